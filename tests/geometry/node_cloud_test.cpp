// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cloud/node_cloud.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/tests/solids.hpp"
#include "meshes.hpp"

#include <algorithm>
#include <set>

namespace efree {
namespace {

/// Vertices a node covers: closer than its spacing, joined to it by edges inside that ball.
std::set<Index> covered_by(const FineMesh<2>& mesh, Index node, double spacing) {
  std::set<Index> covered{node};
  std::vector<Index> stack{node};
  while (!stack.empty()) {
    const Index v = stack.back();
    stack.pop_back();
    for (const Index c : mesh.cells_of(v))
      for (const Index w : mesh.cells().col(c))
        if ((mesh.vertex(w) - mesh.vertex(node)).norm() < spacing && covered.insert(w).second) stack.push_back(w);
  }
  return covered;
}

/// Every vertex is covered; nodes cover each other only on the boundary.
void expect_maximal_packing(const FineMesh<2>& mesh, const NodeCloud<2>& cloud) {
  const std::set<Index> nodes(cloud.vertices.begin(), cloud.vertices.end());
  ASSERT_EQ(static_cast<Index>(nodes.size()), cloud.size());
  EXPECT_TRUE(std::is_sorted(cloud.vertices.begin(), cloud.vertices.end()));
  std::vector<char> covered(mesh.num_vertices(), 0);
  std::set<std::pair<Index, Index>> seen;  // (node, another that it covers)
  for (Index i = 0; i < cloud.size(); ++i) {
    EXPECT_EQ(cloud.positions.col(i), mesh.vertices().col(cloud.vertices[i]));
    for (const Index v : covered_by(mesh, cloud.vertices[i], cloud.spacing[i])) {
      covered[v] = 1;
      if (v != cloud.vertices[i] && nodes.contains(v)) seen.insert({cloud.vertices[i], v});
    }
  }
  EXPECT_EQ(std::count(covered.begin(), covered.end(), 0), 0);
  for (const auto& [a, b] : seen)
    EXPECT_FALSE(!(mesh.on_boundary(a) && mesh.on_boundary(b)) && seen.contains({b, a}))
        << "nodes at vertices " << a << " and " << b << " cover each other";
}

bool has_node_at(const NodeCloud<2>& cloud, const Vec<2>& p) {
  return std::any_of(cloud.positions.colwise().begin(), cloud.positions.colwise().end(),
                     [&](const auto& x) { return x == p; });
}

TEST(NodeCloud, IsAMaximalPacking) {
  for (const PlanarDomain& domain :
       {shapes::rectangle(0.0, 0.0, 2.0, 1.0), shapes::quarter_plate_with_hole(0.5, 2.0, 0.03), shapes::l_shape(1.5),
        shapes::annulus(0.2, 1.0, 0.03), shapes::slit_rectangle(0.0, 0.0, 2.0, 1.0, {0.5, 0.3}, {1.3, 0.6}),
        shapes::plate_with_random_holes(2.0, 30, 0.02, 0.2, 0.02, 1, 0.03)}) {
    const FineMesh<2> mesh = triangulate(domain, {.size = 0.03});
    for (const std::uint64_t seed : {1, 2, 3})
      expect_maximal_packing(mesh, sample_cloud<2>(mesh, {.spacing = 0.2, .seed = seed}));
  }
}

TEST(NodeCloud, VaryingSpacingIsAMaximalPackingToo) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.02});
  const Vector spacing = 0.06 + 0.1 * mesh.vertices().row(0).transpose().array();
  const NodeCloud<2> cloud = sample_cloud<2>(mesh, spacing, 1);
  expect_maximal_packing(mesh, cloud);
  EXPECT_EQ(cloud.spacing, Vector(spacing(cloud.vertices)));
  const Index left = static_cast<Index>((cloud.positions.row(0).array() < 1.0).count());
  EXPECT_GT(left, 2 * (cloud.size() - left));
}

TEST(NodeCloud, IsReproducibleAndDependsOnTheSeed) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.03});
  const auto nodes = [&](std::uint64_t seed) {
    return sample_cloud<2>(mesh, {.spacing = 0.15, .seed = seed}).vertices;
  };
  EXPECT_EQ(nodes(1), nodes(1));
  EXPECT_NE(nodes(1), nodes(2));
}

TEST(NodeCloud, KeepsCornersTipsAndEndsOfGroups) {
  PlanarDomain domain = shapes::l_shape(1.0);
  domain.embedded = {{"foot", {{0.31, 0.0}, {0.47, 0.0}}}};
  domain.slits = {{"slit", {{0.2, 0.7}, {0.3, 0.8}}}};
  const NodeCloud<2> cloud = sample_cloud<2>(triangulate(domain, {.size = 0.03}), {.spacing = 0.3});
  for (const Polyline& side : domain.boundary)
    EXPECT_TRUE(has_node_at(cloud, side.points[0])) << side.points[0].transpose();
  for (const Polyline& chain : {domain.embedded[0], domain.slits[0]})
    for (const Vec<2>& end : chain.points) EXPECT_TRUE(has_node_at(cloud, end)) << end.transpose();
}

TEST(NodeCloud, IsUniformOnTheBoundary) {
  const double h = 0.01, spacing = 0.13;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = h});
  const NodeCloud<2> cloud = sample_cloud<2>(mesh, {.spacing = spacing});
  std::vector<double> bottom;
  for (Index i = 0; i < cloud.size(); ++i)
    if (cloud.positions(1, i) == 0.0) bottom.push_back(cloud.positions(0, i));
  std::sort(bottom.begin(), bottom.end());
  ASSERT_EQ(bottom.size(), 9u);  // ceil(1 / 0.13) = 8 intervals
  for (std::size_t k = 0; k < bottom.size(); ++k) EXPECT_NEAR(bottom[k], k / 8.0, 0.5 * h * (1.0 + 1e-12));
}

