// SPDX-License-Identifier: GPL-3.0-or-later
/// Exact distances: closed forms, and a dense visibility graph of the corners of random polygons with holes.
#include "domains.hpp"
#include "efree/core/error.hpp"
#include "efree/heatgeo/internal/patch.hpp"
#include "efree/heatgeo/internal/sight_lines.hpp"
#include "efree/heatgeo/internal/visible_distance.hpp"

#include <gtest/gtest.h>

namespace efree::testing {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Shortest paths over the corners of closed polygons, every pair of points tested against every side.
class CornerGraph {
 public:
  explicit CornerGraph(const PlanarDomain& domain) {
    for (const Polyline& line : domain.boundary)
      for (std::size_t k = 0; k + 1 < line.points.size(); ++k) {
        corners_.push_back(line.points[k]);
        sides_.push_back({line.points[k], line.points[k + 1]});
      }
  }

  void set_source(const Vec<2>& source) {
    source_ = source;
    distance_.assign(corners_.size(), infinity);
    for (std::size_t i = 0; i < corners_.size(); ++i)
      if (sees(source, corners_[i])) distance_[i] = (corners_[i] - source).norm();
    for (std::size_t round = 0; round < corners_.size(); ++round)
      for (std::size_t i = 0; i < corners_.size(); ++i)
        for (std::size_t j = 0; j < corners_.size(); ++j) {
          const double d = distance_[i] + (corners_[i] - corners_[j]).norm();
          if (d < distance_[j] - 1e-14 && sees(corners_[i], corners_[j])) distance_[j] = d;
        }
  }

  double to(const Vec<2>& x) const {
    if (sees(source_, x)) return (x - source_).norm();
    double least = infinity;
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const double d = distance_[i] + (corners_[i] - x).norm();
      if (d < least && sees(corners_[i], x)) least = d;
    }
    return least;
  }

 private:
  bool sees(const Vec<2>& a, const Vec<2>& b) const {
    for (const auto& [p, q] : sides_) {
      if ((a == p && b == q) || (a == q && b == p)) return true;
      if (a == p || a == q || b == p || b == q) continue;
      if (cross(b - a, p - a) * cross(b - a, q - a) < 0.0 && cross(q - p, a - p) * cross(q - p, b - p) < 0.0)
        return false;
    }
    const Vec<2> middle = 0.5 * (a + b);
    bool inside = false;
    for (const auto& [p, q] : sides_)
      if ((p.y() > middle.y()) != (q.y() > middle.y()) &&
          middle.x() < p.x() + (middle.y() - p.y()) / (q.y() - p.y()) * (q.x() - p.x()))
        inside = !inside;
    return inside;
  }

  std::vector<Vec<2>> corners_;
  std::vector<std::pair<Vec<2>, Vec<2>>> sides_;
  Vec<2> source_;
  std::vector<double> distance_;
};

/// A star-shaped, jagged outline with jagged holes.
PlanarDomain jagged_domain(unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> random(0.0, 1.0);
  const auto star = [&](const Vec<2>& centre, double radius, int corners) {
    Polyline line;
    for (int k = 0; k < corners; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k + 0.7 * random(generator)) / corners;
      line.points.push_back(centre +
                            radius * (0.4 + 0.6 * random(generator)) * Vec<2>(std::cos(angle), std::sin(angle)));
    }
    line.points.push_back(line.points.front());
    return line;
  };
  PlanarDomain domain;
  domain.boundary.push_back(star({0.0, 0.0}, 2.5, 12));
  for (int k = 0; k < 5; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k + 0.3 * random(generator)) / 5;
    domain.boundary.push_back(star(0.6 * Vec<2>(std::cos(angle), std::sin(angle)), 0.3, 6));
  }
  return domain;
}

/// A square with a kinked and a branching slit, one end on the boundary.
PlanarDomain cracked_square() {
  PlanarDomain domain = shapes::rectangle(-1, -1, 1, 1);
  domain.slits.push_back({"kinked", {{-1.0, -0.4}, {-0.3, -0.3}, {0.1, -0.6}, {0.5, -0.6}}});
  domain.slits.push_back({"trunk", {{-0.5, 0.3}, {0.1, 0.3}}});
  domain.slits.push_back({"branches", {{0.4, 0.7}, {0.1, 0.3}, {0.5, 0.1}}});
  return domain;
}

