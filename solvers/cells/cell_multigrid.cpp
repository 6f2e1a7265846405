// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_multigrid.hpp"

namespace efree::internal {
namespace {

/// coarse = P^T fine with trilinear P, where something is free.
void restrict_to(const CellProblem& coarse, const CellGrid& fine, const SingleField& from, SingleField& to) {
  const CellGrid& grid = coarse.grid;
  const auto& ratio = coarse.ratio;
  const Index dj_most = ratio[1] - 1, dk_most = ratio[2] - 1;
  parallel_chunks(grid.cells[2] + 1, 2, [&](Index begin, Index end) {
    std::vector<float> line(fine.pitch + 1);
    for (int c = 0; c < 3; ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= grid.cells[1]; ++j) {
          std::ranges::fill(line, 0.0F);
          for (Index dk = -dk_most; dk <= dk_most; ++dk)
            for (Index dj = -dj_most; dj <= dj_most; ++dj) {
              const Index fj = ratio[1] * j + dj, fk = ratio[2] * k + dk;
              if (fj < 0 || fj > fine.cells[1] || fk < 0 || fk > fine.cells[2]) continue;
              const float weight = (dk ? 0.5F : 1.0F) * (dj ? 0.5F : 1.0F);
              const float* row = from.data() + c * fine.nodes() + fine.node(0, fj, fk);
              for (Index i = 0; i <= fine.cells[0]; ++i) line[i] += weight * row[i];
            }
          const std::size_t node = c * grid.nodes() + grid.node(0, j, k);
          for (Index i = 0; i <= grid.cells[0]; ++i) {
            float sum = line[ratio[0] * i];
            if (ratio[0] == 2) {
              if (i > 0) sum += 0.5F * line[2 * i - 1];
              if (i < grid.cells[0]) sum += 0.5F * line[2 * i + 1];
            }
            to[node + i] = coarse.inverse_diagonal[node + i] > 0.0F ? sum : 0.0F;
          }
        }
  });
}

}  // namespace

template <class T>
void prolong(const CellProblem& coarse, const CellProblem& fine, const Values<T>& from, Values<T>& to) {
  const CellGrid& grid = coarse.grid;
  const auto& ratio = coarse.ratio;
  parallel_chunks(fine.grid.cells[2] + 1, 4, [&](Index begin, Index end) {
    std::vector<T> line(grid.cells[0] + 1);
    for (int c = 0; c < 3; ++c)
      for (Index k = begin; k < end; ++k)
        for (Index j = 0; j <= fine.grid.cells[1]; ++j) {
          const T* base = from.data() + c * grid.nodes();
          const Index j0 = j / ratio[1], j1 = (j + ratio[1] - 1) / ratio[1], k0 = k / ratio[2],
                      k1 = (k + ratio[2] - 1) / ratio[2];
          const T* rows[4] = {base + grid.node(0, j0, k0), base + grid.node(0, j1, k0), base + grid.node(0, j0, k1),
                              base + grid.node(0, j1, k1)};
          for (Index i = 0; i <= grid.cells[0]; ++i)
            line[i] = T(0.25) * (rows[0][i] + rows[1][i] + rows[2][i] + rows[3][i]);
          T* out = to.data() + c * fine.grid.nodes() + fine.grid.node(0, j, k);
          for (Index i = 0; i <= grid.cells[0]; ++i) {
            out[ratio[0] * i] += line[i];
            if (ratio[0] == 2 && i < grid.cells[0]) out[2 * i + 1] += T(0.5) * (line[i] + line[i + 1]);
          }
        }
  });
}
template void prolong<float>(const CellProblem&, const CellProblem&, const SingleField&, SingleField&);
template void prolong<double>(const CellProblem&, const CellProblem&, const Field&, Field&);

CellMultigrid::CellMultigrid(const std::vector<std::unique_ptr<CellProblem>>& grids)
    : grids_(grids), work_(grids.size()) {
  factor(*grids.back());
}

void CellMultigrid::take(std::size_t l) {
  for (auto* field : {&work_[l].b, &work_[l].x, &work_[l].step, &work_[l].rest})
    if (field->empty()) *field = zeros<float>(grids_[l]->grid.size());
}
void CellMultigrid::release(std::size_t l) {
  for (auto* field : {&work_[l].x, &work_[l].step, &work_[l].rest}) *field = SingleField();
}

void CellMultigrid::factor(const CellProblem& coarsest) {
  const CellGrid& grid = coarsest.grid;
  const auto for_nodes = [&](const auto& f) {
    for (Index k = 0; k <= grid.cells[2]; ++k)
      for (Index j = 0; j <= grid.cells[1]; ++j)
        for (Index i = 0; i <= grid.cells[0]; ++i) f(i, j, k);
  };
  std::vector<Index> unknown(grid.size(), -1);
  for_nodes([&](Index i, Index j, Index k) {
    for (int c = 0; c < 3; ++c) {
      const std::size_t dof = c * grid.nodes() + grid.node(i, j, k);
      if (coarsest.inverse_diagonal[dof] == 0.0F) continue;
      unknown[dof] = static_cast<Index>(coarsest_dofs_.size());
      coarsest_dofs_.push_back(dof);
    }
  });
  if (coarsest_dofs_.empty()) return;
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
    coarsest.apply_isotropic(u.data(), f.data(), Dilatation::local);  // as all coarser grids
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
  for (const ObliqueNode& at : coarsest.oblique)
    for (int r = 0; r < 3; ++r)
      for (int s = 0; s <= r; ++s) {
        const std::size_t row = r * grid.nodes() + at.node, column = s * grid.nodes() + at.node;
        if (unknown[row] < 0 || unknown[column] < 0) continue;
        const double stiffness = far_stiffer / coarsest.inverse_diagonal[row];
        entries.emplace_back(unknown[row], unknown[column], stiffness * ((r == s ? 1.0 : 0.0) - at.free(r, s)));
      }
  const auto size = static_cast<Index>(coarsest_dofs_.size());
  SymmetricMatrix K(size, size);
  K.setFromTriplets(entries.begin(), entries.end());
  coarsest_.emplace(K, 1);
}

/// x += a polynomial of b - K x (chebyshev_steps).
void CellMultigrid::smooth(std::size_t l, bool from_zero, Dilatation dilatation) {
  const CellProblem& problem = *grids_[l];
  const float* inverse = problem.inverse_diagonal.data();
  Work& w = work_[l];
  const auto steps = chebyshev_steps();
  for (std::size_t s = 0; s < steps.size(); ++s) {
    const float keep = steps[s].keep, take = steps[s].take;
    if (from_zero && s == 0) {
      for_all(w.b.size(), [&](std::size_t i) { w.x[i] = w.step[i] = take * inverse[i] * w.b[i]; });
      continue;
    }
    problem.apply_isotropic(w.x.data(), w.rest.data(), dilatation);
    problem.project(w.rest);
    if (s == 0)
      for_all(w.b.size(), [&](std::size_t i) {
        w.step[i] = take * inverse[i] * (w.b[i] - w.rest[i]);
        w.x[i] += w.step[i];
      });
    else
      for_all(w.b.size(), [&](std::size_t i) {
        w.step[i] = keep * w.step[i] + take * inverse[i] * (w.b[i] - w.rest[i]);
        w.x[i] += w.step[i];
      });
  }
}

const SingleField& CellMultigrid::cycle(std::size_t l) {
  return cycle(l, grids_[l]->dilatation);
}
const SingleField& CellMultigrid::cycle(std::size_t l, Dilatation dilatation) {
  take(l);
  Work& w = work_[l];
  if (l + 1 == grids_.size()) {
    std::ranges::fill(w.x, 0.0F);
    if (!coarsest_) return w.x;
    Vector b(coarsest_dofs_.size());
    for (std::size_t i = 0; i < coarsest_dofs_.size(); ++i) b[i] = w.b[coarsest_dofs_[i]];
    const Vector x = coarsest_->solve(b);
    for (std::size_t i = 0; i < coarsest_dofs_.size(); ++i) w.x[coarsest_dofs_[i]] = static_cast<float>(x[i]);
    grids_[l]->project(w.x);
    return w.x;
  }
  const CellProblem &fine = *grids_[l], &coarse = *grids_[l + 1];
  smooth(l, true, dilatation);
  fine.apply_isotropic(w.x.data(), w.rest.data(), dilatation);
  for_all(w.b.size(), [&](std::size_t i) { w.rest[i] = fine.inverse_diagonal[i] > 0.0F ? w.b[i] - w.rest[i] : 0.0F; });
  fine.project(w.rest);
  take(l + 1);
  restrict_to(coarse, fine.grid, w.rest, work_[l + 1].b);
  coarse.project(work_[l + 1].b);
  prolong(coarse, fine, cycle(l + 1, Dilatation::local), w.x);
  for_all(w.b.size(), [&](std::size_t i) { w.x[i] = fine.inverse_diagonal[i] > 0.0F ? w.x[i] : 0.0F; });
  fine.project(w.x);
  smooth(l, false, dilatation);
  return w.x;
}

}  // namespace efree::internal
