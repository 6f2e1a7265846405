// SPDX-License-Identifier: GPL-3.0-or-later
/// Inspections as Packer and Unpacker take them: `fields` lists the members of a type.
#pragma once

#include "efree/io/case/inspect.hpp"

#include <tuple>

namespace efree {

// By structured bindings, so that a member that is added and not listed does not compile.
template <int Dim> auto fields(BodySummary<Dim>& body) {
  auto& [name, num_cells, volume, box] = body;
  return std::tie(name, num_cells, volume, box);
}
template <int Dim> auto fields(GroupSummary<Dim>& group) {
  auto& [name, num_facets, measure, normal, box, mean_normal] = group;
  return std::tie(name, num_facets, measure, normal, box, mean_normal);
}
template <class T>
concept IsFeature = requires(T feature) {
  feature.what;
  feature.size;
  feature.at;
};
auto fields(IsFeature auto& feature) {
  auto& [what, size, at] = feature;
  return std::tie(what, size, at);
}
template <class T>
concept IsWalls = requires(T walls) {
  walls.thickness;
  walls.share;
};
auto fields(IsWalls auto& walls) {
  auto& [thickness, nodes, edges, spacing, at, share] = walls;
  return std::tie(thickness, nodes, edges, spacing, at, share);
}
template <class T>
concept IsSuggestion = requires(T suggestion) {
  suggestion.mesh_size;
  suggestion.cells;
};
auto fields(IsSuggestion auto& suggestion) {
  auto& [mesh_size, cells, spacing, limited] = suggestion;
  return std::tie(mesh_size, cells, spacing, limited);
}
template <class T>
concept IsPiece = requires(T piece) {
  piece.corners;
  piece.region;
};
auto fields(IsPiece auto& piece) {
  auto& [corners, region, group] = piece;
  return std::tie(corners, region, group);
}
template <int Dim> auto fields(Inspection<Dim>& inspection) {
  auto& [file, kind, box, volume, boundary, bodies, groups, smallest, walls, suggestion, facts, remarks, points,
         pieces] = inspection;
  return std::tie(file, kind, box, volume, boundary, bodies, groups, smallest, walls, suggestion, facts, remarks,
                  points, pieces);
}

}  // namespace efree
