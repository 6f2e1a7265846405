// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: the surface of a compressed body wrinkles where it should, and not before.
#include "efree/bench/compressed_block.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using bench::CompressedBlock;

TEST(StabilitySurface, ClosedFormOfTheHalfSpaceTendsToThatOfBiot) {
  EXPECT_NEAR(CompressedBlock{0.4999999}.critical(), CompressedBlock::incompressible, 1e-6);
  const double l2 = CompressedBlock::incompressible * CompressedBlock::incompressible;
  EXPECT_NEAR(l2 * l2 * l2 + l2 * l2 + 3.0 * l2, 1.0, 1e-5);
}

TEST(StabilitySurface, HomogeneousStateIsInBalance) {
  const CompressedBlock block;
  const FineMesh<2> mesh = CompressedBlock::mesh(0.05);
  const auto approximation = block.approximation(mesh, {.spacing = 0.25});
  const NonlinearEquilibrium<2> equations(approximation, block.model(BasisKind::mls), CompressedBlock::program());
  EXPECT_LT(equations.residual(block.at(equations, 0.6)).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(StabilitySurface, FirstZeroEigenvalueIsWithinThreePercentOnFiveCloudsOfARubberThatYields) {
  constexpr double spacing = 0.1;
  const FineMesh<2> mesh = CompressedBlock::mesh(spacing / 6.0);
  for (const double nu : {0.3, 0.39}) {
    const CompressedBlock block{nu};
    for (std::uint64_t seed = 1; seed <= 5; ++seed)
      EXPECT_NEAR(block.first_zero(block.approximation(mesh, {.spacing = spacing, .seed = seed})) / block.critical(),
                  1.0, 0.03)
          << "nu " << nu << ", cloud " << seed;
  }
}

TEST(StabilitySurface, FirstZeroEigenvalueIsWithinThreePercentOnFiveCloudsOfANearlyIncompressibleRubber) {
  constexpr double spacing = 0.0833;
  const FineMesh<2> mesh = CompressedBlock::mesh(spacing / 6.0);
  const CompressedBlock block;
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    EXPECT_NEAR(block.first_zero(block.approximation(mesh, {.spacing = spacing, .seed = seed})) / block.critical(), 1.0,
                0.03)
        << "cloud " << seed;
}

}  // namespace
}  // namespace efree
