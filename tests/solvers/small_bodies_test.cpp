// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that a cloud passes by: specks of a few cells, islands of a label, shavings.
#include "efree/bench/noise.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"

#include <gtest/gtest.h>
#include <utility>

namespace efree {
namespace {

/// Bodies next to each other: vertices and cells of all, no groups.
template <int Dim> MeshData<Dim> together(const std::vector<MeshData<Dim>>& bodies) {
  MeshData<Dim> all;
  for (const auto& body : bodies) {
    const Index vertices = static_cast<Index>(all.vertices.cols()), cells = static_cast<Index>(all.cells.cols());
    all.vertices.conservativeResize(Dim, vertices + body.vertices.cols());
    all.vertices.rightCols(body.vertices.cols()) = body.vertices;
    all.cells.conservativeResize(Dim + 1, cells + body.cells.cols());
    all.cells.rightCols(body.cells.cols()) = body.cells.array() + vertices;
  }
  return all;
}
/// All of the boundary as the part "all".
template <int Dim> FineMesh<Dim> with_boundary(const MeshData<Dim>& data) {
  FineMesh<Dim> mesh(data);
  std::vector<Index> facets(mesh.num_facets());
  std::iota(facets.begin(), facets.end(), 0);
  return std::move(mesh).with_groups({{"all", facets}});
}

/// A square with a triangle, two triangles, and a square of 18 triangles beside it.
FineMesh<2> square_with_specks() {
  const auto of = [](const FineMesh<2>& mesh) { return MeshData<2>{mesh.vertices(), mesh.cells(), {}}; };
  MeshData<2> one{Points<2>(2, 3), Cells<2>(3, 1), {}}, two{Points<2>(2, 4), Cells<2>(3, 2), {}};
  one.vertices << 1.1, 1.2, 1.1, 0.0, 0.0, 0.05;
  one.cells << 0, 1, 2;
  two.vertices << 1.1, 1.2, 1.2, 1.1, 0.3, 0.3, 0.4, 0.4;
  two.cells << 0, 0, 1, 2, 2, 3;
  return with_boundary(together<2>({of(triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.08})), one, two,
                                    of(triangulate(shapes::rectangle(1.1, 0.6, 1.25, 0.75), {.size = 0.08}))}));
}
/// A cube with a tetrahedron, a cube of six, and a cube of 48 beside it.
FineMesh<3> cube_with_specks() {
  const auto speck = [](MeshData<3> body, double size, const Vec<3>& at) {
    body.vertices = (size * body.vertices).colwise() + at;
    return body;
  };
  MeshData<3> one{Points<3>(3, 4), Cells<3>(4, 1), {}};
  one.vertices << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1;
  one.cells << 0, 1, 2, 3;
  return with_boundary(
      together<3>({testing::box(6), speck(one, 0.1, {1.1, 0, 0}), speck(testing::box(1), 0.15, {1.1, 0.5, 0}),
                   speck(testing::box(2), 0.2, {1.1, 0.5, 0.5})}));
}

template <int Dim> void expect_linear_fields_exact(const FineMesh<Dim>& mesh, ApproximationOptions options) {
  for (const auto essential : {Essential::nitsche, Essential::strong}) {
    options.vanish_on = essential == Essential::strong ? std::vector<std::string>{"all"} : std::vector<std::string>{};
    const auto approximation = approximate(mesh, options);
    EXPECT_GE(approximation.small_bodies, 2);
    const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = essential};
    for (const auto& field : testing::linear_fields<Dim>()) {
      const auto error = testing::patch_error<Dim>(approximation, model, field, {"all"}, {});
      EXPECT_LE(error.displacement, 1e-11) << field.name;
      EXPECT_LE(error.stress, 1e-10) << field.name;
      EXPECT_LE(error.recovered, 1e-10) << field.name;
    }
  }
}

