// SPDX-License-Identifier: GPL-3.0-or-later
/// Load paths that leave their functions open: what is chosen, and how far it is from the truth.
#include "efree/analysis/analyse.hpp"
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

using ::testing::Contains, ::testing::HasSubstr;

MeshSource<2> rectangle(double x, double width, double height, double natural) {
  return {.mesh = [=](const MeshSize& size, const Stage&) {
    const double edge = size.length > 0.0 ? size.length : size.coarsening * natural;
    const FineMesh<2> mesh = triangulate(shapes::rectangle(x, 0.0, x + width, height), {.size = edge});
    return MadeMesh<2>{.mesh = extract(mesh, std::vector<char>(mesh.num_cells(), 1)), .size = edge};
  }};
}

/// A slice of a thick cylinder, radii 1 and 2, elastic and perfectly plastic, under internal pressure.
Settings<2> cylinder(double pressure) {
  return {.model = {.material = J2({.moduli = {.E = 210.0, .nu = 0.3}, .yield = 0.24}), .plane = Plane::axisymmetric},
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
  const Settings<2> settings{.model = {.material = NeoHookean({.E = 1.0, .nu = 0.3}), .plane = Plane::strain},
                             .supports = {clamp<2>("left"), right},
                             .time = TimeSettings<2>{.path = {.step = 0.5}},
                             .approximation = {.support = 2.5}};  // of a cloud
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

TEST(ChosenPath, AMeshThatSaysItsSizeKeepsItAndIsComparedWithACoarserOne) {
  MeshSource<2> source = rectangle(1.0, 1.0, 0.2, 0.05);
  source.size = 0.05;
  const Result<2> result = analyse(source, cylinder(0.18));
  EXPECT_NEAR(result.mesh->size(), 0.05, 0.02);
  ASSERT_TRUE(result.path_errors);
  EXPECT_GT(result.path_errors->coarser, 1.15);
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
