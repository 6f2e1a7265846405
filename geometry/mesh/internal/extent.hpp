// SPDX-License-Identifier: GPL-3.0-or-later
/// Which bodies can be computed with in double precision.
#pragma once

#include "efree/core/types.hpp"

#include <string_view>

namespace efree::internal {

/// Throws InputError beginning with "`subject`: " for a box whose ends are no finite numbers, whose longest side is 0
/// or beyond 1e-30 and 1e30 (their powers leave the range of numbers), or which lies more than 1e8 times its longest
/// side from the origin (its points are known to a hundred millionth of that at best).
template <int Dim> void require_extent(const Vec<Dim>& low, const Vec<Dim>& high, std::string_view subject);

/// Throws InputError beginning with "`subject`: " for a box whose longest side is more than 2e4 times its shortest:
/// what holds a body that thin cannot be told from what does not, in double precision.
template <int Dim> void require_thickness(const Vec<Dim>& low, const Vec<Dim>& high, std::string_view subject);

}  // namespace efree::internal
