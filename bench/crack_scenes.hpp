// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that crack in known ways, and what must hold of their meshes, for tests and benchmarks.
#pragma once

#include "efree/geometry/cracks/cracked_body.hpp"
#include "efree/geometry/mesh/internal/signed_volume.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <utility>
#include <vector>

namespace efree::bench {

/// Points moved along all axes at random, by up to `amplitude`.
template <int Dim> Points<Dim> in_disorder(Points<Dim> points, double amplitude, std::uint64_t seed = 7) {
  std::mt19937_64 generator(seed);
  for (double& x : points.reshaped()) x += amplitude * (2.0 * static_cast<double>(generator() >> 11) * 0x1.0p-53 - 1.0);
  return points;
}
/// Points in the middles of n^Dim cells of the unit square (cube), moved by up to `jitter` of a cell.
template <int Dim> Points<Dim> points_in_unit_box(Index n, double jitter) {
  const Index count = Dim == 2 ? n * n : n * n * n;
  Points<Dim> points(Dim, count);
  for (Index p = 0; p < count; ++p)
    for (Index i = 0, rest = p; i < Dim; ++i, rest /= n)
      points(i, p) = (static_cast<double>(rest % n) + 0.5) / static_cast<double>(n);
  return in_disorder<Dim>(std::move(points), jitter / static_cast<double>(n), 1);
}

template <int Dim> Vector volumes_of_cells(const Points<Dim>& x, const Cells<Dim>& cells) {
  Vector result(cells.cols());
  for (Index c = 0; c < cells.cols(); ++c) result[c] = internal::signed_volume<Dim>(x, cells, c);
  return result;
}

/// What is wrong with a mesh of a cracked body: all of it is zero but for rounding.
struct CrackFaults {
  double tiling = 0.0;     ///< error of the volume in the reference configuration, over it
  Index inverted = 0;      ///< cells of negative volume there, by more than rounding
  Index open_edges = 0;    ///< of the surface (in the plane its vertices), which others do not close
  Index wrong_parts = 0;   ///< parts that facets do not join, or that they join to others
  Index inner_facets = 0;  ///< facets of the surface that two cells share, and of one cell that are not on it
};
template <int Dim> CrackFaults find_faults(const CrackedMesh<Dim>& mesh, double volume) {
  CrackFaults faults;
  const Vector volumes = volumes_of_cells<Dim>(mesh.reference, mesh.cells);
  faults.tiling = std::abs(volumes.sum() / volume - 1.0);
  faults.inverted = static_cast<Index>((volumes.array() < -1e-15 * volume).count());

  std::map<std::vector<Index>, Index> sides;  // of the surface: facets that run along them, less those against them
  std::set<std::array<Index, Dim>> surface;
  for (Index f = 0; f < mesh.surface.cols(); ++f) {
    std::array<Index, Dim> facet;
    for (int i = 0; i < Dim; ++i) {
      facet[i] = mesh.surface(i, f);
      if constexpr (Dim == 2) {
        sides[{mesh.surface(i, f)}] += i == 0 ? 1 : -1;
      } else {
        const Index a = mesh.surface(i, f), b = mesh.surface((i + 1) % 3, f);
        sides[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
      }
    }
    std::ranges::sort(facet);
    if (!surface.insert(facet).second) ++faults.inner_facets;
  }
  for (const auto& [side, sum] : sides) faults.open_edges += sum != 0;

  // Cells by facets.
  std::map<std::array<Index, Dim>, std::vector<Index>> cells;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    for (int k = 0; k <= Dim; ++k) {
      std::array<Index, Dim> facet;
      for (int i = 0, j = 0; i <= Dim; ++i)
        if (i != k) facet[j++] = mesh.cells(i, c);
      std::ranges::sort(facet);
      cells[facet].push_back(c);
    }
  std::vector<Index> first(mesh.cells.cols());
  for (Index c = 0; c < mesh.cells.cols(); ++c) first[c] = c;
  const auto find = [&](Index c) {
    while (first[c] != c) c = first[c] = first[first[c]];
    return c;
  };
  for (const auto& [facet, of] : cells) {
    faults.inner_facets += (of.size() == 1) != surface.contains(facet) || of.size() > 2;
    for (const Index c : of) first[find(c)] = find(of[0]);
  }
  std::map<Index, Index> part_of_first;
  std::map<Index, Index> first_of_part;
  for (Index c = 0; c < mesh.cells.cols(); ++c) {
    faults.wrong_parts += part_of_first.try_emplace(find(c), mesh.part[c]).first->second != mesh.part[c];
    faults.wrong_parts += first_of_part.try_emplace(mesh.part[c], find(c)).first->second != find(c);
  }
  return faults;
}

/// Half of the unit box beyond a plane through it moves away along the normal by `opening`.
template <int Dim> Points<Dim> torn_by_plane(Points<Dim> points, const Vec<Dim>& normal, double level, double opening) {
  for (Index p = 0; p < points.cols(); ++p)
    if (normal.dot(points.col(p)) > level) points.col(p) += opening * normal;
  return points;
}
/// Area of the plane through the middle of the unit cube (square) with the normal (1, slope, slope), which leaves it
/// through none of the sides x = 0, 1.
template <int Dim> double section_of_unit_box(double slope) {
  return std::sqrt(1.0 + (Dim - 1) * slope * slope);
}

}  // namespace efree::bench
