// SPDX-License-Identifier: GPL-3.0-or-later
/// Masses of nodes, lumped or not, and velocities by impulses.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Masses of nodes, over their mean, that are raised to this.
constexpr double least_mass = 0.35;

}  // namespace

/// Lumped masses, and of bodies with more than one term the consistent ones.
template <int Dim> void Motion<Dim>::find_masses() {
  const auto N = static_cast<Index>(x.cols());
  mass.setZero(N);
  std::vector<Eigen::Triplet<double, Index>> entries;  // N times the root of the point's mass
  for (const auto& chunk : chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const Index a = chunk.nodes[chunk.local[e]];
        mass[a] += chunk.mass[p] * chunk.entries[e].N;
        if (bodies[chunk.body].mass_terms > 1)
          entries.emplace_back(bodies[chunk.body].first_point + chunk.number[p], a,
                               std::sqrt(chunk.mass[p]) * chunk.entries[e].N);
      }
  const auto check = [&] {
    for (std::size_t b = 0; b + 1 < bodies.size(); ++b)
      for (Index a = bodies[b].first_node; a < bodies[b + 1].first_node; ++a)
        if (!(mass[a] > 0.0))
          throw NumericalError(
              fmt::format("node {} of body {} at ({:.6g}) has no mass: no material point is near it, or "
                          "functions are negative there; try another spacing or seed of the nodes",
                          a - bodies[b].first_node, b, fmt::join(x.col(a), ", ")));
  };
  if (!fixed) return check();
  SparseRows values(static_cast<Index>(place_of_point.size()), N);
  values.setFromTriplets(entries.begin(), entries.end());
  const SparseRows by_node = values.transpose();
  coupling = by_node * values;
  for (Index b = 0; b + 1 < static_cast<Index>(bodies.size()); ++b)
    if (bodies[b].mass_terms > 1) raise_light_masses(b);
  check();
  find_free();
  nodal_momentum = v * mass.asDiagonal();
}

/// Nodes that are much lighter than others make steps short: they get mass of their neighbours, such that the mass of
/// all and its centre stay where they are.
template <int Dim> void Motion<Dim>::raise_light_masses(Index body) {
  const Index first = bodies[body].first_node, end = bodies[body + 1].first_node;
  const double least = least_mass * mass.segment(first, end - first).mean();
  for (Index a = first; a < end; ++a) {
    if (mass[a] >= least) continue;
    Mat<Dim + 1> moment = Mat<Dim + 1>::Zero();
    const auto basis = [&](Index b) {
      Vec<Dim + 1> result;
      result << 1.0, (x.col(b) - x.col(a)) / spacing[a];
      return result;
    };
    std::vector<Index> around;
    for (SparseRows::InnerIterator entry(coupling, a); entry; ++entry)
      if (entry.value() > 0.0 && mass[entry.col()] > 2.0 * least) {
        around.push_back(entry.col());
        moment += basis(entry.col()) * basis(entry.col()).transpose();
      }
    const Vec<Dim + 1> by = moment.ldlt().solve(Vec<Dim + 1>::Unit(0));
    if (!((moment * by - Vec<Dim + 1>::Unit(0)).norm() < 1e-9)) continue;
    const double more = least - mass[a];
    const bool bearable =
        std::ranges::all_of(around, [&](Index b) { return mass[b] - more * by.dot(basis(b)) > least; });
    if (!bearable) continue;
    for (const Index b : around) mass[b] -= more * by.dot(basis(b));
    mass[a] = least;
  }
}

template <int Dim> void Motion<Dim>::find_free() {
  free.setOnes(Dim, x.cols());
  for (const auto& [node, axis, velocity] : prescribed) free(axis, node) = 0.0;
  if (fixed) pull = (coupling * free.transpose()).transpose();
}

/// Velocities that impulses on the nodes make: with lumped masses D and consistent ones M the first terms of
/// D^-1 + D^-1 (D - M) D^-1 + ..., the series of M^-1 (Guermond & Pasquetti 2013). It is symmetric, and does to motions
/// that all nodes share what D does, so momentum is conserved. Nodes that are held along an axis have lumped masses
/// along it.
template <int Dim> void Motion<Dim>::find_velocities(const Points<Dim>& impulses, Points<Dim>& result) const {
  const auto N = static_cast<Index>(x.cols());
  result.resize(Dim, N);
  parallel_for(N, [&](Index a) {
    if (mass[a] > 0.0)
      result.col(a) = impulses.col(a) / mass[a];
    else
      result.col(a).setZero();
  });
  Index terms = 1;
  for (const BodyOf& body : bodies) terms = std::max(terms, body.mass_terms);
  for (Index k = 1; k < terms; ++k) {
    Points<Dim>& before = seen_by_mass;
    before = free.cwiseProduct(result);
    parallel_for(N, [&](Index a) {
      if (bodies[body_of_node[a]].mass_terms <= k) return;
      Vec<Dim> drawn = pull.col(a).cwiseProduct(result.col(a));
      for (SparseRows::InnerIterator entry(coupling, a); entry; ++entry)
        drawn -= entry.value() * before.col(entry.col());
      result.col(a) = (impulses.col(a) + free.col(a).cwiseProduct(drawn)) / mass[a];
    });
  }
}

template <int Dim> Points<Dim> Motion<Dim>::velocities_of(const Points<Dim>& impulses) const {
  Points<Dim> velocities;
  find_velocities(impulses, velocities);
  return velocities;
}

/// The momenta whose velocities are those of the nodes, by conjugate gradients: there are no more different numbers
/// than terms between the series and D^-1.
template <int Dim> void Motion<Dim>::find_momenta() {
  if (!fixed) return;
  nodal_momentum = v * mass.asDiagonal();
  Points<Dim> off = v - velocities_of(nodal_momentum), way = off * mass.asDiagonal(), weighted = way;
  const double enough = 1e-30 * v.cwiseProduct(nodal_momentum).sum();
  double size = off.cwiseProduct(weighted).sum();
  for (int k = 0; k < 100 && size > enough; ++k) {
    const Points<Dim> change = velocities_of(way);
    const double length = size / way.cwiseProduct(change).sum();
    nodal_momentum += length * way;
    off -= length * change;
    weighted = off * mass.asDiagonal();
    const double next = off.cwiseProduct(weighted).sum();
    way = weighted + next / size * way;
    size = next;
  }
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
