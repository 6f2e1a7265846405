// SPDX-License-Identifier: GPL-3.0-or-later
/// Single numbers of an answer, displacements at points and reactions of parts, and how wrong they are: by dual
/// solutions (Becker & Rannacher 2001).
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/basis/fine_space.hpp"

#include <string>
#include <vector>

namespace efree {

/// A number that is linear in the displacement u: the work of forces on it, and that of what holds a part of the
/// boundary if the part moves: `forces` . u + reactions . (`motion` + `weak_motion`).
template <int Dim> struct Functional {
  Points<Dim> forces;       ///< Dim x space.size(), at the fine degrees of freedom
  Points<Dim> motion;       ///< likewise, of what nodal values hold; empty if nothing moves
  Points<Dim> weak_motion;  ///< likewise, of what is held weakly (Nitsche)

  bool moves() const { return !motion.isZero(0.0) || !weak_motion.isZero(0.0); }
};

/// A functional's dual solution: the displacement z with a(v, z) = functional of v for all v that vanish where nodal
/// values hold the body, and z = -motion there.
template <int Dim> struct DualSolution {
  Points<Dim> displacement;  ///< z, Dim x space.size()
  double error = 0.0;        ///< of z against that of the finite elements; relative, in the energy norm
  int iterations = 0;        ///< for z
};

/// The displacement at a point along a direction. Throws InputError like probe.
template <int Dim>
Functional<Dim> displacement_at(const FineSpace<Dim>& space, const Vec<Dim>& at, const Vec<Dim>& direction);

/// The component along a direction of the force by which what is prescribed on a part holds the body [force; in the
/// plane per thickness, axisymmetric in full turns]. Where parts overlap each has a like share of what several
/// prescribe. `all_weakly`: every condition is set by Nitsche; else only those that nodal values cannot hold. Throws
/// InputError if nothing is prescribed on the part.
template <int Dim> Functional<Dim> reaction_of(const FineSpace<Dim>& space,
                                               const std::vector<DisplacementCondition<Dim>>& conditions,
                                               const std::vector<TiedFacets>& ties, const std::string& part,
                                               const Vec<Dim>& direction, bool all_weakly = false);

/// What the share that parts which meet have at the nodes between them makes of a reaction: the work of the tractions
/// of a stress (at the places of the space) on what the functional moves beyond the facets of the part, and does
/// not on them. Zero where no other part is next to it; of the order of an edge else.
template <int Dim>
double shared_work(const FineSpace<Dim>& space, const std::vector<DisplacementCondition<Dim>>& conditions,
                   const std::string& part, const Vec<Dim>& direction, const Functional<Dim>& reaction,
                   const VoigtPoints<Dim>& stress, bool all_weakly = false);

}  // namespace efree
