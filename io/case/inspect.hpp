// SPDX-License-Identifier: GPL-3.0-or-later
/// What a file holds, before anything is analysed.
#pragma once

#include "efree/core/monitor.hpp"
#include "efree/geometry/mesh/summary.hpp"
#include "efree/io/confined/reading.hpp"

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace efree {

/// What a file holds.
template <int Dim> struct Inspection {
  std::string file;  ///< as it was named
  std::string kind;  ///< "CAD", "gmsh geometry", "gmsh mesh", "label image", "grey image", "surface", "case"
  BoundingBox<Dim> box{};
  double volume = 0.0;                      ///< of all bodies, area in 2D; 0 if unknown: a surface with faults
  double boundary = 0.0;                    ///< its area, length in 2D; of images along the faces of pixels
  std::vector<BodySummary<Dim>> bodies{};   ///< regions: what [[material]] can name
  std::vector<GroupSummary<Dim>> groups{};  ///< named parts of the boundary: what `on` can name
  /// The smallest thing that a fine mesh has to resolve.
  struct Feature {
    std::string what;
    double size;  ///< [length]
    Vec<Dim> at;
  };
  std::optional<Feature> smallest{};
  /// Of a case: thickness of the body (of each region for itself), and how finely cloud and mesh resolve it.
  struct Walls {
    /// Each at the least, at what 5 % of the boundary has less than (of the part of it that has an opposite side), and
    /// at the median.
    std::array<double, 3> thickness{};  ///< [length]
    std::array<double, 3> nodes{};      ///< thickness over the spacing of the cloud there; 0: finite elements
    std::array<double, 3> edges{};      ///< thickness over the edges of the fine mesh there
    double spacing = 0.0;               ///< of the cloud, asked for or chosen; 0: finite elements [length]
    Vec<Dim> at;                        ///< the thinnest: on one of its sides
    double share = 0.0;                 ///< of the boundary that has an opposite side
  };
  std::optional<Walls> walls{};
  /// Sizes to begin with: two edges of the fine mesh across the walls but for the thinnest 5 % of the boundary, no
  /// coarser than a twentieth of the box and no finer than two million cells. Cells and spacing are about what follows;
  /// no cloud follows, spacing 0, in cases of explicit dynamics.
  struct Suggestion {
    double mesh_size, cells, spacing;
    bool limited;  ///< by the number of cells
  };
  std::optional<Suggestion> suggestion{};
  /// Counts and measures of quality, named as in JSON ("open_edges").
  std::vector<std::pair<std::string, double>> facts{};
  std::vector<std::string> remarks{};  ///< what stands in the way of an analysis, and what can be done about it

  /// What to draw: in 3D the boundary, in 2D bodies (triangles, rectangles) and their boundary (lines).
  struct Piece {
    std::array<Index, 4> corners{-1, -1, -1, -1};  ///< 2 to 4 points, then -1
    Index region = -1, group = -1;                 ///< by `bodies` and `groups`; -1: none
  };
  Points<Dim> points{};
  std::vector<Piece> pieces{};
};
/// Of a file in the plane or in space.
using AnyInspection = std::variant<Inspection<2>, Inspection<3>>;

/// Looks into a gmsh, CAD, image or surface file, or at the geometry of a case (.toml) with its selections. gmsh and
/// CAD files are meshed with their own sizes; images are told from their pixels (for grey ones the threshold that parts
/// them best) and surfaces from their triangles. Stage: inspect. Throws InputError as the readers do, and for files
/// they fail on.
AnyInspection inspect(const std::filesystem::path& file, const Reading& reading = {}, const Monitor& monitor = {});

/// For people: several lines, ending with a line break.
template <int Dim> std::string inspection_text(const Inspection<Dim>& inspection);
/// For programs: JSON, ending with a line break; the format is in docs/case-file.md.
template <int Dim> std::string inspection_json(const Inspection<Dim>& inspection);
/// The pieces for ParaView and for the picture (VTU): cell data region and group, names in the field data region_names
/// and group_names. Throws InputError if the file cannot be written.
template <int Dim> void write_pieces(const std::filesystem::path& file, const Inspection<Dim>& inspection);

}  // namespace efree
