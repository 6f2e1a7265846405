// SPDX-License-Identifier: GPL-3.0-or-later
/// What resists dilatations that deviate from the averaged ones of their pressure patch where material flows.
#pragma once

#include "efree/assembly/materials.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/equations/equilibrium.hpp"

#include <vector>

namespace efree::internal {

/// By quadrature point the modulus k against deviations of its dilatation from the averaged one [stress].
/// Where all materials are elastic bearable_kappas. Where one flows all points have patches, also those that do not
/// need them: as long as functions bear the bulk modulus (bearable_incompressibility) k is all of it, so that what has
/// not yielded is as stiff as without patches; else it is bearable_kappa. Zero in space where materials flow:
/// patch_shears.
template <int Dim> std::vector<double> patch_moduli(const Approximation<Dim>& approximation,
                                                    const Materials<Dim>& materials, const ElasticModel& model);

/// In the plane and in bodies of revolution materials that flow see the deviation of a point's dilatation from the
/// averaged one as a shear out of the plane, gamma_K = c_K (theta_K - theta_averaged), c_K = sqrt(k_K / G). There is no
/// other such shear, so that in isotropic materials it couples with no other strain: elastic ones have the energy k
/// (theta_K - theta_averaged)^2 / 2, and flow limits its stress as that of any part of the deviator. Without it
/// deviations cost next to nothing where material flows, and rings lose their shape; an elastic energy would grow
/// without bounds and lock. Space has no strain to spare. By point c_K, zero where materials are elastic. Empty in
/// space, in plane stress, and where nothing flows.
template <int Dim> std::vector<double> patch_shears(const Approximation<Dim>& approximation,
                                                    const Materials<Dim>& materials, const ElasticModel& model,
                                                    const std::vector<double>& moduli);

/// What materials answer at points, also to shears out of the plane.
template <int Dim> struct ShearedResponses : PointResponses<Dim> {
  Vector shear_stress;               ///< by point: work on the shear [stress]; empty if there are no shears
  Gradients<Dim> stress_by_shear;    ///< dP / dgamma
  Gradients<Dim> shear_by_gradient;  ///< d shear_stress / dH
  Vector shear_stiffness;            ///< d shear_stress / dgamma
};
/// Materials::respond; with shears out of the plane (by point, 2D) unless these are empty, which the materials of the
/// model see as F(3, 1).
template <int Dim> ShearedResponses<Dim> respond(const Materials<Dim>& materials, const ElasticModel& model,
                                                 const Discretization<Dim>& points, const Gradients<Dim>& H,
                                                 const Vector& shears, const Vector& history, double dt, bool tangents);

}  // namespace efree::internal
