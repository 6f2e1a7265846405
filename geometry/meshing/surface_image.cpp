// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/surface_image.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/internal/oriented_triangles.hpp"
#include "efree/geometry/input/internal/winding.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

using internal::Triangle, internal::Winding;

constexpr Index block = 4;      ///< voxels
constexpr double whole = 0.05;  ///< farthest from a whole number that a winding number is one
constexpr int margin = 2;       ///< voxels of void around the surface

/// Squared distance from q to a triangle, by the region of its plane that q is over (Ericson 2005).
double squared_distance(const Triangle& triangle, const Vec<3>& q) {
  const auto& [a, b, c] = triangle;
  const auto to_edge = [&](const Vec<3>& from, const Vec<3>& to) {
    const Vec<3> along = to - from;
    const double t = std::clamp((q - from).dot(along) / along.squaredNorm(), 0.0, 1.0);
    return (q - from - t * along).squaredNorm();
  };
  const Vec<3> normal = (b - a).cross(c - a);
  const bool within = normal.dot((b - a).cross(q - a)) >= 0.0 && normal.dot((c - b).cross(q - b)) >= 0.0 &&
                      normal.dot((a - c).cross(q - c)) >= 0.0;
  if (within) return std::pow((q - a).dot(normal), 2) / normal.squaredNorm();
  return std::min({to_edge(a, b), to_edge(b, c), to_edge(c, a)});
}

}  // namespace