TEST(SmallBodies, LinearFieldsAreExactOnSpecksInThePlane) {
  const FineMesh<2> mesh = square_with_specks();
  for (const int order : {1, 2})
    for (const int interpolation : {1, 2})
      for (const auto secondary : {SecondaryKind::cells, SecondaryKind::full})
        expect_linear_fields_exact<2>(
            mesh, {.order = order, .interpolation = interpolation, .spacing = 0.3, .secondary = secondary});
}
TEST(SmallBodies, LinearFieldsAreExactOnSpecksInSpace) {
  const FineMesh<3> mesh = cube_with_specks();
  for (const int order : {1, 2})
    expect_linear_fields_exact<3>(mesh, {.order = order, .interpolation = 1, .spacing = 0.45});
}
TEST(SmallBodies, LinearFieldsAreExactOnSpecksWithDilatationAveraged) {
  expect_linear_fields_exact<2>(square_with_specks(), {.spacing = 0.3, .dilatation = Dilatation::averaged});
  expect_linear_fields_exact<3>(cube_with_specks(), {.spacing = 0.45, .dilatation = Dilatation::averaged});
}

/// On specks alone the functions are those of finite elements, and so is the answer.
TEST(SmallBodies, SpecksHeldAndBentAreFiniteElements) {
  MeshData<3> data = testing::box(1);
  data.vertices *= 0.1;
  const FineMesh<3> mesh = with_boundary(together<3>({data}));
  const auto cloud = approximate<3>(mesh, {.spacing = 0.15});
  EXPECT_EQ(cloud.small_bodies, 1);
  EXPECT_EQ(cloud.mls.own_functions, mesh.num_vertices());
  const auto elements = approximate<3>(mesh, {.kind = BasisKind::p1});
  const DisplacementCondition<3> bent = testing::displacement<3>("all", [](const Vec<3>& x) -> Vec<3> {
    return {x[1] * x[2], 0.0, x[0] * x[0]};
  });
  const ElasticModel model{.material = LinearElastic(1.0, 0.3)};
  const auto of_cloud = ElasticSolver<3>(cloud, model, {bent}).solve({}),
             of_elements = ElasticSolver<3>(elements, model, {bent}).solve({});
  EXPECT_NEAR(of_cloud.strain_energy, of_elements.strain_energy, 1e-12 * of_elements.strain_energy);
}

/// Three labels that are noise: islands of a voxel, shells around them. The same linear field in all.
TEST(SmallBodies, LinearFieldsAreExactOnIslandsOfNoisyLabels) {
  const auto made = mesh_image(bench::noise_of_three_labels(6, 0, 1), {.size = 1.0});
  const FineMesh<3> mesh(cut_regions(made));
  std::vector<std::string> sides = testing::box_sides;
  const auto approximation = approximate<3>(mesh, {.spacing = 3.0});
  EXPECT_GE(approximation.small_bodies, 2);
  for (const auto& field : testing::linear_fields<3>()) {
    const auto error = testing::patch_error<3>(approximation, {.material = LinearElastic(1.0, 0.3)}, field, sides, {});
    EXPECT_LE(error.displacement, 1e-10) << field.name;
    EXPECT_LE(error.stress, 1e-10 * 1e3) << field.name;  // cells are as flat as a thousandth
  }
}

/// The same with moduli of 1, 10, 100: corrections end at the elements, P1 fully solved on the mesh in one piece.
TEST(SmallBodies, CorrectionsOnNoisyLabelsEndAtTheFiniteElements) {
  for (const int passes : {0, 1}) {
    const auto made = mesh_image(bench::noise_of_three_labels(8, passes, 1), {.size = 1.0});
    const FineMesh<3> whole(made), parted(cut_regions(made));
    ElasticModel model;
    model.regions = {LinearElastic(1.0, 0.3), LinearElastic(10.0, 0.3), LinearElastic(100.0, 0.3)};
    const std::vector<DisplacementCondition<3>> supports = bench::pulled({.size = {8, 8, 8}}, 1.0, {1.0}).supports;
    const auto cloud = approximate<3>(parted, {.spacing = 3.0});
    const auto solution = ElasticSolver<3>(cloud, model, supports).solve({});
    const auto corrected = Corrector<3>(cloud, model, supports)
                               .correct(interpolate(cloud.shape, solution.coefficients), {}, {.tolerance = 1e-6});
    model.essential = Essential::strong;
    const auto elements = approximate<3>(whole, {.kind = BasisKind::p1});
    const double truth = ElasticSolver<3>(elements, model, supports).solve({}).strain_energy;
    EXPECT_NEAR(corrected.strain_energy, truth, 1e-9 * truth) << passes;
    EXPECT_LE(corrected.iterations, 40) << passes;
  }
}

}  // namespace
}  // namespace efree
