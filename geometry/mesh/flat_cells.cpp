// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <utility>

namespace efree::internal {
namespace {

using Facet = std::array<Index, 3>;

/// Facet opposite vertex i of cell c, its vertices ascending.
Facet facet_of(const MeshData<3>& mesh, Index c, int i) {
  Facet facet;
  for (int k = 0; k < 3; ++k) facet[k] = mesh.cells((i + 1 + k) % 4, c);
  std::ranges::sort(facet);
  return facet;
}

/// Twice the area, normal to the facet.
Vec<3> area_vector(const MeshData<3>& mesh, const Facet& facet) {
  const Vec<3> a = mesh.vertices.col(facet[0]);
  return (mesh.vertices.col(facet[1]) - a).cross(mesh.vertices.col(facet[2]) - a);
}

std::vector<Index> flat_cells(const MeshData<3>& mesh) {
  std::vector<Index> flat;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    if (flatness<3>(mesh.vertices, mesh.cells, c) < least_flatness) flat.push_back(c);
  return flat;
}

std::vector<char> vertices_of(const MeshData<3>& mesh, const std::vector<Index>& cells) {
  std::vector<char> is_of_one(mesh.vertices.cols(), 0);
  for (const Index c : cells)
    for (const Index v : mesh.cells.col(c)) is_of_one[v] = 1;
  return is_of_one;
}

/// Facets at vertex v, of cells `star` around it, that are on the boundary or between regions.
std::vector<Facet> surface_facets(const MeshData<3>& mesh, Index v, const std::vector<Index>& star) {
  std::vector<std::pair<Facet, Index>> sides;
  for (const Index c : star)
    for (int i = 0; i < 4; ++i)
      if (mesh.cells(i, c) != v) sides.emplace_back(facet_of(mesh, c, i), mesh.regions.empty() ? 0 : mesh.regions[c]);
  std::ranges::sort(sides);
  std::vector<Facet> facets;
  for (std::size_t s = 0; s < sides.size(); ++s)
    if (s + 1 < sides.size() && sides[s].first == sides[s + 1].first) {
      if (sides[s].second != sides[s + 1].second) facets.push_back(sides[s].first);
      ++s;
    } else
      facets.push_back(sides[s].first);
  return facets;
}

/// Projector on the directions in which a vertex of these facets stays in the plane of each.
Mat<3> within(const MeshData<3>& mesh, const std::vector<Facet>& facets) {
  constexpr double as_good_as_parallel = 1e-12;  // square of an angle
  if (facets.empty()) return Mat<3>::Identity();
  Mat<3> normals = Mat<3>::Zero();
  for (const Facet& facet : facets) {
    const Vec<3> normal = area_vector(mesh, facet).stableNormalized();
    normals += normal * normal.transpose();
  }
  const auto [shares, axes] = internal::spectrum<3>(normals);
  Mat<3> projector = Mat<3>::Zero();
  for (int k = 0; k < 3; ++k)
    if (shares[k] < as_good_as_parallel) projector += axes.col(k) * axes.col(k).transpose();
  return projector;
}

}  // namespace

template <int Dim> double flatness(const Points<Dim>& vertices, const Cells<Dim>& cells, Index c) {
  double longest = 0.0;
  for (int i = 0; i <= Dim; ++i)
    for (int j = 0; j < i; ++j)
      longest = std::max(longest, (vertices.col(cells(i, c)) - vertices.col(cells(j, c))).norm());
  Mat<Dim> edges;
  for (int k = 0; k < Dim; ++k) edges.col(k) = vertices.col(cells(k + 1, c)) - vertices.col(cells(0, c));
  return edges.determinant() / std::pow(longest, Dim);
}

void peel_flat_cells(MeshData<3>& mesh) {
  const std::vector<Index> flat = flat_cells(mesh);
  if (flat.empty()) return;
  const std::vector<char> is_near = vertices_of(mesh, flat);
  const auto is_facet_near = [&](const Facet& facet) {
    return std::ranges::all_of(facet, [&](Index v) { return is_near[v]; });
  };
  std::map<Facet, int> cells_at;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    for (int i = 0; i < 4; ++i)
      if (const Facet facet = facet_of(mesh, c, i); is_facet_near(facet)) ++cells_at[facet];
  using Place = std::pair<std::size_t, std::size_t>;  // group, position in it
  std::map<Facet, Place> place_of;
  std::set<std::pair<Index, Index>> boundary_edges;
  const auto add_edges = [&](const Facet& facet) {
    for (int k = 0; k < 3; ++k)
      if (is_near[facet[k]] && is_near[facet[(k + 1) % 3]])
        boundary_edges.insert(std::minmax(facet[k], facet[(k + 1) % 3]));
  };
  for (std::size_t g = 0; g < mesh.groups.size(); ++g)
    for (std::size_t f = 0; f < mesh.groups[g].facets.size(); ++f) {
      Facet facet = mesh.groups[g].facets[f];
      std::ranges::sort(facet);
      add_edges(facet);
      if (is_facet_near(facet)) place_of[facet] = {g, f};
    }

  const auto peel = [&](Index c) {
    std::vector<Facet> outer, inner;
    for (int i = 0; i < 4; ++i) {
      const Facet facet = facet_of(mesh, c, i);
      (cells_at.at(facet) == 1 && place_of.contains(facet) ? outer : inner).push_back(facet);
    }
    if (outer.size() != 2 || place_of.at(outer[0]).first != place_of.at(outer[1]).first) return false;
    std::vector<Index> ridge;  // the edge that comes to lie on the boundary
    std::ranges::set_intersection(inner[0], inner[1], std::back_inserter(ridge));
    if (boundary_edges.contains({ridge[0], ridge[1]})) return false;
    for (int k = 0; k < 2; ++k) {
      const Place place = place_of.at(outer[k]);
      place_of.erase(outer[k]);
      place_of[inner[k]] = place;
      add_edges(inner[k]);
      mesh.groups[place.first].facets[place.second] = inner[k];
      --cells_at[outer[k]];
      --cells_at[inner[k]];
    }
    return true;
  };
  // One below another comes to the boundary with it.
  std::vector<char> is_gone(mesh.cells.cols(), 0);
  for (bool again = true; again;) {
    again = false;
    for (const Index c : flat)
      if (!is_gone[c] && peel(c)) {
        is_gone[c] = 1;
        again = true;
      }
  }
  std::vector<Index> kept;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    if (!is_gone[c]) kept.push_back(c);
  mesh.cells = Cells<3>(mesh.cells(Eigen::all, kept));
  if (!mesh.regions.empty()) {
    for (std::size_t k = 0; k < kept.size(); ++k) mesh.regions[k] = mesh.regions[kept[k]];
    mesh.regions.resize(kept.size());
  }
}

void inflate_flat_cells(MeshData<3>& mesh, double reach, const std::vector<char>& is_fixed) {
  constexpr int most_passes = 50, halvings = 8;
  constexpr double rounding = 1e-12;
  std::map<Index, std::vector<Index>> stars;
  std::map<Index, Vec<3>> off_surface;  // by vertex: sum of such moves
  const auto flatness_of = [&](Index c) { return flatness<3>(mesh.vertices, mesh.cells, c); };

  // Makes the best of all moves of its vertices, if that is better than none.
  const auto improve = [&](Index cell, bool along_surface) {
    std::vector<Index> around;
    double longest = 0.0;
    Vec<3> normal = Vec<3>::Zero();
    for (int i = 0; i < 4; ++i) {
      const auto& star = stars.at(mesh.cells(i, cell));
      around.insert(around.end(), star.begin(), star.end());
      for (int j = 0; j < i; ++j)
        longest =
            std::max(longest, (mesh.vertices.col(mesh.cells(i, cell)) - mesh.vertices.col(mesh.cells(j, cell))).norm());
      const Vec<3> area = area_vector(mesh, facet_of(mesh, cell, i));
      if (area.squaredNorm() > normal.squaredNorm()) normal = area;
    }
    normal.stableNormalize();
    std::ranges::sort(around);
    around.erase(std::unique(around.begin(), around.end()), around.end());
    const auto quality = [&] {
      std::vector<double> values;
      for (const Index c : around) {
        const double value = flatness_of(c);
        values.push_back(std::abs(value) < rounding ? 0.0 : value);
      }
      std::ranges::sort(values);
      return values;
    };
    std::vector<double> best = quality();
    Index moved = -1;
    Vec<3> best_move;
    for (const Index v : mesh.cells.col(cell)) {
      if (is_fixed[v]) continue;
      const Vec<3> from = mesh.vertices.col(v), off = off_surface.try_emplace(v, Vec<3>::Zero()).first->second;
      const Vec<3> direction =
          along_surface ? (within(mesh, surface_facets(mesh, v, stars.at(v))) * normal).eval() : normal;
      if (direction.norm() < 1e-3) continue;
      double step = along_surface ? 0.25 * longest : reach;
      for (int k = 0; k < halvings; ++k, step /= 2)
        for (const double sign : {-1.0, 1.0}) {
          const Vec<3> move = sign * step * direction.normalized();
          if (!along_surface && (off + move).norm() > reach * (1.0 + rounding)) continue;
          mesh.vertices.col(v) = from + move;
          if (auto found = quality(); found > best) {
            best = std::move(found);
            moved = v;
            best_move = move;
          }
        }
      mesh.vertices.col(v) = from;
    }
    if (moved < 0) return false;
    mesh.vertices.col(moved) += best_move;
    if (!along_surface) off_surface.at(moved) += best_move;
    return true;
  };
  bool any = true;
  for (int pass = 0;; ++pass) {
    // Anew each time: what lifts one cell may leave a neighbour flat that was not, only the least of them rises.
    const std::vector<Index> flat = flat_cells(mesh);
    if (flat.empty()) return;
    if (!any || pass > most_passes) {
      const Vec<3> at = mesh.vertices.col(mesh.cells(0, flat[0]));
      throw NumericalError(
          fmt::format("mesh: the cell at ({:g}, {:g}, {:g}) has no volume, and none of its vertices can move", at.x(),
                      at.y(), at.z()));
    }
    const std::vector<char> is_near = vertices_of(mesh, flat);
    stars.clear();
    for (Index c = 0; c < mesh.cells.cols(); ++c)
      for (const Index v : mesh.cells.col(c))
        if (is_near[v]) stars[v].push_back(c);
    any = false;
    for (const Index c : flat)
      for (const bool along_surface : {true, false})
        if (flatness_of(c) < least_flatness) any = improve(c, along_surface) || any;
  }
}

template double flatness<2>(const Points<2>&, const Cells<2>&, Index);
template double flatness<3>(const Points<3>&, const Cells<3>&, Index);

}  // namespace efree::internal
