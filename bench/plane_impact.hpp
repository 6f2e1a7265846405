// SPDX-License-Identifier: GPL-3.0-or-later
/// A metal that hits a wall and cannot give way to the sides: the waves of a plane impact, by Rankine and Hugoniot, and
/// the same by explicit dynamics on meshes of no symmetry, for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/j2.hpp"

#include <cmath>
#include <utility>

namespace efree::bench {

/// SI units. The axis is the last one, along which the bar flies down.
struct PlaneImpact {
  static constexpr double length = 0.5, width = 0.1, density = 2700.0;
  static constexpr double until = 50e-6;  ///< no wave has come to the other end
  static constexpr double E = 73e9, nu = 0.33, yield = 265e6;

  /// Of aluminium 6061 (Marsh 1980; Meyers 1994).
  static EquationOfState state() { return EquationOfState::mie_grueneisen({density, 5350.0, 1.34, 2.0}); }
  /// Flows at one stress, with the pressure that shocks have in it.
  static SharedMaterial aluminium() {
    return WithPressure(
        J2({.moduli = {.E = E, .nu = nu}, .yield = Hardening::linear(yield, 0.0), .strain = Strain::finite}), state());
  }

  /// Behind a front, or before it: J, Cauchy stress against the front, how fast the metal follows it, over what is
  /// before all fronts, and internal energy of the equation of state over the volume at rest.
  struct State {
    double J = 1.0, stress = 0.0, velocity = 0.0, energy = 0.0;
  };
  /// Stress on the wall at this speed: Rankine and Hugoniot's of the fronts that run into the bar, an elastic one to
  /// the limit of Hugoniot and a plastic one after it, or that alone where it is faster.
  static double wall_stress(double speed) {
    const EquationOfState fluid = state();
    const double shear = 0.5 * E / (1.0 + nu);
    // Behind a plastic front to J. All that is dissipated is heat, and shear stores as much before as after.
    const auto behind = [&](const State& before, double J) {
      // The pressure is linear in the energy, which the front raises by the mean stress.
      const double unheated = fluid.at(J, before.energy).pressure + 2.0 / 3.0 * yield / J;
      const double by_energy = fluid.at(J, 0.0).by_energy, half = 0.5 * (before.J - J);
      State after{.J = J};
      after.stress = (unheated + by_energy * half * before.stress) / (1.0 - by_energy * half);
      after.velocity = before.velocity + std::sqrt((after.stress - before.stress) * 2.0 * half / density);
      after.energy = before.energy + (before.stress + after.stress) * half;
      return after;
    };
    const auto front = [&](const State& before) {
      double low = 0.5, high = before.J;
      for (int k = 0; k < 100; ++k) {
        const double J = 0.5 * (low + high);
        (behind(before, J).velocity > speed ? low : high) = J;
      }
      return behind(before, 0.5 * (low + high));
    };
    const auto speed_of = [](const State& before, const State& after) {
      return (after.stress - before.stress) / (density * (after.velocity - before.velocity));
    };
    // Hugoniot's limit: where the deviator of Hencky's strain has come to 2/3 of the yield stress.
    State limit{.J = std::exp(-0.5 * yield / shear)};
    limit.energy = 0.5 * fluid.at(limit.J, 0.0).pressure * (1.0 - limit.J);
    limit.stress = fluid.at(limit.J, limit.energy).pressure + 2.0 / 3.0 * yield / limit.J;
    limit.velocity = std::sqrt(limit.stress * (1.0 - limit.J) / density);
    const State plastic = front(limit);
    if (speed_of(limit, plastic) < speed_of({}, limit)) return plastic.stress;
    return front({}).stress;
  }
  /// By `until`, of the momentum at the start.
  static double momentum_lost(double speed) { return wall_stress(speed) * until / (density * length * speed); }

  /// Nodes at most `size` apart. Held at the sides.
  template <int Dim> static FineMesh<Dim> mesh(double size) {
    if constexpr (Dim == 2)
      return triangulate(shapes::rectangle(0.0, 0.0, width, length), {.size = size});
    else
      return FineMesh<3>(solids::box({width, width, length}, size));
  }
  template <int Dim> static Dynamics<Dim> bar(const FineMesh<Dim>& mesh, double speed, const OtmOptions& scheme,
                                              const DynamicsOptions& options, bool shared_dilatation = true) {
    DeformableBody<Dim> body = deformable_body(mesh, aluminium(), density);
    body.velocity.setZero(Dim, body.nodes.cols());
    body.velocity.row(Dim - 1).setConstant(-speed);
    if (!shared_dilatation) body.patches.clear();
    Dynamics<Dim> dynamics({body}, otm<Dim>(scheme), options);
    dynamics.add_wall({.normal = Vec<Dim>::Unit(Dim - 1)});
    for (Index a = 0; a < body.nodes.cols(); ++a)
      for (int i = 0; i + 1 < Dim; ++i)
        if (const double x = body.nodes(i, a); x < 1e-9 || x > width - 1e-9) dynamics.prescribe(a, i, 0.0);
    return dynamics;
  }
};

}  // namespace efree::bench
