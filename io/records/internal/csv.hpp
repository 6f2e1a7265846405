// SPDX-License-Identifier: GPL-3.0-or-later
/// Tables as comma-separated values.
#pragma once

#include <string>

namespace efree::internal {

/// A text as a cell of a table: quoted if it holds commas or quotes, as names may.
inline std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted;
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return '"' + quoted + '"';
}

}  // namespace efree::internal
