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
  /// Means of values `from`, `stride` apart, over a box.
  float mean(Index box, const float* from, std::size_t stride) const {
    float sum = 0.0F;
    for (std::size_t s = begin[box]; s < begin[box + 1]; ++s) sum += shares[s].share * from[stride * shares[s].voxel];
    return sum;
  }
};

/// The image as materials whose boundaries are planes within a voxel, layer by layer.
class VoxelFractions {
 public:
  /// Of voxels cut into parts^3 equal parts, 1 or 2.
  VoxelFractions(const LabelImage<3>& image, const std::vector<float>& value_of_label, int parts, double grown)
      : image_(image), parts_(parts), grown_(static_cast<float>(grown) * static_cast<float>(parts)) {
    for (int d = 0; d < 3; ++d) size[d] = parts * image.size[d];
    for (int p = 0; p <= 2 * parts; ++p) {
      const float t = 0.5F * static_cast<float>(p) / static_cast<float>(parts) - 0.5F;
      weights_.push_back({0.5F * t * (t - 1.0F), 1.0F - t * t, 0.5F * t * (t + 1.0F)});
    }
    for (const Label label : image.labels)
      if (label >= kind_.size()) kind_.resize(label + 1, unknown);
    values_.push_back(value_of_label.empty() ? 0.0F : value_of_label[0]);
    if (!kind_.empty()) kind_[0] = 0;
    for (const Label label : image.labels) {
      if (kind_[label] != unknown) continue;
      const float value = label < value_of_label.size() ? value_of_label[label] : 0.0F;
      const auto same = std::find(values_.begin() + 1, values_.end(), value);
      kind_[label] = static_cast<std::uint16_t>(same - values_.begin());
      if (same == values_.end()) values_.push_back(value);
    }
    if (!image.grey.empty())
      for (std::size_t label = 1; label < kind_.size(); ++label)
        if (kind_[label] != unknown) material_ = std::max(material_, values_[kind_[label]]);
  }
  int parts() const { return parts_; }
  std::array<Index, 3> size;  ///< parts along the axes

