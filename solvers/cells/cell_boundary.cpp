// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_boundary.hpp"

#include "efree/core/parallel.hpp"
#include "efree/solvers/cells/internal/cell_parts.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <tuple>

namespace efree::internal {
namespace {

/// Octants that a voxel shares along an axis, and its part in each [voxels].
struct Span {
  Index octant;
  double low, high;
};
std::vector<Span> spans_of(Index voxel, Index voxels, Index octants) {
  constexpr double rounding = 1e-9;
  const double length = static_cast<double>(voxels) / octants;
  const auto first = static_cast<Index>(std::floor(voxel / length + rounding)),
             last = static_cast<Index>(std::ceil((voxel + 1) / length - rounding)) - 1;
  std::vector<Span> spans;
  for (Index o = first; o <= last; ++o)
    spans.push_back({o, std::max<double>(voxel, o * length), std::min(voxel + 1.0, (o + 1) * length)});
  return spans;
}

/// The octants of a grid, and how much of each is material.
struct Octants {
  std::array<Index, 3> size;
  const std::vector<float>& solid;

  /// Of the cell of an octant, counted in octants.
  float in_cell(const std::array<Index, 3>& o) const {
    float sum = 0.0F;
    const PartOrder order({size[0] / 2, size[1] / 2, size[2] / 2});
    for (int q = 0; q < 8; ++q) sum += solid[order(o[0] / 2, o[1] / 2, o[2] / 2, q)];
    return sum;
  }
};

/// Moves the octant of a patch against the normal of its surface until its cell has enough material to bear loads, or
/// to the best of some. `at`: the patch's centroid [octants]; `inwards`: of the largest component 1. Returns whether
/// there is material.
bool move_inwards(const Octants& octants, const Vec<3>& at, const Vec<3>& inwards, std::array<Index, 3>& octant) {
  constexpr int most = 16;  // half steps; the smallest octants are a quarter of a voxel
  constexpr float enough = 0.25F;
  std::array<Index, 3> there = octant;
  float best = 0.0F;
  for (int n = 1; n <= most && best < enough; ++n) {
    if (const float material = octants.in_cell(there); material > best) {
      best = material;
      octant = there;
    }
    for (int d = 0; d < 3; ++d) {
      there[d] = static_cast<Index>(std::floor(at[d] + 0.5 * n * inwards[d]));
      if (there[d] < 0 || there[d] >= octants.size[d]) return best > 0.0F;
    }
  }
  return best > 0.0F;
}

void add_patches(const LabelImage<3>& image, const VoxelFacet& facet, const Octants& octants,
                 std::vector<BoundaryPatch>& patches) {
  const auto nx = static_cast<std::size_t>(image.size[0]), ny = static_cast<std::size_t>(image.size[1]);
  const std::size_t v = facet.voxel();
  const std::array<Index, 3> voxel{static_cast<Index>(v % nx), static_cast<Index>(v / nx % ny),
                                   static_cast<Index>(v / nx / ny)};
  const int axis = facet.axis(), first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
  const bool upper = facet.sign() > 0.0;
  const Vec<3> normal = smooth_normal(image, facet);
  Vec<3> voxels;  // to an octant
  for (int d = 0; d < 3; ++d) voxels[d] = static_cast<double>(image.size[d]) / octants.size[d];
  Vec<3> inwards = -normal.cwiseQuotient(image.spacing.cwiseProduct(voxels));
  inwards /= inwards.cwiseAbs().maxCoeff();
  const auto across = spans_of(voxel[axis], image.size[axis], octants.size[axis]);
  for (const Span& b : spans_of(voxel[second], image.size[second], octants.size[second]))
    for (const Span& a : spans_of(voxel[first], image.size[first], octants.size[first])) {
      BoundaryPatch patch{{}, facet.side(), is_on_frame(image, facet), 0.0, 0.0, {}, normal};
      patch.octant[axis] = upper ? across.back().octant : across.front().octant;
      patch.octant[first] = a.octant;
      patch.octant[second] = b.octant;
      patch.facet_area = (a.high - a.low) * image.spacing[first] * (b.high - b.low) * image.spacing[second];
      patch.area = patch.facet_area * facet.sign() * normal[axis];
      patch.at[axis] = voxel[axis] + (upper ? 1.0 : 0.0);
      patch.at[first] = 0.5 * (a.low + a.high);
      patch.at[second] = 0.5 * (b.low + b.high);
      const bool found = move_inwards(octants, patch.at.cwiseQuotient(voxels), inwards, patch.octant);
      patch.at = patch.at.cwiseProduct(image.spacing);
      if (found) patches.push_back(patch);
    }
}

}  // namespace

std::vector<BoundaryPatch> boundary_patches(const LabelImage<3>& image, const std::vector<VoxelFacet>& facets,
                                            const std::vector<float>& solid, const std::array<Index, 3>& cells) {
  const Octants octants{{2 * cells[0], 2 * cells[1], 2 * cells[2]}, solid};
  constexpr Index chunk = 4096;
  const auto count = static_cast<Index>(facets.size());
  std::vector<std::vector<BoundaryPatch>> parts((count + chunk - 1) / chunk);
  parallel_chunks(static_cast<Index>(parts.size()), 1, [&](Index begin, Index end) {
    for (Index p = begin; p < end; ++p)
      for (Index f = p * chunk; f < std::min(count, (p + 1) * chunk); ++f)
        add_patches(image, facets[f], octants, parts[p]);
  });
  std::vector<BoundaryPatch> patches;
  for (const auto& part : parts) patches.insert(patches.end(), part.begin(), part.end());
  return patches;
}

std::vector<BoundaryPatch> coarsened(const std::vector<BoundaryPatch>& patches, const std::array<int, 3>& ratio) {
  std::vector<BoundaryPatch> coarse = patches;
  for (BoundaryPatch& patch : coarse)
    for (int d = 0; d < 3; ++d) patch.octant[d] /= ratio[d];
  const auto key = [](const BoundaryPatch& patch) {
    return std::tuple(patch.octant[2], patch.octant[1], patch.octant[0], patch.side, patch.on_frame);
  };
  std::ranges::stable_sort(coarse, {}, key);
  std::size_t last = 0;
  for (std::size_t p = 1; p < coarse.size(); ++p) {
    BoundaryPatch& to = coarse[last];
    const BoundaryPatch& more = coarse[p];
    if (key(to) != key(more)) {
      coarse[++last] = more;
      continue;
    }
    // Moments of forces along the facets' normal stay, so that pressure around a body has none.
    const double facet_area = to.facet_area + more.facet_area, area = to.area + more.area;
    to.at = (to.facet_area * to.at + more.facet_area * more.at) / facet_area;
    to.normal = (to.area * to.normal + more.area * more.normal) / area;
    to.facet_area = facet_area;
    to.area = area;
  }
  if (!coarse.empty()) coarse.resize(last + 1);
  return coarse;
}

}  // namespace efree::internal
