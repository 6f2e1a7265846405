// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of a perfectly plastic metal under which averaged dilatations can lock, lose the shape or soften: thick ring,
/// circular plate, strip footing. Tests and the study share them.
#pragma once

#include "efree/bench/plastic_limits.hpp"

#include <cmath>
#include <numbers>
#include <vector>

namespace efree::bench {

/// A quarter of a thick ring in plane strain, b = 2 a, nu = 0.3, under pressure on its bore, which grows with the time.
/// Plastic as far as the radius c: p = Y' (ln(c / a) + (1 - c^2 / b^2) / 2), the outer surface moves by
/// Y' c^2 (1 - nu^2) / (E b), Y' = 2 Y / sqrt(3) (Hill 1950; de Souza Neto, Peric & Owen 2008, section 7.5.1).
struct PressedRing {
  static constexpr double end = 0.18;
  static bool is_stop(double p) {
    return std::abs(p - 0.10) < 1e-9 || std::abs(p - 0.14) < 1e-9 || std::abs(p - end) < 1e-9;
  }
  Metal metal{};

  /// Of the outer surface.
  double displacement(double p) const {
    const double a = ThickWall::inner, b = ThickWall::outer, Y = 2.0 * metal.yield / std::sqrt(3.0);
    const double per_square = (1.0 - metal.nu * metal.nu) / (metal.E * b);
    double low = a, high = b;
    if (p <= 0.5 * Y * (1.0 - a * a / (b * b))) return 2.0 * p * a * a * b * b * per_square / (b * b - a * a);
    for (int k = 0; k < 60; ++k) {
      const double c = 0.5 * (low + high);
      (Y * (std::log(c / a) + 0.5 * (1.0 - c * c / (b * b))) < p ? low : high) = c;
    }
    return Y * low * low * per_square;
  }
  FineMesh<2> mesh(double size) const { return mesh_of<2>(PressedWall::tube, size); }
  Settings<2> settings(const ApproximationOptions& options) const {
    Settings<2> settings = wall_settings<2>(PressedWall::tube, metal, options, {.pressure = [](double t) { return t; }},
                                            {.end = end, .step = 0.02, .stops = {0.10, 0.14}});
    settings.estimated = false;
    constexpr int probes = 7;
    for (int k = 0; k < probes; ++k) {
      const double angle = 0.5 * std::numbers::pi * k / (probes - 1);
      const double r = k == 0 || k == probes - 1 ? 2.0 : 1.99;
      settings.probes.push_back({std::to_string(k), r * Vec<2>(std::cos(angle), std::sin(angle))});
    }
    return settings;
  }
  /// The error, relative, of the outward displacement that is furthest off around the ring.
  double worst(const HistoryStep<2>& step) const {
    double worst = 0.0;
    for (std::size_t k = 0; k < step.probes.size(); ++k) {
      const double angle =
          0.5 * std::numbers::pi * static_cast<double>(k) / (static_cast<double>(step.probes.size()) - 1.0);
      const double u = step.probes[k].dot(Vec<2>(std::cos(angle), std::sin(angle)));
      const double off = u / displacement(step.time) - 1.0;
      if (std::abs(off) > std::abs(worst)) worst = off;
    }
    return worst;
  }
};

/// A circular plate of radius 10 and thickness 1, simply supported along its rim, under pressure.
struct BentPlate {
  static constexpr double radius = 10.0, limit = 260.8;  ///< limit load (de Souza Neto et al. 2008, section 7.5.3)
  Metal metal{.E = 1e7, .nu = 0.24, .yield = 16000.0};

  /// Of the centre of the lower face while it is elastic: quadratic elements on a fine mesh.
  static double deflection(double p) { return -0.0751 * p / 100.0; }
  FineMesh<2> mesh(double size) const { return triangulate(shapes::rectangle(0.0, 0.0, radius, 1.0), {.size = size}); }
  Settings<2> settings(const ApproximationOptions& options, double most) const {
    Settings<2> settings;
    settings.common.model.material = metal.material();
    settings.common.model.plane = Plane::axisymmetric;
    settings.common.approximation = options;
    settings.supports = {{"right", {ScalarField<2>{}, [](const Vec<2>&) { return 0.0; }}, {}}};
    settings.loads.tractions = {pressure<2>("top", [most](const Vec<2>&) { return most; })};
    settings.time = TimeSettings<2>{.path = {.end = most, .step = 20.0, .max_step = 20.0}};
    settings.probes = {{"centre", {0.0, 0.0}}};
    settings.estimated = false;
    return settings;
  }
};

/// Half of a rigid, smooth strip footing of half width 50 on soil 500 wide and deep, pressed down by the time, nu =
/// 0.48. Loads of a fine mesh over the cohesion (de Souza Neto et al. 2008, section 7.5.4).
struct Footing {
  static constexpr double stops[] = {0.020, 0.045, 0.075, 0.080, 0.2}, loads[] = {3.62, 4.70, 5.12, 5.18, 5.20};
  double least = 5.0, most = 60.0;
  Metal metal{.E = 1e7, .nu = 0.48, .yield = 848.7049};

  FineMesh<2> mesh() const {
    return grid(graded_line(0.0, 500.0, 50.0, least, most), graded_line(0.0, 500.0, 500.0, least, most),
                [](const Vec<2>& x) -> std::string {
                  if (x[1] > 500.0 - 1e-6) return x[0] < 50.0 ? "footing" : "top";
                  return x[1] < 1e-6 ? "base" : x[0] < 1e-6 ? "axis" : "far";
                });
  }
  Settings<2> settings(const ApproximationOptions& options) const {
    Settings<2> settings;
    settings.common.model.material = metal.material();
    settings.common.model.plane = Plane::strain;
    settings.common.approximation = options;
    settings.supports = {clamp<2>("base"),
                         symmetry_plane<2>("far"),
                         symmetry_plane<2>("axis"),
                         {"footing", {ScalarField<2>{}, [](const Vec<2>&) { return -0.2; }}, {}}};
    settings.time = TimeSettings<2>{.path = {.end = 0.2, .step = 0.005, .stops = {0.020, 0.045, 0.075, 0.080}}};
    settings.estimated = false;
    return settings;
  }
  /// Mean pressure over the cohesion.
  double load(const HistoryStep<2>& step) const {
    return std::abs(step.reactions.at("footing").force[1]) / 50.0 / (metal.yield / std::sqrt(3.0));
  }
};

}  // namespace efree::bench
