// SPDX-License-Identifier: GPL-3.0-or-later
/// Stiffness of what an image has in the parts of a grid's cells.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/materials/material.hpp"

#include <array>
#include <limits>
#include <utility>
#include <vector>

namespace efree::internal {

/// C_xyxy and C_xxyy by part of a grid's cells.
struct Parts {
  std::vector<float> shear, across;
};

/// Stiffness of the labels, C_xyxy and C_xxyy, in units of the largest C_xyxy (where it varies: of that at some point).
struct LabelStiffness {
  std::vector<float> shear, across, solid;                ///< by label; the first two 0 where they vary
  std::vector<double> exact_shear, exact_across;          ///< these two before rounding
  std::vector<std::pair<Label, SharedMaterial>> varying;  ///< materials that differ from place to place
  double unit = 0.0;                                      ///< [stress]
  float least_ratio = std::numeric_limits<float>::max(), most_ratio = std::numeric_limits<float>::lowest();

  /// Throws InputError for a label without material or with one that is not isotropic, or an image that is all void.
  LabelStiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials);
  /// So that the ratios hold those of all parts.
  void widen_ratios(const Parts& parts);
};

/// By part of a grid of so many cells, two to a cell along each axis, x fastest. `grown` as of box_averages. Throws
/// InputError for a material that is not isotropic somewhere.
Parts parts_of(const LabelImage<3>& image, const LabelStiffness& stiffness, const std::array<Index, 3>& cells,
               double grown);

}  // namespace efree::internal
