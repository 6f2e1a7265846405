// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/box_averages.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace efree {
namespace {

/// For each of `boxes` equal parts of a line of `voxels`, the voxels in it with their shares of it.
struct Overlaps {
  struct Share {
    Index voxel;
    float share;
  };
  std::vector<Share> shares;
  std::vector<std::size_t> begin;  // by box, and the end

  Overlaps(Index voxels, Index boxes) : begin{0} {
    const double length = static_cast<double>(voxels) / boxes;
    for (Index box = 0; box < boxes; ++box) {
      const double low = box * length, high = box + 1 == boxes ? voxels : (box + 1) * length;
      for (Index v = static_cast<Index>(low); v < voxels && v < high; ++v) {
        const double share = (std::min(high, v + 1.0) - std::max<double>(low, v)) / length;
        if (share > 1e-9) shares.push_back({v, static_cast<float>(share)});
      }
      begin.push_back(shares.size());
    }
  }
  /// Mean of the line's values over a box.
  float mean(Index box, const float* from) const {
    float sum = 0.0F;
    for (std::size_t s = begin[box]; s < begin[box + 1]; ++s) sum += shares[s].share * from[shares[s].voxel];
    return sum;
  }
};

/// The image as materials whose boundaries are planes within a voxel, layer by layer.
class VoxelFractions {
 public:
  /// Of voxels cut into parts^3 equal parts, 1 or 2.
  VoxelFractions(const LabelImage<3>& image, const std::vector<LabelCount>& counts,
                 const std::vector<float>& value_of_label, int parts, double grown)
      : image_(image), parts_(parts), grown_(static_cast<float>(grown) * static_cast<float>(parts)) {
    for (int d = 0; d < 3; ++d) size[d] = parts * image.size[d];
    keep({0, 0}, {image.size[0], image.size[1]});
    for (std::size_t p = 0; p < weights_.size(); ++p) {
      const float t = 0.25F * static_cast<float>(p) - 0.5F;
      weights_[p] = {0.5F * t * (t - 1.0F), 1.0F - t * t, 0.5F * t * (t + 1.0F)};
    }
    values_.push_back(value_of_label.empty() ? 0.0F : value_of_label[0]);
    for (const auto& [label, count] : counts) {
      kind_.resize(label + 1, unknown);
      const float value = label < value_of_label.size() ? value_of_label[label] : 0.0F;
      const auto same = label == 0 ? values_.begin() : std::find(values_.begin() + 1, values_.end(), value);
      kind_[label] = static_cast<std::uint16_t>(same - values_.begin());
      if (same == values_.end()) values_.push_back(value);
    }
    if (!image.grey.empty())
      for (std::size_t label = 1; label < kind_.size(); ++label)
        if (kind_[label] != unknown) material_ = std::max(material_, values_[kind_[label]]);
  }
  int parts() const { return parts_; }
  std::array<Index, 3> size;  ///< parts along the axes

  /// No more than the voxels [low, high) along x and y are asked for. To be said before the first layer.
  void keep(const std::array<Index, 2>& low, const std::array<Index, 2>& high) {
    low_ = low;
    high_ = high;
  }
  const std::array<Index, 2>& low() const { return low_; }
  const std::array<Index, 2>& high() const { return high_; }

