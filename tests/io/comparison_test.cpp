// SPDX-License-Identifier: GPL-3.0-or-later
/// efree compare: one scene by several methods.
#include "efree/tests/io/workspace.hpp"

#include <gmock/gmock.h>
#include <map>

namespace efree::test {
namespace {

using ::testing::HasSubstr, ::testing::Not;

/// A strip that is stretched to 1.3 times its length. Its closed form: von Mises stress 0.272848, width 0.88687.
const std::string stretched = R"toml(title = "strip"
[geometry]
shape = "rectangle"
parameters = { width = 1, height = 2 }
mesh_size = 0.17
[analysis]
kind = "dynamics"
plane = "strain"
[material]
model = "neo_hookean"
E = 1
nu = 0.3
density = 1
[[velocity]]
value = ["-2e-2 * 3/7 * (x - 0.5)", "2e-2 * (y - 1)"]
[[boundary]]
on = "bottom"
velocity = ["free", -0.02]
[[boundary]]
on = "top"
velocity = ["free", 0.02]
[time]
end = 15
[[probe]]
name = "stress"
largest = "von_mises"
box = [[-1, 0.5], [2, 1.5]]
truth = 0.272848
[[probe]]
name = "width"
extent = "x"
truth = 0.88687
[[probe]]
name = "corner"
at = [1, 2]
)toml";

const std::string two_squares = R"(
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Rectangle(2) = {1.5, 0, 0, 1, 1};
Physical Surface("left") = {1};
Physical Surface("right") = {2};
)";

/// What `efree compare` makes of a case.
nlohmann::json compared(const Workspace& work, const std::vector<std::string>& options) {
  std::vector<std::string> arguments{"compare", "case.toml", "--out", "out", "--quiet"};
  arguments.insert(arguments.end(), options.begin(), options.end());
  const auto run = work.efree(arguments);
  EXPECT_EQ(run.status, 0) << run.output;
  return json(work / "out/comparison.json");
}

TEST(Comparison, EveryMethodComesCloseToTheTruthAndTheSameOnAnyNumberOfThreads) {
  const Workspace work;
  work.write("case.toml", stretched);
  const auto found = compared(
      work, {"--resolutions", "2", "--threads", "2", "--methods", "otm,total_lagrangian,mpm,mpm_total,mpm_mesh"});
  ASSERT_EQ(found["runs"].size(), 10U);
  EXPECT_EQ(found["references"]["stress"]["given"], true);
  EXPECT_NEAR(found["references"]["corner"]["value"][1].get<double>(), 0.3, 0.01);
  std::map<std::string, int> runs;
  for (const auto& run : found["runs"]) {
    EXPECT_FALSE(run.contains("failure")) << run;
    EXPECT_LT(run["energy_error"], 0.01) << run;
    const bool fine = ++runs[run["method"]] == 2;
    EXPECT_NEAR(run["spacing"].get<double>(), fine ? 0.2 : 0.2 * std::sqrt(2.0), 1e-12);
    // Stress is one everywhere: moving least squares hold it, meshes and new grids do so on average.
    const std::string method = run["method"];
    const auto [stress, width] = method == "total_lagrangian" ? std::pair(1e-3, 1e-3)
                                 : method == "mpm_total"      ? std::pair(0.08, 0.02)
                                 : method == "otm"            ? std::pair(0.25, 0.01)
                                                              : std::pair(0.35, 0.08);
    EXPECT_LT(run["probes"]["stress"]["error"], stress) << run;
    EXPECT_LT(run["probes"]["width"]["error"], width) << run;
  }
  EXPECT_EQ(runs.size(), 5U);
  const std::string csv = content(work / "out/comparison.csv");
  EXPECT_THAT(csv, HasSubstr("\"error of width\""));
  EXPECT_EQ(std::ranges::count(csv, '\n'), 11);
  for (const char* chart : {"probes.svg", "probes.png", "energy.svg", "energy.png"})
    EXPECT_TRUE(fs::exists(work / "out" / chart)) << chart;
  const auto serial = compared(work, {"--resolutions", "2", "--threads", "1", "--methods", "mpm"});
  for (std::size_t k = 0; k < 2; ++k)
    for (const char* probe : {"stress", "width", "corner"})
      EXPECT_EQ(serial["runs"][k]["probes"][probe]["value"], found["runs"][4 + k]["probes"][probe]["value"]);
}

