// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/solvers/cells/internal/grid_fields.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree {
namespace {

/// C_xyxy and C_xxyy.
struct Isotropic {
  double shear, across;
};
/// Those of a tangent by P and F, if it is isotropic.
std::optional<Isotropic> isotropic(const MaterialResponse::Tangent& A) {
  const Isotropic one{A(3, 3), A(0, 4)};
  MaterialResponse::Tangent same = MaterialResponse::Tangent::Zero();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      same(4 * i, 4 * j) += one.across;
      same(i + 3 * j, i + 3 * j) += one.shear;
      same(i + 3 * j, j + 3 * i) += one.shear;
    }
  if (!((A - same).norm() <= 1e-9 * A.norm())) return {};
  return one;
}

/// How many times A is B, if it is a multiple of it.
std::optional<double> factor_between(const MaterialResponse::Tangent& A, const MaterialResponse::Tangent& B) {
  const double factor = (A.array() * B.array()).sum() / A.squaredNorm();
  if (!((B - factor * A).norm() <= 1e-9 * B.norm())) return {};
  return factor;
}

/// At a point of each column.
MaterialResponse tangents(const Material& material, Points<3> X) {
  return respond(material, Deformation::none(std::move(X), material.history_size()), true);
}

}  // namespace

bool is_isotropic(const SharedMaterial& material, const Vec<3>& X) {
  return isotropic(tangents(*material, X).tangent_at(0)).has_value();
}

bool is_multiple(const SharedMaterial& material, const Vec<3>& X, const Vec<3>& Y) {
  return factor_between(tangents(*material, X).tangent_at(0), tangents(*material, Y).tangent_at(0)).has_value();
}

