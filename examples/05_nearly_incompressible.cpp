// SPDX-License-Identifier: GPL-3.0-or-later
/// Cook's membrane of a nearly incompressible material, plane strain, by the defaults: functions that would lock
/// average their dilatations, without a word from the user.
///
///   div sigma = 0,   sigma = C : sym(grad u),   nu = 0.4999
///
///               __|  right: sigma n = (0, 6.25), from (48, 44) to (48, 60)
///           __--  | ^
///     / __--      |
///     /|       __-   top, bottom: sigma n = 0
///     /|   __--
///     /|_--          left: u = 0, from (0, 0) to (0, 44)
///
/// Prints the deflection in the middle of the right side against very fine finite elements.
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

/// Reference of examples/cook.
constexpr double deflection = 7.695;

int main() {
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 1.2});
  const Settings<2> settings{
      .common = {.model = {.material = LinearElastic(240.565, 0.4999), .plane = Plane::strain},
                 .approximation = {.spacing = 3.2}},
      .supports = {clamp<2>("left")},
      .loads = {.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(0.0, 6.25); }}}},
      .probes = {{"tip", {48.0, 52.0}}}};
  const auto error = [&](const char* name, const Settings<2>& of) {
    const double tip = analyse(mesh, of).probes[0].second.displacement.y();
    std::printf("%-28s %.3f, error %+6.2f %%\n", name, tip, 100.0 * (tip / deflection - 1.0));
    return std::abs(tip / deflection - 1.0);
  };
  Settings<2> cloud = settings, locked = settings;
  cloud.corrected = locked.estimated = locked.corrected = false;
  locked.common.approximation.dilatation = Dilatation::pointwise;
  const double corrected = error("defaults", settings), alone = error("the cloud alone", cloud);
  const double stiff = error("dilatations at every point", locked);
  return corrected < 0.002 && alone < 0.02 && stiff > 0.1 ? 0 : 1;
}
