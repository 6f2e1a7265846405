// SPDX-License-Identifier: GPL-3.0-or-later
/// Cases of explicit dynamics with regions that touch, by every method, or shall.
#include "efree/tests/io/dynamics_cases.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree {
namespace {

using test::json, test::refuses, test::replaced, test::says, test::Workspace;
using ::testing::HasSubstr, ::testing::Not;

/// Two halves of a strip that fly apart, and a block that flies ahead of them.
const std::string halves = R"toml(title = "halves"
[geometry]
file = "halves.geo"
mesh_size = 0.1
[analysis]
kind = "dynamics"
plane = "strain"
METHOD
[material]
model = "neo_hookean"
E = 1
nu = 0.3
density = 1
[[velocity]]
region = "left"
value = [-0.005, 0]
[[velocity]]
region = "right"
value = [0.005, 0]
[[velocity]]
region = "ahead"
value = [0.01, 0]
[[probe]]
name = "left"
region = "left"
largest = "x"
[[probe]]
name = "right"
region = "right"
smallest = "x"
[time]
end = 2
[output]
frames = 0
)toml";

struct Halves : Workspace {
  explicit Halves(const std::string& method) : Workspace(replaced(halves, "METHOD", method)) {
    std::ofstream(*this / "halves.geo") << R"geo(SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 0.5};
Rectangle(2) = {1, 0, 0, 1, 0.5};
Rectangle(3) = {2.2, 0, 0, 1, 0.5};
Coherence;
Physical Surface("left") = {1};
Physical Surface("right") = {2};
Physical Surface("ahead") = {3};
)geo";
  }
};

TEST(TiedCase, RegionsThatTouchStayTogetherByMethodsThatTieThem) {
  for (const char* method : {"", "[mpm]\ncell = 0.1", "[mpm]\ncell = 0.2\nframe = \"mesh\"", "[sph]\nspacing = 0.05"}) {
    const Halves work(method);
    const auto run = work.efree({"run", "case.toml", "--out", "out", "--no-picture"});
    ASSERT_EQ(run.status, 0) << method << run.output;
    EXPECT_THAT(run.output, HasSubstr("regions that touch are tied")) << method;
    const auto probes = json(work / "out/result.json")["probes"];
    EXPECT_LT(probes["right"].get<double>() - probes["left"].get<double>(), 0.002) << method;
  }
}

TEST(TiedCase, RegionsPartByMethodsThatDoNotTieThemAndThatIsWarnedOf) {
  for (const auto& [method, is_asked] :
       {std::pair("[contact]\ntie = false", true), std::pair("[mpm]\ncell = 0.1\n[contact]\ntie = false", true),
        std::pair("[mpm]\ncell = 0.1\nframe = \"total\"", false)}) {
    const Halves work(method);
    const auto run = work.efree({"run", "case.toml", "--out", "out", "--no-picture"});
    ASSERT_EQ(run.status, 0) << method << run.output;
    EXPECT_THAT(run.output, Not(HasSubstr("regions that touch are tied"))) << method;
    EXPECT_EQ(run.output.find("Regions are not tied to each other") == std::string::npos, is_asked) << method;
    const auto probes = json(work / "out/result.json")["probes"];
    EXPECT_GT(probes["right"].get<double>() - probes["left"].get<double>(), 0.015) << method;
  }
}

TEST(TiedCase, ParticlesOfBodiesThatMeetAreAsOneSoContactIsRefused) {
  const Halves work("[sph]\nspacing = 0.05\n[contact]\ntie = false");
  const auto run = work.efree({"run", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, HasSubstr("case.toml:11: tie means nothing for smoothed particles"));
}

/// Two blocks, one in the other by a tenth of an edge.
TEST(TiedCase, OverlapsAreRefusedWithWhatClosesThemAndThenNothingMoves) {
  std::string text = replaced(halves, "METHOD\n", "");
  text = replaced(replaced(text, "mesh_size = 0.1", "mesh_size = 0.2"), "plane = \"strain\"\n", "");
  text = text.substr(0, text.find("[[velocity]]")) + "[time]\nend = 1\n[output]\nframes = 0\n";
  const auto run = [&](const std::string& more, int status) {
    const Workspace work(text + more);
    std::ofstream(work / "halves.geo") << R"geo(SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 0.5};
Box(2) = {0.2, 0.2, 0.48, 0.5, 0.5, 0.5};
Physical Volume("left") = {1};
Physical Volume("right") = {2};
)geo";
    const auto done = work.efree({"run", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(done.status, status) << done.output;
    if (status == 0) {
      const auto result = json(work / "out/result.json");
      const auto energy = result["energy"];
      // The later one loses the overlap of 0.02, of 0.5.
      EXPECT_EQ(result["by_region"]["left"]["volume_change_percent"], 0.0);
      EXPECT_NEAR(result["by_region"]["right"]["volume_change_percent"].get<double>(), -4.0, 0.01);
      EXPECT_THAT(result["reports"]["warnings"].dump(),
                  HasSubstr("contact.close has changed the volume of \\\"right\\\" (-4 %)"));
      EXPECT_LT(energy["kinetic"].get<double>() + energy["stored"].get<double>(), 1e-20);
    }
    return done.output;
  };
  EXPECT_THAT(run("", 2), HasSubstr("close overlaps by contact.close = 0.022"));
  EXPECT_THAT(run("[contact]\nclose = 0.022\n", 0), HasSubstr("gaps and overlaps between regions are closed: "));
  EXPECT_THAT(run("[contact]\nclose = 0.01\n", 2), HasSubstr("close overlaps by contact.close = 0.022"));
  EXPECT_THAT(run("[contact]\nclose = 0.022\nenabled = false\n", 2), HasSubstr("close is for bodies in contact"));
  EXPECT_THAT(run("[contact]\nclose = -1\n", 2), HasSubstr("close is -1, expected a number > 0"));
}

}  // namespace
}  // namespace efree
