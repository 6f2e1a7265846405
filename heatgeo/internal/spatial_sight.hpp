// SPDX-License-Identifier: GPL-3.0-or-later
/// Lines of sight through a tetrahedral mesh.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/heatgeo/internal/box_tree.hpp"

#include <array>

namespace efree {

/// What marches through one mesh share: neighbours, planes of the boundary, trees to search in, and the test of lines
/// of sight. Immutable.
class SpatialSight {
 public:
  struct Facet {
    Vec<3> normal;   ///< unit, outward
    double longest;  ///< of its sides
    double slack;    ///< rounding of heights over the facet's plane, for each unit of length around
  };
  /// What a search finds, with what decides at once whether it matters.
  struct PlacedVertex {
    Vec<3> x;
    Index vertex, body;
  };
  struct PlacedFacet {
    Facet facet;
    Vec<3> corner;  ///< the first of `corners`
    std::array<Index, 3> corners;
    Index body;
  };
  struct Neighbour {
    Index vertex;
    Index cell;  ///< one of those that hold both ends of the edge
  };
  /// On which side of a facet's plane a point lies.
  enum Side : char { inner, outer, edge_on };

  /// What trees are built for: marches from single sources, or none.
  enum class Search { patches, none };

  /// Keeps a reference. Cost linear in the mesh, n log n with trees.
  SpatialSight(const FineMesh<3>& mesh, Search search);

  const FineMesh<3>& mesh() const { return mesh_; }
  double tolerance() const { return tolerance_; }
  std::span<const Neighbour> neighbours(Index v) const { return neighbours_[v]; }
  const Facet& facet(Index f) const { return facets_[f]; }
  /// Calls body(PlacedVertex) for every vertex in the open ball, and some around it; needs Search::patches.
  template <class Body> void for_each_vertex_near(const Vec<3>& centre, double radius, const Body& body) const {
    vertex_tree_.for_each_near(centre, radius, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) body(placed_vertices_[k]);
    });
  }
  /// The same for the boundary's facets that meet the ball.
  template <class Body> void for_each_facet_near(const Vec<3>& centre, double radius, const Body& body) const {
    facet_tree_.for_each_near(centre, radius, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) body(placed_facets_[k]);
    });
  }

  /// `arm` leads to the point from a corner of the facet.
  Side side(const Facet& facet, const Vec<3>& arm) const {
    const double height = facet.normal.dot(arm), rounding = facet.slack * (facet.longest + arm.cwiseAbs().sum());
    return height > rounding ? outer : height < -rounding ? inner : edge_on;
  }
  /// Whether the straight line from v to x begins inside the body or on its boundary, if not all facets at v show x
  /// their outer sides. x is another place than v's.
  bool begins_inside(Index v, const Vec<3>& x) const;
  /// Whether the straight line from v to `target` stays inside the body. Lines along the boundary are inside.
  bool sees(Index v, Index target) const;

  /// How a vertex has been reached by a march, measured by the straight line from the target of a line of sight.
  enum Reach : unsigned char { not_yet = 0, in_time = 1, late = 2 };

  /// The same for v in `near`, with a shortcut: `reach` tells of a vertex what is above. Where all corners of a facet
  /// that the line crosses have been reached in time, so is what lies behind it, whatever the line goes through
  /// farther on; where all are late, the line comes out of a shadow. Only a spike thinner than that facet could make a
  /// difference.
  template <class ReachOf> bool sees(const Neighbour& near, Index target, const ReachOf& reach) const {
    const Index v = near.vertex;
    if (mesh_.on_boundary(v) && shows_only_outer_sides(v, mesh_.vertex(target))) return false;
    const Answer answer = walk(near, target, reach);
    return answer == Answer::unsure ? sees(v, target) : answer == Answer::yes;
  }

 private:
  enum class Answer { yes, no, unsure };
  struct Start {
    Index cell = -1;
    int corner = 0;
  };

  // By heights over facets: robust and slow.
  Start start(Index vertex, const Vec<3>& x) const;
  bool reaches(Start from, Index target) const;
  bool beyond(Index c, int i, const Vec<3>& x) const;
  double height(Index c, int i, const Vec<3>& x) const;

  bool shows_only_outer_sides(Index v, const Vec<3>& x) const {
    const Vec<3> arm = x - mesh_.vertex(v);
    for (const Index f : mesh_.facets_of(v))
      if (side(facets_[f], arm) != outer) return false;
    return true;
  }
  Answer begins_inside_from(Index v, const Vec<3>& line, Index c) const;
  template <class ReachOf> Answer walk(const Neighbour& near, Index target, const ReachOf& reach) const;

  const FineMesh<3>& mesh_;
  double tolerance_;
  Ragged<Neighbour> neighbours_;
  std::vector<Facet> facets_;
  BoxTree vertex_tree_, facet_tree_;
  std::vector<PlacedVertex> placed_vertices_;  ///< in the order of the tree
  std::vector<PlacedFacet> placed_facets_;
};

