// SPDX-License-Identifier: GPL-3.0-or-later
// bench_scenes NAME ...: rows of explicit dynamics in scenes from practice, one or several of friction, compliance,
// folding, rolling, seal, scaling, gas, noh, sedov, jet; `all` is all of these. Each prints what it measures beside its
// bar, and the exit status is 1 where one is missed.

#include "contact_scenes.hpp"
#include "folding_scenes.hpp"
#include "gas_scenes.hpp"
#include "rest_scenes.hpp"
#include "rows.hpp"
#include "scaling_scenes.hpp"

#include "efree/analysis/dynamics.hpp"

#include <cstdio>

namespace efree {
namespace {

using namespace bench;

/// Speed of a block on a slope: within 2 % of that of a rigid block, or at rest within a thousandth of free fall.
bool friction() {
  bool good = true;
  for (const auto& [slope, name] : {std::pair(Slope::wall, "wall"), std::pair(Slope::moving_plane, "moving plane"),
                                    std::pair(Slope::wall_under_cloud, "wall, cloud"), std::pair(Slope::body, "body")})
    for (const double ramp : {0.3, 0.0})
      for (const double spacing : {0.25, 0.125, 0.0625})
        for (const double mu : {0.2, 0.4, 0.5, 0.6, 0.7, 1.0}) {
          // Gravity that is there at once lets the block slip while it vibrates.
          const Slide block = slide_down({slope, mu, spacing, ramp, ramp > 0.0 ? 1.0 : 2.0});
          const std::string what =
              fmt::format("{}, {}, h {}, mu {}", name, ramp > 0.0 ? "ramp" : "at once", spacing, mu);
          if (block.rigid_speed > 0.0)
            good &= row("friction", what + ": speed / closed form", block.speed / block.rigid_speed, 0.98, 1.02);
          else
            good &= row("friction", what + ": speed / free fall", block.speed / block.free_speed, -1e-3, 1e-3);
          if (std::abs(block.energy_error) > 0.01)
            good &= row("friction", what + ": energy error", block.energy_error, -0.01, 0.01);
        }
  return good;
}

/// A heavy block on a soft column: the column's stiffness, and by how much they penetrate each other.
bool compliance() {
  bool good = true;
  for (const int cells : {4, 10}) {
    const Column column = press_column(cells);
    const std::string what = fmt::format("{} cells: ", cells);
    good &= row("compliance", what + "mean sag / closed form", column.sag, 0.95, 1.05);
    good &= row("compliance", what + "period / closed form", column.period, 0.975, 1.025);
    good &= row("compliance", what + "penetration / spacing", column.penetration, 0.0, 0.03);
    good &= row("compliance", what + "step / step of the block alone", column.step, 0.95, 1.05);
    good &= row("compliance", what + "energy error", column.energy_error, -0.01, 0.01);
  }
  return good;
}

/// Bodies that fold onto themselves: no part passes through another.
bool folding() {
  bool good = true;
  const auto check = [&](const std::string& what, auto dynamics, double end) {
    const Folding folding = fold(dynamics, end);
    good &= row("folding", what + "depth of nodes in other cells / spacing", folding.penetration, 0.0, 0.2);
    good &= row("folding", what + "energy error", folding.energy_error, -0.01, 0.01);
    good &= row("folding", what + "energy lost in contact", folding.contact, 1e-3, 0.5);
  };
  for (const double friction : {0.0, 0.3}) {
    for (const double spacing : {0.1, 0.05}) {
      const std::string what = fmt::format("h {}, mu {}: ", spacing, friction);
      check("closing U, " + what, closing_u(spacing, friction), 4.0);
      check("flattened tube, " + what, flattened_tube(0.5 * spacing, friction), 5.0);
    }
    check(fmt::format("crumpled sheet, mu {}: ", friction), crumpled_sheet(0.06, friction), 7.0);
  }
  return good;
}

/// Discs that slide, and roll in the end with two thirds of their speed.
bool rolling() {
  bool good = true;
  for (const auto& [alley, name] : {std::pair(Alley::wall, "wall"), std::pair(Alley::body, "body")})
    for (const int edges : {0, 63, 126, 252}) {
      const Rolling disc = roll(alley, edges);
      const std::string what =
          fmt::format("{} on a {}: ", edges == 0 ? "rigid disc" : fmt::format("disc of {} edges", edges), name);
      good &= row("rolling", what + "speed / closed form", disc.speed, 0.99, 1.01);
      good &= row("rolling", what + "slip / speed", disc.slip, -0.01, 0.01);
      good &= row("rolling", what + "energy error", disc.energy_error, -0.01, 0.01);
    }
  return good;
}

/// A seal that is pressed by 30 %: its force over the way, against nodes that are four times as fine.
bool seal() {
  constexpr int parts = 6;
  const std::vector<double> force = press_seal({.spacing = 0.1}, parts), fine = press_seal({.spacing = 0.025}, parts),
                            slow = press_seal({.spacing = 0.1, .time = 200.0}, parts);
  bool good = true;
  for (int k = 0; k < parts; ++k) {
    const std::string what = fmt::format("{} % pressed: ", 5 * (k + 1));
    good &= row("seal", what + "force / force with a quarter of the spacing", force[k] / fine[k], 0.97, 1.03);
    good &= row("seal", what + "force / force pressed half as fast", force[k] / slow[k], 0.98, 1.02);
  }
  return good;
}

/// Mass scaling: the stated error beside that of the force, over the largest force. Where less than half of it is
/// stated there is a warning, and none where there is hardly any.
bool scaling() {
  bool good = true;
  const auto compare = [&](const ScalingScene& scene, bool is_slow_block) {
    const ScalingResult real = run_scaling(scene, {});
    for (const double factor : {10.0, 100.0, 1000.0}) {
      const ScalingResult scaled = run_scaling(scene, {.factor = factor});
      const double error = scaling_error(scaled, real), stated = scaled.inertia.error();
      const bool is_warned = !scaled.inertia.is_known() || stated > warned_inertia;
      const std::string what = fmt::format("{}, factor {}: ", scene.name, factor);
      if (is_slow_block)
        good &= row("scaling", what + "steps / steps without",
                    static_cast<double>(scaled.steps) / static_cast<double>(real.steps), 0.0, 1.3 / std::sqrt(factor));
      row("scaling", what + "error of the largest force", largest_force(scaled) / largest_force(real) - 1.0, -1.0,
          20.0);
      row("scaling", what + "largest error / largest force", error, 0.0, 20.0);
      row("scaling", what + "stated error", stated, 0.0, 20.0);
      // Contact chatters by some three hundredths of the force, and hundredths of the time average what rings.
      const double most = is_slow_block && error > 0.02 ? 3.0 : 20.0;
      good &= row("scaling", what + (is_warned ? "stated / largest error, warned" : "stated / largest error"),
                  stated / error, is_warned ? 0.0 : 0.5, most);
    }
  };
  for (const ScalingScene& scene : slow_blocks()) compare(scene, true);
  for (const ScalingScene& scene : other_processes()) compare(scene, false);
  return good;
}

/// Gas at rest: its pressure over twelve crossings of sound.
bool gas() {
  bool good = true;
  for (const bool shock : {false, true})
    for (const double spacing : {0.1, 0.05})
      for (const double strain : {0.2, 0.0}) {
        GasOptions options;
        options.scheme.reconnection_strain = strain;
        if (!shock) options.dynamics.shock = {};
        options.patches = !shock;
        const BoxResult box = run_box({.spacing = spacing}, options);
        const std::string what = fmt::format("h {}, {}, {}: ", spacing, shock ? "viscosity" : "patches",
                                             strain > 0.0 ? "at rest" : "reconnected in every step");
        good &= row("gas", what + "lowest pressure - 1", box.low - 1.0, -1e-6, 0.0);
        good &= row("gas", what + "highest pressure - 1", box.high - 1.0, 0.0, 1e-6);
        good &= row("gas", what + "energy error", box.energy, -0.01, 0.01);
      }
  return good;
}

/// Noh's problem: density and pressure behind the shock, and what the wall, or the axis, is heated by.
bool noh() {
  bool good = true;
  for (const bool cylindrical : {false, true}) {
    double before = 0.0;
    for (const double spacing : {0.04, 0.02, 0.01}) {
      if (spacing == 0.01 && !cylindrical) continue;
      const Noh of{.cylindrical = cylindrical, .spacing = spacing};
      const NohResult found = run_noh(of, {});
      const bool finest = spacing == (cylindrical ? 0.01 : 0.02);
      const std::string what = fmt::format("{}, h {}: ", cylindrical ? "cylindrical" : "planar", spacing);
      good &= row("noh", what + "density behind the shock / closed form", found.density.mean / of.plateau(),
                  finest ? 0.9 : 0.5, 1.1);
      row("noh", what + "pressure there / closed form", found.pressure.mean / of.pressure_behind(), 0.0, 2.0);
      row("noh", what + "its standard deviation / mean", found.pressure.deviation() / found.pressure.mean, 0.0, 1.0);
      row("noh", what + "mass there over its area / closed form", found.mass_density / of.plateau(), 0.0, 2.0);
      row("noh", what + "density next to the wall / closed form", found.wall / of.plateau(), 0.0, 1.0);
      good &= row("noh", what + "radius of the shock / closed form", found.shock / of.shock(), finest ? 0.95 : 0.8,
                  finest ? 1.05 : 1.2);
      good &= row("noh", what + "energy error", found.energy, -0.01, 0.01);
      row("noh", what + "error of density in L1 / its integral", found.error, 0.0, 1.0);
      if (before > 0.0) good &= row("noh", what + "order", std::log2(before / found.error), 0.3, 2.0);
      before = found.error;
    }
  }
  return good;
}

/// Sedov's blast: where its shock is, and the jump of density there, which is one point wide.
bool sedov() {
  bool good = true;
  double before = 0.0;
  for (const double spacing : {0.04, 0.02}) {
    const Sedov of{.spacing = spacing};
    const SedovResult found = run_sedov(of, {});
    const std::string what = fmt::format("h {}: ", spacing);
    good &= row("sedov", what + "radius of the shock / closed form", found.front / of.shock(), 0.97, 1.03);
    good &= row("sedov", what + "density at the shock / closed form", found.peak / Sedov::jump(), 0.6, 1.02);
    good &= row("sedov", what + "energy error", found.energy, -0.01, 0.01);
    const double error = 1.0 - found.peak / Sedov::jump();
    if (before > 0.0)
      good &= row("sedov", what + "order of the density at the shock", std::log2(before / error), 0.1, 2.0);
    before = error;
  }
  return good;
}

/// A jet of water on a wall: its force, and the pressure at the stagnation point.
bool jet() {
  bool good = true;
  for (const double viscosity : {0.06, 0.5}) {
    GasOptions options;
    options.dynamics.shock = {.linear = viscosity, .quadratic = 2.0};
    const JetResult found = run_jet({}, options);
    const double pressure = Jet::stagnation_pressure();
    const std::string what = fmt::format("viscosity {}: ", viscosity);
    good &= row("jet", what + "force on the wall / rho v^2 area", found.force, 0.95, 1.05);
    good &= row("jet", what + "mean stagnation pressure / (rho v^2 / 2)", found.pressure.mean / pressure, 0.9, 1.1);
    good &= row("jet", what + "its standard deviation", found.pressure.deviation() / pressure, 0.0, 0.2);
    row("jet", what + "that of means over the points, in time", found.means.deviation() / pressure, 0.0, 1.0);
    good &= row("jet", what + "energy error", found.energy, -0.03, 0.03);
  }
  return good;
}

const Rows rows{{"friction", friction}, {"compliance", compliance},
                {"folding", folding},   {"rolling", rolling},
                {"seal", seal},         {"scaling", scaling},
                {"gas", gas},           {"noh", noh},
                {"sedov", sedov},       {"jet", jet}};

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  try {
    return efree::bench::print_rows(efree::rows, {argv + 1, argv + argc}) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_scenes: %s\n", error.what());
    return 2;
  }
}
