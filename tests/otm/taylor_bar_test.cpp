// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/taylor_bar.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

namespace efree {
namespace {

using bench::TaylorBar;

/// The bands are those of published computations, which differ by as much (docs/evidence.md).
TEST(TaylorBar, AxisymmetricBarEndsInTheBandsWithItsEnergyAccounted) {
  auto otm = TaylorBar::bar<2>(TaylorBar::mesh<2>(0.8e-3), 227.0, {});
  const auto before = otm.balance();
  EXPECT_NEAR(before.kinetic, 239.81, 0.01);
  otm.run(80e-6);
  const auto shape = TaylorBar::shape(otm);
  EXPECT_GT(shape.length, 21.4e-3);
  EXPECT_LT(shape.length, 21.7e-3);
  EXPECT_GT(shape.foot, 6.9e-3);
  EXPECT_LT(shape.foot, 7.3e-3);
  const auto after = otm.balance();
  EXPECT_NEAR(after.total(), before.total(), 0.005 * before.total());
  EXPECT_GT(after.dissipated, 0.93 * before.kinetic);
  EXPECT_LT(after.renewal + after.contact, 0.05 * before.kinetic);
  const Tensors F = otm.deformation();
  for (Index p = 0; p < otm.num_points(); ++p)
    EXPECT_NEAR(Eigen::Map<const Mat<3>>(F.col(p).data()).determinant(), 1.0, 0.5);
}

/// Where the foot gets a hundredth of a spacing thin, nodes become one, and those that no point sees any more follow.
TEST(TaylorBar, AtThreeTimesTheSpeedNodesBecomeOneAndTheEnergyIsAccounted) {
  for (const double size : {0.8e-3, 0.6e-3}) {
    auto otm = TaylorBar::bar<2>(TaylorBar::mesh<2>(size), 750.0, {});
    const auto before = otm.balance();
    const double mass = otm.masses().sum();
    otm.run(10e-6);
    EXPECT_NEAR(otm.balance().total(), before.total(), 0.002 * before.total());
    EXPECT_GT(otm.counts().merged, 0);
    EXPECT_NEAR(otm.masses().sum(), mass, 1e-13 * mass);
    EXPECT_NEAR(TaylorBar::shape(otm).length, 24.91e-3, 0.02e-3);
    EXPECT_LT(otm.counts().steps, 2000);
  }
}

TEST(TaylorBar, AQuarterBetweenPlanesOfSymmetryEndsAsTheMeridianSectionDoes) {
  auto section = TaylorBar::bar<2>(TaylorBar::mesh<2>(0.9e-3), 227.0, {});
  auto quarter = TaylorBar::bar<3>(TaylorBar::quarter(0.8e-3), 227.0, {}, true, TaylorBar::copper(), true);
  const auto before = quarter.balance();
  section.run(80e-6);
  quarter.run(80e-6);
  const auto two = TaylorBar::shape(section), three = TaylorBar::shape(quarter);
  EXPECT_NEAR(three.length, two.length, 0.005 * two.length);
  EXPECT_NEAR(three.foot, two.foot, 0.01 * two.foot);
  EXPECT_GT(three.foot, 6.9e-3);
  EXPECT_NEAR(quarter.balance().total(), before.total(), 0.003 * before.total());
}

/// The bar becomes a disk half a millimetre thin: nodes come in along it and become one across it.
TEST(TaylorBar, AtThreeTimesTheSpeedNodesThatComeInCarryItToTheEnd) {
  for (const double size : {1e-3, 0.8e-3}) {
    auto otm = TaylorBar::bar<2>(TaylorBar::mesh<2>(size), 750.0, {.injection = 2.0});
    const auto before = otm.balance();
    const double mass = otm.masses().sum();
    otm.run(100e-6);
    const auto after = otm.balance();
    EXPECT_NEAR(after.total(), before.total(), 0.02 * before.total());
    EXPECT_LT(std::abs(after.renewal), 0.06 * before.kinetic);
    EXPECT_LT(after.kinetic, 0.05 * before.kinetic);
    EXPECT_GT(otm.counts().injected, 10);
    EXPECT_GT(otm.counts().fused, 0);
    EXPECT_NEAR(otm.masses().sum(), mass, 1e-11 * mass);
    const Tensors F = otm.deformation();
    for (Index p = 0; p < otm.num_points(); ++p)
      EXPECT_GT(Eigen::Map<const Mat<3>>(F.col(p).data()).determinant(), 0.0);
    EXPECT_GT(TaylorBar::shape(otm).foot, 20e-3);
    EXPECT_LT(TaylorBar::shape(otm).length, 2e-3);
  }
}

/// Points next to the wall are squeezed while others of their unions grow; a shock of 25 GPa passes.
TEST(TaylorBar, AtThreeTimesTheSpeedPointsNextToTheWallHoldInSpaceToo) {
  for (const bool is_quarter : {false, true}) {
    auto otm = is_quarter ? TaylorBar::bar<3>(TaylorBar::quarter(1.6e-3), 750.0, {.injection = 2.0}, true,
                                              TaylorBar::copper(), true)
                          : TaylorBar::bar<3>(TaylorBar::mesh<3>(2e-3), 750.0, {.injection = 2.0});
    const auto before = otm.balance();
    const double mass = otm.masses().sum();
    otm.run(is_quarter ? 20e-6 : 3e-6);
    EXPECT_NEAR(otm.balance().total(), before.total(), 0.005 * before.total());
    EXPECT_NEAR(otm.masses().sum(), mass, 1e-12 * mass);
    EXPECT_GT(otm.counts().injected, 20);
    const Tensors F = otm.deformation();
    for (Index p = 0; p < otm.num_points(); ++p)
      EXPECT_GT(Eigen::Map<const Mat<3>>(F.col(p).data()).determinant(), 0.2);
  }
}

}  // namespace
}  // namespace efree
