// SPDX-License-Identifier: GPL-3.0-or-later
/// Grids over an image's frame with periodic, kinematic or traction conditions on it, and multigrid between them.
#pragma once

#include "efree/solvers/cells/effective.hpp"
#include "efree/solvers/cells/internal/cell_operator.hpp"

#include <array>
#include <memory>
#include <vector>

namespace efree::internal {

/// A grid with its matrix and the conditions on the frame. Under periodic conditions a node at an upper side is the one
/// at the lower side: fields have copies there, residuals zeros.
struct FrameGrid {
  std::unique_ptr<CellOperator> matrix;
  FrameCondition frame;
  std::vector<float> inverse_diagonal;  ///< of a diagonal that is nowhere less than K_iso; 0 where nothing is free

  FrameGrid(std::unique_ptr<CellOperator> matrix, FrameCondition frame);

  /// Copies a field to the upper sides.
  template <class T> void spread(T* u) const;
  /// Adds forces at the upper sides to those at the lower ones.
  template <class T> void fold(T* f) const;
  /// f = K u for fields, whose upper sides are set first.
  template <class T> void multiply(T* const* u, T* const* f, int count) const {
    for (int r = 0; r < count; ++r) spread(u[r]);
    matrix->apply(u, f, count, matrix->dilatation());
    for (int r = 0; r < count; ++r) fold(f[r]);
  }
  /// The same of the isotropic parts (CellOperator::apply_isotropic).
  template <class T> void multiply_isotropic(T* const* u, T* const* f, int count, Dilatation dilatation) const {
    for (int r = 0; r < count; ++r) spread(u[r]);
    matrix->apply_isotropic(u, f, count, dilatation);
    for (int r = 0; r < count; ++r) fold(f[r]);
  }
};

/// Interpolation between two grids over the same frame, trilinear, whatever their numbers of cells.
class Transfer {
 public:
  Transfer(const FrameGrid& coarse, const FrameGrid& fine);
  /// fine += P coarse, where something is free. Upper sides of `from` are set first.
  template <class T> void prolong(T* from, T* to) const;
  /// coarse = P^T fine, where something is free.
  void restrict_to_coarse(const float* from, float* to) const;

 private:
  struct Axis {
    std::vector<Index> lower;          ///< by fine node: coarse node below (or at) it
    std::vector<float> share;          ///< of the coarse node above
    std::vector<std::size_t> begin;    ///< by coarse node, and the end: of these
    std::vector<Index> fine;           ///< nodes that it has a share of
    std::vector<float> share_of_fine;  ///< which
  };
  const FrameGrid *coarse_, *fine_;
  std::array<Axis, 3> axes_;
};

/// V-cycles in single precision for several right-hand sides at once, as of CellMultigrid. On the coarsest grid the
/// pseudo-inverse is dense.
class FrameMultigrid {
 public:
  /// Keeps a reference to the grids, from fine to coarse, for so many right-hand sides at most.
  FrameMultigrid(const std::vector<FrameGrid>& grids, int most);

  /// To be filled before a cycle from grid l on.
  SingleField& right(std::size_t l, int load) { return work_[l][load].b; }
  /// An approximate inverse of K, symmetric and not negative, times right(l, .).
  void cycle(std::size_t l, int count);
  const SingleField& result(std::size_t l, int load) const { return work_[l][load].x; }
  /// fine += P coarse from grid l + 1 to l.
  void prolong(std::size_t l, Field& coarse, Field& fine) const;

 private:
  struct Work {
    SingleField b, x, step, rest;
  };
  void cycle(std::size_t l, int count, Dilatation dilatation);
  void smooth(std::size_t l, int count, bool from_zero, Dilatation dilatation);
  void multiply(std::size_t l, int count, Dilatation dilatation);
  void invert_coarsest();

  const std::vector<FrameGrid>& grids_;
  std::vector<Transfer> transfers_;
  std::vector<std::vector<Work>> work_;  ///< by grid and load
  std::vector<std::size_t> coarsest_dofs_;
  Matrix coarsest_inverse_;
};

}  // namespace efree::internal
