// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree::internal {

/// Throws InputError unless a parameter is finite and good.
inline void require_number(const char* parameter, double value, bool good, const char* expected) {
  if (!good || !std::isfinite(value)) throw InputError(fmt::format("{} = {}, expected {}", parameter, value, expected));
}

}  // namespace efree::internal
