// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/image_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/internal/pixel_values.hpp"
#include "efree/geometry/mesh/internal/extent.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {

using internal::PixelValues, internal::read_pixels, internal::require_grey, internal::with_type;

namespace {

/// Label of every value, in the order of the file.
template <int Dim, class T>
std::vector<Label> classify(const std::string& path, const PixelValues& v, const ImageOptions<Dim>& options) {
  const T* values = static_cast<const T*>(v.data());
  require_grey(path, values, v);
  std::vector<Label> labels(v.pixels());
  for (std::size_t p = 0; p < labels.size(); ++p) {
    const T value = values[p * v.components];
    if (options.threshold) {
      const bool high = static_cast<double>(value) >= *options.threshold;
      labels[p] = high != options.below;
      continue;
    }
    const double number = static_cast<double>(value);
    if (!(number >= 0.0 && number <= std::numeric_limits<Label>::max() && number == std::floor(number)))
      throw InputError(
          fmt::format("{}: the value {} is no label (whole numbers from 0 to {} are); for a grey image give "
                      "a threshold",
                      path, number, std::numeric_limits<Label>::max()));
    labels[p] = static_cast<Label>(number);
  }
  return labels;
}

/// Grey values as LabelImage has them. Never 0: a value that is the threshold itself counts as next to it. Values that
/// are no numbers do so, too; infinite ones as very large.
template <int Dim, class T> std::vector<float> distances_from_threshold(const T* values, int stride,
                                                                        const ImageOptions<Dim>& options,
                                                                        const std::vector<Label>& labels) {
  constexpr double least = std::numeric_limits<float>::min(), largest = 1e30;
  std::vector<float> out(labels.size());
  for (std::size_t p = 0; p < out.size(); ++p) {
    const double distance = std::abs(static_cast<double>(values[p * stride]) - *options.threshold);
    const double kept = std::isnan(distance) ? least : std::clamp(distance, least, largest);
    out[p] = static_cast<float>(labels[p] != 0 ? kept : -kept);
  }
  return out;
}

/// The file's values, with the dimensions asked for.
template <int Dim> PixelValues read_checked(const std::string& path, const ImageOptions<Dim>& options) {
  if (!options.spacing.empty() && options.spacing.size() != 1 && options.spacing.size() != Dim)
    throw InputError(fmt::format("{}: {} spacings given, expected 1 or {}", path, options.spacing.size(), Dim));
  PixelValues v = read_pixels<Dim>(path, options);
  if (Dim == 2 && v.size[2] != 1)
    throw InputError(fmt::format("{}: it has {} layers, expected a plane image", path, v.size[2]));
  if (Dim == 3 && v.size[2] == 1)
    throw InputError(fmt::format("{}: it has a single layer, expected an image of three dimensions", path));
  return v;
}

/// An image of this size, in this place.
template <class Image, int Dim>
Image frame_of(const std::string& path, const PixelValues& v, const ImageOptions<Dim>& options) {
  Image image;
  for (int d = 0; d < Dim; ++d) {
    image.size[d] = v.size[d];
    image.spacing[d] = options.spacing.empty() ? v.spacing[d] : options.spacing[options.spacing.size() == 1 ? 0 : d];
    // The origin is a length as well, but not one in pixels: a spacing that is given leaves it.
    image.origin[d] = v.origin[d];
    if (!(image.spacing[d] > 0.0))
      throw InputError(fmt::format(
          "{}: the spacing of its pixels along {} is {}, expected a positive length ([geometry.image] spacing says "
          "another one)",
          path, "xyz"[d], image.spacing[d]));
  }
  Vec<Dim> extent = image.spacing;
  for (int d = 0; d < Dim; ++d) extent[d] *= image.size[d];
  internal::require_extent<Dim>(image.origin, image.origin + extent, path);
  return image;
}

/// y points up.
template <class T> void flip(const PixelValues& v, std::vector<T>& values) {
  if (!v.top_first) return;
  for (Index k = 0; k < v.size[2]; ++k)
    for (Index j = 0; j < v.size[1] / 2; ++j) {
      const auto row = [&](Index of) {
        return values.begin() + (static_cast<std::ptrdiff_t>(k) * v.size[1] + of) * v.size[0];
      };
      std::swap_ranges(row(j), row(j) + v.size[0], row(v.size[1] - 1 - j));
    }
}

}  // namespace

template <int Dim> LabelImage<Dim> read_image(const std::string& path, const ImageOptions<Dim>& options) {
  if (options.threshold && !std::isfinite(*options.threshold))
    throw InputError(fmt::format("{}: the threshold is {}", path, *options.threshold));
  const PixelValues v = read_checked<Dim>(path, options);
  auto image = frame_of<LabelImage<Dim>>(path, v, options);
  with_type(path, v.type, [&](auto value) {
    image.labels = classify<Dim, decltype(value)>(path, v, options);
    if (options.threshold)
      image.grey =
          distances_from_threshold(static_cast<const decltype(value)*>(v.data()), v.components, options, image.labels);
  });
  flip(v, image.labels);
  if (options.threshold) flip(v, image.grey);
  if (!options.threshold)
    for (Label& label : image.labels)
      if (std::find(options.background.begin(), options.background.end(), label) != options.background.end()) label = 0;
  check_image(image);
  const auto counts = count_labels(image);
  if (counts.size() == 1 && counts[0].label == 0) throw InputError(fmt::format("{}: all of it is background", path));
  if (static_cast<Index>(counts.size()) > options.max_labels)
    throw InputError(
        fmt::format("{}: it has {} different values and looks like a grey image: give a threshold (or allow "
                    "that many labels)",
                    path, counts.size()));
  return image;
}

template <int Dim> GreyImage<Dim> read_grey_image(const std::string& path, const ImageOptions<Dim>& options) {
  const PixelValues v = read_checked<Dim>(path, options);
  auto image = frame_of<GreyImage<Dim>>(path, v, options);
  with_type(path, v.type, [&](auto value) {
    using T = decltype(value);
    const T* values = static_cast<const T*>(v.data());
    require_grey(path, values, v);
    image.values.resize(v.pixels());
    for (std::size_t p = 0; p < image.values.size(); ++p)
      image.values[p] = static_cast<float>(values[p * v.components]);
  });
  flip(v, image.values);
  return image;
}

template LabelImage<2> read_image<2>(const std::string&, const ImageOptions<2>&);
template LabelImage<3> read_image<3>(const std::string&, const ImageOptions<3>&);
template GreyImage<2> read_grey_image<2>(const std::string&, const ImageOptions<2>&);
template GreyImage<3> read_grey_image<3>(const std::string&, const ImageOptions<3>&);

}  // namespace efree
