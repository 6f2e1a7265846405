// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/effective.hpp"

#include "efree/analysis/internal/closed_gaps.hpp"
#include "efree/analysis/internal/effective_interpretation.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <utility>

namespace efree {
namespace {

using internal::EffectivePhase, internal::said_at;

/// What each label is made of: materials, or conductivities.
struct Phases {
  std::vector<SharedMaterial> materials;
  std::vector<double> conductivities;
};

/// An entry for the region of each label; `entries` with a region that is not in the image are rejected.
template <class Entry, class F> void for_regions(const MadeImage<3>& image, const std::vector<Entry>& entries,
                                                 const std::string& kind, const std::string& where, const F& take) {
  for (const auto& [label, name] : image.region_of_label) {
    const auto found = std::ranges::find(entries, name, &Entry::region);
    if (found == entries.end())
      throw InputError(said_at(where, fmt::format("no {} for the region \"{}\" of the image", kind, name)));
    take(label, *found);
  }
  for (const Entry& entry : entries) {
    const auto is_it = [&](const auto& region) { return region.second == entry.region; };
    if (std::ranges::any_of(image.region_of_label, is_it)) continue;
    std::vector<std::string> names;
    for (const auto& region : image.region_of_label) names.push_back(region.second);
    throw InputError(said_at(entry.where, fmt::format("there is no region \"{}\" in the image, which has {}",
                                                      entry.region, fmt::join(names, ", "))));
  }
}

Phases phases_of(const EffectiveSettings<3>& settings, const MadeImage<3>& image) {
  Phases phases;
  const std::size_t labels = image.region_of_label.empty() ? 1 : image.region_of_label.rbegin()->first + 1;
  if (settings.property == EffectiveProperty::stiffness) {
    phases.materials.resize(labels);
    if (settings.common.materials.empty())
      for (const auto& region : image.region_of_label) phases.materials[region.first] = settings.common.model.material;
    else
      for_regions(image, settings.common.materials, "[[material]]", settings.common.materials.back().where,
                  [&](Label label, const RegionMaterial& one) { phases.materials[label] = one.material; });
    return phases;
  }
  phases.conductivities.assign(labels, 0.0);
  const auto& said = settings.conductivities;
  if (said.empty()) throw InputError(said_at(settings.common.where, "no conductivity is given"));
  if (said.size() == 1 && said.front().region.empty())
    for (const auto& region : image.region_of_label) phases.conductivities[region.first] = said.front().value;
  else
    for_regions(image, said, "conductivity", said.back().where,
                [&](Label label, const RegionConductivity& one) { phases.conductivities[label] = one.value; });
  return phases;
}

EffectiveTensor solve(const EffectiveSettings<3>& settings, const LabelImage<3>& image, const Phases& phases,
                      FrameCondition frame, double size, const Monitor& monitor) {
  const EffectiveOptions options{.frame = frame, .size = size, .smooth = settings.smooth};
  return settings.property == EffectiveProperty::stiffness
             ? effective_stiffness(image, phases.materials, options, monitor)
             : effective_conductivity(image, phases.conductivities, options, monitor);
}

/// Fractions by label, void included.
std::map<Label, double> fractions_of(const LabelImage<3>& image) {
  std::map<Label, double> fractions;
  for (const LabelCount& count : count_labels(image))
    fractions[count.label] = static_cast<double>(count.pixels) / static_cast<double>(image.labels.size());
  return fractions;
}

LabelImage<3> part_of(const LabelImage<3>& image, const std::array<Index, 3>& size, const std::array<Index, 3>& at) {
  LabelImage<3> part;
  part.size = size;
  part.spacing = image.spacing;
  for (int d = 0; d < 3; ++d) part.origin[d] = image.origin[d] + at[d] * size[d] * image.spacing[d];
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i) {
        const std::size_t from = image.index({at[0] * size[0] + i, at[1] * size[1] + j, at[2] * size[2] + k});
        part.labels.push_back(image.labels[from]);
        if (!image.grey.empty()) part.grey.push_back(image.grey[from]);
      }
  return part;
}

/// Whether nothing in a part carries or conducts.
bool is_empty_part(const LabelImage<3>& part, const Phases& phases) {
  return std::ranges::none_of(part.labels, [&](Label label) {
    return label != 0 && (phases.conductivities.empty() || phases.conductivities[label] > 0.0);
  });
}

SubvolumeStatistics statistics_of_subvolumes(const EffectiveSettings<3>& settings, const LabelImage<3>& image,
                                             const Phases& phases, const EffectiveTensor& of_whole,
                                             const Monitor& monitor) {
  const Index n = settings.subvolumes;
  const Matrix& whole = of_whole.tensor;
  const double cell = of_whole.finest().edges.minCoeff();
  std::array<Index, 3> size;
  for (int d = 0; d < 3; ++d) size[d] = image.size[d] / n;
  const FrameCondition frame =
      settings.frame == FrameCondition::periodic ? FrameCondition::periodic : FrameCondition::kinematic;
  const Stage stage("subvolumes", monitor);
  SubvolumeStatistics result{.count = n * n * n};
  std::vector<Matrix> tensors;
  for (Index p = 0; p < result.count; ++p) {
    const LabelImage<3> part = part_of(image, size, {p % n, p / n % n, p / n / n});
    tensors.push_back(is_empty_part(part, phases) ? Matrix(Matrix::Zero(whole.rows(), whole.cols()))
                                                  : solve(settings, part, phases, frame, cell, stage.within()).tensor);
    stage.tick(static_cast<double>(p + 1) / result.count);
  }
  result.mean = result.deviation = Matrix::Zero(whole.rows(), whole.cols());
  for (const Matrix& one : tensors) result.mean += one / result.count;
  for (const Matrix& one : tensors) result.deviation += (one - result.mean).cwiseAbs2() / (result.count - 1.0);
  result.deviation = result.deviation.cwiseSqrt().eval();
  const auto size_of = [&](const Matrix& tensor) { return internal::size_of(tensor, settings.property); };
  if (const double norm = size_of(result.mean); norm > 0.0) result.spread = size_of(result.deviation) / norm;
  result.bias = size_of(result.mean - whole) / size_of(whole);
  result.expected_spread = result.spread / std::sqrt(static_cast<double>(result.count));
  return result;
}

}  // namespace

