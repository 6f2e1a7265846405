// SPDX-License-Identifier: GPL-3.0-or-later
// Pressures at nu = 0.4999: inf-sup values, swings where they should be constant, total variation.
#include "cook.hpp"
#include "pressures.hpp"
#include "stability.hpp"

#include <fmt/format.h>

namespace efree::bench {

void pressure_oscillation(const StudyOf& study) {
  std::printf("Smallest inf-sup value of pressures, square of side 1\n\n");
  const Materials<2> materials({LinearElastic(1.0, 0.0)}, Plane::strain);
  Table values(study.folder, "inf_sup", {"basis", "H", "cloud", "nodes", "pressures", "inf-sup"});
  for (const auto& [secondary, name] : {std::pair{SecondaryKind::cells, "cells"}, {SecondaryKind::linear, "linear"}})
    for (const double H : {0.2, 0.1, 0.05, 0.025}) {
      const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 6.0});
      for (int seed = 1; seed <= study.seeds; ++seed) {
        const auto approximation = approximate(mesh, {.spacing = H,
                                                      .seed = static_cast<std::uint64_t>(seed),
                                                      .secondary = secondary,
                                                      .dilatation = Dilatation::averaged});
        values.row({name, fmt::format("{}", H), fmt::format("{}", seed), fmt::format("{}", approximation.nodes.cols()),
                    fmt::format("{}", approximation.dilatation.size()),
                    fmt::format("{:.3f}", inf_sup(approximation, materials))});
      }
    }

  const auto methods = [&](Table& table, double H, const Settings<2>& given, const auto& mesh_of, const auto& measure) {
    const auto add = [&](const char* method, int seed, const FineMesh<2>& mesh, const Settings<2>& settings) {
      const Result<2> result = analyse(mesh, settings);
      std::vector<std::string> cells{method, fmt::format("{}", H), fmt::format("{}", seed),
                                     fmt::format("{}", result.approximation.nodes.cols())};
      for (const double value : measure(result)) cells.push_back(fmt::format("{:.2f}", value));
      table.row(cells);
    };
    const FineMesh<2> fine = mesh_of(H / 6.0);
    for (int seed = 1; seed <= study.seeds; ++seed)
      for (const bool corrected : {true, false}) {
        Settings<2> settings = given;
        settings.common.approximation = {.spacing = H, .seed = static_cast<std::uint64_t>(seed)};
        if (!corrected) settings.estimated = settings.corrected = false;
        add(corrected ? "efree" : "cloud alone", seed, fine, settings);
      }
    Settings<2> settings = given;
    settings.estimated = settings.corrected = false;
    settings.common.approximation = {
        .spacing = H, .secondary = SecondaryKind::full, .dilatation = Dilatation::pointwise};
    add("full integration", 1, fine, settings);
    settings.common.approximation = {.kind = BasisKind::p1};
    add("P1", 1, mesh_of(1.45 * H), settings);
    settings.common.approximation = {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise};
    add("P2", 1, mesh_of(2.9 * H), settings);
    settings.common.approximation = {.kind = BasisKind::p2, .dilatation = Dilatation::averaged};
    add("P2 with mean dilatation", 1, mesh_of(2.9 * H), settings);
  };

  std::printf("\nMean stress of a thick tube, constant by Lame: per cent off, root mean square and worst vertex\n\n");
  Table tube(study.folder, "tube", {"method", "H", "cloud", "nodes", "rms %", "worst %"});
  const Tube thick;
  for (const double H : {0.24, 0.12, 0.06})
    methods(
        tube, H, thick.settings(), [](double size) { return triangulate(Tube::domain(size), {.size = size}); },
        [&](const Result<2>& result) {
          const Swing swing(result, thick.mean_stress());
          return std::vector{100.0 * swing.mean, 100.0 * swing.worst};
        });

  std::printf("\nTotal variation of the mean stress in Cook's membrane\n\n");
  Table cook(study.folder, "variation", {"method", "H", "cloud", "nodes", "int |grad p|"});
  for (const double H : {6.4, 3.2, 1.6})
    methods(
        cook, H, Cook{0.4999}.settings(), [](double size) { return Cook::mesh(size); },
        [](const Result<2>& result) { return std::vector{total_variation(result)}; });
  Settings<2> fine = Cook{0.4999}.elements(BasisKind::p2);
  fine.common.approximation.dilatation = Dilatation::averaged;
  for (const double h : {0.8, 0.4})
    cook.row({"P2 with mean dilatation (fine)", fmt::format("{}", h), "1", "",
              fmt::format("{:.2f}", total_variation(analyse(Cook::mesh(h), fine)))});
}

}  // namespace efree::bench
