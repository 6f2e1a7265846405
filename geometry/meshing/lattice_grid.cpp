// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/lattice_grid.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree::internal {

LatticeGrid::LatticeGrid(const LabelImage<3>& image, const ImageMeshOptions& options)
    : image_(image), regions_(image_regions(image, options)), field_(image, regions_, true) {
  if (!image.grey.empty() && regions_.names.size() > 1)
    throw InputError(
        fmt::format("image: grey values of an image with {} regions, expected one", regions_.names.size()));
  if (regions_.names.size() + 1 >= on_boundary)
    throw InputError(fmt::format("image: {} regions, at most {} fit", regions_.names.size(), on_boundary - 2));
  double points = 1.0, cubes = 1.0;
  std::array<double, 3> counts;
  for (int d = 0; d < 3; ++d) {
    counts[d] = std::max(1.0, std::round(image.size[d] * image.spacing[d] / options.size));
    points *= counts[d] + 1.0;
    cubes *= counts[d];
  }
  double material = 0.0;
  for (const LabelCount& count : count_labels(image))
    if (count.label != 0) material += static_cast<double>(count.pixels);
  material /= static_cast<double>(image.labels.size());
  const std::string what = fmt::format("image: meshing {} x {} x {} voxels with a size of {}", image.size[0],
                                       image.size[1], image.size[2], options.size);
  require_memory(16.0 * points + 300.0 * cubes * material, what, "take a larger size");
  if (points > largest_index)
    throw InputError(fmt::format("{} takes a lattice of {:.3g} points, at most {} can be numbered; take a larger size",
                                 what, points, largest_index));
  for (int d = 0; d < 3; ++d) cubes_[d] = static_cast<Index>(counts[d]);
  stride_ = {1, static_cast<std::size_t>(cubes_[0]) + 1,
             (static_cast<std::size_t>(cubes_[0]) + 1) * (static_cast<std::size_t>(cubes_[1]) + 1)};
  num_points_ = stride_[2] * (static_cast<std::size_t>(cubes_[2]) + 1);
  for (std::size_t corner = 0; corner < 8; ++corner)
    offset_[corner] = (corner & 1) * stride_[0] + (corner >> 1 & 1) * stride_[1] + (corner >> 2) * stride_[2];
}

Lattice LatticeGrid::lattice() const {
  Lattice out;
  for (int d = 0; d < 3; ++d) {
    out.origin[d] = image_.origin[d];
    out.spacing[d] = image_.spacing[d] * image_.size[d] / cubes_[d];
  }
  out.cubes = cubes_;
  return out;
}

}  // namespace efree::internal
