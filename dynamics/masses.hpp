// SPDX-License-Identifier: GPL-3.0-or-later
/// Velocities of nodes by impulses, with lumped or consistent masses.
#pragma once

#include "efree/dynamics/state.hpp"

namespace efree {

/// Sum of the values of a row times the columns they stand for, in turn by two sums, as an addition waits for the one
/// before it.
template <int R> Vec<R> row_times(const SparseRows& matrix, Index row, const Points<R>& columns) {
  const Index *column = matrix.innerIndexPtr(), *end = column + matrix.outerIndexPtr()[row + 1];
  const double* value = matrix.valuePtr() + matrix.outerIndexPtr()[row];
  column += matrix.outerIndexPtr()[row];
  Vec<R> even = Vec<R>::Zero(), odd = even;
  for (; column + 1 < end; column += 2, value += 2) {
    even += value[0] * columns.col(column[0]);
    odd += value[1] * columns.col(column[1]);
  }
  if (column < end) even += value[0] * columns.col(column[0]);
  return even + odd;
}

/// nodes.mass = sum of N_a times the masses of the points. Cost: once through all tables.
template <int Dim> void sum_lumped_masses(World<Dim>& world);
/// Likewise nodes.added_mass, of the added masses of the points.
template <int Dim> void sum_added_masses(World<Dim>& world);
/// Throws NumericalError for nodes without mass.
template <int Dim> void require_masses(const World<Dim>& world);
/// Dim x N, velocities by impulses on the nodes: over lumped masses; with consistent ones M by the first terms of
/// D^-1 + D^-1 (D - M) D^-1 + ..., the series of M^-1 (Guermond & Pasquetti 2013). The result is symmetric in the
/// impulses, and of common motions of all nodes it is that of D, so momentum is conserved. Nodes with prescribed
/// velocity along an axis have lumped masses along it.
template <int Dim> void find_velocities(const World<Dim>& world, const Points<Dim>& impulses, Points<Dim>& velocities);
template <int Dim> Points<Dim> velocities_of(const World<Dim>& world, const Points<Dim>& impulses);
/// nodes.momentum such that its velocities are those of the nodes, by conjugate gradients (the series and D^-1 differ
/// by no more eigenvalues than terms); nothing where all masses are lumped.
template <int Dim> void find_momenta(World<Dim>& world);
/// Momentum of a node, half a step ago.
template <int Dim> Vec<Dim> momentum_of(const World<Dim>& world, Index node) {
  const bool lumped = !world.consistent_mass.any() || world.consistent_mass.terms[world.nodes.body[node]] == 1;
  return lumped ? Vec<Dim>(world.nodes.mass[node] * world.nodes.v.col(node)) : Vec<Dim>(world.nodes.momentum.col(node));
}

}  // namespace efree
