// SPDX-License-Identifier: GPL-3.0-or-later
/// One grid of a linear problem, as multigrid and conjugate gradients see it.
#pragma once

#include "efree/solvers/cells/internal/cell_grid.hpp"
#include "efree/solvers/cells/internal/grid_fields.hpp"

#include <functional>
#include <utility>
#include <vector>

namespace efree::internal {

/// K u = f on a grid. Fields have their components one after the other, each by node.
class GridLevel {
 public:
  GridLevel() = default;
  GridLevel(const GridLevel&) = delete;
  GridLevel& operator=(const GridLevel&) = delete;
  GridLevel(GridLevel&&) = default;
  GridLevel& operator=(GridLevel&&) = default;
  virtual ~GridLevel() = default;

  virtual const CellLayout& layout() const = 0;
  virtual int components() const = 0;
  std::size_t size() const { return components() * layout().nodes(); }
  /// What answers are to be of. Preconditioners have local dilatations on coarser grids.
  virtual Dilatation dilatation() const = 0;

  /// f = K u of a complete field. Bitwise the same on any number of threads.
  virtual void apply(const float* u, float* f) const = 0;
  virtual void apply(const double* u, double* f) const = 0;
  /// The same of the isotropic parts of materials, which is what preconditioners know.
  virtual void apply_isotropic(const float* u, float* f, Dilatation dilatation) const = 0;
  virtual void apply_isotropic(const double* u, double* f, Dilatation dilatation) const = 0;
  /// Sets what of a correction follows from the rest: copies on opposite sides, none in directions that are held.
  virtual void complete(float* u) const = 0;
  virtual void complete(double* u) const = 0;
  /// The transpose, for forces.
  virtual void collect(float* f) const = 0;
  virtual void collect(double* f) const = 0;

  /// By degree of freedom, of a diagonal that is nowhere less than K_iso; 0 where nothing is free.
  std::vector<float> inverse_diagonal{};

  /// What preconditioners add to the diagonal (match).
  std::vector<std::pair<std::size_t, float>> added{};

  bool is_free(std::size_t dof) const { return inverse_diagonal[dof] > 0.0F; }
  template <class T> void add_to_diagonal(const T* u, T* f) const {
    for (const auto& [dof, stiffness] : added) f[dof] += static_cast<T>(stiffness) * u[dof];
  }
  /// The inverse from that diagonal.
  void set_diagonal(std::vector<float> diagonal) {
    inverse_diagonal = std::move(diagonal);
    for_all(inverse_diagonal.size(), [&](std::size_t i) {
      float& d = inverse_diagonal[i];
      d = d > 0.0F ? 1.0F / d : 0.0F;
    });
  }
};

/// An approximate inverse of K_iso with local dilatations on a small grid, symmetric and not negative: sets x from b.
using SmallInverse = std::function<void(const SingleField& b, SingleField& x)>;

}  // namespace efree::internal
