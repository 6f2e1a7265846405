// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear functions of a mesh as members of its spaces.
#pragma once

#include "efree/basis/fine_space.hpp"

namespace efree::internal {

/// Values at the degrees of freedom of a space (columns): of a function that has them there already, or of one that has
/// values at the vertices and is linear along edges.
template <int Dim> Matrix lifted(const FineSpace<Dim>& space, const Eigen::Ref<const Matrix>& values) {
  Matrix result(values.rows(), space.size());
  result.leftCols(values.cols()) = values;
  if (values.cols() == space.size()) return result;
  auto dof = static_cast<Index>(values.cols());
  for (const auto& [a, b] : space.edges()) result.col(dof++) = 0.5 * (values.col(a) + values.col(b));
  return result;
}

}  // namespace efree::internal
