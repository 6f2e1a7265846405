// SPDX-License-Identifier: GPL-3.0-or-later
/// Vertices of a mesh that is cut out of a lattice.
#pragma once

#include "efree/geometry/meshing/internal/lattice_points.hpp"

#include <algorithm>
#include <bit>
#include <vector>

namespace efree::internal {

/// The lattice with the vertices that its points, edges, faces and tetrahedra have in the mesh.
class LatticeVertices : public LatticePoints {
 public:
  using LatticePoints::LatticePoints;

  /// Once edges are cut: numbers vertices and cells. Throws InputError if there are too many, NumericalError if there
  /// are none.
  void number_vertices();
  /// Sets the vertices of the mesh, and which of them are points of the lattice.
  void place_vertices(LatticeMesh& out) const;

 protected:
  /// A point in which parts of the body touch that do not hang together around it: one vertex for each part.
  struct Split {
    std::size_t point;
    std::int64_t first_copy;            // of the second part
    std::array<std::uint8_t, 24> part;  // by tetrahedron of the star
    int parts;
  };
  static constexpr std::uint32_t split_bit = 1u << num_bits;

  static bool is_uniform(const std::array<Label, 8>& corner) {
    return corner[0] != on_boundary &&
           std::all_of(corner.begin() + 1, corner.end(), [&](Label l) { return l == corner[0]; });
  }
  /// The pieces of a tetrahedron.
  static const Subdivision& subdivision_of(const std::array<Label, 8>& corner, const KuhnTet& tet);
  /// The vertex of a point of tetrahedron `number` of a cube.
  Index vertex(std::size_t cube, int number, std::uint8_t point) const;

  std::vector<std::uint32_t> bits_;         ///< by point: the vertices that it is the lowest corner of
  std::vector<std::vector<Split>> splits_;  ///< by plane, ascending
  std::vector<Index> first_vertex_;         ///< by point
  std::vector<std::int64_t> first_cell_;    ///< by plane
  std::int64_t num_main_ = 0, num_vertices_ = 0, num_cells_ = 0;

 private:
  /// Region of a piece of a tetrahedron.
  Label region_of(std::size_t cube, const KuhnTet& tet, int owner) const;
  /// Bits of the vertices that a point is the lowest corner of.
  std::uint32_t entities(const std::array<Index, 3>& at, std::size_t point, std::vector<Split>& splits) const;
  std::uint32_t vertex_on_boundary(const std::array<Index, 3>& at, std::size_t point, std::vector<Split>& splits) const;
  int count_cells(std::size_t cube) const;
  /// Where three or four regions meet: the mean of the cuts around, in barycentric coordinates, off the sides.
  Vec<3> junction(std::size_t point, int bit, const Vec<3>& u) const;
};

}  // namespace efree::internal
