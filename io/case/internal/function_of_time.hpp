// SPDX-License-Identifier: GPL-3.0-or-later
/// Expressions of the time alone.
#pragma once

#include "efree/io/case/internal/case_parts.hpp"

#include <fmt/format.h>
#include <array>
#include <functional>
#include <string>
#include <string_view>

namespace efree::internal {

/// A vector whose components depend on the time t alone. root, grey: as read_definitions takes them. Throws InputError
/// that begins with "file:line: ".
template <int Dim, int Size> std::function<Vec<Size>(double)> read_function_of_time(
    const std::array<std::string, static_cast<std::size_t>(Size)>& texts, const Section& entry, std::string_view key,
    const Section& root, const ScalarField<Dim>& grey) {
  const std::string where = entry.where(key);
  const Expressions<Dim> now = read_definitions<Dim>(root, grey, {0.0});
  for (const std::string& text : texts)
    if (now.varies(text, where))
      entry.fail(key, fmt::format("{} is \"{}\", expected an expression of the time t alone", key, text));
  const auto function = read_definitions<Dim>(root, grey, {.time = {}, .runs = true})
                            .template fields<static_cast<std::size_t>(Size)>(texts, where);
  return [function](double t) { return Vec<Size>(function(t * Vec<Dim>::Unit(0))); };
}

}  // namespace efree::internal
