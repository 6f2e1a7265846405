// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/planar_domain.hpp"
#include "meshes.hpp"

#include <cmath>
#include <map>
#include <numbers>

namespace efree {
namespace {

using test::boundary_length;
using test::euler_characteristic;
using test::expect_consistent;
using test::length;

using std::numbers::pi;

/// Area of a regular polygon with n corners, and length of its sides together.
double polygon_area(double radius, int n) {
  return 0.5 * n * radius * radius * std::sin(2.0 * pi / n);
}
double polygon_length(double radius, int n) {
  return 2.0 * n * radius * std::sin(pi / n);
}

struct Expected {
  double area;
  std::map<std::string, double> lengths;
  Index euler;
};

void expect_mesh(const PlanarDomain& domain, double size, const Expected& expected) {
  const FineMesh<2> mesh = triangulate(domain, {.size = size});
  expect_consistent(mesh);
  EXPECT_LE(mesh.size(), size * (1.0 + 1e-12));
  EXPECT_NEAR(mesh.volumes().sum(), expected.area, 1e-12 * expected.area);
  EXPECT_EQ(euler_characteristic(mesh), expected.euler);
  EXPECT_EQ(mesh.groups().size(), expected.lengths.size());
  double named = 0.0;
  for (const auto& [name, expected_length] : expected.lengths) {
    EXPECT_NEAR(length(mesh, name), expected_length, 1e-12 * expected_length) << name;
    named += expected_length;
  }
  EXPECT_NEAR(boundary_length(mesh), named, 1e-12 * named);
}

TEST(Shapes, RectangleHasItsAreaAndSides) {
  expect_mesh(shapes::rectangle(-1.0, 2.0, 3.0, 2.5), 0.06,
              {2.0, {{"left", 0.5}, {"right", 0.5}, {"bottom", 4.0}, {"top", 4.0}}, 1});
}

TEST(Shapes, QuarterPlateHasItsAreaAndSides) {
  const int chords = 4 * static_cast<int>(std::ceil(0.5 * pi / 0.1));
  expect_mesh(
      shapes::quarter_plate_with_hole(1.0, 4.0, 0.1), 0.1,
      {16.0 - 0.25 * polygon_area(1.0, chords),
       {{"left", 3.0}, {"bottom", 3.0}, {"right", 4.0}, {"top", 4.0}, {"hole", 0.25 * polygon_length(1.0, chords)}},
       1});
}

TEST(Shapes, LShapeHasItsAreaAndSides) {
  expect_mesh(shapes::l_shape(2.0), 0.07,
              {3.0, {{"left", 2.0}, {"bottom", 2.0}, {"right", 1.0}, {"top", 1.0}, {"notch", 2.0}}, 1});
}

TEST(Shapes, CookHasItsAreaAndSides) {
  expect_mesh(shapes::cook(), 1.3,
              {1440.0,
               {{"left", 44.0}, {"right", 16.0}, {"bottom", std::hypot(48.0, 44.0)}, {"top", std::hypot(48.0, 16.0)}},
               1});
}

TEST(Shapes, AnnulusHasItsAreaAndSides) {
  const int inner = static_cast<int>(std::ceil(2.0 * pi * 0.5 / 0.11)),
            outer = static_cast<int>(std::ceil(2.0 * pi * 2.0 / 0.11));
  expect_mesh(shapes::annulus(0.5, 2.0, 0.11), 0.11,
              {polygon_area(2.0, outer) - polygon_area(0.5, inner),
               {{"inner", polygon_length(0.5, inner)}, {"outer", polygon_length(2.0, outer)}},
               0});
}

TEST(Shapes, SlitRectangleHasBothSidesOfTheSlit) {
  expect_mesh(
      shapes::slit_rectangle(0.0, 0.0, 2.0, 1.0, {0.5, 0.3}, {1.1, 0.7}), 0.05,
      {2.0, {{"left", 1.0}, {"right", 1.0}, {"bottom", 2.0}, {"top", 2.0}, {"slit", 2.0 * std::hypot(0.6, 0.4)}}, 0});
}

TEST(Shapes, PlateWithHolesHasAllOfThem) {
  const PlanarDomain domain = shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 3, 0.1);
  double area = 100.0, edge = 0.0;
  for (const Polyline& chain : domain.boundary) {
    if (chain.name != "holes") continue;
    const int n = static_cast<int>(chain.points.size()) - 1;
    const double chord = (chain.points[1] - chain.points[0]).norm(), radius = chord / (2.0 * std::sin(pi / n));
    EXPECT_GE(n, 16);
    EXPECT_GE(radius, 0.04 * (1.0 - 1e-12));
    EXPECT_LE(radius, 0.4 * (1.0 + 1e-12));
    area -= polygon_area(radius, n);
    edge += n * chord;
  }
  expect_mesh(domain, 0.1,
              {area, {{"left", 10.0}, {"right", 10.0}, {"bottom", 10.0}, {"top", 10.0}, {"holes", edge}}, 1 - 160});
  const auto again = shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 3, 0.1);
  const auto other = shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 4, 0.1);
  EXPECT_EQ(domain.boundary.back().points, again.boundary.back().points);
  EXPECT_NE(domain.boundary.back().points, other.boundary.back().points);
}