TEST(NodeCloud, BothSidesOfASlitHaveNodes) {
  const FineMesh<2> mesh =
      triangulate(shapes::slit_rectangle(0.0, 0.0, 2.0, 1.0, {0.5, 0.5}, {1.5, 0.5}), {.size = 0.03});
  for (const double spacing : {0.1, 0.4, 3.0}) {
    const NodeCloud<2> cloud = sample_cloud<2>(mesh, {.spacing = spacing});
    std::set<Index> above, below;
    for (const Index f : mesh.group("slit"))
      for (const Index v : mesh.facets().col(f))
        if (std::binary_search(cloud.vertices.begin(), cloud.vertices.end(), v))
          (mesh.facet_normal(f).y() < 0.0 ? above : below).insert(v);
    const std::size_t intervals = std::max(2.0, std::ceil(1.0 / spacing));
    EXPECT_EQ(above.size(), intervals + 1);
    EXPECT_EQ(below.size(), intervals + 1);
    EXPECT_EQ(cloud.vertices.size(), std::set<Index>(cloud.vertices.begin(), cloud.vertices.end()).size());
  }
}

TEST(NodeCloud, SmallHolesHaveThreeNodes) {
  const PlanarDomain domain = shapes::plate_with_random_holes(2.0, 20, 0.03, 0.08, 0.02, 5, 0.02);
  const FineMesh<2> mesh = triangulate(domain, {.size = 0.02});
  const NodeCloud<2> cloud = sample_cloud<2>(mesh, {.spacing = 0.4});
  for (const Polyline& chain : domain.boundary) {
    if (chain.name != "holes") continue;
    Vec<2> centre = Vec<2>::Zero();
    for (std::size_t k = 1; k < chain.points.size(); ++k)
      centre += chain.points[k] / static_cast<double>(chain.points.size() - 1);
    const double radius = (chain.points[0] - centre).norm();
    const auto nodes = ((cloud.positions.colwise() - centre).colwise().norm().array() < radius * (1.0 + 1e-9)).count();
    EXPECT_EQ(nodes, std::max(3.0, std::ceil(6.2 * radius / 0.4)));
  }
}

TEST(NodeCloud, WholeBodiesGetNodesEvenIfSmallerThanTheSpacing) {
  PlanarDomain domain = shapes::rectangle(0.0, 0.0, 1.0, 1.0);
  const PlanarDomain crumb = shapes::rectangle(1.05, 0.4, 1.1, 0.45);
  domain.boundary.insert(domain.boundary.end(), crumb.boundary.begin(), crumb.boundary.end());
  const FineMesh<2> mesh = triangulate(domain, {.size = 0.02});
  const NodeCloud<2> cloud = sample_cloud<2>(mesh, {.spacing = 0.3});
  EXPECT_EQ((cloud.positions.row(0).array() > 1.01).count(), 4);
}

TEST(NodeCloud, RefusesSpacingsThatAreNotPositive) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.3});
  EXPECT_INPUT_ERROR(sample_cloud<2>(mesh, CloudOptions{}), "spacing is 0, expected a positive length");
  EXPECT_INPUT_ERROR(sample_cloud<2>(mesh, {.spacing = std::nan("")}), "spacing is nan");
  Vector spacing = Vector::Constant(mesh.num_vertices(), 0.5);
  spacing[0] = -1.0;
  EXPECT_INPUT_ERROR(sample_cloud<2>(mesh, spacing, 1), "is -1, expected a positive length");
  EXPECT_INPUT_ERROR(sample_cloud<2>(mesh, Vector::Ones(2), 1), "2 spacings for");
}

TEST(SolidCloud, CoversTheBodyAndKeepsItsDistances) {
  const FineMesh<3> mesh = testing::slit_box(10);
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto cloud = sample_cloud(mesh, CloudOptions{0.3, seed});
    ASSERT_TRUE(std::is_sorted(cloud.vertices.begin(), cloud.vertices.end()));
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      double nearest = 1e300;
      for (Index I = 0; I < cloud.size(); ++I)
        nearest = std::min(nearest, (cloud.positions.col(I) - mesh.vertex(v)).norm());
      EXPECT_LT(nearest, 0.3);
    }
    // Closer pairs look at each other through the slit.
    const auto beside = [&](Index I) { return cloud.positions(0, I) - 0.5; };
    for (Index I = 0; I < cloud.size(); ++I)
      for (Index J = 0; J < I; ++J)
        if ((cloud.positions.col(I) - cloud.positions.col(J)).norm() < 0.3) {
          EXPECT_LE(beside(I) * beside(J), 0.0) << "nodes " << I << " and " << J;
        }
    for (const double x : {0.0, 1.0})
      for (const double y : {0.0, 1.0})
        for (const double z : {0.0, 1.0})
          EXPECT_EQ((cloud.positions.colwise() - Vec<3>(x, y, z)).colwise().norm().minCoeff(), 0.0) << "corner";
  }
}

TEST(SolidCloud, SpacingMayVary) {
  const FineMesh<3> mesh = testing::with_sides(testing::box(12));
  Vector spacing(mesh.num_vertices());
  for (Index v = 0; v < mesh.num_vertices(); ++v) spacing[v] = mesh.vertex(v).x() < 0.5 ? 0.15 : 0.4;
  const auto cloud = sample_cloud<3>(mesh, spacing, 1);
  const Index left = static_cast<Index>((cloud.positions.row(0).array() < 0.5).count());
  EXPECT_GT(left, 4 * (cloud.size() - left));
}

}  // namespace
}  // namespace efree
