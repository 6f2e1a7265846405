// SPDX-License-Identifier: GPL-3.0-or-later
/// Parts of the boundary of an image.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/geometry/input/image_boundary.hpp"

namespace efree::internal {

/// The faces of voxels of all parts of the boundary that the settings name: those of the image (ImageBoundary::named),
/// selections, and unions of these. Throws InputError, with its place in the case file, for a part that is none or
/// empty.
VoxelParts image_parts(const Settings<3>& settings, const LabelImage<3>& image);

}  // namespace efree::internal
