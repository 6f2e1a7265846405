// SPDX-License-Identifier: GPL-3.0-or-later
/// Points that have come too near to each other become one.
#include "efree/otm/internal/motion.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <set>

namespace efree::internal {

/// Points of cells that have collapsed, as nodes of theirs became one, are to fuse with one of the same chunk that has
/// most corners in common, the nearest of these.
template <int Dim> void Motion<Dim>::pair_points() {
  bool found = false;
  for (auto& chunk : chunks) {
    const BodyOf& body = bodies[chunk.body];
    if (!body.renewed || body.cells.cols() == 0) continue;
    const auto corners = [&](Index p) {
      const auto cell = body.cells.col(chunk.number[p]);
      return std::set<Index>(cell.begin(), cell.end());
    };
    const auto is_collapsed = [&](Index p) {
      const auto cell = body.cells.col(chunk.number[p]);
      for (int i = 0; i <= Dim; ++i)
        for (int j = 0; j < i; ++j)
          if (cell[i] == cell[j]) return true;
      return false;
    };
    std::vector<Index> collapsed;
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && !chunk.is_crushed(p) && is_collapsed(p)) collapsed.push_back(p);
    if (collapsed.empty()) continue;
    std::set<Index> busy(collapsed.begin(), collapsed.end());
    busy.insert(chunk.crushed.begin(), chunk.crushed.end());
    deform(chunk, x);
    for (Index p = 0; p < chunk.size(); ++p) place(chunk, p);
    for (const Index p : collapsed) {
      const std::set<Index> of_p = corners(p);
      Index with = -1, shared_with = 0;
      double distance = 0.0;
      for (Index q = 0; q < chunk.size(); ++q) {
        if (busy.contains(q) || chunk.is_eroded(q)) continue;
        const std::set<Index> of_q = corners(q);
        const auto shared = static_cast<Index>(
            std::count_if(of_p.begin(), of_p.end(), [&](Index corner) { return of_q.contains(corner); }));
        const double away = (chunk.at.col(q) - chunk.at.col(p)).squaredNorm();
        if (shared > shared_with || (shared > 0 && shared == shared_with && away < distance)) {
          with = q;
          shared_with = shared;
          distance = away;
        }
      }
      if (with < 0) continue;
      busy.insert(with);
      // The larger goes on, in the cell that is left.
      const bool is_larger = chunk.mass[p] > chunk.mass[with];
      if (is_larger) std::swap(chunk.number[p], chunk.number[with]);
      chunk.pairs.push_back(
          {.first = is_larger ? p : with, .second = is_larger ? with : p, .pairing = OtmPairing::fuse});
      chunk.wear(p);
      chunk.wear(with);
      found = true;
    }
  }
  if (found) find_points();
}

/// The first of every pair that fuses gets the volume and mass of both; of what they have felt it keeps its own, but
/// for the dilatation, by which the volume that both fill stays what it is. What others of a union say of its
/// dilatation counts anew: they are scaled, so that it stays.
template <int Dim> void Motion<Dim>::fuse_pairs() {
  std::vector<std::vector<Index>> gone(bodies.size());
  for (auto& chunk : chunks) {
    if (std::none_of(chunk.pairs.begin(), chunk.pairs.end(), [](const auto& pair) { return pair.fuses(); })) continue;
    deform(chunk, x);
    for (Index p = 0; p < chunk.size(); ++p) place(chunk, p);
    const auto own = [&](Index p) {
      return chunk.since[p].determinant() * Eigen::Map<const Mat<3>>(chunk.made.col(p).data()).determinant();
    };
    // As materials feel it: each with the dilatation of its union.
    const auto energy = [&](const Vector& dilatation) {
      Deformation felt = chunk.now;
      felt.heat.resize(0);
      for (Index p = 0; p < chunk.size(); ++p) {
        const Mat<3> F = chunk.since[p] * Eigen::Map<const Mat<3>>(chunk.made.col(p).data());
        Eigen::Map<Mat<3>>(felt.F.col(p).data()) = F * std::cbrt(dilatation[p] / F.determinant());
      }
      const MaterialResponse response = respond(*bodies[chunk.body].material, felt, false);
      return chunk.volume.dot(response.energy) +
             (response.dissipated.size() == 0 ? 0.0 : chunk.volume.dot(response.dissipated));
    };
    const auto mean = [&](std::size_t u, const auto& of) {
      double sum = 0.0, volume = 0.0;
      for (Index p = chunk.unions[u]; p < chunk.unions[u + 1]; ++p) {
        sum += chunk.volume[p] * of(p);
        volume += chunk.volume[p];
      }
      return volume > 0.0 ? sum / volume : 1.0;
    };
    Vector dilatation(chunk.size());
    for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u)
      dilatation.segment(chunk.unions[u], chunk.unions[u + 1] - chunk.unions[u]).setConstant(mean(u, own));
    const double before = energy(dilatation);
    std::vector<char> goes(chunk.size(), 0);
    for (const auto& pair : chunk.pairs) {
      if (!pair.fuses()) continue;
      const Index p = pair.first, q = pair.second;
      const double volume = chunk.volume[p] + chunk.volume[q];
      dilatation[p] = (chunk.volume[p] * dilatation[p] + chunk.volume[q] * dilatation[q]) / volume;
      chunk.volume[p] = volume;
      chunk.mass[p] += chunk.mass[q];
      chunk.penalty[p] += chunk.penalty[q];
      chunk.volume[q] = chunk.mass[q] = 0.0;
      goes[q] = 1;
      gone[chunk.body].push_back(chunk.number[q]);
    }
    for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
      const double wanted = mean(u, [&](Index p) { return dilatation[p]; }), is = mean(u, own);
      for (Index p = chunk.unions[u]; p < chunk.unions[u + 1]; ++p) {
        chunk.made.col(p) *= std::cbrt(wanted / is);
        chunk.dilatation[p] = dilatation[p] = wanted;
      }
    }
    renewal_loss += before - energy(dilatation);
    std::vector<Index> from;
    for (Index p = 0; p < chunk.size(); ++p)
      if (goes[p] == 0) from.push_back(p);
    chunk.take(from);
  }
  bool found = false;
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b) {
    std::vector<Index>& numbers = gone[b];
    if (numbers.empty()) continue;
    found = true;
    counts.fused += static_cast<Index>(numbers.size());
    std::sort(numbers.begin(), numbers.end());
    Cells<Dim>& cells = bodies[b].cells;
    Index next = 0;
    for (Index c = 0; c < cells.cols(); ++c)
      if (!std::binary_search(numbers.begin(), numbers.end(), c)) cells.col(next++) = cells.col(c).eval();
    cells.conservativeResize(Eigen::NoChange, next);
    bodies[b].outer.clear();
    for (auto& chunk : chunks) {
      if (chunk.body != static_cast<Index>(b)) continue;
      for (Index& number : chunk.number)
        number -= static_cast<Index>(std::lower_bound(numbers.begin(), numbers.end(), number) - numbers.begin());
    }
  }
  if (!found) return;
  find_points();
  ball_offsets.clear();
}

template void Motion<2>::pair_points();
template void Motion<3>::pair_points();
template void Motion<2>::fuse_pairs();
template void Motion<3>::fuse_pairs();

}  // namespace efree::internal
