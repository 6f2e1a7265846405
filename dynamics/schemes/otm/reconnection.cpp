// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions of points that have strained are computed again, with what the nodes carry of these points.
#include "efree/core/internal/spectrum.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"
#include "efree/materials/internal/principal.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <numeric>

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
  const Mat<3> left = F * (Mat<3>::Identity() + symmetric(flow)) * F.transpose();  // V_e^2
  const auto [squares, axes] = spectrum<3>(0.5 * (left + left.transpose()));
  if (!(squares[0] > 0.0)) return;
  const Mat<3> V = axes * squares.cwiseSqrt().asDiagonal() * axes.transpose();
  const double growth = std::cbrt(J / V.determinant());
  F = growth * V;
  flow << Vec<3>::Constant(1.0 / (growth * growth) - 1.0), Vec<3>::Zero();
}

/// The rotation whose angular momentum is that of first moments of velocities, on shape functions of that second
/// moment; as far as there is one (none about nodes that are in one place, nor about a line of them).
template <int Dim> Mat<Dim> rotation_of(const Mat<Dim>& velocities, const Mat<Dim>& moment) {
  const Mat<Dim> skew = velocities - velocities.transpose();
  if (!(moment.trace() > 0.0)) return Mat<Dim>::Zero();
  if constexpr (Dim == 2) {
    return skew / moment.trace();
  } else {
    const Mat<3> inertia = moment.trace() * Mat<3>::Identity() - moment;
    const Vec<3> spin = pseudo_inverse<3>(inertia) * Vec<3>(skew(2, 1), skew(0, 2), skew(1, 0));
    Mat<3> result;
    result << 0.0, -spin[2], spin[1], spin[2], 0.0, -spin[0], -spin[1], spin[0], 0.0;
    return result;
  }
}

/// What a node gets of a point.
template <int Dim> struct NodeShare {
  Index node;
  double mass;
  Vec<Dim> momentum;
};

/// Points whose shape functions change together: their momentum goes from the nodes they had to those they get.
template <int Dim> class PointGroup {
 public:
  PointGroup(const World<Dim>& world, const Chunk<Dim>& chunk) : chunk_(chunk), x_(world.nodes.x), v_(world.nodes.v) {}

  void add(Index p, const TableRow& row) {
    rows_.emplace_back(p, &row);
    mass_ += chunk_.matter.mass[p];
    centre_ += chunk_.matter.mass[p] * chunk_.matter.x.col(p);
  }
  /// Adds what the nodes they had lose, and those they get have more.
  void transfer(MomentumTransfer how, std::vector<NodeShare<Dim>>& shares) {
    if (rows_.empty()) return;
    centre_ /= mass_;
    for (const auto& [p, row] : rows_)
      for (const auto& [a, entry] : chunk_.table.row(p)) {
        const double part = chunk_.matter.mass[p] * entry.N;
        velocity_ += part / mass_ * v_.col(a);
        gradient_ += part / mass_ * v_.col(a) * (x_.col(a) - centre_).transpose();
        shares.push_back({a, -part, -part * v_.col(a)});
      }
    Vec<Dim> shift = Vec<Dim>::Zero();
    Mat<Dim> turn = Mat<Dim>::Zero();
    if (how == MomentumTransfer::affine) std::tie(shift, turn) = correction();
    for (const auto& [p, row] : rows_)
      for (const auto& [a, entry] : *row) {
        const double part = chunk_.matter.mass[p] * entry.N;
        const Vec<Dim> v = v_.col(a) + shift + turn * (x_.col(a) - centre_);
        shares.push_back({a, part, part * (how == MomentumTransfer::points ? velocity_ : v)});
      }
  }

 private:
  /// The affine velocity about the centre of mass that the nodes' velocities lack, on the new rows, of the momentum and
  /// the first moments of velocity that the points have.
  std::pair<Vec<Dim>, Mat<Dim>> correction() const {
    Vec<Dim> shift = velocity_;
    Mat<Dim> turn = gradient_, moment = Mat<Dim>::Zero();
    for (const auto& [p, row] : rows_)
      for (const auto& [a, entry] : *row) {
        const double part = chunk_.matter.mass[p] * entry.N / mass_;
        const Vec<Dim> d = x_.col(a) - centre_;
        shift -= part * v_.col(a);
        turn -= part * v_.col(a) * d.transpose();
        moment += part * d * d.transpose();
      }
    const Mat<Dim> rotation = rotation_of<Dim>(turn, moment);
    // Where shape functions are narrow the inverse would keep fewer digits of the angular momentum.
    turn = moment.ldlt().solve(turn.transpose()).transpose().eval();
    // No more of what is no rotation than gains no energy: on narrow shape functions it would be many times what there
    // was. Over half the mass, against the mean velocity.
    double before = 0.0, after = 0.0, mixed = 0.0, stretched = 0.0;
    for (const auto& [p, row] : rows_) {
      for (const auto& [a, entry] : chunk_.table.row(p))
        before += chunk_.matter.mass[p] / mass_ * entry.N * (v_.col(a) - velocity_).squaredNorm();
      for (const auto& [a, entry] : *row) {
        const double part = chunk_.matter.mass[p] * entry.N / mass_;
        const Vec<Dim> d = x_.col(a) - centre_, stretch = (turn - rotation) * d;
        const Vec<Dim> speed = v_.col(a) + shift + rotation * d - velocity_;
        after += part * speed.squaredNorm();
        mixed += part * speed.dot(stretch);
        stretched += part * stretch.squaredNorm();
      }
    }
    if (after + 2.0 * mixed + stretched > before && stretched > 0.0) {
      const double root = mixed * mixed - stretched * (after - before);
      const double share = (std::sqrt(std::max(0.0, root)) - mixed) / stretched;
      turn = rotation + std::min(1.0, share) * (turn - rotation);
    }
    return {shift, turn};
  }

  const Chunk<Dim>& chunk_;
  const Points<Dim>&x_, &v_;
  std::vector<std::pair<Index, const TableRow*>> rows_;  ///< points and their new rows
  double mass_ = 0.0;
  Vec<Dim> centre_ = Vec<Dim>::Zero(), velocity_ = Vec<Dim>::Zero();  ///< of mass; mean
  Mat<Dim> gradient_ = Mat<Dim>::Zero();                              ///< first moments of velocity, over the mass
};

