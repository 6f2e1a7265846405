// SPDX-License-Identifier: GPL-3.0-or-later
// bench_materials: what materials of explicit dynamics take for a point and step, without a tangent, on one thread.

#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"

#include "clock.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>

namespace efree {
namespace {

/// A chunk of points that are strained and turned at random, for a hundred steps; the best of seven.
void measure(const char* name, const Material& material) {
  constexpr Index points = 256;
  constexpr int steps = 100;
  std::srand(1);
  const Tensors increment[] = {0.002 * Tensors::Random(9, points), 0.002 * Tensors::Random(9, points),
                               0.002 * Tensors::Random(9, points), 0.002 * Tensors::Random(9, points)};
  double best = std::numeric_limits<double>::infinity();
  for (int repeat = 0; repeat < 7; ++repeat) {
    Deformation at = Deformation::none(Points<3>::Zero(3, points), material.history_size());
    MaterialResponse response = respond(material, at, false);
    at.dt = 1e-7;
    double seconds = 0.0;
    for (int step = 0; step < steps; ++step) {
      at.F += increment[step / 10 % 4];
      const double begin = bench::cpu_seconds();
      material.respond(at, response);
      seconds += bench::cpu_seconds() - begin;
      at.history.swap(response.history);
    }
    best = std::min(best, seconds);
  }
  std::printf("| %s | %.2f |\n", name, 1e6 * best / steps / points);
}

}  // namespace
}  // namespace efree

int main() {
  using namespace efree;
  // OFHC copper in MPa, s, K (Johnson & Cook 1983; Marsh 1980).
  const ElasticModuli moduli{.E = 124e3, .nu = 0.34};
  const auto shocks = EquationOfState::mie_grueneisen({8.93e-9, 3.94e6, 1.489, 1.99});
  J2Parameters copper{.moduli = moduli, .yield = Hardening::linear(90.0, 300.0), .strain = Strain::finite};
  std::puts("| material | us a point and step |\n|---|---|");
  measure("neo-Hookean", NeoHookean(moduli));
  measure("J2, linear hardening", J2(copper));
  copper.yield = Hardening::ludwik(90.0, 292.0, 0.31);
  measure("Ludwik's hardening", J2(copper));
  copper.rate = RateFactor::johnson_cook(0.025, 1.0);
  measure("and the rate", J2(copper));
  copper.heating = Heating{.capacity = 3.43, .melting = 1356.0, .reference = 298.0, .exponent = 1.09};
  measure("and heat: Johnson and Cook", J2(copper));
  measure("and the pressure of shocks", WithPressure(J2(copper), shocks));
  measure("gas", Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = 1.0}));
  measure("viscous gas", Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = 1.0, .viscosity = 1e-9}));
}
