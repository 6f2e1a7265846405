// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of results and of geometry (PNG, 1600 x 1200), drawn in memory: they need no display.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/io/inspect.hpp"

#include <filesystem>

namespace efree {

/// von Mises stress on the deformed body, the undeformed one behind it, and where it is held and loaded. Displacements
/// are drawn at a fifteenth of the body's size. Throws InputError if the file cannot be written.
template <int Dim>
void draw_fields(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result);

/// The same with Result::error_density in place of the stress: where a finer mesh would help.
template <int Dim>
void draw_error(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result);

/// Regions and named parts of the boundary, each in a colour of its own. Throws InputError if the file cannot be
/// written.
template <int Dim> void draw_pieces(const std::filesystem::path& file, const Inspection<Dim>& inspection);

}  // namespace efree
