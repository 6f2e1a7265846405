// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads, ties and rest of explicit dynamics, from case files to results.
#include "efree/tests/io/dynamics_cases.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <filesystem>

namespace efree {
namespace {

using test::column, test::json, test::refuses, test::replaced, test::rubber, test::run, test::says, test::with,
    test::without, test::Workspace;
using testing::HasSubstr;

/// The strip, with more lines at its end.
std::string and_also(const std::string& more) {
  return rubber + more;
}

/// Sections that choose a method and its resolution, for the strip of 2 by 1.
const std::string all_methods[] = {"",
                                   "[cloud]\nspacing = 0.3\n",
                                   "[mpm]\ncell = 0.2\n",
                                   "[mpm]\ncell = 0.2\nframe = \"total\"\n",
                                   "[mpm]\ncell = 0.25\nframe = \"mesh\"\n",
                                   "[sph]\nspacing = 0.1\n",
                                   "[sph]\nspacing = 0.1\nframe = \"total\"\n"};

TEST(LoadsCase, WrongLoadsAreRefusedWithFileAndLine) {
  const auto boundary = [](const std::string& more) { return refuses(and_also("[[boundary]]\n" + more + "\n")); };
  EXPECT_THAT(boundary("on = \"left\""), says("exactly one of velocity, displacement, traction"));
  EXPECT_THAT(boundary("on = \"left\"\ntraction = [1, 0]\npressure = 1"), says("has traction and pressure"));
  EXPECT_THAT(boundary("on = \"left\"\ntraction = [1]"), says("expected an array of 2"));
  EXPECT_THAT(boundary("on = \"lift\"\npressure = 1"), says("lift"));
  EXPECT_THAT(boundary("on = \"left\"\npressure = \"log(\""), says("log("));
  EXPECT_THAT(boundary("on = \"left\"\nforce = [\"y\", 0]"), says("expected an expression of the time t alone"));
  EXPECT_THAT(boundary("on = \"left\"\nstiffness = -1"), says("stiffness"));
  EXPECT_THAT(boundary("on = \"left\"\ndamping = [0, 0]"), says("one that is not zero"));
  EXPECT_THAT(boundary("on = \"left\"\ntraction = [1, 0]\nfollower = true"), says("follower is for a pressure"));
  EXPECT_THAT(boundary("on = \"left\"\ndamping = 1\nramp = [[0, 0], [1, 1]]"), says("ramp means nothing for damping"));
  EXPECT_THAT(boundary("on = \"left\"\npressure = 1\nramp = [[1, 0], [1, 1]]"), says("in the order of the times"));
  EXPECT_THAT(boundary("on = \"left\"\ndisplacement = [\"free\", \"free\"]"), says("every component"));
  EXPECT_THAT(refuses(replaced(and_also("[sph]\nspacing = 0.1\nsplitting = { strain = 0.1 }\n[[boundary]]\non = "
                                        "\"left\"\npressure = 1\n"),
                               "mesh_size = 0.25", "mesh_size = 0.1")),
              says("not for particles that split"));
  EXPECT_THAT(refuses(and_also("[relaxation]\nfrom = 5\n")), says("from"));
  EXPECT_THAT(refuses(and_also("[start]\nstatic = false\nspin = 1\n")), says("without a static start"));
  EXPECT_THAT(refuses(and_also("[mpm]\ncell = 0.5\n[start]\nstatic = true\n")), says("nodes that stay"));
}

TEST(LoadsCase, ForcesAndPressuresMoveABodyByTheirImpulse) {
  // Up by a force that grows, to the right by a pressure.
  const std::string pushed = replaced(and_also(R"toml([[boundary]]
on = "bottom"
force = [0, 0.2]
ramp = [[0, 0], [2, 1]]
[[boundary]]
on = "left"
pressure = "1e-3*t"
)toml"),
                                      "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", "");
  for (const std::string& method : all_methods) {
    const Workspace workspace;
    const auto done =
        run(workspace,
            replaced(pushed, "mesh_size = 0.25", method.empty() ? "mesh_size = 0.25" : "mesh_size = 0.1") + method);
    ASSERT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    // Mass 2, velocity -0.2; int 0.2 ramp dt = 0.2 (1 + 2); int 1e-3 t dt = 8e-3 on a side of about 1. Momenta are
    // those of half a step ago.
    const double dt = result["stable_step"].get<double>();
    EXPECT_NEAR(result["momentum"][1].get<double>(), -0.4 + 0.6 - 0.1 * dt, 0.05 * dt) << method;
    EXPECT_NEAR(result["momentum"][0].get<double>(), 8e-3, 0.15 * 8e-3) << method;
    EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 5e-3) << method;
    EXPECT_EQ(column(workspace / "out/history.csv", "loads").back(), result["energy"]["loads"].get<double>());
  }
}

/// Of a body that begins at rest with its centre at x = 1, in the field -0.01 (x - 3) (1 + t); the trapezoidal rule.
double speed_of_centre(double time) {
  constexpr int steps = 10000;
  const double dt = time / steps;
  double x = 1.0, v = 0.0;
  for (int k = 0; k < steps; ++k) {
    const double before = 0.5 * dt * v;
    v -= 0.01 * dt * (x + before - 3.0) * (1.0 + (k + 0.5) * dt);
    x += before + 0.5 * dt * v;
  }
  return v;
}

TEST(LoadsCase, GravityByPlaceAndTimePullsABodyByAllMethods) {
  const std::string pulled =
      replaced(replaced(replaced(rubber, "[analysis]", "[analysis]\ngravity = [\"-0.01*(x - 3)*(1 + t)\", 0]"),
                        "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", ""),
               "\"-0.2\"", "0");
  for (const std::string& method : all_methods) {
    SCOPED_TRACE(method);
    const Workspace workspace;
    const auto done = run(workspace, replaced(pulled, "mesh_size = 0.25", "mesh_size = 0.125") + method);
    ASSERT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    const double dt = result["stable_step"].get<double>();
    // Momenta are those of half a step ago, and the last step may be shorter.
    EXPECT_NEAR(result["momentum"][0].get<double>(), 2.0 * speed_of_centre(4.0 - 0.5 * dt), 5e-3);
    EXPECT_NEAR(result["momentum"][1].get<double>(), 0.0, 1e-6);
    EXPECT_NEAR(result["energy"]["gravity"].get<double>(), std::pow(speed_of_centre(4.0), 2), 5e-4);
    EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 5e-3);
    EXPECT_EQ(column(workspace / "out/history.csv", "gravity").back(), result["energy"]["gravity"].get<double>());
  }
}

