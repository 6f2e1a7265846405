// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/image_boundary.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/select_facets.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <string_view>

namespace efree {
namespace {

using Voxel = std::array<Index, 3>;
constexpr std::array<std::string_view, 7> names_of_parts{"left", "right", "front", "back", "bottom", "top", "pores"};

Voxel voxel_at(const LabelImage<3>& image, std::size_t index) {
  const auto nx = static_cast<std::size_t>(image.size[0]), ny = static_cast<std::size_t>(image.size[1]);
  return {static_cast<Index>(index % nx), static_cast<Index>(index / nx % ny), static_cast<Index>(index / nx / ny)};
}
bool is_material(const LabelImage<3>& image, const Voxel& at) {
  for (int d = 0; d < 3; ++d)
    if (at[d] < 0 || at[d] >= image.size[d]) return false;
  return image.at(at) != 0;
}
VoxelFacet facet_of(const LabelImage<3>& image, const Voxel& at, int side) {
  return {6 * image.index(at) + static_cast<std::size_t>(side)};
}

/// Weights of voxels around a facet for the gradient at its middle: `reach` layers on either side, in each
/// 2 wide + 1 voxels square. Linear functions have their own, whatever is cut off.
struct GradientStencil {
  static constexpr int reach = 3, wide = 2;
  static constexpr double sigma = 1.2;  // [voxels]
  std::array<double, 2 * reach> across{}, arm_across{};
  std::array<double, 2 * wide + 1> along{}, arm_along{};

  GradientStencil() {
    const auto fill = [](auto& weights, auto& arms, double first) {
      double sum = 0.0, moment = 0.0;
      for (std::size_t k = 0; k < weights.size(); ++k) {
        arms[k] = first + static_cast<double>(k);
        weights[k] = std::exp(-0.5 * arms[k] * arms[k] / (sigma * sigma));
        sum += weights[k];
        moment += weights[k] * arms[k] * arms[k];
      }
      for (double& arm : arms) arm *= sum / moment;
    };
    fill(across, arm_across, 0.5 - reach);
    fill(along, arm_along, -wide);
  }
};

/// The facets as a boundary for FacetSelector, in the world.
class VoxelBoundary {
 public:
  VoxelBoundary(const LabelImage<3>& image, const std::vector<VoxelFacet>& facets) : image_(image), facets_(facets) {}

  Index size() const { return static_cast<Index>(facets_.size()); }
  bool can_be_selected(Index) const { return true; }
  template <class Predicate> bool all_corners(Index f, const Predicate& wanted) const {
    const Vec<3> low = corner(f);
    const int axis = facets_[f].axis(), first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
    for (int c = 0; c < 4; ++c) {
      Vec<3> x = low;
      x[first] += c & 1;
      x[second] += c >> 1;
      if (!wanted(image_.in_world(image_.origin + x.cwiseProduct(image_.spacing)))) return false;
    }
    return true;
  }
  Vec<3> normal(Index f) const { return image_.axes * smooth_normal(image_, facets_[f]); }
  double squared_distance(Index f, const Vec<3>& x) const {
    const Vec<3> local = image_.axes.transpose() * (x - image_.origin);
    Vec<3> low = corner(f), high = low + Vec<3>::Ones();
    high[facets_[f].axis()] -= 1.0;
    const Vec<3> nearest = local.cwiseMax(low.cwiseProduct(image_.spacing)).cwiseMin(high.cwiseProduct(image_.spacing));
    return (local - nearest).squaredNorm();
  }
  /// At a right angle smoothed normals turn by steps: there those count that are one voxel farther from the edge, on
  /// either side. So it is one where both faces are flat, and less where they are steps of a curved wall.
  template <class Visit> void visit_neighbours(Index f, const Visit& visit) const {
    const VoxelFacet facet = facets_[f];
    for (int side = 0; side < 6; ++side) {
      if (side / 2 == facet.axis()) continue;
      const VoxelFacet next = over_edge(facet, side);
      visit(static_cast<Index>(std::ranges::lower_bound(facets_, next) - facets_.begin()), [&] {
        if (next.axis() == facet.axis()) return turn(facet, next);
        const int onwards = next.side() == side ? facet.side() ^ 1 : facet.side();
        return std::min(turn(over_edge(facet, side ^ 1), next), turn(facet, over_edge(next, onwards)));
      });
    }
  }
  double diagonal() const {
    return image_.spacing.cwiseProduct(Vec<3>(image_.size[0], image_.size[1], image_.size[2])).norm();
  }

 private:
  /// The facet of the same body over the edge of a facet towards a side: bodies that touch along an edge only are
  /// apart.
  VoxelFacet over_edge(const VoxelFacet& facet, int side) const {
    const Voxel at = voxel_at(image_, facet.voxel());
    Voxel beside = at;
    beside[side / 2] += side % 2 == 1 ? 1 : -1;
    if (!is_material(image_, beside)) return facet_of(image_, at, side);
    Voxel above = beside;
    above[facet.axis()] += facet.sign() > 0.0 ? 1 : -1;
    return is_material(image_, above) ? facet_of(image_, above, side ^ 1) : facet_of(image_, beside, facet.side());
  }
  double turn(const VoxelFacet& one, const VoxelFacet& other) const {
    return smooth_normal(image_, one).dot(smooth_normal(image_, other));
  }
  /// The lowest corner of a facet [voxels].
  Vec<3> corner(Index f) const {
    const Voxel at = voxel_at(image_, facets_[f].voxel());
    Vec<3> low(at[0], at[1], at[2]);
    if (facets_[f].sign() > 0.0) low[facets_[f].axis()] += 1.0;
    return low;
  }