  /// Mean values in the parts of the voxels of a layer: `parts` layers one after the other. Fast for one layer after
  /// the next.
  const std::vector<float>& layer(Index k) {
    const Index nx = image_.size[0], ny = image_.size[1];
    std::array<const Smooth*, 3> smooth;
    for (int dz = -1; dz <= 1; ++dz) smooth[dz + 1] = &smoothed(std::clamp(k + dz, 0, image_.size[2] - 1));
    result_.resize(static_cast<std::size_t>(parts_) * size[0] * size[1]);
    std::vector<float> values(static_cast<std::size_t>(parts_) * parts_ * parts_);
    for (Index j = 0; j < ny; ++j)
      for (Index i = 0; i < nx; ++i) {
        const std::uint16_t kind = kind_[image_.at({i, j, k})];
        // Walls, slits and specks a voxel thick, which smoothing would take away, stay as they are.
        const int own = smooth[1]->of_kind[kind][i + static_cast<std::size_t>(nx) * j];
        const bool thin = image_.grey.empty() && own <= whole / 2 && is_thin({i, j, k});
        if (own == whole || thin)
          std::ranges::fill(
              values, thin && kind > 0 ? std::clamp(1.0F + 2.0F * grown_, 0.0F, 1.0F) * values_[kind] : values_[kind]);
        else
          split({i, j, k}, smooth, values);
        for (int p = 0; p < static_cast<int>(values.size()); ++p)
          result_[parts_ * i + p % parts_ +
                  static_cast<std::size_t>(size[0]) *
                      (parts_ * j + p / parts_ % parts_ + static_cast<std::size_t>(size[1]) * (p / parts_ / parts_))] =
              values[p];
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

  const Smooth& smoothed(Index k) {
    Smooth& out = smooth_[k % 3];
    if (out.layer == k) return out;
    out.layer = k;
    out.of_kind.resize(values_.size());
    const Index nx = image_.size[0], ny = image_.size[1];
    const std::size_t plane = static_cast<std::size_t>(nx) * ny;
    const Label* layers[3];
    for (int dz = -1; dz <= 1; ++dz)
      layers[dz + 1] = image_.labels.data() + plane * std::clamp(k + dz, 0, image_.size[2] - 1);
    // Along z, along y, along x; the frame repeats its outermost voxels.
    Plane columns(plane), rows(plane);
    for (std::size_t kind = 0; kind < values_.size(); ++kind) {
      for (std::size_t i = 0; i < plane; ++i)
        columns[i] = static_cast<std::uint8_t>((kind_[layers[0][i]] == kind) + 2 * (kind_[layers[1][i]] == kind) +
                                               (kind_[layers[2][i]] == kind));
      for (Index j = 0; j < ny; ++j) {
        const std::uint8_t *before = columns.data() + static_cast<std::size_t>(nx) * std::max(j - 1, 0),
                           *here = columns.data() + static_cast<std::size_t>(nx) * j,
                           *after = columns.data() + static_cast<std::size_t>(nx) * std::min(j + 1, ny - 1);
        std::uint8_t* to = rows.data() + static_cast<std::size_t>(nx) * j;
        for (Index i = 0; i < nx; ++i) to[i] = static_cast<std::uint8_t>(before[i] + 2 * here[i] + after[i]);
      }
      Plane& result = out.of_kind[kind];
      result.resize(plane);
      for (Index j = 0; j < ny; ++j) {
        const std::uint8_t* from = rows.data() + static_cast<std::size_t>(nx) * j;
        std::uint8_t* to = result.data() + static_cast<std::size_t>(nx) * j;
        for (Index i = 1; i + 1 < nx; ++i) to[i] = static_cast<std::uint8_t>(from[i - 1] + 2 * from[i] + from[i + 1]);
        to[0] = static_cast<std::uint8_t>(3 * from[0] + from[std::min(1, nx - 1)]);
        to[nx - 1] = static_cast<std::uint8_t>(3 * from[nx - 1] + from[std::max(nx - 2, 0)]);
      }
    }
    return out;
  }

  /// Adds by part how much of it lies where the stencil's field, quadratic along each axis, is positive, if a plane
  /// bounds it: to `sums` times `value`, to `all` as it is.
  void add_fractions(const Stencil& stencil, float grown, float value, std::array<float, 8>& sums,
                     std::array<float, 8>& all) const {
    // At the parts' faces and middles: along x, along y, along z.
    const int m = 2 * parts_ + 1;
    std::array<float, 45> along_x;
    std::array<float, 75> along_xy;
    std::array<float, 125> at;
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
    int part = 0;
    for (int z = 0; z < parts_; ++z)
      for (int y = 0; y < parts_; ++y)
        for (int x = 0; x < parts_; ++x, ++part) {
          const float* middle = &at[((2 * z + 1) * m + 2 * y + 1) * m + 2 * x + 1];
          float mean = *middle, change = 0.0F,
                squares = 0.0F;  // Simpson's mean: where boundaries are curved, so is the field
          for (const int step : {1, m, m * m}) {
            mean += (middle[step] + middle[-step] - 2.0F * *middle) / 6.0F;
            const float across = middle[step] - middle[-step];
            change += std::abs(across);
            squares += across * across;
          }
          mean += grown * std::sqrt(squares);
          const float fraction = change > 0.0F ? std::clamp(0.5F + mean / change, 0.0F, 1.0F)
                                 : mean > 0.0F ? 1.0F
                                               : 0.0F;
          sums[part] += fraction * value;
          all[part] += fraction;
        }
  }

  void split(const std::array<Index, 3>& voxel, const std::array<const Smooth*, 3>& smooth,
             std::vector<float>& values) const {
    std::array<std::size_t, 9> around;  // in a layer
    for (int n = 0; n < 9; ++n)
      around[n] = std::clamp(voxel[0] + n % 3 - 1, 0, image_.size[0] - 1) +
                  static_cast<std::size_t>(image_.size[0]) * std::clamp(voxel[1] + n / 3 - 1, 0, image_.size[1] - 1);
    const std::size_t plane = static_cast<std::size_t>(image_.size[0]) * image_.size[1];
    std::array<float, 8> sums{}, all{};
    Stencil stencil;
    if (!image_.grey.empty()) {
      for (int n = 0; n < 27; ++n)
        stencil[n] = image_.grey[around[n % 9] + plane * std::clamp(voxel[2] + n / 9 - 1, 0, image_.size[2] - 1)];
      // Far from boundaries some fields have the largest number there is.
      float largest = 0.0F;
      for (const float value : stencil) largest = std::max(largest, std::abs(value));
      for (float& value : stencil) value /= largest;
      add_fractions(stencil, grown_, material_, sums, all);
      all.fill(1.0F);
    } else {
      for (std::size_t kind = 0; kind < values_.size(); ++kind) {
        if (smooth[1]->of_kind[kind][around[4]] == 0) continue;
        for (int n = 0; n < 27; ++n)
          stencil[n] = static_cast<float>(smooth[n / 9]->of_kind[kind][around[n % 9]]) / whole - 0.5F;
        add_fractions(stencil, kind == 0 ? -grown_ : grown_, values_[kind], sums, all);
      }
    }
    for (std::size_t p = 0; p < values.size(); ++p)
      values[p] = all[p] > 0.0F ? sums[p] / all[p] : values_[kind_[image_.at(voxel)]];
  }

  const LabelImage<3>& image_;
  int parts_;
  float grown_;                                ///< by how much void recedes [parts]
  std::vector<std::uint16_t> kind_;            ///< by label: labels of the same value are of one kind
  std::vector<float> values_;                  ///< by kind: void, then labels by their values
  float material_ = 0.0F;                      ///< value of what is not void, with grey values
  std::vector<std::array<float, 3>> weights_;  ///< of quadratics through -1, 0, 1, by face or middle of a part
  std::array<Smooth, 3> smooth_;
  std::vector<float> result_;
};

void require_boxes(const std::array<Index, 3>& boxes) {
  if (*std::ranges::min_element(boxes) < 1) throw InputError("a grid of boxes needs at least one along each axis");
}

VoxelFractions voxel_fractions(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                               const std::array<Index, 3>& boxes, double grown) {
  bool smaller = false;
  for (int d = 0; d < 3; ++d) smaller = smaller || boxes[d] > image.size[d];
  return {image, value_of_label, smaller ? 2 : 1, grown};
}

}  // namespace

std::vector<float> box_averages(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                                const std::array<Index, 3>& boxes, double grown) {
  check_image(image);
  require_boxes(boxes);
  const VoxelFractions of_image = voxel_fractions(image, value_of_label, boxes, grown);
  const auto& n = of_image.size;
  const Overlaps x(n[0], boxes[0]), y(n[1], boxes[1]), z(n[2], boxes[2]);
  const auto along = static_cast<std::size_t>(boxes[0]), plane = along * boxes[1];
  std::vector<float> means(plane * boxes[2]);
  parallel_chunks(boxes[2], 16, [&](Index begin, Index end) {
    VoxelFractions voxels = of_image;
    std::vector<float> lines(along * n[1]);
    const std::vector<float>* layer = nullptr;
    Index there = -1;
    for (Index k = begin; k < end; ++k)
      for (std::size_t s = z.begin[k]; s < z.begin[k + 1]; ++s) {
        const Index part = z.shares[s].voxel;
        if (part / voxels.parts() != there) layer = &voxels.layer(there = part / voxels.parts());
        const float* from = layer->data() + static_cast<std::size_t>(n[0]) * n[1] * (part % voxels.parts());
        for (Index j = 0; j < n[1]; ++j)
          for (Index i = 0; i < boxes[0]; ++i)
            lines[i + along * j] = x.mean(i, from + static_cast<std::size_t>(n[0]) * j, 1);
        float* out = means.data() + plane * k;
        for (Index j = 0; j < boxes[1]; ++j)
          for (Index i = 0; i < boxes[0]; ++i)
            out[i + along * j] += z.shares[s].share * y.mean(j, lines.data() + i, along);
      }
  });
  return means;
}

std::vector<float> side_averages(const LabelImage<3>& image, const std::vector<float>& value_of_label,
                                 const std::array<Index, 3>& boxes, int axis, bool upper) {
  check_image(image);
  require_boxes(boxes);
  // The side as an image of its own, one voxel deep.
  LabelImage<3> side{.size = image.size, .spacing = image.spacing, .origin = image.origin};
  side.size[axis] = 1;
  std::array<Index, 3> at{};
  for (at[2] = 0; at[2] < side.size[2]; ++at[2])
    for (at[1] = 0; at[1] < side.size[1]; ++at[1])
      for (at[0] = 0; at[0] < side.size[0]; ++at[0]) {
        std::array<Index, 3> from = at;
        if (upper) from[axis] = image.size[axis] - 1;
        side.labels.push_back(image.at(from));
        if (!image.grey.empty()) side.grey.push_back(image.grey[image.index(from)]);
      }
  std::array<Index, 3> flat = boxes;
  flat[axis] = 1;
  return box_averages(side, value_of_label, flat);
}

}  // namespace efree
