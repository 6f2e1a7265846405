// SPDX-License-Identifier: GPL-3.0-or-later
/// Lagrange functions on the fine mesh: the space every basis of the library lives in.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

namespace efree {

/// Quadrature on a simplex: barycentric points and weights that sum to 1.
template <int Dim> struct SimplexRule {
  Eigen::Matrix<double, Dim + 1, Eigen::Dynamic> points;
  Vector weights;
};
/// Exact for polynomials of the degree, 1 to 5. Throws InputError beyond.
template <int Dim> SimplexRule<Dim> simplex_rule(int degree);

/// A mesh that somebody else keeps, as one that is shared.
template <int Dim> std::shared_ptr<const FineMesh<Dim>> borrowed(const FineMesh<Dim>& mesh) {
  return {std::shared_ptr<const void>(), &mesh};
}

/// Continuous piecewise polynomials of degree 1 or 2. Degrees of freedom: the vertices, then the midpoints of the
/// edges.
template <int Dim> class FineSpace {
 public:
  static constexpr int max_cell_size = (Dim + 1) * (Dim + 2) / 2;
  using CellValues = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_cell_size, 1>;
  using CellGradients = Eigen::Matrix<double, Dim, Eigen::Dynamic, 0, Dim, max_cell_size>;
  using Barycentric = Eigen::Matrix<double, Dim + 1, 1>;

  FineSpace() = default;
  /// Shares the mesh. Axisymmetric: the mesh is half of a meridian section, x the radius and y the axis. Throws
  /// InputError unless degree is 1 or 2, for a vertex at a negative radius, or for axisymmetry in 3D.
  FineSpace(std::shared_ptr<const FineMesh<Dim>> mesh, int degree, bool axisymmetric = false);
  /// Refers to the mesh, which must outlive it and its copies.
  FineSpace(const FineMesh<Dim>& mesh, int degree, bool axisymmetric = false)
      : FineSpace(borrowed(mesh), degree, axisymmetric) {}
  /// Takes the mesh.
  FineSpace(FineMesh<Dim>&& mesh, int degree, bool axisymmetric = false)
      : FineSpace(std::make_shared<const FineMesh<Dim>>(std::move(mesh)), degree, axisymmetric) {}

  const FineMesh<Dim>& mesh() const { return *mesh_; }
  const std::shared_ptr<const FineMesh<Dim>>& shared_mesh() const { return mesh_; }
  int degree() const { return degree_; }
  bool axisymmetric() const { return axisymmetric_; }
  Index size() const { return static_cast<Index>(points_.cols()); }
  const Points<Dim>& points() const { return points_; }
  /// Degrees of freedom of cell c: its vertices, then (degree 2) the midpoints of edges (0,1), (0,2), (1,2), ...
  std::span<const Index> cell(Index c) const;
  /// Ends of the edge that each degree of freedom beyond the vertices is the middle of; empty for degree 1.
  std::vector<std::array<Index, 2>> edges() const;
  /// Fields that jump between regions, as stresses do, have a value at every place: one at each degree of freedom,
  /// numbered alike, for the region of its first cell, and where regions share degrees of freedom one more for each of
  /// the others. With one region, and in meshes parted by cut_regions, places are degrees of freedom.
  Index num_places() const { return size() + static_cast<Index>(shared_.size()); }
  /// Places of cell c, in the order of cell(c).
  std::span<const Index> places(Index c) const;
  /// The place of a region that has a cell around the degree of freedom.
  Index place(Index dof, Index region) const;
  Index dof_at(Index place) const { return place < size() ? place : shared_[place - size()].first; }
  /// Values at the degrees of freedom (columns) as values at the places.
  Matrix at_places(const Eigen::Ref<const Matrix>& values) const;
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

  /// Volume (in 3D area) of the body that one unit of the mesh's volume (area) at x stands for: 2 pi r if axisymmetric,
  /// else 1. Every integral has it as a factor.
  double measure(const Vec<Dim>& x) const { return axisymmetric_ ? 2.0 * std::numbers::pi * std::max(0.0, x[0]) : 1.0; }

  /// Rule on cells that integrates one gradient times a function of the secondary basis exactly: the centroid for
  /// degree 1, Dim + 1 points for degree 2. Axisymmetric: one gradient times the measure.
  const SimplexRule<Dim>& cell_rule() const { return cell_rule_; }
  /// Volume of the body that cell c stands for, and its centre of mass.
  double volume(Index c) const { return mesh_->volume(c) * measure(mesh_->centroid(c)); }
  Vec<Dim> centre_of_mass(Index c) const;
  /// Volume of the body that point q of the cell rule stands for in cell c.
  double weight(Index c, Index q) const {
    const double flat = mesh_->volume(c) * cell_rule_.weights[q];
    return axisymmetric_ ? flat * measure(position(c, cell_rule_.points.col(q))) : flat;
  }
  /// Rule on boundary facets, exact to degree 5.
  const SimplexRule<Dim - 1>& facet_rule() const { return facet_rule_; }

 private:
  std::shared_ptr<const FineMesh<Dim>> mesh_;
  int degree_ = 0;
  bool axisymmetric_ = false;
  Points<Dim> points_;
  int cell_size_ = 0;
  std::vector<Index> cell_dofs_;
  std::vector<std::pair<Index, Index>> shared_;  // degree of freedom and region of the places beyond, ascending
  std::vector<Index> cell_places_;               // empty if places are degrees of freedom
  SimplexRule<Dim> cell_rule_;
  SimplexRule<Dim - 1> facet_rule_;
};

}  // namespace efree