EffectiveResult find_effective(const EffectiveSettings<3>& settings, const MadeImage<3>& image,
                               const Monitor& monitor_of_run) {
  EffectiveResult result;
  const Monitor monitor = monitor_of_run.timing(result.times);
  check_image(image.image);
  const Phases phases = phases_of(settings, image);
  if (settings.subvolumes > 1)
    for (int d = 0; d < 3; ++d)
      if (image.image.size[d] % settings.subvolumes != 0)
        throw InputError(said_at(settings.common.said.contains("effective.subvolumes")
                                     ? settings.common.said.at("effective.subvolumes")
                                     : "",
                                 fmt::format("subvolumes is {}, which does not divide the {} voxels along {}",
                                             settings.subvolumes, image.image.size[d], "xyz"[d])));
  std::vector<EffectivePhase> shares;
  for (const auto& [label, fraction] : fractions_of(image.image)) {
    shares.push_back({label == 0 ? "void" : image.region_of_label.at(label), fraction});
    if (label == 0) continue;
    if (settings.property == EffectiveProperty::stiffness)
      shares.back().material = phases.materials[label];
    else
      shares.back().conductivity = phases.conductivities[label];
  }
  for (const EffectivePhase& share : shares) result.fractions.push_back({share.region, share.fraction});
  result.tensor = solve(settings, image.image, phases, settings.frame, settings.size, monitor);
  internal::interpret(settings.property, result);
  internal::find_bounds(settings.property, Plane::strain, shares, result);
  if (settings.subvolumes > 1)
    result.subvolumes = statistics_of_subvolumes(settings, image.image, phases, result.tensor, monitor);
  if ((result.tensor.finest().edges - image.image.spacing).maxCoeff() > 1e-9 * image.image.spacing.maxCoeff())
    result.warnings.emplace_back(
        "the error of the grid may be larger than reported: cells hold several voxels, and boundaries between labels "
        "cut them");
  std::array<Index, 3> cells;
  for (int d = 0; d < 3; ++d)
    cells[d] =
        static_cast<Index>(std::lround(image.image.size[d] * image.image.spacing[d] / result.tensor.finest().edges[d]));
  if (std::string gaps = internal::closed_gaps(image.image, cells); !gaps.empty())
    result.warnings.push_back(std::move(gaps));
  result.warnings.insert(result.warnings.end(), image.warnings.begin(), image.warnings.end());
  if (image.image.is_turned())
    result.warnings.emplace_back("the image is turned: the tensor is in its own axes, not in those of the world");
  if (result.tensor.grid_error > 0.05)
    result.warnings.push_back(
        fmt::format("the tensor may be {:.0f} % off: cells are too large for what the image shows",
                    100.0 * result.tensor.grid_error));
  return result;
}

}  // namespace efree
