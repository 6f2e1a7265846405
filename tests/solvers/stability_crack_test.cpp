// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: slits, thin ligaments, re-entrant corners.
#include "efree/bench/edge_crack.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using namespace bench;

TEST(StabilityCrack, NoFunctionReachesThroughASlitPastAThinLigamentOrAroundACorner) {
  constexpr double H = 0.1, support = (1.0 + 1e-12) * 2.5 * H;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const ApproximationOptions options{.spacing = H, .seed = seed};
    const auto expect_none = [&](const Approximation<2>& approximation, const auto& corner) {
      const Leak leak(approximation, approximation.mls.largest_growth * support, corner);
      EXPECT_GT(leak.checked, 50);
      EXPECT_EQ(leak.pairs, 0) << leak.largest;
    };
    const EdgeCrack plate;
    const auto cracked = approximate(plate.mesh(H / 6.0), options);
    expect_none(cracked, CutAlongAxis(cracked.space, plate.length, 2.0));
    const Ligament thin{0.4 * H};
    const auto ligament = approximate(thin.mesh(H / 6.0), options);
    expect_none(ligament, CutAlongAxis(ligament.space, thin.left(), thin.right()));
    const auto corner = approximate(triangulate(shapes::l_shape(1.0), {.size = H / 6.0}), options);
    expect_none(corner, NotchOfL{corner.space});
  }
}

TEST(StabilityCrack, StressIntensityIsWithinThreePercentOfTheHandbook) {
  const EdgeCrack plate;
  const FineMesh<2> mesh = plate.mesh(plate.length / 30.0);
  for (std::uint64_t seed = 1; seed <= 2; ++seed)
    for (const double outer : {0.2, 0.4})
      EXPECT_NEAR(plate.stress_intensity(analyse(mesh, plate.settings(0.1, seed)), 0.1, outer) / plate.handbook(), 1.0,
                  0.03)
          << "cloud " << seed;
}

}  // namespace
}  // namespace efree
