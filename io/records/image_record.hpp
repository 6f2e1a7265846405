// SPDX-License-Identifier: GPL-3.0-or-later
/// Results of images that were solved on cells, as files and in words.
#pragma once

#include "efree/analysis/image_analysis.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// Fields on the grid for ParaView (VTK image data, binary, compressed, in single precision), turned as the image is:
/// point data displacement; cell data solid (part of the cell that is material), region (counted from 0; -1: void),
/// strain and stress (xx, yy, zz, yz, xz, xy, engineering shear; means over the material), von_mises, and utilisation
/// where a material has a strength. Of load cases after the first "NAME: displacement" and so on. Cells without
/// material are hidden. Throws InputError if the file cannot be written.
void write_fields(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result);

/// A line for each layer of cells across the axes of the image, of all load cases (cell_slices), for spreadsheets.
/// Throws InputError if the file cannot be written.
void write_slices(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result);

/// Counts, energy, errors, probes, parts of the boundary, seconds: the format is in docs/case-file.md.
void write_result(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result);

/// Error in the energy norm, probes, loads, reactions and extremes, a line each.
std::vector<std::string> describe_result(const Settings<3>& settings, const ImageResult& result);

}  // namespace efree