namespace internal {
namespace {

/// What all of a are of b, if it is the same; where b is 0 it does not count.
std::optional<float> common_ratio(const std::vector<float>& a, const std::vector<float>& b) {
  std::optional<float> ratio;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (b[i] == 0.0F) continue;
    if (!ratio) ratio = a[i] / b[i];
    if (std::abs(a[i] - *ratio * b[i]) > 1e-6F * std::abs(a[i])) return {};
  }
  return ratio;
}

/// Centre of the first pixel with that label.
Vec<3> first_place(const LabelImage<3>& image, Label label) {
  auto pixel = static_cast<std::size_t>(std::ranges::find(image.labels, label) - image.labels.begin());
  Vec<3> at;
  for (int d = 0; d < 3; pixel /= image.size[d++]) at[d] = static_cast<double>(pixel % image.size[d]) + 0.5;
  return image.in_world(image.origin + at.cwiseProduct(image.spacing));
}

/// Averages over the layers [begin, end) of boxes, where only those of `range` may have some; empty: none of them has.
std::vector<float> averages_in_layers(const BoxAverages& averages, BoxRange range, const std::array<Index, 3>& boxes,
                                      Index begin, Index end) {
  range.begin[2] = std::max(range.begin[2], begin);
  range.end[2] = std::min(range.end[2], end);
  if (range.begin[2] >= range.end[2]) return {};
  const std::vector<float> some = averages.in(range);
  const BoxRange layers{{0, 0, begin}, {boxes[0], boxes[1], end}};
  std::vector<float> all(layers.size(), 0.0F);
  const Index along = range.end[0] - range.begin[0];
  for (Index k = range.begin[2]; k < range.end[2]; ++k)
    for (Index j = range.begin[1]; j < range.end[1]; ++j)
      std::copy_n(some.begin() + static_cast<std::ptrdiff_t>(range.index({range.begin[0], j, k})), along,
                  all.begin() + static_cast<std::ptrdiff_t>(layers.index({range.begin[0], j, k})));
  return all;
}

/// Calls take(box, response, X) for boxes with a `share`, of layers of them from `layer` on, with what a material does
/// at the places X: of a small box its middle, else points up to two voxels apart.
template <class Take> void at_points_of(const LabelImage<3>& image, const Material& material,
                                        const std::array<Index, 3>& boxes, Index layer, const std::vector<float>& share,
                                        const Take& take) {
  Vec<3> edges;
  std::array<Index, 3> samples;  // along each axis of a box
  for (int d = 0; d < 3; ++d) {
    edges[d] = image.size[d] * image.spacing[d] / boxes[d];
    samples[d] = std::max(1, static_cast<int>(std::ceil(edges[d] / (2.0 * image.spacing[d]) - 1e-9)));
  }
  const Index of_box = samples[0] * samples[1] * samples[2];
  const auto rows = static_cast<Index>(share.size() / boxes[0]);
  parallel_chunks(rows, 16, [&](Index begin, Index end) {
    for (Index row = begin; row < end; ++row) {
      const std::size_t first = static_cast<std::size_t>(row) * boxes[0];
      std::vector<Index> there;
      for (Index i = 0; i < boxes[0]; ++i)
        if (share[first + i] > 0.0F) there.push_back(i);
      if (there.empty()) continue;
      Points<3> X(3, of_box * static_cast<Index>(there.size()));
      Index p = 0;
      for (const Index i : there)
        for (Index s = 0; s < of_box; ++s, ++p) {
          const std::array<Index, 3> box{i, row % boxes[1], layer + row / boxes[1]},
              sample{s % samples[0], s / samples[0] % samples[1], s / samples[0] / samples[1]};
          for (int d = 0; d < 3; ++d) X(d, p) = image.origin[d] + edges[d] * (box[d] + (sample[d] + 0.5) / samples[d]);
          X.col(p) = image.in_world(X.col(p));
        }
      const MaterialResponse response = tangents(material, X);
      for (std::size_t k = 0; k < there.size(); ++k) {
        const Index from = static_cast<Index>(k) * of_box;
        take(first + there[k], response, from, from + of_box, X);
      }
    }
  });
}

/// Adds the stiffness of a material that varies in space to the parts of layers of boxes, from `layer` on; `share` is
/// how much of it there is.
void add_varying(const LabelImage<3>& image, Label label, const Material& material, double unit,
                 const std::array<Index, 3>& boxes, Index layer, const std::vector<float>& share, Parts& parts) {
  at_points_of(image, material, boxes, layer, share,
               [&](std::size_t box, const MaterialResponse& response, Index from, Index to, const Points<3>& X) {
                 Isotropic sum{0.0, 0.0};
                 for (Index p = from; p < to; ++p) {
                   const auto here = isotropic(response.tangent_at(p));
                   if (!here)
                     throw InputError(fmt::format(
                         "on cells materials that differ from place to place by more than a factor are isotropic; that "
                         "of label {} is not at ({:.6g}, {:.6g}, {:.6g})",
                         label, X(0, p), X(1, p), X(2, p)));
                   sum.shear += here->shear;
                   sum.across += here->across;
                 }
                 const double weight = share[box] / ((to - from) * unit);
                 parts.shear[box] += static_cast<float>(weight * sum.shear);
                 parts.across[box] += static_cast<float>(weight * sum.across);
               });
}

/// Multiplies how much of an anisotropic material there is with its factor.
void scale_varying(const LabelImage<3>& image, const AnisotropicLabels& of, const std::array<Index, 3>& boxes,
                   Index layer, std::vector<float>& share) {
  const MaterialResponse there = tangents(*of.varying, of.place);
  at_points_of(image, *of.varying, boxes, layer, share,
               [&](std::size_t box, const MaterialResponse& response, Index from, Index to, const Points<3>& X) {
                 double sum = 0.0;
                 for (Index p = from; p < to; ++p) {
                   const auto factor = factor_between(there.tangent_at(0), response.tangent_at(p));
                   if (!factor)
                     throw InputError(fmt::format(
                         "on cells anisotropic materials differ from place to place by a factor; that of label {} does "
                         "by more at ({:.6g}, {:.6g}, {:.6g})",
                         of.labels.front(), X(0, p), X(1, p), X(2, p)));
                   sum += *factor;
                 }
                 share[box] *= static_cast<float>(sum / (to - from));
               });
}

/// Scales how much of materials is in boxes to what is there of all of them: where more than two meet, the boundaries
/// that each has alone overlap or leave gaps.
void share_out(const std::vector<float>& all, std::vector<std::vector<float>>& shares) {
  std::vector<float> sum(all.size(), 0.0F), factor(all.size()), each(all.size());
  const auto present = std::ranges::count_if(shares, [](const auto& share) { return !share.empty(); });
  for (const std::vector<float>& share : shares)
    if (!share.empty()) for_all(all.size(), [&](std::size_t i) { sum[i] += share[i]; });
  for_all(all.size(), [&](std::size_t i) {
    factor[i] = sum[i] > 0.0F ? all[i] / sum[i] : 0.0F;
    each[i] = sum[i] > 0.0F ? 0.0F : all[i] / static_cast<float>(present);
  });
  for (std::vector<float>& share : shares)
    if (!share.empty()) for_all(all.size(), [&](std::size_t i) { share[i] = factor[i] * share[i] + each[i]; });
}

}  // namespace

