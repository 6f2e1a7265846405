// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/image_summary.hpp"

#include "efree/core/error.hpp"

#include <algorithm>
#include <limits>
#include <string>

namespace efree {
namespace {

template <int Dim> class Pixels {
 public:
  explicit Pixels(const LabelImage<Dim>& image) : image_(image) {
    for (int d = 1; d < Dim; ++d) stride_[d] = stride_[d - 1] * image.size[d - 1];
  }
  std::size_t stride(int d) const { return stride_[d]; }
  Index along(std::size_t pixel, int d) const { return static_cast<Index>(pixel / stride_[d] % image_.size[d]); }
  /// Lower corner; counted from 0, an upper end of the image is a corner, too.
  Vec<Dim> corner(const std::array<Index, Dim>& at) const {
    Vec<Dim> x;
    for (int d = 0; d < Dim; ++d) x[d] = image_.origin[d] + at[d] * image_.spacing[d];
    return image_.in_world(x);
  }
  /// Makes the box contain a pixel.
  void extend(BoundingBox<Dim>& box, const std::array<Index, Dim>& at) const {
    for (int c = 0; c < 1 << Dim; ++c) {
      auto of = at;
      for (int d = 0; d < Dim; ++d) of[d] += c >> d & 1;
      box.extend(corner(of));
    }
  }
  /// From one pixel to the next in the order of the labels.
  void step(std::array<Index, Dim>& at) const {
    for (int d = 0; d < Dim; ++d) {
      if (++at[d] < image_.size[d]) return;
      at[d] = 0;
    }
  }

 private:
  const LabelImage<Dim>& image_;
  std::array<std::size_t, Dim> stride_{1};
};

/// Connected parts of the material and of the void inside it.
template <int Dim>
void find_parts(const LabelImage<Dim>& image, const Pixels<Dim>& pixels, ImageSummary<Dim>& summary) {
  LabelImage<Dim> material{.size = image.size, .labels = image.labels};
  for (Label& label : material.labels) label = label != 0;
  const auto [parts, part_of] = connected_pixels(material);
  std::vector<Vec<Dim>> sum(parts.size(), Vec<Dim>::Zero());  // of the centres of pixels, in pixels
  std::vector<char> on_frame(parts.size(), 0);
  std::array<Index, Dim> at{};
  for (const Index part : part_of) {
    for (int d = 0; d < Dim; ++d) {
      sum[part][d] += at[d] + 0.5;
      if (at[d] == 0 || at[d] + 1 == image.size[d]) on_frame[part] = 1;
    }
    pixels.step(at);
  }
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const bool is_void = parts[k].label == 0;
    if (is_void && on_frame[k]) continue;
    ++(is_void ? summary.closed_pores : summary.bodies);
    auto& smallest = is_void ? summary.smallest_pore : summary.smallest_body;
    if (smallest && smallest->pixels <= static_cast<std::int64_t>(parts[k].pixels)) continue;
    const Vec<Dim> centre = sum[k] / static_cast<double>(parts[k].pixels);
    smallest = {static_cast<std::int64_t>(parts[k].pixels),
                image.in_world(image.origin + centre.cwiseProduct(image.spacing))};
  }
}

/// The faces across axis `d` in the direction `side` (-1, 1), in runs along the first of the other axes.
template <int Dim> void find_facets(const LabelImage<Dim>& image, const Pixels<Dim>& pixels,
                                    const std::vector<Index>& number, int d, int side,
                                    std::vector<GroupSummary<Dim>>& groups, std::vector<ImageFacet<Dim>>& facets) {
  const int run = d == 0 ? 1 : 0;
  const Index frame_group = 2 * d + (side > 0), pore_group = 2 * Dim;
  const double measure = image.pixel_volume() / image.spacing[d];
  const auto group_of = [&](std::size_t pixel, const std::array<Index, Dim>& at) -> Index {
    if (image.labels[pixel] == 0) return -1;
    const bool framed = side < 0 ? at[d] == 0 : at[d] + 1 == image.size[d];
    if (framed) return frame_group;
    return image.labels[side < 0 ? pixel - pixels.stride(d) : pixel + pixels.stride(d)] == 0 ? pore_group : -1;
  };
  std::array<Index, Dim> at{};
  for (std::size_t pixel = 0; pixel < image.labels.size(); ++pixel, pixels.step(at)) {
    const Index group = group_of(pixel, at);
    if (group < 0) continue;
    if (at[run] > 0) {  // part of a run that is done already?
      auto before = at;
      --before[run];
      const std::size_t previous = pixel - pixels.stride(run);
      if (image.labels[previous] == image.labels[pixel] && group_of(previous, before) == group) continue;
    }
    auto low = at, high = at, next = at;
    std::size_t last = pixel;
    for (++next[run]; next[run] < image.size[run]; ++next[run]) {
      const std::size_t candidate = last + pixels.stride(run);
      if (image.labels[candidate] != image.labels[pixel] || group_of(candidate, next) != group) break;
      last = candidate;
    }
    if (side > 0) ++low[d], ++high[d];
    high[run] = next[run];
    ImageFacet<Dim> facet{{}, number[image.labels[pixel]], group};
    facet.corners[0] = pixels.corner(low);
    facet.corners[1] = pixels.corner(high);
    if constexpr (Dim == 3) {
      const int other = 3 - d - run;
      ++low[other], ++high[other];
      facet.corners[2] = pixels.corner(high);
      facet.corners[3] = pixels.corner(low);
    }
    const Index count = next[run] - at[run];
    GroupSummary<Dim>& part = groups[group];
    part.num_facets += count;
    part.measure += count * measure;
    part.mean_normal += side * count * measure * image.axes.col(d);
    for (const Vec<Dim>& corner : facet.corners) part.box.extend(corner);
    facets.push_back(std::move(facet));
  }
}

}  // namespace

