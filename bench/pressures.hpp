// SPDX-License-Identifier: GPL-3.0-or-later
/// Pressures of nearly incompressible bodies: whether they hang on displacements, and whether they swing; tests and the
/// study share it.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/bench/inf_sup.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <cmath>
#include <numbers>

namespace efree::bench {

/// A quarter of a thick tube (1 to 2) in plane strain under unit pressure inside: its mean stress is the same
/// everywhere (Lame 1852).
struct Tube {
  double nu = 0.4999;

  static PlanarDomain domain(double size) {
    const auto arc = [&](double radius, double from, double to) {
      const int chords = static_cast<int>(std::ceil(radius * std::numbers::pi / 2.0 / size));
      std::vector<Vec<2>> points;
      for (int i = 0; i <= chords; ++i) {
        const double t = from + (to - from) * i / chords;
        points.push_back(t == 0.0   ? Vec<2>(radius, 0.0)
                         : t == 1.0 ? Vec<2>(0.0, radius)
                                    : Vec<2>(radius * std::cos(t * std::numbers::pi / 2.0),
                                             radius * std::sin(t * std::numbers::pi / 2.0)));
      }
      return points;
    };
    return {.boundary = {{"bottom", {{1.0, 0.0}, {2.0, 0.0}}},
                         {"outer", arc(2.0, 0.0, 1.0)},
                         {"left", {{0.0, 2.0}, {0.0, 1.0}}},
                         {"inner", arc(1.0, 1.0, 0.0)}}};
  }
  Settings<2> settings() const {
    return {.common = {.model = {.material = LinearElastic(1.0, nu), .plane = Plane::strain}},
            .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
            .loads = {.tractions = {efree::pressure<2>("inner", [](const Vec<2>&) { return 1.0; })}}};
  }
  /// A third of the trace, with s_zz = nu (s_xx + s_yy) and s_xx + s_yy = 2 a^2 / (b^2 - a^2).
  double mean_stress() const { return (1.0 + nu) / 3.0 * 2.0 / 3.0; }
};

/// What the mean stress is off where it should be constant, relative to it: root of the mean square over the quadrature
/// points, and the most at any vertex, as it is written out.
struct Swing {
  double mean, worst;
  Swing(const Result<2>& result, double exact) {
    const auto off = [&](const VoigtPoints<2>& stress) -> Vector {
      return stress.topRows<3>().colwise().mean().transpose().array() / exact - 1.0;
    };
    const auto& weights = result.basis().quadrature.weights;
    mean = std::sqrt(weights.dot(off(result.solution.stress).cwiseAbs2()) / weights.sum());
    worst = off(result.fields.stress).lpNorm<Eigen::Infinity>();
  }
};

/// Total variation of the mean stress that is written out, over the body: int |grad p|.
inline double total_variation(const Result<2>& result) {
  const FineSpace<2>& space = result.basis().space;
  const FineMesh<2>& mesh = space.mesh();
  double sum = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Vec<2> a = mesh.vertex(mesh.cells()(0, c)), b = mesh.vertex(mesh.cells()(1, c)),
                 d = mesh.vertex(mesh.cells()(2, c));
    Mat<2> edges;
    edges << b - a, d - a;
    const auto p = [&](int k) { return result.fields.stress.col(mesh.cells()(k, c)).head<3>().mean(); };
    const Vec<2> slope = edges.transpose().inverse() * Vec<2>(p(1) - p(0), p(2) - p(0));
    sum += mesh.volume(c) * slope.norm();
  }
  return sum;
}

}  // namespace efree::bench
