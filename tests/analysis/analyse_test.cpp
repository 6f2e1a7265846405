// SPDX-License-Identifier: GPL-3.0-or-later
/// From settings to results without a case file.
#include "efree/analysis/analyse.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using ::testing::Contains, ::testing::ElementsAre, ::testing::HasSubstr, ::testing::StartsWith;

/// A quarter of a plate with a hole, pulled along x.
MeshSource<2> plate(double size = 0.0) {
  return {.mesh =
              [](const MeshSize& wanted, const Stage&) {
                const double length = wanted.length > 0.0 ? wanted.length : 0.4 * wanted.coarsening;
                const auto domain = shapes::quarter_plate_with_hole(1.0, 4.0, std::min(length, 0.2));
                return MadeMesh<2>{.mesh = triangulate_data(domain, {.size = length}), .size = length};
              },
          .size = size};
}

Settings<2> pulled() {
  return {.common = {.model = {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}},
          .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          .loads = {.tractions = {tension<2>("right", 1.0)}, .body_force = {}},
          .probes = {{"top of the hole", {0.0, 1.0}}}};
}

template <class Error = InputError, class Work> std::string complaint(const Work& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(Analyse, AnswersOnAMeshWithTheErrorOfTheAnswer) {
  const auto mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, 0.05), {.size = 0.1});
  const Result<2> result = analyse(mesh, pulled());
  ASSERT_TRUE(result.estimates);
  EXPECT_GT(result.estimates->corrections, 0);
  EXPECT_LT(result.estimates->total(), 0.05);
  // Howland (1930), a strip twice as wide: 3.1 to 3.3 of the tension far away.
  ASSERT_EQ(result.probes.size(), 1u);
  EXPECT_GT(result.probes[0].second.stress[0], 3.0);
  EXPECT_LT(result.probes[0].second.stress[0], 3.7);
}

TEST(Analyse, AnExactSolutionThatIsZeroIsRefusedWhereItWasSaid) {
  Settings<2> settings = pulled();
  settings.common.where = "plate.toml";
  settings.exact.displacement = [](const Vec<2>&) { return Vec<2>(Vec<2>::Zero()); };
  EXPECT_THAT(complaint([&] { analyse(plate(0.2), settings); }),
              StartsWith("plate.toml: the exact solution is zero everywhere"));
}

TEST(Analyse, IsTheSameOnAMeshAndOnTheSourceItCameFrom) {
  const MeshSource<2> source = plate(0.2);
  const Result<2> of_source = analyse(source, pulled());
  const Result<2> of_mesh = analyse(FineMesh<2>(source.mesh({.length = 0.2}, {"mesh", {}}).mesh), pulled());
  const Result<2> of_prepared = analyse(prepare(source, pulled()), pulled());
  EXPECT_EQ(of_source.solution.strain_energy, of_mesh.solution.strain_energy);
  EXPECT_EQ(of_source.solution.strain_energy, of_prepared.solution.strain_energy);
  EXPECT_EQ(of_source.fields.displacement, of_mesh.fields.displacement);
  EXPECT_EQ(of_source.fields.stress, of_prepared.fields.stress);
}

TEST(Analyse, OutlivesTheMeshItWasGiven) {
  const auto result = [] {
    return analyse(triangulate(shapes::rectangle(0.0, 0.0, 4.0, 1.0), {.size = 0.2}),
                   {.common = {.model = {.material = LinearElastic(1.0, 0.0), .plane = Plane::stress}},
                    .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                    .loads = {.tractions = {tension<2>("right", 2.0)}, .body_force = {}}});
  }();
  EXPECT_NEAR(result.solution.strain_energy, 8.0, 1e-9);
  EXPECT_NEAR(probe(result.basis().space, result.fields, {4.0, 0.5}).displacement.x(), 8.0, 1e-9);
}

TEST(Analyse, MessagesBeginWithAPlaceOnlyWhereOneIsKnown) {
  Settings<2> settings = pulled();
  settings.probes[0].at = {0.0, 0.5};
  const std::string outside = complaint([&] { analyse(plate(0.4), settings); });
  EXPECT_THAT(outside, HasSubstr("outside the body"));
  settings.probes[0].where = "plate.toml:7";
  EXPECT_EQ(complaint([&] { analyse(plate(0.4), settings); }), "plate.toml:7: " + outside);

  settings = pulled();
  settings.supports.pop_back();
  const std::string free = complaint([&] { analyse(plate(0.4), settings); });
  EXPECT_THAT(free, HasSubstr("translation"));
  settings.common.where = "plate.toml";
  EXPECT_EQ(complaint([&] { analyse(plate(0.4), settings); }), "plate.toml: " + free);

  settings = pulled();
  settings.common.materials = {{"steel", LinearElastic(1.0, 0.3)}};
  EXPECT_THAT(complaint([&] { analyse(plate(0.4), settings); }), HasSubstr("\"steel\""));
  settings = pulled();
  settings.accuracy = 0.02;
  settings.corrected = false;
  EXPECT_THAT(complaint([&] { analyse(plate(), settings); }), StartsWith("an accuracy can be asked for where"));
}

