// SPDX-License-Identifier: GPL-3.0-or-later
/// What the stiffness of an approximation is made of.
#pragma once

#include "efree/assembly/nitsche.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/equations/equilibrium.hpp"

#include <vector>

namespace efree {

/// The stiffness as a sum of terms with their own quadrature: the share `stabilisation` of the deviatoric part by full
/// integration, the volumetric part on pressure patches where the approximation has them, less what points bear of it
/// (bearable_kappas; empty: nothing). They refer to the approximation. Throws InputError for a stabilisation out of
/// range or without full integration.
template <int Dim> std::vector<StiffnessTerm<Dim>> stiffness_terms(const Approximation<Dim>& approximation,
                                                                   const Materials<Dim>& materials,
                                                                   double stabilisation = 0.0,
                                                                   const std::vector<double>& bearable = {});

/// Of a stiffness against dilatation, what the points bear where dilatations of elastic materials are averaged: what
/// twice its (least) shear modulus has of it. The rest, lambda of an isotropic solid, is on the patches, as in
/// selective integration (Hughes 1980); so waves as short as a patch do not find a body that has no stiffness against
/// them.
template <int Dim> double bearable_kappa(const Stiffness<Dim>& stiffness);

/// By quadrature point, on patches of a cloud; zero where materials flow, since these would lock by it. Empty without
/// patches, and for finite elements, whose patches are single cells.
template <int Dim> std::vector<double> bearable_kappas(const Approximation<Dim>& approximation,
                                                       const Materials<Dim>& materials, const ElasticModel& model);

/// Forces by which these terms answer coefficients U (Dim x N).
template <int Dim> Points<Dim> forces_of(const std::vector<StiffnessTerm<Dim>>& terms, const Points<Dim>& U);

/// Whether a stabilisation makes a difference. Throws InputError if it lacks full integration.
template <int Dim> bool is_stabilised(const Approximation<Dim>& approximation, double stabilisation);

}  // namespace efree
