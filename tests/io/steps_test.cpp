// SPDX-License-Identifier: GPL-3.0-or-later
/// Cases through time: [time], materials that are not linear, history.csv, runs that cannot go on.
#include "efree/io/case/case_file.hpp"
#include "efree/tests/io/steps_cases.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using test::history, test::json, test::pulled_strip, test::replaced, test::Workspace;
using ::testing::HasSubstr;
using ::testing::Not;

/// The force that stretches the strip, by its closed form: no stress across.
double pull(double stretch) {
  double b = 1.0;
  for (int k = 0; k < 50; ++k)
    b -= (0.7 * (b - 1.0 / b) + 1.3 * std::log(stretch * b) / b) /
         (0.7 * (1.0 + 1.0 / (b * b)) + 1.3 * (1.0 - std::log(stretch * b)) / (b * b));
  return 0.7 * (stretch - 1.0 / stretch) + 1.3 * std::log(stretch * b) / stretch;
}

TEST(Steps, LoadPathOfARubberStripIsThatOfItsClosedForm) {
  const Workspace work(pulled_strip);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("error in the energy norm"));
  const auto columns = history(work / "out/history.csv");
  ASSERT_GT(columns.at("t").size(), 3u);
  EXPECT_EQ(columns.at("t").back(), 1.0);
  for (std::size_t k = 0; k < columns.at("t").size(); ++k) {
    const double stretch = 1.0 + 0.8 * columns.at("t")[k];
    EXPECT_NEAR(columns.at("reaction.right.x")[k], pull(stretch), 1e-8);
    EXPECT_NEAR(columns.at("probe.end.ux")[k], 2.0 * (stretch - 1.0), 1e-8);
    EXPECT_EQ(columns.at("dissipated")[k], 0.0);
    EXPECT_EQ(columns.at("negative_pivots")[k], 0.0);
    EXPECT_LT(columns.at("iterations")[k], 8.0);
  }
  const auto result = json(work / "out/result.json");
  EXPECT_EQ(result["path"]["steps"], columns.at("t").size());
  EXPECT_NEAR(result["reactions"]["right"]["force"][0].get<double>(), pull(1.8), 1e-8);
  EXPECT_LT(result["balance"]["error"].get<double>(), 1e-10);
}

TEST(Steps, TheCloudsAnswerIsHandedOutWhereCorrectionIsOff) {
  const std::string held =
      replaced(pulled_strip, "displacement = [\"1.6*t\", \"free\"]", "displacement = [\"1.6*t\", 0]");
  const auto result = [&](const std::string& text) {
    const Workspace work(text);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 0) << run.output;
    return json(work / "out/result.json");
  };
  const auto corrected = result(held),
             alone = result(replaced(held, "plane = \"strain\"", "plane = \"strain\"\ncorrection = \"off\""));
  EXPECT_EQ(corrected["estimates"]["energy"]["cloud"], 0.0);
  EXPECT_EQ(alone["estimates"]["energy"]["cloud"], corrected["estimates"]["energy"]["uncorrected"]);
  const auto pull_of = [](const auto& json) {
    const auto force = json["reactions"]["right"]["force"];
    return Vec<2>(force[0].template get<double>(), force[1].template get<double>());
  };
  const Vec<2> should = pull_of(corrected);
  EXPECT_NEAR(alone["estimates"]["cloud_alone"]["reactions"]["right"].get<double>(),
              (pull_of(alone) - should).norm() / should.norm(), 1e-9);
  EXPECT_GT(corrected["corrections"], 0);
  EXPECT_EQ(alone["corrections"], 0);
}

TEST(Steps, WhatDoesNotMentionTimeGrowsInProportionToIt) {
  const Workspace work(replaced(replaced(pulled_strip, "1.6*t", "1.6"), "step = 0.25", "end = 2\nstep = 0.5"));
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  const auto columns = history(work / "out/history.csv");
  for (std::size_t k = 0; k < columns.at("t").size(); ++k)
    EXPECT_NEAR(columns.at("reaction.right.x")[k], pull(1.0 + 0.4 * columns.at("t")[k]), 1e-8);
}