/// Two squares that meet in a corner, next to a third across a gap.
PlanarDomain touching_squares() {
  PlanarDomain domain = shapes::rectangle(0, 0, 1, 1);
  for (const PlanarDomain& other : {shapes::rectangle(1, 1, 2, 2), shapes::rectangle(1.1, 0, 2, 0.9)})
    domain.boundary.insert(domain.boundary.end(), other.boundary.begin(), other.boundary.end());
  return domain;
}

TEST(Visibility, MatchesTheCornerGraphOfJaggedDomains) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const PlanarDomain domain = jagged_domain(seed);
    const FineMesh<2> mesh = triangulate(domain, {.size = 0.12});
    const Geodesics<2> geodesics(mesh, {.engine = Weight::visibility});
    CornerGraph graph(domain);
    int compared = 0;
    for (Index source : random_vertices(mesh, 12, seed)) {
      if (mesh.on_boundary(source)) continue;
      graph.set_source(mesh.vertex(source));
      const LocalField field = geodesics.from(source, 20.0);
      ASSERT_EQ(static_cast<Index>(field.vertices.size()), mesh.num_vertices());
      for (Index v = 0; v < mesh.num_vertices(); ++v)
        if (!mesh.on_boundary(v)) {
          ASSERT_NEAR(field.values[v], graph.to(mesh.vertex(v)), 1e-11)
              << "seed " << seed << " from " << source << " to " << v;
          ++compared;
        }
    }
    EXPECT_GT(compared, 500);
  }
}

TEST(Visibility, IsExactAroundTheSlit) {
  for (const bool slivers : {false, true}) {
    const FineMesh<2> mesh = slivers ? with_slivers(slit_square(0.08)) : slit_square(0.08);
    const Geodesics<2> geodesics(mesh, {.engine = Weight::visibility});
    std::vector<Index> sources = random_vertices(mesh, 40, 3);
    sources.insert(sources.end(),
                   {vertex_near(mesh, {-0.5, 0.0}, {0.0, 1.0}), vertex_near(mesh, {-0.5, 0.0}, {0.0, -1.0}),
                    vertex_near(mesh, {0.0, 0.0}), vertex_near(mesh, {-1.0, 0.0}, {0.0, 1.0})});
    for (const double radius : {0.4, 0.9, 5.0}) {
      const auto error = distance_error(mesh, geodesics, sources, radius, 1e-12,
                                        [&](Index a, Index b) { return slit_distance(mesh, a, b); });
      EXPECT_LT(error.largest, 1e-12) << "radius " << radius;
    }
  }
}

TEST(Visibility, IsExactInTheL) {
  const FineMesh<2> mesh = triangulate(shapes::l_shape(2.0), {.size = 0.1});
  const Geodesics<2> geodesics(mesh, {.engine = Weight::visibility});
  const Vec<2> corner(1.0, 1.0);
  const auto exact = [&](Index a, Index b) {
    const Vec<2> x = mesh.vertex(a), y = mesh.vertex(b);
    // Only a segment between the two arms can pass on the wrong side of the corner.
    const bool arms = (x.x() > 1.0 && y.y() > 1.0) || (y.x() > 1.0 && x.y() > 1.0);
    const double passes = cross(y - x, corner - x) * (x.x() > y.x() ? 1.0 : -1.0);
    return arms && passes > 0.0 ? (x - corner).norm() + (y - corner).norm() : (x - y).norm();
  };
  EXPECT_LT(distance_error(mesh, geodesics, random_vertices(mesh, 60, 1), 10.0, 0.0, exact).largest, 1e-12);
}

