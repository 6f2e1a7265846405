// SPDX-License-Identifier: GPL-3.0-or-later
/// Load paths that leave their functions open: what is chosen, and how far it is from the truth.
#include "efree/analysis/analyse.hpp"
#include "efree/analysis/internal/facet_errors.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/mesh/walls.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using ::testing::AllOf, ::testing::Contains, ::testing::HasSubstr, ::testing::StartsWith;

MeshSource<2> rectangle(double x, double width, double height, double natural) {
  return {.mesh = [=](const MeshSize& size, const Stage&) {
    const double edge = size.length > 0.0 ? size.length : size.coarsening * natural;
    const FineMesh<2> mesh = triangulate(shapes::rectangle(x, 0.0, x + width, height), {.size = edge});
    return MadeMesh<2>{.mesh = extract(mesh, std::vector<char>(mesh.num_cells(), 1)), .size = edge};
  }};
}

/// A plate with holes as near to each other as a tenth of their radii and less.
MeshSource<2> plate_with_holes() {
  return {.mesh = [](const MeshSize& size, const Stage&) {
    const double edge = size.length > 0.0 ? size.length : size.coarsening * 0.2;
    CurvedMesh<2> curved = triangulate_curved(
        shapes::plate_with_random_holes(4.0, 12, 0.2, 0.5, 0.02, 1, edge, size.sagitta_or_natural()), {.size = edge});
    return MadeMesh<2>{.mesh = std::move(curved.mesh), .size = edge, .boundary = std::move(curved.boundary)};
  }};
}

/// A slice of a thick cylinder, radii 1 and 2, elastic and perfectly plastic, under internal pressure.
Settings<2> cylinder(double pressure) {
  return {.common = {.model = {.material = J2({.moduli = {.E = 210.0, .nu = 0.3}, .yield = 0.24}),
                               .plane = Plane::axisymmetric}},
          .supports = {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")},
          .loads = {.tractions = {efree::pressure<2>("left", [=](const Vec<2>&) { return pressure; })}},
          .probes = {{"outer", {2.0, 0.1}}},
          .time = TimeSettings<2>{.path = {.step = 0.25}}};
}

TEST(ThinWall, IsThatOfTheThinnestShareOfTheBoundaryAboveWalls) {
  const FineMesh<2> slab = triangulate(shapes::rectangle(0.0, 0.0, 8.0, 1.0), {.size = 0.3});
  EXPECT_NEAR(thin_wall(slab, 0.05), 1.0, 1e-12);
  EXPECT_NEAR(thin_wall(slab, 0.95), 8.0, 1e-12) << "along it";
}

TEST(ChosenPath, FirstCloudHasFourNodesAcrossTheWall) {
  const MeshSource<2> source = rectangle(0.0, 10.0, 1.0, 0.5);  // two edges across
  DisplacementCondition<2> right{"right", {}, {}};
  right.components[1] = [](const Vec<2>&) { return 1.0; };
  const Settings<2> settings{
      .common = {.model = {.material = NeoHookean({.E = 1.0, .nu = 0.3}), .plane = Plane::strain},
                 .approximation = {.support = 2.5}},
      .supports = {clamp<2>("left"), right},
      .time = TimeSettings<2>{.path = {.step = 0.5}}};  // of a cloud
  const Result<2> result = analyse(source, settings);
  ASSERT_FALSE(result.attempts.empty());
  EXPECT_LE(result.attempts.front().spacing, 0.25);
  EXPECT_GT(result.attempts.front().spacing, 0.2);
  EXPECT_LT(result.mesh->size(), 0.125) << "the mesh is as fine as its cloud needs";
  const FineMesh<2> fine = triangulate(shapes::rectangle(0.0, 0.0, 10.0, 1.0), {.size = 0.1});
  const Result<2> on_mesh = analyse(fine, settings);
  EXPECT_GT(on_mesh.approximation.nodes.cols(), 4 * 30) << "and on a mesh that is given";
}

TEST(ChosenPath, PlasticCylinderIsWithinOnePercentOfItsClosedForm) {
  // Outer displacement at p = 0.18 (Hill 1950, chapter V.2, with compressible elasticity): 0.15378 of radii 100, 200.
  const Result<2> result = analyse(rectangle(1.0, 1.0, 0.2, 0.05), cylinder(0.18));
  EXPECT_NEAR(result.probes.at(0).second.displacement[0], 1.5378e-3, 1.5378e-5);
  ASSERT_TRUE(result.path_errors);
  EXPECT_LT(result.path_errors->largest().first, 0.05);
  ASSERT_TRUE(result.path_errors->stress);
  EXPECT_LT(*result.path_errors->stress, 0.1);
  EXPECT_EQ(result.refusal, "");
}

TEST(ChosenPath, FacetsStayAsFineAsWallsNeedThemOnFinerMeshes) {
  DisplacementCondition<2> right{"right", {}, {}};
  right.components[0] = [](const Vec<2>&) { return 0.4; };
  const Settings<2> settings{
      .common = {.model = {.material = NeoHookean({.E = 1.0, .nu = 0.3}), .plane = Plane::strain}},
      .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), right},
      .reactions = {{"force", "right"}},
      .time = TimeSettings<2>{.path = {.step = 1.0}}};
  const Result<2> result = analyse(plate_with_holes(), settings);
  ASSERT_GT(result.attempts.size(), 1u);
  const double finer = result.attempts.back().size / result.attempts[1].size;  // than the first that may be the result
  EXPECT_LE(internal::largest_relative_sagitta(*result.mesh, result.offsets), 1.05 * default_sagitta * finer * finer);
  ASSERT_TRUE(result.path_errors);
  EXPECT_NEAR(result.path_errors->coarser, 1.5, 0.2) << "facets of the coarser mesh are coarser as its edges are";
}