  /// Mean values in the parts of the voxels of a layer: `parts` layers one after the other. Fast for one layer after
  /// the next.
  const std::vector<float>& layer(Index k) {
    const Index nx = image_.size[0];
    std::array<const Smooth*, 3> smooth;
    for (int dz = -1; dz <= 1; ++dz) smooth[dz + 1] = &smoothed(std::clamp(k + dz, 0, image_.size[2] - 1));
    const std::vector<std::uint16_t>& kinds = kinds_of(k);
    result_.resize(static_cast<std::size_t>(parts_) * size[0] * size[1]);
    std::array<float, 8> values;
    constexpr Index at_once = 8;
    std::array<std::uint8_t, at_once> all_whole;
    all_whole.fill(whole);
    for (Index j = low_[1]; j < high_[1]; ++j)
      for (Index i = low_[0]; i < high_[0]; ++i) {
        const std::size_t voxel = i + static_cast<std::size_t>(nx) * j;
        const std::uint16_t kind = kinds[voxel];
        const std::uint8_t* of_kind = smooth[1]->of_kind[kind].data() + voxel;
        if (parts_ == 1 && i + at_once <= high_[0] && std::equal(all_whole.begin(), all_whole.end(), of_kind)) {
          std::fill_n(result_.begin() + static_cast<std::ptrdiff_t>(voxel), at_once, values_[kind]);
          i += at_once - 1;
          continue;
        }
        const int own = *of_kind;
        // Walls, slits and specks a voxel thick, which smoothing would take away, stay as they are.
        const bool thin = own <= whole / 2 && image_.grey.empty() && is_thin({i, j, k});
        if (own == whole)
          values.fill(values_[kind]);
        else if (thin)
          values.fill(kind > 0 ? std::clamp(1.0F + 2.0F * grown_, 0.0F, 1.0F) * values_[kind] : values_[kind]);
        else
          split({i, j, k}, kind, smooth, values);
        if (parts_ == 1) {
          result_[voxel] = values[0];
          continue;
        }
        for (int p = 0; p < 8; ++p)
          result_[2 * i + (p & 1) +
                  static_cast<std::size_t>(size[0]) *
                      (2 * j + (p >> 1 & 1) + static_cast<std::size_t>(size[1]) * (p >> 2))] = values[p];
      }
    return result_;
  }

 private:
  static constexpr std::uint16_t unknown = 0xffff;
  static constexpr int whole = 64;  ///< sum of the weights 1, 2, 1 along each axis
  using Plane = std::vector<std::uint8_t>;
  using Stencil = std::array<float, 27>;  ///< by voxel around one, x fastest
  /// By kind of value, how much of it is in the 27 voxels around each one of a layer.
  struct Smooth {
    Index layer = -1;
    std::vector<Plane> of_kind;
  };
  struct Kinds {
    Index layer = -1;
    std::vector<std::uint16_t> of_voxel;
  };

  /// Whether both neighbours along an axis are of other kinds than a voxel.
  bool is_thin(const std::array<Index, 3>& voxel) const {
    const std::uint16_t own = kind_[image_.at(voxel)];
    for (int d = 0; d < 3; ++d) {
      std::array<Index, 3> low = voxel, high = voxel;
      if (--low[d] < 0 || ++high[d] >= image_.size[d]) continue;
      if (kind_[image_.at(low)] != own && kind_[image_.at(high)] != own) return true;
    }
    return false;
  }

  const std::vector<std::uint16_t>& kinds_of(Index k) {
    Kinds& out = kinds_[k % kinds_.size()];
    if (out.layer == k) return out.of_voxel;
    out.layer = k;
    const std::size_t plane = static_cast<std::size_t>(image_.size[0]) * image_.size[1];
    out.of_voxel.resize(plane);
    const Label* labels = image_.labels.data() + plane * k;
    const Range y = around(1, 2);
    for (std::size_t i = static_cast<std::size_t>(image_.size[0]) * y.begin;
         i < static_cast<std::size_t>(image_.size[0]) * y.end; ++i)
      out.of_voxel[i] = kind_[labels[i]];
    return out.of_voxel;
  }

  struct Range {
    Index begin, end;
  };
  /// The voxels that are kept and so many around them, along x or y.
  Range around(int axis, Index by) const {
    return {std::max(low_[axis] - by, 0), std::min(high_[axis] + by, image_.size[axis])};
  }

