// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_problem.hpp"
#include "efree/solvers/linear/internal/scaled_cholesky.hpp"

#include <algorithm>
#include <memory>

namespace efree::internal {

SmallInverse inverse_of(const CellProblem& problem) {
  const CellGrid& grid = problem.grid;
  std::vector<std::size_t> dofs;  // that are free
  const auto for_nodes = [&](const auto& f) {
    for (Index k = 0; k <= grid.cells[2]; ++k)
      for (Index j = 0; j <= grid.cells[1]; ++j)
        for (Index i = 0; i <= grid.cells[0]; ++i) f(i, j, k);
  };
  std::vector<Index> unknown(grid.size(), -1);
  for_nodes([&](Index i, Index j, Index k) {
    for (int c = 0; c < 3; ++c) {
      const std::size_t dof = c * grid.nodes() + grid.node(i, j, k);
      if (!problem.is_free(dof)) continue;
      unknown[dof] = static_cast<Index>(dofs.size());
      dofs.push_back(dof);
    }
  });
  if (dofs.empty()) return [](const SingleField&, SingleField& x) { std::ranges::fill(x, 0.0F); };
  // Columns of nodes three apart do not overlap: 27 times three products have them all.
  Field u(grid.size()), f(grid.size());
  std::vector<Eigen::Triplet<double, Index>> entries;
  for (int colour = 0; colour < 81; ++colour) {
    const int c = colour / 27, x = colour % 3, y = colour / 3 % 3, z = colour / 9 % 3;
    std::ranges::fill(u, 0.0);
    for_nodes([&](Index i, Index j, Index k) {
      const std::size_t dof = c * grid.nodes() + grid.node(i, j, k);
      if (i % 3 == x && j % 3 == y && k % 3 == z && unknown[dof] >= 0) u[dof] = 1.0;
    });
    problem.apply_isotropic(u.data(), f.data(), Dilatation::local);  // as all coarser grids
    for_nodes([&](Index i, Index j, Index k) {
      // The one node of this colour among the neighbours.
      const Index a = i + (x - i % 3 + 4) % 3 - 1, b = j + (y - j % 3 + 4) % 3 - 1, d = k + (z - k % 3 + 4) % 3 - 1;
      if (a < 0 || b < 0 || d < 0 || a > grid.cells[0] || b > grid.cells[1] || d > grid.cells[2]) return;
      const Index column = unknown[c * grid.nodes() + grid.node(a, b, d)];
      if (column < 0) return;
      for (int r = 0; r < 3; ++r) {
        const std::size_t dof = r * grid.nodes() + grid.node(i, j, k);
        const Index line = unknown[dof];
        // Bodies that nothing holds would make the matrix singular; as a preconditioner it may be a little off.
        if (line >= column) entries.emplace_back(line, column, line == column ? f[dof] * (1.0 + 1e-7) : f[dof]);
      }
    });
  }
  // Held by far stiffer springs, and projected after each solution.
  constexpr double far_stiffer = 1e4;
  for (const ObliqueNode& at : problem.oblique)
    for (int r = 0; r < 3; ++r)
      for (int s = 0; s <= r; ++s) {
        const std::size_t row = r * grid.nodes() + at.node, column = s * grid.nodes() + at.node;
        if (unknown[row] < 0 || unknown[column] < 0) continue;
        const double stiffness = far_stiffer / problem.inverse_diagonal[row];
        entries.emplace_back(unknown[row], unknown[column], stiffness * ((r == s ? 1.0 : 0.0) - at.free(r, s)));
      }
  const auto size = static_cast<Index>(dofs.size());
  SymmetricMatrix K(size, size);
  K.setFromTriplets(entries.begin(), entries.end());
  return on_unknowns(std::move(dofs), [factor = std::make_shared<const ScaledCholesky>(K, 1)](const Vector& b) {
    return factor->solve(b);
  });
}

}  // namespace efree::internal