TEST(Analyse, ReachesTheAccuracyThatIsAskedFor) {
  Settings<2> settings = pulled();
  settings.accuracy = 0.02;
  std::vector<std::string> said;
  const Result<2> result = analyse(plate(), settings, {.say = [&](const std::string& line) { said.push_back(line); }});
  EXPECT_LE(result.estimates->total(), 0.02);
  EXPECT_GE(result.attempts.size(), 2u) << "the first mesh is coarse";
  EXPECT_EQ(said.size(), 2 * result.attempts.size() + 2)
      << "three parts of the boundary, every mesh, and of every next one how large it will be";
  EXPECT_TRUE(result.warnings.empty());
  // On a mesh that is given there is no other: what is missed is said.
  const FineMesh<2> coarse(plate().mesh({.length = 1.0}, {"mesh", {}}).mesh);
  const Result<2> missed = analyse(coarse, settings);
  EXPECT_THAT(missed.warnings, Contains(HasSubstr("an error of 2 % in the energy norm was asked for")));
}

struct Told {
  std::string stage;
  StageTimes times;
  Monitor monitor(std::function<bool(const std::string& stage, int asked)> cancel = {}) {
    Monitor result{.progress = [this](const std::string& name, double) { stage = name; }, .times = &times};
    if (cancel) result.cancelled = [this, cancel, asked = 0]() mutable { return cancel(stage, ++asked); };
    return result;
  }
};

TEST(Analyse, TimesOfTheStagesAddUpForWhoeverWatchesAsInTheResult) {
  Told told;
  const Result<2> result = analyse(plate(0.2), pulled(), told.monitor());
  for (const char* stage :
       {"mesh", "cloud", "weights", "basis", "quadrature", "assembly", "solve", "correction", "duals", "output"}) {
    EXPECT_GT(result.times[stage], 0.0) << stage;
    EXPECT_EQ(result.times[stage], told.times[stage]) << stage;
  }
  EXPECT_NEAR(result.times.total(), told.times.total(), 1e-12);
}

TEST(Analyse, EndsInTheMiddleOfTheStageInWhichItIsCancelled) {
  for (const std::string in : {"mesh", "basis", "correction", "duals", "output"}) {
    Told told;
    int there = 0;
    // The first question of a stage comes before it is told of: what is asked while it is the one told of is within it.
    const auto cancel = [&](const std::string& stage, int) { return stage == in && ++there > 0; };
    const std::string message = complaint<Cancelled>([&] { analyse(plate(0.2), pulled(), told.monitor(cancel)); });
    if (in == "mesh" || in == "output")
      EXPECT_THAT(message, in == "mesh" ? HasSubstr("\"cloud\"") : HasSubstr("no error"));
    else
      EXPECT_EQ(message, "cancelled in the stage \"" + in + "\"");
  }
}

TEST(Analyse, EndsOnTheWayToAnAccuracy) {
  Settings<2> settings = pulled();
  settings.accuracy = 1e-4;
  int meshes = 0;
  const Monitor monitor{.cancelled = [&] { return meshes == 2; },
                        .say = [&](const std::string& line) { meshes += line.find(" cells of degree ") != line.npos; }};
  EXPECT_EQ(complaint<Cancelled>([&] { analyse(plate(), settings, monitor); }), "cancelled in the stage \"mesh\"");
}

Settings<2> cook(double nu) {
  return {.common = {.model = {.material = LinearElastic(240.565, nu), .plane = Plane::strain}},
          .supports = {clamp<2>("left")},
          .loads = {.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(0.0, 100.0 / 16.0); }}},
                    .body_force = {}},
          .probes = {{"tip", {48.0, 52.0}}}};
}

/// 7.695 by very fine finite elements; the case file of the same membrane is within a thousandth, too.
TEST(Defaults, CooksMembraneDoesNotLockNearOneHalf) {
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 0.8});
  Settings<2> settings = cook(0.4999);
  settings.common.approximation.spacing = 3.2;
  const Result<2> result = analyse(mesh, settings);
  EXPECT_TRUE(result.approximation.averaged);
  EXPECT_NEAR(result.probes.at(0).second.displacement.y() / 7.695, 1.0, 1e-3);
}

