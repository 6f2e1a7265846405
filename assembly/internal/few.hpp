// SPDX-License-Identifier: GPL-3.0-or-later
/// Several vectors at once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace efree {

/// Calls f(first, std::integral_constant<int, n>) for groups of n <= 5 of `count` things, one after the other. So many
/// vectors share what is read of a matrix and stay in registers (docs/evidence.md, "Load cases").
template <class F> void for_few(std::size_t count, const F& f) {
  for (std::size_t first = 0; first < count; first += 5) switch (std::min<std::size_t>(count - first, 5)) {
      case 1:
        f(first, std::integral_constant<int, 1>{});
        break;
      case 2:
        f(first, std::integral_constant<int, 2>{});
        break;
      case 3:
        f(first, std::integral_constant<int, 3>{});
        break;
      case 4:
        f(first, std::integral_constant<int, 4>{});
        break;
      default:
        f(first, std::integral_constant<int, 5>{});
    }
}

}  // namespace efree
