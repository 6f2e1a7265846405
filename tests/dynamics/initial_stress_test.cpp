// SPDX-License-Identifier: GPL-3.0-or-later
/// Runs that start with given stresses.
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/quadrature/approximation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>

namespace efree {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr double E = 1e3, nu = 0.3;
SharedMaterial rubber() {
  return NeoHookean({.E = E, .nu = nu});
}
SharedMaterial metal() {
  return J2({.moduli = {.E = E, .nu = nu}, .yield = 200.0, .strain = Strain::finite});
}

enum class Method { otm, elements, cloud, mpm, sph };
constexpr Method all_methods[] = {Method::otm, Method::elements, Method::cloud, Method::mpm, Method::sph};

Dynamics<2> rectangle(Method method, double width, double height, double size, const SharedMaterial& material) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, width, height), {.size = size});
  if (method == Method::mpm) {
    const MpmOptions grid{.cell = size};
    return {{body_on_lattice<2>(mesh, MpmFrame::updated, grid, 2, material, 1.0)}, mpm<2>(grid)};
  }
  if (method == Method::sph) {
    const SphOptions particles{.spacing = 0.5 * size};
    return {{particles_on_lattice<2>(mesh, SphFrame::updated, particles, material, 1.0)}, sph<2>(particles)};
  }
  if (method == Method::otm) return {{deformable_body(mesh, material, 1.0)}, otm<2>()};
  ApproximationOptions options{.kind = BasisKind::p1};
  if (method == Method::cloud)
    options = {.spacing = size, .support = dynamics_support, .vanish_on = {"left", "right", "bottom"}};
  return {{deformable_body(approximate(mesh, options), material, 1.0)}, total_lagrangian<2>()};
}

void hold(Dynamics<2>& dynamics, const std::function<bool(const Vec<2>&)>& where) {
  for (const int axis : {0, 1}) dynamics.prescribe(where, axis, 0.0);
}

Mat<3> biaxial() {
  Mat<3> stress = Mat<3>::Zero();
  stress.diagonal() << 60.0, -40.0, 15.0;
  stress(0, 1) = stress(1, 0) = 20.0;
  return stress;
}

TEST(InitialStress, AUniformStressIsBorneByEveryMethodAndMaterial) {
  for (const Method method : all_methods)
    for (const bool is_metal : {false, true}) {
      Dynamics<2> dynamics = rectangle(method, 1.0, 0.5, 0.125, is_metal ? metal() : rubber());
      const double mass = dynamics.masses().sum();
      const Points<2> points = dynamics.points();
      dynamics.set_stresses([](Index, const Vec<2>&) { return biaxial(); });
      EXPECT_EQ(dynamics.masses().sum(), mass);
      EXPECT_EQ(dynamics.points(), points);
      EXPECT_GT(dynamics.balance()["stored"], 0.0);
      const Tensors stress = dynamics.cauchy_stress();
      for (Index p = 0; p < dynamics.num_points(); ++p)
        EXPECT_LT((stress.col(p) - biaxial().reshaped()).norm(), 1e-10 * biaxial().norm()) << static_cast<int>(method);
      EXPECT_TRUE(dynamics.history(0).isZero(1e-12));
      // The volume at the start is that of the geometry.
      double volume = 0.0;
      for (const auto& chunk : dynamics.world().chunks)
        for (Index p = 0; p < chunk.size(); ++p)
          volume += chunk.matter.volume[p] * chunk.matter.now.gradient(p).determinant();
      EXPECT_NEAR(volume, 0.5, 1e-10);
    }
}

TEST(InitialStress, AHeldPlateKeepsItsPrestressAndItsForces) {
  for (const Method method : {Method::otm, Method::elements}) {
    Dynamics<2> dynamics = rectangle(method, 1.0, 0.5, 0.1, rubber());
    dynamics.set_stresses([](Index, const Vec<2>&) { return biaxial(); });
    const auto on_edge = [](const Vec<2>& x) {
      return std::min(x[0], 1.0 - x[0]) < 1e-9 || std::min(x[1], 0.5 - x[1]) < 1e-9;
    };
    hold(dynamics, on_edge);
    // Virtual work of the nodal forces in uniform strains.
    const Mat<2> work = dynamics.world().nodes.force * dynamics.nodes().transpose();
    EXPECT_LT((work + 0.5 * biaxial().topLeftCorner<2, 2>()).norm(), 1e-9 * biaxial().norm());
    dynamics.run(0.2);
    EXPECT_GT(dynamics.steps(), 100);
    const Tensors stress = dynamics.cauchy_stress();
    // Sums of gradients of otm integrate to a hundredth of their first error.
    const double allowed = method == Method::elements ? 1e-10 : 1e-2;
    for (Index p = 0; p < dynamics.num_points(); ++p)
      EXPECT_LT((stress.col(p) - biaxial().reshaped()).norm(), allowed * biaxial().norm()) << static_cast<int>(method);
  }
}