SurfaceImage sample_surface(const SurfaceSoup& surface, double voxel) {
  require(!surface.triangles.empty(), "sample_surface: there is no triangle");
  if (!(voxel > 0.0 && std::isfinite(voxel)))
    throw InputError(fmt::format("sample_surface: voxels of {:.4g}, expected > 0", voxel));
  internal::OrientedTriangles faces = internal::orient_triangles(surface);
  require(!faces.triangles.empty(), "sample_surface: no triangle has an area");
  SurfaceImage result;
  result.turned = faces.turned;
  result.shells_turned = faces.shells_turned;
  LabelImage<3>& image = result.image;
  const Vec<3> low = surface.points.rowwise().minCoeff(), high = surface.points.rowwise().maxCoeff();
  double voxels = 1.0;
  for (int d = 0; d < 3; ++d) voxels *= std::ceil((high[d] - low[d]) / voxel) + 2 * margin;
  require_memory(16.0 * voxels, fmt::format("the surface on {:.3g} voxels", voxels), "use a larger mesh_size");
  for (int d = 0; d < 3; ++d) {
    image.size[d] = static_cast<Index>(std::ceil((high[d] - low[d]) / voxel)) + 2 * margin;
    image.origin[d] = 0.5 * (low[d] + high[d] - image.size[d] * voxel);
  }
  image.spacing.setConstant(voxel);
  const auto& n = image.size;
  const std::size_t layer = static_cast<std::size_t>(n[0]) * n[1];
  const double reach = margin * voxel;
  const auto centre = [&](Index i, Index j, Index k) -> Vec<3> {
    return image.origin + voxel * Vec<3>(i + 0.5, j + 0.5, k + 0.5);
  };

  // Distances as far as `reach`, layer by layer.
  std::vector<std::vector<Index>> over(n[2]);
  const auto cells = [&](double from, double to, int d) {
    const auto clamped = [&](double x) {
      return static_cast<Index>(std::clamp(std::floor((x - image.origin[d]) / voxel), 0.0, n[d] - 1.0));
    };
    return std::pair{clamped(from - reach), clamped(to + reach)};
  };
  for (Index t = 0; t < std::ssize(faces.triangles); ++t) {
    const auto& [a, b, c] = faces.triangles[t];
    const auto [first, last] = cells(std::min({a[2], b[2], c[2]}), std::max({a[2], b[2], c[2]}), 2);
    for (Index k = first; k <= last; ++k) over[k].push_back(t);
  }
  std::vector<float> distance(layer * n[2], static_cast<float>(reach));
  parallel_for(n[2], [&](Index k) {
    for (const Index t : over[k]) {
      const auto& [a, b, c] = faces.triangles[t];
      const auto [i0, i1] = cells(std::min({a[0], b[0], c[0]}), std::max({a[0], b[0], c[0]}), 0);
      const auto [j0, j1] = cells(std::min({a[1], b[1], c[1]}), std::max({a[1], b[1], c[1]}), 1);
      for (Index j = j0; j <= j1; ++j)
        for (Index i = i0; i <= i1; ++i) {
          float& least = distance[image.index({i, j, k})];
          const double squared = squared_distance(faces.triangles[t], centre(i, j, k));
          least = std::min(least, static_cast<float>(std::sqrt(squared)));
        }
    }
  });
  const Winding winding(std::move(faces.triangles));
  image.labels.assign(distance.size(), 0);
  image.grey.resize(distance.size());
  const auto sense = [&](double wound, std::size_t at) {
    const auto value = static_cast<float>(std::clamp(2.0 * wound - 1.0, -1.0, 1.0) * distance[at]);
    image.labels[at] = value > 0.0F ? 1 : 0;
    // On a triangle a voxel is outside, by next to nothing.
    image.grey[at] = value != 0.0F ? value : -1e-6F * static_cast<float>(voxel);
  };
  // Away from the triangles and their holes the number is a whole one, the same in all of a block.
  std::array<Index, 3> blocks;
  for (int d = 0; d < 3; ++d) blocks[d] = (n[d] + block - 1) / block;
  parallel_for(blocks[0] * blocks[1] * blocks[2], [&](Index b) {
    const std::array<Index, 3> at{b % blocks[0], b / blocks[0] % blocks[1], b / (blocks[0] * blocks[1])};
    std::array<Index, 3> begin, end;
    for (int d = 0; d < 3; ++d) begin[d] = block * at[d], end[d] = std::min(n[d], begin[d] + block);
    const auto for_voxels = [&](const auto& visit) {
      for (Index k = begin[2]; k < end[2]; ++k)
        for (Index j = begin[1]; j < end[1]; ++j)
          for (Index i = begin[0]; i < end[0]; ++i) visit(i, j, k);
    };
    bool is_away = true;
    for_voxels([&](Index i, Index j, Index k) {
      is_away &= distance[image.index({i, j, k})] >= static_cast<float>(reach);
    });
    if (is_away) {
      const double wound =
          winding(0.5 * (centre(begin[0], begin[1], begin[2]) + centre(end[0] - 1, end[1] - 1, end[2] - 1)));
      if (std::abs(wound - std::round(wound)) < whole)
        return for_voxels([&](Index i, Index j, Index k) { sense(wound, image.index({i, j, k})); });
    }
    for_voxels([&](Index i, Index j, Index k) { sense(winding(centre(i, j, k)), image.index({i, j, k})); });
  });
  double boundary = 0.0, beyond = 0.0;
  for (Index k = 0; k + 1 < n[2]; ++k)
    for (Index j = 0; j + 1 < n[1]; ++j)
      for (Index i = 0; i + 1 < n[0]; ++i) {
        const std::size_t at = image.index({i, j, k});
        for (const std::size_t next : {at + 1, at + n[0], at + layer})
          if (image.labels[at] != image.labels[next]) {
            boundary += 1.0;
            if (std::min(distance[at], distance[next]) > voxel) beyond += 1.0;
          }
      }
  require(boundary > 0.0,
          "the surface has no inside: no voxel is wound around by more than half of it (an open sheet, or thinner than "
          "half of mesh_size)");
  result.closed = beyond / boundary;
  return result;
}

SurfaceLattice mesh_surface_on_lattice(const SurfaceSoup& surface, double size) {
  const SurfaceImage sampled = sample_surface(surface, 0.5 * size);
  LatticeMesh on_lattice = mesh_on_lattice(sampled.image, {.size = size});
  SurfaceLattice result{std::move(on_lattice.mesh), on_lattice.lost, sampled.turned, sampled.shells_turned,
                        sampled.closed};
  result.mesh.regions.clear();
  result.mesh.region_names.clear();
  std::erase_if(result.mesh.groups, [](const auto& group) { return group.facets.empty(); });
  for (auto& group : result.mesh.groups) group.name = "surface 1";  // none lie on the frame
  return result;
}

}  // namespace efree
