// SPDX-License-Identifier: GPL-3.0-or-later
/// Material points that have come too near to each other are merged.
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <set>

namespace efree::internal {
namespace {

template <int Dim> std::set<Index> corners(const World<Dim>& world, const Chunk<Dim>& chunk, Index p) {
  const auto cell = world.bodies[chunk.body].cells.col(chunk.number[p]);
  return {cell.begin(), cell.end()};
}

/// The point to merge with: of those not busy that of most corners in common, the nearest of these; -1: none.
template <int Dim>
Index find_partner(const World<Dim>& world, const Chunk<Dim>& chunk, Index p, const std::set<Index>& busy) {
  const std::set<Index> of_p = corners(world, chunk, p);
  Index with = -1, shared_with = 0;
  double distance = 0.0;
  for (Index q = 0; q < chunk.size(); ++q) {
    if (busy.contains(q) || chunk.is_eroded(q)) continue;
    const std::set<Index> of_q = corners(world, chunk, q);
    const auto shared = static_cast<Index>(
        std::count_if(of_p.begin(), of_p.end(), [&](Index corner) { return of_q.contains(corner); }));
    const double away = (chunk.matter.x.col(q) - chunk.matter.x.col(p)).squaredNorm();
    if (shared > shared_with || (shared > 0 && shared == shared_with && away < distance)) {
      with = q;
      shared_with = shared;
      distance = away;
    }
  }
  return with;
}

/// The pairs of a chunk that merge. The first gets the volume and mass of both; its history is its own, but for the
/// dilatation, by which the volume that both fill stays what it is. Their part in the dilatation of a pressure patch
/// changes: its points are scaled, so that it stays.
template <int Dim> class MergedPairs {
 public:
  MergedPairs(const World<Dim>& world, Chunk<Dim>& chunk, OtmPoints<Dim>& points)
      : world_(world), chunk_(chunk), points_(points), J_(chunk.size()) {}
  /// Returns the numbers of points that are gone, in the body, and adds the energy lost.
  std::vector<Index> merge(double& lost);

 private:
  double own_J(Index p) const {
    return chunk_.matter.F_since[p].determinant() *
           Eigen::Map<const Mat<3>>(chunk_.matter.F_table.col(p).data()).determinant();
  }
  template <class Value> double mean(std::size_t patch, const Value& value) const {
    double sum = 0.0, volume = 0.0;
    for (Index p = chunk_.patches[patch]; p < chunk_.patches[patch + 1]; ++p) {
      sum += chunk_.matter.volume[p] * value(p);
      volume += chunk_.matter.volume[p];
    }
    return volume > 0.0 ? sum / volume : 1.0;
  }
  double energy() const;

  const World<Dim>& world_;
  Chunk<Dim>& chunk_;
  OtmPoints<Dim>& points_;
  Vector J_;  ///< of the points' pressure patches
};

/// Each point with the dilatation of its pressure patch.
template <int Dim> double MergedPairs<Dim>::energy() const {
  const Matter<Dim>& matter = chunk_.matter;
  Deformation deformation = matter.now;
  deformation.heat.resize(0);
  for (Index p = 0; p < chunk_.size(); ++p) {
    const Mat<3> F = matter.F_since[p] * Eigen::Map<const Mat<3>>(matter.F_table.col(p).data());
    Eigen::Map<Mat<3>>(deformation.F.col(p).data()) = F * std::cbrt(J_[p] / F.determinant());
  }
  const MaterialResponse response = respond(*world_.bodies[chunk_.body].material, deformation, false);
  return matter.volume.dot(response.energy) +
         (response.dissipated.size() == 0 ? 0.0 : matter.volume.dot(response.dissipated));
}

template <int Dim> std::vector<Index> MergedPairs<Dim>::merge(double& lost) {
  Matter<Dim>& matter = chunk_.matter;
  update_positions(world_, chunk_);
  const auto own = [&](Index p) { return own_J(p); };
  for (std::size_t u = 0; u + 1 < chunk_.patches.size(); ++u)
    J_.segment(chunk_.patches[u], chunk_.patches[u + 1] - chunk_.patches[u]).setConstant(mean(u, own));
  const double before = energy();
  std::vector<char> goes(chunk_.size(), 0);
  std::vector<Index> gone;
  for (const auto& pair : points_.pairs) {
    if (!pair.merges()) continue;
    const Index p = pair.first, q = pair.second;
    const double volume = matter.volume[p] + matter.volume[q];
    J_[p] = (matter.volume[p] * J_[p] + matter.volume[q] * J_[q]) / volume;
    matter.volume[p] = volume;
    matter.mass[p] += matter.mass[q];
    chunk_.support.stabilisation[p] += chunk_.support.stabilisation[q];
    matter.volume[q] = matter.mass[q] = 0.0;
    goes[q] = 1;
    gone.push_back(chunk_.number[q]);
  }
  for (std::size_t u = 0; u + 1 < chunk_.patches.size(); ++u) {
    const double wanted = mean(u, [&](Index p) { return J_[p]; }), is = mean(u, own);
    for (Index p = chunk_.patches[u]; p < chunk_.patches[u + 1]; ++p) {
      matter.F_table.col(p) *= std::cbrt(wanted / is);
      matter.J[p] = J_[p] = wanted;
    }
  }
  lost += before - energy();
  std::vector<Index> from;
  for (Index p = 0; p < chunk_.size(); ++p)
    if (goes[p] == 0) from.push_back(p);
  points_.take(from, chunk_.take(from));
  return gone;
}

}  // namespace

/// Of cells that have collapsed, as nodes of theirs were merged.
template <int Dim> void pair_points_to_merge(World<Dim>& world, OtmState<Dim>& state) {
  bool found = false;
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    OtmPoints<Dim>& points = state.points[c];
    if (world.bodies[chunk.body].cells.cols() == 0) continue;
    std::vector<Index> collapsed;
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && !chunk.is_inverted(p) && static_cast<int>(corners(world, chunk, p).size()) <= Dim)
        collapsed.push_back(p);
    if (collapsed.empty()) continue;
    std::set<Index> busy(collapsed.begin(), collapsed.end());
    busy.insert(chunk.inverted.begin(), chunk.inverted.end());
    update_positions(world, chunk);
    for (const Index p : collapsed) {
      const Index with = find_partner(world, chunk, p, busy);
      if (with < 0) continue;
      busy.insert(with);
      // The larger goes on, in the cell that is left.
      const bool is_larger = chunk.matter.mass[p] > chunk.matter.mass[with];
      if (is_larger) std::swap(chunk.number[p], chunk.number[with]);
      points.pairs.push_back(
          {.first = is_larger ? p : with, .second = is_larger ? with : p, .pairing = Pairing::merge});
      points.mark(p);
      points.mark(with);
      found = true;
    }
  }
  if (found) world.find_points();
}