  const Smooth& smoothed(Index k) {
    Smooth& out = smooth_[k % smooth_.size()];
    if (out.layer == k) return out;
    out.layer = k;
    out.of_kind.resize(values_.size());
    const Index nx = image_.size[0], ny = image_.size[1];
    const std::size_t plane = static_cast<std::size_t>(nx) * ny;
    std::array<const std::uint16_t*, 3> layers;
    for (int dz = -1; dz <= 1; ++dz) layers[dz + 1] = kinds_of(std::clamp(k + dz, 0, image_.size[2] - 1)).data();
    // Along z, along y, along x; the frame repeats its outermost voxels. The last kind is what the others leave.
    const Range x = around(0, 1), x_read = around(0, 2), y = around(1, 1), y_read = around(1, 2);
    Plane columns(plane), rows(plane);
    const auto row_of = [nx](auto& plane_of, Index j) { return plane_of.data() + static_cast<std::size_t>(nx) * j; };
    Plane& rest = out.of_kind.back();
    rest.resize(plane);
    for (Index j = y.begin; j < y.end; ++j)
      std::fill(row_of(rest, j) + x.begin, row_of(rest, j) + x.end, static_cast<std::uint8_t>(whole));
    for (std::size_t kind = 0; kind + 1 < values_.size(); ++kind) {
      for (Index j = y_read.begin; j < y_read.end; ++j) {
        const std::size_t row = static_cast<std::size_t>(nx) * j;
        for (std::size_t i = row + x_read.begin; i < row + x_read.end; ++i)
          columns[i] =
              static_cast<std::uint8_t>((layers[0][i] == kind) + 2 * (layers[1][i] == kind) + (layers[2][i] == kind));
      }
      for (Index j = y.begin; j < y.end; ++j) {
        const std::uint8_t *before = row_of(columns, std::max(j - 1, 0)), *here = row_of(columns, j),
                           *after = row_of(columns, std::min(j + 1, ny - 1));
        std::uint8_t* to = row_of(rows, j);
        for (Index i = x_read.begin; i < x_read.end; ++i)
          to[i] = static_cast<std::uint8_t>(before[i] + 2 * here[i] + after[i]);
      }
      Plane& result = out.of_kind[kind];
      result.resize(plane);
      for (Index j = y.begin; j < y.end; ++j) {
        const std::uint8_t* from = row_of(rows, j);
        std::uint8_t *to = row_of(result, j), *left = row_of(rest, j);
        const auto at_end = [&](Index i) {
          to[i] = static_cast<std::uint8_t>(from[std::max(i - 1, 0)] + 2 * from[i] + from[std::min(i + 1, nx - 1)]);
        };
        for (Index i = std::max(x.begin, 1); i < std::min(x.end, nx - 1); ++i)
          to[i] = static_cast<std::uint8_t>(from[i - 1] + 2 * from[i] + from[i + 1]);
        if (x.begin == 0) at_end(0);
        if (x.end == nx) at_end(nx - 1);
        for (Index i = x.begin; i < x.end; ++i) left[i] = static_cast<std::uint8_t>(left[i] - to[i]);
      }
    }
    return out;
  }

  /// How much of a part lies where a field is positive, if a plane bounds that: from its values in the middle and at
  /// the middles of the sides.
  static float fraction(float middle, const std::array<float, 3>& low, const std::array<float, 3>& high, float grown) {
    float mean = middle, change = 0.0F, squares = 0.0F;  // Simpson's mean: where boundaries are curved, so is the field
    for (int d = 0; d < 3; ++d) {
      mean += (low[d] + high[d] - 2.0F * middle) / 6.0F;
      const float across = high[d] - low[d];
      change += std::abs(across);
      squares += across * across;
    }
    if (grown != 0.0F) mean += grown * std::sqrt(squares);
    return change > 0.0F ? std::clamp(0.5F + mean / change, 0.0F, 1.0F) : mean > 0.0F ? 1.0F : 0.0F;
  }
  /// That of a whole voxel: `at` its own value, and those before and after along each axis.
  static float whole_fraction(float own, const std::array<float, 3>& before, const std::array<float, 3>& after,
                              float grown) {
    std::array<float, 3> low, high;
    for (int d = 0; d < 3; ++d) {
      low[d] = 0.375F * before[d] + 0.75F * own - 0.125F * after[d];
      high[d] = -0.125F * before[d] + 0.75F * own + 0.375F * after[d];
    }
    return fraction(own, low, high, grown);
  }

