// SPDX-License-Identifier: GPL-3.0-or-later
/// The order in which neighbours in space are neighbours in memory.
#pragma once

#include "efree/core/types.hpp"

#include <cstddef>
#include <vector>

namespace efree::internal {

/// Numbers of vertices along a space-filling curve (Hilbert 1891).
template <int Dim> std::vector<std::size_t> along_curve(const Points<Dim>& vertices);

}  // namespace efree::internal
