// SPDX-License-Identifier: GPL-3.0-or-later
/// Nodes that have come too near to each other, or have left the points behind, are merged.
#include "efree/core/parallel.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace efree::internal {
namespace {

/// Largest distance of nodes that are merged, over their spacing.
constexpr double reach = 0.5;
/// Width of shape functions, over the first, below which a point lies in a plane of its nodes.
constexpr double flat = 0.1;
/// Largest shape function of a node at any point, below which there is nothing of the body around it.
constexpr double least_shape_function = 0.02;

/// Whether all that is prescribed of the second node is of the first.
template <int Dim> bool has_supports_of(const World<Dim>& world, Index a, Index other) {
  const auto supports = [&](Index node) {
    std::set<std::pair<int, double>> by;
    for (const auto& [of, axis, velocity] : world.prescribed)
      if (of == node) by.insert({axis, velocity});
    return by;
  };
  const auto of_a = supports(a), of_other = supports(other);
  return std::includes(of_a.begin(), of_a.end(), of_other.begin(), of_other.end());
}

/// Chunks and points that have a node in their table.
template <int Dim, class Visit> void for_each_point_of(const World<Dim>& world, Index node, const Visit& visit) {
  for (Index k = world.node_chunks.offsets[node]; k < world.node_chunks.offsets[node + 1]; ++k) {
    const auto [c, l] = world.node_chunks.places[k];
    for (Index p = 0; p < world.chunks[c].size(); ++p)
      if (world.chunks[c].table.has(p, l) && !visit(c, p)) return;
  }
}

/// The search of merge_close_nodes.
template <int Dim> class CloseNodes {
 public:
  CloseNodes(World<Dim>& world, OtmState<Dim>& state)
      : world_(world), state_(state), on_surface_(world.nodes.size(), 0), is_built_(world.num_bodies(), 0) {}
  void merge();

 private:
  bool is_narrow(Index c, Index p) const;
  Mat<Dim> moment_of(const Chunk<Dim>& chunk, Index p) const;
  void build_searches(Index body);
  bool merge_near(Index c, Index p, const Mat<Dim>& moment, const Vec<Dim>& n);
  bool merge(Index a, Index with, Index c, Index p, double width);
  void move_off_plane(Index c, Index p, const Vec<Dim>& n, double width);

  World<Dim>& world_;
  OtmState<Dim>& state_;
  std::vector<char> on_surface_;  ///< by node
  std::vector<char> is_built_;    ///< by body: its search, and on_surface_ of its nodes
  std::set<Index> locked_;        ///< nodes that shape functions found so far count on
};

template <int Dim> Mat<Dim> CloseNodes<Dim>::moment_of(const Chunk<Dim>& chunk, Index p) const {
  const Mat<Dim> since = chunk.matter.F_since[p].template topLeftCorner<Dim, Dim>();
  return since * chunk.support.moment[p] * since.transpose();
}

template <int Dim> bool CloseNodes<Dim>::is_narrow(Index c, Index p) const {
  const Chunk<Dim>& chunk = world_.chunks[c];
  return !chunk.is_eroded(p) &&
         !(smallest_width<Dim>(moment_of(chunk, p)) >= state_.options.merging * state_.points[c].width[p]);
}

template <int Dim> void CloseNodes<Dim>::build_searches(Index body) {
  for (Index b = 0; b < world_.num_bodies(); ++b) {
    if (is_built_[b] != 0 || (b != body && state_.seized.empty())) continue;
    state_.search.follow(world_, b);
    for (const auto& [a, e] : state_.outer_edges(world_, b))
      on_surface_[world_.first_node[b] + a] = on_surface_[world_.first_node[b] + e] = 1;
    is_built_[b] = 1;
  }
}

/// Merges the first node with the other, if all points that have it in their support have shape functions without it,
/// and this point of these has wider ones: all are due from now on. Nodes that these count on are locked.
template <int Dim> bool CloseNodes<Dim>::merge(Index a, Index with, Index of_chunk, Index of_point, double width) {
  if (locked_.contains(a) || locked_.contains(with) || !has_supports_of(world_, with, a)) return false;
  state_.merged[a] = with;
  LmeFunctions<Dim> functions(state_.options.lme);
  std::vector<Index> used;
  Reconnection<Dim> tried;
  const auto has_shape_functions = [&](Index c, Index p) {
    Mat<Dim> metric = world_.chunks[c].support.metric[p];
    Vec<Dim> lambda = state_.points[c].lambda[p];
    return find_shape_functions(world_, state_, c, p, false, metric, lambda, functions, used, tried);
  };
  // Where it fails it does so at that point nearly always.
  bool good = has_shape_functions(of_chunk, of_point) && smallest_width<Dim>(functions.moment()) >= width;
  std::set<Index> counted_on;
  std::vector<std::pair<Index, Index>> points;  // chunks and numbers there
  if (good)
    for_each_point_of(world_, a, [&](Index c, Index p) {
      good = has_shape_functions(c, p);
      points.emplace_back(c, p);
      counted_on.insert(used.begin(), used.end());
      return good;
    });
  if (!good) {
    state_.merged[a] = -1;
    return false;
  }
  locked_.insert(counted_on.begin(), counted_on.end());
  merge_node(world_, state_, a, with);
  for (const auto& [c, p] : points) state_.points[c].mark(p);
  return true;
}

/// A point whose shape functions narrow across n, as it is all but in a plane of nodes, and the nearest out of that
/// plane come nearer to each other, their centre of mass where it is.
template <int Dim> void CloseNodes<Dim>::move_off_plane(Index c, Index p, const Vec<Dim>& n, double width) {
  const Chunk<Dim>& chunk = world_.chunks[c];
  OtmPoints<Dim>& points = state_.points[c];
  const Points<Dim>& x = chunk.matter.x;
  const auto is_free = [&](Index q) {
    return !chunk.is_inverted(q) && std::none_of(points.pairs.begin(), points.pairs.end(),
                                                 [&](const auto& pair) { return pair.first == q || pair.second == q; });
  };
  if (!is_free(p)) return;
  Index with = -1;
  for (Index q = 0; q < chunk.size(); ++q) {
    const Vec<Dim> d = x.col(q) - x.col(p);
    if (!chunk.is_eroded(q) && std::abs(n.dot(d)) > 4.0 * width && is_free(q) &&
        (with < 0 || d.squaredNorm() < (x.col(with) - x.col(p)).squaredNorm()))
      with = q;
  }
  if (with < 0) return;
  const double share = chunk.matter.mass[with] / (chunk.matter.mass[p] + chunk.matter.mass[with]);
  points.pairs.push_back({.first = p, .second = with, .displacement = 0.3 * share * (x.col(with) - x.col(p))});
  points.mark(p);
  points.mark(with);
}

/// Merges one of the nodes that make a point's shape functions narrow across n; whether it does.
template <int Dim> bool CloseNodes<Dim>::merge_near(Index c, Index p, const Mat<Dim>& moment, const Vec<Dim>& n) {
  const PointTable<Dim>& table = world_.chunks[c].table;
  const Nodes<Dim>& nodes = world_.nodes;
  const Mat<Dim> inverse = world_.chunks[c].matter.F_since[p].template topLeftCorner<Dim, Dim>().inverse();
  // What makes the shape functions narrow is what they change most by.
  std::vector<std::pair<double, Index>> by;
  for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
    const Index a = table.nodes[table.local[e]];
    Vec<Dim> dN;
    for (int i = 0; i < Dim; ++i) dN[i] = table.entries[e].dN[i];
    if (state_.merged[a] < 0) by.emplace_back(-std::abs(n.dot(inverse.transpose() * dN)), a);
  }
  std::sort(by.begin(), by.end());
  if (by.size() > 4) by.resize(4);
  for (const auto& [slope, a] : by) {
    Index nearest = -1;
    for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
      const Index b = table.nodes[table.local[e]];
      if (b != a && state_.merged[b] < 0 && nodes.body[b] == nodes.body[a] &&
          (nearest < 0 ||
           (nodes.x.col(b) - nodes.x.col(a)).squaredNorm() < (nodes.x.col(nearest) - nodes.x.col(a)).squaredNorm()))
        nearest = b;
    }
    if (nearest < 0 ||
        (nodes.x.col(nearest) - nodes.x.col(a)).norm() > reach * 0.5 * (nodes.spacing[a] + nodes.spacing[nearest]))
      continue;
    // The surface stays where it is.
    const bool is_inner = !on_surface_[a] || on_surface_[nearest];
    if (merge(is_inner ? a : nearest, is_inner ? nearest : a, c, p, 1.3 * smallest_width<Dim>(moment))) return true;
  }
  return false;
}

