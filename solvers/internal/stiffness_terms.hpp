// SPDX-License-Identifier: GPL-3.0-or-later
/// What the stiffness of an approximation is made of.
#pragma once

#include "efree/assembly/nitsche.hpp"
#include "efree/quadrature/approximation.hpp"

#include <vector>

namespace efree {

/// The stiffness as a sum of terms with their own quadrature: the share `stabilisation` of the deviatoric part by full
/// integration, the volumetric part on coarser unions where the approximation has them (of linear materials less
/// bearable_kappa). They refer to the approximation. Throws InputError for a stabilisation out of range or without full
/// integration.
template <int Dim> std::vector<StiffnessTerm<Dim>> stiffness_terms(const Approximation<Dim>& approximation,
                                                                   const Materials<Dim>& materials,
                                                                   double stabilisation = 0.0);

/// Of a stiffness against dilatation, what functions bear without locking, however much more there is of it: that of
/// nu = 3/8 with the same (least) shear modulus, lambda = 3 mu. Where dilatations of elastic materials are averaged
/// only the rest is on the unions, and this on the points; so waves as short as a union do not find a body that has no
/// stiffness against them.
template <int Dim> double bearable_kappa(const Stiffness<Dim>& stiffness);

/// By quadrature point, on unions of a cloud; zero for finite elements, whose unions are single cells.
template <int Dim>
std::vector<double> bearable_kappas(const Approximation<Dim>& approximation, const Materials<Dim>& materials);

/// Forces by which these terms answer coefficients U (Dim x N).
template <int Dim> Points<Dim> forces_of(const std::vector<StiffnessTerm<Dim>>& terms, const Points<Dim>& U);

/// Whether a stabilisation makes a difference. Throws InputError if it lacks full integration.
template <int Dim> bool is_stabilised(const Approximation<Dim>& approximation, double stabilisation);

}  // namespace efree
