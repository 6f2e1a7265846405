// SPDX-License-Identifier: GPL-3.0-or-later
/// Nodes and points where a body has stretched so far that it has few of them.
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

namespace efree::internal {
namespace {

/// Area of a triangle, over that of a regular one whose edges are the spacing, below which it is not split: where a
/// body has become that much thinner than its spacing nodes would be inserted and merged over and over. Tetrahedra are
/// slivers from the start, and say nothing of it.
constexpr double least_split = 0.1;

/// An edge between two nodes of a body, and the cells around it.
template <int Dim> struct Split {
  Index a, b;
  Vec<Dim> middle;
  std::vector<Index> cells;
};

/// Edges of a body's cells that are to be split, of no cell two: the longest first, of those longer than
/// OtmOptions::insertion times the spacing, of cells that are not too thin, that have no other node near their middle;
/// on the surface no other of it, and nearer, as points between the surface and nodes inside have nothing else around
/// them.
template <int Dim> class LongEdges {
 public:
  LongEdges(World<Dim>& world, OtmState<Dim>& state, Index body)
      : world_(world), state_(state), body_(body), first_(world.first_node[body]) {}
  std::vector<Split<Dim>> find();

 private:
  using Edge = std::pair<Index, Index>;
  double longest(Index a, Index b) const {
    const Vector& spacing = world_.nodes.spacing;
    return 0.5 * state_.options.insertion * (spacing[first_ + a] + spacing[first_ + b]);
  }
  double length(Index a, Index b) const {
    return (world_.nodes.x.col(first_ + a) - world_.nodes.x.col(first_ + b)).norm();
  }
  bool is_thin(Index cell) const;
  std::map<Edge, std::vector<Index>> find_around() const;

  World<Dim>& world_;
  OtmState<Dim>& state_;
  Index body_, first_;
};

template <int Dim> bool LongEdges<Dim>::is_thin(Index cell) const {
  if (Dim == 3) return false;
  const auto [in, p] = world_.place_of_point[world_.first_point[body_] + cell];
  double edge = 0.0;
  for (const Index corner : world_.bodies[body_].cells.col(cell))
    edge += world_.nodes.spacing[first_ + corner] / (Dim + 1);
  const Matter<Dim>& matter = world_.chunks[in].matter;
  return matter.volume[p] < least_split * std::sqrt(3.0) / 4.0 * edge * edge * world_.out_of_plane(matter.x(0, p));
}

/// Cells around every edge that is too long.
template <int Dim> auto LongEdges<Dim>::find_around() const -> std::map<Edge, std::vector<Index>> {
  const Cells<Dim>& cells = world_.bodies[body_].cells;
  std::map<Edge, std::vector<Index>> around;
  for (Eigen::Index c = 0; c < cells.cols(); ++c) {
    const auto [in, p] = world_.place_of_point[world_.first_point[body_] + c];
    if (world_.chunks[in].is_eroded(p)) continue;
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j < i; ++j) {
        const Edge edge = std::minmax(cells(i, c), cells(j, c));
        if (edge.first == edge.second || length(edge.first, edge.second) <= longest(edge.first, edge.second)) continue;
        std::vector<Index>& of_edge = around[edge];
        if (of_edge.empty() || of_edge.back() != c) of_edge.push_back(static_cast<Index>(c));
      }
  }
  return around;
}

template <int Dim> std::vector<Split<Dim>> LongEdges<Dim>::find() {
  std::map<Edge, std::vector<Index>> around = find_around();
  std::vector<Split<Dim>> result;
  if (around.empty()) return result;
  std::vector<std::pair<double, Edge>> order;
  for (const auto& [edge, cells] : around) order.push_back({-length(edge.first, edge.second), edge});
  std::sort(order.begin(), order.end());
  state_.search.build(world_, body_);
  const std::vector<Edge>& outer = state_.outer_edges(world_, body_);
  std::vector<char> on_surface(world_.nodes.size(), 0);
  for (const auto& [a, b] : outer) on_surface[a] = on_surface[b] = 1;
  std::vector<char> is_split(static_cast<std::size_t>(world_.bodies[body_].cells.cols()), 0);
  std::vector<Index> near_by;
  for (const auto& [minus_length, edge] : order) {
    const auto& [a, b] = edge;
    const std::vector<Index>& cells = around[edge];
    if (std::any_of(cells.begin(), cells.end(), [&](Index c) { return is_split[c] != 0 || is_thin(c); })) continue;
    const Vec<Dim> middle = 0.5 * (world_.nodes.x.col(first_ + a) + world_.nodes.x.col(first_ + b));
    const bool is_outer = std::binary_search(outer.begin(), outer.end(), edge);
    const double room = (is_outer ? 0.25 : 0.5) * longest(a, b);
    state_.search.tree(body_).within(middle, room, near_by);
    const auto is_in_the_way = [&](Index near) {
      return state_.merged[first_ + near] < 0 && (!is_outer || on_surface[near] != 0);
    };
    const auto is_near = [&](const Split<Dim>& other) { return (other.middle - middle).squaredNorm() < room * room; };
    if (std::ranges::any_of(near_by, is_in_the_way) || std::ranges::any_of(result, is_near)) continue;
    for (const Index c : cells) is_split[c] = 1;
    result.push_back({a, b, middle, cells});
  }
  return result;
}

/// The points of `twice`, ascending, become two each: both as they were, shape functions and all, but of half the
/// volume.
template <int Dim> void halve(Chunk<Dim>& chunk, OtmPoints<Dim>& points, const std::vector<Index>& twice) {
  std::vector<Index> from;
  for (Index p = 0; p < chunk.size(); ++p) {
    const bool is_twice = std::binary_search(twice.begin(), twice.end(), p);
    from.insert(from.end(), is_twice ? 2 : 1, p);
    if (!is_twice) continue;
    chunk.matter.volume[p] *= 0.5;
    chunk.matter.mass[p] *= 0.5;
    chunk.support.stabilisation[p] *= 0.5;
  }
  points.take(from, chunk.take(from));
}

/// New nodes in the middle of the edges. Points with both ends in their support are due, to have what is between them.
template <int Dim> void insert_middles(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable, Index body,
                                       const std::vector<Split<Dim>>& splits) {
  const Nodes<Dim>& nodes = world.nodes;
  const Index begin = world.first_node[body], first = world.first_node[body + 1];
  const auto count = static_cast<Index>(splits.size());
  Points<Dim> at(Dim, count), velocity(Dim, count);
  Vector spacings(count);
  for (Index k = 0; k < count; ++k) {
    const Index ends[] = {begin + splits[k].a, begin + splits[k].b};
    at.col(k) = splits[k].middle;
    velocity.col(k) = 0.5 * (nodes.v.col(ends[0]) + nodes.v.col(ends[1]));
    spacings[k] = 0.5 * (nodes.spacing[ends[0]] + nodes.spacing[ends[1]]);
    for (Index place = world.node_chunks.offsets[ends[0]]; place < world.node_chunks.offsets[ends[0] + 1]; ++place) {
      const Index c = world.node_chunks.places[place].first;
      const Chunk<Dim>& chunk = world.chunks[c];
      const auto has = [&](Index p, Index node) {
        return std::any_of(chunk.table.local.begin() + chunk.table.offsets[p],
                           chunk.table.local.begin() + chunk.table.offsets[p + 1],
                           [&](std::uint16_t local) { return chunk.table.nodes[local] == node; });
      };
      for (Index p = 0; p < chunk.size(); ++p)
        if (!chunk.is_eroded(p) && has(p, ends[0]) && has(p, ends[1])) state.points[c].mark(p);
    }
  }
  for (Index& with : state.merged)
    if (with >= first) with += count;
  state.merged.insert(state.merged.begin() + first, count, -1);
  for (auto& [node, with] : state.seized)
    if (node >= first) node += count;
  world.insert_nodes(body, at, velocity, spacings);
  stable.nodes_inserted(first, count);
  world.ledger.add_count("inserted nodes", count);
  state.nodes_changed = true;
}

}  // namespace

