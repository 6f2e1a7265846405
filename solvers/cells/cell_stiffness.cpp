// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/box_averages.hpp"
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
  if (!((A - same).norm() < 1e-9 * A.norm())) return {};
  return one;
}

/// At a point of each column.
MaterialResponse tangents(const Material& material, Points<3> X) {
  return respond(material, Deformation::none(std::move(X), material.history_size()), true);
}

}  // namespace

bool is_isotropic(const SharedMaterial& material, const Vec<3>& X) {
  return isotropic(tangents(*material, X).tangent_at(0)).has_value();
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

/// Adds what a material that differs from place to place has in each part.
void add_varying(const LabelImage<3>& image, Label label, const Material& material, double unit,
                 const std::array<Index, 3>& boxes, double grown, Parts& parts) {
  std::vector<float> one(label + 1, 0.0F);
  one[label] = 1.0F;
  const std::vector<float> share = box_averages(image, one, boxes, grown);
  Vec<3> edges;
  std::array<Index, 3> samples;  // along each axis of a part
  for (int d = 0; d < 3; ++d) {
    edges[d] = image.size[d] * image.spacing[d] / boxes[d];
    samples[d] = std::max(1, static_cast<int>(std::ceil(edges[d] / (2.0 * image.spacing[d]) - 1e-9)));
  }
  const Index of_part = samples[0] * samples[1] * samples[2];
  parallel_chunks(boxes[1] * boxes[2], 16, [&](Index begin, Index end) {
    for (Index row = begin; row < end; ++row) {
      const std::size_t first = static_cast<std::size_t>(row) * boxes[0];
      std::vector<Index> there;
      for (Index i = 0; i < boxes[0]; ++i)
        if (share[first + i] > 0.0F) there.push_back(i);
      if (there.empty()) continue;
      Points<3> X(3, of_part * static_cast<Index>(there.size()));
      Index p = 0;
      for (const Index i : there)
        for (Index s = 0; s < of_part; ++s, ++p) {
          const std::array<Index, 3> part{i, row % boxes[1], row / boxes[1]},
              sample{s % samples[0], s / samples[0] % samples[1], s / samples[0] / samples[1]};
          for (int d = 0; d < 3; ++d) X(d, p) = image.origin[d] + edges[d] * (part[d] + (sample[d] + 0.5) / samples[d]);
          X.col(p) = image.in_world(X.col(p));
        }
      const MaterialResponse response = tangents(material, X);
      for (std::size_t k = 0; k < there.size(); ++k) {
        Isotropic sum{0.0, 0.0};
        for (Index s = 0; s < of_part; ++s) {
          p = static_cast<Index>(k) * of_part + s;
          const auto here = isotropic(response.tangent_at(p));
          if (!here)
            throw InputError(
                fmt::format("on cells materials are isotropic; that of label {} is not at ({:.6g}, {:.6g}, {:.6g})",
                            label, X(0, p), X(1, p), X(2, p)));
          sum.shear += here->shear;
          sum.across += here->across;
        }
        const std::size_t at = first + there[k];
        const double weight = share[at] / (of_part * unit);
        parts.shear[at] += static_cast<float>(weight * sum.shear);
        parts.across[at] += static_cast<float>(weight * sum.across);
      }
    }
  });
}

}  // namespace

LabelStiffness::LabelStiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials)
    : shear(materials.size(), 0.0F),
      across(shear),
      solid(shear),
      exact_shear(materials.size(), 0.0),
      exact_across(exact_shear) {
  std::vector<VoigtMatrix<3>> C(materials.size(), VoigtMatrix<3>::Zero());
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    if (count.label >= materials.size())
      throw InputError(fmt::format("the image has the label {}, which has no material", count.label));
    const SharedMaterial& material = materials[count.label];
    const Vec<3> place = first_place(image, count.label);
    if (!is_isotropic(material, place))
      throw InputError(fmt::format("on cells materials are isotropic; that of label {} is not", count.label));
    const VoigtMatrix<3> there = Materials<3>({material}, Plane::strain).stiffness(0, place).C;
    solid[count.label] = 1.0F;
    unit = std::max(unit, there(5, 5));
    if (material->homogeneous())
      C[count.label] = there;
    else
      varying.emplace_back(count.label, material);
  }
  if (unit == 0.0) throw InputError("all of the image is void");
  for (std::size_t l = 0; l < C.size(); ++l) {
    if (C[l](5, 5) == 0.0) continue;
    exact_shear[l] = C[l](5, 5) / unit;
    exact_across[l] = C[l](0, 1) / unit;
    shear[l] = static_cast<float>(exact_shear[l]);
    across[l] = static_cast<float>(exact_across[l]);
    const auto ratio = static_cast<float>(C[l](0, 1) / C[l](5, 5));
    least_ratio = std::min(least_ratio, ratio);
    most_ratio = std::max(most_ratio, ratio);
  }
}

void LabelStiffness::widen_ratios(const Parts& parts) {
  for (std::size_t i = 0; i < parts.shear.size(); ++i) {
    if (!(parts.shear[i] > 0.0F)) continue;
    const float ratio = parts.across[i] / parts.shear[i];
    least_ratio = std::min(least_ratio, ratio);
    most_ratio = std::max(most_ratio, ratio);
  }
}

Parts parts_of(const LabelImage<3>& image, const LabelStiffness& stiffness, const std::array<Index, 3>& cells,
               double grown) {
  const std::array<Index, 3> boxes{2 * cells[0], 2 * cells[1], 2 * cells[2]};
  Parts parts{box_averages(image, stiffness.shear, boxes, grown), {}};
  if (const auto ratio = common_ratio(stiffness.across, stiffness.shear)) {
    parts.across.resize(parts.shear.size());
    for_all(parts.shear.size(), [&](std::size_t i) { parts.across[i] = *ratio * parts.shear[i]; });
  } else {
    parts.across = box_averages(image, stiffness.across, boxes, grown);
  }
  for (const auto& [label, material] : stiffness.varying)
    add_varying(image, label, *material, stiffness.unit, boxes, grown, parts);
  return parts;
}

}  // namespace internal
}  // namespace efree