std::vector<float> ones_of(const std::vector<Label>& labels) {
  std::vector<float> values(*std::ranges::max_element(labels) + 1, 0.0F);
  for (const Label label : labels) values[label] = 1.0F;
  return values;
}

void add_isotropic_parts(const std::vector<AnisotropicLabels>& materials, Parts& parts) {
  constexpr float rounding = 1e-5F;
  for (std::size_t m = 0; m < materials.size(); ++m) {
    const auto shear = static_cast<float>(materials[m].isotropic.shear),
               across = static_cast<float>(materials[m].isotropic.across);
    std::vector<float>& share = parts.shares[m];
    for_all(share.size(), [&](std::size_t i) {
      if (std::abs(share[i] - 1.0F) < rounding) share[i] = 1.0F;
      parts.shear[i] += share[i] * shear;
      parts.across[i] += share[i] * across;
    });
  }
}

LabelStiffness::LabelStiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials)
    : shear(materials.size(), 0.0F),
      across(shear),
      solid(shear),
      exact_shear(materials.size(), 0.0),
      exact_across(exact_shear) {
  constexpr double locking = 4.67;  // bulk over shear modulus of nu = 0.4
  std::vector<VoigtMatrix<3>> C(materials.size(), VoigtMatrix<3>::Zero());
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    if (count.label >= materials.size())
      throw InputError(fmt::format("the image has the label {}, which has no material", count.label));
    const SharedMaterial& material = materials[count.label];
    const Vec<3> place = first_place(image, count.label);
    const VoigtMatrix<3> there = Materials<3>({material}, Plane::strain).stiffness(0, place).C;
    solid[count.label] = 1.0F;
    const MaterialResponse response = tangents(*material, place);
    if (!isotropic(response.tangent_at(0))) {
      const VoigtMatrix<3> along_image = rotate_to_axes(there, image.axes);
      const auto same = std::ranges::find_if(
          anisotropic, [&](const AnisotropicLabels& of) { return !of.varying && of.C == along_image; });
      if (material->homogeneous() && same != anisotropic.end()) {
        same->labels.push_back(count.label);
        continue;
      }
      const bool nearly_incompressible = incompressibility(response.tangent_at(0)) > locking;
      anisotropic.push_back({{count.label},
                             along_image,
                             isotropic_part(along_image, nearly_incompressible),
                             place,
                             material->homogeneous() ? SharedMaterial{} : material});
      unit = std::max(unit, anisotropic.back().isotropic.shear);
      continue;
    }
    unit = std::max(unit, there(5, 5));
    if (material->homogeneous())
      C[count.label] = there;
    else
      varying.emplace_back(count.label, material);
  }
  if (unit == 0.0) throw InputError("all of the image is void");
  constexpr double least = 1e-9;
  for (std::size_t l = 0; l < C.size(); ++l)
    if (C[l](5, 5) > 0.0 && C[l](5, 5) < least * unit)
      throw InputError(fmt::format(
          "the material of label {} is {:.2g} times as stiff as the stiffest, which is lost in rounding on cells: "
          "expected at least {:g}, or void in its place",
          l, C[l](5, 5) / unit, least));
  for (std::size_t l = 0; l < C.size(); ++l) {
    if (C[l](5, 5) == 0.0) continue;
    exact_shear[l] = C[l](5, 5) / unit;
    exact_across[l] = C[l](0, 1) / unit;
    shear[l] = static_cast<float>(exact_shear[l]);
    across[l] = static_cast<float>(exact_across[l]);
  }
  for (AnisotropicLabels& of : anisotropic) {
    of.C /= unit;
    of.isotropic = {of.isotropic.shear / unit, of.isotropic.across / unit};
  }
}

