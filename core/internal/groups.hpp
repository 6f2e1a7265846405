// SPDX-License-Identifier: GPL-3.0-or-later
/// Members of numbered groups, and sparse tables from their rows.
#pragma once

#include "efree/core/types.hpp"

#include <numeric>
#include <vector>

namespace efree::internal {

/// The members of each group, ascending; group[k] is that of k.
inline Ragged<Index> members_of(const std::vector<Index>& group, Index groups) {
  Ragged<Index> members;
  members.offsets.assign(groups + 1, 0);
  for (const Index g : group) ++members.offsets[g + 1];
  std::partial_sum(members.offsets.begin(), members.offsets.end(), members.offsets.begin());
  members.items.resize(group.size());
  std::vector<Index> cursor(members.offsets.begin(), members.offsets.end() - 1);
  for (std::size_t k = 0; k < group.size(); ++k) members.items[cursor[group[k]]++] = static_cast<Index>(k);
  return members;
}

/// Row i has the entries offsets[i] .. offsets[i + 1] of columns and values.
inline SparseRows from_rows(Index cols, const std::vector<Index>& offsets, const std::vector<Index>& columns,
                            const std::vector<double>& values) {
  return Eigen::Map<const SparseRows>(static_cast<Index>(offsets.size()) - 1, cols, static_cast<Index>(columns.size()),
                                      offsets.data(), columns.data(), values.data());
}

/// One entry of 1 per row: rows of indicator functions.
inline SparseRows indicators(const std::vector<Index>& column, Index cols) {
  std::vector<Index> offsets(column.size() + 1);
  std::iota(offsets.begin(), offsets.end(), 0);
  return from_rows(cols, offsets, column, std::vector<double>(column.size(), 1.0));
}

}  // namespace efree::internal
