// SPDX-License-Identifier: GPL-3.0-or-later
/// The linear patch test in space.
#include "efree/geometry/input/surface.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"
#include "efree/tests/solvers/patch_tolerance.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

class SolidPatchTest : public ::testing::TestWithParam<std::tuple<std::string, SecondaryKind, Essential>> {};

TEST_P(SolidPatchTest, LinearFieldsAreExact) {
  const auto [name, secondary, essential] = GetParam();
  const auto mesh = testing::solid(name);
  const std::vector<std::string> inner =
      name == "slit_box" ? std::vector<std::string>{"slit"} : std::vector<std::string>{};
  for (std::uint64_t seed = 1; seed <= (secondary == SecondaryKind::cells ? 2 : 1); ++seed) {
    ApproximationOptions options{.spacing = 0.4, .seed = seed, .secondary = secondary};
    if (essential == Essential::strong) options.vanish_on = testing::box_sides;
    const auto approximation = approximate(mesh, options);
    std::vector<std::string> loaded(testing::box_sides.begin() + 1, testing::box_sides.end());
    loaded.insert(loaded.end(), inner.begin(), inner.end());
    for (const auto& field : testing::linear_fields<3>())
      for (const bool all : {true, false}) {
        const ElasticModel model{.material = LinearElastic(1.0, 0.3), .essential = essential};
        const auto error = all ? testing::patch_error<3>(approximation, model, field, testing::box_sides, inner)
                               : testing::patch_error<3>(approximation, model, field, {"left"}, loaded);
        EXPECT_LE(error.displacement, patch_tolerance)
            << field.name << (all ? ", held" : ", loaded") << ", cloud " << seed;
        EXPECT_LE(error.stress, patch_tolerance) << field.name << (all ? ", held" : ", loaded") << ", cloud " << seed;
        EXPECT_LE(error.recovered, patch_tolerance)
            << field.name << (all ? ", held" : ", loaded") << ", cloud " << seed;
      }
  }
}

INSTANTIATE_TEST_SUITE_P(Solids, SolidPatchTest,
                         ::testing::Combine(::testing::Values("box", "flat_cells", "slit_box"),
                                            ::testing::Values(SecondaryKind::cells, SecondaryKind::linear,
                                                              SecondaryKind::mls),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) + "_" +
                                  testing::name_of(std::get<1>(test.param)) +
                                  (std::get<2>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

TEST(SolidPatchTestBodies, FlatCellsAreAsFlatAsPromised) {
  EXPECT_LT(testing::smallest_dihedral_angle(testing::solid("flat_cells")), 0.6);
  EXPECT_GT(testing::smallest_dihedral_angle(testing::solid("box")), 10.0);
}

TEST(SolidPatchTestFiniteElements, LinearFieldsAreExact) {
  const auto mesh = testing::solid("slit_box");
  for (const auto kind : {BasisKind::p1, BasisKind::p2})
    for (const auto essential : {Essential::nitsche, Essential::strong}) {
      const auto approximation = approximate(mesh, {.kind = kind});
      for (const auto& field : testing::linear_fields<3>()) {
        const auto error =
            testing::patch_error<3>(approximation, {.material = LinearElastic(1.0, 0.3), .essential = essential}, field,
                                    {"left"}, {"right", "front", "back", "bottom", "top", "slit"});
        EXPECT_LE(error.displacement, patch_tolerance) << field.name;
        EXPECT_LE(error.stress, patch_tolerance) << field.name;
      }
    }
}

TEST(SolidPatchTestFiniteElements, LinearFieldsAreExactOnThePlateOfASurface) {
  // Regular points on its edges make a cell of four of one plane, in which P1 is singular: it must not be left.
  SurfaceSoup plate{Points<3>(3, 36), {}};
  Index point = 0;
  for (const auto& q : std::vector<std::array<Index, 4>>{
           {0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}})
    for (const std::array<Index, 3>& t : {std::array{q[0], q[1], q[2]}, std::array{q[0], q[2], q[3]}}) {
      plate.triangles.push_back({point, point + 1, point + 2});
      for (const Index corner : t) plate.points.col(point++) << 0.1 * (corner & 1), (corner >> 1) & 1, corner >> 2;
    }
  const FineMesh<3> mesh(mesh_surface(plate, {.size = 0.9}));
  const auto approximation = approximate(mesh, {.kind = BasisKind::p1});
  for (const auto& field : testing::linear_fields<3>()) {
    const auto error = testing::patch_error<3>(
        approximation, {.material = LinearElastic(1.0, 0.3), .essential = Essential::strong}, field, {"surface 1"},
        {"surface 2", "surface 3", "surface 4", "surface 5", "surface 6"});
    EXPECT_LE(error.displacement, patch_tolerance) << field.name;
    EXPECT_LE(error.stress, patch_tolerance) << field.name;
  }
}

}  // namespace
}  // namespace efree
