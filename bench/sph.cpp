// SPDX-License-Identifier: GPL-3.0-or-later
// bench_sph [--full] NAME ...: rows of smoothed particles, one or several of adjoint, maps, shear, geostatic, walls,
// rods, rods-2, refine, cut, strip, pile, cohesive, speed; `all` is all of these. --full halves spacings. Each prints
// what it measures beside its bar, and the exit status is 1 where one is missed.

#include "efree/core/error.hpp"

#include "clock.hpp"
#include "rows.hpp"
#include "soil_scenes.hpp"
#include "sph_scenes.hpp"

#include <fmt/format.h>
#include <cstdio>
#include <functional>
#include <string>

namespace efree {
namespace {

using namespace bench;

double halved = 1.0;  ///< spacings over those written here

bool adjoint() {
  bool good = true;
  for (const auto& [kernel, name] : {std::pair(SmoothingKernel::cubic_spline, "cubic spline"),
                                     std::pair(SmoothingKernel::wendland_c2, "Wendland C2")})
    for (const double ratio : {1.0, 1.8}) {
      const auto [two, two_sum] = adjoint_errors<2>(kernel, ratio);
      const auto [three, three_sum] = adjoint_errors<3>(kernel, ratio);
      const std::string what = fmt::format("{}, smoothing lengths up to {} times as large", name, ratio);
      good &= row("adjoint", what + ": <L v, V sigma> + <v, f>", std::max(two, three), 0.0, 1e-13);
      good &= row("adjoint", what + ": sum of the forces", std::max(two_sum, three_sum), 0.0, 1e-13);
      const auto [by_walls, by_walls_sum] = adjoint_errors<2>(kernel, ratio, true);
      good &= row("adjoint", what + ", walls: <L v, V sigma> + <v, f>", by_walls, 0.0, 1e-13);
      good &= row("adjoint", what + ", walls: sum of the forces less theirs", by_walls_sum, 0.0, 1e-13);
    }
  const auto [lost, drift] = vibrating_block(Index{100000});
  good &= row("adjoint", "1e5 steps of a block: momentum lost", lost, 0.0, 1e-13);
  good &= row("adjoint", "drift of its energy", std::abs(drift), 0.0, 0.01);
  return good;
}

bool maps() {
  bool good = true;
  for (const auto& [ratio, expected] : {std::pair(0.5, 0.106), std::pair(0.6, 0.0500), std::pair(0.75, 0.00874)})
    good &= row("maps", fmt::format("r 1.2, e 0.5, coarse neighbours, alpha {}: error over {}", ratio, expected),
                splitting_error(1.2, 0.5, ratio, 1.0) / expected, 0.99, 1.01);
  return good;
}

bool shear() {
  bool good = true;
  const auto tangent = [](double degrees) { return std::tan(degrees * std::numbers::pi / 180.0); };
  for (const double friction : {19.8, 25.0}) {
    Soil soil = rods;
    soil.friction = friction;
    const double t = tangent(friction), expected = 3.0 * t / std::sqrt(9.0 + 12.0 * t * t);
    good &= row("shear", fmt::format("phi {}, psi 0: tau / sigma_n over 3 A = {:.4g}", friction, expected),
                shear_ratio(soil, 1e3) / expected, 0.999, 1.001);
    soil.dilatancy = friction;
    good &= row("shear", fmt::format("phi {}, psi phi: tau / sigma_n over tan phi = {:.4g}", friction, t),
                shear_ratio(soil, 1e3) / t, 0.999, 1.001);
    soil.dilatancy = 0.0;
    good &= row("shear", fmt::format("phi {}, psi 0: tau / sigma_n of a layer over 3 A", friction),
                shear_ratio_of_layer(soil, 0.01 * halved) / expected, 0.98, 1.02);
  }
  return good;
}

bool geostatic() {
  bool good = true;
  for (const double cohesion : {0.0, 5e3}) {
    Soil soil = rods;
    soil.cohesion = cohesion;
    const Bed bed = bed_at_rest({.spacing = 0.05 * halved}, soil, 1.0, 10.0);
    good &=
        row("geostatic", fmt::format("c {}: slope of the vertical stress over rho g", cohesion), bed.slope, 0.99, 1.01);
    good &= row("geostatic", "largest deviation inside, over the stress at the floor", bed.largest, 0.0, 0.15);
    good &= row("geostatic", "speed that 99 % stay below [m/s]", bed.speed, 0.0, 1e-3);
  }
  return good;
}

bool walls() {
  bool good = row("walls", "block that slides at 30 degrees with friction 0.3: acceleration, less 1",
                  sliding_error(30.0, 0.3), -0.01, 0.01);
  for (const double spacings : {10.0, 20.0})
    good &= row("walls", fmt::format("footing, {} particles: pressure over (2 + pi) c", spacings / halved),
                footing_ratio(spacings / halved), 0.95, 1.05);
  return good;
}

bool collapses(const char* name, const Soil& soil) {
  bool good = true;
  double before = 0.0;
  for (const double spacing : {8e-3, 4e-3, 2e-3}) {
    const Heap heap = collapse(0.2, 0.1, {.spacing = spacing * halved}, soil, 1.0);
    const bool last = spacing == 2e-3;
    good &= row(name,
                fmt::format("d {:.3g}: toe [m] ({:.0f} s, furthest {:.3f}, crest {:.4f})", spacing * halved,
                            heap.seconds, heap.furthest, heap.crest),
                heap.toe, last ? 0.40 : 0.3, last ? 0.43 : 0.5);
    good &= row(name, "x of the failure line [m] (the first wedge begins at 0.13)", heap.failure, 0.0, 0.13);
    good &= row(name, "speed that 99 % stay below [m/s]", heap.speed, 0.0, 0.01);
    good &= row(name, "error of the energy balance", std::abs(heap.energy_error), 0.0, 0.01);
    if (last) good &= row(name, "toe over that with twice the spacing, less 1", heap.toe / before - 1.0, -0.03, 0.03);
    before = heap.toe;
  }
  return good;
}

bool rods_collapse() {
  return collapses("rods", rods);
}
bool rods_2_collapse() {
  return collapses("rods-2", rods_2);
}

/// Distance of two surfaces, root of the mean square.
double surface_distance(const Heap& a, const Heap& b) {
  double sum = 0.0;
  for (std::size_t k = 0; k < a.surface.size(); ++k) sum += std::pow(a.surface[k] - b.surface[k], 2);
  return std::sqrt(sum / static_cast<double>(a.surface.size()));
}

bool refine() {
  const double coarse = 4e-3 * halved;
  SphOptions split{.spacing = coarse};
  split.splitting.strain = 0.1;
  const Heap rough = collapse(0.2, 0.1, {.spacing = coarse}, rods, 1.0), refined = collapse(0.2, 0.1, split, rods, 1.0),
             fine = collapse(0.2, 0.1, {.spacing = 0.5 * coarse}, rods, 1.0);
  bool good = row(
      "refine",
      fmt::format("toe of coarse {:.4f}, split {:.4f}, fine {:.4f}: split less fine", rough.toe, refined.toe, fine.toe),
      refined.toe - fine.toe, -0.02, 0.02);
  const double off = surface_distance(rough, fine);
  good &= row("refine", fmt::format("surface of split off fine, over that of coarse, {:.2g} mm", 1e3 * off),
              surface_distance(refined, fine) / off, 0.0, 1.0 / 3.0);
  good &= row("refine", fmt::format("time of split over fine, {} of {} particles", refined.particles, fine.particles),
              refined.seconds / fine.seconds, 0.0, 0.6);
  return good;
}

bool cut() {
  double stands = 1.2, fails = 2.2;
  while (fails - stands > 0.05) {
    const double height = 0.5 * (stands + fails);
    (speed_of_cut(height, 32.0 / halved) > 0.02 ? fails : stands) = height;
  }
  return row("cut", "height at which a vertical cut fails [m] (upper bound 1.66)", 0.5 * (stands + fails), 1.5, 1.75);
}

bool strip() {
  const SphOptions plain{.spacing = 1.0};
  SphOptions cured = plain;
  cured.artificial_stress.strength = 0.5;
  const auto in_total = stretch_particles(plain, SphFrame::total, 2.0);
  bool good = row("strip", "total: scatter of stresses at a stretch of 1.3", in_total.scatter, 0.0, 0.05);
  good &= row("strip", "total: stretch at a gap (0: none)", in_total.gap_at, 0.0, 0.0);
  for (const auto& [name, options] : {std::pair("plain", plain), std::pair("artificial stress", cured)}) {
    const auto updated = stretch_particles(options, SphFrame::updated, 2.0);
    std::printf("strip      updated, %s: scatter at 1.3 %.3g, stretch at a gap %.3g (0: none up to 2)\n", name,
                updated.scatter, updated.gap_at);
  }
  return good;
}

bool piles() {
  bool good = true;
  for (const double spacing : {0.02, 0.0133, 0.01}) {
    const Pile heap = pile(spacing * halved);
    good &= row("pile",
                fmt::format("d {:.3g}: run-out over radius ({} particles, {:.0f} s, slope {:.1f} for 30 degrees)",
                            spacing * halved, heap.particles, heap.seconds, heap.angle),
                heap.run_out, 0.9, 1.6);
    good &= row("pile", "speed that 99 % stay below [m/s]", heap.speed, 0.0, 0.05);
  }
  return good;
}

template <int Dim> bool cohesive_in(double spacing) {
  bool good = true;
  const SphOptions plain{.spacing = spacing * halved};
  SphOptions cured = plain;
  cured.artificial_stress.strength = 0.5;
  const Clumps clumped = cohesive_collapse<Dim>(plain, 2.0), smooth = cohesive_collapse<Dim>(cured, 2.0);
  const auto in = [](const std::string& what) { return fmt::format("{}D, {}", Dim, what); };
  good &= row("cohesive", in("without artificial stress: pairs closer than half the spacing"), clumped.close_pairs, 1.0,
              1e9);
  good &= row("cohesive", in("with it: closest pair over the spacing"), smooth.closest, 0.5, 2.0);
  good &=
      row("cohesive", in("with it: largest distance of the fourth (sixth) neighbour"), smooth.void_radius, 0.0, 2.0);
  good &= row("cohesive", in("with it: error of the energy balance"), std::abs(smooth.energy_error), 0.0, 0.05);
  return good;
}
bool cohesive() {
  const bool in_plane = cohesive_in<2>(0.04), in_space = cohesive_in<3>(0.08);
  return in_plane && in_space;
}

bool speed() {
  const Heap heap = collapse(0.2, 0.1, {.spacing = 2e-3}, rods, 0.1);
  return row("speed", fmt::format("rods, {} particles: million updates a second", heap.particles),
             1e-6 * static_cast<double>(heap.particles) * static_cast<double>(heap.steps) / heap.seconds, 2.5, 1e3);
}

/// Errors and choices over what can be chosen, as comma-separated values.
void chart() {
  for (const double smoothing : {1.0, 1.2})
    for (const bool among_daughters : {false, true}) {
      for (int e = 0; e <= 24; ++e) {
        for (int a = 0; a <= 20; ++a) {
          const double separation = 0.2 + 0.025 * e, ratio = 0.4 + 0.025 * a;
          std::printf("map_%.1f_%s,%g,%g,%g\n", smoothing, among_daughters ? "fine" : "coarse", separation, ratio,
                      splitting_error(smoothing, separation, ratio, among_daughters ? ratio : 1.0));
        }
      }
    }
  const double coarse = 4e-3;
  const Heap rough = collapse(0.2, 0.1, {.spacing = coarse}, rods, 1.0),
             fine = collapse(0.2, 0.1, {.spacing = 0.5 * coarse}, rods, 1.0);
  const auto split = [&](const char* name, double value, const ParticleSplitting& splitting) {
    const Heap heap = collapse(0.2, 0.1, {.spacing = coarse, .splitting = splitting}, rods, 1.0);
    std::printf("%s,%g,%g,%g,%td\n", name, value, surface_distance(heap, fine) / surface_distance(rough, fine),
                heap.seconds / fine.seconds, static_cast<std::ptrdiff_t>(heap.particles));
    std::fflush(stdout);
  };
  for (const double strain : {0.02, 0.05, 0.1, 0.2, 0.5}) split("strain", strain, {.strain = strain});
  for (const double separation : {0.3, 0.4, 0.5, 0.6, 0.7})
    split("separation", separation, {.strain = 0.1, .separation = separation});
  for (const double ratio : {0.5, 0.6, 0.7, 0.8, 0.9}) split("smoothing", ratio, {.strain = 0.1, .smoothing = ratio});
  for (const double spacing : {8e-3, 4e-3})
    for (const double linear : {0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0}) {
      const Heap heap =
          collapse(0.2, 0.1, {.spacing = spacing, .viscosity = {.linear = linear, .quadratic = 0.1}}, rods, 1.0);
      std::printf("viscosity_%g,%g,%g,%g\n", 1e3 * spacing, linear, heap.toe, heap.furthest);
      std::fflush(stdout);
    }
  for (const double strength : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    SphOptions options{.spacing = 0.04};
    options.artificial_stress.strength = strength;
    const double start = seconds();
    const Clumps clumps = cohesive_collapse<2>(options, 2.0);
    std::printf("tension,%g,%g,%g,%g\n", strength, clumps.closest, clumps.void_radius, seconds() - start);
    std::fflush(stdout);
  }
}

const Rows benches{{"adjoint", adjoint},
                   {"maps", maps},
                   {"shear", shear},
                   {"geostatic", geostatic},
                   {"walls", walls},
                   {"rods", rods_collapse},
                   {"rods-2", rods_2_collapse},
                   {"refine", refine},
                   {"cut", cut},
                   {"strip", strip},
                   {"pile", piles},
                   {"cohesive", cohesive},
                   {"speed", speed}};

int run(std::vector<std::string> names) {
  if (std::erase(names, "--full") > 0) halved = 0.5;
  if (names == std::vector<std::string>{"chart"}) {
    chart();
    return 0;
  }
  return print_rows(benches, names) ? 0 : 1;
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  try {
    return efree::run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_sph: %s\n", error.what());
    return 2;
  }
}
