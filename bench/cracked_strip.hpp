// SPDX-License-Identifier: GPL-3.0-or-later
/// A long strip with clamped edges and a crack along its middle, pulled apart (Rice 1967), for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace efree::bench {

/// Of height 1, E = 1 and density 1; 2.5 long, and cracked from x = 0 to 1. Ahead of a long crack it is stretched
/// uniformly, behind it is at rest: G is the energy that a slice of it stores.
struct CrackedStrip {
  static constexpr double length = 2.5, notch = 1.0, nu = 0.3;
  static constexpr double strain_at_onset = 0.003;
  static constexpr double modulus = (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu));  ///< uniaxial strain
  static constexpr double toughness = 0.5 * modulus * strain_at_onset * strain_at_onset;

  double size, ramp;
  Dynamics<2> dynamics;
  Index notched;  ///< points that the crack took at the start

  static DeformableBody<2> body(double size, double neighbourhood, double ramp) {
    DeformableBody<2> body = deformable_body(triangulate(shapes::rectangle(0.0, -0.5, length, 0.5), {.size = size}),
                                             NeoHookean({.E = 1.0, .nu = nu}), 1.0);
    body.fracture = {.toughness = toughness, .neighbourhood = neighbourhood};
    // The edges part at a steady rate. What is behind the crack's tip moves as a whole, which saves it from swinging.
    body.velocity.setZero(2, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      const double x = body.nodes(0, a), y = body.nodes(1, a);
      const double s = std::clamp((x - notch + 0.5) / 0.7, 0.0, 1.0), ahead = s * s * (3.0 - 2.0 * s);
      body.velocity(1, a) = strain_at_onset / ramp * (ahead * y + (1.0 - ahead) * (y > 0.0 ? 0.5 : -0.5));
    }
    return body;
  }
  /// Nodes at most `size` apart. The crack is wider than the supports of shape functions, which would bridge it. G
  /// would get to the toughness at the time `ramp`.
  CrackedStrip(double size, double neighbourhood, double ramp)
      : size(size), ramp(ramp), dynamics({body(size, neighbourhood, ramp)}, otm<2>()) {
    for (Index a = 0; a < dynamics.num_nodes(); ++a)
      if (std::abs(dynamics.nodes()(1, a)) > 0.5 - 1e-9) {
        dynamics.prescribe(a, 0, 0.0);
        dynamics.prescribe(a, 1, dynamics.velocities()(1, a));
      }
    const Points<2> points = dynamics.points();
    for (Index p = 0; p < dynamics.num_points(); ++p)
      if (points(0, p) < notch && std::abs(points(1, p)) < size) dynamics.erode(p);
    notched = static_cast<Index>(dynamics.count("eroded points"));
  }
  /// Energy release rate of a crack that is long, over the toughness.
  double load() const { return std::pow(dynamics.time() / ramp, 2); }
  /// How far the crack has grown.
  double growth() const {
    double tip = notch;
    const Points<2> points = dynamics.points();
    for (Index p = 0; p < dynamics.num_points(); ++p)
      if (dynamics.is_eroded(p)) tip = std::max(tip, points(0, p));
    return tip - notch;
  }
  struct Onset {
    double first;  ///< load at which the first point breaks
    double grown;  ///< load at which the crack has grown by five spacings
  };
  /// Runs until then; infinite where it takes more than four times the load.
  Onset onset() {
    constexpr double never = std::numeric_limits<double>::infinity();
    Onset result{never, never};
    while (load() < 4.0) {
      const std::int64_t before = dynamics.count("eroded points");
      dynamics.step();
      if (dynamics.count("eroded points") == before) continue;
      result.first = std::min(result.first, load());
      if (growth() < 5.0 * size) continue;
      result.grown = load();
      break;
    }
    return result;
  }
};

}  // namespace efree::bench
