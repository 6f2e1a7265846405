// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/rigid_map.hpp"

#include "efree/core/parallel.hpp"

#include <numeric>

namespace efree {
namespace {

/// Rows of a map, and what goes in and comes out; of turns where there are some.
template <int Dim> struct RigidPass {
  Index begin, end;
  const Index* offsets;
  const typename RigidMap<Dim>::Entry* entries;
  const double *places, *others;
  const double *moves, *turns;
  double *to_moves, *to_turns;
};

/// Adds factor * turn x arm.
template <int lanes> EFREE_INLINE void add_turned(const double* arm, const NodeLanes<double, 2, lanes>& turn,
                                                  double factor, NodeLanes<double, 2, lanes>& sum) {
  sum.of[0] -= factor * arm[1] * turn.of[0];
  sum.of[1] += factor * arm[0] * turn.of[0];
}
template <int lanes> EFREE_INLINE void add_turned(const double* arm, const NodeLanes<double, 3, lanes>& turn,
                                                  double factor, NodeLanes<double, 3, lanes>& sum) {
  const double x = factor * arm[0], y = factor * arm[1], z = factor * arm[2];
  sum.of[0] += z * turn.of[1] - y * turn.of[2];
  sum.of[1] += x * turn.of[2] - z * turn.of[0];
  sum.of[2] += y * turn.of[0] - x * turn.of[1];
}
/// Adds factor * arm x force.
template <int lanes> EFREE_INLINE void add_moment(const double* arm, const NodeLanes<double, 2, lanes>& force,
                                                  double factor, NodeLanes<double, 2, lanes>& sum) {
  sum.of[0] += factor * (arm[0] * force.of[1] - arm[1] * force.of[0]);
}
template <int lanes> EFREE_INLINE void add_moment(const double* arm, const NodeLanes<double, 3, lanes>& force,
                                                  double factor, NodeLanes<double, 3, lanes>& sum) {
  add_turned<lanes>(arm, force, -factor, sum);
}

/// From one place to another.
template <int Dim> struct Arm {
  double of[Dim];
  EFREE_INLINE Arm(const double* from, Index i, const double* to, Index j) {
    for (int d = 0; d < Dim; ++d) of[d] = to[Dim * std::ptrdiff_t{j} + d] - from[Dim * std::ptrdiff_t{i} + d];
  }
};

template <int Dim, int lanes> EFREE_INLINE void follow_rows(const RigidPass<Dim>& at) {
  NodeLanes<double, Dim, lanes> move, turn, other;
  for (Index row = at.begin; row < at.end; ++row) {
    move.clear();
    turn.clear();
    for (Index k = at.offsets[row]; k < at.offsets[row + 1]; ++k) {
      const auto& entry = at.entries[k];
      other.load(at.moves, entry.of);
      move.add(entry.share, other);
      if (!at.turns) continue;
      other.load(at.turns, entry.of);
      add_turned<lanes>(Arm<Dim>(at.others, entry.of, at.places, row).of, other, entry.share, move);
      turn.add(entry.share, other);
    }
    move.store(at.to_moves, row);
    if (at.to_turns) turn.store(at.to_turns, row);
  }
}

template <int Dim, int lanes> EFREE_INLINE void gather_rows(const RigidPass<Dim>& at) {
  NodeLanes<double, Dim, lanes> force, moment, other;
  for (Index row = at.begin; row < at.end; ++row) {
    force.clear();
    moment.clear();
    for (Index k = at.offsets[row]; k < at.offsets[row + 1]; ++k) {
      const auto& entry = at.entries[k];
      other.load(at.moves, entry.of);
      force.add(entry.share, other);
      if (!at.to_turns) continue;
      add_moment<lanes>(Arm<Dim>(at.places, row, at.others, entry.of).of, other, entry.share, moment);
      if (!at.turns) continue;
      other.load(at.turns, entry.of);
      moment.add(entry.share, other);
    }
    force.store(at.to_moves, row);
    if (at.to_turns) moment.store(at.to_turns, row);
  }
}

template <int Dim> EFREE_INLINE void pass_rows(int lanes, bool gathers, const RigidPass<Dim>& pass) {
  switch (lanes) {
    case 1:
      return gathers ? gather_rows<Dim, 1>(pass) : follow_rows<Dim, 1>(pass);
    case 4:
      return gathers ? gather_rows<Dim, 4>(pass) : follow_rows<Dim, 4>(pass);
    default:
      return gathers ? gather_rows<Dim, 8>(pass) : follow_rows<Dim, 8>(pass);
  }
}
EFREE_FOR_EACH_MACHINE void pass_rows_2(int lanes, bool gathers, const RigidPass<2>& pass) {
  pass_rows<2>(lanes, gathers, pass);
}
EFREE_FOR_EACH_MACHINE void pass_rows_3(int lanes, bool gathers, const RigidPass<3>& pass) {
  pass_rows<3>(lanes, gathers, pass);
}

template <int Dim>
LanesPair passed(const RigidMap<Dim>& map, int lanes, bool gathers, const LanesPair& from, bool turning) {
  const Index count = map.rows.rows();
  const std::size_t size = std::size_t{Dim} * lanes * count;
  LanesPair to{Lanes(size), Lanes(turning ? size : 0)};
  parallel_chunks(count, 512, [&](Index begin, Index end) {
    const RigidPass<Dim> pass{.begin = begin,
                              .end = end,
                              .offsets = map.rows.offsets.data(),
                              .entries = map.rows.items.data(),
                              .places = map.places.data(),
                              .others = map.others.data(),
                              .moves = from.moves.data(),
                              .turns = from.turns.empty() ? nullptr : from.turns.data(),
                              .to_moves = to.moves.data(),
                              .to_turns = turning ? to.turns.data() : nullptr};
    if constexpr (Dim == 2)
      pass_rows_2(lanes, gathers, pass);
    else
      pass_rows_3(lanes, gathers, pass);
  });
  return to;
}

}  // namespace

template <int Dim> RigidMap<Dim> RigidMap<Dim>::mirrored() const {
  RigidMap result;
  result.places = others;
  result.others = places;
  auto& [offsets, items] = result.rows;
  offsets.assign(others.cols() + 1, 0);
  for (const Entry& entry : rows.items) ++offsets[entry.of + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  items.resize(rows.items.size());
  std::vector<Index> next(offsets.begin(), offsets.end() - 1);
  for (Index row = 0; row < rows.rows(); ++row)
    for (const Entry& entry : rows[row]) items[next[entry.of]++] = {row, entry.share};
  return result;
}

template <int Dim> LanesPair follow(const RigidMap<Dim>& map, int lanes, const LanesPair& others, bool turning) {
  return passed(map, lanes, false, others, turning);
}

template <int Dim> LanesPair gather(const RigidMap<Dim>& mirrored, int lanes, const LanesPair& rows, bool turning) {
  return passed(mirrored, lanes, true, rows, turning);
}

template struct RigidMap<2>;
template struct RigidMap<3>;
template LanesPair follow<2>(const RigidMap<2>&, int, const LanesPair&, bool);
template LanesPair follow<3>(const RigidMap<3>&, int, const LanesPair&, bool);
template LanesPair gather<2>(const RigidMap<2>&, int, const LanesPair&, bool);
template LanesPair gather<3>(const RigidMap<3>&, int, const LanesPair&, bool);

}  // namespace efree
