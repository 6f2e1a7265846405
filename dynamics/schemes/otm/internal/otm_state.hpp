// SPDX-License-Identifier: GPL-3.0-or-later
/// What the OTM scheme keeps besides the world: supports of points, merged nodes, searches.
#pragma once

#include "efree/basis/internal/neighbours.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"

#include <span>
#include <utility>
#include <vector>

namespace efree::internal {

/// What two points do in the next reconnection.
enum class Pairing {
  move,   ///< come apart, as they were one, or nearer to each other; their centre of mass stays
  merge,  ///< both go to their centre of mass, and the first has the mass of both
  share,  ///< the second goes to the first and shares its shape functions; it keeps its mass and its history
};

}  // namespace efree::internal

template <> inline constexpr bool efree::is_plain<efree::internal::Pairing> = true;

namespace efree::internal {

/// Two points of a chunk whose momentum and angular momentum are transferred together.
template <int Dim> struct PointPair {
  Index first, second;
  Vec<Dim> displacement = Vec<Dim>::Zero();  ///< of the first where they move
  Pairing pairing = Pairing::move;
  bool merges() const { return pairing == Pairing::merge; }

  friend auto fields(PointPair& of) {
    auto& [first, second, displacement, pairing] = of;
    return std::tie(first, second, displacement, pairing);
  }
};

/// Points of a chunk, in its order.
template <int Dim> struct OtmPoints {
  std::vector<Vec<Dim>> lambda;       ///< Lagrange multipliers of their shape functions
  Vector count;                       ///< nodes in each one's support at first
  Vector width;                       ///< of the shape functions at first, where they were narrowest
  std::vector<Index> due;             ///< points to be reconnected, ascending
  std::vector<Index> stiffened;       ///< those of them whose new shape functions are stiffer
  std::vector<PointPair<Dim>> pairs;  ///< of points that are due; none that moves or merges is in two

  /// The point is to be reconnected.
  void mark(Index p);
  /// Where it is in `due`.
  std::size_t place(Index p) const;
  bool is_due(Index p) const;
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
  void build(const World<Dim>& world, Index body);
  /// Builds the tree again when nodes have moved so far that a search would find many that are too far away.
  void follow(const World<Dim>& world, Index body);
  /// Nodes of the body, numbered by it, that may be within r: among them all that are.
  void within(Index body, const Vec<Dim>& x, double r, std::vector<Index>& found) const {
    trees_[body].within(x, r + moved_[body], found);
  }
  const Neighbours<Dim>& tree(Index body) const { return trees_[body]; }

 private:
  std::vector<Neighbours<Dim>> trees_;
  std::vector<double> moved_;  ///< largest displacement of a node since then
};

/// Which nodes a point may have in its support: those that cells join to its own, once something is eroded.
template <int Dim> class CrackVisibility {
 public:
  /// Finds the cells around every node that are not eroded.
  void update(const World<Dim>& world);
  bool any() const { return !cells_.empty(); }
  /// Of these nodes, ascending, those that cells which are not eroded join to the point's own, by nodes among these:
  /// shape functions do not reach across cracks.
  void keep_connected(const World<Dim>& world, Index body, Index point, std::vector<Index>& nodes) const;

 private:
  std::vector<std::vector<Index>> offsets_, cells_;  ///< by body and node
};

template <int Dim> struct OtmState {
  OtmOptions options;
  std::vector<OtmPoints<Dim>> points;  ///< by chunk
  std::vector<Index> merged;           ///< by node: the node it has been merged with, itself not merged; -1: none
  bool nodes_changed = false;          ///< nodes have been merged or inserted since the last reconnection
  std::vector<std::vector<std::pair<Index, Index>>> outer;  ///< by body: outer edges of its cells; empty: not known
  NodeSearch<Dim> search;
  CrackVisibility<Dim> cracks;
  /// Nodes, and bodies whose nodes their points have in their supports too; ascending.
  std::vector<std::pair<Index, Index>> seized;

  /// Edges of facets of which a body has one cell only, as the body numbers its nodes, ascending.
  const std::vector<std::pair<Index, Index>>& outer_edges(const World<Dim>& world, Index body);
  /// Marks all points that have this node in their table, unless eroded.
  void mark_points_of(const World<Dim>& world, Index node);
};

/// Shape functions that points of a chunk get.
template <int Dim> struct Reconnection {
  std::vector<TableRow> rows;
  std::vector<Index> lost;       ///< points that have none, nor any to keep, or are inverted: rows are empty
  std::vector<Index> kept;       ///< points that keep the shape functions they had
  std::vector<Index> stiffened;  ///< points whose shape functions are stiffer than before
  std::int64_t iterations = 0;   ///< of Newton's method
  std::int64_t enlarged = 0;     ///< supports
  std::int64_t shared = 0, num_kept = 0;
  double stabilisation = 0.0;  ///< energy of zero-energy modes before
  void add(Reconnection&& more);
};

// Shape functions (shape_functions.cpp).

/// Shape functions of these points of a chunk, ascending, where they and the nodes are; first: at the start.
template <int Dim> Reconnection<Dim> compute_shape_functions(World<Dim>& world, OtmState<Dim>& state, Index chunk,
                                                             std::span<const Index> points, bool first);
/// The shape functions at a point of a chunk, and their nodes; metric and lambda are those of before, and of now on
/// return. False if there are none. Counts in `counted`.
template <int Dim> bool find_shape_functions(const World<Dim>& world, const OtmState<Dim>& state, Index chunk, Index p,
                                             bool first, Mat<Dim>& metric, Vec<Dim>& lambda,
                                             LmeFunctions<Dim>& functions, std::vector<Index>& used,
                                             Reconnection<Dim>& counted);
/// "the material point at ... is outside of the nodes around it".
template <int Dim> std::string no_shape_functions(const World<Dim>& world, const Chunk<Dim>& chunk, Index p);

// Reconnection (reconnection.cpp, shared_supports.cpp, momentum.cpp).

/// Holds a point whose position was just updated, if the step would invert it: until it is reconnected it stays as it
/// was before. Whether it does.
template <int Dim> bool hold_if_inverted(const World<Dim>& world, Chunk<Dim>& chunk, Index p);
/// The step is none for a point that it would invert or nearly so: the point stays as it was, by its F_since before,
/// and exerts no force, since the moments of forces are right only where F is that of the nodes. The work of its stress
/// in half of the step, and the energy of its zero-energy modes, are lost.
template <int Dim> void hold(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const Mat<3>& before);
/// Points without shape functions share those of the nearest point of the chunk that has some.
template <int Dim> void share_supports(World<Dim>& world, OtmState<Dim>& state, Index chunk, Reconnection<Dim>& change);
/// A point and its new row.
struct PointRow {
  Index point;
  const TableRow* row;
};
/// Changes of the masses and momenta of the nodes as shape functions of these points change together.
template <int Dim> void transfer_momentum(const World<Dim>& world, MomentumTransfer how, const Chunk<Dim>& chunk,
                                          const std::vector<PointRow>& rows, Vector& masses, Points<Dim>& momenta);
/// Computes shape functions of all points that are due, where nodes and points are now.
template <int Dim> void reconnect(World<Dim>& world, OtmState<Dim>& state, StableStep<Dim>& stable);

// Nodes and points that come and go.

/// Node a moves with the other from now on; its mass goes with the points that have it in their support.
template <int Dim> void merge_node(World<Dim>& world, OtmState<Dim>& state, Index a, Index with);
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

/// Changes the first shape functions until gradients integrate exactly.
template <int Dim> void integrate_exactly(World<Dim>& world, OtmState<Dim>& state);

/// Bodies that move as one once they meet: an interaction without forces, which marks points near other bodies.
template <int Dim> std::unique_ptr<Interaction<Dim>> seizing(const Scheme<Dim>& scheme, OtmState<Dim>& state);

}  // namespace efree::internal
