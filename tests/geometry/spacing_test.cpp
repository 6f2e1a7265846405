// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cloud/spacing.hpp"
#include "efree/geometry/cloud/node_cloud.hpp"
#include "efree/geometry/mesh/walls.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "meshes.hpp"

#include <limits>
#include <map>
#include <numbers>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Largest change of the spacing along any edge of any cell, per length.
template <int Dim> double steepest(const FineMesh<Dim>& mesh, const Vector& spacing) {
  double slope = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j < i; ++j) {
        const Index a = mesh.cells()(i, c), b = mesh.cells()(j, c);
        slope = std::max(slope, std::abs(spacing[a] - spacing[b]) / (mesh.vertex(a) - mesh.vertex(b)).norm());
      }
  return slope;
}

/// A square of side 4 with a hole in the middle.
FineMesh<2> plate_with_hole(double radius) {
  PlanarDomain domain = shapes::rectangle(-2, -2, 2, 2);
  domain.boundary.push_back(shapes::annulus(radius, 10.0, 0.05).boundary.front());
  domain.boundary.back().name = "hole";
  return triangulate(domain, {.size = 0.1});
}

/// [0, x] x [0, y] x [0, z] cut in n(0) x n(1) x n(2) boxes of six tetrahedra (Kuhn).
FineMesh<3> block(const Vec<3>& extent, const Eigen::Vector3i& n) {
  MeshData<3> data;
  const auto number = [&](int i, int j, int k) { return (k * (n[1] + 1) + j) * (n[0] + 1) + i; };
  data.vertices.resize(3, (n[0] + 1) * (n[1] + 1) * (n[2] + 1));
  data.cells.resize(4, 6 * n.prod());
  Index cell = 0;
  for (int k = 0; k <= n[2]; ++k)
    for (int j = 0; j <= n[1]; ++j)
      for (int i = 0; i <= n[0]; ++i) {
        data.vertices.col(number(i, j, k)) = extent.cwiseProduct(Vec<3>(i, j, k).cwiseQuotient(n.cast<double>()));
        if (i == n[0] || j == n[1] || k == n[2]) continue;
        std::array<int, 3> axes{0, 1, 2};
        do {
          Eigen::Vector3i at(i, j, k);
          data.cells(0, cell) = number(i, j, k);
          for (int step = 0; step < 3; ++step) {
            ++at[axes[step]];
            data.cells(step + 1, cell) = number(at[0], at[1], at[2]);
          }
          ++cell;
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
  return FineMesh<3>(data);
}

TEST(GradedSpacing, IsConstantUnlessAskedForMore) {
  const FineMesh<2> mesh = plate_with_hole(0.1);
  const Vector spacing = graded_spacing(mesh, 0.4, {});
  EXPECT_EQ(spacing, Vector::Constant(mesh.num_vertices(), 0.4));
}

TEST(GradedSpacing, GrowsNoFasterThanAskedAlongEveryEdge) {
  const auto mesh = triangulate(shapes::plate_with_random_holes(2.0, 30, 0.02, 0.2, 0.02, 1, 0.03), {.size = 0.03});
  for (const double growth : {0.1, 0.2, 0.5}) {
    const Vector spacing = graded_spacing(mesh, 0.3, {.features = true, .growth = growth});
    EXPECT_LE(steepest(mesh, spacing), growth * (1.0 + 1e-12));
    EXPECT_GE(steepest(mesh, spacing), growth * (1.0 - 1e-12)) << "the limit is reached somewhere";
    EXPECT_LE(spacing.maxCoeff(), 0.3);
    EXPECT_GT(spacing.minCoeff(), 0.0);
    EXPECT_LT(spacing.minCoeff(), 0.1);
  }
}

TEST(GradedSpacing, LimitOfGrowthIsADistanceFieldFromASinglePoint) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.05});
  Vector spacing = Vector::Constant(mesh.num_vertices(), 10.0);
  spacing[0] = 0.1;
  const Vector limited = limit_growth(mesh, spacing, 0.5);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const double distance = (mesh.vertex(v) - mesh.vertex(0)).norm();
    EXPECT_GE(limited[v], 0.1 + 0.5 * distance - 1e-12);
    EXPECT_LE(limited[v], 0.1 + 0.5 * 1.2 * distance + 1e-12) << "paths along edges make some way round";
  }
}

TEST(FeatureSize, OfAHoleIsItsDiameter) {
  const FineMesh<2> mesh = plate_with_hole(0.1);
  const Vector size = feature_size(mesh, 1.0);
  for (const Index f : mesh.group("hole")) EXPECT_NEAR(size[mesh.facets()(0, f)], 0.2, 0.03);
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (mesh.vertex(v).norm() > 0.11) {
      EXPECT_EQ(size[v], infinity) << "sides and right corners are no features";
    }
}

