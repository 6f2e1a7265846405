// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: pressures of nearly incompressible bodies.
#include "efree/bench/pressures.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using namespace bench;

/// Of the answer at the defaults, which corrections towards elements end at, and of the cloud alone.
TEST(StabilityPressure, MeanStressOfAThickTubeIsConstant) {
  const FineMesh<2> mesh = triangulate(Tube::domain(0.03), {.size = 0.03});
  for (const double nu : {0.499, 0.4999}) {
    const Tube tube{nu};
    Settings<2> settings = tube.settings();
    settings.common.approximation.spacing = 0.12;
    EXPECT_LT(Swing(analyse(mesh, settings), tube.mean_stress()).mean, 0.01) << nu;
    settings.estimated = settings.corrected = false;
    EXPECT_LT(Swing(analyse(mesh, settings), tube.mean_stress()).mean, 0.03) << nu;
  }
}

/// Over H, H/2, H/4. Constant pressures, half a patch to a node, have 0.42 to 0.66 here.
TEST(StabilityPressure, InfSupValueOfPatchesStaysAboveOneHalfHoweverFineTheCloud) {
  const Materials<2> materials({LinearElastic(1.0, 0.0)}, Plane::strain);
  for (const double H : {0.2, 0.1, 0.05}) {
    const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 6.0});
    for (const auto secondary : {SecondaryKind::cells, SecondaryKind::linear})
      for (std::uint64_t seed = 1; seed <= 3; ++seed)
        EXPECT_GT(
            inf_sup(approximate(
                        mesh, {.spacing = H, .seed = seed, .secondary = secondary, .dilatation = Dilatation::averaged}),
                    materials),
            0.5)
            << "H " << H << ", cloud " << seed;
  }
}

}  // namespace
}  // namespace efree
