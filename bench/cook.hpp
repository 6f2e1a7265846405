// SPDX-License-Identifier: GPL-3.0-or-later
/// Cook's membrane (Cook 1974) in plane strain, from compressible to nearly incompressible, at small and finite
/// strains; tests and the study share it.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <array>

namespace efree::bench {

/// Clamped on the left, a dead load F = 100 upwards on the right, E = 240.565.
struct Cook {
  /// Deflection of the middle of the right side by P2 elements (with a mean dilatation in each cell from nu = 0.49 on)
  /// on three meshes, extrapolated: `bench_stability truth`.
  struct Truth {
    double nu, small, finite;
  };
  static constexpr std::array<Truth, 5> truths{{{0.3, 9.1218, 7.8923},
                                                {0.49, 7.7910, 7.0285},
                                                {0.499, 7.7062, 6.9702},
                                                {0.4999, 7.6976, 6.9643},
                                                {0.499999, 7.6967, 6.9637}}};

  double nu;
  bool finite = false;

  static FineMesh<2> mesh(double size) { return triangulate(shapes::cook(), {.size = size}); }

  /// All that the library asks for; the rest is as its defaults say.
  Settings<2> settings() const {
    const SharedMaterial material =
        finite ? SharedMaterial(NeoHookean({.E = 240.565, .nu = nu})) : SharedMaterial(LinearElastic(240.565, nu));
    return {.common = {.model = {.material = material, .plane = Plane::strain}},
            .supports = {clamp<2>("left")},
            .loads = {.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(0.0, 100.0 / 16.0); }}}},
            .probes = {{"tip", {48.0, 52.0}}}};
  }
  /// The cloud by itself, without the corrections towards elements.
  Settings<2> cloud(double spacing, std::uint64_t seed = 1) const {
    Settings<2> result = settings();
    result.common.approximation = {.spacing = spacing, .seed = seed};
    result.estimated = result.corrected = false;
    return result;
  }
  Settings<2> elements(BasisKind kind) const {
    Settings<2> result = settings();
    result.common.approximation = {.kind = kind};
    result.estimated = result.corrected = false;
    return result;
  }

  static double tip(const Result<2>& result) { return result.probes.at(0).second.displacement.y(); }
  static double tip(const FineMesh<2>& mesh, const Settings<2>& settings) { return tip(analyse(mesh, settings)); }
};

}  // namespace efree::bench
