// SPDX-License-Identifier: GPL-3.0-or-later
/// Where load paths end: limit loads, plateaus by arc length, and bounds of probes and reactions.
#include "efree/tests/io/steps_cases.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <utility>

namespace efree {
namespace {

using test::history, test::json, test::pulled_strip, test::replaced, test::Workspace;
using ::testing::HasSubstr;
using ::testing::Not;

/// A perfectly plastic bar, pulled to 1.25 times its yield stress of 200.
const std::string bar = R"([geometry]
shape = "box"
parameters = { width = 1, depth = 1, height = 1 }
mesh_size = 0.5
[material]
model = "j2"
E = 200e3
nu = 0.3
yield = 200
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "front"
normal_displacement = 0
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "top"
traction = [0, 0, "250*t"]
[[probe]]
name = "tip"
at = [0.5, 0.5, 1]
[time]
step = 0.1
)";

TEST(Steps, AUniformBarPulledBeyondItsYieldStressSaysThatTheLimitLoadIsReached) {
  const Workspace work(bar);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, HasSubstr("error: limit load reached at t = "));
  EXPECT_THAT(run.output, HasSubstr("; prescribe displacements to go on"));
  EXPECT_THAT(run.output, Not(HasSubstr("arc length"))) << "all of it flows: there is nothing to find along an arc";
  const double t = json(work / "out/result.json")["path"]["time"].get<double>();
  EXPECT_NEAR(t, 0.8, 2e-4);
  EXPECT_NEAR(json(work / "out/result.json")["probes"]["tip"]["displacement"][2].get<double>(), 250.0 * t / 200e3,
              1e-9);
}

TEST(Steps, StepsThatDoNotConvergeForAnotherReasonAreNoLimitLoad) {
  const Workspace work(test::turned_strip);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, Not(HasSubstr("limit load")));
}

TEST(Steps, ByArcLengthAPlateauEndsWithAMessageOrWhereAProbeIsToldToBe) {
  const std::string arc = replaced(replaced(bar, "yield = 200", "yield = \"200 + 2*a\""), "step = 0.1",
                                   "step = 0.1\ncontrol = \"arc_length\"");
  const Workspace plateau(arc);
  const auto run = plateau.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, HasSubstr("error: limit load reached at t = 0.8000"));
  EXPECT_THAT(run.output, HasSubstr("say what ends the path: [time] until"));
  EXPECT_LT(history(plateau / "out/history.csv").at("t").size(), 60u);
  const Workspace told(arc + "until = { probe = \"tip\", component = \"z\", above = 0.004 }\n");
  const auto ended = told.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(ended.status, 0) << ended.output;
  EXPECT_THAT(ended.output, HasSubstr("probe \"tip\" z rises above 0.004, it is 0.004"));
  const auto columns = history(told / "out/history.csv");
  const auto& tip = columns.at("probe.tip.uz");
  EXPECT_GT(tip.back(), 0.004);
  EXPECT_LE(tip[tip.size() - 2], 0.004);
  EXPECT_NEAR(columns.at("t").back(), 0.8, 1e-4);
  EXPECT_FALSE(std::filesystem::exists(told / "out/failure.json"));
}

/// Without any stiffness left no step along an arc is defined either.
TEST(Steps, ByArcLengthAUniformBarWithoutHardeningSaysToPrescribeDisplacements) {
  const Workspace work(replaced(bar, "step = 0.1", "step = 0.1\ncontrol = \"arc_length\""));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, HasSubstr("error: limit load reached at t = 0.8"));
  EXPECT_THAT(run.output, HasSubstr("; prescribe displacements to go on"));
}

TEST(Steps, APathEndsWithTheFirstStepAtWhichAProbeOrAReactionPassesABound) {
  const auto last = [](const std::string& until, const std::string& column) {
    const Workspace work(replaced(replaced(pulled_strip, "1.6*t", "1.6*sin(pi*t)"), "step = 0.25",
                                  "step = 0.05\nmax_step = 0.05\nuntil = " + until));
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 0) << run.output;
    const auto values = history(work / "out/history.csv").at(column);
    return std::pair(values.back(), values.size() > 1 ? values[values.size() - 2] : 0.0);
  };
  const auto [above, before_above] = last("{ probe = \"end\", component = \"x\", above = 1 }", "probe.end.ux");
  EXPECT_GT(above, 1.0);
  EXPECT_LE(before_above, 1.0);
  // It is below at the beginning: once it has been above.
  const auto [below, before_below] = last("{ probe = \"end\", component = \"x\", below = 1 }", "probe.end.ux");
  EXPECT_LT(below, 1.0);
  EXPECT_GE(before_below, 1.0);
  const auto [pulled, before_pulled] =
      last("{ reaction = \"left\", component = \"x\", below = -0.5 }", "reaction.left.x");
  EXPECT_LT(pulled, -0.5);
  EXPECT_GE(before_pulled, -0.5);
  const auto [force, before_force] = last("{ reaction = \"right\", above = 0.5 }", "reaction.right.x");
  EXPECT_GT(force, 0.5);
  EXPECT_LE(before_force, 0.5);
}

TEST(Steps, APathThatComesToItsEndBeforeTheBoundWarnsOfThat) {
  const Workspace work(replaced(pulled_strip, "step = 0.25", "step = 0.25\nuntil = { probe = \"end\", above = 5 }"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("warning: the path is at its end, t = 1, before probe \"end\" rises above 5"));
}

}  // namespace
}  // namespace efree
