// SPDX-License-Identifier: GPL-3.0-or-later
/// Geometric multigrid on grids of cells.
#pragma once

#include "efree/solvers/cells/internal/cell_problem.hpp"
#include "efree/solvers/linear/internal/scaled_cholesky.hpp"

namespace efree::internal {

/// fine += P coarse, trilinear.
template <class T>
void prolong(const CellProblem& coarse, const CellProblem& fine, const Values<T>& from, Values<T>& to);

/// V-cycles in single precision over grids from fine to coarse, on each of which they can start. The coarsest grid's
/// matrix is factored.
class CellMultigrid {
 public:
  /// Keeps a reference to the grids.
  explicit CellMultigrid(const std::vector<std::unique_ptr<CellProblem>>& grids);

  /// To be filled before a cycle from grid l on.
  SingleField& right(std::size_t l) { return work_[l].b; }
  /// An approximate inverse of K, symmetric and positive, times right(l).
  const SingleField& cycle(std::size_t l);

 private:
  struct Work {
    SingleField b, x, step, rest;
  };
  void smooth(std::size_t l, bool from_zero);
  void factor(const CellProblem& coarsest);

  const std::vector<std::unique_ptr<CellProblem>>& grids_;
  std::vector<Work> work_;
  std::vector<std::size_t> coarsest_dofs_;
  std::optional<ScaledCholesky> coarsest_;
};

}  // namespace efree::internal