/// The same strip under a pressure on its end; what it stretches by is that of the true stress.
TEST(Steps, APressureThatFollowsTheBodyActsOnItsAreaAsItIs) {
  const std::string pressed =
      replaced(pulled_strip, "displacement = [\"1.6*t\", \"free\"]", "pressure = \"-0.5*t\"\nfollower = true");
  const Workspace work(pressed);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, Not(HasSubstr("at rest"))) << "nothing to warn of";
  const auto columns = history(work / "out/history.csv");
  for (std::size_t k = 0; k < columns.at("t").size(); ++k) {
    const double stretch = 1.0 + 0.5 * columns.at("probe.end.ux")[k], across = 1.0 + columns.at("probe.end.uy")[k];
    EXPECT_NEAR(pull(stretch) / across, 0.5 * columns.at("t")[k], 1e-8);
    EXPECT_NEAR(columns.at("reaction.left.x")[k], -pull(stretch), 1e-8);
    EXPECT_LT(columns.at("iterations")[k], 8.0);
  }
  const auto result = json(work / "out/result.json");
  const auto& load = result["loads"][0];
  EXPECT_EQ(load["kind"], "follower_pressure");
  EXPECT_NEAR(load["force"][0].get<double>(), -columns.at("reaction.left.x").back(), 1e-8);
  EXPECT_LT(result["balance"]["error"].get<double>(), 1e-10);
  const Workspace thin(replaced(pressed, "plane = \"strain\"", "plane = \"stress\""));
  EXPECT_THAT(thin.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).output,
              HasSubstr("it is per thickness at rest"));
}

TEST(Steps, AMaterialThatIsNotLinearNeedsNoTimeToBeSaid) {
  const Workspace work(replaced(replaced(pulled_strip, "1.6*t", "1.6"), "[time]\nstep = 0.25\n", ""));
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  EXPECT_NEAR(history(work / "out/history.csv").at("reaction.right.x").back(), pull(1.8), 1e-8);
}

TEST(Steps, ALargestStepAloneIsTheFirstToo) {
  const Workspace work(replaced(pulled_strip, "step = 0.25", "max_step = 0.01"));
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  const auto times = history(work / "out/history.csv").at("t");
  EXPECT_EQ(times.size(), 100u);
  EXPECT_NEAR(times.front(), 0.01, 1e-12);
}

TEST(Steps, LinearMaterialsFollowLoadsThatComeAndGo) {
  const std::string elastic =
      replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3", "E = 1\nnu = 0.3");
  const Workspace work(
      replaced(replaced(elastic, "1.6*t", "0.1*sin(pi*t)"), "step = 0.25", "step = 0.25\nmax_step = 0.25"));
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  const auto columns = history(work / "out/history.csv");
  for (std::size_t k = 0; k < columns.at("t").size(); ++k)
    EXPECT_NEAR(columns.at("reaction.right.x")[k], 0.05 * std::sin(M_PI * columns.at("t")[k]) / (1.0 - 0.09), 1e-9);
}