/// In the projection along the line, where it is the origin: it crosses the facet whose corners go around that.
template <class ReachOf>
SpatialSight::Answer SpatialSight::walk(const Neighbour& near, Index target, const ReachOf& reach) const {
  // Corners opposite corner k, so that they turn to the left seen from it.
  constexpr std::array<std::array<int, 3>, 4> opposite{{{1, 2, 3}, {3, 2, 0}, {3, 0, 1}, {1, 0, 2}}};
  constexpr int steps_around_vertex = 24, steps = 1000;
  constexpr double rim = 1e-6;  // share of a facet
  const Index v = near.vertex;
  const Vec<3> from = mesh_.vertex(v), line = mesh_.vertex(target) - from;
  int axis = 0;
  line.cwiseAbs().minCoeff(&axis);
  const Vec<3> across = line.cross(Vec<3>::Unit(axis)), up = line.cross(across);

  struct Projected {
    Index vertex;
    double x, y;
  };
  const auto project = [&](Index w) {
    const Vec<3> arm = mesh_.vertex(w) - from;
    return Projected{w, across.dot(arm), up.dot(arm)};
  };
  const auto turn = [](const Projected& p, const Projected& q) { return p.x * q.y - p.y * q.x; };

  // Around v to the cell that the line enters.
  Index c = near.cell;
  const auto across_from = [&](Index w) {
    const auto corners = mesh_.cells().col(c);
    return mesh_.neighbour(corners[0] == w ? 0 : corners[1] == w ? 1 : corners[2] == w ? 2 : 3, c);
  };
  std::array<Projected, 3> crossed;
  {
    const auto corners = mesh_.cells().col(c);
    const int corner = corners[0] == v ? 0 : corners[1] == v ? 1 : corners[2] == v ? 2 : 3;
    for (int k = 0; k < 3; ++k) crossed[k] = project(corners[opposite[corner][k]]);
  }
  for (int step = 0;; ++step) {
    // turns[k]: of the side opposite corner k
    const std::array<double, 3> turns{turn(crossed[1], crossed[2]), turn(crossed[2], crossed[0]),
                                      turn(crossed[0], crossed[1])};
    const int least = turns[0] <= turns[1] && turns[0] <= turns[2] ? 0 : turns[1] <= turns[2] ? 1 : 2;
    if (turns[least] >= 0.0) {
      c = across_from(v);
      break;
    }
    const Index next = across_from(crossed[least].vertex);
    if (next < 0) {  // the line may begin inside beyond it
      const Answer begins = begins_inside_from(v, line, c);
      return begins == Answer::yes ? Answer::unsure : begins;
    }
    c = next;
    if (step == steps_around_vertex) return Answer::unsure;
    const auto corners = mesh_.cells().col(c);
    Projected &left = crossed[(least + 1) % 3], &right = crossed[(least + 2) % 3];
    crossed[least] = project(corners[0] ^ corners[1] ^ corners[2] ^ corners[3] ^ v ^ left.vertex ^ right.vertex);
    std::swap(left, right);
  }

  std::array<Reach, 3> reached{};
  for (int k = 0; k < 3; ++k) {
    if (crossed[k].vertex == target) return Answer::yes;
    reached[k] = reach(crossed[k].vertex);
  }
  for (int step = 0; step < steps; ++step) {
    if (const int all = reached[0] & reached[1] & reached[2]) return all == in_time ? Answer::yes : Answer::no;
    if (c < 0) {
      const double ab = turn(crossed[0], crossed[1]), bd = turn(crossed[1], crossed[2]),
                   da = turn(crossed[2], crossed[0]);
      return std::min({ab, bd, da}) > rim * (ab + bd + da) ? Answer::no : Answer::unsure;
    }
    // The corner that is not one of the facet.
    const auto corners = mesh_.cells().col(c);
    const Index ahead =
        corners[0] ^ corners[1] ^ corners[2] ^ corners[3] ^ crossed[0].vertex ^ crossed[1].vertex ^ crossed[2].vertex;
    if (ahead == target) return Answer::yes;
    const Projected e = project(ahead);
    const bool left_of_0 = turn(e, crossed[0]) >= 0.0, left_of_1 = turn(e, crossed[1]) >= 0.0,
               left_of_2 = turn(e, crossed[2]) >= 0.0;
    const int replaced = left_of_0 && !left_of_1 ? 2 : left_of_1 && !left_of_2 ? 0 : 1;
    c = across_from(crossed[replaced].vertex);
    crossed[replaced] = e;
    reached[replaced] = reach(ahead);
  }
  return Answer::unsure;
}

}  // namespace efree
