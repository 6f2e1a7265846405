// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_slices.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>

namespace efree {
namespace {

/// Adds sums, which become means in the end.
void add(CellSlice& to, const CellSlice& more) {
  to.solid += more.solid;
  to.stress += more.stress;
  to.von_mises += more.von_mises;
  to.most = std::max(to.most, more.most);
}

}  // namespace

std::array<std::vector<CellSlice>, 3> cell_slices(const Lattice& grid, const CellFields& fields) {
  const auto& n = grid.cubes;
  using Sums = std::array<std::vector<CellSlice>, 3>;
  std::vector<Sums> of_layer(n[2]);
  parallel_chunks(n[2], 1, [&](Index k, Index) {
    Sums& sums = of_layer[k];
    for (int d = 0; d < 3; ++d) sums[d].resize(d == 2 ? 1 : n[d]);
    auto cell = static_cast<Eigen::Index>(n[0]) * n[1] * k;
    for (Index j = 0; j < n[1]; ++j)
      for (Index i = 0; i < n[0]; ++i, ++cell) {
        const auto solid = static_cast<double>(fields.solid[cell]),
                   von_mises = static_cast<double>(fields.von_mises[cell]);
        if (solid == 0.0) continue;
        const CellSlice one{.solid = solid,
                            .stress = solid * fields.stress.col(cell).cast<double>(),
                            .von_mises = solid * von_mises,
                            .most = von_mises};
        add(sums[0][i], one);
        add(sums[1][j], one);
        add(sums[2][0], one);
      }
  });
  Sums slices;
  for (int d = 0; d < 3; ++d) {
    slices[d].resize(n[d]);
    for (Index k = 0; k < n[2]; ++k)
      for (std::size_t s = 0; s < of_layer[k][d].size(); ++s) add(slices[d][d == 2 ? k : s], of_layer[k][d][s]);
    const double cells = static_cast<double>(n[0]) * n[1] * n[2] / n[d];
    for (Index s = 0; s < n[d]; ++s) {
      CellSlice& slice = slices[d][s];
      slice.at = (s + 0.5) * grid.spacing[d];
      if (slice.solid == 0.0) continue;
      slice.stress /= slice.solid;
      slice.von_mises /= slice.solid;
      slice.solid /= cells;
    }
  }
  return slices;
}

}  // namespace efree