template <int Dim> ImageSummary<Dim> summarize_image(const LabelImage<Dim>& image) {
  check_image(image);
  const Pixels<Dim> pixels(image);
  ImageSummary<Dim> summary;
  std::vector<Index> number(std::numeric_limits<Label>::max() + 1, -1);
  std::int64_t material = 0;
  for (const auto& [label, count] : count_labels(image)) {
    if (label == 0) continue;
    number[label] = static_cast<Index>(summary.labels.size());
    material += count;
    summary.labels.push_back(
        {std::to_string(label), static_cast<Index>(count), static_cast<double>(count) * image.pixel_volume(), {}});
  }
  if (material == 0) throw InputError("image: all of it is void");
  summary.material = static_cast<double>(material) / static_cast<double>(image.labels.size());
  std::array<Index, Dim> at{};
  for (std::size_t pixel = 0; pixel < image.labels.size(); ++pixel, pixels.step(at)) {
    if (image.labels[pixel] == 0) continue;
    pixels.extend(summary.labels[number[image.labels[pixel]]].box, at);
  }
  find_parts(image, pixels, summary);

  const std::vector<std::string> names =
      Dim == 2 ? std::vector<std::string>{"left", "right", "bottom", "top", "pores"}
               : std::vector<std::string>{"left", "right", "front", "back", "bottom", "top", "pores"};
  std::vector<GroupSummary<Dim>> groups;
  for (const std::string& name : names) groups.push_back({name, 0, 0.0, std::nullopt, {}, Vec<Dim>::Zero()});
  for (int d = 0; d < Dim; ++d)
    for (const int side : {-1, 1}) find_facets(image, pixels, number, d, side, groups, summary.facets);
  std::vector<Index> kept(groups.size(), -1);
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (groups[g].num_facets == 0) continue;
    kept[g] = static_cast<Index>(summary.groups.size());
    groups[g].mean_normal /= groups[g].measure;
    if (g < 2 * Dim) groups[g].normal = groups[g].mean_normal;
    summary.groups.push_back(std::move(groups[g]));
  }
  for (auto& facet : summary.facets) facet.group = kept[facet.group];
  return summary;
}

template ImageSummary<2> summarize_image<2>(const LabelImage<2>&);
template ImageSummary<3> summarize_image<3>(const LabelImage<3>&);

}  // namespace efree