  const LabelImage<3>& image_;
  const std::vector<VoxelFacet>& facets_;
};

}  // namespace

const std::vector<VoxelFacet>& ImageBoundary::facets() const {
  if (facets_) return *facets_;
  std::vector<std::vector<VoxelFacet>> layers(image_.size[2]);
  parallel_chunks(image_.size[2], 1, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < image_.size[1]; ++j)
        for (Index i = 0; i < image_.size[0]; ++i) {
          if (image_.at({i, j, k}) == 0) continue;
          for (int side = 0; side < 6; ++side) {
            Voxel beyond{i, j, k};
            beyond[side / 2] += side % 2 == 1 ? 1 : -1;
            if (!is_material(image_, beyond)) layers[k].push_back(facet_of(image_, {i, j, k}, side));
          }
        }
  });
  facets_.emplace();
  for (const auto& layer : layers) facets_->insert(facets_->end(), layer.begin(), layer.end());
  return *facets_;
}

std::vector<VoxelFacet> ImageBoundary::named(const std::string& name) const {
  const auto found = std::ranges::find(names_of_parts, name);
  if (found == names_of_parts.end())
    throw InputError(
        fmt::format("there is no boundary \"{}\"; the image has \"{}\"", name, fmt::join(names_of_parts, "\", \"")));
  const auto part = static_cast<int>(found - names_of_parts.begin());
  std::vector<VoxelFacet> result;
  if (part == 6) {
    std::ranges::copy_if(facets(), std::back_inserter(result),
                         [&](const VoxelFacet& facet) { return !is_on_frame(image_, facet); });
    return result;
  }
  Voxel first{0, 0, 0}, last = image_.size;
  if (part % 2 == 1)
    first[part / 2] = last[part / 2] - 1;
  else
    last[part / 2] = 1;
  for (Index k = first[2]; k < last[2]; ++k)
    for (Index j = first[1]; j < last[1]; ++j)
      for (Index i = first[0]; i < last[0]; ++i)
        if (image_.at({i, j, k}) != 0) result.push_back(facet_of(image_, {i, j, k}, part));
  return result;
}

std::vector<VoxelFacet> ImageBoundary::select(const Selection<3>& selection) const {
  const VoxelBoundary boundary(image_, facets());
  std::vector<VoxelFacet> result;
  for (const Index f : std::visit(internal::FacetSelector<3, VoxelBoundary>(boundary), selection))
    result.push_back(facets()[f]);
  return result;
}

bool is_on_frame(const LabelImage<3>& image, const VoxelFacet& facet) {
  const Index at = voxel_at(image, facet.voxel())[facet.axis()];
  return facet.sign() > 0.0 ? at + 1 == image.size[facet.axis()] : at == 0;
}

Vec<3> smooth_normal(const LabelImage<3>& image, const VoxelFacet& facet) {
  static const GradientStencil stencil;
  constexpr int reach = GradientStencil::reach, wide = GradientStencil::wide;
  const int axis = facet.axis(), first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
  const Vec<3> own = facet.sign() * Vec<3>::Unit(axis);
  if (is_on_frame(image, facet)) return own;
  const Voxel voxel = voxel_at(image, facet.voxel());
  const Index lowest = voxel[axis] + (facet.sign() > 0.0 ? 1 : 0) - reach;
  Vec<3> normal = Vec<3>::Zero();
  Voxel at;
  // Beyond the frame its outermost voxels go on.
  for (int a = 0; a < 2 * reach; ++a)
    for (int b = 0; b <= 2 * wide; ++b)
      for (int c = 0; c <= 2 * wide; ++c) {
        at[axis] = std::clamp(lowest + a, 0, image.size[axis] - 1);
        at[first] = std::clamp(voxel[first] + b - wide, 0, image.size[first] - 1);
        at[second] = std::clamp(voxel[second] + c - wide, 0, image.size[second] - 1);
        if (image.at(at) == 0) continue;
        const double weight = stencil.across[a] * stencil.along[b] * stencil.along[c];
        normal[axis] -= stencil.arm_across[a] * weight;
        normal[first] -= stencil.arm_along[b] * weight;
        normal[second] -= stencil.arm_along[c] * weight;
      }
  normal = normal.cwiseQuotient(image.spacing);
  // A speck in a corner may have its material elsewhere.
  return normal.dot(own) > 0.0 ? normal.normalized() : own;
}

double surface_area(const LabelImage<3>& image, const std::vector<VoxelFacet>& facets) {
  double area = 0.0;
  for (const VoxelFacet& facet : facets)
    area +=
        image.spacing.prod() / image.spacing[facet.axis()] * facet.sign() * smooth_normal(image, facet)[facet.axis()];
  return area;
}

}  // namespace efree
