// SPDX-License-Identifier: GPL-3.0-or-later
/// What the OTM scheme keeps besides the world, and its parts.
#pragma once

#include "efree/basis/internal/neighbours.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"

#include <Eigen/LU>
#include <ranges>

namespace efree::internal {

using NodePair = std::pair<Index, Index>;

/// Two points of a chunk whose momentum and angular momentum are transferred together in the next reconnection.
template <int Dim> struct PointPair {
  Index first, second;
  Vec<Dim> displacement = Vec<Dim>::Zero();  ///< of the first; their centre of mass stays
  bool merges = false;  ///< both go to their centre of mass instead, and the first has the mass of both

  friend auto fields(PointPair& of) {
    auto& [first, second, displacement, merges] = of;
    return std::tie(first, second, displacement, merges);
  }
};

/// Points of a chunk, in its order.
template <int Dim> struct OtmPoints {
  std::vector<Vec<Dim>> lambda;       ///< Lagrange multipliers of their shape functions
  Vector count;                       ///< nodes in each one's support at first; 0: not yet known
  Vector width;                       ///< of the shape functions at first, where they were narrowest
  std::vector<Index> due;             ///< points to be reconnected, ascending
  std::vector<Index> stiffened;       ///< those of them whose new shape functions are stiffer
  std::vector<PointPair<Dim>> pairs;  ///< of points that are due; none that moves or merges is in two

  /// The point is to be reconnected.
  void mark(Index p) {
    if (!is_due(p)) due.insert(std::ranges::lower_bound(due, p), p);
  }
  bool is_due(Index p) const { return std::ranges::binary_search(due, p); }
  /// Where it is in `due`.
  std::size_t place(Index p) const { return static_cast<std::size_t>(std::ranges::lower_bound(due, p) - due.begin()); }
  /// As Chunk::take; first: what it returned.
  void take(const std::vector<Index>& from, const std::vector<Index>& first);

  friend auto fields(OtmPoints& of) {
    auto& [lambda, count, width, due, stiffened, pairs] = of;
    return std::tie(lambda, count, width, due, stiffened, pairs);
  }
};

/// Nodes near a place, body by body, though they have moved a little since the trees were built.
template <int Dim> class NodeSearch {
 public:
  /// Builds trees, again when nodes have moved against each other so far that a search would find many that are too far
  /// away.
  void follow(const World<Dim>& world);
  /// Nodes of the body, numbered by it, that may be within r: among them all that are.
  void within(Index body, const Vec<Dim>& x, double r, std::vector<Index>& found) const {
    const auto& [nodes, shift, moved] = trees_[body];
    nodes.within(x - shift, r + moved, found);
  }
  /// The nearest of the body, of those where the tree has them.
  Index nearest(Index body, const Vec<Dim>& x) const { return trees_[body].nodes.nearest(x - trees_[body].shift); }

 private:
  struct Tree {
    Neighbours<Dim> nodes{};
    Vec<Dim> shift = Vec<Dim>::Zero();  ///< mean displacement of the nodes since they were put into it
    double moved = 0.0;                 ///< largest displacement of a node since then, less that
  };
  std::vector<Tree> trees_;  ///< by body
};

/// Nodes that a point may have in its support: shape functions do not reach across cracks, nor across gaps between
/// parts of a body that is in contact with itself.
template <int Dim> class Visibility {
 public:
  /// Finds the cells around every node that are not eroded, and where surfaces are now.
  void update(const World<Dim>& world);
  bool has_cracks() const { return has_cracks_; }
  /// Whether some of these nodes may be hidden from a point of a body at that place.
  bool may_hide(const World<Dim>& world, Index body, const Vec<Dim>& at, const std::vector<Index>& nodes) const;
  /// Of these nodes, ascending, those that cells which are not eroded join to the point's own, by nodes among these.
  void keep_connected(const World<Dim>& world, Index body, Index point, std::vector<Index>& nodes) const;

 private:
  void find_cells(const World<Dim>& world);

  bool has_cracks_ = false;
  std::vector<Ragged<Index>> cells_;          ///< by body and node; empty: of no use
  std::vector<Facets<Dim>> surfaces_;         ///< by body; none: it is not in contact with itself
  Points<Dim> normals_;                       ///< of these surfaces at their nodes, outwards; else zero
  std::array<Index, 3> changes_{-1, -1, -1};  ///< of the world until then
};

/// What comes of BodyState::reference_pressure.
template <int Dim> struct ReferencePressure {
  Facets<Dim> facets;          ///< on which it acts
  Index surface_changes = -1;  ///< of the world when they were found
  double pressure = 0.0;       ///< that acted last
  double excess = 0.0;         ///< then, volume of the points less that inside the facets
  double energy = 0.0;         ///< work against it that the difference has taken so far

  friend auto fields(ReferencePressure& of) {
    auto& [facets, surface_changes, pressure, excess, energy] = of;
    return std::tie(facets, surface_changes, pressure, excess, energy);
  }
};

template <int Dim> struct OtmState {
  OtmOptions options;
  std::vector<OtmPoints<Dim>> points;        ///< by chunk
  bool nodes_changed = false;                ///< nodes have been merged or inserted since the last reconnection
  std::vector<std::vector<NodePair>> outer;  ///< by body: outer edges of its cells; empty: not known
  NodeSearch<Dim> search;
  Visibility<Dim> visibility;
  std::vector<ReferencePressure<Dim>> references;  ///< by body
  /// Nodes, and bodies whose nodes their points have in their supports too; ascending.
  std::vector<NodePair> seized;

  /// Edges of facets that belong to one cell only, as the body numbers its nodes, ascending.
  const std::vector<NodePair>& outer_edges(const World<Dim>& world, Index body);
  /// Whether nodes are ends of these edges, of all bodies.
  std::vector<char> surface_nodes(const World<Dim>& world);
  /// Marks all points that have this node in their table, unless eroded.
  void mark_points_of(const World<Dim>& world, Index node);
  /// Node a moves with the other from now on. Its mass goes with the points that have it in their table: they are due.
  void merge_node(World<Dim>& world, Index a, Index with);
  /// The step is none for a point that it would invert or nearly so: the point stays as it was, by its F_since before,
  /// until it is reconnected, and exerts no force, since the moments of forces are right only where F is that of the
  /// nodes. The work of its stress in half of the step, and the energy of its zero-energy modes, are lost.
  static void hold(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const Mat<3>& before);
  /// Holds a point whose position was just updated, if the step would invert it. Whether it does.
  static bool hold_if_inverted(const World<Dim>& world, Chunk<Dim>& chunk, Index p);
};

/// Calls visit(c, p) for all chunks and points that have a node in their table.
template <int Dim, class Visit> void for_each_point_of(const World<Dim>& world, Index node, const Visit& visit) {
  const auto& [offsets, places, forces] = world.node_chunks;
  for (Index k = offsets[node]; k < offsets[node + 1]; ++k) {
    const auto [c, l] = places[k];
    for (Index p = 0; p < world.chunks[c].size(); ++p)
      if (world.chunks[c].table.has(p, l)) visit(c, p);
  }
}

/// Of these numbers of nodes or points the first at the least distance that is allowed; -1: none is.
template <class Numbers, class Distance, class Allowed>
Index find_nearest(Numbers&& numbers, const Distance& distance, const Allowed& is_allowed) {
  Index nearest = -1;
  decltype(distance(0)) least{};
  for (const Index k : numbers)
    if (const auto d = distance(k); (nearest < 0 || d < least) && is_allowed(k)) nearest = k, least = d;
  return nearest;
}

/// Deformation gradient since the table of a chunk was computed, along the axes of the nodes.
template <int Dim> Mat<Dim> deformation_since_table(const Chunk<Dim>& chunk, Index p) {
  return chunk.matter.F_since[p].template topLeftCorner<Dim, Dim>();
}
/// Second moments of a point's shape functions, where its nodes are now.
template <int Dim> Mat<Dim> current_moment(const Chunk<Dim>& chunk, Index p) {
  const Mat<Dim> since = deformation_since_table(chunk, p);
  return since * chunk.support.moment[p] * since.transpose();
}
/// Kirchhoff stress of a point, without viscous pressure and its body's reference pressure.
template <int Dim> Mat<3> kirchhoff_stress(const World<Dim>& world, const Chunk<Dim>& chunk, Index p) {
  const Mat<3> F = chunk.matter.now.gradient(p);
  Mat<3> tau = Eigen::Map<const Mat<3>>(chunk.matter.P.col(p).data()) * F.transpose();
  if (const double pressure = world.bodies[chunk.body].reference_pressure; pressure != 0.0)
    tau.diagonal().array() += pressure * F.determinant();
  return tau;
}
/// F when the table was computed.
template <int Dim> Mat<3> table_gradient(const Matter<Dim>& matter, Index p) {
  return Eigen::Map<const Mat<3>>(matter.F_table.col(p).data());
}

/// What becomes of the shape functions of a point that is due.
struct PointChange {
  bool lost = false;       ///< it has none, nor any to keep, or is inverted: its row is empty
  bool same = false;       ///< they are those it had, of the same nodes
  bool stiffened = false;  ///< they are stiffer than before
  /// Numbers of Newton's iterations, of larger supports, and of points with the shape functions they had or another's.
  std::int64_t iterations = 0, enlarged = 0, kept = 0, shared = 0;
};

/// New rows of the points of a chunk that are due, in their order.
struct Reconnection {
  Index chunk;
  std::vector<TableRow> rows;
  std::vector<PointChange> points;
  std::vector<Index> kept{};   ///< points with the shape functions they had
  double stabilisation = 0.0;  ///< energy of zero-energy modes before
};

/// Finds local maximum-entropy shape functions of material points, where they and the nodes are.
template <int Dim> class ShapeFunctions {
 public:
  ShapeFunctions(World<Dim>& world, OtmState<Dim>& state)
      : world_(world), state_(state), functions_(state.options.lme) {}

  /// Those at a point of a chunk; metric and lambda are those of before, and of now on return. False if there are none.
  bool find(Index chunk, Index p, Mat<Dim>& metric, Vec<Dim>& lambda);
  /// The nodes found.
  const std::vector<Index>& nodes() const { return nodes_; }
  const Mat<Dim>& moment() const { return functions_.moment(); }

  /// Puts those of a point, or else those it has, into an empty row.
  PointChange compute(Index chunk, Index p, TableRow& row);
  /// Points that have none share those of the nearest of the chunk that has some. Lists those kept and stiffened.
  void share(Reconnection& change);
  /// Throws NumericalError: the material point is outside of the nodes around it.
  [[noreturn]] void fail_at(const Chunk<Dim>& chunk, Index p) const;

 private:
  void find_partners(const Chunk<Dim>& chunk, Index p);
  void search(const Vec<Dim>& at, const Mat<Dim>& metric, double share);
  bool keep(Chunk<Dim>& chunk, Index p, TableRow& row);
  double stabilisation(Chunk<Dim>& chunk, Index p, bool is_first) const;
  TableEntry make_entry(double N, const Vec<Dim>& dN, double radius) const {
    return table_entry<Dim>(N, dN, world_.axisymmetric() ? N / radius : 0.0);
  }

  World<Dim>& world_;
  OtmState<Dim>& state_;
  LmeFunctions<Dim> functions_;
  std::vector<Index> nodes_, partners_, around_;
  PointChange change_;
};

/// Computes shape functions of all points that are due, where nodes and points are now.
template <int Dim> void reconnect(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable);
/// Nodes that have left the points behind are merged with the nearest node of the same support.
template <int Dim> void merge_detached_nodes(World<Dim>& world, OtmState<Dim>& state);
/// Nodes that make shape functions too narrow are merged with the next.
template <int Dim> void merge_close_nodes(World<Dim>& world, OtmState<Dim>& state);
/// Nodes come into the middle of edges that are too long, and cells and points around them become two.
template <int Dim> void insert_nodes(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable);
/// Points of collapsed cells are paired with a neighbour to be merged.
template <int Dim> void pair_points_to_merge(World<Dim>& world, OtmState<Dim>& state);
/// Merges these pairs.
template <int Dim> void merge_points(World<Dim>& world, OtmState<Dim>& state);
/// Volume of fluids goes from points to neighbours of lower pressure, over the last step; and their reference pressures
/// for this one.
template <int Dim> void diffuse_pressures(World<Dim>& world, OtmState<Dim>& state);
/// Reference pressures of fluids with cells at the start, the lowest at any point if that is positive.
template <int Dim> void begin_reference_pressures(World<Dim>& world, OtmState<Dim>& state);
/// Adds the forces of reference pressures on surfaces, and what becomes of energy.
template <int Dim> void add_reference_pressures(World<Dim>& world, OtmState<Dim>& state);
/// Changes the first shape functions until gradients integrate exactly.
template <int Dim> void integrate_exactly(World<Dim>& world, OtmState<Dim>& state);

}  // namespace efree::internal
