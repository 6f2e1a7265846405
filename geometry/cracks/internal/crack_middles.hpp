// SPDX-License-Identifier: GPL-3.0-or-later
/// The places at which the pieces of cut cells meet.
#pragma once

#include "efree/geometry/cracks/internal/skeleton.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// A place on an edge that is cut, or in a face or cell with such an edge.
template <int Dim> struct CrackMiddle {
  std::array<Index, Dim + 1> vertices{};  ///< `size` of them
  int size = 0;
  std::array<int, Dim + 1> group{};  ///< by vertex: the group of those that uncut edges join, from 0
  int groups = 0;
  std::array<double, Dim + 1> weights{};  ///< barycentric coordinates, all positive

  Vec<Dim> position(const Points<Dim>& x) const {
    Vec<Dim> result = Vec<Dim>::Zero();
    for (int i = 0; i < size; ++i) result += weights[i] * x.col(vertices[i]);
    return result;
  }
  int group_of(Index vertex) const {
    for (int i = 0; i < size; ++i)
      if (vertices[i] == vertex) return group[i];
    return -1;
  }
};

/// All of a mesh. Cracks consist of simplices between the middles of an edge, a face around it and a cell around that
/// (in the plane of an edge and a cell).
template <int Dim> class CrackMiddles {
 public:
  /// Middles of edges are halfway. Those of faces and cells that the crack divides are at the mean of those of their
  /// edges, so that it is plane in a face; where it ends inside they are at the centroid.
  CrackMiddles(const Cells<Dim>& cells, const Skeleton<Dim>& skeleton, const std::vector<char>& is_cut);

  /// Moves the middles of edges along these to make the area of the cracks less, one after the other, in so many sweeps
  /// over all. Pieces keep a positive volume, and both sides stay alike.
  void smooth(const Points<Dim>& vertices, int sweeps);
  /// The area of the cracks (in the plane their length).
  double area(const Points<Dim>& vertices) const;

  const std::vector<CrackMiddle<Dim>>& all() const { return middles_; }  ///< of edges first
  /// Its number, or -1 where nothing is cut.
  Index of_edge(Index edge) const { return of_edge_[edge]; }
  Index of_face(Index face) const { return of_face_[face]; }  ///< in space
  Index of_cell(Index cell) const { return of_cell_[cell]; }

 private:
  Index add(const CrackMiddle<Dim>& middle, const std::vector<Index>& edges);
  void place_among_edges(Index middle);

  std::vector<CrackMiddle<Dim>> middles_;
  Ragged<Index> edges_;                            // by middle: those of the edges of its face or cell that are cut
  std::vector<std::array<Index, Dim>> simplices_;  // middles: edge, (face,) cell
  std::vector<Index> of_edge_, of_face_, of_cell_;
};

}  // namespace efree::internal