TEST(Defaults, QuadraticElementsAverageDilatationsBeyondTheirPowersAndLinearOnesWarn) {
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 4.0});
  const auto with = [&](BasisKind kind, double nu) {
    Settings<2> settings = cook(nu);
    settings.common.approximation.kind = kind;
    return analyse(mesh, settings);
  };
  EXPECT_FALSE(with(BasisKind::p2, 0.48).approximation.averaged);
  const Result<2> quadratic = with(BasisKind::p2, 0.4999), linear = with(BasisKind::p1, 0.4999);
  EXPECT_TRUE(quadratic.approximation.averaged);
  EXPECT_NEAR(quadratic.probes.at(0).second.displacement.y() / 7.695, 1.0, 0.02);
  EXPECT_THAT(quadratic.warnings, ElementsAre(HasSubstr("the fine mesh leaves an error")));
  EXPECT_LT(linear.probes.at(0).second.displacement.y() / 7.695, 0.85);
  EXPECT_THAT(linear.warnings, ElementsAre(StartsWith("linear elements lock"), HasSubstr("basis.kind = \"p2\"")));
}

TEST(Defaults, ArePickedByTheMaterialOfTheWorstRegionAndPlace) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.2});
  const MeshSource<2> source{
      .mesh = [&](const MeshSize&,
                  const Stage&) { return MadeMesh<2>{extract(mesh, std::vector<char>(mesh.num_cells(), 1))}; },
      .size = 0.2};
  const auto decided = [&](const SharedMaterial& material, Plane plane) {
    const Settings<2> settings{.common = {.model = {.material = material, .plane = plane}},
                               .supports = {clamp<2>("left")}};
    return with_defaults(settings, prepare(source, settings)).common.approximation;
  };
  const auto growing = [](double slope) {
    return LinearElastic(1.0, [slope](const Vec<3>& X) { return 0.3 + slope * X.x(); });
  };
  EXPECT_EQ(decided(growing(0.08), Plane::strain).dilatation, Dilatation::averaged);
  EXPECT_EQ(decided(growing(0.04), Plane::strain).dilatation, Dilatation::pointwise);
  EXPECT_EQ(decided(growing(0.08), Plane::stress).dilatation, Dilatation::pointwise);
  EXPECT_EQ(decided(growing(0.08), Plane::axisymmetric).dilatation, Dilatation::averaged);
  EXPECT_TRUE(decided(growing(0.0), Plane::axisymmetric).axisymmetric);
}

TEST(Defaults, WhatIsSaidIsKept) {
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 4.0});
  Settings<2> settings = cook(0.4999);
  settings.estimated = settings.corrected = false;
  settings.common.approximation.dilatation = Dilatation::pointwise;
  const double locked = analyse(mesh, settings).probes.at(0).second.displacement.y();
  settings.common.approximation.dilatation = Dilatation::averaged;
  const Result<2> averaged = analyse(mesh, settings);
  EXPECT_LT(locked, 0.8 * averaged.probes.at(0).second.displacement.y());
  settings.common.model.essential = Essential::strong;
  PreparedMesh<2> prepared;
  prepared.mesh = averaged.mesh;
  prepared.materials = {settings.common.model.material};
  EXPECT_EQ(with_defaults(settings, prepared).common.approximation.vanish_on, std::vector<std::string>{"left"});
}

TEST(Defaults, APlaneIsNeverAssumed) {
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 8.0});
  Settings<2> settings = cook(0.3);
  settings.common.model.plane.reset();
  EXPECT_THAT(complaint([&] { analyse(mesh, settings); }), HasSubstr("plane"));
}

/// What the lower layers say of a nearly incompressible material.
std::string complaint_of_solver(const ApproximationOptions& options, double nu, Plane plane = Plane::strain) {
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 2.0});
  return complaint([&] {
    const ElasticModel model{.material = LinearElastic(1.0, nu), .plane = plane};
    const auto approximation = approximate(mesh, options);
    ElasticSolver<2>(approximation, model, {clamp<2>("left")}).solve({});
  });
}

TEST(Defaults, LowerLayersRefuseToLockInSilence) {
  const ApproximationOptions cloud{.spacing = 8.0}, linear{.kind = BasisKind::p1}, quadratic{.kind = BasisKind::p2};
  EXPECT_THAT(complaint_of_solver(cloud, 0.41), HasSubstr("approximate with dilatation = Dilatation::averaged"));
  EXPECT_THAT(complaint_of_solver(linear, 0.41), HasSubstr("take BasisKind::mls or p2"));
  EXPECT_THAT(complaint_of_solver(quadratic, 0.495), HasSubstr("approximate with dilatation = Dilatation::averaged"));
  for (const auto& options : {cloud, linear}) {
    EXPECT_EQ(complaint_of_solver(options, 0.39), "no error");
    EXPECT_EQ(complaint_of_solver(options, 0.4999, Plane::stress), "no error");
  }
  EXPECT_EQ(complaint_of_solver(quadratic, 0.485), "no error");
  for (const Dilatation said : {Dilatation::pointwise, Dilatation::averaged}) {
    EXPECT_EQ(complaint_of_solver({.spacing = 8.0, .dilatation = said}, 0.49), "no error");
    EXPECT_EQ(complaint_of_solver({.kind = BasisKind::p2, .dilatation = said}, 0.4999), "no error");
  }
}

}  // namespace
}  // namespace efree
