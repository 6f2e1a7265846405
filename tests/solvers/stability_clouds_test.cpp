// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: bad triangulations and random clouds.
#include "efree/bench/bad_meshes.hpp"
#include "efree/bench/cook.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using namespace bench;

/// Largest less smallest, over the mean.
double spread(const std::vector<double>& values) {
  const auto [least, most] = std::ranges::minmax(values);
  return (most - least) * static_cast<double>(values.size()) / std::accumulate(values.begin(), values.end(), 0.0);
}

TEST(StabilityClouds, AnswersOfTwentyCloudsOnFourMeshesOfAPlateAreWithinOnePercent) {
  constexpr double H = 0.4;
  std::vector<double> displacements, energies;
  std::uint64_t seed = 1;
  for (const char* how : {"regular", "jittered", "slivers", "needles"}) {
    const FineMesh<2> mesh = careless(how, shapes::quarter_plate_with_hole(1.0, 4.0, H / 6.0), H / 6.0);
    for (int k = 0; k < 5; ++k) {
      const auto result =
          analyse(mesh, Settings<2>{.common = {.model = {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                                               .approximation = {.spacing = H, .seed = seed++}},
                                    .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                                    .loads = {.tractions = {tension<2>("right", 1.0)}},
                                    .probes = {{"hole", {1.0, 0.0}}}});
      displacements.push_back(result.probes[0].second.displacement.x());
      energies.push_back(result.solution.strain_energy);
    }
  }
  EXPECT_LT(spread(displacements), 0.01);
  EXPECT_LT(spread(energies), 0.01);
}

TEST(StabilityClouds, AnswersOfNearlyIncompressibleMembranesAreWithinOnePercent) {
  std::vector<double> tips;
  std::uint64_t seed = 1;
  for (const char* how : {"regular", "slivers"})
    for (int k = 0; k < 2; ++k) {
      Settings<2> settings = Cook{0.4999}.settings();
      settings.common.approximation = {.spacing = 4.8, .seed = seed++};
      tips.push_back(Cook::tip(careless(how, shapes::cook(), 4.8 / 4.0), settings));
    }
  EXPECT_LT(spread(tips), 0.01);
}

}  // namespace
}  // namespace efree
