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
/// matrix is factored. Coarser grids than the one where a cycle starts have local dilatations: what they would add to
/// fields without mean dilatation is not free of it on finer grids.
class CellMultigrid {
 public:
  /// Keeps a reference to the grids.
  explicit CellMultigrid(const std::vector<std::unique_ptr<CellProblem>>& grids);

  /// To be filled before a cycle from grid l on, which leaves it as it is.
  SingleField& right(std::size_t l) { return work_[l].b; }
  /// An approximate inverse of K, symmetric and positive, times right(l): that of the isotropic parts of materials.
  const SingleField& cycle(std::size_t l);
  /// Free between cycles.
  SingleField& spare(std::size_t l) { return work_[l].rest; }
  /// Gives back the memory that cycles work in on grid l, but not right(l); the next one takes it again.
  void release(std::size_t l);

 private:
  struct Work {
    SingleField b, x, step, rest;
  };
  void take(std::size_t l);
  const SingleField& cycle(std::size_t l, Dilatation dilatation);
  void smooth(std::size_t l, bool from_zero, Dilatation dilatation);
  void factor(const CellProblem& coarsest);

  const std::vector<std::unique_ptr<CellProblem>>& grids_;
  std::vector<Work> work_;
  std::vector<std::size_t> coarsest_dofs_;
  std::optional<ScaledCholesky> coarsest_;
};

}  // namespace efree::internal
