// SPDX-License-Identifier: GPL-3.0-or-later
/// Which cell holds a point.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <memory>
#include <optional>

namespace efree {

/// A cell and barycentric coordinates in it.
template <int Dim> struct Location {
  Index cell;
  Eigen::Matrix<double, Dim + 1, 1> at;
};

/// Finds the cells that hold points, many on the same mesh: by a tree of the cells' boxes.
template <int Dim> class Locator {
 public:
  /// Keeps a reference to the mesh. `points`: how many are to be found; for a few, walking all cells takes less time
  /// than making the tree.
  explicit Locator(const FineMesh<Dim>& mesh, std::size_t points = 1000);
  ~Locator();
  Locator(Locator&&) noexcept;

  /// Of several cells that hold the point the first; a point outside by rounding (1e-9 in barycentric coordinates)
  /// belongs to the cell it is least outside of. A point outside by at most 1e-6 of the diagonal of the mesh's box, or
  /// by what facets are off a convex curve (angles between them below 30 degrees), is taken at the nearest point of the
  /// boundary. Throws InputError (with the nearest vertex) if it lies outside the body.
  Location<Dim> operator()(const Vec<Dim>& x) const;
  /// The same for a point that is in a cell, but for rounding; nothing for others.
  std::optional<Location<Dim>> find(const Vec<Dim>& x) const;

 private:
  struct Tree;
  std::optional<Location<Dim>> beside_boundary(const Vec<Dim>& x) const;
  const FineMesh<Dim>* mesh_;
  std::unique_ptr<const Tree> tree_;  ///< none: cells are walked
};

/// The same for a single point, by walking all cells.
template <int Dim> Location<Dim> locate(const FineMesh<Dim>& mesh, const Vec<Dim>& x) {
  return Locator<Dim>(mesh, 1)(x);
}

}  // namespace efree