  /// By half part of a voxel how much of it lies where the stencil's field, quadratic along each axis, is positive.
  std::array<float, 8> eighth_fractions(const Stencil& stencil, float grown) const {
    // At the parts' faces and middles: along x, along y, along z.
    constexpr int m = 5;
    std::array<float, 9 * m> along_x;
    std::array<float, 3 * m * m> along_xy;
    std::array<float, m * m * m> at;
    for (int p = 0; p < m; ++p) {
      const auto& w = weights_[p];
      for (int n = 0; n < 9; ++n)
        along_x[n * m + p] = w[0] * stencil[3 * n] + w[1] * stencil[3 * n + 1] + w[2] * stencil[3 * n + 2];
    }
    for (int z = 0; z < 3; ++z)
      for (int p = 0; p < m; ++p)
        for (int x = 0; x < m; ++x) {
          const float* from = &along_x[3 * z * m + x];
          along_xy[(z * m + p) * m + x] =
              weights_[p][0] * from[0] + weights_[p][1] * from[m] + weights_[p][2] * from[2 * m];
        }
    for (int p = 0; p < m; ++p)
      for (int i = 0; i < m * m; ++i)
        at[p * m * m + i] = weights_[p][0] * along_xy[i] + weights_[p][1] * along_xy[m * m + i] +
                            weights_[p][2] * along_xy[2 * m * m + i];
    std::array<float, 8> fractions;
    for (int part = 0; part < 8; ++part) {
      const float* middle = &at[((2 * (part >> 2) + 1) * m + 2 * (part >> 1 & 1) + 1) * m + 2 * (part & 1) + 1];
      fractions[part] =
          fraction(*middle, {middle[-1], middle[-m], middle[-m * m]}, {middle[1], middle[m], middle[m * m]}, grown);
    }
    return fractions;
  }

  /// Mean values in the parts of a voxel that a boundary cuts.
  void split(const std::array<Index, 3>& voxel, std::uint16_t own, const std::array<const Smooth*, 3>& smooth,
             std::array<float, 8>& values) const {
    std::array<std::array<std::size_t, 3>, 3> at;  // by axis: steps to the voxel before, itself, the next
    std::size_t stride = 1;
    for (int d = 0; d < 3; stride *= image_.size[d++])
      for (int n = 0; n < 3; ++n) at[d][n] = stride * std::clamp(voxel[d] + n - 1, 0, image_.size[d] - 1);
    /// What a kind, whose field around the voxel is value(x, y, z) at 0 to 2 along each axis, has of the parts.
    const auto fractions = [&](const auto& value, float grown) {
      std::array<float, 8> result{};
      if (parts_ == 1) {
        result[0] = whole_fraction(value(1, 1, 1), {value(0, 1, 1), value(1, 0, 1), value(1, 1, 0)},
                                   {value(2, 1, 1), value(1, 2, 1), value(1, 1, 2)}, grown);
        return result;
      }
      Stencil stencil;
      for (int n = 0; n < 27; ++n) stencil[n] = value(n % 3, n / 3 % 3, n / 9);
      return eighth_fractions(stencil, grown);
    };
    if (!image_.grey.empty()) {
      // Far from boundaries some fields have the largest number there is.
      float largest = 0.0F;
      const auto grey = [&](int x, int y, int z) { return image_.grey[at[0][x] + at[1][y] + at[2][z]]; };
      for (int n = 0; n < 27; ++n) largest = std::max(largest, std::abs(grey(n % 3, n / 3 % 3, n / 9)));
      values = fractions([&](int x, int y, int z) { return grey(x, y, z) / largest; }, grown_);
      for (float& value : values) value *= material_;
      return;
    }
    std::array<float, 8> sums{}, all{};
    const bool two = values_.size() == 2;  // the other has the rest
    if (two) all.fill(1.0F);
    for (std::size_t kind = two ? 1 : 0; kind < values_.size(); ++kind) {
      if (smooth[1]->of_kind[kind][at[0][1] + at[1][1]] == 0) continue;
      const auto field = [&](int x, int y, int z) {
        return static_cast<float>(smooth[z]->of_kind[kind][at[0][x] + at[1][y]]) / whole - 0.5F;
      };
      const std::array<float, 8> of_kind = fractions(field, kind == 0 ? -grown_ : grown_);
      for (std::size_t p = 0; p < 8; ++p) {
        sums[p] += of_kind[p] * values_[kind] + (two ? (1.0F - of_kind[p]) * values_[0] : 0.0F);
        if (!two) all[p] += of_kind[p];
      }
    }
    for (std::size_t p = 0; p < 8; ++p) values[p] = all[p] > 0.0F ? sums[p] / all[p] : values_[own];
  }

