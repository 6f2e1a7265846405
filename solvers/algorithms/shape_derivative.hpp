// SPDX-License-Identifier: GPL-3.0-or-later
/// What the faceted approximation of a curved boundary changes: by the derivative of energies and functionals with
/// respect to the shape (Sokolowski & Zolesio 1992).
#pragma once

#include "efree/assembly/materials.hpp"
#include "efree/geometry/mesh/boundary_offsets.hpp"
#include "efree/solvers/algorithms/functional.hpp"

#include <memory>
#include <vector>

namespace efree {

/// A change, to first order in the distance between facets and surface, if the boundary moves from the facets to the
/// true surface of the body.
struct ShapeChange {
  double sum = 0.0;        ///< with its sign
  double magnitude = 0.0;  ///< sum of the absolute values that facets contribute by stresses, not by loads

  /// An estimate of its size that does not trust cancellation beyond a twentieth.
  double size() const;
};

/// Changes of the numbers of linear elastic answers on one mesh, by linear combinations of the displacement's
/// derivatives along the facets: those across them follow from the traction on the facet. On facets that are held
/// rigidly, and on those between regions, they are those of the displacement in the cell.
template <int Dim> class ShapeDerivative {
 public:
  /// `offsets`: facet_offsets of the space's mesh. Keeps references to space and materials; shares nothing else. Throws
  /// InputError for a part of the boundary that does not exist.
  ShapeDerivative(const FineSpace<Dim>& space, const Matrix& offsets, const Materials<Dim>& materials,
                  const std::vector<DisplacementCondition<Dim>>& conditions, const std::vector<TiedFacets>& ties);
  ~ShapeDerivative();
  ShapeDerivative(ShapeDerivative&&) noexcept;

  /// Whether facets and surface are the same.
  bool is_flat() const;
  /// Of the potential energy, int (sigma : eps / 2) dV - work of the loads, at equilibrium; minus that of the strain
  /// energy where loads and not displacements are prescribed. `u`: Dim x space.size(). Followers are left out, and what
  /// springs store at the boundary.
  ShapeChange potential_energy(const Points<Dim>& u, const Loads<Dim>& loads) const;
  /// Of a functional of the displacement u, by its dual solution z (DualSolution).
  ShapeChange functional(const Points<Dim>& u, const Points<Dim>& z, const Loads<Dim>& loads) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace efree
