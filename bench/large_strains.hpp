// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies at large strains that go on until methods break. Tests and the study share them.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"

#include <cmath>
#include <numbers>
#include <string>
#include <utility>

namespace efree::bench {

/// A body, what happens to it, and the part whose force along an axis is looked at, or a point that moves.
struct LargeCase {
  std::string name;
  PlanarDomain domain;
  Settings<2> settings;
  std::string part;  ///< empty: the first probe
  int axis = 0;
  double on_the_way = 0.5;  ///< a time at which methods are compared

  double force(const HistoryStep<2>& step) const {
    return part.empty() ? step.probes.front()[axis] : step.reactions.at(part).force[axis];
  }
};

inline Settings<2> large_settings(SharedMaterial material, Plane plane, double step, double stop = 0.5) {
  Settings<2> settings;
  settings.common.model.material = std::move(material);
  settings.common.model.plane = plane;
  settings.time = TimeSettings<2>{.path = {.step = step, .stops = {stop}}};
  settings.estimated = settings.corrected = false;
  return settings;
}
inline DisplacementCondition<2> moved_by(std::string on, double ux, double uy) {
  return {std::move(on), {[ux](const Vec<2>&) { return ux; }, [uy](const Vec<2>&) { return uy; }}, {}};
}

/// Half of a rubber block between plates that hold it, pressed to a quarter of its height.
inline LargeCase pressed_block() {
  LargeCase result{"pressed block",
                   shapes::rectangle(0.0, 0.0, 1.0, 1.0),
                   large_settings(NeoHookean({.E = 1.0, .nu = 0.3}), Plane::strain, 0.05, 0.4),
                   "top",
                   1,
                   0.4};
  result.settings.supports = {symmetry_plane<2>("left"), clamp<2>("bottom"), moved_by("top", 0.0, -0.75)};
  return result;
}
/// A square held at both ends, pulled to ten times its length.
inline LargeCase pulled_square() {
  LargeCase result{"pulled square", shapes::rectangle(0.0, 0.0, 1.0, 1.0),
                   large_settings(NeoHookean({.E = 1.0, .nu = 0.3}), Plane::strain, 0.02), "right", 0};
  result.settings.supports = {clamp<2>("left"), moved_by("right", 9.0, 0.0)};
  return result;
}
/// A beam, ten times as long as it is deep, bent to a full circle: its end goes round with the end of an arc of the
/// beam's length.
inline LargeCase bent_to_circle() {
  LargeCase result{"beam to circle", shapes::rectangle(0.0, -0.5, 10.0, 0.5),
                   large_settings(NeoHookean({.E = 1.0, .nu = 0.3}), Plane::strain, 0.02), "right", 0};
  const auto supports = [](double time) {
    const double angle = 2.0 * std::numbers::pi * time, length = 10.0;
    const Vec<2> end = angle == 0.0
                           ? Vec<2>(length, 0.0)
                           : Vec<2>(length / angle * std::sin(angle), length / angle * (1.0 - std::cos(angle)));
    const auto u = [=](const Vec<2>& x) -> Vec<2> {
      return end + x[1] * Vec<2>(-std::sin(angle), std::cos(angle)) - x;
    };
    return std::vector<DisplacementCondition<2>>{
        clamp<2>("left"),
        {"right", {[u](const Vec<2>& x) { return u(x)[0]; }, [u](const Vec<2>& x) { return u(x)[1]; }}, {}}};
  };
  result.settings.supports = supports(1.0);
  result.settings.time->acting = [supports](double time) { return Acting<2>{supports(time), {}}; };
  return result;
}
/// Half of a bar of circular section that necks, a section of it (Simo 1992; its middle is 1.8 % thinner).
inline LargeCase necking_bar() {
  const double R = 6.413, middle = 0.982 * R, half = 26.667;
  const J2 metal({.moduli = {.E = 206.9, .nu = 0.29},
                  .yield = Hardening::voce(0.45, 0.715, 16.93, 0.12924),
                  .strain = Strain::finite});
  LargeCase result{"necking bar",
                   {.boundary = {{"bottom", {{0.0, 0.0}, {middle, 0.0}}},
                                 {"side", {{middle, 0.0}, {R, half}}},
                                 {"top", {{R, half}, {0.0, half}}},
                                 {"axis", {{0.0, half}, {0.0, 0.0}}}}},
                   large_settings(metal, Plane::axisymmetric, 0.02),
                   "top",
                   1};
  result.settings.supports = {symmetry_plane<2>("bottom"), moved_by("top", 0.0, 7.0)};
  result.settings.probes = {{"neck", Vec<2>(middle, 0.0)}};
  return result;
}
/// Cook's membrane as nearly incompressible rubber, under a dead load.
inline LargeCase cook_rubber() {
  LargeCase result{"Cook, nu = 0.4999", shapes::cook(),
                   large_settings(NeoHookean({.E = 240.565, .nu = 0.4999}), Plane::strain, 0.1), "", 1};
  result.settings.supports = {clamp<2>("left")};
  result.settings.loads.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(0.0, 100.0 / 16.0); }}};
  result.settings.probes = {{"tip", Vec<2>(48.0, 52.0)}};
  return result;
}

}  // namespace efree::bench