TEST(Shapes, HolesKeepTheirGap) {
  const double gap = 0.05;
  const PlanarDomain domain = shapes::plate_with_random_holes(3.0, 12, 0.1, 0.3, gap, 1, 0.05);
  double least = 1.0;
  for (std::size_t a = 4; a < domain.boundary.size(); ++a)
    for (const Vec<2>& p : domain.boundary[a].points) {
      least = std::min({least, p.x(), p.y(), 3.0 - p.x(), 3.0 - p.y()});
      for (std::size_t b = 4; b < a; ++b)
        for (const Vec<2>& q : domain.boundary[b].points) least = std::min(least, (p - q).norm());
    }
  EXPECT_GE(least, gap * (1.0 - 1e-12));
}

TEST(Shapes, RefuseImpossibleLengths) {
  EXPECT_INPUT_ERROR(shapes::rectangle(1.0, 0.0, 0.0, 1.0), "is empty");
  EXPECT_INPUT_ERROR(shapes::annulus(2.0, 1.0, 0.1), "0 < inner < outer");
  EXPECT_INPUT_ERROR(shapes::quarter_plate_with_hole(4.0, 1.0, 0.1), "radius 4 and half width 1");
  EXPECT_INPUT_ERROR(shapes::annulus(1.0, 2.0, 0.0), "size is 0");
  EXPECT_INPUT_ERROR(shapes::annulus(1.0, 4294967296.0, 0.2), "chords of an arc");
  EXPECT_INPUT_ERROR(shapes::plate_with_random_holes(1.0, 100, 0.2, 0.2, 0.01, 1, 0.1), "of 100 holes");
}

TEST(Triangulate, IsDeterministic) {
  const PlanarDomain domain = shapes::quarter_plate_with_hole(1.0, 4.0, 0.1);
  const FineMesh<2> a = triangulate(domain, {.size = 0.1}), b = triangulate(domain, {.size = 0.1});
  EXPECT_EQ(a.vertices(), b.vertices());
  EXPECT_EQ(a.cells(), b.cells());
}

TEST(Triangulate, ReachesTheAngleItAimsAt) {
  const FineMesh<2> mesh =
      triangulate(shapes::plate_with_random_holes(4.0, 20, 0.04, 0.4, 0.03, 2, 0.05), {.size = 0.05});
  double least = 90.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i < 3; ++i) {
      const Vec<2> p = mesh.vertex(mesh.cells()(i, c)),
                   u = (mesh.vertex(mesh.cells()((i + 1) % 3, c)) - p).normalized(),
                   v = (mesh.vertex(mesh.cells()((i + 2) % 3, c)) - p).normalized();
      least = std::min(least, std::acos(u.dot(v)) * 180.0 / pi);
    }
  EXPECT_GT(least, 20.6);
}

TEST(Triangulate, LeavesSliversAloneIfToldSo) {
  // A 1e-4 wide strip: with an angle to aim at it takes thousands of triangles.
  const PlanarDomain strip = shapes::rectangle(0.0, 0.0, 1.0, 1e-4);
  EXPECT_LT(triangulate(strip, {.size = 0.1, .min_angle = 0.0}).num_cells(), 100);
  EXPECT_GT(triangulate(strip, {.size = 0.1}).num_cells(), 5000);
}