/// Both points of a cell that is split keep the history of the one, so that the energy stored is what it was; momentum
/// and angular momentum are transferred by the reconnection.
template <int Dim> void insert_nodes(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable) {
  for (Index b = 0; b < world.num_bodies(); ++b) {
    Cells<Dim>& body_cells = world.bodies[b].cells;
    if (body_cells.cols() == 0) continue;
    const std::vector<Split<Dim>> splits = LongEdges<Dim>(world, state, b).find();
    if (splits.empty()) continue;
    const Index begin = world.first_node[b], num_nodes = world.first_node[b + 1] - begin;
    insert_middles(world, state, stable, b, splits);
    const Points<Dim>& x = world.nodes.x;
    // By chunk and point: the number of the second point, and how far the first moves.
    std::vector<std::map<Index, std::pair<Index, Vec<Dim>>>> halves(world.chunks.size());
    for (Index k = 0; k < static_cast<Index>(splits.size()); ++k) {
      const auto& [a, e, middle, cells] = splits[k];
      const Index fresh = num_nodes + k;
      for (const auto& interaction : world.interactions)
        interaction->edge_split(world, begin + a, begin + e, begin + fresh);
      for (const Index c : cells) {
        const auto [in, p] = world.place_of_point[world.first_point[b] + c];
        const auto next = static_cast<Index>(body_cells.cols());
        halves[in][p] = {next, (x.col(begin + a) - x.col(begin + e)) / (2 * (Dim + 1))};
        state.points[in].mark(p);
        body_cells.conservativeResize(Eigen::NoChange, next + 1);
        body_cells.col(next) = body_cells.col(c);
        for (Index& corner : body_cells.col(c))
          if (corner == e) corner = fresh;
        for (Index& corner : body_cells.col(next))
          if (corner == a) corner = fresh;
      }
    }
    for (std::size_t c = 0; c < world.chunks.size(); ++c) {
      if (halves[c].empty()) continue;
      Chunk<Dim>& chunk = world.chunks[c];
      std::vector<Index> twice;
      for (const auto& [p, half] : halves[c]) twice.push_back(p);
      halve(chunk, state.points[c], twice);
      Index before = 0;
      for (const auto& [p, half] : halves[c]) {
        state.points[c].pairs.push_back({p + before, p + before + 1, half.second});
        chunk.number[p + ++before] = half.first;
      }
    }
    state.outer[b].clear();
    world.find_points();
    world.find_node_chunks();
    world.find_free_axes();
  }
}

