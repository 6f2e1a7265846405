// SPDX-License-Identifier: GPL-3.0-or-later
// Too few quadrature points: modes that they do not see, at rest, at large strains and after yield.
#include "stability.hpp"
#include "tangent_modes.hpp"

#include <fmt/format.h>

namespace efree::bench {

void too_few_points(const StudyOf& study) {
  Table table(
      study.folder, "points",
      {"state", "basis", "asked", "cloud", "M/N", "smallest", "every cell", "seen", "zero modes", "negative modes"});
  constexpr double spacing = 0.125;
  const FineMesh<2> mesh = StrainedBlock::mesh(spacing / 6.0);
  for (const auto& block : StrainedBlock::all())
    for (const auto& [secondary, name] :
         {std::pair{SecondaryKind::cells, "cells"}, {SecondaryKind::linear, "linear"}, {SecondaryKind::mls, "mls"}})
      for (const double ratio : {0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 0.0})
        for (int seed = 1; seed <= study.seeds; ++seed) {
          const Coercivity found(
              block, mesh,
              {.spacing = spacing, .seed = static_cast<std::uint64_t>(seed), .secondary = secondary, .ratio = ratio});
          table.row({block.name, name, ratio > 0.0 ? fmt::format("{}", ratio) : "default", fmt::format("{}", seed),
                     fmt::format("{:.2f}", found.ratio), fmt::format("{:.4f}", found.eigenvalues[0]),
                     fmt::format("{:.4f}", found.every_cell), fmt::format("{:.3f}", found.seen()),
                     fmt::format("{}", found.zero()), fmt::format("{}", found.negative())});
        }
}

}  // namespace efree::bench