  const LabelImage<3>& image_;
  int parts_;
  std::array<Index, 2> low_, high_;              ///< voxels that are kept, along x and y
  float grown_;                                  ///< by how much void recedes [parts]
  std::vector<std::uint16_t> kind_;              ///< by label: labels of the same value are of one kind
  std::vector<float> values_;                    ///< by kind: void, then labels by their values
  float material_ = 0.0F;                        ///< value of what is not void, with grey values
  std::array<std::array<float, 3>, 5> weights_;  ///< of quadratics through -1, 0, 1, by face or middle of a half
  std::array<Smooth, 3> smooth_;
  std::array<Kinds, 5> kinds_;
  std::vector<float> result_;
};

void require_boxes(const std::array<Index, 3>& boxes) {
  if (*std::ranges::min_element(boxes) < 1) throw InputError("a grid of boxes needs at least one along each axis");
}

}  // namespace

struct BoxAverages::Parts {
  VoxelFractions voxels;
  std::array<Index, 3> boxes;
  Overlaps x, y, z;
};

BoxAverages::BoxAverages(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                         const std::array<Index, 3>& boxes, double grown)
    : BoxAverages((check_image(image), image), count_labels(image), value_of_label, boxes, grown) {}
BoxAverages::BoxAverages(const LabelImage<3>& image, const std::vector<LabelCount>& counts,
                         const std::vector<float>& value_of_label, const std::array<Index, 3>& boxes, double grown) {
  require_boxes(boxes);
  bool smaller = false;
  for (int d = 0; d < 3; ++d) smaller = smaller || boxes[d] > image.size[d];
  const VoxelFractions voxels(image, counts, value_of_label, smaller ? 2 : 1, grown);
  const auto& n = voxels.size;
  parts_ = std::make_unique<const Parts>(Parts{voxels, boxes, {n[0], boxes[0]}, {n[1], boxes[1]}, {n[2], boxes[2]}});
}
BoxAverages::BoxAverages(BoxAverages&&) noexcept = default;
BoxAverages::~BoxAverages() = default;

std::vector<float> BoxAverages::layers(Index first, Index last) const {
  return in({{0, 0, first}, {parts_->boxes[0], parts_->boxes[1], last}});
}