/// E = 1, yield = 0.01 + 0.25 a: past yield a slope of 1/5.
TEST(Steps, AMetalStripYieldsAndIsUnloadedToAPlasticStrain) {
  const std::string metal = replaced(replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3",
                                              "model = \"j2\"\nE = 1\nnu = 0.3\nyield = \"0.01 + 0.25*a\""),
                                     "plane = \"strain\"", "plane = \"stress\"");
  const Workspace work(
      replaced(replaced(metal, "1.6*t", "0.06*(1 - abs(1 - 2*t))"), "step = 0.25", "step = 0.125\nmax_step = 0.125"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto columns = history(work / "out/history.csv");
  double plastic = 0.0, all = 0.0, dissipated = 0.0;  // strain, and its sum either way
  for (std::size_t k = 0; k < columns.at("t").size(); ++k) {
    const double trial = columns.at("probe.end.ux")[k] / 2.0 - plastic;
    const double flow = std::max(0.0, std::abs(trial) - (0.01 + 0.25 * all)) / 1.25;
    plastic += std::copysign(flow, trial);
    all += flow;
    EXPECT_NEAR(columns.at("reaction.right.x")[k], trial - std::copysign(flow, trial), 1e-8) << columns.at("t")[k];
    EXPECT_EQ(columns.at("plastic_share")[k] > 0.5, flow > 0.0) << columns.at("t")[k];
    EXPECT_GE(columns.at("dissipated")[k], dissipated);
    dissipated = columns.at("dissipated")[k];
  }
  EXPECT_NEAR(json(work / "out/result.json")["path"]["largest"]["equivalent_plastic_strain"].get<double>(), all, 1e-8);
  EXPECT_GT(all, 0.017) << "it yields again on the way back";
}

TEST(Steps, AMetalStripWhoseYieldStressDependsOnTheRateFlowsFromStepToStep) {
  const std::string metal =
      replaced(replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3",
                        "model = \"j2\"\nE = 1\nnu = 0.3\nyield = \"0.01 + 0.25*a\"\nC = 0.1\nreference_rate = 1e-3"),
               "plane = \"strain\"", "plane = \"stress\"");
  const Workspace work(replaced(replaced(metal, "1.6*t", "0.06*t"), "step = 0.25", "step = 0.1\nmax_step = 0.1"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto columns = history(work / "out/history.csv");
  double plastic = 0.0, before = 0.0;
  for (std::size_t k = 0; k < columns.at("t").size(); ++k) {
    const double strain = columns.at("probe.end.ux")[k] / 2.0, dt = columns.at("t")[k] - before;
    before = columns.at("t")[k];
    double low = 0.0, high = strain - plastic;  // of the flow in the step
    for (int i = 0; i < 100; ++i) {
      const double flow = 0.5 * (low + high), factor = 1.0 + 0.1 * std::max(0.0, std::log(flow / dt / 1e-3));
      (strain - plastic - flow > (0.01 + 0.25 * (plastic + flow)) * factor ? low : high) = flow;
    }
    if (strain > 0.01) plastic += low;
    EXPECT_NEAR(columns.at("reaction.right.x")[k], strain - plastic, 1e-8) << columns.at("t")[k];
  }
  EXPECT_GT(plastic, 0.01);
}

TEST(Steps, StepsEndWhereLoadsTurnIfToldSo) {
  const Workspace work(
      replaced(replaced(pulled_strip, "1.6*t", "0.8*(1 - abs(1 - 2*t))"), "step = 0.25", "step = 0.35\nstops = [0.5]"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto columns = history(work / "out/history.csv");
  const auto& t = columns.at("t");
  const auto turn = std::ranges::find(t, 0.5);
  ASSERT_NE(turn, t.end());
  EXPECT_NEAR(columns.at("reaction.right.x")[turn - t.begin()], pull(1.4), 1e-8);
  EXPECT_NEAR(columns.at("reaction.right.x").back(), 0.0, 1e-8);
}

TEST(Steps, DefinitionsMayDependOnTimeAndOnEachOther) {
  const Workspace work("[definitions]\nshare = \"sqrt(t)\"\nend = \"1.6*share\"\n" +
                       replaced(pulled_strip, "1.6*t", "end"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto columns = history(work / "out/history.csv");
  for (std::size_t k = 0; k < columns.at("t").size(); ++k)
    EXPECT_NEAR(columns.at("reaction.right.x")[k], pull(1.0 + 0.8 * std::sqrt(columns.at("t")[k])), 1e-8);
}

TEST(Steps, ForcesInAllMayDependOnTimeAndReactionsHaveTheirNames) {
  const std::string pulled = replaced(pulled_strip, "displacement = [\"1.6*t\", \"free\"]", "force = [\"0.3*t^2\", 0]");
  const Workspace work(pulled + "[[reaction]]\nname = \"wall\"\non = \"left\"\n");
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("reaction \"wall\": force (-0.3, "));
  const auto columns = history(work / "out/history.csv");
  for (std::size_t k = 0; k < columns.at("t").size(); ++k) {
    EXPECT_NEAR(columns.at("reaction.wall.x")[k], -0.3 * std::pow(columns.at("t")[k], 2), 1e-9);
    EXPECT_NEAR(pull(1.0 + columns.at("probe.end.ux")[k] / 2.0), 0.3 * std::pow(columns.at("t")[k], 2), 1e-8);
    EXPECT_EQ(columns.at("reaction.wall.x")[k], columns.at("reaction.left.x")[k]);
  }
  const auto result = json(work / "out/result.json");
  EXPECT_NEAR(result["reactions"]["wall"]["force"][0].get<double>(), -0.3, 1e-9);
  EXPECT_LT(result["balance"]["error"].get<double>(), 1e-9);
  EXPECT_TRUE(std::filesystem::exists(work / "out/history.png"));
}

TEST(Steps, WhatTheAnswerLacksIsWarnedOf) {
  const auto said = [](const std::string& text) {
    const Workspace work(text);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 0) << run.output;
    return run.output;
  };
  EXPECT_THAT(said(replaced(pulled_strip, "displacement = [\"1.6*t\", \"free\"]", "pressure = -0.1")),
              HasSubstr("pressure on \"right\" acts on the area and along the normal at rest"));
  const std::string elastic =
      replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3", "E = 1\nnu = 0.3");
  EXPECT_THAT(said(elastic), HasSubstr("displacement gradients of 0.8"));
  EXPECT_THAT(said(replaced(elastic, "1.6*t", "0.08*t")), Not(HasSubstr("displacement gradients")));
  EXPECT_THAT(said(pulled_strip + "[basis]\nkind = \"p2\"\n"),
              AllOf(HasSubstr("error of the path, by one of"), Not(HasSubstr("not estimated"))))
      << "elements are compared with those of coarser meshes";
}

TEST(Steps, ABodyTurnedInsideOutSomewhereIsNoAnswer) {
  const Workspace work(test::turned_strip);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, HasSubstr("turned inside out"));
  const auto columns = history(work / "out/history.csv");
  EXPECT_LT(columns.at("smallest_J").back(), 0.01) << "steps are halved up to there";
  for (const double J : columns.at("smallest_J")) EXPECT_GT(J, 0.0);
}

TEST(Steps, ARunThatCannotGoOnLeavesItsLastStepAndSaysWhy) {
  std::string tube = replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3",
                              "model = \"j2\"\nE = 1\nnu = 0.3\nyield = 0.01");
  tube = replaced(tube, "displacement = [\"1.6*t\", \"free\"]", "traction = [\"0.02*t\", 0]");
  const Workspace work(tube);
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, HasSubstr("error: limit load reached at t = "));
  EXPECT_THAT(run.output, HasSubstr("prescribe displacements or use arc length"));
  const auto columns = history(work / "out/history.csv");
  const double limit = 0.02 / std::sqrt(3.0);  // plane strain
  EXPECT_LT(columns.at("reaction.left.x").back(), -0.97 * limit);
  EXPECT_GT(columns.at("reaction.left.x").back(), -1.0001 * limit);
  EXPECT_THAT(json(work / "out/failure.json")["reason"].get<std::string>(), HasSubstr("do not converge"));
  EXPECT_EQ(json(work / "out/failure.json")["results"], "of this run");
  EXPECT_EQ(json(work / "out/result.json")["path"]["time"], columns.at("t").back());
}

/// A nearly incompressible block between plates that it is bonded to. Held in the mean, its sides become wavy. At its
/// corners the stresses of so coarse a cloud are far off, which is not the point here.
TEST(Steps, HowFarBoundariesAreFromWhatIsPrescribedIsStatedAndWarnedOf) {
  const std::string block = R"([geometry]
shape = "rectangle"
parameters = { width = 4, height = 1.5 }
mesh_size = 0.15
[cloud]
spacing = 0.45
[analysis]
plane = "strain"
correction = "off"
largest_error = 10
[material]
model = "neo_hookean"
E = 3
nu = 0.4999
[[boundary]]
on = "bottom"
displacement = [0, 0]
[[boundary]]
on = "top"
displacement = [0, "-0.45*t"]
[[probe]]
name = "plate"
at = [0.35, 1.5]
)";
  const auto solved = [&](const std::string& text) {
    const Workspace work(text + "[time]\nstep = 0.1\n");
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 0) << run.output;
    return std::pair(json(work / "out/result.json"), run.output);
  };
  const auto [weak, said] = solved(block);
  const auto u = weak["probes"]["plate"]["displacement"];
  const double off = std::hypot(u[0].get<double>(), u[1].get<double>() + 0.45);
  const double most = weak["extremes"]["displacement"]["value"].get<double>();
  EXPECT_GT(weak["path"]["gap"].get<double>(), 0.01);
  EXPECT_GE(weak["path"]["gap"].get<double>(), 0.9 * off / most);
  EXPECT_THAT(said, HasSubstr("warning: boundaries are up to"));
  const auto [strong, nothing_said] =
      solved(replaced(block, "plane = \"strain\"", "plane = \"strain\"\nessential = \"strong\""));
  EXPECT_EQ(strong["path"]["gap"], 0.0);
  EXPECT_NEAR(strong["probes"]["plate"]["displacement"][1].get<double>(), -0.45, 1e-12);
  EXPECT_THAT(nothing_said, Not(HasSubstr("warning: boundaries")));
}

