// SPDX-License-Identifier: GPL-3.0-or-later
/// Grids over an image's frame with periodic, kinematic or traction conditions on it.
#pragma once

#include "efree/solvers/cells/effective.hpp"
#include "efree/solvers/cells/internal/cell_operator.hpp"
#include "efree/solvers/cells/internal/grid_level.hpp"

#include <memory>

namespace efree::internal {

/// A grid with its matrix and the conditions on the frame. Under periodic conditions a node at an upper side is the one
/// at the lower side: complete fields have copies there, collected forces zeros.
class FrameGrid final : public GridLevel {
 public:
  FrameGrid(std::unique_ptr<CellOperator> matrix, FrameCondition frame);

  CellOperator& matrix() const { return *matrix_; }
  const CellLayout& layout() const override { return matrix_->layout(); }
  int components() const override { return matrix_->components(); }
  Dilatation dilatation() const override { return matrix_->dilatation(); }
  void apply(const float* u, float* f) const override { matrix_->apply(u, f, dilatation()); }
  void apply(const double* u, double* f) const override { matrix_->apply(u, f, dilatation()); }
  void apply_isotropic(const float* u, float* f, Dilatation of) const override { multiply_isotropic(u, f, of); }
  void apply_isotropic(const double* u, double* f, Dilatation of) const override { multiply_isotropic(u, f, of); }
  void complete(float* u) const override { spread(u); }
  void complete(double* u) const override { spread(u); }
  void collect(float* f) const override { fold(f); }
  void collect(double* f) const override { fold(f); }

 private:
  template <class T> void multiply_isotropic(const T* u, T* f, Dilatation of) const {
    matrix_->apply_isotropic(u, f, of);
    add_to_diagonal(u, f);
  }
  template <class T> void spread(T* u) const;
  template <class T> void fold(T* f) const;

  std::unique_ptr<CellOperator> matrix_;
  FrameCondition frame_;
};

/// The pseudo-inverse, dense.
SmallInverse inverse_of(const FrameGrid& grid);

}  // namespace efree::internal