std::vector<float> BoxAverages::in(const BoxRange& range) const {
  const auto& [of_image, boxes, x, y, z] = *parts_;
  const auto& n = of_image.size;
  const auto along = static_cast<std::size_t>(range.end[0] - range.begin[0]),
             plane = along * (range.end[1] - range.begin[1]);
  std::vector<float> means(range.size());
  if (means.empty()) return means;
  // The parts of voxels that these boxes overlap.
  const auto first_of = [](const Overlaps& overlaps, Index box) { return overlaps.shares[overlaps.begin[box]].voxel; };
  const auto end_of = [](const Overlaps& overlaps, Index box) {
    return overlaps.shares[overlaps.begin[box] - 1].voxel + 1;
  };
  const Index parts = of_image.parts();
  const std::array<Index, 2> low{first_of(x, range.begin[0]) / parts, first_of(y, range.begin[1]) / parts},
      high{(end_of(x, range.end[0]) + parts - 1) / parts, (end_of(y, range.end[1]) + parts - 1) / parts};
  parallel_chunks(range.end[2] - range.begin[2], 16, [&](Index begin, Index end) {
    VoxelFractions voxels = of_image;
    voxels.keep(low, high);
    const std::size_t line_plane = along * n[1];
    std::vector<float> lines(parts * line_plane);  // means along x, of the parts of a layer of voxels
    Index there = -1;
    for (Index k = range.begin[2] + begin; k < range.begin[2] + end; ++k)
      for (std::size_t s = z.begin[k]; s < z.begin[k + 1]; ++s) {
        const Index part = z.shares[s].voxel;
        if (part / parts != there) {
          const std::vector<float>& layer = voxels.layer(there = part / parts);
          for (Index of_voxel = 0; of_voxel < parts; ++of_voxel)
            for (Index j = parts * low[1]; j < parts * high[1]; ++j) {
              const std::size_t line = j + static_cast<std::size_t>(n[1]) * of_voxel;
              for (Index i = range.begin[0]; i < range.end[0]; ++i)
                lines[i - range.begin[0] + along * line] = x.mean(i, layer.data() + n[0] * line);
            }
        }
        float* out = means.data() + plane * (k - range.begin[2]);
        for (Index j = range.begin[1]; j < range.end[1]; ++j)
          for (std::size_t t = y.begin[j]; t < y.begin[j + 1]; ++t) {
            const float share = z.shares[s].share * y.shares[t].share;
            const float* line = lines.data() + line_plane * (part % parts) + along * y.shares[t].voxel;
            float* to = out + along * (j - range.begin[1]);
            for (std::size_t i = 0; i < along; ++i) to[i] += share * line[i];
          }
      }
  });
  return means;
}

std::vector<float> box_averages(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                                const std::array<Index, 3>& boxes, double grown) {
  return BoxAverages(image, value_of_label, boxes, grown).layers(0, boxes[2]);
}

std::vector<BoxRange> boxes_of_groups(const LabelImage<3>& image, const std::vector<Index>& group_of_label,
                                      Index groups, const std::array<Index, 3>& boxes) {
  const BoxRange none{image.size, {0, 0, 0}};
  const auto add = [](BoxRange& to, const std::array<Index, 3>& begin, const std::array<Index, 3>& end) {
    for (std::size_t d = 0; d < 3; ++d) {
      to.begin[d] = std::min(to.begin[d], begin[d]);
      to.end[d] = std::max(to.end[d], end[d]);
    }
  };
  std::vector<std::vector<BoxRange>> of_layer(image.size[2], std::vector<BoxRange>(groups, none));
  parallel_chunks(image.size[2], 1, [&](Index k, Index) {
    const Label* labels = image.labels.data() + image.index({0, 0, k});
    for (Index j = 0; j < image.size[1]; ++j, labels += image.size[0])
      for (Index i = 0, end = 0; i < image.size[0]; i = end) {
        const Label label = labels[i];
        while (end < image.size[0] && labels[end] == label) ++end;
        const Index group = label < group_of_label.size() ? group_of_label[label] : -1;
        if (group >= 0) add(of_layer[k][group], {i, j, k}, {end, j + 1, k + 1});
      }
  });
  std::vector<BoxRange> result(groups);
  for (Index group = 0; group < groups; ++group) {
    BoxRange voxels = none;
    for (const auto& layer : of_layer) add(voxels, layer[group].begin, layer[group].end);
    if (voxels.end[0] == 0) continue;
    constexpr double smoothed = 1.0;  // voxels
    for (std::size_t d = 0; d < 3; ++d) {
      const double per_voxel = static_cast<double>(boxes[d]) / image.size[d];
      const double low = (voxels.begin[d] - smoothed) * per_voxel, high = (voxels.end[d] + smoothed) * per_voxel;
      result[group].begin[d] = std::max(0, static_cast<Index>(std::floor(low)));
      result[group].end[d] = std::min(boxes[d], static_cast<Index>(std::ceil(high)));
    }
  }
  return result;
}

}  // namespace efree