TEST(Steps, EveryStepIsALineOnTheTerminalUnlessQuiet) {
  const Workspace work(pulled_strip);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_THAT(run.output, HasSubstr("t = 0.25: step 1, "));
  EXPECT_THAT(run.output, HasSubstr("t = 1: step "));
  EXPECT_THAT(work.efree({"solve", "case.toml", "--out", "out", "--no-picture", "--quiet"}).output,
              Not(HasSubstr("step 1")));
}

TEST(Steps, APathThatIsFarOffLeavesItsResultsWithExitStatusThree) {
  const Workspace work;
  std::string metal = replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3",
                               "model = \"j2\"\nE = 210\nnu = 0.3\nyield = 0.24");
  metal = replaced(metal, "file = \"strip.geo\"\nmesh_size = 0.2",
                   "shape = \"rectangle\"\nmesh_size = 0.1\nparameters = { width = 2, height = 1 }");
  // Bent like a short cantilever.
  metal = replaced(metal, "on = \"left\"\nnormal_displacement = 0", "on = \"left\"\ndisplacement = [0, 0]");
  metal = replaced(metal, "[[boundary]]\non = \"bottom\"\nnormal_displacement = 0\n", "");
  metal = replaced(metal, "[\"1.6*t\", \"free\"]", "[\"free\", \"0.01*t\"]");
  work.write("case.toml", replaced(metal, "plane = \"strain\"", "plane = \"strain\"\nlargest_error = 0.01"));
  const auto refused = work.efree({"solve", "case.toml", "--out", "out", "--quiet", "--no-picture"});
  EXPECT_EQ(refused.status, 3) << refused.output;
  EXPECT_THAT(json(work / "out/failure.json")["reason"].get<std::string>(), HasSubstr("% off"));
  const auto result = json(work / "out/result.json");
  EXPECT_EQ(result["path"]["time"], 1.0);
  EXPECT_TRUE(result["estimates"]["path"]["stress"].is_number());
  EXPECT_TRUE(std::filesystem::exists(work / "out/fields.vtu"));
  work.write("case.toml", replaced(metal, "plane = \"strain\"", "plane = \"strain\"\nlargest_error = 10"));
  EXPECT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--quiet", "--no-picture"}).status, 0);
  EXPECT_FALSE(std::filesystem::exists(work / "out/failure.json"));
}

