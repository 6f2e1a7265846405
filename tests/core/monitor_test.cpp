// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/monitor.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/tests/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>

namespace efree {
namespace {

using ::testing::ElementsAre, ::testing::Pair, ::testing::AnyOf;

struct Told {
  std::vector<std::pair<std::string, double>> progress{};
  StageTimes times{};
  /// Says yes from this question on.
  int patience = std::numeric_limits<int>::max();
  int asked = 0;

  Monitor monitor() {
    return {.progress = [this](const std::string& stage, double done) { progress.emplace_back(stage, done); },
            .cancelled = [this] { return ++asked > patience; },
            .times = &times};
  }
};

/// The stage in which `work` was cancelled; empty if it came to its end.
template <class Work> std::string cancelled_in(const Work& work) {
  try {
    work();
  } catch (const Cancelled& error) {
    EXPECT_EQ(error.what(), "cancelled in the stage \"" + error.stage + "\"");
    return error.stage;
  }
  return "";
}

TEST(Monitor, HearsOfBeginningTicksAndEndOfAStage) {
  Told told;
  {
    const Stage stage("mesh", told.monitor());
    stage.tick(0.5);
  }
  EXPECT_THAT(told.progress, ElementsAre(Pair("mesh", 0.0), Pair("mesh", 0.5), Pair("mesh", 1.0)));
}

TEST(Monitor, TimesOfStagesAddUpInTheOrderTheyFirstRan) {
  Told told;
  const Monitor monitor = told.monitor();
  for (const char* name : {"solve", "mesh", "solve"}) const Stage stage(name, monitor);
  ASSERT_EQ(told.times.stages().size(), 2u);
  EXPECT_EQ(told.times.stages()[0].first, "solve");
  EXPECT_GT(told.times["solve"], 0.0);
  EXPECT_EQ(told.times.total(), told.times["solve"] + told.times["mesh"]);
  EXPECT_EQ(told.times["basis"], 0.0);
}

TEST(Monitor, StagesEndWhereTheyAreCancelledAndTheirTimeCounts) {
  Told told{.patience = 1};
  const auto work = [&] {
    const Stage stage("solve", told.monitor());
    stage.tick(0.5);
    ADD_FAILURE() << "went on";
  };
  EXPECT_EQ(cancelled_in(work), "solve");
  EXPECT_THAT(told.progress, ElementsAre(Pair("solve", 0.0), Pair("solve", 1.0)));
  EXPECT_GT(told.times["solve"], 0.0);
}

TEST(Monitor, PartsOfAStageAreCancelledInItsNameAndNeitherToldNorTimed) {
  Told told{.patience = 2};
  const auto work = [&] {
    const Stage stage("correction", told.monitor());
    const Stage part("basis", stage.within());
    part.tick(0.5);
  };
  EXPECT_EQ(cancelled_in(work), "correction");
  EXPECT_THAT(told.progress, ElementsAre(Pair("correction", 0.0), Pair("correction", 1.0)));
  EXPECT_EQ(told.times["basis"], 0.0);
}

TEST(Monitor, WhatNobodyWatchesRuns) {
  const Stage stage("solve", {});
  stage.tick(0.5);
  const Stage part("basis", stage.within());
  part.check();
}

/// A square, pulled; every stage from cloud to corrected answer.
double pull(const Monitor& monitor) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.05});
  const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  const std::vector<DisplacementCondition<2>> supports{clamp<2>("left")};
  const Loads<2> loads{.tractions = {tension<2>("right", 1.0)}, .body_force = {}};
  const auto cloud = approximate(mesh, {.spacing = 0.2}, monitor);
  const auto solution = ElasticSolver<2>(cloud, model, supports, monitor).solve(loads);
  return Corrector<2>(cloud, model, supports, monitor)
      .correct(interpolate(cloud.shape, solution.coefficients), loads, {.tolerance = 1e-6}, monitor)
      .strain_energy;
}

TEST(Monitor, EndsAnAnalysisAtWhateverStepItIsAsked) {
  Told watched;
  const double energy = pull(watched.monitor());
  EXPECT_EQ(energy, pull({}));
  for (const char* stage : {"cloud", "weights", "basis", "quadrature", "assembly", "solve", "correction"})
    EXPECT_GT(watched.times[stage], 0.0) << stage;
  // Every question can be answered with yes: the stage that asks it is where the analysis ends.
  std::vector<std::string> ends;
  for (int patience = 0; patience < watched.asked; ++patience) {
    Told told{.patience = patience};
    const std::string stage = cancelled_in([&] { pull(told.monitor()); });
    EXPECT_EQ(told.asked, patience + 1);
    if (std::ranges::find(ends, stage) == ends.end()) ends.push_back(stage);
  }
  // One thread samples the cloud of the quadrature before the weights.
  EXPECT_THAT(ends, AnyOf(ElementsAre("cloud", "weights", "basis", "quadrature", "assembly", "solve", "correction"),
                          ElementsAre("cloud", "quadrature", "weights", "basis", "assembly", "solve", "correction")));
  EXPECT_GT(watched.asked, 12) << "not only at the beginning of stages: between iterations, too";
}

TEST(Monitor, EndsIterationsOnCells) {
  LabelImage<3> image{.size = {8, 8, 8}};
  image.labels.assign(512, 1);
  const std::vector<DisplacementCondition<3>> supports{clamp<3>("bottom")};
  const Loads<3> loads{.tractions = {tension<3>("top", 1.0)}, .body_force = {}};
  const auto solve = [&](const Monitor& monitor) {
    return solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, supports, loads, {.size = 1.0}, monitor);
  };
  Told watched;
  solve(watched.monitor());
  Told told{.patience = watched.asked - 1};
  EXPECT_EQ(cancelled_in([&] { solve(told.monitor()); }), "solve");
  EXPECT_LT(told.progress[told.progress.size() - 2].second, 1.0);
}

}  // namespace
}  // namespace efree
