// SPDX-License-Identifier: GPL-3.0-or-later
/// What meshing an image is the same in two dimensions and three.
#pragma once

#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/internal/planar_regions.hpp"

#include <string>
#include <vector>

namespace efree::internal {

struct ImageRegions {
  std::vector<std::string> names;  ///< by region
  std::vector<Index> of_label;     ///< by label; -1: void, or not in the image
};

/// Checks image and options as mesh_image says, and numbers the regions.
template <int Dim> ImageRegions image_regions(const LabelImage<Dim>& image, const ImageMeshOptions& options);

/// Turns vertices of a mesh that was made as if the image's axes were those of the world.
template <int Dim> void turn_to_world(const LabelImage<Dim>& image, Points<Dim>& vertices);

/// The contours between regions and around the material, without points within straight runs. Chains are named "left",
/// "right", "bottom", "top" on the image's frame, and "pores" inside it.
PlanarRegions contours(const LabelImage<2>& image, const ImageRegions& regions, Contour contour);

}  // namespace efree::internal
