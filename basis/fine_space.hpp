// SPDX-License-Identifier: GPL-3.0-or-later
/// Lagrange functions on the fine mesh: the space every basis of the library lives in.
#pragma once

#include "efree/geometry/fine_mesh.hpp"

#include <span>

namespace efree {

/// Quadrature on a simplex: barycentric points and weights that sum to 1.
template <int Dim> struct SimplexRule {
  Eigen::Matrix<double, Dim + 1, Eigen::Dynamic> points;
  Vector weights;
};
/// Exact for polynomials of the degree, 1 to 5. Throws InputError beyond.
template <int Dim> SimplexRule<Dim> simplex_rule(int degree);

/// Continuous piecewise polynomials of degree 1 or 2. Degrees of freedom: the vertices, then the midpoints of the
/// edges.
template <int Dim> class FineSpace {
 public:
  static constexpr int max_cell_size = (Dim + 1) * (Dim + 2) / 2;
  using CellValues = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_cell_size, 1>;
  using CellGradients = Eigen::Matrix<double, Dim, Eigen::Dynamic, 0, Dim, max_cell_size>;
  using Barycentric = Eigen::Matrix<double, Dim + 1, 1>;

  FineSpace() = default;
  /// Keeps a pointer to the mesh. Throws InputError unless degree is 1 or 2.
  FineSpace(const FineMesh<Dim>& mesh, int degree);

  const FineMesh<Dim>& mesh() const { return *mesh_; }
  int degree() const { return degree_; }
  Index size() const { return static_cast<Index>(points_.cols()); }
  const Points<Dim>& points() const { return points_; }
  /// Degrees of freedom of cell c: its vertices, then (degree 2) the midpoints of edges (0,1), (0,2), (1,2), ...
  std::span<const Index> cell(Index c) const;
  /// Degrees of freedom on boundary facet f, each once.
  std::vector<Index> facet(Index f) const;

  /// Values of the cell's functions at a barycentric point.
  CellValues values(const Barycentric& at) const;
  /// Gradients of the cell's functions [1/length].
  CellGradients gradients(Index c, const Barycentric& at) const;
  /// Position of a barycentric point of cell c.
  Vec<Dim> position(Index c, const Barycentric& at) const;
  /// Barycentric coordinates in cell facet_cell(f) of a point given by those on facet f.
  Barycentric facet_point(Index f, const Eigen::Matrix<double, Dim, 1>& at) const;

  /// Rule on cells that integrates one gradient times a function of the secondary basis exactly: the centroid for
  /// degree 1, Dim + 1 points for degree 2.
  const SimplexRule<Dim>& cell_rule() const { return cell_rule_; }
  /// Rule on boundary facets, exact to degree 5.
  const SimplexRule<Dim - 1>& facet_rule() const { return facet_rule_; }

 private:
  const FineMesh<Dim>* mesh_ = nullptr;
  int degree_ = 0;
  Points<Dim> points_;
  int cell_size_ = 0;
  std::vector<Index> cell_dofs_;
  SimplexRule<Dim> cell_rule_;
  SimplexRule<Dim - 1> facet_rule_;
};

}  // namespace efree