TEST(Triangulate, TakesOutlinesInAnyOrderAndNesting) {
  PlanarDomain domain = shapes::rectangle(0.0, 0.0, 4.0, 4.0);
  const PlanarDomain hole = shapes::rectangle(1.0, 1.0, 3.0, 3.0), island = shapes::rectangle(1.5, 1.5, 2.5, 2.5);
  domain.boundary.insert(domain.boundary.begin(), island.boundary.rbegin(), island.boundary.rend());
  domain.boundary.insert(domain.boundary.end(), hole.boundary.begin(), hole.boundary.end());
  const FineMesh<2> mesh = triangulate(domain, {.size = 0.2});
  expect_consistent(mesh);
  EXPECT_NEAR(mesh.volumes().sum(), 16.0 - 4.0 + 1.0, 1e-12);
  EXPECT_EQ(mesh.num_components(), 2);
  EXPECT_NEAR(length(mesh, "left"), 4.0 + 2.0 + 1.0, 1e-12);
}

TEST(Triangulate, SidesGivenTwiceJoinTheParts) {
  PlanarDomain domain = shapes::rectangle(0.0, 0.0, 1.0, 1.0);
  const PlanarDomain right = shapes::rectangle(1.0, 0.0, 2.0, 1.0);
  domain.boundary.insert(domain.boundary.end(), right.boundary.begin(), right.boundary.end());
  const FineMesh<2> mesh = triangulate(domain, {.size = 0.1});
  expect_consistent(mesh);
  EXPECT_NEAR(mesh.volumes().sum(), 2.0, 1e-12);
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_NEAR(length(mesh, "left"), 1.0, 1e-12);
  EXPECT_NEAR(boundary_length(mesh), 6.0, 1e-12);
}

TEST(Triangulate, FollowsEmbeddedChainsAndPoints) {
  PlanarDomain domain = shapes::rectangle(0.0, 0.0, 1.0, 1.0);
  domain.embedded = {{"", {{0.1, 0.2}, {0.83, 0.61}}}, {"", {{0.317, 0.871}}}, {"foot", {{0.25, 0.0}, {0.75, 0.0}}}};
  const FineMesh<2> mesh = triangulate(domain, {.size = 0.05});
  expect_consistent(mesh);
  const Vec<2> a = domain.embedded[0].points[0], along = (domain.embedded[0].points[1] - a);
  Index points = 0;
  double followed = 0.0;
  const auto on_chain = [&](const Vec<2>& p) {
    const double t = along.dot(p - a) / along.squaredNorm();
    return t > -1e-12 && t < 1.0 + 1e-12 && (p - a - t * along).norm() < 1e-12;
  };
  for (Index v = 0; v < mesh.num_vertices(); ++v) points += mesh.vertex(v) == Vec<2>(0.317, 0.871);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i < 3; ++i) {
      const Vec<2> p = mesh.vertex(mesh.cells()(i, c)), q = mesh.vertex(mesh.cells()((i + 1) % 3, c));
      if (on_chain(p) && on_chain(q)) followed += 0.5 * (q - p).norm();  // from both sides
    }
  EXPECT_EQ(points, 1);
  EXPECT_NEAR(followed, along.norm(), 1e-12);
  EXPECT_EQ(euler_characteristic(mesh), 1);
  EXPECT_NEAR(length(mesh, "foot"), 0.5, 1e-12);
  EXPECT_NEAR(length(mesh, "bottom"), 1.0, 1e-12);
}

/// One element in such a corner hides from recovery how singular the stress is there.
TEST(Triangulate, CornersWiderThanARightAngleHaveTwoCells) {
  for (double size = 1.25; size < 1.75; size *= 1.005) {  // of every sixth of these a corner would be cut off
    const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = size});
    Index corner = 0, cells = 0;
    while ((mesh.vertex(corner) - Vec<2>(0.0, 44.0)).norm() > 1e-12) ++corner;
    for (const Index v : mesh.cells().reshaped()) cells += v == corner;
    EXPECT_GE(cells, 2) << size;
    EXPECT_LE(mesh.size(), size * (1.0 + 1e-12));
  }
}

