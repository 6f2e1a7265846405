// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/geometry/input/label_image.hpp"

#include <fmt/format.h>
#include <cmath>
#include <limits>

namespace efree {
namespace {

/// An image as runs of like pixels along its rows, which are joined where those of neighbouring rows touch (Rosenfeld &
/// Pfaltz 1966): far fewer than pixels.
template <int Dim> class Runs {
 public:
  /// Pixels are alike if class_of(label) is the same.
  template <class Class> Runs(const LabelImage<Dim>& image, const Class& class_of) : row_(image.size[0]) {
    const std::size_t rows = image.labels.size() / row_;
    first_.reserve(rows + 1);
    for (std::size_t row = 0; row < rows; ++row) {
      first_.push_back(runs_.size());
      const Label* labels = image.labels.data() + row * row_;
      for (std::size_t begin = 0, end = 0; begin < row_; begin = end) {
        const Label like = class_of(labels[begin]);
        do ++end;
        while (end < row_ && class_of(labels[end]) == like);
        runs_.push_back({static_cast<Index>(end), like});
      }
    }
    first_.push_back(runs_.size());
    if (runs_.size() > static_cast<std::size_t>(std::numeric_limits<Index>::max()))
      throw InputError(fmt::format("image: {} runs of like pixels, at most {} can be numbered", runs_.size(),
                                   std::numeric_limits<Index>::max()));
    join(image);
  }

  std::vector<ConnectedPixels::Part> parts;
  /// Calls f(first pixel, pixel after the last, part) for all runs, in their order.
  template <class F> void for_all(const F& f) const {
    for (std::size_t row = 0; row + 1 < first_.size(); ++row) {
      std::size_t begin = row * row_;
      for (std::size_t r = first_[row]; r < first_[row + 1]; ++r) {
        const std::size_t end = row * row_ + runs_[r].end;
        f(begin, end, part_of_[r]);
        begin = end;
      }
    }
  }

 private:
  struct Run {
    Index end;  ///< pixel of the row after the last one
    Label like;
  };

  void join(const LabelImage<Dim>& image) {
    internal::DisjointSets sets(static_cast<Index>(runs_.size()));
    std::size_t stride = 1;  // rows
    for (int d = 1; d < Dim; stride *= image.size[d++])
      for (std::size_t row = 0; row + 1 < first_.size(); ++row) {
        if (row / stride % image.size[d] == 0) continue;
        for (std::size_t a = first_[row - stride], b = first_[row]; b < first_[row + 1];) {
          if (runs_[a].like == runs_[b].like) sets.join(static_cast<Index>(a), static_cast<Index>(b));
          const Index end = std::min(runs_[a].end, runs_[b].end);
          a += runs_[a].end == end;
          b += runs_[b].end == end;
        }
      }
    part_of_ = std::move(sets).firsts();
    for (std::size_t r = 0; r < part_of_.size(); ++r) {
      Index& part = part_of_[r];
      const bool is_first = part == static_cast<Index>(r);
      part = is_first ? static_cast<Index>(parts.size()) : part_of_[part];
      if (is_first) parts.push_back({runs_[r].like, 0});
    }
    for_all([&](std::size_t begin, std::size_t end, Index part) { parts[part].pixels += end - begin; });
  }

  std::size_t row_;  ///< pixels in one
  std::vector<Run> runs_;
  std::vector<std::size_t> first_;  ///< run, by row, and the end
  std::vector<Index> part_of_;      ///< by run
};

}  // namespace

template <int Dim> ConnectedPixels connected_pixels(const LabelImage<Dim>& image) {
  Runs<Dim> runs(image, [](Label label) { return label; });
  ConnectedPixels out{std::move(runs.parts), std::vector<Index>(image.labels.size())};
  runs.for_all([&](std::size_t begin, std::size_t end, Index part) {
    std::fill(out.part_of.begin() + static_cast<std::ptrdiff_t>(begin),
              out.part_of.begin() + static_cast<std::ptrdiff_t>(end), part);
  });
  return out;
}

template <int Dim> std::vector<PixelBody> pixel_bodies(const LabelImage<Dim>& image) {
  check_image(image);
  const Runs<Dim> runs(image, [](Label label) -> Label { return label != 0; });
  std::vector<Index> body_of_part(runs.parts.size(), -1);
  std::vector<PixelBody> bodies;
  runs.for_all([&](std::size_t begin, std::size_t, Index part) {
    if (runs.parts[part].label == 0 || body_of_part[part] >= 0) return;
    body_of_part[part] = static_cast<Index>(bodies.size());
    bodies.push_back({runs.parts[part].pixels, begin});
  });
  return bodies;
}

template <int Dim> LargestBody<Dim> keep_largest(LabelImage<Dim> image) {
  check_image(image);
  const Runs<Dim> runs(image, [](Label label) -> Label { return label != 0; });
  Index largest = -1, bodies = 0;
  std::size_t pixels = 0;
  for (std::size_t k = 0; k < runs.parts.size(); ++k) {
    if (runs.parts[k].label == 0) continue;
    ++bodies;
    pixels += runs.parts[k].pixels;
    if (largest < 0 || runs.parts[k].pixels > runs.parts[largest].pixels) largest = static_cast<Index>(k);
  }
  if (largest < 0) throw InputError("image: all of it is void");
  runs.for_all([&](std::size_t begin, std::size_t end, Index part) {
    if (part == largest) return;
    for (std::size_t pixel = begin; pixel < end; ++pixel) {
      image.labels[pixel] = 0;
      if (!image.grey.empty()) image.grey[pixel] = -std::abs(image.grey[pixel]);
    }
  });
  return {std::move(image), bodies - 1,
          static_cast<double>(pixels - runs.parts[largest].pixels) / static_cast<double>(pixels)};
}

template ConnectedPixels connected_pixels<2>(const LabelImage<2>&);
template ConnectedPixels connected_pixels<3>(const LabelImage<3>&);
template std::vector<PixelBody> pixel_bodies<2>(const LabelImage<2>&);
template std::vector<PixelBody> pixel_bodies<3>(const LabelImage<3>&);
template LargestBody<2> keep_largest<2>(LabelImage<2>);
template LargestBody<3> keep_largest<3>(LabelImage<3>);

}  // namespace efree