bool LabelStiffness::varies() const {
  return !varying.empty() ||
         std::ranges::any_of(anisotropic, [](const AnisotropicLabels& of) { return bool(of.varying); });
}

std::vector<VoigtMatrix<3>> LabelStiffness::anisotropy() const {
  std::vector<VoigtMatrix<3>> result;
  for (const AnisotropicLabels& of : anisotropic) result.push_back(of.C - of.isotropic.matrix());
  return result;
}

PartsOfImage::PartsOfImage(const LabelImage<3>& image, const LabelStiffness& stiffness,
                           const std::array<Index, 3>& cells, double grown)
    : image_(image),
      stiffness_(stiffness),
      boxes_{2 * cells[0], 2 * cells[1], 2 * cells[2]},
      shear_(image, stiffness.shear, boxes_, grown),
      ratio_(common_ratio(stiffness.across, stiffness.shear)) {
  if (!ratio_) across_.emplace(image, stiffness.across, boxes_, grown);
  for (const auto& [label, material] : stiffness.varying)
    of_varying_.emplace_back(image, ones_of({label}), boxes_, grown);
  const std::vector<LabelCount> counts = count_labels(image);
  std::vector<Label> anisotropic;
  std::vector<Index> group_of_label(counts.back().label + 1, -1);
  for (std::size_t m = 0; m < stiffness.anisotropic.size(); ++m) {
    const AnisotropicLabels& of = stiffness.anisotropic[m];
    for (const Label label : of.labels) group_of_label[label] = static_cast<Index>(m);
    of_anisotropic_.emplace_back(image, counts, ones_of(of.labels), boxes_, grown);
    anisotropic.insert(anisotropic.end(), of.labels.begin(), of.labels.end());
    exact_.push_back({static_cast<float>(of.isotropic.shear), static_cast<float>(of.isotropic.across)});
  }
  if (!anisotropic.empty())
    boxes_of_anisotropic_ =
        boxes_of_groups(image, group_of_label, static_cast<Index>(stiffness.anisotropic.size()), boxes_);
  if (of_anisotropic_.size() > 1) all_anisotropic_.emplace(image, counts, ones_of(anisotropic), boxes_, grown);
  if (stiffness.varying.empty() && anisotropic.empty())
    solid_over_shear_ = common_ratio(stiffness.solid, stiffness.shear);
  for (std::size_t l = 0; l < stiffness.shear.size(); ++l)
    if (stiffness.shear[l] > 0.0F)
      exact_.push_back({stiffness.shear[l], ratio_ ? *ratio_ * stiffness.shear[l] : stiffness.across[l]});
}

Parts PartsOfImage::layers(Index begin, Index end) const {
  Parts parts{shear_.layers(2 * begin, 2 * end), {}};
  if (across_) {
    parts.across = across_->layers(2 * begin, 2 * end);
  } else {
    parts.across.resize(parts.shear.size());
    for_all(parts.shear.size(), [&](std::size_t i) { parts.across[i] = *ratio_ * parts.shear[i]; });
  }
  for (std::size_t v = 0; v < of_varying_.size(); ++v) {
    const auto& [label, material] = stiffness_.varying[v];
    add_varying(image_, label, *material, stiffness_.unit, boxes_, 2 * begin, of_varying_[v].layers(2 * begin, 2 * end),
                parts);
  }
  if (of_anisotropic_.empty()) return parts;
  std::vector<std::size_t> present;
  for (std::size_t m = 0; m < of_anisotropic_.size(); ++m)
    if (const BoxRange& of = boxes_of_anisotropic_[m]; of.begin[2] < 2 * end && of.end[2] > 2 * begin)
      present.push_back(m);
  parts.shares.resize(of_anisotropic_.size());
  // Many side by side, few layer by layer.
  constexpr std::size_t many = 8;
  const auto average = [&](std::size_t m) {
    parts.shares[m] = averages_in_layers(of_anisotropic_[m], boxes_of_anisotropic_[m], boxes_, 2 * begin, 2 * end);
  };
  if (present.size() < many)
    std::ranges::for_each(present, average);
  else
    parallel_chunks(static_cast<Index>(present.size()), 1, [&](Index p, Index) { average(present[p]); });
  if (all_anisotropic_) share_out(all_anisotropic_->layers(2 * begin, 2 * end), parts.shares);
  for (const std::size_t m : present)
    if (const AnisotropicLabels& of = stiffness_.anisotropic[m]; of.varying)
      scale_varying(image_, of, boxes_, 2 * begin, parts.shares[m]);
  add_isotropic_parts(stiffness_.anisotropic, parts);
  return parts;
}

