// SPDX-License-Identifier: GPL-3.0-or-later
/// An error instead of a mesh: an L-shaped plate that hangs under its own weight. At the corner inside it stresses are
/// without bound.
///
///   div sigma + b = 0,   sigma = C : sym(grad u),   b = (0, -1)
///
///     ////  top: u = 0
///    |    |
///    |    |___
///    |        |  all other sides: sigma n = 0
///    |________|
///
/// Prints the meshes that were tried, and the error that was said and the true one, both in the energy norm.
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

/// Strain energy, of quadratic elements on three meshes, extrapolated (bench_accuracy truth).
constexpr double true_energy = 0.79354;

int main() {
  // A geometry is a mesh as a function of its size; without one, what is natural for it.
  const MeshSource<2> plate{.mesh = [](const MeshSize& wanted, const Stage&) {
    const double size = wanted.length > 0.0 ? wanted.length : 0.05 * wanted.coarsening;
    return MadeMesh<2>{.mesh = triangulate_data(shapes::l_shape(1.0), {.size = size}), .size = size};
  }};
  bool kept = true;
  for (const double asked : {0.1, 0.05, 0.03}) {
    const Result<2> result =
        analyse(plate, {.common = {.model = {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}},
                        .supports = {clamp<2>("top")},
                        .loads = {.body_force = [](const Vec<2>&) { return Vec<2>(0.0, -1.0); }},
                        .accuracy = asked});
    // What an answer lacks of the energy is the energy of its error: nothing but the load does work.
    const double error = std::sqrt(std::abs(1.0 - result.solution.strain_energy / true_energy));
    std::printf("asked for %2.0f %%: said %.1f %%, true %.1f %%; cells tried:", 100 * asked,
                100 * result.estimates->total(), 100 * error);
    for (const Attempt& attempt : result.attempts) std::printf(" %d", attempt.cells);
    std::printf("\n");
    kept = kept && error < asked && result.refusal.empty();
  }
  return kept ? 0 : 1;
}
