// SPDX-License-Identifier: GPL-3.0-or-later
/// The materials of a body as equations in Dim dimensions see them.
#pragma once

#include "efree/assembly/kinematics.hpp"
#include "efree/materials/material.hpp"
#include "efree/quadrature/discretization.hpp"

#include <optional>
#include <utility>
#include <vector>

namespace efree {

/// A stiffness at small strains, in Voigt order with engineering shear, and what follows from it. "The strains that
/// there are": in the plane xx, yy, xy; m is the trace of these.
template <int Dim> struct Stiffness {
  VoigtMatrix<Dim> C;  ///< stress by strain
  VoigtMatrix<Dim> S;  ///< strain by stress, of the strains that there are, else zero
  /// Stiffness against dilatation: the largest kappa for which C - kappa m m^T is not negative, 1 / (m . S m). Of an
  /// isotropic material lambda + 2 mu / n, n the number of normal strains that there are.
  double kappa;
  /// The strain that pressure makes, per dilatation: kappa S m.
  Voigt<Dim> swelling;
  /// In plane stress: the strain zz is the product of this with the others; else zero.
  Voigt<Dim> thinning;
};

/// All of a stiffness C, its volumetric part kappa m m^T, or what that leaves: the split that averaged dilatations
/// (B-bar) need, none of whose parts is negative whatever the anisotropy.
enum class StiffnessPart { all, volumetric, deviatoric };

/// Tangents at points, equal ones stored once.
template <int Dim> struct PointTangents {
  std::vector<Tangent<Dim>> values;
  std::vector<Index> at;  ///< by point: into `values`

  const Tangent<Dim>& operator[](Index point) const { return values[at[point]]; }
};

/// What materials answer at the points of a discretization.
template <int Dim> struct PointResponses {
  Gradients<Dim> P;             ///< stress, first Piola-Kirchhoff
  Vector energy;                ///< stored [stress]
  Vector dissipated;            ///< in this step [stress]
  Vector history;               ///< after; laid out as Materials::history_size says
  std::vector<Tangent<Dim>> A;  ///< dP/dH; empty if they are not wanted
};

/// By region of a mesh.
template <int Dim> class Materials {
 public:
  /// `plane` means nothing in 3D. Throws InputError for a region without a material, for tangents that are not
  /// symmetric and positive on the strains that there are.
  Materials(std::vector<SharedMaterial> by_region, Plane plane);

  Index num_regions() const { return static_cast<Index>(materials_.size()); }
  /// The stiffness where nothing has happened yet, at X; in `room`, unless all points of the region have the same.
  const Stiffness<Dim>& stiffness(Index region, const Vec<Dim>& X, Stiffness<Dim>& room) const;
  Stiffness<Dim> stiffness(Index region, const Vec<Dim>& X) const {
    Stiffness<Dim> room;
    return stiffness(region, X, room);
  }
  /// Likewise the tangent dP/dH, or a part of it.
  bool is_uniform(Index region) const { return uniform_[region].has_value(); }
  Tangent<Dim> tangent(Index region, const Vec<Dim>& X, StiffnessPart part = StiffnessPart::all) const {
    return tangent_and_kappa(region, X, part).first;
  }
  /// With Stiffness::kappa: the material is asked once.
  std::pair<Tangent<Dim>, double> tangent_and_kappa(Index region, const Vec<Dim>& X, StiffnessPart part) const;
  /// `share` times a part of the tangents at the points of a discretization.
  PointTangents<Dim> tangents(const Discretization<Dim>& discretization, StiffnessPart part = StiffnessPart::all,
                              double share = 1.0) const;
  /// Whether all materials are (Material::linear).
  bool linear() const;
  /// Whether a region's material is one of finite strains (Material::finite_strain).
  bool finite_strain(Index region) const { return materials_[region]->finite_strain(); }
  Plane plane() const { return plane_; }
  /// Numbers that the points of a discretization remember: region after region, in these point after point, each with
  /// all that its material remembers.
  Index history_size(const Discretization<Dim>& discretization) const;
  /// Where in that each point's numbers begin.
  std::vector<Index> history_places(const Discretization<Dim>& discretization) const;
  /// How many a point of a region has.
  Index history_size(Index region) const { return in_plane_[region]->history_size(); }
  /// Asks the materials at all points of a discretization: what gradients H (column = point) make of histories (of that
  /// layout) in a time dt. Throws what materials throw.
  PointResponses<Dim> respond(const Discretization<Dim>& discretization, const Gradients<Dim>& H,
                              const Eigen::Ref<const Vector>& history, double dt, bool tangents) const;
  /// The component along this is the trace of a gradient: of the strains that there are.
  Gradient<Dim> trace() const;
  /// The largest efree::incompressibility in the body: of homogeneous materials, and at the centres of cells.
  double incompressibility(const FineMesh<Dim>& mesh) const;

 private:
  struct Answer {
    Tangent<Dim> A;
    Stiffness<Dim> stiffness;
  };
  /// At points of one region.
  std::vector<Answer> ask(Index region, const Points<Dim>& X) const;
  Tangent<Dim> part_of(const Tangent<Dim>& A, double kappa, StiffnessPart part) const;
  std::vector<std::vector<Index>> points_by_region(const Discretization<Dim>& discretization) const;

  std::vector<SharedMaterial> materials_;
  std::vector<SharedMaterial> in_plane_;  ///< the same in plane stress, if that is it
  Plane plane_;
  std::vector<std::optional<Answer>> uniform_;  ///< by region
};

}  // namespace efree
