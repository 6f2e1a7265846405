// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/lattice_losses.hpp"

#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/geometry/mesh/internal/bodies.hpp"
#include "efree/geometry/meshing/internal/lattice_points.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <utility>

namespace efree::internal {

std::vector<std::size_t> LatticePoints::unseen_voxels() const {
  std::array<std::vector<Index>, 3> cube_of;
  for (int d = 0; d < 3; ++d)
    for (Index v = 0; v < image_.size[d]; ++v)
      cube_of[d].push_back(
          std::min(static_cast<Index>((v + 0.5) * cubes_[d] / image_.size[d]), static_cast<Index>(cubes_[d] - 1)));
  const std::size_t row = image_.size[0], layer = row * image_.size[1];
  std::vector<std::vector<std::size_t>> found(image_.size[2]);
  for_each_layer(image_.size[2], layer, [&](Index k) {
    for (Index j = 0; j < image_.size[1]; ++j) {
      const std::size_t cubes = cube_of[1][j] * stride_[1] + cube_of[2][k] * stride_[2];
      const std::size_t voxels = j * row + k * layer;
      for (Index i = 0; i < image_.size[0];) {
        const Index cube = cube_of[0][i];
        const auto corner = corners(cubes + cube);
        for (; i < image_.size[0] && cube_of[0][i] == cube; ++i) {
          const Label region = field_.at(voxels + i);
          bool seen = false;
          for (const Label c : corner) seen = seen || c == region;
          if (!seen) found[k].push_back(voxels + i);
        }
      }
    }
  });
  std::vector<std::size_t> unseen;
  for (const auto& of_layer : found) unseen.insert(unseen.end(), of_layer.begin(), of_layer.end());
  return unseen;
}

void LatticePoints::find_lost(LostFeatures& lost) const {
  const std::vector<std::size_t> unseen = unseen_voxels();
  if (unseen.empty()) return;
  const std::size_t row = image_.size[0], layer = row * image_.size[1];

  DisjointSets sets(static_cast<Index>(unseen.size()));
  std::vector<char> hangs_on(unseen.size(), 0);  // next to a voxel of its region that is seen
  const auto for_each_neighbour = [&](std::size_t voxel, const auto& body) {
    const std::size_t at[3] = {voxel % row, voxel % layer / row, voxel / layer}, step[3] = {1, row, layer};
    for (int d = 0; d < 3; ++d) {
      if (at[d] > 0) body(voxel - step[d]);
      if (at[d] + 1 < static_cast<std::size_t>(image_.size[d])) body(voxel + step[d]);
    }
  };
  for (std::size_t n = 0; n < unseen.size(); ++n)
    for_each_neighbour(unseen[n], [&](std::size_t next) {
      if (field_.at(next) != field_.at(unseen[n])) return;
      const auto it = std::lower_bound(unseen.begin(), unseen.end(), next);
      if (it == unseen.end() || *it != next) {
        hangs_on[n] = 1;
        return;
      }
      sets.join(static_cast<Index>(n), static_cast<Index>(it - unseen.begin()));
    });
  const std::vector<Index> cluster_of = std::move(sets).firsts();
  struct Cluster {
    std::size_t voxels = 0;
    bool hangs_on = false;
    Vec<3> sum = Vec<3>::Zero();
  };
  const auto centre = [&](std::size_t voxel) {
    return Vec<3>(static_cast<double>(voxel % row) + 0.5, static_cast<double>(voxel % layer / row) + 0.5,
                  static_cast<double>(voxel / layer) + 0.5);
  };
  std::vector<Cluster> clusters(unseen.size());
  for (std::size_t n = 0; n < unseen.size(); ++n) {
    Cluster& cluster = clusters[cluster_of[n]];
    ++cluster.voxels;
    cluster.hangs_on = cluster.hangs_on || hangs_on[n];
    cluster.sum += centre(unseen[n]);
  }
  std::size_t worst = 0;
  for (std::size_t n = 0; n < unseen.size(); ++n) {
    if (cluster_of[n] != static_cast<Index>(n)) continue;
    ++(clusters[n].hangs_on ? lost.pieces : lost.parts);
    const auto rank = [&](std::size_t of) { return std::pair(clusters[of].voxels, !clusters[of].hangs_on); };
    if (rank(n) > rank(worst)) worst = n;
  }
  const double volume = image_.pixel_volume();
  lost.volume = volume * static_cast<double>(unseen.size());
  lost.worst_volume = volume * static_cast<double>(clusters[worst].voxels);
  lost.worst_is_part = !clusters[worst].hangs_on;
  const Vec<3> mean = clusters[worst].sum / static_cast<double>(clusters[worst].voxels);
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t n = 0; n < unseen.size(); ++n)
    if (const double distance = (centre(unseen[n]) - mean).squaredNorm();
        cluster_of[n] == static_cast<Index>(worst) && distance < nearest) {
      nearest = distance;
      lost.worst_place = image_.origin + image_.spacing.cwiseProduct(centre(unseen[n]));
    }
  if (const Label region = field_.at(unseen[worst]); region != 0) lost.worst_region = regions_.names[region - 1];
}