TEST(Visibility, FollowsTheRimOfAHole) {
  const FineMesh<2> mesh = triangulate(shapes::annulus(1.0, 3.0, 0.05), {.size = 0.1});
  const Geodesics<2> geodesics(mesh, {.engine = Weight::visibility});
  const auto exact = [&](Index a, Index b) { return disc_distance(1.0, mesh.vertex(a), mesh.vertex(b)); };
  // The hole is a polygon inside the circle: paths are shorter by its sagitta.
  EXPECT_LT(distance_error(mesh, geodesics, random_vertices(mesh, 20, 1), 6.0, 0.0, exact).largest, 2e-4);
}

TEST(Visibility, IsSymmetric) {
  const FineMesh<2> mesh =
      triangulate(shapes::plate_with_random_holes(1.0, 20, 0.03, 0.1, 0.02, 1, 0.02), {.size = 0.04});
  const Geodesics<2> geodesics(mesh, {.engine = Weight::visibility});
  const auto vertices = random_vertices(mesh, 80, 2);
  const auto fields = geodesics.from(vertices, Vector::Constant(80, 3.0));
  double largest = 0.0;
  for (int i = 0; i < 80; ++i)
    for (int j = 0; j < i; ++j)
      largest = std::max(largest, std::abs(fields[i].values[vertices[j]] - fields[j].values[vertices[i]]));
  EXPECT_LT(largest, 1e-13);
}

TEST(Visibility, PartsThatTouchInAPointDoNotSeeEachOther) {
  const FineMesh<2> mesh = triangulate(touching_squares(), {.size = 0.1});
  const Geodesics<2> geodesics(mesh, {.engine = Weight::visibility});
  const auto square = [&](Index v) {
    const Vec<2> x = mesh.centroid(mesh.cells_of(v).front());
    return x.y() > 1.0 ? 2 : x.x() > 1.0 ? 1 : 0;
  };
  const Index contact = vertex_near(mesh, {1.0, 1.0});
  for (Index source = 0; source < mesh.num_vertices(); ++source) {
    if (source == contact) continue;
    Index reached = 0, expected = 0;
    for (Index v : geodesics.from(source, 5.0).vertices) {
      ASSERT_TRUE(v == contact || square(v) == square(source)) << "from " << source << " to " << v;
      ++reached;
    }
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      expected += square(v) == square(source) || (v == contact && square(source) != 1);
    ASSERT_EQ(reached, expected);
  }
}

TEST(Visibility, WhatCornersRememberDoesNotChangeDistances) {
  const FineMesh<2> mesh =
      triangulate(shapes::plate_with_random_holes(1.0, 20, 0.03, 0.1, 0.02, 1, 0.02), {.size = 0.04});
  const SightLines sight(mesh);
  VisibleDistance used(sight);
  for (const double radius : {0.3, 0.8, 0.2, 0.5})
    for (Index source : random_vertices(mesh, 20, 5)) {
      VisibleDistance fresh(sight);
      fresh.measure(source, radius);
      used.measure(source, radius);
      ASSERT_EQ(used.reached().size(), fresh.reached().size());
      for (Index v : fresh.reached()) ASSERT_EQ(used.distance(v), fresh.distance(v));
    }
}

TEST(Viewpoint, SeesWhatSightLinesReach) {
  const FineMesh<2> domains[] = {
      triangulate(cracked_square(), {.size = 0.12}),
      triangulate(touching_squares(), {.size = 0.15}),
      slit_square(0.1),
      with_slivers(slit_square(0.15)),
      triangulate(shapes::l_shape(2.0), {.size = 0.15}),
      triangulate(shapes::plate_with_random_holes(1.0, 12, 0.03, 0.1, 0.02, 1, 0.03), {.size = 0.06}),
      triangulate(jagged_domain(7), {.size = 0.2})};
  for (const FineMesh<2>& mesh : domains) {
    const SightLines sight(mesh);
    Viewpoint viewpoint(sight);
    int hidden = 0;
    for (Index source = 0; source < mesh.num_vertices(); ++source) {
      viewpoint.look(source, {mesh.vertices().rowwise().minCoeff(), mesh.vertices().rowwise().maxCoeff()});
      for (Index v = 0; v < mesh.num_vertices(); ++v) {
        const Vec<2> line = mesh.vertex(v) - mesh.vertex(source);
        const bool seen = sight.visible(source, v);
        ASSERT_EQ(viewpoint.sees(v, line, line.norm()), seen) << "from " << source << " to " << v;
        hidden += !seen;
      }
    }
    EXPECT_GT(hidden, mesh.num_vertices());
  }
}

