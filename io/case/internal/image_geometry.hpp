// SPDX-License-Identifier: GPL-3.0-or-later
/// [geometry] with an image.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/io/case/internal/section.hpp"
#include "efree/io/confined/internal/confined.hpp"

#include <filesystem>
#include <functional>

namespace efree::internal {

/// [geometry.image].
Section image_section(const Section& geometry);

/// Makes the mesh of an image. Throws InputError for settings that have no meaning for it.
template <int Dim> std::function<MadeMesh<Dim>(const MeshSize&)> image_mesh(const Section& geometry,
                                                                            const std::filesystem::path& file,
                                                                            bool is_raw);
/// Reads the image, without a mesh; empty where another mesher than the lattice is asked for.
std::function<MadeImage<3>()> image_alone(const Section& geometry, const std::filesystem::path& file, bool is_raw);
/// The grey value at a point. Not every case asks for it: the file is read for the first one that is.
template <int Dim> ScalarField<Dim> grey_of(const Section& geometry, const std::filesystem::path& file, bool is_raw,
                                            const Confinement& confinement);

}  // namespace efree::internal
