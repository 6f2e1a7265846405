// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/mls.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// Largest error at any fine vertex with which the table reproduces the monomials up to the order (body of size 1).
double reproduction_error(const Points<2>& points, const Points<2>& nodes, const ShapeTable<2>& shape, int order) {
  const auto monomials = [&](const Points<2>& x) {
    Matrix g(order == 1 ? 3 : 6, x.cols());
    g.row(0).setOnes();
    g.middleRows(1, 2) = x;
    if (order == 2) g.bottomRows(3) << x.row(0).cwiseAbs2(), x.row(0).cwiseProduct(x.row(1)), x.row(1).cwiseAbs2();
    return g;
  };
  return (interpolate(shape, monomials(nodes)) - monomials(points)).cwiseAbs().maxCoeff();
}
double reproduction_error(const FineMesh<2>& mesh, const Points<2>& nodes, const ShapeTable<2>& shape, int order) {
  return reproduction_error(mesh.vertices(), nodes, shape, order);
}

class MlsOn : public ::testing::TestWithParam<std::tuple<std::string, int>> {};

TEST_P(MlsOn, ReproducesPolynomialsAtEveryFineVertex) {
  const auto [name, order] = GetParam();
  const auto body = testing::body(name);
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto cloud = sample_cloud(body.mesh, CloudOptions{body.spacing, seed});
    const auto mls = moving_least_squares(body.mesh, cloud, {.order = order, .support = order + 1.0});
    EXPECT_LT(reproduction_error(body.mesh, cloud.positions, mls.shape, order), 1e-12);
    EXPECT_LT(mls.report.largest_sum, 5.0);
  }
}

TEST_P(MlsOn, ReproducesPolynomialsWhereItVanishesOnTheOuterBoundary) {
  const auto [name, order] = GetParam();
  const auto body = testing::body(name);
  const auto cloud = sample_cloud(body.mesh, CloudOptions{body.spacing, 1});
  const auto mls =
      moving_least_squares(body.mesh, cloud, {.order = order, .support = order + 1.0, .vanish_on = body.outer});
  EXPECT_LT(reproduction_error(body.mesh, cloud.positions, mls.shape, order), 1e-12);
  for (const auto& part : body.outer) {
    std::vector<char> on_part(body.mesh.num_vertices(), 0);
    for (Index f : body.mesh.group(part))
      for (int k = 0; k < 2; ++k) on_part[body.mesh.facets()(k, f)] = 1;
    Index intruders = 0;
    for (Index v = 0; v < body.mesh.num_vertices(); ++v)
      for (Index I : mls.shape.row(v).nodes) intruders += on_part[v] && !on_part[cloud.vertices[I]];
    EXPECT_EQ(intruders, 0) << "nodes off \"" << part << "\" act on it";
  }
}

TEST_P(MlsOn, ReproducesPolynomialsAtEdgeMidpointsToo) {
  const auto [name, order] = GetParam();
  const auto body = testing::body(name);
  const FineSpace<2> space(body.mesh, 2);
  const auto cloud = sample_cloud(body.mesh, CloudOptions{body.spacing, 1});
  for (const auto& parts : {std::vector<std::string>{}, body.outer}) {
    const auto mls = moving_least_squares(space, cloud, {.order = order, .support = order + 1.0, .vanish_on = parts});
    ASSERT_EQ(mls.shape.num_points(), space.size());
    EXPECT_LT(reproduction_error(space.points(), cloud.positions, mls.shape, order), 1e-12);
  }
}

INSTANTIATE_TEST_SUITE_P(Bodies, MlsOn,
                         ::testing::Combine(::testing::Values("square", "slivers", "plate_with_hole", "l_shape", "slit",
                                                              "random_holes"),
                                            ::testing::Values(1, 2)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) + "_order_" +
                                  std::to_string(std::get<1>(test.param));
                         });

TEST(Mls, AtMidpointsIsWhatAMeshWithVerticesThereGives) {
  // Every triangle cut in four: the midpoints of the coarse mesh are vertices of the fine one.
  const auto mesh = triangulate(shapes::slit_rectangle(0, 0, 1, 1, {0.4, 0.0}, {0.6, 0.6}), {.size = 0.1});
  const FineSpace<2> space(mesh, 2);
  MeshData<2> data{space.points(), {}, {}};
  data.cells.resize(3, 4 * mesh.num_cells());
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto dofs = space.cell(c);  // vertices 0 1 2, midpoints of 01 02 12
    const int parts[4][3] = {{0, 3, 4}, {1, 5, 3}, {2, 4, 5}, {3, 5, 4}};
    for (int k = 0; k < 4; ++k)
      for (int i = 0; i < 3; ++i) data.cells(i, 4 * c + k) = dofs[parts[k][i]];
  }
  const FineMesh<2> cut(data);
  const auto cloud = sample_cloud(mesh, CloudOptions{0.25, 1});
  const auto at_midpoints = moving_least_squares(space, cloud, {}), at_vertices = moving_least_squares(cut, cloud, {});
  const Matrix difference = Matrix(at_midpoints.shape.matrix()) - Matrix(at_vertices.shape.matrix());
  EXPECT_LT(difference.topRows(mesh.num_vertices()).cwiseAbs().maxCoeff(), 1e-12);
  // Exact where paths are straight; where they bend around the tip the median formula is off by O(h^2).
  EXPECT_LT(difference.cwiseAbs().maxCoeff(), 0.05);
  EXPECT_LT(difference.norm() / at_vertices.shape.matrix().norm(), 0.003);
}

