// SPDX-License-Identifier: GPL-3.0-or-later
/// Nearly incompressible materials, under which functions lock unless dilatations are averaged (B-bar).
#pragma once

#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/equations/equilibrium.hpp"

namespace efree {

/// The largest efree::incompressibility in a body; 0 in plane stress, where it can always thin out and nothing locks.
/// Throws like materials_of.
template <int Dim> double incompressibility(const ElasticModel& model, const FineMesh<Dim>& mesh);

/// Whether some material flows: plastic flow keeps the volume, and functions lock under it as under pressure; not in
/// plane stress.
bool flows(const ElasticModel& model);

/// Whether no material flows.
bool is_elastic(const ElasticModel& model);

/// What functions of this kind bear of it: 4.67 (nu = 0.4) for moving least squares and linear elements, 50 (nu = 0.49)
/// for quadratic ones.
double bearable_incompressibility(BasisKind kind);

/// Throws InputError if functions of which nobody said whether they average dilatations (Dilatation::automatic) would
/// lock under the materials of the model, or as these flow.
template <int Dim> void require_decided(const Approximation<Dim>& approximation, const ElasticModel& model);

}  // namespace efree