TEST(SightLines, TheTwoSidesOfASlitDoNotSeeEachOther) {
  const FineMesh<2> mesh = slit_square(0.1);
  const SightLines sight(mesh);
  const Index above = vertex_near(mesh, {-0.5, 0.0}, {0.0, 1.0}), below = vertex_near(mesh, {-0.5, 0.0}, {0.0, -1.0});
  ASSERT_NE(above, below);
  ASSERT_EQ(mesh.vertex(above), mesh.vertex(below));
  EXPECT_FALSE(sight.visible(above, below));
  EXPECT_FALSE(sight.visible(vertex_near(mesh, {-0.5, 0.5}), below));
  EXPECT_TRUE(sight.visible(vertex_near(mesh, {-0.5, 0.5}), above));
  const Index tip = vertex_near(mesh, {0.0, 0.0}), ahead = vertex_near(mesh, {1.0, 0.0});
  for (const Index side : {above, below}) {
    EXPECT_TRUE(sight.visible(tip, side));
    EXPECT_TRUE(sight.visible(side, tip));
    EXPECT_TRUE(sight.visible(ahead, side) && sight.visible(side, ahead)) << "along the slit from ahead of its tip";
  }
  EXPECT_TRUE(sight.is_reflex(tip));
  EXPECT_FALSE(sight.is_reflex(above));
}

TEST(Patch, IsObstructedOnlyWhereTheOuterSideOfTheBoundaryShows) {
  const FineMesh<2> square = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.05});
  PatchFinder<2> in_square(square);
  for (Index v = 0; v < square.num_vertices(); ++v) EXPECT_FALSE(in_square.around(v, 0.4).obstructed);

  // A straight inclined side is straight but for rounding.
  MeshData<2> turned{square.vertices(), square.cells(), {}};
  turned.vertices = (Eigen::Rotation2Dd(0.7).toRotationMatrix() * square.vertices()).colwise() + Vec<2>(3.0, 17.0);
  const FineMesh<2> inclined(turned);
  PatchFinder<2> in_inclined(inclined);
  for (Index v = 0; v < inclined.num_vertices(); ++v) EXPECT_FALSE(in_inclined.around(v, 0.4).obstructed);

  const FineMesh<2> slit = slit_square(0.1);
  PatchFinder<2> in_slit(slit);
  EXPECT_TRUE(in_slit.around(vertex_near(slit, {-0.2, 0.1}), 0.5).obstructed);
  EXPECT_FALSE(in_slit.around(vertex_near(slit, {-0.2, 0.5}), 0.3).obstructed) << "not in reach";
  EXPECT_TRUE(in_slit.around(vertex_near(slit, {-0.3, 0.0}, {0.0, 1.0}), 0.5).obstructed)
      << "both sides in reach around the tip";
  EXPECT_FALSE(in_slit.around(vertex_near(slit, {-0.6, 0.0}, {0.0, 1.0}), 0.3).obstructed)
      << "the far side is out of reach";
}

TEST(Geodesics, RejectsBadInput) {
  const FineMesh<2> mesh = slit_square(0.3);
  EXPECT_THROW(Geodesics<2>(mesh, {.engine = Weight::heat_flow}), InputError);
  const Geodesics<2> geodesics(mesh, {});
  EXPECT_THROW(geodesics.from(mesh.num_vertices(), 1.0), InputError);
  EXPECT_THROW(geodesics.from(0, 0.0), InputError);
  EXPECT_THROW(geodesics.from(0, std::nan("")), InputError);
  EXPECT_THROW(geodesics.from({0, 1}, Vector::Ones(1)), InputError);
}

}  // namespace
}  // namespace efree::testing
