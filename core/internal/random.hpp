// SPDX-License-Identifier: GPL-3.0-or-later
/// Numbers without pattern, the same on every machine.
#pragma once

#include <cstdint>

namespace efree::internal {

/// From -1 to 1, by a key (Steele, Lea & Flood 2014).
inline double random_number(std::uint64_t key) {
  std::uint64_t z = (key + 1) * 0x9e3779b97f4a7c15u;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
  z = (z ^ z >> 27) * 0x94d049bb133111ebu;
  return 0x1p-63 * static_cast<double>(static_cast<std::int64_t>(z ^ z >> 31));
}

}  // namespace efree::internal