TEST(Steps, AValueThatIsNotFiniteIsSaidWithItsExpressionPlaceAndTime) {
  const auto said = [](const std::string& displacement, int status) {
    const Workspace work(replaced(pulled_strip, "\"1.6*t\"", displacement));
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, status) << run.output;
    return run.output;
  };
  EXPECT_THAT(said("\"0.1/(0.5 - t)\"", 3),
              HasSubstr("case.toml:22: expression \"0.1/(0.5 - t)\" is inf at t = 0.5, expected a finite number"));
  const std::string of_place = said("\"0.1*t*sqrt(y + 0.9 - t)\"", 3);
  EXPECT_THAT(of_place, HasSubstr("case.toml:22: expression \"0.1*t*sqrt(y + 0.9 - t)\" is nan at (2, "));
  EXPECT_THAT(of_place, HasSubstr("), t = 1, expected a finite number"));
  EXPECT_THAT(said("\"0.1*sqrt(0.9 - t)\"", 2), HasSubstr("is nan at t = 1, expected a finite number"));
}

TEST(Steps, ModuliBeyondTheRangeOfNumbersAreRefused) {
  const std::string elastic =
      replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3", "E = 1\nnu = 0.3");
  for (const std::string& large :
       {replaced(elastic, "E = 1\n", "E = 1e300\n"),
        replaced(replaced(elastic, "E = 1\n", "E = 1e-300\n"), "[time]\nstep = 0.25\n", "[definitions]\nt = 1\n")}) {
    const Workspace work(large);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 2) << run.output;
    EXPECT_THAT(run.output, HasSubstr("case.toml:8: the moduli of the material at (0, 0) are about"));
  }
}

