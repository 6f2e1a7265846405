// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <string>

namespace efree::internal {

/// The name of an entry of a Ledger as a key of JSON and a column of CSV: "merged nodes" becomes merged_nodes.
inline std::string snake_case(std::string name) {
  std::ranges::replace(name, ' ', '_');
  return name;
}

}  // namespace efree::internal
