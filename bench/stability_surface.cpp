// SPDX-License-Identifier: GPL-3.0-or-later
// Surface instability of a compressed nearly incompressible block.
#include "compressed_block.hpp"
#include "stability.hpp"

#include <fmt/format.h>

namespace efree::bench {

void surface_instability(const StudyOf& study) {
  Table table(study.folder, "surface", {"method", "H", "cloud", "nodes", "stretch", "error %"});
  const auto add = [&](const char* method, double H, int seed, const FineMesh<2>& mesh,
                       const ApproximationOptions& options) {
    const CompressedBlock block;
    const auto approximation = block.approximation(mesh, options);
    const double stretch = block.first_zero(approximation, options.kind);
    table.row({method, fmt::format("{}", H), fmt::format("{}", seed), fmt::format("{}", approximation.nodes.cols()),
               stretch > 0.0 ? fmt::format("{:.4f}", stretch) : "none",
               stretch > 0.0 ? fmt::format("{:.2f}", 100.0 * (stretch / block.critical() - 1.0)) : "nan"});
  };
  for (const double H : {0.25, 0.167, 0.125, 0.0833, 0.0625}) {
    const FineMesh<2> mesh = CompressedBlock::mesh(H / 6.0);
    for (int seed = 1; seed <= study.seeds; ++seed)
      add("efree", H, seed, mesh, {.spacing = H, .seed = static_cast<std::uint64_t>(seed)});
    add("full integration", H, 1, mesh,
        {.spacing = H, .secondary = SecondaryKind::full, .dilatation = Dilatation::pointwise});
    add("P1", H, 1, CompressedBlock::mesh(1.45 * H), {.kind = BasisKind::p1, .dilatation = Dilatation::pointwise});
    add("P2", H, 1, CompressedBlock::mesh(2.9 * H), {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise});
    add("P2 with mean dilatation", H, 1, CompressedBlock::mesh(2.9 * H), {.kind = BasisKind::p2});
  }
}

}  // namespace efree::bench
