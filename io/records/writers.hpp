// SPDX-License-Identifier: GPL-3.0-or-later
/// Results as files: result.json, fields.vtu, nodes.vtu.
#pragma once

#include "efree/analysis/result.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// Version of the library, as in "0.1.0".
std::string version();

/// Fields on the fine mesh for ParaView (VTK, binary): point data displacement (3 components), strain (xx,
/// yy, xy | rr, zz, tt, rz | xx, yy, zz, yz, xz, xy with engineering shear), stress, von_mises, restrained and loaded
/// (1 on parts of the boundary with displacement conditions and loads, else 0); cell data region (counted from 0)
/// and error (Result::error_density; none of an analysis through time, which has Result::remembered instead). Of load
/// cases after the first "NAME: displacement" and so on. The points are the places of the space: those on interfaces
/// are there once for each region, with its stress. Quadratic spaces become quadratic cells. Throws InputError if the
/// file cannot be written, as all writers do.
template <int Dim>
void write_fields(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result);

/// Fields of all load cases on a space that carries parts of the boundary: the same but for error and what is
/// remembered.
template <int Dim> void write_fields(const std::filesystem::path& file, const Settings<Dim>& settings,
                                     const FineSpace<Dim>& space, const std::vector<const Fields<Dim>*>& by_case);

/// Fields of anyone's, on the space they are of: the same but for restrained, loaded and error. Throws InputError for
/// fields of another size than the space.
template <int Dim>
void write_fields(const std::filesystem::path& file, const FineSpace<Dim>& space, const Fields<Dim>& fields);

/// The cloud of nodes with the displacement at each.
template <int Dim> void write_nodes(const std::filesystem::path& file, const Result<Dim>& result);

/// Values at points, or of cells: a row for each component.
struct PointValues {
  std::string name;
  Matrix values;                             ///< components x points
  std::vector<std::string> components = {};  ///< their names, as many as there are rows, or none
};
/// Anyone's points with values for ParaView (VTK, binary), a vertex each. Throws InputError for values of another
/// number of points.
template <int Dim>
void write_points(const std::filesystem::path& file, const Points<Dim>& points, const std::vector<PointValues>& values);

/// A mesh for ParaView (VTK, binary): cell data region.
template <int Dim> void write_mesh(const std::filesystem::path& file, const FineMesh<Dim>& mesh);

/// Cells of any mesh, with values at their vertices and of cells, for ParaView (VTK, binary). Throws InputError for
/// values of another number of vertices or cells.
template <int Dim> void write_cells(const std::filesystem::path& file, const Points<Dim>& vertices,
                                    const Cells<Dim>& cells, const std::vector<PointValues>& at_vertices,
                                    const std::vector<PointValues>& of_cells);

/// Counts, errors, energy, probes, parts of the boundary, seconds: the format is in docs/case-file.md.
template <int Dim>
void write_result(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result);

/// What went wrong with the analysis of this title (a NumericalError's text), during which stage, and whose results lie
/// beside this file: "none", "of this run" or "of an earlier run".
void write_failure(const std::filesystem::path& file, const std::string& title, const std::string& reason,
                   const std::string& stage, const std::string& results);

}  // namespace efree
