// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <limits>

namespace efree::internal {

inline constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace efree::internal
