// SPDX-License-Identifier: GPL-3.0-or-later
// bench_fracture onset SIZE... [ramp=30] [neighbourhood=2]: energy release rates over the toughness at which a crack
// in a long strip begins to grow, by the spacing of nodes. bench_fracture path SIZE [until=90e-6]: the plate of
// Kalthoff & Winkler (1988), hit on its side between two notches at 33 m/s (half of it, and half of the speed as the
// projectile gives way): points that broke, and on the error stream the angle of the crack. All CSV.
#include "efree/core/parallel.hpp"

#include "arguments.hpp"
#include "clock.hpp"
#include "cracked_strip.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <numbers>
#include <string>
#include <vector>

namespace efree {
namespace {

using bench::Keys;

void onset(const std::vector<double>& sizes, Keys& keys) {
  std::puts("neighbourhood,size,points,first,grown,energy_error,steps,seconds");
  for (const double size : sizes) {
    const double begin = bench::cpu_seconds();
    bench::CrackedStrip strip(size, keys["neighbourhood"], keys["ramp"]);
    const double before = strip.dynamics.balance().total();
    const auto [first, grown] = strip.onset();
    const auto after = strip.dynamics.balance();
    std::printf("%g,%g,%d,%.4f,%.4f,%.2g,%d,%.3g\n", keys["neighbourhood"], size, strip.dynamics.num_points(), first,
                grown, (after.total() - before) / after["prescribed"], strip.dynamics.steps(),
                bench::cpu_seconds() - begin);
    std::fflush(stdout);
  }
}

/// Maraging steel 18Ni1900; metres. The impact is at x = 0 below the notch, y = 0 a plane of symmetry.
void path(double size, Keys& keys) {
  constexpr double side = 0.1, notch = 0.05, height = 0.025;
  DeformableBody<2> body = deformable_body(triangulate(shapes::rectangle(0.0, 0.0, side, side), {.size = size}),
                                           NeoHookean({.E = 190e9, .nu = 0.3}), 8000.0);
  body.fracture = {.toughness = 2.213e4, .neighbourhood = keys["neighbourhood"]};
  Dynamics<2> dynamics({body}, otm<2>());
  const Points<2> start = dynamics.points();
  for (Index p = 0; p < dynamics.num_points(); ++p)
    if (start(0, p) < notch && std::abs(start(1, p) - height) < keys["width"] * size) dynamics.erode(p);
  const auto notched = static_cast<Index>(dynamics.count("eroded points"));
  std::vector<bool> is_notch(static_cast<std::size_t>(dynamics.num_points()));
  for (Index p = 0; p < dynamics.num_points(); ++p) is_notch[p] = dynamics.is_eroded(p);
  for (Index a = 0; a < dynamics.num_nodes(); ++a) {
    if (dynamics.nodes()(1, a) < 1e-9) dynamics.prescribe(a, 1, 0.0);
    if (dynamics.nodes()(0, a) < 1e-9 && dynamics.nodes()(1, a) < height - 0.5 * size) dynamics.prescribe(a, 0, 16.5);
  }
  const double before = dynamics.balance().total();
  double began = 0.0;
  while (dynamics.time() < keys["until"]) {
    dynamics.step();
    if (began == 0.0 && dynamics.count("eroded points") > notched) began = dynamics.time();
  }
  std::puts("x,y,notch");
  // A line through the notch's end, by least squares over points at least 5 mm from it.
  double along = 0.0, across = 0.0, both = 0.0;
  for (Index p = 0; p < dynamics.num_points(); ++p) {
    if (!dynamics.is_eroded(p)) continue;
    std::printf("%.6g,%.6g,%d\n", 1e3 * start(0, p), 1e3 * start(1, p), is_notch[p] ? 1 : 0);
    const double dx = start(0, p) - notch, dy = start(1, p) - height;
    if (is_notch[p] || dy < 0.005) continue;
    along += dx * dx;
    across += dy * dy;
    both += dx * dy;
  }
  const double angle = 0.5 * std::atan2(2.0 * both, along - across) * 180.0 / std::numbers::pi;
  const auto after = dynamics.balance();
  std::fprintf(stderr, "%d points, %d broke from %.1f us on, angle %.1f degrees, energy off by %.2g\n",
               dynamics.num_points(), static_cast<Index>(dynamics.count("eroded points")) - notched, 1e6 * began, angle,
               (after.total() - before) / after["prescribed"]);
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  if (argc < 3) return std::puts("bench_fracture onset SIZE... | path SIZE [key=value ...]"), 2;
  auto [sizes, keys] = efree::bench::arguments(
      argc, argv, 2, {{"ramp", 30.0}, {"neighbourhood", 2.0}, {"until", 90e-6}, {"width", 1.0}, {"threads", 1.0}});
  efree::set_num_threads(static_cast<int>(keys["threads"]));
  if (std::strcmp(argv[1], "onset") == 0)
    efree::onset(sizes, keys);
  else
    efree::path(sizes.at(0), keys);
}
