// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/label_image.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>

namespace efree {

template <int Dim> void check_image(const LabelImage<Dim>& image) {
  std::size_t pixels = 1;
  for (const Index n : image.size) {
    if (n < 1) throw InputError(fmt::format("image: it is {} pixels large", fmt::join(image.size, " x ")));
    pixels *= n;
  }
  if (image.labels.size() != pixels)
    throw InputError(fmt::format("image: {} labels for {} pixels", image.labels.size(), fmt::join(image.size, " x ")));
  if (!(image.spacing.minCoeff() > 0.0) || !image.spacing.allFinite())
    throw InputError(
        fmt::format("image: the spacing is {}, expected positive lengths", fmt::join(image.spacing, ", ")));
  if (!image.origin.allFinite())
    throw InputError(fmt::format("image: the origin is {}, expected finite numbers", fmt::join(image.origin, ", ")));
  if (!image.axes.isUnitary(1e-9) || image.axes.determinant() < 0.0)
    throw InputError("image: its axes are no rotation");
  if (image.grey.empty()) return;
  if (image.grey.size() != pixels)
    throw InputError(
        fmt::format("image: {} grey values for {} pixels", image.grey.size(), fmt::join(image.size, " x ")));
  for (std::size_t pixel = 0; pixel < pixels; ++pixel)
    if (const float grey = image.grey[pixel];
        !std::isfinite(grey) || !(image.labels[pixel] != 0 ? grey > 0.0f : grey < 0.0f))
      throw InputError(fmt::format("image: pixel {} has the label {} and the grey value {}, expected a {} one", pixel,
                                   image.labels[pixel], grey, image.labels[pixel] != 0 ? "positive" : "negative"));
}

template <int Dim> NearMaterial<Dim> material_near(const LabelImage<Dim>& image, const Vec<Dim>& x, int reach) {
  const Vec<Dim> u = (image.axes.transpose() * (x - image.origin)).cwiseQuotient(image.spacing);
  std::array<Index, Dim> low, high;
  for (int d = 0; d < Dim; ++d) {
    const auto at = static_cast<Index>(std::clamp(std::floor(u[d]), -1e9, 1e9));
    low[d] = std::max(0, at - reach);
    high[d] = std::min(image.size[d] - 1, at + reach);
    if (low[d] > high[d]) return {};
  }
  NearMaterial<Dim> found;
  found.distance = std::numeric_limits<double>::infinity();
  for (std::array<Index, Dim> at = low; at[Dim - 1] <= high[Dim - 1];) {
    if (const Label label = image.at(at); label != 0) {
      Vec<Dim> way;  // from the point to the pixel, along the image's axes
      for (int d = 0; d < Dim; ++d) way[d] = image.spacing[d] * (std::clamp(u[d], at[d] * 1.0, at[d] + 1.0) - u[d]);
      if (const double distance = way.norm(); distance < found.distance)
        found = {label, distance > 0.0 ? Vec<Dim>(x + image.axes * way) : x, distance};
    }
    for (int d = 0; d < Dim && (++at[d] > high[d] && d + 1 < Dim); ++d) at[d] = low[d];
  }
  return found.label == 0 ? NearMaterial<Dim>() : found;
}

template <int Dim> std::vector<LabelCount> count_labels(const LabelImage<Dim>& image) {
  constexpr std::size_t chunk = std::size_t{1} << 22U, labels = std::numeric_limits<Label>::max() + 1;
  const std::size_t pixels = image.labels.size();
  std::vector<std::vector<LabelCount>> of_chunk((pixels + chunk - 1) / chunk);
  parallel_chunks(static_cast<Index>(of_chunk.size()), 1, [&](Index first, Index last) {
    std::vector<std::int64_t> count(labels, 0);
    for (Index c = first; c < last; ++c) {
      std::ranges::fill(count, 0);
      const std::size_t stop = std::min(pixels, (c + 1) * chunk);
      for (std::size_t begin = c * chunk, end = begin; begin < stop; begin = end) {  // run by run
        const Label label = image.labels[begin];
        while (end < stop && image.labels[end] == label) ++end;
        count[label] += static_cast<std::int64_t>(end - begin);
      }
      for (std::size_t label = 0; label < labels; ++label)
        if (count[label] > 0) of_chunk[c].push_back({static_cast<Label>(label), count[label]});
    }
  });
  std::map<Label, std::int64_t> all;
  for (const auto& some : of_chunk)
    for (const LabelCount& one : some) all[one.label] += one.pixels;
  std::vector<LabelCount> counts;
  for (const auto& [label, number] : all) counts.push_back({label, number});
  return counts;
}

template <int Dim> LabelImage<Dim> random_spheres(Index n, const RandomSpheres& options) {
  if (n < 1 || !(options.r_min > 0.0 && options.r_min <= options.r_max && std::isfinite(options.r_max)))
    throw InputError(fmt::format("random spheres: {} pixels a side, radii {} to {}, expected 0 < r_min <= r_max", n,
                                 options.r_min, options.r_max));
  if (!(options.porosity >= 0.0 && options.porosity < 1.0))
    throw InputError(fmt::format("random spheres: porosity {}, expected 0 to less than 1", options.porosity));
  require_memory(sizeof(Label) * std::pow(static_cast<double>(n), Dim), "an image of random spheres");
  LabelImage<Dim> image;
  image.size.fill(n);
  std::size_t pixels = 1;
  for (int d = 0; d < Dim; ++d) pixels *= n;
  image.labels.assign(pixels, 1);

  std::mt19937_64 generator(options.seed);
  const auto uniform = [&](double from, double to) {
    return from + (to - from) * 0x1p-53 * static_cast<double>(generator() >> 11);
  };
  std::size_t carved = 0;
  while (static_cast<double>(carved) < options.porosity * static_cast<double>(pixels)) {
    const double r = uniform(options.r_min, options.r_max);
    Vec<Dim> centre;
    for (int d = 0; d < Dim; ++d) centre[d] = uniform(0.0, n);
    std::array<Index, Dim> low, high, at;
    for (int d = 0; d < Dim; ++d) {
      low[d] = std::max(0, static_cast<Index>(std::floor(centre[d] - r)));
      high[d] = std::min(n, static_cast<Index>(std::ceil(centre[d] + r)));
    }
    at = low;
    while (at[Dim - 1] < high[Dim - 1]) {
      double distance = 0.0;
      for (int d = 0; d < Dim; ++d) distance += std::pow(at[d] + 0.5 - centre[d], 2);
      if (Label& label = image.labels[image.index(at)]; distance < r * r && label != 0) {
        label = 0;
        ++carved;
      }
      for (int d = 0; d < Dim; ++d) {  // the next pixel of the box
        if (++at[d] < high[d] || d + 1 == Dim) break;
        at[d] = low[d];
      }
    }
  }
  return image;
}

template void check_image<2>(const LabelImage<2>&);
template void check_image<3>(const LabelImage<3>&);
template NearMaterial<2> material_near<2>(const LabelImage<2>&, const Vec<2>&, int);
template NearMaterial<3> material_near<3>(const LabelImage<3>&, const Vec<3>&, int);
template std::vector<LabelCount> count_labels<2>(const LabelImage<2>&);
template std::vector<LabelCount> count_labels<3>(const LabelImage<3>&);
template LabelImage<2> random_spheres<2>(Index, const RandomSpheres&);
template LabelImage<3> random_spheres<3>(Index, const RandomSpheres&);

}  // namespace efree