TEST(Mls, HeatFlowHasNoDistancesForMidpoints) {
  const auto body = testing::body("square");
  const auto cloud = sample_cloud(body.mesh, CloudOptions{body.spacing, 1});
  EXPECT_THAT(
      [&] { moving_least_squares(FineSpace<2>(body.mesh, 2), cloud, {.weights = {.weight = Weight::heat_flow}}); },
      ThrowsMessage<InputError>(HasSubstr("use degree 1")));
}

TEST(Mls, EveryWeightGivesABasis) {
  const auto body = testing::body("slit");
  const auto cloud = sample_cloud(body.mesh, CloudOptions{body.spacing, 1});
  for (const Weight weight :
       {Weight::heat_geodesic, Weight::heat_flow, Weight::fast_marching, Weight::visibility, Weight::euclidean}) {
    const auto mls = moving_least_squares(body.mesh, cloud, {.support = 2.5, .weights = {.weight = weight}});
    EXPECT_LT(reproduction_error(body.mesh, cloud.positions, mls.shape, 1), 1e-12)
        << "weight " << static_cast<int>(weight);
  }
}

TEST(Mls, ThinLigamentsGrowSupportsAndSaySo) {
  PlanarDomain domain = shapes::rectangle(0, 0, 4, 2);
  for (const double x : {1.485, 2.515}) {  // two holes of radius 0.5 that leave 0.03
    Polyline hole{"holes", {}};
    for (int k = 0; k <= 64; ++k) {
      const double t = 2.0 * std::numbers::pi * (k % 64) / 64.0;
      hole.points.push_back({x + 0.5 * std::cos(t), 1.0 + 0.5 * std::sin(t)});
    }
    domain.boundary.push_back(hole);
  }
  const auto mesh = triangulate(domain, {.size = 0.04});
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto cloud = sample_cloud(mesh, CloudOptions{0.2, seed});
    const auto mls = moving_least_squares(mesh, cloud, {.support = 1.25});
    EXPECT_GT(mls.report.grown_vertices, 0);
    EXPECT_GT(mls.report.grown_nodes, 0);
    EXPECT_GT(mls.report.largest_growth, 1.0);
    EXPECT_LE(mls.report.largest_sum, 5.0);
    EXPECT_LT(reproduction_error(mesh, cloud.positions, mls.shape, 1), 1e-12);
    EXPECT_LE(moving_least_squares(mesh, cloud, {.support = 2.5}).report.largest_sum, 5.0);
  }
}

TEST(Mls, StripThinnerThanTheSpacingHasALinearBasisAndElementsWhereNodesDetermineNoQuadraticOne) {
  // All nodes lie on the two long sides, so no function of them is quadratic across the strip.
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 0.04), {.size = 0.02});
  const auto cloud = sample_cloud(mesh, CloudOptions{0.2, 1});
  const auto mls = moving_least_squares(mesh, cloud, {});
  EXPECT_LT(reproduction_error(mesh, cloud.positions, mls.shape, 1), 1e-12);
  EXPECT_LE(mls.report.largest_sum, 5.0);
  EXPECT_EQ(mls.report.own_functions, 0);
  const auto quadratic = moving_least_squares(mesh, cloud, {.order = 2});
  EXPECT_LT(reproduction_error(mesh, mesh.vertices()(Eigen::all, quadratic.node_dofs), quadratic.shape, 2), 1e-12);
  EXPECT_GT(quadratic.report.own_functions, 0);
  EXPECT_EQ(static_cast<Index>(quadratic.node_dofs.size()), cloud.size() + quadratic.report.own_functions);
}

TEST(Mls, DisconnectedBodiesDoNotSeeEachOther) {
  PlanarDomain domain = shapes::rectangle(0, 0, 1, 1);
  domain.boundary.push_back({"other", {{1.05, 0}, {2, 0}, {2, 1}, {1.05, 1}, {1.05, 0}}});
  const auto mesh = triangulate(domain, {.size = 0.05});
  ASSERT_EQ(mesh.num_components(), 2);
  const auto cloud = sample_cloud(mesh, CloudOptions{0.25, 1});
  const auto mls = moving_least_squares(mesh, cloud, {});
  EXPECT_LT(reproduction_error(mesh, cloud.positions, mls.shape, 1), 1e-12);
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    for (Index I : mls.shape.row(v).nodes) ASSERT_EQ(mesh.component()[v], mesh.component()[cloud.vertices[I]]);
}

TEST(Mls, BodyWithTooFewNodesGetsFunctionsOfItsOwnVertices) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.5});
  NodeCloud<2> cloud{{0, 1}, mesh.vertices().leftCols(2), Vector::Constant(2, 0.5)};
  const auto mls = moving_least_squares(mesh, cloud, {});
  EXPECT_GT(mls.report.own_functions, 0);
  EXPECT_LT(reproduction_error(mesh, mesh.vertices()(Eigen::all, mls.node_dofs), mls.shape, 1), 1e-12);
}

TEST(Mls, OptionsOutOfRangeAreRefused) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.5});
  const auto cloud = sample_cloud(mesh, CloudOptions{0.5, 1});
  EXPECT_THAT([&] { moving_least_squares(mesh, cloud, {.order = 3}); },
              ThrowsMessage<InputError>(HasSubstr("order 3")));
  EXPECT_THAT([&] { moving_least_squares(mesh, cloud, {.support = 0.1}); },
              ThrowsMessage<InputError>(HasSubstr("support = 0.1")));
  EXPECT_THAT([&] { moving_least_squares(mesh, cloud, {.vanish_on = {"nowhere"}}); },
              ThrowsMessage<InputError>(HasSubstr("nowhere")));
}

}  // namespace
}  // namespace efree