TEST(FeatureSize, OfAStripIsItsThickness) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 4, 0.3), {.size = 0.05});
  const Vector size = feature_size(mesh, 1.0);
  Index middle = 0, found = 0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (std::abs(mesh.vertex(v).x() - 2.0) > 1.0) continue;  // the ends are features too
    if (size[v] < infinity) {
      EXPECT_NEAR(size[v], 0.3, 0.03);
      ++found;
    }
    middle += std::abs(mesh.vertex(v).y() - 0.15) < 0.02;
  }
  EXPECT_GT(found, middle);
  const Vector small = feature_size(mesh, 0.25);
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (std::abs(mesh.vertex(v).x() - 2.0) < 1.0) {
      EXPECT_EQ(small[v], infinity) << "thicker than the largest asked for";
    }
}

TEST(FeatureSize, OfASheetOfTetrahedraIsItsThickness) {
  const auto mesh = block({2.0, 2.0, 0.25}, {16, 16, 4});
  const Vector size = feature_size(mesh, 0.5);
  Index found = 0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Vec<3> x = mesh.vertex(v);
    if (x.head<2>().minCoeff() < 0.5 || x.head<2>().maxCoeff() > 1.5 || size[v] == infinity) continue;
    EXPECT_NEAR(size[v], 0.25, 0.07);
    ++found;
  }
  EXPECT_GT(found, 50);
  const Vector spacing = graded_spacing(mesh, 0.5, {.features = true});
  EXPECT_LE(steepest(mesh, spacing), 0.2 * (1.0 + 1e-12));
  EXPECT_LT(spacing.minCoeff(), 0.3);
}

TEST(WallThickness, OfABlockIsExactlyThatOfItsSidesThoughWaysRunAlongEdges) {
  const auto mesh = block({2.0, 1.0, 0.25}, {16, 8, 2});
  const Vector thickness = wall_thickness(mesh);
  ASSERT_EQ(thickness.size(), mesh.num_facets());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const Vec<3> normal = mesh.facet_normal(f).cwiseAbs();
    EXPECT_NEAR(thickness[f], normal.dot(Vec<3>(2.0, 1.0, 0.25)), 1e-12);
  }
}

TEST(WallThickness, SidesOfASharpCornerAreNoWall) {
  MeshData<2> data;
  data.vertices.resize(2, 3);
  data.vertices << 0.0, 1.0, 0.0,  //
      0.0, 0.0, 1.0;
  data.cells.resize(3, 1);
  data.cells << 0, 1, 2;
  const Vector thickness = wall_thickness(FineMesh<2>(data));
  for (Index f = 0; f < 3; ++f) EXPECT_EQ(thickness[f], infinity);
}

TEST(FeatureSize, SidesOfASlitAreNoThinGapOnlyItsTipsAreFeatures) {
  const auto mesh = triangulate(shapes::slit_rectangle(-2, -2, 2, 2, {-1, 0}, {1, 0}), {.size = 0.1});
  const Vector size = feature_size(mesh, 0.5);
  for (const Index f : mesh.group("slit")) {
    const Index v = mesh.facets()(0, f);
    const double to_tip = 1.0 - std::abs(mesh.vertex(v).x());
    if (to_tip > 0.4) {
      EXPECT_EQ(size[v], infinity);
    }
    if (to_tip < 1e-9) {
      EXPECT_LT(size[v], 0.2);
    }
  }
}

TEST(GradedCloud, PutsNodesAroundASmallHole) {
  const FineMesh<2> mesh = plate_with_hole(0.06);
  const auto near = [&](const Vector& spacing) {
    const auto cloud = sample_cloud(mesh, spacing, 1);
    return (cloud.positions.colwise().norm().array() < 0.5).count();
  };
  const auto uniform = near(graded_spacing(mesh, 0.5, {})),
             graded = near(graded_spacing(mesh, 0.5, {.features = true}));
  EXPECT_LE(uniform, 7);
  EXPECT_GE(graded, 2 * uniform);
  EXPECT_LE(graded, 30);
}

