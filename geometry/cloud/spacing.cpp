// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cloud/spacing.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/infinity.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <queue>
#include <tuple>

namespace efree {
namespace {

using internal::infinity;

/// Vertices, the least value first; ties by number, so that the order is the same everywhere.
using Entry = std::pair<double, Index>;
using Queue = std::priority_queue<Entry, std::vector<Entry>, std::greater<>>;

/// Calls body(w) for the other vertices of the cells around v; those of several cells come several times.
template <int Dim, class Body> void for_each_neighbour(const FineMesh<Dim>& mesh, Index v, const Body& body) {
  for (const Index c : mesh.cells_of(v))
    for (int i = 0; i <= Dim; ++i)
      if (const Index w = mesh.cells()(i, c); w != v) body(w);
}

template <int Dim> double mean_edge(const FineMesh<Dim>& mesh, Index v) {
  double sum = 0.0;
  int count = 0;
  for_each_neighbour(mesh, v, [&](Index w) {
    sum += (mesh.vertex(w) - mesh.vertex(v)).norm();
    ++count;
  });
  return sum / count;
}

/// |mean normal| of half a circle or half a sphere.
template <int Dim> constexpr double half_turn = Dim == 2 ? 2.0 / std::numbers::pi : 0.5;

/// Diameters of bends of the boundary at its vertices.
template <int Dim> void add_bends(const FineMesh<Dim>& mesh, double largest, Vector& size) {
  struct Piece {
    double distance;
    Index facet;
    bool operator<(const Piece& other) const {
      return std::tie(distance, facet) < std::tie(other.distance, other.facet);
    }
  };
  // The pole of a half circle or sphere is this far from its rim.
  const double reach = std::sqrt(0.5) * largest;
  parallel_chunks(mesh.num_vertices(), std::max<Index>(4096, (mesh.num_vertices() + 15) / 16),
                  [&](Index begin, Index end) {
                    std::vector<Index> stamp(mesh.num_facets(), -1);  // vertex that last saw the facet
                    std::vector<Piece> pieces;
                    for (Index v = begin; v < end; ++v) {
                      if (!mesh.on_boundary(v)) continue;
                      const Vec<Dim> x = mesh.vertex(v);
                      pieces.clear();
                      const auto visit = [&](Index at) {
                        for (const Index f : mesh.facets_of(at)) {
                          if (stamp[f] == v) continue;
                          stamp[f] = v;
                          Vec<Dim> centre = Vec<Dim>::Zero();
                          for (int k = 0; k < Dim; ++k) centre += mesh.vertex(mesh.facets()(k, f)) / Dim;
                          if (const double distance = (centre - x).norm(); distance < reach || at == v)
                            pieces.push_back({distance, f});
                        }
                      };
                      visit(v);
                      const std::size_t around = pieces.size();
                      for (std::size_t k = 0; k < pieces.size(); ++k)
                        for (int i = 0; i < Dim; ++i) visit(mesh.facets()(i, pieces[k].facet));
                      std::sort(pieces.begin(), pieces.end());
                      Vec<Dim> normal = Vec<Dim>::Zero();
                      double measure = 0.0;
                      for (std::size_t k = 0; k < pieces.size(); ++k) {
                        normal += mesh.facet_measure(pieces[k].facet) * mesh.facet_normal(pieces[k].facet);
                        measure += mesh.facet_measure(pieces[k].facet);
                        if (k + 1 < around || normal.norm() > half_turn<Dim> * measure) continue;
                        size[v] = std::min(size[v], std::numbers::sqrt2 * pieces[k].distance);
                        break;
                      }
                    }
                  });
}

/// Thickness of the body between opposite parts of the boundary, at the vertices where their neighbourhoods meet.
template <int Dim> void add_thickness(const FineMesh<Dim>& mesh, double largest, Vector& size) {
  const Index n = mesh.num_vertices();
  Points<Dim> normal = Points<Dim>::Zero(Dim, n);
  std::vector<Index> foot(n, -1);  // boundary vertex whose distance was carried here through the body
  Vector distance = Vector::Constant(n, infinity);
  Queue queue;
  for (Index v = 0; v < n; ++v) {
    if (!mesh.on_boundary(v)) continue;
    for (const Index f : mesh.facets_of(v)) normal.col(v) += mesh.facet_measure(f) * mesh.facet_normal(f);
    normal.col(v).normalize();
    foot[v] = v;
    distance[v] = 0.0;
    queue.push({0.0, v});
  }
  while (!queue.empty()) {
    const auto [d, v] = queue.top();
    queue.pop();
    if (d > distance[v]) continue;
    for_each_neighbour(mesh, v, [&, v = v](Index w) {
      const double there = (mesh.vertex(w) - mesh.vertex(foot[v])).norm();
      if (there >= distance[w] || there > 0.75 * largest) return;  // half the thickness and some way beyond the middle
      distance[w] = there;
      foot[w] = foot[v];
      queue.push({there, w});
    });
  }
  for (Index v = 0; v < n; ++v)
    for_each_neighbour(mesh, v, [&](Index w) {
      const Index a = foot[v], b = foot[w];
      if (a < 0 || b < 0 || a == b) return;
      const Vec<Dim> across = mesh.vertex(b) - mesh.vertex(a);
      const double length = across.norm();
      // Walls that face each other through the body: neither the sides of a corner nor those of a slit do.
      const bool opposite = across.dot(normal.col(a)) < -0.8 * length && across.dot(normal.col(b)) > 0.8 * length;
      if (opposite && length < largest) size[v] = std::min(size[v], length);
    });
}

void check_length(double length, const char* what) {
  if (!(length > 0.0 && std::isfinite(length)))
    throw InputError(fmt::format("cloud: {} is {}, expected a positive length", what, length));
}

/// Lowers the spacing at v for a box, region or boundary.
template <int Dim>
void lower(const FineMesh<Dim>& mesh, Index v, double to, const std::string& where, Vector& spacing) {
  if (const double edge = mean_edge(mesh, v); to < edge)
    throw InputError(
        fmt::format("cloud: spacing {:.6g} {} is below the edges of the fine mesh at ({:.6g}), {:.3g}; "
                    "expected a finer mesh there (H/h of 3 or more) or a wider spacing",
                    to, where, fmt::join(mesh.vertex(v), ", "), edge));
  spacing[v] = std::min(spacing[v], to);
}

/// Vertices that lie in the same place on the two sides of interfaces between regions; each pair both ways, ascending.
template <int Dim> std::vector<std::pair<Index, Index>> twins(const FineMesh<Dim>& mesh) {
  std::vector<std::pair<Index, Index>> pairs;
  if (mesh.num_regions() < 2) return pairs;
  for (const auto& [first, second] : tied_facets(mesh))
    for (const Index a : mesh.facets().col(first))
      for (const Index b : mesh.facets().col(second))
        if (mesh.vertex(a) == mesh.vertex(b)) pairs.insert(pairs.end(), {{a, b}, {b, a}});
  std::ranges::sort(pairs);
  const auto same = std::ranges::unique(pairs);
  pairs.erase(same.begin(), same.end());
  return pairs;
}

}  // namespace

template <int Dim> Vector feature_size(const FineMesh<Dim>& mesh, double largest) {
  check_length(largest, "the largest feature");
  Vector size = Vector::Constant(mesh.num_vertices(), infinity);
  add_bends(mesh, largest, size);
  add_thickness(mesh, largest, size);
  return size;
}

template <int Dim> Vector limit_growth(const FineMesh<Dim>& mesh, Vector spacing, double growth) {
  if (spacing.size() != mesh.num_vertices())
    throw InputError(
        fmt::format("cloud: {} spacings for {} vertices, expected one for each", spacing.size(), mesh.num_vertices()));
  if (!(growth > 0.0)) throw InputError(fmt::format("cloud: growth is {}, expected a positive number", growth));
  const auto across = twins(mesh);
  Queue queue;
  const double top = spacing.maxCoeff();
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (spacing[v] < top) queue.push({spacing[v], v});
  while (!queue.empty()) {
    const auto [s, v] = queue.top();
    queue.pop();
    if (s > spacing[v]) continue;
    const auto limit = [&, s = s, v = v](Index w) {
      const double allowed = s + growth * (mesh.vertex(w) - mesh.vertex(v)).norm();
      if (allowed >= spacing[w]) return;
      spacing[w] = allowed;
      queue.push({allowed, w});
    };
    for_each_neighbour(mesh, v, limit);
    for (const auto& [from, to] : std::ranges::equal_range(across, v, {}, &std::pair<Index, Index>::first)) limit(to);
  }
  return spacing;
}

template <int Dim> Vector graded_spacing(const FineMesh<Dim>& mesh, double spacing, const Grading& grading) {
  check_length(spacing, "spacing");
  if (!(grading.least >= 1.0))
    throw InputError(fmt::format("cloud: least is {} fine edges, expected 1 or more", grading.least));
  check_length(grading.scale, "the scale of all spacings");
  Vector out = Vector::Constant(mesh.num_vertices(), spacing);
  if (grading.features) {
    const Vector size = feature_size(mesh, 4.0 * spacing);
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (size[v] < 4.0 * spacing)
        out[v] = std::clamp(0.5 * std::sqrt(size[v] * spacing), std::min(spacing, grading.least * mean_edge(mesh, v)),
                            spacing);
  }
  for (const SpacingBox& box : grading.boxes) {
    check_length(box.spacing, "the spacing of a box");
    const Vec<Dim> low = Eigen::Map<const Eigen::Vector3d>(box.low.data()).template head<Dim>(),
                   high = Eigen::Map<const Eigen::Vector3d>(box.high.data()).template head<Dim>();
    bool empty = true;
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const Vec<Dim> x = mesh.vertex(v);
      if ((x.array() < low.array()).any() || (x.array() > high.array()).any()) continue;
      lower(mesh, v, box.spacing, "in a box", out);
      empty = false;
    }
    if (empty)
      throw InputError(fmt::format("cloud: the box from ({:.6g}) to ({:.6g}) holds no vertex of the fine mesh",
                                   fmt::join(low, ", "), fmt::join(high, ", ")));
  }
  for (const SpacingRegion& part : grading.regions) {
    check_length(part.spacing, "the spacing of a region");
    const Index region = mesh.region(part.region);
    const std::string where = fmt::format("in region \"{}\"", part.region);
    for (Index c = 0; c < mesh.num_cells(); ++c)
      if (mesh.region(c) == region)
        for (int i = 0; i <= Dim; ++i)
          if (const Index v = mesh.cells()(i, c); out[v] > part.spacing) lower(mesh, v, part.spacing, where, out);
  }
  for (const SpacingBoundary& part : grading.boundaries) {
    check_length(part.spacing, "the spacing of a boundary");
    const std::string where = fmt::format("on boundary \"{}\"", part.boundary);
    for (const Index f : mesh.group(part.boundary))
      for (int k = 0; k < Dim; ++k)
        if (const Index v = mesh.facets()(k, f); out[v] > part.spacing) lower(mesh, v, part.spacing, where, out);
  }
  if (grading.features || grading.has_places()) out = limit_growth(mesh, std::move(out), grading.growth);
  return grading.scale * out;
}

template Vector feature_size<2>(const FineMesh<2>&, double);
template Vector feature_size<3>(const FineMesh<3>&, double);
template Vector limit_growth<2>(const FineMesh<2>&, Vector, double);
template Vector limit_growth<3>(const FineMesh<3>&, Vector, double);
template Vector graded_spacing<2>(const FineMesh<2>&, double, const Grading&);
template Vector graded_spacing<3>(const FineMesh<3>&, double, const Grading&);

}  // namespace efree
