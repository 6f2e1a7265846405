// SPDX-License-Identifier: GPL-3.0-or-later
/// Meshes and images as Packer and Unpacker take them: `fields` lists the members of a type.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/core/packer.hpp"
#include "efree/geometry/input/grey_image.hpp"

#include <tuple>

namespace efree {

// By structured bindings, so that a member that is added and not listed does not compile.
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
  auto& [size, spacing, origin, axes, labels, grey] = image;
  return std::tie(size, spacing, origin, axes, labels, grey);
}
template <int Dim> auto fields(GreyImage<Dim>& image) {
  auto& [size, spacing, origin, axes, values] = image;
  return std::tie(size, spacing, origin, axes, values);
}
template <int Dim> auto fields(MadeImage<Dim>& made) {
  auto& [image, region_of_label, reports, remarks, warnings] = made;
  return std::tie(image, region_of_label, reports, remarks, warnings);
}
template <int Dim> auto fields(MadeMesh<Dim>& made) {
  auto& [mesh, reports, remarks, warnings, size, boundary, smooth] = made;
  return std::tie(mesh, reports, remarks, warnings, size, boundary, smooth);
}

}  // namespace efree
