// SPDX-License-Identifier: GPL-3.0-or-later
/// Text of others on a terminal or in a chart.
#pragma once

#include <string>

namespace efree::internal {

/// The text with a blank for every control character: it cannot tell a terminal what to do.
inline std::string printable(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7f') c = ' ';
  return text;
}

}  // namespace efree::internal
