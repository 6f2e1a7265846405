// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/frame_grids.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Calls f(lower, upper) for pairs of nodes at both ends of an axis.
template <class F> void for_ends(const CellLayout& grid, int axis, const F& f) {
  const int first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
  parallel_chunks(grid.cells[second] + 1, 64, [&](Index begin, Index end) {
    std::array<Index, 3> at{};
    for (at[second] = begin; at[second] < end; ++at[second])
      for (at[first] = 0; at[first] <= grid.cells[first]; ++at[first]) {
        at[axis] = 0;
        const std::size_t lower = grid.node(at[0], at[1], at[2]);
        at[axis] = grid.cells[axis];
        f(lower, grid.node(at[0], at[1], at[2]));
      }
  });
}

/// Calls f(node) for the nodes of all sides, those of edges more than once.
template <class F> void for_frame(const CellLayout& grid, const F& f) {
  for (int axis = 0; axis < 3; ++axis)
    for_ends(grid, axis, [&](std::size_t lower, std::size_t upper) {
      f(lower);
      f(upper);
    });
}

}  // namespace

FrameGrid::FrameGrid(std::unique_ptr<CellOperator> matrix, FrameCondition frame)
    : matrix_(std::move(matrix)), frame_(frame) {
  std::vector<float> diagonal = matrix_->bound();
  fold(diagonal.data());
  if (frame == FrameCondition::kinematic)
    for (int c = 0; c < components(); ++c)
      for_frame(layout(), [&](std::size_t node) { diagonal[c * layout().nodes() + node] = 0.0F; });
  set_diagonal(std::move(diagonal));
}

/// Copies to the upper sides.
template <class T> void FrameGrid::spread(T* u) const {
  if (frame_ != FrameCondition::periodic) return;
  for (int axis = 0; axis < 3; ++axis)
    for (int c = 0; c < components(); ++c) {
      T* of = u + c * layout().nodes();
      for_ends(layout(), axis, [&](std::size_t lower, std::size_t upper) { of[upper] = of[lower]; });
    }
}

/// Adds what is at the upper sides to the lower ones.
template <class T> void FrameGrid::fold(T* f) const {
  if (frame_ != FrameCondition::periodic) return;
  for (int axis = 0; axis < 3; ++axis)
    for (int c = 0; c < components(); ++c) {
      T* of = f + c * layout().nodes();
      for_ends(layout(), axis, [&](std::size_t lower, std::size_t upper) {
        of[lower] += of[upper];
        of[upper] = T(0);
      });
    }
}

template void FrameGrid::spread(float*) const;
template void FrameGrid::spread(double*) const;
template void FrameGrid::fold(float*) const;
template void FrameGrid::fold(double*) const;

SmallInverse inverse_of(const FrameGrid& grid) {
  std::vector<std::size_t> dofs;  // that are free
  for (std::size_t i = 0; i < grid.size(); ++i)
    if (grid.is_free(i)) dofs.push_back(i);
  const auto unknowns = static_cast<Index>(dofs.size());
  Matrix K(unknowns, unknowns);
  Field u(grid.size()), f(grid.size());
  for (Index column = 0; column < unknowns; ++column) {
    std::ranges::fill(u, 0.0);
    u[dofs[column]] = 1.0;
    grid.complete(u.data());
    grid.apply_isotropic(u.data(), f.data(), Dilatation::local);
    grid.collect(f.data());
    for (Index row = 0; row < unknowns; ++row) K(row, column) = f[dofs[row]];
  }
  // Scaled, so that soft materials do not count as none.
  Vector scale(unknowns);
  for (Index i = 0; i < unknowns; ++i) scale[i] = std::sqrt(grid.inverse_diagonal[dofs[i]]);
  Matrix inverse(unknowns, unknowns);
  if (unknowns > 0)
    inverse = scale.asDiagonal() * pseudo_inverse<Eigen::Dynamic>(scale.asDiagonal() * K * scale.asDiagonal()) *
              scale.asDiagonal();
  return on_unknowns(std::move(dofs),
                     [inverse = std::move(inverse)](const Vector& b) -> Vector { return inverse * b; });
}

}  // namespace efree::internal
