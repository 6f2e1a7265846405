// SPDX-License-Identifier: GPL-3.0-or-later
/// What results say of regions and bodies.
#include "efree/tests/io/dynamics_cases.hpp"

#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using test::json, test::rubber, test::run, test::Workspace;

/// Stresses are y - 1/2 along x, so that as much of the area has each size.
TEST(RegionRecords, OfAStripInBendingHaveItsAreaMassPeaksAndQuantiles) {
  const Workspace workspace;
  const auto done = run(workspace, R"([geometry]
shape = "rectangle"
parameters = { width = 4, height = 1 }
mesh_size = 0.1
[basis]
kind = "p2"
[analysis]
plane = "stress"
[material]
E = 1
nu = 0.3
density = 2
[[boundary]]
on = "left"
displacement = [0, "-0.15 * (y - 0.5)^2"]
[[boundary]]
on = "right"
traction = ["y - 0.5", 0]
)");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto regions = json(workspace / "out/result.json")["by_region"];
  ASSERT_EQ(regions.size(), 1u);
  const auto& of = regions.front();
  EXPECT_NEAR(of["area"], 4.0, 1e-9);
  EXPECT_NEAR(of["mass"], 8.0, 1e-9);
  EXPECT_NEAR(of["von_mises"], 0.5, 1e-6);
  EXPECT_NEAR(std::abs(of["von_mises_at"][1].get<double>() - 0.5), 0.5, 1e-9);
  EXPECT_NEAR(of["principal_stress"][0], -0.5, 1e-6);
  EXPECT_NEAR(of["principal_stress"][1], 0.5, 1e-6);
  for (const auto& [percent, share] : {std::pair("50", 0.5), {"90", 0.9}, {"99", 0.99}})
    EXPECT_NEAR(of["von_mises_quantiles"][percent], 0.5 * share, 0.02) << percent;
}

TEST(RegionRecords, OfBodiesInMotionHaveTheirMassAndSharesOfEnergies) {
  const Workspace workspace;
  const auto done = run(workspace, rubber);
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  ASSERT_EQ(result["by_region"].size(), 1u);
  const auto& of = result["by_region"].front();
  EXPECT_NEAR(of["volume"], 2.0, 1e-9);
  EXPECT_NEAR(of["mass"], 2.0, 1e-9);
  EXPECT_EQ(of["von_mises"], result["extremes"]["von_mises"]["max"]["value"]);
  EXPECT_LE(of["von_mises_quantiles"]["50"], of["von_mises_quantiles"]["99.9"]);
  EXPECT_LE(of["von_mises_quantiles"]["99.9"], of["von_mises"]);
  double all = 0.0;
  for (const auto& [name, fraction] : result["energy"]["fractions"].items()) all += std::abs(fraction.get<double>());
  EXPECT_NEAR(all, 1.0, 1e-12);
}

}  // namespace
}  // namespace efree
