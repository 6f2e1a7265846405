// SPDX-License-Identifier: GPL-3.0-or-later
/// Points that have no shape functions of their own, or that a step would invert.
#include "efree/core/error.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <utility>

namespace efree::internal {

template <int Dim> void hold(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const Mat<3>& before) {
  Matter<Dim>& matter = chunk.matter;
  const Mat<3> rate = (matter.F_since[p] - before) * before.inverse();
  const Mat<3> tau = matter.response.stress(p) * matter.now.gradient(p).transpose();
  chunk.lost += 0.5 * matter.volume[p] * (tau.cwiseProduct(rate).sum() - matter.shock[p] * rate.trace());
  chunk.lost += stabilisation_energy(world, chunk, p, 0.5 * world.last_step);
  chunk.support.stabilisation[p] = matter.shock[p] = 0.0;
  if (matter.now.heat.size() > 0) matter.now.heat[p] = 0.0;
  matter.F_since[p] = before;
  chunk.inverted.insert(std::ranges::lower_bound(chunk.inverted, p), p);
}

template <int Dim> bool hold_if_inverted(const World<Dim>& world, Chunk<Dim>& chunk, Index p) {
  if (!world.bodies[chunk.body].holds_inverted || chunk.is_eroded(p) || chunk.is_inverted(p)) return false;
  const Mat<3> before =
      chunk.matter.now.gradient(p) * Eigen::Map<const Mat<3>>(chunk.matter.F_table.col(p).data()).inverse();
  if (chunk.matter.F_since[p].determinant() / before.determinant() > least_volume_left) return false;
  hold(world, chunk, p, before);
  return true;
}

/// Each goes to the nearest point that has shape functions.
template <int Dim>
void share_supports(World<Dim>& world, OtmState<Dim>& state, Index number, Reconnection<Dim>& change) {
  Chunk<Dim>& chunk = world.chunks[number];
  OtmPoints<Dim>& points = state.points[number];
  const Points<Dim>& x = chunk.matter.x;
  std::vector<Index>& lost = change.lost;
  const auto is_second = [&](Index q) {
    return std::any_of(points.pairs.begin(), points.pairs.end(),
                       [&](const auto& pair) { return pair.merges() && pair.second == q; });
  };
  for (std::size_t k = 0; k < lost.size(); ++k) {
    const Index p = lost[k];
    if (is_second(p)) continue;  // the first of its pair has them
    const auto distance = [&](Index q) { return (x.col(q) - x.col(p)).squaredNorm(); };
    for (;;) {
      Index with = -1;
      for (Index q = 0; q < chunk.size(); ++q)
        if (!chunk.is_eroded(q) && (with < 0 || distance(q) < distance(with)) && std::ranges::count(lost, q) == 0 &&
            !is_second(q))
          with = q;
      if (with < 0) throw NumericalError(no_shape_functions(world, chunk, p));
      if (!points.is_due(with)) {
        // It is reconnected with them.
        const std::size_t place = points.place(with);
        update_position_again(world, chunk, with);
        if (!hold_if_inverted(world, chunk, with))
          change.stabilisation += stabilisation_energy(world, chunk, with, 0.5 * world.last_step);
        Reconnection<Dim> own = compute_shape_functions(world, state, number, std::span<const Index>(&with, 1), false);
        points.mark(with);
        const bool has_some = own.lost.empty();
        change.rows.insert(change.rows.begin() + static_cast<std::ptrdiff_t>(place), std::move(own.rows.front()));
        own.rows.clear();
        change.add(std::move(own));
        if (!has_some) continue;
      }
      Support<Dim>& support = chunk.support;
      chunk.matter.x.col(p) = x.col(with);
      support.metric[p] = support.metric[with];
      points.lambda[p] = points.lambda[with];
      support.moment[p] = support.moment[with];
      support.stabilisation[p] = support.stabilisation[with] * chunk.matter.volume[p] / chunk.matter.volume[with];
      change.rows[points.place(p)] = change.rows[points.place(with)];
      points.pairs.push_back({.first = with, .second = p, .pairing = Pairing::share});
      ++change.shared;
      break;
    }
  }
}

template void hold(const World<2>&, Chunk<2>&, Index, const Mat<3>&);
template void hold(const World<3>&, Chunk<3>&, Index, const Mat<3>&);
template bool hold_if_inverted(const World<2>&, Chunk<2>&, Index);
template bool hold_if_inverted(const World<3>&, Chunk<3>&, Index);
template void share_supports(World<2>&, OtmState<2>&, Index, Reconnection<2>&);
template void share_supports(World<3>&, OtmState<3>&, Index, Reconnection<3>&);

}  // namespace efree::internal
