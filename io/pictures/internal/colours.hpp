// SPDX-License-Identifier: GPL-3.0-or-later
/// Colours of values, and of parts that are told apart.
#pragma once

#include "efree/io/pictures/internal/canvas.hpp"

#include <algorithm>
#include <array>

namespace efree::internal::drawing {

/// Colours from dark blue over green to yellow, even in lightness so that they survive grey printing (viridis,
/// sampled).
class ColourScale {
 public:
  explicit ColourScale(const std::array<double, 2>& range);
  const std::array<double, 2>& range() const { return range_; }
  /// 0 to 1 inside the range.
  Eigen::VectorXf places(const Vector& values) const {
    return ((values.array() - range_[0]) / (range_[1] - range_[0])).cast<float>();
  }
  const Colour& at(float place) const { return table_[entry(place)]; }
  Canvas::Pixel pixel_at(float place) const { return pixels_[entry(place)]; }

 private:
  std::array<double, 2> range_;
  static constexpr std::size_t size = 256;
  /// Also for NaN.
  static std::size_t entry(float place) {
    return place > 0.0F ? static_cast<std::size_t>(std::min(place, 0.9999F) * size) : 0;
  }
  std::array<Colour, size> table_{};
  std::array<Canvas::Pixel, size> pixels_{};
};

/// The range of values that the colours span: all finite ones, unless a few (one in 200) stand out of the others by
/// half.
std::array<double, 2> colour_range(const Vector& values);

/// As many colours as wanted, neighbours in the list far apart in hue.
Colour distinct(Index i);
/// The same, behind others.
Colour pale(Index i);
/// The same light grey for all.
Colour uncoloured(Index i);
using Palette = Colour (*)(Index);

}  // namespace efree::internal::drawing