TEST(Steps, StrainsBelowRoundingAreNoAnswer) {
  const std::string elastic =
      replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3", "E = 1e9\nnu = 0.3");
  const auto said = [&](const std::string& traction, int status) {
    const Workspace work(replaced(elastic, "displacement = [\"1.6*t\", \"free\"]", "traction = [" + traction + ", 0]"));
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, status) << run.output;
    return run.output;
  };
  EXPECT_THAT(said("\"1e3*t\"", 0), Not(HasSubstr("out of balance")));
  EXPECT_THAT(said("\"1e-8*t\"", 3), HasSubstr("error: reactions and loads are out of balance by"));
}

TEST(Steps, WhatIsWrongIsSaidWithItsPlace) {
  const auto refused = [](const std::string& text) {
    const Workspace work(text);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 2) << run.output;
    EXPECT_FALSE(std::filesystem::exists(work / "out"));
    return run.output;
  };
  EXPECT_THAT(refused(replaced(pulled_strip, "[time]\nstep = 0.25\n", "")), HasSubstr("t is the time of [time]"));
  EXPECT_THAT(refused(replaced(pulled_strip, "step = 0.25", "step = 2")), HasSubstr("case.toml:13: step is 2"));
  const auto until = [&](const std::string& value) {
    return refused(replaced(pulled_strip, "step = 0.25", "step = 0.25\nuntil = " + value));
  };
  EXPECT_THAT(until("{ above = 1 }"), HasSubstr("case.toml:14: until has exactly one of probe, reaction"));
  EXPECT_THAT(until("{ probe = \"end\" }"), HasSubstr("case.toml:14: until has no bound: expected above or below"));
  EXPECT_THAT(until("{ probe = \"edn\", above = 1 }"), HasSubstr("there is no probe \"edn\"; did you mean \"end\"?"));
  EXPECT_THAT(until("{ reaction = \"top\", above = 1 }"),
              HasSubstr("there is no reaction \"top\"; expected one of left"));
  EXPECT_THAT(until("{ probe = \"end\", component = \"z\", above = 1 }"), HasSubstr("component is \"z\", expected"));
  EXPECT_THAT(until("{ probe = \"end\", abov = 1 }"), HasSubstr("unknown key \"abov\""));
  EXPECT_THAT(until("0.5"), HasSubstr("expected a table"));
  EXPECT_THAT(refused(replaced(pulled_strip, "step = 0.25", "min_step = 0.3")), HasSubstr("min_step is 0.3"));
  EXPECT_THAT(refused(replaced(pulled_strip, "mu = 0.7", "yield = 0.7")), HasSubstr("yield means nothing for model"));
  EXPECT_THAT(refused(replaced(pulled_strip, "mu = 0.7", "nu = 0.7")), HasSubstr("nu is 0.7"));
  EXPECT_THAT(refused(replaced(pulled_strip, "mu = 0.7\n", "")), HasSubstr("case.toml:"));
  EXPECT_THAT(refused(pulled_strip + "[accuracy]\nenergy = 0.01\n"), HasSubstr("case.toml:26: an accuracy can be"));
  EXPECT_THAT(refused(pulled_strip + "[[case]]\nname = \"a\"\n"), HasSubstr("case.toml:26: load cases"));
  EXPECT_THAT(refused(pulled_strip + "[quadrature]\nbasis = \"cells\"\nstabilisation = 0.5\n"),
              HasSubstr("case.toml:28: a stabilisation is for linear materials"));
  EXPECT_THAT(refused(replaced(pulled_strip, "\"strain\"", "\"stress\"") + "[quadrature]\ndilatation = true\n"),
              HasSubstr("case.toml:27: averaged dilatations of finite strains are not for plane stress"));
  EXPECT_THAT(refused(replaced(pulled_strip, "spacing = 0.4", "spacing = 4")),
              HasSubstr("case.toml:5: cloud spacing = 4"));
  EXPECT_THAT(refused(replaced(pulled_strip, "mu = 0.7", "mu = \"0.7 + t\"")), HasSubstr("mu depends on t"));
  EXPECT_THAT(refused("[definitions]\nsoft = \"1 - t\"\n" + replaced(pulled_strip, "mu = 0.7", "mu = \"soft\"")),
              HasSubstr("mu depends on t"));
  EXPECT_THAT(refused(replaced(pulled_strip, "displacement = [\"1.6*t\", \"free\"]", "force = [\"x*t\", 0]")),
              HasSubstr("force depends on the place"));
  EXPECT_THAT(refused(replaced(pulled_strip, "displacement = [\"1.6*t\", \"free\"]", "stiffness = \"t\"")),
              HasSubstr("stiffness depends on t"));
  EXPECT_THAT(refused(replaced(pulled_strip, "plane = \"strain\"", "plane = \"strain\"\ncorrection = 3")),
              HasSubstr("with a [time] corrections are not counted"));
  EXPECT_THAT(refused(replaced(pulled_strip, "plane = \"strain\"", "plane = \"strain\"\nextremes = [\"von_mises\"]")),
              HasSubstr("extremes means nothing with a [time]"));
  EXPECT_THAT(refused(replaced(pulled_strip, "spacing = 0.4", "spacing = 0.4\n[basis]\nkind = \"cells\"")),
              HasSubstr("cells are for linear elasticity"));
  EXPECT_THAT(refused(replaced(pulled_strip, "step = 0.25", "stops = [1.5]")), HasSubstr("stops"));
  EXPECT_THAT(refused(replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3",
                               "model = \"j2\"\nE = 1\nnu = 0.3\nyield = \"1 + x\"")),
              HasSubstr("not of the place"));
  const std::string end = "displacement = [\"1.6*t\", \"free\"]", follows = "pressure = \"t\"\nfollower = true";
  EXPECT_THAT(refused(replaced(pulled_strip, end, "traction = [\"t\", 0]\nfollower = true")),
              HasSubstr("follower is for a pressure, and there is none"));
  EXPECT_THAT(refused(replaced(pulled_strip, end, "pressure = 1\nfollower = 1")), HasSubstr("expected true or false"));
  const std::string elastic =
      replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3", "E = 1\nnu = 0.3");
  for (const std::string& small :
       {replaced(elastic, end, follows),
        replaced(replaced(elastic, end, "pressure = 1\nfollower = true"), "[time]\nstep = 0.25\n", "")})
    EXPECT_THAT(refused(small), HasSubstr(": pressure on \"right\" follows the body: that is for materials of finite"));
  EXPECT_THAT(refused(replaced(elastic, end, follows)), HasSubstr("case.toml:22: pressure on"));
  EXPECT_THAT(refused(replaced(pulled_strip, "neo_hookean", "neo_hokean")), HasSubstr("\"neo_hookean\""));
}

}  // namespace
}  // namespace efree
