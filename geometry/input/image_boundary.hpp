// SPDX-License-Identifier: GPL-3.0-or-later
/// The boundary of what an image in space shows: the faces of voxels between material and void, and on its frame.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/selection.hpp"

#include <compare>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace efree {

/// A face of a voxel of material, beyond which there is void or the frame ends.
struct VoxelFacet {
  std::size_t code = 0;  ///< 6 times the voxel's index plus the side

  std::size_t voxel() const { return code / 6; }              ///< index in the image
  int side() const { return static_cast<int>(code % 6); }     ///< 2 axis, plus 1 at the upper end
  int axis() const { return side() / 2; }                     ///< of the image that it is across
  double sign() const { return code % 2 == 1 ? 1.0 : -1.0; }  ///< of the outward normal along that axis
  auto operator<=>(const VoxelFacet&) const = default;
};
/// Parts of the boundary by name, each ascending.
using VoxelParts = std::map<std::string, std::vector<VoxelFacet>>;

/// All facets between material and void and on the frame. Facets between materials are none.
class ImageBoundary {
 public:
  /// Keeps a reference to the image, which check_image accepts.
  explicit ImageBoundary(const LabelImage<3>& image) : image_(image) {}

  /// Ascending. Linear in the voxels the first time, which is not for several threads at once.
  const std::vector<VoxelFacet>& facets() const;
  /// Those on a side of the frame ("left", "right", "front", "back", "bottom", "top"), or on none ("pores"), as meshes
  /// of images have them. May be none. Throws InputError for another name, with these.
  std::vector<VoxelFacet> named(const std::string& name) const;
  /// Those that are selected; may be none. Planes and boxes take the corners of facets, angles their smoothed normals.
  /// Throws InputError as select_facets.
  std::vector<VoxelFacet> select(const Selection<3>& selection) const;

 private:
  const LabelImage<3>& image_;
  mutable std::optional<std::vector<VoxelFacet>> facets_{};  ///< once they have been asked for
};

/// Whether a facet is on the frame of its image.
bool is_on_frame(const LabelImage<3>& image, const VoxelFacet& facet);
/// Outward unit normal of the surface that a facet stands for, along the image's axes: against the gradient of what is
/// material, smoothed by a Gaussian of 1.2 voxels; of facets on the frame that of the side.
Vec<3> smooth_normal(const LabelImage<3>& image, const VoxelFacet& facet);
/// Area of the surface that facets stand for: each counts as much as it faces along its smoothed normal, so that the
/// steps of voxels do not count.
double surface_area(const LabelImage<3>& image, const std::vector<VoxelFacet>& facets);

}  // namespace efree
