// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

namespace efree::internal {

/// The coefficients of a vector.
template <class Values> nlohmann::ordered_json json_array(const Values& values) {
  return std::vector<double>(values.begin(), values.end());
}

}  // namespace efree::internal
