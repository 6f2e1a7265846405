// SPDX-License-Identifier: GPL-3.0-or-later
/// Vectors as columns of a history.
#pragma once

#include <fmt/format.h>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// Adds the components "name.x", ... of a vector; of one that has one component alone, the z axis's.
template <class Values>
void add_vector(const std::string& name, const Values& values, std::vector<std::pair<std::string, double>>& line) {
  for (int i = 0; i < values.size(); ++i)
    line.emplace_back(fmt::format("{}.{}", name, "xyz"[values.size() == 1 ? 2 : i]), values[i]);
}

}  // namespace efree::internal
