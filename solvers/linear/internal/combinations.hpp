// SPDX-License-Identifier: GPL-3.0-or-later
/// Which of some vectors are combinations of others: of linear equations, so are their solutions.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace efree::internal {

/// A vector times a factor.
struct Term {
  std::size_t vector;
  double factor;
};

/// A vector of two quantities.
using Parts = std::array<std::span<const double>, 2>;

/// By vector: the terms it is the sum of, each part to rounding of its own, all of them before it and none of them a
/// sum itself; none where it is no sum, or zero.
std::vector<std::vector<Term>> combinations(const std::vector<Parts>& vectors);

}  // namespace efree::internal
