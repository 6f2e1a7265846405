// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/image_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/internal/image_frame.hpp"
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {

using internal::ImageFrame, internal::PixelValues, internal::read_pixels, internal::require_grey, internal::with_type;

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
  float farthest = 0.0F;
  for (std::size_t p = 0; p < out.size(); ++p) {
    const double distance = std::abs(static_cast<double>(values[p * stride]) - *options.threshold);
    if (std::isnan(distance)) continue;
    const double kept = std::clamp(distance, least, largest);
    out[p] = static_cast<float>(labels[p] != 0 ? kept : -kept);
    farthest = std::max(farthest, std::abs(out[p]));
  }
  for (float& distance : out)  // of values that are not numbers: as far on the side of void as any other
    if (distance == 0.0F) distance = -std::max(farthest, static_cast<float>(least));
  return out;
}

/// The warning that some values are not numbers; empty if all are.
template <class T> std::string warning_of_nan(const T* values, int stride, std::size_t count) {
  std::size_t none = 0;
  if constexpr (std::is_floating_point_v<T>)
    for (std::size_t p = 0; p < count; ++p) none += std::isnan(values[p * stride]);
  return none == 0 ? "" : fmt::format("{} voxels of the image are not numbers, and are taken as void", none);
}

/// Gives pixels with these labels the label 0; warns of labels but 0 that no pixel has.
void make_void(const std::vector<Label>& background, std::vector<Label>& labels, std::vector<std::string>& warnings) {
  std::vector<char> is_there(background.size(), 0);
  for (Label& label : labels)
    if (const auto found = std::ranges::find(background, label); found != background.end()) {
      is_there[found - background.begin()] = 1;
      label = 0;
    }
  for (std::size_t k = 0; k < background.size(); ++k)
    if (background[k] != 0 && is_there[k] == 0)
      warnings.push_back(fmt::format("no pixel of the image has the label {}, which background names", background[k]));
}

/// The file's values, with the dimensions asked for.
template <int Dim> PixelValues read_checked(const std::string& path, const ImageOptions<Dim>& options) {
  if (!options.spacing.empty() && options.spacing.size() != 1 && options.spacing.size() != Dim)
    throw InputError(fmt::format("{}: {} spacings given, expected 1 or {}", path, options.spacing.size(), Dim));
  PixelValues v = read_pixels<Dim>(path, options);
  if (Dim == 2 && v.size[2] != 1)
    throw InputError(fmt::format("{}: it has {} layers, expected a plane image", path, v.size[2]));
  if (Dim == 3 && v.size[2] == 1 && !options.raw)
    throw InputError(fmt::format("{}: it has a single layer, expected an image of three dimensions", path));
  return v;
}

}  // namespace

template <int Dim> ImageFile<Dim> read_image_file(const std::string& path, const ImageOptions<Dim>& options) {
  if (options.threshold && !std::isfinite(*options.threshold))
    throw InputError(fmt::format("{}: the threshold is {}", path, *options.threshold));
  PixelValues v = read_checked<Dim>(path, options);
  const ImageFrame<Dim> frame(path, v, options);
  auto image = frame.template empty<LabelImage<Dim>>();
  with_type(path, v.type, [&](auto value) {
    const auto* values = static_cast<const decltype(value)*>(v.data());
    if (options.threshold)
      if (std::string doubt =
              warning_of_nan(values, v.components, v.size[0] * static_cast<std::size_t>(v.size[1]) * v.size[2]);
          !doubt.empty())
        v.doubts.push_back(std::move(doubt));
    image.labels = classify<Dim, decltype(value)>(path, v, options);
    if (options.threshold) image.grey = distances_from_threshold(values, v.components, options, image.labels);
  });
  frame.put_in_order(image.labels);
  if (options.threshold) frame.put_in_order(image.grey);
  if (!options.threshold) make_void(options.background, image.labels, v.doubts);
  check_image(image);
  const auto counts = count_labels(image);
  if (counts.size() == 1 && counts[0].label == 0) throw InputError(fmt::format("{}: all of it is background", path));
  if (static_cast<Index>(counts.size()) > options.max_labels)
    throw InputError(
        fmt::format("{}: it has {} different values and looks like a grey image: give a threshold (or allow "
                    "that many labels)",
                    path, counts.size()));
  return {std::move(image), frame.remarks(), v.doubts};
}

template <int Dim> LabelImage<Dim> read_image(const std::string& path, const ImageOptions<Dim>& options) {
  return read_image_file<Dim>(path, options).image;
}

template <int Dim> GreyImage<Dim> read_grey_image(const std::string& path, const ImageOptions<Dim>& options) {
  const PixelValues v = read_checked<Dim>(path, options);
  const ImageFrame<Dim> frame(path, v, options);
  auto image = frame.template empty<GreyImage<Dim>>();
  with_type(path, v.type, [&](auto value) {
    using T = decltype(value);
    const T* values = static_cast<const T*>(v.data());
    require_grey(path, values, v);
    image.values.resize(v.pixels());
    for (std::size_t p = 0; p < image.values.size(); ++p)
      image.values[p] = static_cast<float>(values[p * v.components]);
  });
  frame.put_in_order(image.values);
  return image;
}

template ImageFile<2> read_image_file<2>(const std::string&, const ImageOptions<2>&);
template ImageFile<3> read_image_file<3>(const std::string&, const ImageOptions<3>&);
template LabelImage<2> read_image<2>(const std::string&, const ImageOptions<2>&);
template LabelImage<3> read_image<3>(const std::string&, const ImageOptions<3>&);
template GreyImage<2> read_grey_image<2>(const std::string&, const ImageOptions<2>&);
template GreyImage<3> read_grey_image<3>(const std::string&, const ImageOptions<3>&);

}  // namespace efree
