// SPDX-License-Identifier: GPL-3.0-or-later
// bench_ballistics SIZE SPEED... [dim=2] [free=0] [toughness=1] [strain=1] [threads=1]: a steel sphere through an
// aluminium plate, axisymmetric or a quarter in space, at these speeds [m/s]: what is left of them, and balances. free:
// the plate's rim is; toughness, strain: whether points break by eigenerosion, and by Johnson and Cook's strain. With
// points=FILE the points at the end of the last run go there. CSV; lines that begin with # say what went wrong.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include "arguments.hpp"
#include "clock.hpp"
#include "perforation.hpp"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace efree {
namespace {

template <int Dim>
void shoot(double size, const std::vector<double>& speeds, bench::Keys& keys, const std::string& points) {
  std::puts(
      "dim,size,points,speed,residual,through,eroded,energy_error,mass_error,momentum_error,fracture,steps,seconds");
  for (const double speed : speeds) {
    const double begin = bench::cpu_seconds();
    FractureCriteria fracture = bench::Perforation::fracture();
    if (keys["toughness"] == 0.0) fracture.toughness = 0.0;
    if (keys["strain"] == 0.0) fracture.strain.reset();
    auto dynamics = bench::Perforation::bodies<Dim>(size, speed, keys["free"] == 0.0, fracture);
    const double kinetic = dynamics.balance()["kinetic"];
    bench::Perforation::End end;
    try {
      end = bench::Perforation::run(dynamics, keys["until"]);
    } catch (const NumericalError& error) {
      std::printf("# %g m/s: %s\n", speed, error.what());
    }
    std::printf("%d,%g,%d,%g,%.1f,%d,%d,%.2g,%.2g,%.2g,%.3g,%d,%.3g\n", Dim, size, dynamics.num_points(), speed,
                end.through ? end.speed : 0.0, end.through ? 1 : 0, static_cast<int>(dynamics.count("eroded points")),
                end.error, end.mass_error, end.momentum_error, dynamics.balance()["fracture"] / kinetic,
                dynamics.steps(), bench::cpu_seconds() - begin);
    std::fflush(stdout);
    if (points.empty() || speed != speeds.back()) continue;
    std::FILE* file = std::fopen(points.c_str(), "w");
    std::fprintf(file, "x,y,body,eroded,plastic_strain\n");
    const Points<Dim> at = dynamics.points();
    for (Index b = 0; b < 2; ++b) {
      const Matrix history = dynamics.history(b);
      for (Index p = dynamics.first_point(b); p < dynamics.first_point(b + 1); ++p)
        std::fprintf(file, "%.6g,%.6g,%d,%d,%.4g\n", 1e3 * at.col(p).template head<Dim - 1>().norm(),
                     1e3 * at(Dim - 1, p), b, dynamics.is_eroded(p) ? 1 : 0, history(6, p - dynamics.first_point(b)));
    }
    std::fclose(file);
  }
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  if (argc < 3) return std::puts("bench_ballistics SIZE SPEED... [key=value ...]"), 2;
  auto [speeds, keys] = efree::bench::arguments(
      argc, argv, 2, {{"dim", 2}, {"free", 0}, {"toughness", 1}, {"strain", 1}, {"threads", 1}, {"until", 200e-6}});
  std::string points;  // a folder, and no number
  for (int i = 2; i < argc; ++i)
    if (std::strncmp(argv[i], "points=", 7) == 0) points = argv[i] + 7;
  efree::set_num_threads(static_cast<int>(keys["threads"]));
  if (keys["dim"] == 2.0)
    efree::shoot<2>(std::atof(argv[1]), speeds, keys, points);
  else
    efree::shoot<3>(std::atof(argv[1]), speeds, keys, points);
}
