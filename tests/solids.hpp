// SPDX-License-Identifier: GPL-3.0-or-later
/// Solid bodies that the tests share, as plain meshes: no mesher in between.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace efree::testing {

inline const std::vector<std::string> box_sides{"left", "right", "front", "back", "bottom", "top"};

/// The box [0, 1]^3 in n^3 cubes of six tetrahedra each (Kuhn 1960), inner vertices moved by up to `jitter` of the edge
/// of a cube; sides left, right (x), front, back (y), bottom, top (z).
inline MeshData<3> box(Index n, double jitter = 0.2, std::uint64_t seed = 1) {
  const Index side = n + 1;
  const auto number = [&](Index i, Index j, Index k) { return (k * side + j) * side + i; };
  MeshData<3> data;
  data.vertices.resize(3, side * side * side);
  std::mt19937_64 generator(seed);
  const auto random = [&] { return 2.0 * static_cast<double>(generator() >> 11) * 0x1.0p-53 - 1.0; };
  for (Index k = 0; k <= n; ++k)
    for (Index j = 0; j <= n; ++j)
      for (Index i = 0; i <= n; ++i) {
        Vec<3> x = Vec<3>(i, j, k) / n;
        const std::array<Index, 3> at{i, j, k};
        for (int d = 0; d < 3; ++d)
          if (at[d] > 0 && at[d] < n) x[d] += jitter / n * random();
        data.vertices.col(number(i, j, k)) = x;
      }
  data.cells.resize(4, 6 * n * n * n);
  Index cell = 0;
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) {
        std::array<int, 3> axes{0, 1, 2};
        do {  // from one corner of the cube to the opposite one along the axes in every order
          std::array<Index, 3> at{i, j, k};
          data.cells(0, cell) = number(at[0], at[1], at[2]);
          for (int step = 0; step < 3; ++step) {
            ++at[axes[step]];
            data.cells(step + 1, cell) = number(at[0], at[1], at[2]);
          }
          ++cell;
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
  return data;
}

/// Names the boundary facets that lie on the sides of the unit box.
inline FineMesh<3> with_sides(MeshData<3> data) {
  const FineMesh<3> bare(data);
  for (int side = 0; side < 6; ++side) {
    data.groups.push_back({box_sides[side], {}});
    for (Index f = 0; f < bare.num_facets(); ++f) {
      bool on_side = true;
      for (int k = 0; k < 3; ++k) on_side = on_side && bare.vertices()(side / 2, bare.facets()(k, f)) == side % 2;
      if (on_side) data.groups.back().facets.push_back({bare.facets()(0, f), bare.facets()(1, f), bare.facets()(2, f)});
    }
  }
  return FineMesh<3>(data);
}

/// Every third cell split in four at a point so near to the centre of its first facet that the cell there has dihedral
/// angles of about `degrees` to that facet.
inline MeshData<3> with_flat_cells(MeshData<3> data, double degrees) {
  const Index cells = static_cast<Index>(data.cells.cols()), vertices = static_cast<Index>(data.vertices.cols()),
              added = (cells + 2) / 3;
  data.vertices.conservativeResize(3, vertices + added);
  data.cells.conservativeResize(4, cells + 3 * added);
  for (Index k = 0; k < added; ++k) {
    const Eigen::Vector4i cell = data.cells.col(3 * k);
    const Vec<3> a = data.vertices.col(cell[1]), b = data.vertices.col(cell[2]), c = data.vertices.col(cell[3]),
                 apex = data.vertices.col(cell[0]);
    const Vec<3> normal = (b - a).cross(c - a);
    const double lengths = (b - a).norm() + (c - b).norm() + (a - c).norm();
    const double inradius = normal.norm() / lengths;
    const Vec<3> centre = ((c - b).norm() * a + (a - c).norm() * b + (b - a).norm() * c) / lengths;
    const double height = std::abs(normal.normalized().dot(apex - a));
    const double share = inradius * std::tan(degrees * std::numbers::pi / 180.0) / height;
    data.vertices.col(vertices + k) = centre + share * (apex - centre);
    data.cells.col(3 * k)[0] = vertices + k;
    for (int i = 1; i < 4; ++i) {
      data.cells.col(cells + 3 * k + i - 1) = cell;
      data.cells.col(cells + 3 * k + i - 1)[i] = vertices + k;
    }
  }
  return data;
}

/// Inner facets of a mesh whose vertices all satisfy `on`.
inline std::vector<std::array<Index, 3>> facets_where(const MeshData<3>& data,
                                                      const std::function<bool(const Vec<3>&)>& on) {
  std::vector<std::array<Index, 3>> facets;
  const FineMesh<3> mesh(data);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (Index i = 0; i < 4; ++i) {
      if (mesh.neighbour(i, c) < c) continue;  // the boundary, and every facet once
      std::array<Index, 3> facet{};
      bool all = true;
      for (int k = 0, at = 0; k < 4; ++k)
        if (k != i) {
          facet[at++] = mesh.cells()(k, c);
          all = all && on(mesh.vertex(mesh.cells()(k, c)));
        }
      if (all) facets.push_back(facet);
    }
  return facets;
}

/// The box with a slit in the plane x = 1/2 from the bottom to z = 1/2 (n even).
inline FineMesh<3> slit_box(Index n) {
  MeshData<3> data = box(n, 0.2);
  const Index side = n + 1;
  for (Index v = 0; v < data.vertices.cols(); ++v) {
    if (v % side != n / 2) continue;
    data.vertices(0, v) = 0.5;
    if (v / (side * side) == n / 2) data.vertices(2, v) = 0.5;
  }
  const auto slit = facets_where(data, [](const Vec<3>& x) { return x.x() == 0.5 && x.z() <= 0.5; });
  data.groups.push_back({"slit", slit});
  return with_sides(cut_open<3>(data, slit));
}

/// Solids by name: box, flat_cells (the box with dihedral angles of half a degree), slit_box.
inline FineMesh<3> solid(const std::string& name) {
  if (name == "box") return with_sides(box(8));
  if (name == "flat_cells") return with_sides(with_flat_cells(box(8), 0.5));
  if (name == "slit_box") return slit_box(8);
  throw std::invalid_argument("no solid named " + name);
}

/// Smallest dihedral angle [degrees].
inline double smallest_dihedral_angle(const FineMesh<3>& mesh) {
  double least = 180.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto gradients = mesh.hat_gradients(c);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j) {
        const double cosine = -gradients.col(i).normalized().dot(gradients.col(j).normalized());
        least = std::min(least, std::acos(std::clamp(cosine, -1.0, 1.0)) * 180.0 / std::numbers::pi);
      }
  }
  return least;
}

}  // namespace efree::testing
