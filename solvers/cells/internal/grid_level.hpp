// SPDX-License-Identifier: GPL-3.0-or-later
/// One grid of a linear problem, as multigrid and conjugate gradients see it.
#pragma once

#include "efree/solvers/cells/internal/cell_grid.hpp"
#include "efree/solvers/cells/internal/grid_fields.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace efree::internal {

/// Numbers >= 0 in 16 bits, the upper half of single precision, rounded towards 0: to within a 128th. Of a diagonal
/// that is nowhere less than a matrix the reciprocal stays one.
class ShortNumbers {
 public:
  void assign(const std::vector<float>& values) {
    bits_.resize(values.size());
    for_all(values.size(), [&](std::size_t i) { set(i, values[i]); });
  }
  float operator[](std::size_t i) const { return std::bit_cast<float>(static_cast<std::uint32_t>(bits_[i]) << 16); }
  void set(std::size_t i, float value) {
    bits_[i] = static_cast<std::uint16_t>(std::bit_cast<std::uint32_t>(value) >> 16);
  }

 private:
  Values<std::uint16_t> bits_;
};

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
  ShortNumbers inverse_diagonal{};

  /// What preconditioners add to the diagonal, by degree of freedom (raise_soft_diagonal, add_weak_springs).
  std::vector<std::pair<std::size_t, float>> added{};

  bool is_free(std::size_t dof) const { return inverse_diagonal[dof] > 0.0F; }
  template <class T> void add_to_diagonal(const T* u, T* f) const {
    for (const auto& [dof, stiffness] : added) f[dof] += static_cast<T>(stiffness) * u[dof];
  }
  /// The inverse from that diagonal.
  void set_diagonal(std::vector<float> diagonal) {
    for_all(diagonal.size(), [&](std::size_t i) { diagonal[i] = diagonal[i] > 0.0F ? 1.0F / diagonal[i] : 0.0F; });
    inverse_diagonal.assign(diagonal);
  }
};

/// An approximate inverse of K_iso with local dilatations on a small grid, symmetric and not negative: sets x from b.
using SmallInverse = std::function<void(const SingleField& b, SingleField& x)>;
/// From one of the unknowns alone, which are these degrees of freedom; x is 0 at the others.
template <class Solve> SmallInverse on_unknowns(std::vector<std::size_t> dofs, Solve solve) {
  return [dofs = std::move(dofs), solve = std::move(solve)](const SingleField& b, SingleField& x) {
    Vector right(dofs.size());
    for (std::size_t i = 0; i < dofs.size(); ++i) right[i] = b[dofs[i]];
    const Vector found = solve(right);
    std::ranges::fill(x, 0.0F);
    for (std::size_t i = 0; i < dofs.size(); ++i) x[dofs[i]] = static_cast<float>(found[i]);
  };
}

}  // namespace efree::internal
