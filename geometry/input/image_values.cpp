// SPDX-License-Identifier: GPL-3.0-or-later
/// What values an image file holds.
#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>

namespace efree {
namespace {

using internal::PixelValues, internal::with_type;

/// Range, number and kind of the values; `step` from one to the next.
template <class T>
void summarise(const std::string& path, const T* values, std::size_t count, std::size_t step, ImageValues& out) {
  out.least = std::numeric_limits<double>::infinity();
  out.largest = -out.least;
  std::set<T> seen;
  for (std::size_t p = 0; p < count; p += step) {
    const double value = static_cast<double>(values[p]);
    if (!std::isfinite(value)) throw InputError(fmt::format("{}: a value is {}, expected a number", path, value));
    out.least = std::min(out.least, value);
    out.largest = std::max(out.largest, value);
    if (seen.size() <= 64) seen.insert(values[p]);
    if (value != std::floor(value)) out.are_labels = false;
  }
  out.different = static_cast<Index>(seen.size());
  if (seen.size() > 64 || out.least < 0.0 || out.largest > std::numeric_limits<Label>::max()) out.are_labels = false;
}

/// The threshold that parts values from `least` to `largest` into two classes best (Otsu 1979).
template <class T>
double otsu_threshold(const T* values, std::size_t count, std::size_t step, double least, double largest) {
  constexpr std::size_t bins = 256;
  std::array<double, bins> histogram{};
  const double width = (largest - least) / static_cast<double>(bins);
  if (!(width > 0.0)) return least;
  double total = 0.0, sum = 0.0;
  for (std::size_t p = 0; p < count; p += step) {
    const double at = (static_cast<double>(values[p]) - least) / width;
    histogram[std::min(static_cast<std::size_t>(at), bins - 1)] += 1.0;
  }
  for (std::size_t b = 0; b < bins; ++b) total += histogram[b], sum += static_cast<double>(b) * histogram[b];
  double threshold = 0.0, below = 0.0, sum_below = 0.0, best = -1.0;
  for (std::size_t b = 0; b + 1 < bins; ++b) {
    below += histogram[b];
    sum_below += static_cast<double>(b) * histogram[b];
    const double above = total - below;
    if (below == 0.0 || above == 0.0) continue;
    const double apart = sum_below / below - (sum - sum_below) / above, between = below * above * apart * apart;
    if (between <= best) continue;
    best = between;
    threshold = least + static_cast<double>(b + 1) * width;
  }
  return threshold;
}

}  // namespace

ImageValues image_values(const std::string& path) {
  const PixelValues v = internal::read_pixels<3>(path, {});
  ImageValues out{.dimension = v.size[2] == 1 ? 2 : 3};
  with_type(path, v.type, [&](auto type) {
    const auto* values = static_cast<const decltype(type)*>(v.data());
    const std::size_t count = v.pixels() * v.components, step = v.components;
    summarise(path, values, count, step, out);
    out.threshold = otsu_threshold(values, count, step, out.least, out.largest);
  });
  return out;
}

}  // namespace efree
