// SPDX-License-Identifier: GPL-3.0-or-later
/// What children hand over, for Packer and Unpacker, which look for `fields` beside the types.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/core/internal/packer.hpp"
#include "efree/geometry/input/grey_image.hpp"
#include "efree/io/case/inspect.hpp"

#include <tuple>

namespace efree {

// What aggregates are made of. By structured bindings, so that a member that is added and not listed does not compile.
template <class T>
concept IsMeshGroup = requires(T group) {
  group.name;
  group.facets.front().front();
};
auto fields(IsMeshGroup auto& group) {
  auto& [name, facets] = group;
  return std::tie(name, facets);
}
template <int Dim> auto fields(MeshData<Dim>& mesh) {
  auto& [vertices, cells, groups, regions, region_names] = mesh;
  return std::tie(vertices, cells, groups, regions, region_names);
}
template <int Dim> auto fields(BoundaryOffsets<Dim>& boundary) {
  auto& [points, offsets] = boundary;
  return std::tie(points, offsets);
}
template <int Dim> auto fields(LabelImage<Dim>& image) {
  auto& [size, spacing, origin, labels, grey] = image;
  return std::tie(size, spacing, origin, labels, grey);
}
template <int Dim> auto fields(GreyImage<Dim>& image) {
  auto& [size, spacing, origin, values] = image;
  return std::tie(size, spacing, origin, values);
}
template <int Dim> auto fields(MadeMesh<Dim>& made) {
  auto& [mesh, reports, remarks, warnings, size, image, region_of_label, boundary, smooth] = made;
  return std::tie(mesh, reports, remarks, warnings, size, image, region_of_label, boundary, smooth);
}
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
