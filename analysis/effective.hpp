// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective properties of an image or a unit cell: from the geometry and its materials to a tensor and what it says.
#pragma once

#include "efree/analysis/elastic_symmetry.hpp"
#include "efree/analysis/mesh_source.hpp"
#include "efree/analysis/settings.hpp"
#include "efree/solvers/cells/effective.hpp"

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace efree {

enum class EffectiveProperty { stiffness, conductivity };

/// Conductivity of a region, and where it was said.
struct RegionConductivity {
  std::string region;  ///< empty: of the whole body
  double value;        ///< flux over gradient
  std::string where{};
};

/// What is asked of an image or a unit cell.
struct EffectiveSettings {
  CommonSettings<3> common{};  ///< title, places and, for the stiffness, materials
  EffectiveProperty property = EffectiveProperty::stiffness;
  FrameCondition frame = FrameCondition::periodic;
  std::vector<RegionConductivity> conductivities{};
  /// Parts of the image along each axis, each with a tensor of its own (kinematic conditions, or periodic if the whole
  /// has these); 1: none.
  Index subvolumes = 1;
  double size = 0.0;   ///< of cells, as EffectiveOptions::size
  bool smooth = true;  ///< as EffectiveOptions::smooth
};

/// A part of the volume.
struct VolumeFraction {
  std::string region;  ///< "void" of label 0
  double fraction;
};

/// Bounds on the moduli of what is isotropic.
struct PhaseBounds {
  std::array<double, 2> voigt_reuss;       ///< lower and upper (Reuss 1929, Voigt 1889)
  std::array<double, 2> hashin_shtrikman;  ///< lower and upper (Hashin & Shtrikman 1963; Walpole 1966)
};

/// Tensors of equal parts of the volume.
struct SubvolumeStatistics {
  Index count = 0;
  Matrix mean{}, deviation{};  ///< by component: mean and standard deviation
  double spread = 0.0;         ///< norm of the deviation over that of the mean
  /// Distance of their mean from the whole's tensor, relative to its norm: what the conditions on their frames add.
  double bias = 0.0;
  /// Expected relative spread of the whole volume's tensor, spread / sqrt(count): parts are independent (Kanit et al.
  /// 2003, with an integral range that is small against them).
  double expected_spread = 0.0;
};

/// Effective properties, their errors and what they say.
struct EffectiveResult {
  EffectiveTensor tensor;  ///< on meshes edges are the mean ones of their cells
  bool on_mesh = false;
  std::vector<VolumeFraction> fractions{};
  /// Axes along which there is no stiffness (conductivity): void (an insulator) cuts the volume.
  std::array<bool, 3> is_cut{};
  Matrix inverse{};  ///< compliance or resistivity; empty if the tensor is singular
  std::optional<ElasticSymmetry> symmetry{};
  SymmetryClass nearest = SymmetryClass::none;
  double class_tolerance = 0.0;  ///< relative distance up to which a class counts
  std::optional<double> universal_anisotropy{};
  std::optional<PhaseBounds> kappa_bounds{}, mu_bounds{}, conductivity_bounds{};
  Vec<3> principal = Vec<3>::Zero();       ///< of the conductivity, descending
  Mat<3> principal_axes = Mat<3>::Zero();  ///< of the conductivity, by column
  std::optional<SubvolumeStatistics> subvolumes{};
  std::vector<std::string> warnings{};
  StageTimes times{};
};

/// Solves, and interprets the tensor. Throws as effective_stiffness and effective_conductivity; InputError also for a
/// region without material or conductivity, a material of a region that is not there, subvolumes that do not divide the
/// numbers of voxels, and void that leaves no stiffness at all.
EffectiveResult find_effective(const EffectiveSettings& settings, const MadeImage<3>& image,
                               const Monitor& monitor = {});

/// Likewise of a unit cell that a mesh fills, the box around it being its frame: quadratic elements on the mesh of the
/// source and ones of two and four times its size, from which the error comes. Throws as prepare and
/// effective_stiffness on meshes; InputError also for more cells than there is memory for.
EffectiveResult find_effective(const EffectiveSettings& settings, const MeshSource<3>& source,
                               const Monitor& monitor = {});

}  // namespace efree
