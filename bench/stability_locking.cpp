// SPDX-License-Identifier: GPL-3.0-or-later
// Volumetric locking: Cook's membrane from nu = 0.3 to 0.499999.
#include "cook.hpp"
#include "stability.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree::bench {

void cook_truth(const StudyOf& study) {
  Table table(study.folder, "cook_truth", {"strains", "nu", "h", "tip"});
  for (const bool finite : {false, true})
    for (const auto& truth : Cook::truths)
      for (const double h : {1.6, 0.8, 0.4}) {
        Settings<2> settings = Cook{truth.nu, finite}.elements(BasisKind::p2);
        settings.common.approximation.dilatation = averaged_if(truth.nu > 0.4);
        table.row({finite ? "finite" : "small", fmt::format("{}", truth.nu), fmt::format("{}", h),
                   fmt::format("{:.5f}", Cook::tip(Cook::mesh(h), settings))});
      }
}

void volumetric_locking(const StudyOf& study) {
  Table table(study.folder, "locking", {"strains", "nu", "method", "H", "seed", "nodes", "tip", "error %"});
  const auto add = [&](bool finite, const Cook::Truth& truth, const char* method, double spacing, int seed,
                       const FineMesh<2>& mesh, const Settings<2>& settings) {
    std::string tip = "no answer", error = "nan", nodes = "";
    try {
      const Result<2> result = analyse(mesh, settings);
      const double value = Cook::tip(result);
      nodes = fmt::format("{}", result.approximation.nodes.cols());
      tip = fmt::format("{:.4f}", value);
      error = fmt::format("{:.2f}", 100.0 * (value / (finite ? truth.finite : truth.small) - 1.0));
    } catch (const NumericalError& problem) {
      std::fprintf(stderr, "%s\n", problem.what());
    }
    table.row({finite ? "finite" : "small", fmt::format("{}", truth.nu), method, fmt::format("{}", spacing),
               fmt::format("{}", seed), nodes, tip, error});
  };
  for (const bool finite : {false, true})
    for (const auto& truth : Cook::truths) {
      const Cook cook{truth.nu, finite};
      for (const double H : {9.6, 6.4, 4.8, 3.2, 2.4, 1.6}) {
        const FineMesh<2> mesh = Cook::mesh(H / 6.0);
        for (int seed = 1; seed <= study.seeds; ++seed) {
          add(finite, truth, "efree", H, seed, mesh, cook.cloud(H, seed));
          Settings<2> corrected = cook.settings();
          corrected.common.approximation = cook.cloud(H, seed).common.approximation;
          add(finite, truth, "efree, corrected", H, seed, mesh, corrected);
        }
        Settings<2> full = cook.cloud(H);
        full.common.approximation.secondary = SecondaryKind::full;
        full.common.approximation.dilatation = Dilatation::pointwise;
        add(finite, truth, "full integration", H, 1, mesh, full);
        // As many nodes: a cloud has one to 1.15 H^2, triangles one to 0.6 h^2 (P2: 2.4 h^2 are a quarter of those).
        add(finite, truth, "P1", H, 1, Cook::mesh(1.45 * H), cook.elements(BasisKind::p1));
        Settings<2> p2 = cook.elements(BasisKind::p2);
        p2.common.approximation.dilatation = Dilatation::pointwise;
        add(finite, truth, "P2", H, 1, Cook::mesh(2.9 * H), p2);
        p2.common.approximation.dilatation = Dilatation::averaged;
        add(finite, truth, "P2 with mean dilatation", H, 1, Cook::mesh(2.9 * H), p2);
      }
    }
}

}  // namespace efree::bench
