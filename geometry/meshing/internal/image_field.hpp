// SPDX-License-Identifier: GPL-3.0-or-later
/// An image in space as a field between the centres of its voxels.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/meshing/internal/image_regions.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace efree::internal {

/// Regions counted from 1 (void: 0) by the trilinear interpolation of each one's indicator, or of the image's grey
/// values, between the centres of voxels; beyond the outermost centres the field is constant along the normal. Points
/// are in voxels from the image's origin; those outside are taken onto the frame.
class ImageField {
 public:
  /// `use_grey`: by the grey values, if the image has any.
  ImageField(const LabelImage<3>& image, const ImageRegions& regions, bool use_grey)
      : image_(image), grey_(use_grey && !image.grey.empty()) {
    for (const Index region : regions.of_label) codes_.push_back(static_cast<Label>(region + 1));
  }

  /// Region of a voxel.
  Label at(const std::array<Index, 3>& voxel) const { return codes_[image_.at(voxel)]; }
  Label at(std::size_t voxel) const { return codes_[image_.labels[voxel]]; }

  /// The region with the largest indicator. Void wins ties (and a little more), so that bodies do not connect in a
  /// corner; then the first.
  Label operator()(const Vec<3>& u) const {
    const Cell cell = cell_of(u);
    std::array<Label, 8> corner;
    if (grey_) {
      const double value = interpolate(cell, [&](std::size_t voxel) { return image_.grey[voxel]; });
      return value > 0.0 ? 1 : 0;
    }
    bool same = true;
    for (int c = 0; c < 8; ++c) {
      corner[c] = at(cell.voxel(c));
      same = same && corner[c] == corner[0];
    }
    if (same) return corner[0];
    std::array<double, 8> sum{};
    for (int c = 0; c < 8; ++c)
      sum[std::find(corner.begin(), corner.end(), corner[c]) - corner.begin()] += cell.weight(c);
    int best = 0;
    for (int c = 0; c < 8; ++c) {
      if (corner[c] == 0) sum[c] += void_bonus;
      if (sum[c] > sum[best] || (sum[c] == sum[best] && corner[c] < corner[best])) best = c;
    }
    return corner[best];
  }

  /// By how much region a is ahead of region b: continuous, and 0 where the boundary between them is.
  double lead(const Vec<3>& u, Label a, Label b) const {
    const Cell cell = cell_of(u);
    if (grey_) {
      const double value = interpolate(cell, [&](std::size_t voxel) { return image_.grey[voxel]; });
      return a != 0 ? value : -value;
    }
    const double value = interpolate(cell, [&](std::size_t voxel) {
      const Label code = at(voxel);
      return static_cast<double>(code == a) - static_cast<double>(code == b);
    });
    return value + (a == 0 ? void_bonus : b == 0 ? -void_bonus : 0.0);
  }

 private:
  static constexpr double void_bonus = 1e-6;

  struct Cell {
    std::array<std::array<std::size_t, 2>, 3> offset;  // of the voxels below and above along each axis
    std::array<double, 3> t;
    std::size_t voxel(int c) const { return offset[0][c & 1] + offset[1][c >> 1 & 1] + offset[2][c >> 2]; }
    double weight(int c) const {
      return (c & 1 ? t[0] : 1.0 - t[0]) * (c & 2 ? t[1] : 1.0 - t[1]) * (c & 4 ? t[2] : 1.0 - t[2]);
    }
  };

  Cell cell_of(const Vec<3>& u) const {
    Cell cell;
    std::size_t stride = 1;
    for (int d = 0; d < 3; ++d) {
      const double x = std::clamp(u[d], 0.0, static_cast<double>(image_.size[d]));
      const Index upper = static_cast<Index>(x + 0.5);
      cell.t[d] = x + 0.5 - upper;
      cell.offset[d] = {stride * static_cast<std::size_t>(std::max(upper - 1, 0)),
                        stride * static_cast<std::size_t>(std::min(upper, image_.size[d] - 1))};
      stride *= image_.size[d];
    }
    return cell;
  }

  template <class Value> static double interpolate(const Cell& cell, const Value& value) {
    double planes[2];
    for (int k = 0; k < 2; ++k) {
      double rows[2];
      for (int j = 0; j < 2; ++j) {
        const std::size_t row = cell.offset[1][j] + cell.offset[2][k];
        const double low = value(cell.offset[0][0] + row), high = value(cell.offset[0][1] + row);
        rows[j] = low + cell.t[0] * (high - low);
      }
      planes[k] = rows[0] + cell.t[1] * (rows[1] - rows[0]);
    }
    return planes[0] + cell.t[2] * (planes[1] - planes[0]);
  }

  const LabelImage<3>& image_;
  bool grey_;
  std::vector<Label> codes_;  // by label
};

}  // namespace efree::internal