TEST(ChosenPath, AMeshThatSaysItsSizeKeepsItAndIsComparedWithACoarserOne) {
  MeshSource<2> source = rectangle(1.0, 1.0, 0.2, 0.05);
  source.size = 0.05;
  const Result<2> result = analyse(source, cylinder(0.18));
  EXPECT_NEAR(result.mesh->size(), 0.05, 0.02);
  ASSERT_TRUE(result.path_errors);
  EXPECT_GT(result.path_errors->coarser, 1.15);
}

TEST(ChosenPath, SpecifiedElementsKeepTheirMeshAndHaveErrorsAgainstCoarserOnes) {
  Settings<2> settings = cylinder(0.18);
  settings.common.approximation.kind = BasisKind::p2;
  const MeshSource<2> source = rectangle(1.0, 1.0, 0.2, 0.05);
  const Result<2> result = analyse(source, settings);
  EXPECT_EQ(result.mesh->num_cells(), source.mesh({}, Stage("mesh", {})).mesh.cells.cols()) << "as it is natural";
  EXPECT_EQ(result.attempts.size(), 3u);
  ASSERT_TRUE(result.path_errors);
  EXPECT_NEAR(result.path_errors->coarser, 1.5, 0.2);
  EXPECT_LT(result.path_errors->space, 0.01);
  EXPECT_LT(result.path_errors->steps, 0.03) << "of four";
  EXPECT_EQ(result.refusal, "");
  settings.largest_error = 0.1 * result.path_errors->largest().first;
  const Result<2> refused = analyse(source, settings);
  EXPECT_THAT(refused.refusal, HasSubstr("off, judged by a coarser path"));
  EXPECT_EQ(refused.fields.displacement, result.fields.displacement) << "results are kept";
}