TEST(LoadsCase, APrescribedDisplacementIsWhereItSays) {
  const Workspace workspace;
  const auto done = run(workspace, replaced(and_also(R"toml([[boundary]]
on = "top"
displacement = ["0.1*(1 - cos(t))", "0.02*t*t"]
)toml"),
                                            "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", ""));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto probes = json(workspace / "out/result.json")["probes"];
  EXPECT_NEAR(probes["corner"]["displacement"][0].get<double>(), 0.1 * (1.0 - std::cos(4.0)), 1e-4);
  EXPECT_NEAR(probes["corner"]["displacement"][1].get<double>(), 0.02 * 16.0, 1e-4);
}

TEST(LoadsCase, AKinkInAPrescribedDisplacementIsNotMissed) {
  const Workspace workspace;
  const auto done = run(workspace, replaced(and_also(R"toml([[boundary]]
on = "top"
displacement = [0, 0.3]
ramp = [[0, 0], [0.51, 1], [1.03, 0], [1.49, 1]]
)toml"),
                                            "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", ""));
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_NEAR(json(workspace / "out/result.json")["probes"]["corner"]["displacement"][1].get<double>(), 0.3, 1e-12);
  EXPECT_THAT(refuses(and_also("[[boundary]]\non = \"top\"\ndisplacement = [0, 0.5]\n")),
              says("is 0.5 at the start, expected 0: take a ramp"));
}

TEST(LoadsCase, DampersHaveTheirTerminalVelocityByAllMethods) {
  // A block, 2 by 1 of density 1, under a force of 0.02 on its top against dampers of 0.1 on its bottom.
  for (const std::string& method : all_methods) {
    const Workspace workspace;
    std::string text = replaced(and_also(R"toml([[boundary]]
on = "bottom"
damping = 1
[[boundary]]
on = "top"
force = [0, 0.02]
)toml"),
                                "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", "");
    text = replaced(replaced(replaced(text, "end = 4", "end = 40"), "\"-0.2\"", "0"), "mesh_size = 0.25",
                    method.empty() ? "mesh_size = 0.25" : "mesh_size = 0.1");
    const auto done = run(workspace, text + method);
    ASSERT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    EXPECT_NEAR(result["momentum"][1].get<double>(), 2.0 * 0.01, 3e-4) << method;
    EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 5e-3) << method;
  }
}

TEST(LoadsCase, AStripAtRestUnderATractionHasItsStretchByAllMethods) {
  // Plane strain: 2 p (1 - nu^2) / E. Points and particles are held up to a cell or spacing from the left side.
  constexpr double stretch = 2.0 * 2e-3 * 0.91;
  const std::string pulled = replaced(replaced(replaced(and_also(R"toml([relaxation]
[[boundary]]
on = "left"
velocity = [0, "free"]
[[boundary]]
on = "right"
traction = [2e-3, 0]
[[probe]]
name = "end"
at = [2, 0.5]
)toml"),
                                                        "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", ""),
                                               "\"-0.2\"", "0"),
                                      "end = 4", "end = 400");
  for (const std::string& method : all_methods) {
    SCOPED_TRACE(method);
    const bool is_sph = method.find("sph") != std::string::npos, is_mpm = method.find("mpm") != std::string::npos,
               is_fixed = method.find("total") != std::string::npos;
    const Workspace workspace;
    const auto done = run(workspace, replaced(pulled, "mesh_size = 0.25", "mesh_size = 0.1") + method +
                                         (is_sph && !is_fixed ? "corrected = true\n" : ""));
    ASSERT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    EXPECT_TRUE(result["relaxation"]["at_rest"].get<bool>());
    EXPECT_NEAR(result["probes"]["end"]["displacement"][0].get<double>(), stretch,
                (is_sph || is_mpm ? 0.1 : 0.02) * stretch);
    EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
    EXPECT_GT(result["energy"]["loads"].get<double>(), 0.0);
  }
}

