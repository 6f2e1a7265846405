// SPDX-License-Identifier: GPL-3.0-or-later
/// Cracks of a body that moved apart, as a mesh: edges that were stretched too far are cut, and cells fall into the
/// pieces of their vertices (Wang, Ding, Gast, Zhu, Gagniere, Jiang & Teran 2019).
#pragma once

#include "efree/geometry/cracks/point_mesh.hpp"

#include <memory>
#include <vector>

namespace efree {

struct CrackOptions {
  double stretch = 2.0;  ///< an edge is cut for ever once it is longer than so many times its length at the start
  int smoothing = 10;    ///< sweeps that make the faces of cracks even
};

/// A body with its cracks at one time. Nodes are the vertices of the mesh, then those on faces of cracks: each there
/// once for every group of vertices of its edge, face or cell that uncut edges still join.
template <int Dim> struct CrackedMesh {
  Points<Dim> reference, current;  ///< positions of nodes at the start, on faces of cracks smoothed, and now
  Cells<Dim> cells;                ///< of nodes; they tile the body, each positive but for rounding in flat ones
  std::vector<Index> part;         ///< by cell: which of the parts that hang together by uncut edges it is of
  Ragged<Index> vertices;          ///< by node: the vertices it belongs to; values at it are their means
  Facets<Dim> surface;             ///< of nodes, outwards: what the cells have on one side only
  std::vector<char> is_crack;      ///< by facet of the surface: whether it is the face of a crack
  Vector volumes;                  ///< by part, in the reference configuration; from large to small
  double crack_area = 0.0;         ///< of one of both faces, in the reference configuration (in the plane a length)
};

/// Follows a body through time. Edges belong to the points that their ends move with: all edges between the same two
/// points are cut together, by how far these have moved apart.
template <int Dim> class CrackedBody {
 public:
  /// Throws InputError for options out of range and cells or owners that are no vertices or points.
  explicit CrackedBody(PointMesh<Dim> mesh, const CrackOptions& options = {});
  ~CrackedBody();
  CrackedBody(CrackedBody&&) noexcept;

  /// Moves the points to these positions, Dim x points, and cuts the edges that are too long by now.
  void move(const Points<Dim>& points);
  /// Pieces meet at smoothed middles X of edges, faces and cells, which are at the mean over a group's vertices v of
  /// x_v + F_v (X - X_v): F_v is fitted to the points around that uncut edges join v's point to.
  CrackedMesh<Dim> mesh() const;

  Index num_edges() const;
  Index num_cut_edges() const;
  /// The largest stretch of an edge between two points that is not cut.
  double largest_stretch() const;

 private:
  struct Topology;
  std::unique_ptr<Topology> topology_;
  CrackOptions options_;
  Points<Dim> x_;             // of vertices
  std::vector<Mat<Dim>> F_;   // by vertex
  std::vector<char> is_cut_;  // by edge
  double largest_stretch_ = 1.0;
};

}  // namespace efree
