// SPDX-License-Identifier: GPL-3.0-or-later
/// Results as files: result.json, fields.vtu, nodes.vtu.
#pragma once

#include "efree/io/run_case.hpp"

#include <filesystem>
#include <string>

namespace efree {

/// Version of the library, as in "0.1.0".
std::string version();

/// Fields on the fine mesh for ParaView (VTK, compressed binary): point data displacement (3 components), strain (xx,
/// yy, xy with engineering shear), stress (xx, yy, xy), von_mises. Quadratic spaces become quadratic triangles. Throws
/// InputError if the file cannot be written, as all writers do.
void write_fields(const std::filesystem::path& file, const Case& analysis, const CaseResult& result);

/// The cloud of nodes with the displacement at each.
void write_nodes(const std::filesystem::path& file, const CaseResult& result);

/// Counts, errors, energy, probes, seconds: the format is in docs/case-file.md.
void write_result(const std::filesystem::path& file, const Case& analysis, const CaseResult& result);

/// What went wrong (a NumericalError's text) and during which stage.
void write_failure(const std::filesystem::path& file, const Case& analysis, const std::string& reason,
                   const std::string& stage);

}  // namespace efree