template <int Dim> void CloseNodes<Dim>::merge() {
  state_.cracks.update(world_);
  std::vector<Index> first_narrow(world_.chunks.size());
  parallel_chunks(static_cast<Index>(world_.chunks.size()), 1, [&](Index c, Index) {
    Index& p = first_narrow[c];
    while (p < world_.chunks[c].size() && !is_narrow(c, p)) ++p;
  });
  for (Index c = 0; c < static_cast<Index>(world_.chunks.size()); ++c) {
    Chunk<Dim>& chunk = world_.chunks[c];
    bool has_positions = false;
    for (Index p = first_narrow[c]; p < chunk.size(); ++p) {
      if (!is_narrow(c, p)) continue;
      const Mat<Dim> moment = moment_of(chunk, p);
      build_searches(chunk.body);
      if (!std::exchange(has_positions, true)) update_positions(world_, chunk);
      Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
      axes.computeDirect(moment);
      const Vec<Dim> n = axes.eigenvectors().col(0);
      if (!merge_near(c, p, moment, n) && smallest_width<Dim>(moment) < flat * state_.points[c].width[p])
        move_off_plane(c, p, n, smallest_width<Dim>(moment));
    }
  }
}

}  // namespace

template <int Dim> void merge_node(World<Dim>& world, OtmState<Dim>& state, Index a, Index with) {
  state.merged[a] = with;
  for (Index& other : state.merged)
    if (other == a) other = with;
  world.nodes.active[a] = 0;
  // Cells collapse with their edge.
  const Index body = world.nodes.body[a], first = world.first_node[body];
  for (Index& corner : world.bodies[body].cells.reshaped())
    if (corner == a - first) corner = with - first;
  state.outer[body].clear();
  ++world.surface_changes;
  world.ledger.add_count("merged nodes", 1);
  state.nodes_changed = true;
}

