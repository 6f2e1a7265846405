// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/crack_series.hpp"

#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/mesh/internal/extract_region.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <utility>

namespace efree {
namespace {

/// The bodies of a mesh, one by one: regions with cells, as build_dynamics_model numbers them.
template <int Dim> std::vector<FineMesh<Dim>> parts_of(const FineMesh<Dim>& mesh) {
  std::vector<FineMesh<Dim>> parts;
  for (Index r = 0; r < mesh.num_regions(); ++r)
    if (auto part = internal::extract_region(mesh, r)) parts.push_back(std::move(*part));
  return parts;
}

/// Whether the nodes are the vertices, one after the other.
template <int Dim> bool are_vertices(const Points<Dim>& nodes, const std::vector<FineMesh<Dim>>& parts) {
  Index first = 0;
  for (const FineMesh<Dim>& part : parts) {
    if (first + part.num_vertices() > nodes.cols()) return false;
    const auto there = nodes.middleCols(first, part.num_vertices());
    if (!there.isApprox(part.vertices(), 1e-12)) return false;
    first += part.num_vertices();
  }
  return first == nodes.cols();
}

/// Points of a body, which is one part of a mesh if there is one.
template <int Dim> Points<Dim> points_of_body(const RecordedFrame<Dim>& frame, Index body) {
  const auto [begin, end] = std::ranges::equal_range(frame.body_of_point, body);
  return frame.points.middleCols(begin - frame.body_of_point.begin(), end - begin);
}

/// A mesh between the points of body number b, which is `part` if that is known.
template <int Dim> PointMesh<Dim> mesh_of_points(const Points<Dim>& points, const FineMesh<Dim>* part, Index b) {
  if (points.cols() <= Dim)
    throw InputError(
        fmt::format("cracks: body {} has {} material points, expected {} and more", b, points.cols(), Dim + 1));
  if (part) {
    const Vec<Dim> low = part->vertices().rowwise().minCoeff(), high = part->vertices().rowwise().maxCoeff();
    const Vec<Dim> middle = points.rowwise().mean();
    if ((middle.array() < low.array()).any() || (middle.array() > high.array()).any())
      throw InputError(
          fmt::format("cracks: the points of body {} are elsewhere than bodies.vtu says: it is of another run", b));
  }
  PointMesh<Dim> mesh = part ? mesh_between<Dim>(points, *part) : mesh_between<Dim>(points);
  if (mesh.cells.cols() == 0)
    throw InputError(
        fmt::format("cracks: the points of body {} are too far apart, or all in a {}", b, Dim == 2 ? "line" : "plane"));
  return mesh;
}

}  // namespace

template <int Dim> PointMesh<Dim> CrackSeries<Dim>::build_mesh(const RecordedRun<Dim>& run, Carriers& carriers) {
  const RecordedFrame<Dim> start = run.frame(0);
  carriers.num_points = static_cast<Index>(start.points.cols());
  carriers.num_nodes = static_cast<Index>(start.nodes.cols());
  require(std::ranges::is_sorted(start.body_of_point) && start.body_of_point.front() >= 0,
          "cracks: expected points of the first body first, then those of the next");
  const Index bodies = start.body_of_point.back() + 1;
  std::vector<FineMesh<Dim>> parts;
  if (run.bodies()) parts = parts_of(*run.bodies());
  require(parts.empty() || static_cast<Index>(parts.size()) == bodies, "cracks: bodies.vtu is of another run");
  carriers.are_nodes = !parts.empty() && are_vertices(start.nodes, parts);

  std::vector<PointMesh<Dim>> meshes;
  std::vector<Index> body_of_point;
  for (Index b = 0; b < bodies; ++b) {
    const FineMesh<Dim>* part = parts.empty() ? nullptr : &parts[b];
    meshes.push_back(carriers.are_nodes ? mesh_of_vertices(*part) : mesh_of_points(points_of_body(start, b), part, b));
    body_of_point.insert(body_of_point.end(), meshes.back().num_points, b);
  }
  PointMesh<Dim> mesh = join(meshes);
  internal::Neighbours<Dim> points;
  if (carriers.are_nodes) points.build(start.points);
  for (Index v = 0; v < mesh.vertices.cols(); ++v) {
    carriers.body.push_back(body_of_point[mesh.owner[v]]);
    carriers.point.push_back(carriers.are_nodes ? points.nearest(mesh.vertices.col(v)) : mesh.owner[v]);
  }
  return mesh;
}

template <int Dim> CrackSeries<Dim>::CrackSeries(const RecordedRun<Dim>& run, const CrackOptions& options)
    : run_(run), cracks_(build_mesh(run, carriers_), options) {}

template <int Dim> CrackFrame<Dim> CrackSeries<Dim>::next() {
  const RecordedFrame<Dim> recorded = run_.frame(next_);
  if (recorded.points.cols() != carriers_.num_points ||
      (carriers_.are_nodes && recorded.nodes.cols() != carriers_.num_nodes))
    throw InputError(fmt::format(
        "cracks: frame {} has {} points and {} nodes, the first {} and {}; cracks follow points and nodes that stay "
        "(method mpm; otm without merging, insertion and fracture)",
        next_, recorded.points.cols(), recorded.nodes.cols(), carriers_.num_points, carriers_.num_nodes));
  const auto damage = std::ranges::find(recorded.scalars, "damage", [](const auto& entry) { return entry.first; });
  const bool is_eroded =
      damage != recorded.scalars.end() && damage->second.size() > 0 && damage->second.maxCoeff() >= 1.0;
  if (carriers_.are_nodes && (recorded.has_merged_nodes || is_eroded))
    throw InputError(
        fmt::format("cracks: in frame {} nodes are merged or points are broken; cracks follow bodies of otm "
                    "without merging, insertion and fracture",
                    next_));
  cracks_.move(carriers_.are_nodes ? recorded.nodes : recorded.points);
  CrackFrame<Dim> frame{.time = run_.time(next_++),
                        .mesh = cracks_.mesh(),
                        .edges = cracks_.num_edges(),
                        .cut_edges = cracks_.num_cut_edges(),
                        .largest_stretch = cracks_.largest_stretch()};
  for (Index c = 0; c < frame.mesh.cells.cols(); ++c)
    frame.body.push_back(carriers_.body[frame.mesh.vertices[frame.mesh.cells(0, c)].front()]);
  for (const auto& [name, values] : recorded.scalars) {
    Vector at_nodes = Vector::Zero(frame.mesh.current.cols());
    for (Index n = 0; n < at_nodes.size(); ++n) {
      const auto vertices = frame.mesh.vertices[n];
      for (const Index v : vertices) at_nodes[n] += values[carriers_.point[v]] / static_cast<double>(vertices.size());
    }
    frame.scalars.emplace_back(name, std::move(at_nodes));
  }
  return frame;
}

template class CrackSeries<2>;
template class CrackSeries<3>;

}  // namespace efree
