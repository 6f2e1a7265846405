// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions of points that have strained are computed again, with what the nodes carry of these points.
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"
#include "efree/materials/internal/principal.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace efree::internal {
namespace {

/// Points whose shape functions a thread computes at once.
constexpr Index points_at_once = 16;

/// Replaces F after much plastic flow by the elastic stretch, and C_p^-1 - 1, given by its components, by what keeps J:
/// an isotropic material has the same stress, by the same V_e^2 = F C_p^-1 F^T. That would be a small difference of
/// numbers of the size of |F|^4: at stretches of e^8 along one axis and e^-8 along another nothing is left of it.
void remove_flow(Eigen::Ref<Mat<3>> F, Eigen::Ref<Vec<6>> flow) {
  constexpr double far = 30.0;
  const double J = F.determinant();
  if (!(J > 0.0) || F.squaredNorm() <= far * std::cbrt(J * J)) return;
  const Mat<3> left = F * (Mat<3>::Identity() + internal::symmetric(flow)) * F.transpose();  // V_e^2
  const auto [squares, axes] = spectrum<3>(0.5 * (left + left.transpose()));
  if (!(squares[0] > 0.0)) return;
  const Mat<3> V = axes * squares.cwiseSqrt().asDiagonal() * axes.transpose();
  const double growth = std::cbrt(J / V.determinant());
  F = growth * V;
  flow << Vec<3>::Constant(1.0 / (growth * growth) - 1.0), Vec<3>::Zero();
}

/// The reconnection of one step.
template <int Dim> class Reconnecting {
 public:
  Reconnecting(World<Dim>& world, OtmState<Dim>& state) : world_(world), state_(state) {
    for (std::size_t c = 0; c < state.points.size(); ++c)
      if (!state.points[c].due.empty()) chunks_.push_back(static_cast<Index>(c));
    changes_.resize(chunks_.size());
  }
  bool is_due() const { return !chunks_.empty(); }

  void run(StableStep<Dim>& stable);

 private:
  void follow_nodes();
  void update_points();
  void compute();
  void share_and_move_references();
  void transfer();
  void transfer_of(std::size_t k, Vector& masses, Points<Dim>& momenta);
  void put();
  void estimate_near_changes(StableStep<Dim>& stable);
  double kinetic_energy() const;
  template <class Body> void for_each_chunk(const Body& body) {
    parallel_chunks(static_cast<Index>(chunks_.size()), 1,
                    [&](Index k, Index) { body(world_.chunks[chunks_[k]], state_.points[chunks_[k]], changes_[k]); });
  }

  World<Dim>& world_;
  OtmState<Dim>& state_;
  std::vector<Index> chunks_;  ///< with points that are due
  std::vector<Reconnection<Dim>> changes_;
};

template <int Dim> void Reconnecting<Dim>::follow_nodes() {
  std::vector<char> is_due(world_.num_bodies(), 0);
  for (const Index c : chunks_) is_due[world_.chunks[c].body] = 1;
  for (Index b = 0; b < world_.num_bodies(); ++b)
    if (is_due[b] || !state_.seized.empty()) state_.search.follow(world_, b);
  state_.cracks.update(world_);
}

/// Where points are now, and how they are deformed, by the shape functions they had.
template <int Dim> void Reconnecting<Dim>::update_points() {
  for_each_chunk([&](Chunk<Dim>& chunk, OtmPoints<Dim>& points, Reconnection<Dim>& change) {
    interpolate(world_, chunk, world_.nodes.x);
    for (const Index p : points.due) {
      update_position(world_, chunk, p);
      // Velocities are those of half a step ago: so is all energy that is lost here.
      if (!hold_if_inverted(world_, chunk, p))
        change.stabilisation += stabilisation_energy(world_, chunk, p, 0.5 * world_.last_step);
    }
    Points<Dim>& x = chunk.matter.x;
    const Vector& mass = chunk.matter.mass;
    for (const auto& pair : points.pairs) {
      const auto& [p, q, displacement, pairing] = pair;
      x.col(p) += pair.merges() ? Vec<Dim>(mass[q] / (mass[p] + mass[q]) * (x.col(q) - x.col(p))) : displacement;
      if (pair.merges())
        x.col(q) = x.col(p);
      else
        x.col(q) -= mass[p] / mass[q] * displacement;
    }
  });
}

/// Shape functions, some points at a time, as there are few such chunks, and of many points at once where much is going
/// on.
template <int Dim> void Reconnecting<Dim>::compute() {
  struct Piece {
    std::size_t of;
    Index begin;
    Reconnection<Dim> change;
  };
  std::vector<Piece> pieces;
  for (std::size_t k = 0; k < chunks_.size(); ++k)
    for (Index begin = 0; begin < static_cast<Index>(state_.points[chunks_[k]].due.size()); begin += points_at_once)
      pieces.push_back({k, begin, {}});
  parallel_chunks(static_cast<Index>(pieces.size()), 1, [&](Index i, Index) {
    auto& [k, begin, change] = pieces[i];
    const std::span<const Index> rest = std::span<const Index>(state_.points[chunks_[k]].due).subspan(begin);
    change = compute_shape_functions(world_, state_, chunks_[k],
                                     rest.first(std::min<std::size_t>(rest.size(), points_at_once)), false);
  });
  for (Piece& piece : pieces) changes_[piece.of].add(std::move(piece.change));
}

/// Points without shape functions get some, and the configuration of the new tables is the one now.
template <int Dim> void Reconnecting<Dim>::share_and_move_references() {
  parallel_chunks(static_cast<Index>(chunks_.size()), 1, [&](Index k, Index) {
    Chunk<Dim>& chunk = world_.chunks[chunks_[k]];
    OtmPoints<Dim>& points = state_.points[chunks_[k]];
    Reconnection<Dim>& change = changes_[k];
    share_supports(world_, state_, chunks_[k], change);
    for (const auto& pair : points.pairs) {
      if (!pair.merges()) continue;
      chunk.matter.x.col(pair.second) = chunk.matter.x.col(pair.first);
      change.rows[points.place(pair.second)] = change.rows[points.place(pair.first)];
      std::erase(change.kept, pair.second);
    }
    const auto& body = world_.bodies[chunk.body];
    const Index metric = body.fracture.stretch > 0.0 ? -1 : body.plastic_metric;  // stretches must be kept to break
    for (const Index p : points.due) {
      Eigen::Map<Mat<3>> F(chunk.matter.F_table.col(p).data());
      F = Mat<3>(chunk.matter.F_since[p] * F);
      if (metric >= 0) remove_flow(F, chunk.matter.now.history.col(p).template segment<6>(metric));
    }
  });
}

template <int Dim> double Reconnecting<Dim>::kinetic_energy() const {
  double sum = 0.0;
  for (Index a = 0; a < world_.nodes.size(); ++a)
    sum += 0.5 * world_.nodes.mass[a] * world_.nodes.v.col(a).squaredNorm();
  return sum;
}

/// Changes of masses and momenta by the points of a chunk, in their order.
template <int Dim> void Reconnecting<Dim>::transfer_of(std::size_t k, Vector& masses, Points<Dim>& momenta) {
  const Chunk<Dim>& chunk = world_.chunks[chunks_[k]];
  const OtmPoints<Dim>& points = state_.points[chunks_[k]];
  // Points that pairs join, one by another, go together; by the first of them.
  std::vector<std::size_t> first(points.due.size());
  std::iota(first.begin(), first.end(), 0);
  for (const auto& pair : points.pairs) {
    const std::size_t one = first[points.place(pair.first)], other = first[points.place(pair.second)];
    std::ranges::replace(first, std::max(one, other), std::min(one, other));
  }
  std::vector<std::vector<PointRow>> together(points.due.size());
  for (std::size_t w = 0; w < points.due.size(); ++w)
    together[first[w]].push_back({points.due[w], &changes_[k].rows[w]});
  for (const auto& rows : together)
    if (!rows.empty()) transfer_momentum(world_, state_.options.momentum, chunk, rows, masses, momenta);
}

template <int Dim> void Reconnecting<Dim>::transfer() {
  Nodes<Dim>& nodes = world_.nodes;
  Ledger& ledger = world_.ledger;
  const double before = kinetic_energy();
  Points<Dim> momentum = Points<Dim>::Zero(Dim, nodes.size());
  Vector change = Vector::Zero(nodes.size());
  double lost = 0.0;
  for (std::size_t k = 0; k < chunks_.size(); ++k) {
    const auto due = static_cast<std::int64_t>(state_.points[chunks_[k]].due.size());
    world_.reconnections += due;
    ledger.add_count("reconnections", due);
    ledger.add_count("lme iterations", changes_[k].iterations);
    ledger.add_count("enlarged supports", changes_[k].enlarged);
    ledger.add_count("kept supports", changes_[k].num_kept);
    ledger.add_count("shared supports", changes_[k].shared);
    lost += changes_[k].stabilisation;
    transfer_of(k, change, momentum);
  }
  for (Index a = 0; a < nodes.size(); ++a) {
    if (change[a] == 0.0 && momentum.col(a).isZero(0.0)) continue;
    const Vec<Dim> l = nodes.mass[a] * nodes.v.col(a) + momentum.col(a);
    nodes.mass[a] = state_.merged[a] < 0 ? nodes.mass[a] + change[a] : 0.0;
    if (state_.options.momentum != MomentumTransfer::nodes && nodes.mass[a] > 0.0) nodes.v.col(a) = l / nodes.mass[a];
  }
  for (const auto& [node, axis, velocity] : world_.prescribed) nodes.v(axis, node) = velocity;
  ledger.add_energy("reconnection", EnergyKind::transfer, lost + (before - kinetic_energy()));
}

/// The new rows into the tables.
template <int Dim> void Reconnecting<Dim>::put() {
  for_each_chunk([&](Chunk<Dim>& chunk, OtmPoints<Dim>& points, Reconnection<Dim>& change) {
    world_.put_rows(chunk, points.due, change.rows);
    for (const Index p : points.due) chunk.matter.F_since[p].setIdentity();
    // Energy of zero-energy modes stays with shape functions that are kept.
    for (const Index p : change.kept) chunk.lost -= stabilisation_energy(world_, chunk, p, 0.5 * world_.last_step);
    // By new shape functions points may be compressed faster than by those they had.
    for (const auto& row : change.rows) {
      Mat<Dim> rate = Mat<Dim>::Zero();
      double hoop = 0.0;
      for (const auto& [a, entry] : row) {
        rate -= world_.nodes.v.col(a) * Eigen::Map<const Vec<Dim>>(entry.dN).transpose();
        if (world_.axisymmetric()) hoop -= world_.nodes.v(0, a) * entry.dN[2];
      }
      Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
      axes.computeDirect(0.5 * (rate + rate.transpose()), Eigen::EigenvaluesOnly);
      chunk.compression_rate = std::max({chunk.compression_rate, axes.eigenvalues()[Dim - 1], hoop});
    }
    chunk.inverted.clear();
    points.stiffened = std::move(change.stiffened);
    for (const auto& pair : points.pairs) points.stiffened.insert(points.stiffened.end(), {pair.first, pair.second});
  });
}

/// Nodes that no point has in its table any more have no mass but rounding: they move with the nearest.
template <int Dim> void merge_nodes_without_points(World<Dim>& world, OtmState<Dim>& state) {
  const Points<Dim>& x = world.nodes.x;
  const auto has_points = [&](Index a) {
    return state.merged[a] < 0 && world.node_chunks.offsets[a + 1] > world.node_chunks.offsets[a];
  };
  for (Index a = 0; a < world.nodes.size(); ++a) {
    if (state.merged[a] >= 0 || has_points(a)) continue;
    const Index body = world.nodes.body[a];
    Index nearest = -1;
    for (Index b = world.first_node[body]; b < world.first_node[body + 1]; ++b)
      if (has_points(b) &&
          (nearest < 0 || (x.col(b) - x.col(a)).squaredNorm() < (x.col(nearest) - x.col(a)).squaredNorm()))
        nearest = b;
    if (nearest < 0) continue;
    world.nodes.mass[a] = 0.0;
    merge_node(world, state, a, nearest);
  }
}

/// Stiffer shape functions may be stiffer than any before, and nodes that lost others around them, or got them, light:
/// the stable step is estimated again there.
template <int Dim> void Reconnecting<Dim>::estimate_near_changes(StableStep<Dim>& stable) {
  bool stiffened = false, changed = std::exchange(state_.nodes_changed, false);
  for (const Index c : chunks_) {
    stiffened = stiffened || !state_.points[c].stiffened.empty();
    changed = changed || !state_.points[c].pairs.empty();
  }
  Points<Dim> mode;
  std::vector<char> where;
  if (stiffened || changed) {
    mode = stable.mode();
    where.assign(world_.nodes.size(), 0);
  }
  const double size = 0.1 / std::sqrt(world_.nodes.mass.sum());
  for (const Index c : chunks_) {
    const PointTable<Dim>& table = world_.chunks[c].table;
    OtmPoints<Dim>& points = state_.points[c];
    for (const Index p : points.stiffened)
      for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
        const Index a = table.nodes[table.local[e]];
        where[a] = 1;
        for (int i = 0; i < Dim; ++i) mode(i, a) += (e + a + i) % 2 == 0 ? size : -size;
      }
    if (changed)
      for (const Index p : points.due)
        for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) where[table.nodes[table.local[e]]] = 1;
    points.stiffened.clear();
    points.due.clear();
    points.pairs.clear();
  }
  if (stiffened || changed) stable.estimate_near(world_, where, std::move(mode), changed ? 8 : 5);
}

template <int Dim> void Reconnecting<Dim>::run(StableStep<Dim>& stable) {
  auto start = std::chrono::steady_clock::now();
  follow_nodes();
  update_points();
  compute();
  share_and_move_references();
  transfer();
  put();
  merge_points(world_, state_);
  world_.find_node_chunks();
  merge_nodes_without_points(world_, state_);
  world_.ledger.add_time("shape functions", seconds_since(start));
  estimate_near_changes(stable);
}

}  // namespace

template <int Dim> void reconnect(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable) {
  Reconnecting<Dim> step(world, state);
  if (step.is_due()) step.run(stable);
}

template void reconnect(World<2>&, OtmState<2>&, StableStep<2>&);
template void reconnect(World<3>&, OtmState<3>&, StableStep<3>&);

}  // namespace efree::internal
