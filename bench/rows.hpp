// SPDX-License-Identifier: GPL-3.0-or-later
/// Rows of a benchmark: what is measured beside its bar.
#pragma once

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cstdio>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace efree::bench {

/// Prints a measurement beside its bar; returns whether it is within.
inline bool row(const char* name, const std::string& what, double measured, double low, double high) {
  const bool within = measured >= low && measured <= high;
  fmt::print("{:<10} {:<64} {:12.4g}   [{:g}, {:g}]{}\n", name, what, measured, low, high, within ? "" : "  MISSED");
  std::fflush(stdout);
  return within;
}

/// Rows by name; each prints its measurements and returns whether all were within their bars.
using Rows = std::vector<std::pair<std::string, std::function<bool()>>>;

/// The rows of these names, or all by `all`. Returns whether all were within their bars, false for no names; throws
/// InputError for a name that there is not.
inline bool print_rows(const Rows& rows, const std::vector<std::string>& names) {
  if (names == std::vector<std::string>{"all"})
    return std::ranges::count_if(rows, [](const auto& one) { return !one.second(); }) == 0;
  bool good = !names.empty();
  for (const std::string& name : names) {
    const auto found = std::ranges::find(rows, name, [](const auto& one) { return one.first; });
    if (found == rows.end()) throw InputError(fmt::format("there is no row \"{}\"", name));
    good = found->second() && good;
  }
  return good;
}

}  // namespace efree::bench
