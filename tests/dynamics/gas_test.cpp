// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/gas_scenes.hpp"
#include "efree/core/parallel.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using namespace bench;

TEST(GasAtRest, KeepsItsPressureOverManyCrossingsOfSound) {
  for (const double reconnection_strain : {0.2, 0.0}) {
    GasOptions options;
    options.scheme.reconnection_strain = reconnection_strain;
    const BoxResult box = run_box({.spacing = 0.1, .until = 5.0}, options);
    EXPECT_GT(box.low, 1.0 - 1e-9) << reconnection_strain;
    EXPECT_LT(box.high, 1.0 + 1e-9) << reconnection_strain;
    EXPECT_LT(std::abs(box.energy), 0.01) << reconnection_strain;
    EXPECT_EQ(box.reconnections > 0, reconnection_strain == 0.0);
  }
}

TEST(GasAtRest, OfFullRevolutionPressesOnItsSurfaceAlone) {
  // A cylinder of gas, of the full revolution: pressure acts on its surface alone.
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.5, 0.0, 1.0, 1.0), {.size = 0.2});
  const DeformableBody<2> body =
      deformable_body(mesh, Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = 3.0}), 1.0, true);
  Dynamics<2> dynamics({body}, otm<2>(), {.plane = Plane::axisymmetric});
  dynamics.add_wall({.normal = {1.0, 0.0}, .level = 0.5});
  dynamics.add_wall({.normal = {-1.0, 0.0}, .level = -1.0});
  dynamics.add_wall({.normal = {0.0, 1.0}});
  dynamics.add_wall({.normal = {0.0, -1.0}, .level = -1.0});
  dynamics.run(2.0);
  const GasSamples found = gas_samples(dynamics, 1.0);
  EXPECT_NEAR(found.pressure.minCoeff(), 3.0, 1e-8);
  EXPECT_NEAR(found.pressure.maxCoeff(), 3.0, 1e-8);
  const double area = std::numbers::pi * (1.0 - 0.25);
  EXPECT_NEAR(dynamics.wall_forces()(1, 2), -3.0 * area, 0.01 * area);
}

TEST(StirredGas, IsTheSameOnAnyNumberOfThreadsAndAfterACheckpoint) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.05});
  DeformableBody<2> body =
      deformable_body(mesh, Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = 1.0}), 1.0);
  body.patches.clear();
  body.velocity = body.nodes.array().sin().matrix();
  const auto make = [&] {
    Dynamics<2> dynamics({body}, otm<2>(), {.shock = {.linear = 0.5, .quadratic = 2.0}});
    dynamics.add_wall({.normal = {-1.0, 0.0}, .level = -1.0});
    dynamics.add_wall({.normal = {0.0, -1.0}, .level = -1.0});
    return dynamics;
  };
  const int threads = num_threads();
  set_num_threads(1);
  Dynamics<2> one = make();
  one.run(0.1);
  const std::string half_way = one.state();
  one.run(0.3);
  set_num_threads(3);
  Dynamics<2> three = make();
  three.run(0.1);
  three.run(0.3);
  EXPECT_EQ(one.nodes(), three.nodes());
  EXPECT_EQ(one.cauchy_stress(), three.cauchy_stress());
  Dynamics<2> resumed = make();
  resumed.restore(half_way);
  resumed.run(0.3);
  set_num_threads(threads);
  EXPECT_GT(one.count("reconnections"), 0);
  EXPECT_EQ(one.nodes(), resumed.nodes());
  EXPECT_EQ(one.cauchy_stress(), resumed.cauchy_stress());
  EXPECT_EQ(one.balance().total(), resumed.balance().total());
}

TEST(Noh, DiffusionLeavesPressureBehindAShockSmoothAndLosesNoEnergy) {
  GasOptions rough, smooth;
  rough.scheme.pressure_diffusion = 0.0;
  const Noh of{.spacing = 0.04};
  const NohResult before = run_noh(of, rough), after = run_noh(of, smooth);
  EXPECT_LT(after.pressure.deviation(), 0.5 * before.pressure.deviation());
  EXPECT_LT(after.pressure.deviation(), 0.1 * of.pressure_behind());
  EXPECT_NEAR(after.density.mean, 4.0, 0.4);
  EXPECT_NEAR(after.pressure.mean, of.pressure_behind(), 0.1 * of.pressure_behind());
  EXPECT_NEAR(after.shock, of.shock(), 0.1 * of.shock());
  EXPECT_LT(std::abs(after.energy), 1e-3);
  EXPECT_LT(after.wall, after.density.mean) << "the wall is heated";
  EXPECT_GT(after.wall, 0.5 * after.density.mean);
}

}  // namespace
}  // namespace efree
