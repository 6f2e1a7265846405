// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective properties of an image or a unit cell: from the geometry and its materials to a tensor with its
/// engineering constants, symmetry and bounds.
#pragma once

#include "efree/analysis/elastic_symmetry.hpp"
#include "efree/analysis/mesh_source.hpp"
#include "efree/analysis/plane_symmetry.hpp"
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

/// Which effective property, under which conditions.
template <int Dim> struct EffectiveSettings {
  /// Title, places and, for the stiffness, materials and in the plane model.plane: strain or stress.
  CommonSettings<Dim> common{};
  EffectiveProperty property = EffectiveProperty::stiffness;
  FrameCondition frame = FrameCondition::periodic;
  std::vector<RegionConductivity> conductivities{};
  // Of images in space only.
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

/// Bounds on the moduli of isotropic arrangements of the phases.
struct PhaseBounds {
  std::array<double, 2> voigt_reuss;  ///< lower and upper (Reuss 1929, Voigt 1889)
  /// Lower and upper (Hashin & Shtrikman 1963; Walpole 1966; in the plane Hashin 1965).
  std::array<double, 2> hashin_shtrikman;
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

/// Effective properties and their errors.
struct EffectiveResult {
  int dim = 3;             ///< 2: in the plane, where tensors are 3 x 3 by xx, yy, xy or 2 x 2
  EffectiveTensor tensor;  ///< on meshes edges are the mean ones of their cells
  bool on_mesh = false;
  std::vector<VolumeFraction> fractions{};
  /// Axes along which there is no stiffness (conductivity): void (an insulator) cuts the volume.
  std::array<bool, 3> is_cut{};
  Matrix inverse{};                               ///< compliance or resistivity; empty if the tensor is singular
  std::optional<ElasticSymmetry> symmetry{};      ///< in space
  std::optional<PlaneSymmetry> plane_symmetry{};  ///< in the plane
  SymmetryClass nearest = SymmetryClass::none;
  PlaneSymmetryClass plane_nearest = PlaneSymmetryClass::none;
  double class_tolerance = 0.0;                  ///< relative distance up to which a class counts
  std::optional<double> universal_anisotropy{};  ///< in space
  /// kappa is in the plane that of the symmetry: mean stress in the plane over the change of area.
  std::optional<PhaseBounds> kappa_bounds{}, mu_bounds{}, conductivity_bounds{};
  Vector principal{};       ///< of the conductivity, descending
  Matrix principal_axes{};  ///< of the conductivity, by column
  std::optional<SubvolumeStatistics> subvolumes{};
  std::vector<std::string> warnings{};
  StageTimes times{};
};

/// Effective properties of an image on the grid of its voxels. Throws as effective_stiffness and
/// effective_conductivity; InputError also for a region without material or conductivity, a material of a region that
/// is not there, subvolumes that do not divide the numbers of voxels, and void that leaves no stiffness at all.
EffectiveResult find_effective(const EffectiveSettings<3>& settings, const MadeImage<3>& image,
                               const Monitor& monitor = {});

/// Likewise of a unit cell that a mesh fills, the box around it being its frame: quadratic elements on the mesh of the
/// source and ones of two and four times its size, from which the error comes; coarser meshes that cannot be made are
/// left out, with a remark. Throws as prepare and effective_stiffness on meshes; InputError also for more cells than
/// there is memory for.
template <int Dim> EffectiveResult find_effective(const EffectiveSettings<Dim>& settings, const MeshSource<Dim>& source,
                                                  const Monitor& monitor = {});

}  // namespace efree
