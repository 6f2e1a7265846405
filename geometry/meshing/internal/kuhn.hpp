// SPDX-License-Identifier: GPL-3.0-or-later
/// How cubes fall into tetrahedra, and tetrahedra into pieces of one label each.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace efree::internal {

/// Bits of the edges, faces and inner points of which a lattice point is the lowest corner: first the point itself,
/// then its seven edges by the mask of the axes they go along, its twelve faces, its six tetrahedra.
constexpr int first_edge_bit = 1, first_face_bit = 8, first_cell_bit = 20, num_bits = 26;

/// One of the six tetrahedra of a cube: from its lowest corner along three axes, one after the other, to the opposite
/// one (Kuhn 1960). Corners of a cube are masks of axes. Points of a tetrahedron are masks of its corners: the point on
/// an edge, in a face or inside it has the bits of the corners around it.
struct KuhnTet {
  std::array<std::uint8_t, 3> axes;
  std::array<std::uint8_t, 4> corner;      ///< of the cube, ascending in the lattice
  bool is_odd;                             ///< negatively oriented
  std::array<std::uint8_t, 16> owner;      ///< by point: the cube's corner that it belongs to
  std::array<std::uint8_t, 16> bit;        ///< by point: its bit there
  std::array<std::uint8_t, 4> beyond;      ///< number of the tetrahedron across the face opposite corner i
  std::array<std::int8_t, 4> beyond_axis;  ///< the axis along which its cube is the next (i = 0) or previous one; or -1
};
const std::array<KuhnTet, 6>& kuhn_tets();

/// A face of twelve: from a point along the axes of `middle`, then on to those of `far`.
struct KuhnFace {
  std::uint8_t middle, far;
};
const std::array<KuhnFace, 12>& kuhn_faces();

/// The 24 tetrahedra around a lattice point, and which of them are next to each other.
struct KuhnStar {
  struct Tet {
    std::uint8_t tet;                  ///< of its cube
    std::uint8_t corner;               ///< which of its corners the point is
    std::array<std::uint8_t, 4> next;  ///< in the star, across the face opposite corner i; 24 for the point itself
  };
  std::array<Tet, 24> tets;
};
const KuhnStar& kuhn_star();

/// A tetrahedron whose corners have labels, or none: in pieces of one label each. Two tetrahedra with a common face cut
/// it alike. Corners without a label are on the boundary between the others' and belong to the pieces around them.
struct Subdivision {
  struct Piece {
    std::array<std::uint8_t, 4> points;  ///< positively oriented, if the tetrahedron is
    std::uint8_t owner;                  ///< a corner with its label; 4: no corner has a label
  };
  struct Interface {
    std::array<std::uint8_t, 3> points;
    std::uint8_t owner, other;  ///< corners with the labels of the two sides
  };
  struct Outer {
    std::array<std::uint8_t, 3> points;
    std::uint8_t owner;
    std::uint8_t face;  ///< of the tetrahedron: the corner opposite
    bool is_whole;      ///< no corner of the face has a label
  };
  std::vector<Piece> pieces;
  std::vector<Interface> interfaces;
  std::vector<Outer> outer;  ///< in the faces of the tetrahedron
};
/// By what labels are equal: sum of 5^i times the class of corner i. Class 0: no label; the others are numbered from 1
/// in the order of their first corners.
const Subdivision& subdivision(int classes);

}  // namespace efree::internal