void find_broken(const LabelImage<3>& image, LatticeMesh& out) {
  const Cells<3>& cells = out.mesh.cells;
  const std::vector<Index> first = first_of_body<3>(cells, static_cast<Index>(out.mesh.vertices.cols()));
  struct Body {
    double volume = 0.0;
    Vec<3> moment = Vec<3>::Zero();
    Index part = -1;  // of the image
  };
  std::vector<Index> number(first.size(), -1);  // of the body, by its first vertex
  std::vector<Body> bodies;
  for (std::size_t v = 0; v < first.size(); ++v)
    if (first[v] == static_cast<Index>(v)) {
      number[v] = static_cast<Index>(bodies.size());
      bodies.emplace_back();
    }
  if (bodies.size() < 2) return;

  LabelImage<3> material{.size = image.size, .labels = image.labels};
  for (Label& label : material.labels) label = label != 0;
  const ConnectedPixels parts = connected_pixels(material);
  for (Index c = 0; c < cells.cols(); ++c) {
    Body& body = bodies[number[first[cells(0, c)]]];
    const Vec<3> corner = out.mesh.vertices.col(cells(0, c));
    Mat<3> edges;
    for (int i = 1; i < 4; ++i) edges.col(i - 1) = out.mesh.vertices.col(cells(i, c)) - corner;
    const double volume = edges.determinant() / 6.0;
    const Vec<3> centre = corner + 0.25 * edges.rowwise().sum();
    body.volume += volume;
    body.moment += volume * centre;
    if (body.part >= 0) continue;
    // Near the boundary cells may lie in voxels of void.
    std::array<Index, 3> voxel;
    for (int d = 0; d < 3; ++d)
      voxel[d] = std::clamp(static_cast<Index>((centre[d] - image.origin[d]) / image.spacing[d]), 0, image.size[d] - 1);
    if (const Index part = parts.part_of[image.index(voxel)]; parts.parts[part].label != 0) body.part = part;
  }
  std::vector<Index> largest(parts.parts.size(), -1);  // first of the largest bodies of each part
  for (std::size_t n = 0; n < bodies.size(); ++n)
    if (bodies[n].part >= 0)
      if (Index& of = largest[bodies[n].part]; of < 0 || bodies[n].volume > bodies[of].volume)
        of = static_cast<Index>(n);
  for (std::size_t n = 0; n < bodies.size(); ++n) {
    const Body& body = bodies[n];
    if (body.part < 0 || largest[body.part] == static_cast<Index>(n)) continue;
    ++out.lost.broken_off;
    if (body.volume <= out.lost.broken_volume) continue;
    out.lost.broken_volume = body.volume;
    out.lost.broken_place = body.moment / body.volume;
  }
}
}  // namespace efree::internal
