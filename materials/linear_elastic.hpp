// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elasticity at small strains.
#pragma once

#include "efree/materials/material.hpp"
#include "efree/materials/moduli.hpp"

namespace efree {

/// Stiffness that is the same in all directions.
struct IsotropicModuli {
  double E = 0.0;   ///< Young's modulus [stress], positive
  double nu = 0.0;  ///< Poisson's ratio, in (-1, 0.5)
};
/// Isotropic: P = lambda tr(eps) I + 2 mu eps, eps the symmetric part of F - I.
class LinearElastic final : public Material {
 public:
  /// Young's modulus [stress], positive, and Poisson's ratio, in (-1, 0.5). Throws InputError for numbers out of range;
  /// `respond` does for those of fields, naming the point.
  LinearElastic(Parameter E, Parameter nu) : LinearElastic(ElasticModuli{.E = std::move(E), .nu = std::move(nu)}) {}
  explicit LinearElastic(const IsotropicModuli& moduli) : LinearElastic(moduli.E, moduli.nu) {}
  /// Any two constants, with the same ranges.
  explicit LinearElastic(const ElasticModuli& moduli) : moduli_(moduli.checked()) {}
  bool homogeneous() const override { return moduli_.is_constant(); }
  bool linear() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  ElasticModuli moduli_;
};

/// Stiffness along three axes that are at right angles to each other.
struct OrthotropicModuli {
  Vec<3> E;                          ///< Young's moduli along the axes [stress]
  Vec<3> nu;                         ///< nu_yz, nu_xz, nu_xy: what a pull along the first of the two takes off along
                                     ///< the second; nu_ij / E_i = nu_ji / E_j
  Vec<3> G;                          ///< shear moduli G_yz, G_xz, G_xy [stress]
  Mat<3> axes = Mat<3>::Identity();  ///< columns: the axes, orthonormal
};
/// Orthotropic (Lekhnitskii 1963): P = C : eps, eps the symmetric part of F - I.
class OrthotropicElastic final : public Material {
 public:
  /// Throws InputError for moduli that are not positive, ratios that make the stiffness indefinite, axes that are not
  /// orthonormal.
  explicit OrthotropicElastic(const OrthotropicModuli& moduli);
  /// With the moduli of x times a positive factor of the place.
  OrthotropicElastic(const OrthotropicModuli& moduli, Parameter factor);
  bool homogeneous() const override { return factor_.is_constant(); }
  bool linear() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  MaterialResponse::Tangent C_;
  Parameter factor_;
};

/// Lame constants, for closed forms: sigma = lambda tr(eps) I + 2 mu eps, in as many dimensions as eps has.
struct Lame {
  double lambda = 0.0;  ///< [stress]
  double mu = 0.0;      ///< [stress]
};
/// Throws InputError for E <= 0 or nu outside (-1, 0.5).
Lame solid_lame(const IsotropicModuli& moduli);
/// In the plane: those of the solid for plane strain and axisymmetry, lambda' = 2 lambda mu / (lambda + 2 mu) for plane
/// stress. Throws like solid_lame.
Lame plane_lame(const IsotropicModuli& moduli, Plane plane);

}  // namespace efree
