// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/summary.hpp"

#include "efree/core/internal/infinity.hpp"
#include "efree/geometry/mesh/internal/sorted_facet.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace efree {
namespace {

constexpr double degree = std::numbers::pi / 180.0;
using internal::infinity;

/// Normal of a facet times its measure, outward for a boundary facet in FineMesh's order.
template <int Dim> Vec<Dim> area_vector(const Points<Dim>& x, const std::array<Index, Dim>& facet) {
  if constexpr (Dim == 2) {
    const Vec<2> along = x.col(facet[1]) - x.col(facet[0]);
    return {along.y(), -along.x()};
  } else {
    const Vec<3> a = x.col(facet[1]) - x.col(facet[0]), b = x.col(facet[2]) - x.col(facet[0]);
    return 0.5 * a.cross(b);
  }
}

template <int Dim>
GroupSummary<Dim> summarize_group(const MeshData<Dim>& mesh, const typename MeshData<Dim>::Group& group,
                                  const std::map<std::array<Index, Dim>, std::array<Index, Dim>>& outward) {
  GroupSummary<Dim> out{group.name, 0, 0.0, std::nullopt, {}, Vec<Dim>::Zero()};
  auto facets = group.facets;
  for (auto& facet : facets) facet = internal::sorted_facet<Dim>(facet);
  std::sort(facets.begin(), facets.end());
  facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  Vec<Dim> sum = Vec<Dim>::Zero();
  std::vector<Vec<Dim>> normals;
  for (const auto& facet : facets) {
    const auto side = outward.find(facet);
    Vec<Dim> area = area_vector<Dim>(mesh.vertices, side == outward.end() ? facet : side->second);
    // Inside the body a normal has no sign of its own.
    if (side == outward.end() && area.dot(sum) < 0.0) area = -area;
    sum += area;
    out.measure += area.norm();
    normals.push_back(area.normalized());
    for (const Index v : facet) out.box.extend(mesh.vertices.col(v));
  }
  out.num_facets = static_cast<Index>(facets.size());
  if (out.measure > 0.0) out.mean_normal = sum / out.measure;
  const Vec<Dim> mean = sum.normalized();
  const double cosine = std::cos(0.1 * degree);
  if (!normals.empty() &&
      std::ranges::all_of(normals, [&](const Vec<Dim>& normal) { return normal.dot(mean) >= cosine; }))
    out.normal = mean;
  return out;
}

}  // namespace

template <int Dim> GeometrySummary<Dim> summarize(const MeshData<Dim>& data) {
  const FineMesh<Dim> mesh(data);
  GeometrySummary<Dim> out;
  out.num_vertices = mesh.num_vertices();
  out.num_cells = mesh.num_cells();
  out.num_components = mesh.num_components();
  out.volume = mesh.volumes().sum();
  out.largest_edge = mesh.size();
  for (Index v = 0; v < mesh.num_vertices(); ++v) out.box.extend(mesh.vertex(v));
  for (const std::string& name : mesh.region_names()) out.bodies.push_back({name, 0, 0.0, {}});

  out.smallest_edge = infinity;
  double largest_cosine = -1.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    BodySummary<Dim>& body = out.bodies[mesh.region(c)];
    ++body.num_cells;
    body.volume += mesh.volume(c);
    auto normals = mesh.hat_gradients(c);
    normals.colwise().normalize();
    for (int i = 0; i <= Dim; ++i) {
      body.box.extend(mesh.vertex(mesh.cells()(i, c)));
      for (int j = 0; j < i; ++j) {
        out.smallest_edge =
            std::min(out.smallest_edge, (mesh.vertex(mesh.cells()(i, c)) - mesh.vertex(mesh.cells()(j, c))).norm());
        largest_cosine = std::max(largest_cosine, -normals.col(i).dot(normals.col(j)));
      }
    }
  }
  out.smallest_angle = std::acos(std::min(largest_cosine, 1.0)) / degree;
  for (Index f = 0; f < mesh.num_facets(); ++f) out.boundary += mesh.facet_measure(f);

  // Groups are taken from what was given, as FineMesh keeps facets on the boundary only; it drops vertices without a
  // cell but keeps the order of the others.
  std::vector<Index> given(mesh.num_vertices());
  std::vector<char> used(data.vertices.cols(), 0);
  for (const Index v : data.cells.reshaped()) used[v] = 1;
  for (Index v = 0, count = 0; v < data.vertices.cols(); ++v)
    if (used[v]) given[count++] = v;
  std::map<std::array<Index, Dim>, std::array<Index, Dim>> outward;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    std::array<Index, Dim> facet;
    for (int k = 0; k < Dim; ++k) facet[k] = given[mesh.facets()(k, f)];
    outward.emplace(internal::sorted_facet<Dim>(facet), facet);
  }
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto gradients = mesh.hat_gradients(c);
    for (int i = 0; i <= Dim; ++i) {
      const Index other = mesh.neighbour(i, c);
      if (other < 0 || mesh.region(c) >= mesh.region(other)) continue;
      std::array<Index, Dim> facet;
      for (int k = 0; k < Dim; ++k) facet[k] = given[mesh.cells()((i + 1 + k) % (Dim + 1), c)];
      if (area_vector<Dim>(data.vertices, facet).dot(gradients.col(i)) > 0.0) std::swap(facet[0], facet[1]);
      outward.emplace(internal::sorted_facet<Dim>(facet), facet);
    }
  }
  for (const auto& group : data.groups) out.groups.push_back(summarize_group<Dim>(data, group, outward));
  return out;
}

template GeometrySummary<2> summarize<2>(const MeshData<2>&);
template GeometrySummary<3> summarize<3>(const MeshData<3>&);

}  // namespace efree
