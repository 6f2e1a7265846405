// SPDX-License-Identifier: GPL-3.0-or-later
// bench_shock_tube convergence: errors of three Riemann problems over 100 to 800 points, of OTM and of
// finite elements by the same driver. bench_shock_tube choices: Sod's tube by smoothness of shape functions and
// reconnection strain. bench_shock_tube profile sod|lax|collision POINTS: the state at the end, beside the exact one.
// All CSV.

#include "efree/core/parallel.hpp"

#include "clock.hpp"
#include "shock_tube.hpp"

#include <cstdio>
#include <cstdlib>
#include <string>

namespace efree {
namespace {

using bench::RiemannProblem, bench::ShockTube;

const std::pair<const char*, RiemannProblem> problems[] = {
    {"sod", RiemannProblem::sod()}, {"lax", RiemannProblem::lax()}, {"collision", RiemannProblem::collision()}};

void convergence() {
  std::puts("problem,functions,points,density_l1,velocity_l2,pressure_l1,energy_lost,viscous_heat,steps,seconds");
  for (const auto& [name, problem] : problems)
    for (const bool elements : {false, true})
      for (const Index points : {100, 200, 400, 800}) {
        const double begin = bench::cpu_seconds();
        ShockTube tube(problem, points, elements);
        const auto before = tube.dynamics.balance();
        const auto errors = tube.run();
        const auto after = tube.dynamics.balance();
        // Of a tube one cell high, by that of one of height 1.
        std::printf("%s,%s,%d,%.4g,%.4g,%.4g,%.2g,%.4g,%d,%.3g\n", name, elements ? "elements" : "lme", points,
                    errors.density, errors.velocity, errors.pressure, (before.total() - after.total()) * points,
                    after["viscous"] * points, tube.dynamics.steps(), bench::cpu_seconds() - begin);
        std::fflush(stdout);
      }
}

void choices() {
  std::puts("gamma,reconnection_strain,points,density_l1,velocity_l2,reconnections_of_a_point");
  for (const double gamma : {2.5, 4.0, 6.0})
    for (const double strain : {0.05, 0.1, 0.2, 0.5})
      for (const Index points : {100, 200, 400, 800}) {
        OtmOptions options = ShockTube::scheme_options();
        options.lme.gamma = gamma;
        options.reconnection_strain = strain;
        ShockTube tube(problems[0].second, points, false, options);
        try {
          const auto errors = tube.run();
          std::printf("%g,%g,%d,%.4g,%.4g,%.2f\n", gamma, strain, points, errors.density, errors.velocity,
                      static_cast<double>(tube.dynamics.count("reconnections")) / points);
        } catch (const NumericalError& error) {
          std::printf("%g,%g,%d,nan,nan,nan\n", gamma, strain, points);
        }
      }
}

void profile(const std::string& which, Index points) {
  for (const auto& [name, problem] : problems)
    if (which == name) {
      ShockTube tube(problem, points);
      tube.run();
      std::puts("x,density,velocity,pressure,energy,exact_density,exact_velocity,exact_pressure,exact_energy");
      for (const auto& [x, density, velocity, pressure, energy] : tube.samples()) {
        const auto exact = problem.at(x / tube.dynamics.time());
        std::printf("%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", x, density, velocity, pressure, energy,
                    exact.density, exact.velocity, exact.pressure,
                    exact.pressure / ((problem.gamma - 1.0) * exact.density));
      }
    }
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  const std::string task = argc > 1 ? argv[1] : "";
  efree::set_num_threads(1);
  if (task == "convergence")
    efree::convergence();
  else if (task == "choices")
    efree::choices();
  else if (task == "profile" && argc > 3)
    efree::profile(argv[2], std::atoi(argv[3]));
  else
    return std::puts("bench_shock_tube convergence | choices | profile sod|lax|collision POINTS"), 2;
}