TEST(LoadsCase, LoadsOnAnEndThatBreaksStayInTheBalance) {
  const Workspace workspace;
  const auto done = run(workspace, replaced(and_also(R"toml([[boundary]]
on = "top"
traction = [0, 0.3]
ramp = [[0, 0], [1, 1]]
[[fracture]]
spall = 0.03
)toml"),
                                            "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", ""));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_GT(result["counts"]["eroded_points"].get<int>(), 5);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
}

TEST(LoadsCase, ForcesOfContactAreMeansBetweenLinesAndTheirPeakIsInTheResult) {
  const Workspace workspace;
  const auto done = run(workspace, rubber);
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  const auto& contact = result["contacts"][0];
  EXPECT_EQ(contact["with"], "wall.0");
  EXPECT_NEAR(contact["impulse"][1].get<double>(), result["momentum"][1].get<double>() + 0.4, 1e-12);
  const auto t = column(workspace / "out/history.csv", "t"),
             force = column(workspace / "out/history.csv", "contact.body.wall.0.force.y");
  double impulse = 0.0;
  for (std::size_t k = 1; k < t.size(); ++k) impulse += force[k] * (t[k] - t[k - 1]);
  EXPECT_NEAR(impulse, contact["impulse"][1].get<double>(), 1e-12);
  EXPECT_EQ(*std::ranges::max_element(force), contact["peak_force"]["force"][1].get<double>());
  EXPECT_LT(contact["peak_force"]["from"].get<double>(), contact["peak_force"]["to"].get<double>());
}

TEST(LoadsCase, ARunEndsWhenBodiesAreAtRest) {
  const Workspace workspace;
  const std::string rests = replaced(replaced(with("level = -0.1", "level = -1e-3"), "[analysis]",
                                              "[relaxation]\n[analysis]\ngravity = [0, \"-0.01*min(t, 1)\"]"),
                                     "end = 4", "end = 400");
  const auto done = run(workspace, replaced(rests, "\"-0.2\"", "0"));
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr("at rest at time"));
  const auto result = json(workspace / "out/result.json");
  EXPECT_TRUE(result["relaxation"]["at_rest"].get<bool>());
  EXPECT_LT(result["time"].get<double>(), 200.0);
  EXPECT_LT(result["energy"]["kinetic"].get<double>(), 1e-2 * result["energy"]["stored"].get<double>());
  const auto soon = run(workspace, replaced(replaced(rests, "\"-0.2\"", "0"), "end = 400", "end = 4"));
  ASSERT_EQ(soon.status, 0) << soon.output;
  EXPECT_THAT(soon.output, HasSubstr("Bodies are not at rest at the end"));
}

TEST(LoadsCase, ASealIsPressedFlatAndItsInnerSidesTouchAtRest) {
  const Workspace workspace;
  const std::string given = test::content(std::filesystem::path(EFREE_EXAMPLES) / "rubber/seal.toml");
  const auto done =
      run(workspace, replaced(replaced(given, "mesh_size = 0.4e-3", "mesh_size = 0.8e-3"), "frames = 8", "frames = 0"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_TRUE(result["relaxation"]["at_rest"].get<bool>());
  EXPECT_NEAR(result["probes"]["height"].get<double>(), 3.5e-3, 2e-5);
  // Two walls of 2 mm in 3.5 mm: they are pressed on each other, with the same force on both plates.
  const auto peak = [&](int k) { return result["contacts"][k]["peak_force"]["value"].get<double>(); };
  EXPECT_NEAR(peak(0), 1.37e4, 0.1 * 1.37e4);
  EXPECT_NEAR(peak(1), peak(0), 0.02 * peak(0));
  EXPECT_GT(result["energy"]["friction"].get<double>(), 0.0);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
}

TEST(LoadsCase, ARunStartsAtRestUnderItsWeight) {
  const Workspace workspace;
  const std::string held =
      replaced(and_also("[start]\nstatic = true\n[[boundary]]\non = \"bottom\"\nvelocity = [0, 0]\n"),
               "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", "");
  const auto done =
      run(workspace, replaced(replaced(held, "\"-0.2\"", "0"), "[analysis]", "[analysis]\ngravity = [0, -0.01]"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto height = column(workspace / "out/history.csv", "probe.height");
  const auto [low, high] = std::ranges::minmax_element(height);
  EXPECT_LT(*high, 0.997);
  EXPECT_LT(*high - *low, 1e-4 * (1.0 - *low));
}

}  // namespace
}  // namespace efree