template <int Dim>
const std::vector<std::pair<Index, Index>>& OtmState<Dim>::outer_edges(const World<Dim>& world, Index body) {
  const Cells<Dim>& cells = world.bodies[body].cells;
  std::vector<std::pair<Index, Index>>& edges = outer[body];
  if (!edges.empty()) return edges;
  std::vector<std::array<Index, Dim>> sides;
  sides.reserve((Dim + 1) * static_cast<std::size_t>(cells.cols()));
  for (Eigen::Index c = 0; c < cells.cols(); ++c) {
    std::array<Index, Dim + 1> corners;
    std::copy_n(cells.col(c).data(), Dim + 1, corners.begin());
    std::sort(corners.begin(), corners.end());
    if (std::adjacent_find(corners.begin(), corners.end()) != corners.end()) continue;  // collapsed
    for (int without = 0; without <= Dim; ++without) {
      std::array<Index, Dim>& side = sides.emplace_back();
      std::copy(corners.begin(), corners.begin() + without, side.begin());
      std::copy(corners.begin() + without + 1, corners.end(), side.begin() + without);
    }
  }
  std::sort(sides.begin(), sides.end());
  for (std::size_t k = 0; k < sides.size(); ++k) {
    const auto& side = sides[k];
    if ((k > 0 && sides[k - 1] == side) || (k + 1 < sides.size() && sides[k + 1] == side)) continue;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < i; ++j) edges.emplace_back(side[j], side[i]);
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

template void insert_nodes(World<2>&, OtmState<2>&, StableStep<2>&);
template void insert_nodes(World<3>&, OtmState<3>&, StableStep<3>&);
template const std::vector<std::pair<Index, Index>>& OtmState<2>::outer_edges(const World<2>&, Index);
template const std::vector<std::pair<Index, Index>>& OtmState<3>::outer_edges(const World<3>&, Index);

}  // namespace efree::internal
