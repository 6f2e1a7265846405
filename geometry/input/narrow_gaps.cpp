// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/narrow_gaps.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace efree {
namespace {

struct Gap {
  Index begin, end;  ///< voxels of a column
  bool is_closed;    ///< no whole cell is in it
};

/// The gaps along one axis, column by column.
class Columns {
 public:
  Columns(const LabelImage<3>& image, int axis, Index cells)
      : axis_(axis),
        first_(axis == 0 ? 1 : 0),
        second_(axis == 2 ? 1 : 2),
        size_{image.size[first_], image.size[second_]},
        gaps_(static_cast<std::size_t>(size_[0]) * size_[1]) {
    const double to_cell = static_cast<double>(image.size[axis]) / cells;  // voxels
    constexpr double rounding = 1e-9;
    const auto holds_no_cell = [&](Index begin, Index end) {
      return (std::ceil(begin / to_cell - rounding) + 1.0) * to_cell > end + rounding;
    };
    // Rows of voxels in the order of memory; each thread has its own columns.
    parallel_chunks(axis == 1 ? image.size[0] : size_[1], 8, [&](Index low, Index high) {
      std::vector<Index> last(gaps_.size(), -1);  // by column: its last voxel of material
      const auto visit = [&](Index i, Index j, Index k) {
        if (image.at({i, j, k}) == 0) return;
        const std::array<Index, 3> voxel{i, j, k};
        const std::size_t c = column(voxel[first_], voxel[second_]);
        const Index begin = last[c] + 1, end = voxel[axis_];
        last[c] = end;
        // In what is two cells wide there is a whole one, in less it depends on where that begins.
        if (begin > 0 && end > begin && end - begin < 2.0 * to_cell - rounding)
          gaps_[c].push_back({begin, end, holds_no_cell(begin, end)});
      };
      const bool by_k = axis == 0, by_j = axis == 2;
      for (Index k = by_k ? low : 0; k < (by_k ? high : image.size[2]); ++k)
        for (Index j = by_j ? low : 0; j < (by_j ? high : image.size[1]); ++j)
          for (Index i = axis == 1 ? low : 0; i < (axis == 1 ? high : image.size[0]); ++i) visit(i, j, k);
    });
  }

  /// Leaves those that have one beside them on all four sides, within a voxel of their own.
  void erode() {
    std::vector<std::vector<Gap>> left(gaps_.size());
    parallel_chunks(size_[1], 8, [&](Index begin, Index end) {
      for (Index b = begin; b < end; ++b)
        for (Index a = 0; a < size_[0]; ++a)
          for (const Gap& gap : gaps_[column(a, b)])
            if (goes_on(a - 1, b, gap) && goes_on(a + 1, b, gap) && goes_on(a, b - 1, gap) && goes_on(a, b + 1, gap))
              left[column(a, b)].push_back(gap);
    });
    gaps_ = std::move(left);
  }

  void add_to(const LabelImage<3>& image, NarrowGaps& found) const {
    const double face = image.spacing[first_] * image.spacing[second_];
    for (Index b = 0; b < size_[1]; ++b)
      for (Index a = 0; a < size_[0]; ++a)
        for (const Gap& gap : gaps_[column(a, b)]) {
          if (!gap.is_closed) continue;
          if (found.area == 0.0) {
            Vec<3> at;
            at[axis_] = 0.5 * (gap.begin + gap.end);
            at[first_] = a + 0.5;
            at[second_] = b + 0.5;
            found.at = image.in_world(image.origin + at.cwiseProduct(image.spacing));
            found.width = (gap.end - gap.begin) * image.spacing[axis_];
          }
          found.area += face;
        }
  }

 private:
  std::size_t column(Index a, Index b) const { return a + static_cast<std::size_t>(size_[0]) * b; }
  bool goes_on(Index a, Index b, const Gap& gap) const {
    if (a < 0 || b < 0 || a >= size_[0] || b >= size_[1]) return true;
    return std::ranges::any_of(gaps_[column(a, b)],
                               [&](const Gap& other) { return other.begin <= gap.end && gap.begin <= other.end; });
  }

  int axis_, first_, second_;
  std::array<Index, 2> size_;
  std::vector<std::vector<Gap>> gaps_;  ///< by column, ascending
};

}  // namespace

NarrowGaps narrow_gaps(const LabelImage<3>& image, const std::array<Index, 3>& cells) {
  NarrowGaps found;
  for (int axis = 0; axis < 3; ++axis) {
    Columns columns(image, axis, cells[axis]);
    double widest = 0.0;  // of a cell [voxels]
    for (int d = 0; d < 3; ++d) widest = std::max(widest, static_cast<double>(image.size[d]) / cells[d]);
    for (int n = std::max(2, static_cast<int>(std::ceil(1.5 * widest))); n > 0; --n) columns.erode();
    columns.add_to(image, found);
  }
  return found;
}

}  // namespace efree
