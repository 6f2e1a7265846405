// SPDX-License-Identifier: GPL-3.0-or-later
/// [geometry] of a case file.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/io/case/internal/section.hpp"
#include "efree/io/confined/reading.hpp"

#include <filesystem>

namespace efree::internal {

/// Keys that [geometry] may have.
Section::Keys geometry_keys();

/// Dimensions of the body: by the shape, the kind of file or, for .geo and .msh, what is in it. Images of formats that
/// hold 2 or 3 dimensions are taken as the case means them: planar if it `has_plane`. `folder` is where relative names
/// of files start. Stage where a file has to be read: read. Throws InputError beginning with "file:line: ", as all that
/// follow.
int geometry_dimension(const Section& geometry, const std::filesystem::path& folder, bool has_plane,
                       const Reading& reading, const Monitor& monitor);

/// Checks all of [geometry] that can be checked before a mesh is made, which happens as `reading` says.
template <int Dim>
MeshSource<Dim> read_geometry(const Section& geometry, const std::filesystem::path& folder, const Reading& reading);

}  // namespace efree::internal