template <int Dim> void merge_points(World<Dim>& world, OtmState<Dim>& state) {
  std::vector<std::vector<Index>> gone(world.num_bodies());
  double lost = 0.0;
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    if (std::ranges::none_of(state.points[c].pairs, [](const auto& pair) { return pair.merges(); })) continue;
    const std::vector<Index> more = MergedPairs<Dim>(world, chunk, state.points[c]).merge(lost);
    gone[chunk.body].insert(gone[chunk.body].end(), more.begin(), more.end());
  }
  bool found = false;
  for (Index b = 0; b < world.num_bodies(); ++b) {
    std::vector<Index>& numbers = gone[b];
    if (numbers.empty()) continue;
    found = true;
    world.ledger.add_count("merged points", static_cast<Index>(numbers.size()));
    std::sort(numbers.begin(), numbers.end());
    Cells<Dim>& cells = world.bodies[b].cells;
    Index next = 0;
    for (Index c = 0; c < cells.cols(); ++c)
      if (!std::binary_search(numbers.begin(), numbers.end(), c)) cells.col(next++) = cells.col(c).eval();
    cells.conservativeResize(Eigen::NoChange, next);
    state.outer[b].clear();
    for (auto& chunk : world.chunks) {
      if (chunk.body != b) continue;
      for (Index& number : chunk.number)
        number -= static_cast<Index>(std::lower_bound(numbers.begin(), numbers.end(), number) - numbers.begin());
    }
  }
  if (!found) return;
  world.ledger.add_energy("reconnection", EnergyKind::transfer, lost);
  world.find_points();
}

template void pair_points_to_merge(World<2>&, OtmState<2>&);
template void pair_points_to_merge(World<3>&, OtmState<3>&);
template void merge_points(World<2>&, OtmState<2>&);
template void merge_points(World<3>&, OtmState<3>&);

}  // namespace efree::internal