TEST(Comparison, ParticlesInTheReferenceConfigurationComeClosestAndCoarseOnesSayWhyTheyDoNotBegin) {
  const Workspace work;
  work.write("case.toml", replaced(stretched, "mesh_size = 0.17", "mesh_size = 0.085"));
  const auto found = compared(work, {"--resolutions", "1", "--methods", "sph,sph_total"});
  ASSERT_EQ(found["runs"].size(), 2U);
  for (const auto& run : found["runs"]) EXPECT_FALSE(run.contains("failure")) << run;
  const auto error = [&](std::size_t run) { return found["runs"][run]["probes"]["width"]["error"].get<double>(); };
  EXPECT_LT(error(1), 0.04);
  EXPECT_LT(error(1), error(0));
  work.write("case.toml", replaced(stretched, "mesh_size = 0.17", "mesh_size = 0.3"));
  const auto coarse = compared(work, {"--resolutions", "1", "--methods", "mpm_total,sph"});
  EXPECT_THAT(coarse["runs"][1]["failure"].get<std::string>(), HasSubstr("Expected a tenth of that, or less"));
}

TEST(Comparison, MethodsThatCannotRunASceneSayWhy) {
  const Workspace work;
  work.write("squares.geo", two_squares);
  work.write("case.toml", replaced(replaced(stretched.substr(0, stretched.find("[[velocity]]")),
                                            "shape = \"rectangle\"\nparameters = { width = 1, height = 2 }",
                                            "file = \"squares.geo\""),
                                   "density = 1\n", "density = 1\n[time]\nend = 0.1\n"));
  const auto found = compared(work, {"--resolutions", "1", "--methods", "otm,total_lagrangian"});
  EXPECT_FALSE(found["runs"][0].contains("failure"));
  EXPECT_THAT(found["runs"][1]["failure"].get<std::string>(), HasSubstr("pass through each other"));
}

TEST(Comparison, RunsThatFailSayHowFarTheyCameAndLeaveNoOldCharts) {
  const Workspace work;
  work.write("case.toml", replaced(stretched, "end = 15", "end = 1"));
  compared(work, {"--resolutions", "1", "--methods", "mpm"});
  EXPECT_TRUE(fs::exists(work / "out/probes.png"));
  work.write("case.toml", stretched);
  const auto run = work.efree({"compare", "case.toml", "--out", "out", "--quiet", "--resolutions", "1", "--methods",
                               "otm,mpm", "--time-limit", "1e-9"});
  EXPECT_EQ(run.status, 3) << run.output;
  EXPECT_THAT(run.output, HasSubstr("no run came to its end"));
  const auto found = json(work / "out/comparison.json");
  for (const auto& one : found["runs"]) {
    EXPECT_EQ(one["steps"], 1);
    EXPECT_THAT(one["failure"].get<std::string>(), HasSubstr("the time limit of 1e-09 s ended the run at time"));
    EXPECT_THAT(one["failure"].get<std::string>(), Not(HasSubstr("--resume")));
  }
  EXPECT_FALSE(fs::exists(work / "out/probes.png"));
}

TEST(Comparison, InputWithWhichNothingCanBeComparedIsRefused) {
  const Workspace work;
  const auto refused = [&](const std::string& text, const std::vector<std::string>& options) {
    work.write("case.toml", text);
    std::vector<std::string> arguments{"compare", "case.toml", "--out", "out", "--quiet"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const auto run = work.efree(arguments);
    EXPECT_EQ(run.status, 2) << run.output;
    return run.output;
  };
  EXPECT_THAT(refused(stretched, {"--methods", "otm,fem"}), HasSubstr("no method \"fem\" to compare; there are otm"));
  EXPECT_THAT(refused(stretched, {"--methods", "otm,otm"}), HasSubstr("\"otm\" is given twice"));
  EXPECT_THAT(refused(stretched, {"--resolutions", "0"}), HasSubstr("--resolutions"));
  EXPECT_THAT(refused(replaced(stretched, "mesh_size = 0.17\n", ""), {}), HasSubstr("add mesh_size to [geometry]"));
  EXPECT_THAT(refused(replaced(stretched, "on = \"top\"", "on = \"topp\""), {}), HasSubstr("topp"));
  EXPECT_THAT(refused(replaced(stretched, "at = [1, 2]", "at = [1, 2]\ntruth = 1"), {}),
              HasSubstr("truth is of a single number"));
  work.write("strip.geo", strip_geo);
  EXPECT_THAT(refused(strip_case, {}), HasSubstr("this case is static"));
  EXPECT_FALSE(fs::exists(work / "out"));
}

}  // namespace
}  // namespace efree::test
