// SPDX-License-Identifier: GPL-3.0-or-later
/// A strip with an edge crack under tension: the crack is a slit of the fine mesh, and nothing else has to know of it.
///
///   div sigma = 0,   sigma = C : sym(grad u),   crack: sigma n = 0
///
///        ^ ^ ^ ^ ^ ^   top: sigma n = (0, 1)
///       |-----------|
///       |======     |  crack of length 0.5 from the left side
///       |-----------|
///       /////////////  bottom: u = 0
///
/// Weights by geodesic distance go around the tip and never reach through the crack. Prints how far it opens at the
/// left side, against P1 elements on the same fine mesh.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

static double opening(const FineMesh<2>& mesh, const ApproximationOptions& options) {
  const Approximation<2> strip = approximate(mesh, options);
  const ElasticSolver<2> solver(strip, {.material = LinearElastic(1.0, 0.3), .plane = Plane::strain},
                                {clamp<2>("bottom")});
  const Fields<2> fields = recover_fields(strip, solver.solve({.tractions = {tension<2>("top", 1.0)}}));
  double lower = 1e300, upper = -1e300;
  for (Index f : mesh.group("slit"))
    for (int k = 0; k < 2; ++k)
      if (const Index v = mesh.facets()(k, f); mesh.vertex(v).x() < 1e-9) {
        lower = std::min(lower, fields.displacement(1, v));
        upper = std::max(upper, fields.displacement(1, v));
      }
  return upper - lower;
}

int main() {
  const FineMesh<2> mesh = triangulate(shapes::slit_rectangle(0, -1, 1, 1, {0, 0}, {0.5, 0}), {.size = 0.02});
  const double elements = opening(mesh, {.kind = BasisKind::p1});
  const double cloud = opening(mesh, {.spacing = 0.08});
  std::printf("crack opening: P1 on %d fine vertices %.3f, efree %.3f, %.1f %% apart\n", mesh.num_vertices(), elements,
              cloud, 100.0 * std::abs(cloud / elements - 1));
  return std::abs(cloud / elements - 1) < 0.05 ? 0 : 1;
}
