// SPDX-License-Identifier: GPL-3.0-or-later
/// Stiffness of what an image has in the parts of a grid's cells.
#pragma once

#include "efree/geometry/input/box_averages.hpp"
#include "efree/materials/material.hpp"
#include "efree/solvers/cells/internal/cell_anisotropy.hpp"
#include "efree/solvers/cells/internal/cell_parts.hpp"

#include <array>
#include <optional>
#include <utility>
#include <vector>

namespace efree::internal {

/// Values by label, as averages over boxes take them: 1 of these, 0 of others.
std::vector<float> ones_of(const std::vector<Label>& labels);

/// An anisotropic material and the labels that have it.
struct AnisotropicLabels {
  std::vector<Label> labels;
  VoigtMatrix<3> C;              ///< along the image's axes, at `place`
  IsotropicStiffness isotropic;  ///< isotropic_part
  Vec<3> place;                  ///< in the world
  SharedMaterial varying{};      ///< of one label, C times a factor that differs from place to place; null: homogeneous
};

/// Stiffness of the labels, C_xyxy and C_xxyy, in units of the largest C_xyxy (where it varies: of that at some point;
/// of anisotropic materials of the isotropic part).
struct LabelStiffness {
  std::vector<float> shear, across, solid;  ///< by label; the first two 0 where they vary, and of anisotropic materials
  std::vector<double> exact_shear, exact_across;          ///< these two before rounding
  std::vector<std::pair<Label, SharedMaterial>> varying;  ///< materials that differ from place to place
  std::vector<AnisotropicLabels> anisotropic;             ///< of different stiffness
  double unit = 0.0;                                      ///< [stress]

  /// Throws InputError for a label without material, or an image that is all void.
  LabelStiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials);
  /// Whether any material differs from place to place.
  bool varies() const;
  /// What anisotropic materials have beyond their isotropic parts.
  std::vector<VoigtMatrix<3>> anisotropy() const;
};

/// Stiffness by part of a grid over an image, layer by layer. Keeps references to the image and the stiffness.
class PartsOfImage {
 public:
  /// Of a grid of so many cells. `grown` as of box_averages.
  PartsOfImage(const LabelImage<3>& image, const LabelStiffness& stiffness, const std::array<Index, 3>& cells,
               double grown);
  /// Of the layers [begin, end) of cells: of anisotropic materials the isotropic parts, and the shares, times the
  /// factor by which they vary. Throws InputError for a material that varies by more than a factor and is not isotropic
  /// somewhere.
  Parts layers(Index begin, Index end) const;
  /// Of the labels, as whole parts have them; none where they vary.
  const std::vector<PartStiffness>& exact() const { return exact_; }
  /// How much of a part is material, over its C_xyxy, if that is the same everywhere.
  std::optional<float> solid_over_shear() const { return solid_over_shear_; }

 private:
  const LabelImage<3>& image_;
  const LabelStiffness& stiffness_;
  std::array<Index, 3> boxes_;
  BoxAverages shear_;
  std::optional<BoxAverages> across_;  ///< none: as shear, times the ratio
  std::optional<float> ratio_, solid_over_shear_;
  std::vector<BoxAverages> of_varying_;         ///< by material that varies: how much of it there is
  std::vector<BoxAverages> of_anisotropic_;     ///< likewise by anisotropic material
  std::vector<BoxRange> boxes_of_anisotropic_;  ///< that may have some of it
  std::optional<BoxAverages> all_anisotropic_;  ///< of all of these, if there are several
  std::vector<PartStiffness> exact_;
};

/// Adds the isotropic parts of materials to moduli, by Parts::shares. Shares that are whole but for rounding are.
void add_isotropic_parts(const std::vector<AnisotropicLabels>& materials, Parts& parts);

/// The same stiffness where no corner of a cell moves freely: a cell with one or two parts of material, each of which
/// has one point for strains, has more corners than strains, and loads on these would move them without end. Of a wall
/// that is one part thick between void a thirtieth is put into the empty part beside it in the cell, and a tenth of
/// cells with up to three parts of material is spread over all of their parts. Stiffness against constant strains
/// stays.
PartLayers stabilised(PartLayers layers, const std::array<Index, 3>& cells);

}  // namespace efree::internal
