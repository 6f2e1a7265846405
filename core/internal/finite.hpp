// SPDX-License-Identifier: GPL-3.0-or-later
/// Whether numbers are finite.
#pragma once

#include <Eigen/Core>

namespace efree::internal {

/// Whether all coefficients are: products with zero are summed, which goes by vectors, where allFinite asks one by one.
template <class Derived> bool all_finite(const Eigen::PlainObjectBase<Derived>& values) {
  return (Eigen::Map<const Eigen::ArrayXd>(values.data(), values.size()) * 0.0).sum() == 0.0;
}

}  // namespace efree::internal