/// A column of soil of density 1, 2 wide and 10 high, on its base between smooth walls.
struct Column {
  static constexpr double H = 10.0, g = 0.01, K0 = 0.5;
  static Dynamics<2> make(Method method, bool stressed) {
    const SharedMaterial soil = DruckerPrager(
        {.moduli = {.E = E, .nu = nu}, .cohesion = 0.05, .friction = 0.6, .dilatancy = 0.1, .strain = Strain::finite});
    Dynamics<2> dynamics = rectangle(method, 2.0, H, 0.25, soil);
    if (stressed)
      dynamics.set_stresses([](Index, const Vec<2>& x) {
        const double vertical = -g * (H - x[1]);
        return Mat<3>(Vec<3>(K0 * vertical, vertical, K0 * vertical).asDiagonal());
      });
    dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
    dynamics.prescribe([](const Vec<2>& x) { return std::min(x[0], 2.0 - x[0]) < 1e-9; }, 0, 0.0);
    dynamics.set_gravity({0.0, -g});
    return dynamics;
  }
  static double largest_speed(Dynamics<2>& dynamics) {
    double speed = 0.0;
    for (int k = 1; k <= 40; ++k) {
      dynamics.run(k * 0.05);  // up to several times that of a wave through the column
      speed = std::max(speed, dynamics.velocities().colwise().norm().maxCoeff());
    }
    return speed / std::sqrt(2.0 * g * H);
  }
};

TEST(InitialStress, AColumnOfSoilWithItsGeostaticStressDoesNotRing) {
  for (const Method method : {Method::otm, Method::elements, Method::cloud}) {
    Dynamics<2> stressed = Column::make(method, true), unstressed = Column::make(method, false);
    EXPECT_LT(stressed.imbalance(), 0.02) << static_cast<int>(method);
    // Masses of light nodes of a cloud are raised, and their weight with these.
    const double allowed = method == Method::cloud ? 1e-3 : 1e-4;
    EXPECT_LT(Column::largest_speed(stressed), allowed) << static_cast<int>(method);
    EXPECT_GT(Column::largest_speed(unstressed), 3e-3) << static_cast<int>(method);
    EXPECT_LT(std::abs(stressed.energy().largest_error()), 1e-3);
  }
}

TEST(InitialStress, AStripUnderTensionSagsAsAClampedBeamWithTension) {
  constexpr double L = 10.0, h = 0.2, g = 0.01;
  const auto middle_under = [](double gravity) {
    Dynamics<2> dynamics = rectangle(Method::otm, L, h, 0.1, rubber());
    Mat<3> stress = Mat<3>::Zero();
    stress(0, 0) = 0.05 * E;
    dynamics.set_stresses([&](Index, const Vec<2>&) { return stress; });
    hold(dynamics, [](const Vec<2>& x) { return std::min(x[0], L - x[0]) < 1e-9; });
    dynamics.set_gravity({0.0, gravity});
    Index middle = 0;
    (dynamics.nodes().colwise() - Vec<2>(0.5 * L, 0.5 * h)).colwise().norm().minCoeff(&middle);
    dynamics.come_to_rest(1e-7, 1000000);
    return dynamics.nodes()(1, middle);
  };
  const double sag = 0.5 * (middle_under(g) - middle_under(-g));
  // q L^2 / (8 T) - q L / (2 k T) tanh(k L / 4), k^2 = T / (E' I) (Timoshenko 1956).
  const double T = 0.05 * E * h, q = g * h, k = std::sqrt(T / (E / (1.0 - nu * nu) * h * h * h / 12.0));
  const double exact = q * L * L / (8.0 * T) - q * L / (2.0 * k * T) * std::tanh(0.25 * k * L);
  EXPECT_NEAR(sag, exact, 0.03 * exact);
}

TEST(InitialStress, WhatTheMaterialDoesNotBearIsRefusedWithPlaceAndValue) {
  const auto set = [](double shear, const SharedMaterial& material) {
    return [shear, material] {
      Dynamics<2> dynamics = rectangle(Method::otm, 1.0, 0.5, 0.125, material);
      dynamics.set_stresses([&](Index, const Vec<2>& x) {
        Mat<3> stress = Mat<3>::Zero();
        stress(0, 1) = stress(1, 0) = shear * x[0];
        return stress;
      });
    };
  };
  const double yield = 200.0 / std::sqrt(3.0);
  EXPECT_NO_THROW(set(0.99 * yield, metal())());
  EXPECT_THAT(set(1.2 * yield, metal()),
              ThrowsMessage<InputError>(AllOf(HasSubstr("the stress (xx, yy, zz, yz, xz, xy) = (0, 0, 0, 0, 0, 1"),
                                              HasSubstr(") at (0.8"), HasSubstr("within its yield surface"))));
  EXPECT_THAT(set(std::numeric_limits<double>::quiet_NaN(), rubber()),
              ThrowsMessage<InputError>(HasSubstr("is not finite")));
}

}  // namespace
}  // namespace efree