/// The reconnection of one step.
template <int Dim> class Reconnecting {
 public:
  Reconnecting(World<Dim>& world, OtmState<Dim>& state) : world_(world), state_(state) {
    for (std::size_t c = 0; c < state.points.size(); ++c)
      if (const std::size_t due = state.points[c].due.size(); due > 0)
        changes_.push_back({static_cast<Index>(c), std::vector<TableRow>(due), std::vector<PointChange>(due)});
  }

  void run(StableStep<Dim>& stable) {
    if (changes_.empty()) return;
    auto start = std::chrono::steady_clock::now();
    state_.search.follow(world_);
    state_.visibility.update(world_);
    update_points();
    compute_shape_functions();
    share_and_move_references();
    transfer_momentum();
    count_changes();
    put_rows();
    merge_points(world_, state_);
    world_.find_node_chunks();
    merge_nodes_without_points();
    world_.ledger.add_time("shape functions", seconds_since(start));
    estimate_near_changes(stable);
  }

 private:
  template <class Body> void for_each_change(const Body& body) {
    parallel_chunks(static_cast<Index>(changes_.size()), 1, [&](Index k, Index) {
      Reconnection& change = changes_[k];
      body(world_.chunks[change.chunk], state_.points[change.chunk], change);
    });
  }

  /// Where points are now, and how they are deformed, by the shape functions they had.
  void update_points() {
    for_each_change([&](Chunk<Dim>& chunk, OtmPoints<Dim>& points, Reconnection& change) {
      interpolate(world_, chunk, world_.nodes.x);
      for (const Index p : points.due) {
        update_position(world_, chunk, p);
        // Velocities are those of half a step ago: so is all energy that is lost here.
        if (!OtmState<Dim>::hold_if_inverted(world_, chunk, p))
          change.stabilisation += stabilisation_energy(world_, chunk, p, 0.5 * world_.last_step);
      }
      Points<Dim>& x = chunk.matter.x;
      const Vector& mass = chunk.matter.mass;
      for (const auto& [p, q, displacement, merges] : points.pairs) {
        x.col(p) += merges ? Vec<Dim>(mass[q] / (mass[p] + mass[q]) * (x.col(q) - x.col(p))) : displacement;
        x.col(q) = merges ? Vec<Dim>(x.col(p)) : Vec<Dim>(x.col(q) - mass[p] / mass[q] * displacement);
      }
    });
  }

  /// Some points at a time, as there are few such chunks, and of many points at once where much is going on.
  void compute_shape_functions() {
    std::vector<std::pair<Reconnection*, std::size_t>> places;  // of points, among those of a chunk that are due
    for (Reconnection& change : changes_)
      for (std::size_t w = 0; w < change.rows.size(); ++w) places.emplace_back(&change, w);
    parallel_chunks(static_cast<Index>(places.size()), points_at_once, [&](Index begin, Index end) {
      ShapeFunctions<Dim> shape_functions(world_, state_);
      for (Index i = begin; i < end; ++i) {
        const auto& [change, w] = places[i];
        const Index p = state_.points[change->chunk].due[w];
        change->points[w] = shape_functions.compute(change->chunk, p, change->rows[w]);
      }
    });
  }

  /// Points without shape functions get some, and the configuration of the new tables is the one now.
  void share_and_move_references() {
    for_each_change([&](Chunk<Dim>& chunk, OtmPoints<Dim>& points, Reconnection& change) {
      Matter<Dim>& matter = chunk.matter;
      ShapeFunctions<Dim>(world_, state_).share(change);
      for (const auto& [p, q, displacement, merges] : points.pairs) {
        if (!merges) continue;
        matter.x.col(q) = matter.x.col(p);
        change.rows[points.place(q)] = change.rows[points.place(p)];
        std::erase(change.kept, q);
      }
      const auto& body = world_.bodies[chunk.body];
      const Index metric = body.fracture.stretch > 0.0 ? -1 : body.plastic_metric;  // stretches must be kept to break
      for (const Index p : points.due) {
        Eigen::Map<Mat<3>> F(matter.F_table.col(p).data());
        F = Mat<3>(matter.F_since[p] * F);
        if (metric >= 0) remove_flow(F, matter.now.history.col(p).template segment<6>(metric));
      }
    });
  }

  /// What nodes get of the points of each change.
  std::vector<std::vector<NodeShare<Dim>>> share_masses() {
    std::vector<std::vector<NodeShare<Dim>>> result(changes_.size());
    parallel_chunks(static_cast<Index>(changes_.size()), 1, [&](Index k, Index) {
      const Reconnection& change = changes_[k];
      const OtmPoints<Dim>& points = state_.points[change.chunk];
      // Points that pairs join, one by another, go together; by the first of them.
      std::vector<std::size_t> first(points.due.size());
      std::iota(first.begin(), first.end(), 0);
      for (const auto& pair : points.pairs) {
        const std::size_t one = first[points.place(pair.first)], other = first[points.place(pair.second)];
        std::ranges::replace(first, std::max(one, other), std::min(one, other));
      }
      std::vector<PointGroup<Dim>> groups(points.due.size(), {world_, world_.chunks[change.chunk]});
      for (std::size_t w = 0; w < points.due.size(); ++w) groups[first[w]].add(points.due[w], change.rows[w]);
      for (auto& group : groups) group.transfer(state_.options.momentum, result[k]);
    });
    return result;
  }

  void count_changes() {
    for (const Reconnection& change : changes_) {
      const auto due = std::ssize(state_.points[change.chunk].due);
      world_.reconnections += due;
      world_.ledger.add_count("reconnections", due);
      for (const auto& [name, count] : {std::pair("lme iterations", &PointChange::iterations),
                                        {"enlarged supports", &PointChange::enlarged},
                                        {"kept supports", &PointChange::kept},
                                        {"shared supports", &PointChange::shared}}) {
        std::int64_t sum = 0;
        for (const PointChange& point : change.points) sum += point.*count;
        world_.ledger.add_count(name, sum);
      }
    }
  }

  void transfer_momentum() {
    Nodes<Dim>& nodes = world_.nodes;
    const auto kinetic_energy = [&](Index a) { return 0.5 * nodes.mass[a] * nodes.v.col(a).squaredNorm(); };
    Points<Dim> momenta = Points<Dim>::Zero(Dim, nodes.size());
    Vector masses = Vector::Zero(nodes.size());
    double lost = 0.0;
    for (const Reconnection& change : changes_) lost += change.stabilisation;
    for (const auto& shares : share_masses())
      for (const auto& [a, mass, momentum] : shares) {
        masses[a] += mass;
        momenta.col(a) += momentum;
      }
    double before = 0.0, after = 0.0;
    for (Index a = 0; a < nodes.size(); ++a) {
      before += kinetic_energy(a);
      if (masses[a] == 0.0 && momenta.col(a).isZero(0.0)) continue;
      const Vec<Dim> l = nodes.mass[a] * nodes.v.col(a) + momenta.col(a);
      nodes.mass[a] = world_.nodes.follows(a) ? 0.0 : nodes.mass[a] + masses[a];
      if (state_.options.momentum != MomentumTransfer::nodes && nodes.mass[a] > 0.0) nodes.v.col(a) = l / nodes.mass[a];
    }
    for (const auto& one : world_.prescribed) nodes.v(one.axis, one.node) = one.velocity;
    for (Index a = 0; a < nodes.size(); ++a) after += kinetic_energy(a);
    world_.ledger.add_energy("reconnection", EnergyKind::transfer, lost + (before - after));
  }

  void put_rows() {
    for_each_change([&](Chunk<Dim>& chunk, OtmPoints<Dim>& points, Reconnection& change) {
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
      for (const auto& pair : points.pairs) points.stiffened.insert(points.stiffened.end(), {pair.first, pair.second});
    });
  }

  /// Nodes that no point has in its table any more have no mass but rounding: they move with the nearest.
  void merge_nodes_without_points() {
    Nodes<Dim>& nodes = world_.nodes;
    const auto has_points = [&](Index a) {
      return !world_.nodes.follows(a) && world_.node_chunks.offsets[a + 1] > world_.node_chunks.offsets[a];
    };
    for (Index a = 0; a < nodes.size(); ++a) {
      if (world_.nodes.follows(a) || has_points(a)) continue;
      const auto distance = [&](Index b) { return (nodes.x.col(b) - nodes.x.col(a)).squaredNorm(); };
      const Index with = find_nearest(world_.nodes_of(nodes.body[a]), distance, has_points);
      if (with < 0) continue;
      nodes.mass[a] = 0.0;
      state_.merge_node(world_, a, with);
    }
  }

  /// Stiffer shape functions may be stiffer than any before, and nodes that lost others around them, or got them,
  /// light: the stable step is estimated again there.
  void estimate_near_changes(StableStep<Dim>& stable) {
    bool changed = std::exchange(state_.nodes_changed, false), stiffened = false;
    for (const Reconnection& change : changes_) {
      changed = changed || !state_.points[change.chunk].pairs.empty();
      stiffened = stiffened || !state_.points[change.chunk].stiffened.empty();
    }
    Points<Dim> mode;
    std::vector<char> where;
    if (changed || stiffened) {
      mode = stable.mode();
      where.assign(world_.nodes.size(), 0);
    }
    const double size = 0.1 / std::sqrt(world_.nodes.mass.sum());
    for (const Reconnection& change : changes_) {
      const PointTable<Dim>& table = world_.chunks[change.chunk].table;
      OtmPoints<Dim>& points = state_.points[change.chunk];
      for (const Index p : points.stiffened)
        for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
          const Index a = table.nodes[table.local[e]];
          where[a] = 1;
          for (int i = 0; i < Dim; ++i) mode(i, a) += (e + a + i) % 2 == 0 ? size : -size;
        }
      if (changed)
        for (const Index p : points.due)
          for (const auto& [a, entry] : table.row(p)) where[a] = 1;
      points.stiffened.clear();
      points.due.clear();
      points.pairs.clear();
    }
    if (changed || stiffened) stable.estimate_near(world_, where, std::move(mode), changed ? 8 : 5);
  }

  World<Dim>& world_;
  OtmState<Dim>& state_;
  std::vector<Reconnection> changes_;  ///< by chunk with points that are due
};

}  // namespace

template <int Dim> void reconnect(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable) {
  Reconnecting<Dim>(world, state).run(stable);
}

template void reconnect(World<2>&, OtmState<2>&, StableStep<2>&);
template void reconnect(World<3>&, OtmState<3>&, StableStep<3>&);

}  // namespace efree::internal