/// As at a rim that is thrown off, they bear next to no mass, and fly anywhere: each is merged with the nearest of the
/// nodes in the tables of its points, on the surface if it is on it.
template <int Dim> void merge_detached_nodes(World<Dim>& world, OtmState<Dim>& state) {
  const Nodes<Dim>& nodes = world.nodes;
  Vector largest = Vector::Zero(nodes.size());
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = chunk.table.offsets[p]; e < chunk.table.offsets[p + 1]; ++e) {
        double& most = largest[chunk.table.nodes[chunk.table.local[e]]];
        most = std::max(most, chunk.is_eroded(p) ? 1.0 : chunk.table.entries[e].N);
      }
  const auto is_detached = [&](Index a) {
    return state.merged[a] < 0 && largest[a] > 0.0 && largest[a] < least_shape_function;
  };
  std::vector<std::set<Index>> on_surface(world.num_bodies());
  for (Index a = 0; a < nodes.size(); ++a) {
    if (!is_detached(a)) continue;
    const Index b = nodes.body[a];
    std::set<Index>& surface = on_surface[b];
    if (surface.empty() && world.bodies[b].cells.cols() != 0)
      for (const auto& [one, other] : state.outer_edges(world, b))
        surface.insert({world.first_node[b] + one, world.first_node[b] + other});
    std::vector<std::pair<Index, Index>> points;  // chunks and numbers there
    Index with = -1;
    const auto distance = [&](Index other) {
      const bool leaves = surface.contains(a) && !surface.contains(other);
      return std::pair(leaves, (nodes.x.col(other) - nodes.x.col(a)).squaredNorm());
    };
    for_each_point_of(world, a, [&](Index c, Index p) {
      const PointTable<Dim>& table = world.chunks[c].table;
      points.emplace_back(c, p);
      for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e)
        if (const Index other = table.nodes[table.local[e]];
            other != a && state.merged[other] < 0 && !is_detached(other) && nodes.body[other] == b &&
            has_supports_of(world, other, a) && (with < 0 || distance(other) < distance(with)))
          with = other;
      return true;
    });
    if (with < 0) continue;
    merge_node(world, state, a, with);
    for (const auto& [c, p] : points) state.points[c].mark(p);
  }
}

template <int Dim> void merge_close_nodes(World<Dim>& world, OtmState<Dim>& state) {
  CloseNodes<Dim>(world, state).merge();
}

template void merge_node(World<2>&, OtmState<2>&, Index, Index);
template void merge_node(World<3>&, OtmState<3>&, Index, Index);
template void merge_detached_nodes(World<2>&, OtmState<2>&);
template void merge_detached_nodes(World<3>&, OtmState<3>&);
template void merge_close_nodes(World<2>&, OtmState<2>&);
template void merge_close_nodes(World<3>&, OtmState<3>&);

}  // namespace efree::internal