namespace {

/// What belongs to each part.
std::vector<std::vector<float>*> values_of(Parts& parts) {
  std::vector<std::vector<float>*> values{&parts.shear, &parts.across};
  for (std::vector<float>& share : parts.shares)
    if (!share.empty()) values.push_back(&share);
  return values;
}

/// Spreads a little of the stiffness of cells with up to three parts of material over all of their parts.
void spread(Parts& parts, const std::array<Index, 3>& cells) {
  constexpr float spread = 1.0F / 30.0F, nothing = 0.02F;
  constexpr int few = 3;
  const PartOrder order(cells);
  const auto all_values = values_of(parts);
  parallel_chunks(cells[2], 1, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < cells[1]; ++j)
        for (Index i = 0; i < cells[0]; ++i) {
          const auto part = [&](int q) { return order(i, j, k, q); };
          float most = 0.0F;
          for (int q = 0; q < 8; ++q) most = std::max(most, parts.shear[part(q)]);
          if (most == 0.0F) continue;
          int with_material = 0;
          for (int q = 0; q < 8; ++q) with_material += parts.shear[part(q)] > nothing * most;
          if (with_material > few) continue;
          for (auto* values : all_values) {
            float mean = 0.0F;
            for (int q = 0; q < 8; ++q) mean += 0.125F * (*values)[part(q)];
            for (int q = 0; q < 8; ++q) (*values)[part(q)] += spread * (mean - (*values)[part(q)]);
          }
        }
  });
}

/// What stabilised says, of parts of so many cells.
Parts stabilise(Parts parts, const std::array<Index, 3>& cells) {
  spread(parts, cells);
  const auto all_values = values_of(parts);
  constexpr float moved = 1.0F / 30.0F, nothing = 0.02F;
  const std::array<std::size_t, 3> size{2 * static_cast<std::size_t>(cells[0]), 2 * static_cast<std::size_t>(cells[1]),
                                        2 * static_cast<std::size_t>(cells[2])},
      stride{1, size[0], size[0] * size[1]};
  for (int axis = 0; axis < 3; ++axis) {
    const int first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
    // Lines of parts along the axis. Neighbours are read; only parts of the same cell are written.
    parallel_chunks(static_cast<Index>(size[second]), 4, [&](Index begin, Index end) {
      for (Index b = begin; b < end; ++b)
        for (std::size_t a = 0; a < size[first]; ++a) {
          const std::size_t line = a * stride[first] + static_cast<std::size_t>(b) * stride[second];
          float before = 0.0F;  // the part before the cell, as it was
          for (std::size_t k = 0; k < size[axis]; k += 2) {
            const std::size_t low = line + k * stride[axis], high = low + stride[axis];
            const float after = k + 2 < size[axis] ? parts.shear[high + stride[axis]] : 0.0F, of_low = parts.shear[low],
                        of_high = parts.shear[high];
            const auto move = [&](std::size_t from, std::size_t to) {
              for (auto* values : all_values) {
                const float part = moved * (*values)[from];
                (*values)[from] -= part;
                (*values)[to] += part;
              }
            };
            if (of_high <= nothing * of_low && before <= nothing * of_low && of_low > 0.0F)
              move(low, high);
            else if (of_low <= nothing * of_high && after <= nothing * of_high && of_high > 0.0F)
              move(high, low);
            before = of_high;
          }
        }
    });
  }
  return parts;
}

}  // namespace

PartLayers stabilised(PartLayers layers, const std::array<Index, 3>& cells) {
  return [layers = std::move(layers), cells](Index begin, Index end) {
    // With the layers beside them, at which it looks.
    const Index first = std::max(begin - 1, 0), last = std::min(end + 1, cells[2]);
    const std::array<Index, 3> slab{cells[0], cells[1], last - first};
    return layers_of(stabilise(layers(first, last), slab), slab)(begin - first, end - first);
  };
}

}  // namespace internal
}  // namespace efree