TEST(ChosenPath, ElementsOnCellsOfAFileWarnThatErrorsAreNotEstimated) {
  const MeshSource<2> rectangular = rectangle(1.0, 1.0, 0.2, 0.05);
  const MeshSource<2> cells{.mesh = [&](const MeshSize& size, const Stage& stage) {
    if (size.length > 0.0) throw InputError("cells have their size");
    MadeMesh<2> made = rectangular.mesh({}, stage);
    made.size = 0.0;
    return made;
  }};
  Settings<2> settings = cylinder(0.18);
  settings.common.approximation.kind = BasisKind::p2;
  const Result<2> result = analyse(cells, settings);
  EXPECT_EQ(result.attempts.size(), 1u) << "no coarser path";
  EXPECT_FALSE(result.path_errors || result.estimates);
  EXPECT_THAT(result.warnings, Contains(AllOf(StartsWith("displacements, forces and stresses may be off by any amount"),
                                              HasSubstr("not estimated"), HasSubstr("no coarser mesh"))));
  EXPECT_EQ(result.refusal, "");
}

/// A quarter of a perfectly plastic plate with a hole, in tension along an arc.
TEST(ChosenPath, APlateauIsWithinOnePercentOfTheLimitLoadAndSaysHowFar) {
  Settings<2> settings{
      .common = {.model = {.material = J2({.moduli = {.E = 1000.0, .nu = 0.3}, .yield = 1.0}), .plane = Plane::stress},
                 .approximation = {.kind = BasisKind::p2}},
      .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
      .loads = {.tractions = {pressure<2>("right", [](const Vec<2>&) { return -1.0; })}},
      .probes = {{"end", {2.0, 0.0}}},
      .time = TimeSettings<2>{.path = {.control = Control::arc_length, .end = 1.0, .step = 0.1}}};
  const FineMesh<2> mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 2.0, 0.3), {.size = 0.3});
  const Result<2> result = analyse(mesh, settings);
  EXPECT_THAT(result.stopped, AllOf(HasSubstr("limit load reached"), HasSubstr("[time] until = ")));
  const double limit = result.history.back().time;
  settings.time->until = PathEnd{.of = PathEnd::Of::probe, .name = "end", .component = 0, .above = 0.05};
  const Result<2> farther = analyse(mesh, settings);
  EXPECT_EQ(farther.stopped, "") << "on its plateau the path comes to the bound";
  EXPECT_GT(farther.history.back().probes[0][0], 0.05);
  EXPECT_NEAR(limit, farther.history.back().time, 0.01 * limit);
  settings.time->until = PathEnd{.of = PathEnd::Of::reaction, .name = "left", .component = 0, .below = -5.0};
  const Result<2> never = analyse(mesh, settings);
  EXPECT_EQ(never.history.size(), result.history.size());
  EXPECT_THAT(never.stopped, AllOf(HasSubstr("limit load reached"), HasSubstr("would not come to where")));
}

TEST(ChosenPath, ARunThatWasKilledGoesOnFromItsLastStepBitForBit) {
  const MeshSource<2> source = rectangle(1.0, 1.0, 0.2, 0.05);
  Settings<2> settings = cylinder(0.18);
  std::vector<Checkpoint<2>> all;
  settings.steps.done = [&](const Checkpoint<2>& there, const Result<2>&) { all.push_back(there); };
  const Result<2> whole = analyse(source, settings);
  ASSERT_GT(whole.attempts.size(), 1u);
  for (const std::size_t k : {std::size_t{1}, all.size() - 2}) {
    SCOPED_TRACE(k);
    settings.steps.from = all[k];
    int told = 0;
    settings.steps.done = [&](const Checkpoint<2>&, const Result<2>&) { ++told; };
    const Result<2> resumed = analyse(source, settings);
    EXPECT_EQ(told, static_cast<int>(all.size() - 1 - k)) << "no step again";
    EXPECT_EQ(resumed.fields.displacement, whole.fields.displacement);
    EXPECT_EQ(resumed.path_errors->work, whole.path_errors->work);
  }
  settings.steps.from->body += 1;
  EXPECT_THROW(analyse(source, settings), InputError);
}

}  // namespace
}  // namespace efree
