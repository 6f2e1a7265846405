// SPDX-License-Identifier: GPL-3.0-or-later
/// The lattice that an image in space is cut into: equal boxes, each of them six tetrahedra (Kuhn 1960).
#pragma once

#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/internal/image_field.hpp"
#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/geometry/meshing/internal/kuhn.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"

#include <array>
#include <cstdint>
#include <limits>

namespace efree::internal {

/// In place of a region: the point has been moved onto a boundary.
constexpr Label on_boundary = std::numeric_limits<Label>::max();

/// Points, edges and cubes of the lattice. A cube has the number of its lowest corner; edges go along the axes of a
/// mask (bit d: axis d).
class LatticeGrid {
 public:
  /// Keeps a reference to the image. Throws InputError for a lattice that cannot be numbered or does not fit into
  /// memory.
  LatticeGrid(const LabelImage<3>& image, const ImageMeshOptions& options);

  /// The cubes as boxes in space.
  Lattice lattice() const;

 protected:
  static constexpr double largest_index = std::numeric_limits<Index>::max();

  /// In voxels; exact on the frame.
  double coordinate(int d, Index i) const {
    return static_cast<double>(static_cast<std::int64_t>(i) * image_.size[d]) / cubes_[d];
  }
  Vec<3> place(const std::array<Index, 3>& at) const {
    return {coordinate(0, at[0]), coordinate(1, at[1]), coordinate(2, at[2])};
  }
  std::array<Index, 3> unpacked(std::size_t point) const {
    return {static_cast<Index>(point % stride_[1]), static_cast<Index>(point % stride_[2] / stride_[1]),
            static_cast<Index>(point / stride_[2])};
  }
  /// Voxels along the edge of the cubes that goes along the axes of a mask.
  Vec<3> edge(unsigned axes) const {
    Vec<3> out = Vec<3>::Zero();
    for (int d = 0; d < 3; ++d)
      if (axes >> d & 1) out[d] = static_cast<double>(image_.size[d]) / cubes_[d];
    return out;
  }
  /// Axes along which there is a next (previous) point.
  unsigned upward(const std::array<Index, 3>& at) const {
    return (at[0] < cubes_[0] ? 1u : 0u) | (at[1] < cubes_[1] ? 2u : 0u) | (at[2] < cubes_[2] ? 4u : 0u);
  }
  static unsigned downward(const std::array<Index, 3>& at) {
    return (at[0] > 0 ? 1u : 0u) | (at[1] > 0 ? 2u : 0u) | (at[2] > 0 ? 4u : 0u);
  }

  /// body(k) for k < layers, concurrently but for small layers, `each` items in each: threads are not worth it there.
  template <class Body> static void for_each_layer(Index layers, std::size_t each, const Body& body) {
    parallel_chunks(layers, static_cast<Index>(20000 / each + 1), [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) body(k);
    });
  }
  /// body(k) for all planes of points.
  template <class Body> void for_each_plane(const Body& body) const { for_each_layer(cubes_[2] + 1, stride_[2], body); }
  /// body(at, point) for the points of a plane, in order.
  template <class Body> void for_each_point(Index k, const Body& body) const {
    std::array<Index, 3> at{0, 0, k};
    std::size_t point = stride_[2] * k;
    for (at[1] = 0; at[1] <= cubes_[1]; ++at[1])
      for (at[0] = 0; at[0] <= cubes_[0]; ++at[0]) body(at, point++);
  }

  const LabelImage<3>& image_;
  ImageRegions regions_;
  ImageField field_;
  std::array<Index, 3> cubes_{};
  std::array<std::size_t, 3> stride_{};
  std::array<std::size_t, 8> offset_{};  ///< by mask of axes
  std::size_t num_points_ = 0;
};

}  // namespace efree::internal
