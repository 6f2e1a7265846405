// SPDX-License-Identifier: GPL-3.0-or-later
/// Nodes and points where a body has stretched so far that it has few of them.
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <map>
#include <numeric>

namespace efree::internal {
namespace {

/// Area of a triangle, over that of a regular one whose edges are the spacing, below which it is not split: where a
/// body has become that much thinner than its spacing nodes would be inserted and merged over and over. Tetrahedra are
/// slivers from the start, and say nothing of it.
constexpr double least_split = 0.1;

/// By point of a chunk that becomes two: the number of the second in the body, and how far the first moves.
template <int Dim> using Halves = std::map<Index, std::pair<Index, Vec<Dim>>>;

/// Points become two each: both as they were, shape functions and all, but of half the volume.
template <int Dim> void halve(Chunk<Dim>& chunk, OtmPoints<Dim>& points, const Halves<Dim>& halves) {
  std::vector<Index> from(chunk.size());
  std::iota(from.begin(), from.end(), 0);
  for (const auto& [p, half] : halves) {
    from.push_back(p);
    chunk.matter.volume[p] *= 0.5;
    chunk.matter.mass[p] *= 0.5;
    if (chunk.matter.added_mass.size() != 0) chunk.matter.added_mass[p] *= 0.5;
    chunk.support.stabilisation[p] *= 0.5;
  }
  std::ranges::sort(from);
  const std::vector<Index> first = chunk.take(from);
  points.take(from, first);
  for (const auto& [p, half] : halves) {
    chunk.number[first[p] + 1] = half.first;
    points.pairs.push_back({first[p], first[p] + 1, half.second});
  }
}

/// Splits edges of the cells of a body, of no cell two.
template <int Dim> class EdgeSplitting {
 public:
  EdgeSplitting(World<Dim>& world, OtmState<Dim>& state, Index body)
      : world_(world), state_(state), body_(body), first_(world.first_node[body]), cells_(world.bodies[body].cells) {}

  void run(StableStep<Dim>& stable) {
    const std::vector<Split> splits = find_splits();
    if (splits.empty()) return;
    const Index num_nodes = world_.first_node[body_ + 1] - first_;
    insert_middles(splits, stable);
    std::vector<Halves<Dim>> halves(world_.chunks.size());
    for (std::size_t k = 0; k < splits.size(); ++k) split_cells(splits[k], num_nodes + static_cast<Index>(k), halves);
    for (std::size_t c = 0; c < world_.chunks.size(); ++c)
      if (!halves[c].empty()) halve(world_.chunks[c], state_.points[c], halves[c]);
    state_.outer[body_].clear();
    world_.find_points();
    world_.find_node_chunks();
    world_.find_free_axes();
  }

 private:
  /// An edge, its middle and the cells around it.
  struct Split {
    NodePair edge;
    Vec<Dim> middle;
    std::vector<Index> cells;
  };

  auto x(Index a) const { return world_.nodes.x.col(first_ + a); }
  double spacing(Index a) const { return world_.nodes.spacing[first_ + a]; }
  double length(const NodePair& edge) const { return (x(edge.first) - x(edge.second)).norm(); }
  double longest(const NodePair& edge) const {
    return 0.5 * state_.options.insertion * (spacing(edge.first) + spacing(edge.second));
  }

  bool is_thin(Index cell) const {
    if (Dim == 3) return false;
    const auto& [chunk, p] = world_.locate(world_.first_point[body_] + cell);
    const Matter<Dim>& matter = chunk.matter;
    double edge = 0.0;
    for (const Index corner : cells_.col(cell)) edge += spacing(corner) / (Dim + 1);
    return matter.volume[p] < least_split * std::sqrt(3.0) / 4.0 * edge * edge * world_.out_of_plane(matter.x(0, p));
  }

  /// Cells around every edge that is too long, the longest first: by minus its length and its nodes.
  std::map<std::pair<double, NodePair>, std::vector<Index>> find_long_edges() const {
    std::map<std::pair<double, NodePair>, std::vector<Index>> around;
    for (Index c = 0; c < cells_.cols(); ++c) {
      if (const auto& [chunk, p] = world_.locate(world_.first_point[body_] + c); chunk.is_eroded(p)) continue;
      for (int i = 0; i <= Dim; ++i)
        for (int j = 0; j < i; ++j) {
          const NodePair edge = std::minmax(cells_(i, c), cells_(j, c));
          if (edge.first == edge.second || length(edge) <= longest(edge)) continue;
          std::vector<Index>& cells = around[{-length(edge), edge}];
          if (cells.empty() || cells.back() != c) cells.push_back(c);
        }
    }
    return around;
  }

  /// The longest first, of those longer than OtmOptions::insertion times the spacing, of cells that are not too thin,
  /// that have no other node near their middle; on the surface no other of it, and nearer, as points between the
  /// surface and nodes inside have nothing else around them.
  std::vector<Split> find_splits() {
    const auto long_edges = find_long_edges();
    if (long_edges.empty()) return {};
    state_.search.follow(world_);
    const std::vector<NodePair>& outer = state_.outer_edges(world_, body_);
    const std::vector<char> on_surface = state_.surface_nodes(world_);
    std::vector<char> is_split(static_cast<std::size_t>(cells_.cols()), 0);
    std::vector<Split> result;
    std::vector<Index> near_by;
    for (const auto& [key, cells] : long_edges) {
      const NodePair& edge = key.second;
      if (std::ranges::any_of(cells, [&](Index c) { return is_split[c] != 0 || is_thin(c); })) continue;
      const Vec<Dim> middle = 0.5 * (x(edge.first) + x(edge.second));
      const bool is_outer = std::ranges::binary_search(outer, edge);
      const double room = (is_outer ? 0.25 : 0.5) * longest(edge);
      state_.search.within(body_, middle, room, near_by);
      const auto is_in_the_way = [&](Index a) {
        return (x(a) - middle).squaredNorm() <= room * room && !world_.nodes.follows(first_ + a) &&
               (!is_outer || on_surface[first_ + a] != 0);
      };
      const auto is_near = [&](const Split& other) { return (other.middle - middle).squaredNorm() < room * room; };
      if (std::ranges::any_of(near_by, is_in_the_way) || std::ranges::any_of(result, is_near)) continue;
      for (const Index c : cells) is_split[c] = 1;
      result.push_back({edge, middle, cells});
    }
    return result;
  }

  /// New nodes in the middle of the edges. Points with both ends in their support are due, to get the middle too.
  void insert_middles(const std::vector<Split>& splits, StableStep<Dim>& stable) {
    const Index next = world_.first_node[body_ + 1], count = static_cast<Index>(splits.size());
    Points<Dim> at(Dim, count), velocity(Dim, count);
    Vector spacings(count);
    for (Index k = 0; k < count; ++k) {
      const auto& [a, b] = splits[k].edge;
      at.col(k) = splits[k].middle;
      velocity.col(k) = 0.5 * (world_.nodes.v.col(first_ + a) + world_.nodes.v.col(first_ + b));
      spacings[k] = 0.5 * (spacing(a) + spacing(b));
      for_each_point_of(world_, first_ + a, [&, other = first_ + b](Index c, Index p) {
        const Chunk<Dim>& chunk = world_.chunks[c];
        const bool has_both = std::ranges::count(chunk.table.row(p) | std::views::keys, other) > 0;
        if (has_both && !chunk.is_eroded(p)) state_.points[c].mark(p);
      });
    }
    for (auto& [node, with] : state_.seized) shift_node(node, next, count);
    world_.insert_nodes(body_, at, velocity, spacings);
    stable.nodes_inserted(next, count);
    world_.ledger.add_count("inserted nodes", count);
    state_.nodes_changed = true;
  }

  /// Both points of a cell that is split keep the history of the one, so that the energy stored is what it was;
  /// momentum and angular momentum are transferred by the reconnection.
  void split_cells(const Split& split, Index middle, std::vector<Halves<Dim>>& halves) {
    const auto [a, b] = split.edge;
    for (const auto& interaction : world_.interactions)
      interaction->edge_split(world_, first_ + a, first_ + b, first_ + middle);
    for (const Index c : split.cells) {
      const auto [in, p] = world_.place_of_point[world_.first_point[body_] + c];
      const auto next = static_cast<Index>(cells_.cols());
      halves[in][p] = {next, (x(a) - x(b)) / (2 * (Dim + 1))};
      state_.points[in].mark(p);
      cells_.conservativeResize(Eigen::NoChange, next + 1);
      cells_.col(next) = cells_.col(c);
      std::ranges::replace(cells_.col(c), b, middle);
      std::ranges::replace(cells_.col(next), a, middle);
    }
  }

  World<Dim>& world_;
  OtmState<Dim>& state_;
  Index body_, first_;
  Cells<Dim>& cells_;
};

}  // namespace

template <int Dim> void insert_nodes(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable) {
  for (Index b = 0; b < world.num_bodies(); ++b) EdgeSplitting<Dim>(world, state, b).run(stable);
}

template void insert_nodes(World<2>&, OtmState<2>&, StableStep<2>&);
template void insert_nodes(World<3>&, OtmState<3>&, StableStep<3>&);

}  // namespace efree::internal