TEST(GradedCloud, IsDenserInBoxesAndRegionsOnly) {
  MeshData<2> data;
  const auto plain = triangulate(shapes::rectangle(0, 0, 4, 1), {.size = 0.05});
  data.vertices = plain.vertices();
  data.cells = plain.cells();
  for (Index c = 0; c < plain.num_cells(); ++c) data.regions.push_back(plain.centroid(c).x() > 3.0);
  data.region_names = {"soft", "stiff"};
  const FineMesh<2> mesh(data);
  const Grading grading{.boxes = {{{0, 0, 0}, {0.5, 1, 0}, 0.1}, {{0, 0, 0}, {0.2, 0.2, 0}, 0.2}},
                        .regions = {{"stiff", 0.15}, {"soft", 0.6}}};
  const Vector spacing = graded_spacing(mesh, 0.4, grading);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const double x = mesh.vertex(v).x();
    if (x <= 0.5) {
      EXPECT_EQ(spacing[v], 0.1);
    }
    if (x > 0.5) {
      EXPECT_GT(spacing[v], 0.1);
    }
    if (x >= 3.05) {
      EXPECT_EQ(spacing[v], 0.15);
    }
    if (x > 2.0 && x < 2.2) {
      EXPECT_GT(spacing[v], 0.3);
    }
  }
  EXPECT_LE(steepest(mesh, spacing), 0.2 * (1.0 + 1e-12));
}

TEST(GradedCloud, GrowsFromNamedPartsOfTheBoundaryWithTheDistanceToThem) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 4, 1), {.size = 0.04});
  const Vector spacing = graded_spacing(mesh, 0.5, {.growth = 0.25, .boundaries = {{"left", 0.1}, {"right", 0.7}}});
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const double x = mesh.vertex(v).x(), wall = std::min(0.5, 0.1 + 0.25 * x);
    EXPECT_GE(spacing[v], wall - 1e-12);  // a path along edges is no shorter than the distance
    EXPECT_LE(spacing[v], wall + 0.25 * (0.2 * x + 0.02));
  }
  const auto cloud = sample_cloud(mesh, spacing, 1);
  const auto within = [&](double low, double high) {
    return (cloud.positions.row(0).array() >= low && cloud.positions.row(0).array() <= high).count();
  };
  EXPECT_GE(within(3.5, 4.0), 1);
  EXPECT_GE(within(0.0, 0.5), 5 * within(3.5, 4.0));
}

TEST(GradedCloud, GrowsAcrossInterfacesBetweenRegions) {
  const auto whole = triangulate(
      {.boundary = shapes::rectangle(0, 0, 2, 1).boundary, .embedded = {{"", {{1, 0}, {1, 1}}}}}, {.size = 0.05});
  MeshData<2> data;
  data.vertices = whole.vertices();
  data.cells = whole.cells();
  data.region_names = {"soft", "stiff"};
  for (Index c = 0; c < whole.num_cells(); ++c) data.regions.push_back(whole.centroid(c).x() > 1.0);
  const FineMesh<2> parted(cut_regions(data));
  ASSERT_GT(parted.num_vertices(), whole.num_vertices());
  const Grading grading{.boxes = {{{0, 0, 0}, {0.5, 1, 0}, 0.1}}};
  const Vector one = graded_spacing(whole, 0.6, grading), two = graded_spacing(parted, 0.6, grading);
  const auto at = [](const FineMesh<2>& mesh, const Vector& spacing) {
    std::map<std::pair<double, double>, double> by_place;
    for (Index v = 0; v < mesh.num_vertices(); ++v) by_place[{mesh.vertex(v).x(), mesh.vertex(v).y()}] = spacing[v];
    return by_place;
  };
  EXPECT_EQ(at(whole, one), at(parted, two));
  EXPECT_LT(two.maxCoeff(), 0.5);
}

TEST(GradedSpacing, RefusesWhatCannotBe) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.1});
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.0, {}), "expected a positive length");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.features = true, .growth = 0.0}), "growth is 0");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.least = 0.5}), "least is 0.5");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.boxes = {{{2, 2, 0}, {3, 3, 0}, 0.2}}}), "holds no vertex");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.boxes = {{{0, 0, 0}, {1, 1, 0}, -0.2}}}),
                     "the spacing of a box is -0.2");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.boxes = {{{0, 0, 0}, {1, 1, 0}, 0.01}}}),
                     "expected a finer mesh there");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.regions = {{"steel", 0.2}}}), "steel");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.boundaries = {{"wall", 0.2}}}), "wall");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.boundaries = {{"left", -0.2}}}), "the spacing of a boundary is -0.2");
  EXPECT_INPUT_ERROR(graded_spacing(mesh, 0.3, {.boundaries = {{"left", 0.01}}}),
                     "spacing 0.01 on boundary \"left\" is below the edges of the fine mesh");
  EXPECT_INPUT_ERROR(limit_growth(mesh, Vector::Ones(3), 0.2), "3 spacings");
}

}  // namespace
}  // namespace efree
