// SPDX-License-Identifier: GPL-3.0-or-later
/// Endings of files, however they are spelt.
#pragma once

#include <cctype>
#include <string>

namespace efree::internal {

/// ASCII letters in lower case, everything else as it is.
inline std::string lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

}  // namespace efree::internal