TEST(Triangulate, ASlitFromAnInclinedSideStartsThere) {
  // No double lies exactly on the side at a third of its length: the point is taken to be on it all the same.
  PlanarDomain domain = shapes::cook();
  const Vec<2> mouth = Vec<2>(0.0, 0.0) + Vec<2>(48.0, 44.0) / 3.0, tip(20.0, 38.0);
  domain.slits = {{"crack", {mouth, tip}}};
  const FineMesh<2> mesh = triangulate(domain, {.size = 1.5});
  expect_consistent(mesh);
  EXPECT_NEAR(length(mesh, "crack"), 2.0 * (tip - mouth).norm(), 1e-10);
  EXPECT_NEAR(length(mesh, "bottom"), std::hypot(48.0, 44.0), 1e-10);
  EXPECT_EQ(euler_characteristic(mesh), 1);  // open to the outside, no hole
  EXPECT_GT(mesh.volumes().minCoeff(), 1e-3);
}

TEST(Triangulate, CrossingSlitsOpenAllFourWays) {
  PlanarDomain domain = shapes::rectangle(0.0, 0.0, 1.0, 1.0);
  domain.slits = {{"a", {{0.2, 0.3}, {0.8, 0.7}}}, {"b", {{0.3, 0.9}, {0.6, 0.1}}}};
  const FineMesh<2> mesh = triangulate(domain, {.size = 0.05});
  expect_consistent(mesh);
  EXPECT_NEAR(length(mesh, "a"), 2.0 * std::hypot(0.6, 0.4), 1e-12);
  EXPECT_NEAR(length(mesh, "b"), 2.0 * std::hypot(0.3, 0.8), 1e-12);
  EXPECT_EQ(euler_characteristic(mesh), 0);
  EXPECT_EQ(mesh.num_components(), 1);
}

TEST(Triangulate, ASlitFromSideToSideSeparatesTheBody) {
  const FineMesh<2> mesh =
      triangulate(shapes::slit_rectangle(0.0, 0.0, 2.0, 1.0, {0.7, 0.0}, {1.2, 1.0}), {.size = 0.1});
  expect_consistent(mesh);
  EXPECT_EQ(mesh.num_components(), 2);
  EXPECT_NEAR(length(mesh, "slit"), 2.0 * std::hypot(0.5, 1.0), 1e-12);
  EXPECT_NEAR(mesh.volumes().sum(), 2.0, 1e-12);
}

TEST(Triangulate, AShortSlitOpens) {
  const FineMesh<2> mesh =
      triangulate(shapes::slit_rectangle(0.0, 0.0, 1.0, 1.0, {0.5, 0.5}, {0.51, 0.5}), {.size = 0.2});
  EXPECT_NEAR(length(mesh, "slit"), 0.02, 1e-12);
}

TEST(Triangulate, RefusesWhatIsNoDomain) {
  const PlanarDomain square = shapes::rectangle(0.0, 0.0, 1.0, 1.0);
  EXPECT_INPUT_ERROR(triangulate(square, {}), "size is 0, expected a positive length");
  EXPECT_INPUT_ERROR(triangulate(square, {.size = 0.1, .min_angle = 30.0}), "min_angle is 30");
  EXPECT_INPUT_ERROR(triangulate(square, {.size = 1e-9}), "GiB of memory");
  EXPECT_INPUT_ERROR(triangulate({}, {.size = 0.1}), "0 points, expected at least 3");

  PlanarDomain domain = square;
  domain.boundary[1].points = {{1.0, 0.0}, {1.0, 0.75}};
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "loose end at (1, 0.75)");
  domain = square;
  domain.boundary.push_back({"stray", {{0.25, 0.5}, {0.75, 0.5}}});
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "loose end at (0.25, 0.5)");
  domain = square;
  domain.boundary.push_back({"hole", {{0.5, 0.5}, {1.5, 0.5}, {1.5, 0.75}, {0.5, 0.5}}});
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "\"right\" and \"hole\" cross at (1, 0.5)");
  domain = square;
  domain.boundary.insert(domain.boundary.end(), square.boundary.begin(), square.boundary.end());
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "it is empty");
  domain = square;
  domain.boundary.push_back({"dot", {{0.5, 0.5}}});
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "chain \"dot\" has 1 points, expected at least 2");
  domain = square;
  domain.boundary[0].points[0].x() = std::nan("");
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "expected finite numbers");
  domain = square;
  domain.slits = {{"crack", {{0.5, 0.5}, {1.75, 0.5}}}};
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "\"right\" and \"crack\" cross at (1, 0.5)");
  domain.slits = {{"crack", {{1.25, 0.5}, {1.5, 0.5}}}};
  EXPECT_INPUT_ERROR(triangulate(domain, {.size = 0.1}), "slit \"crack\" leaves the body");
}

}  // namespace
}  // namespace efree
