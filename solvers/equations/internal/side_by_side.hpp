// SPDX-License-Identifier: GPL-3.0-or-later
/// Several answers of one approximation side by side: what is stored of points and cells is read once for all of them.
#pragma once

#include "efree/assembly/operators.hpp"
#include "efree/basis/shape_table.hpp"

#include <array>
#include <vector>

namespace efree::internal {

constexpr Index most_side_by_side = 8;

/// Up to eight fields of a list: the numbers of all lanes for each component next to each other. One alone is not
/// copied, and has to outlive this.
template <int Rows> class SideBySide {
 public:
  /// Those from `first` on, as many as there is room for.
  SideBySide(const std::vector<const Points<Rows>*>& all, std::size_t first);
  Index count() const { return count_; }
  Index lanes() const { return lanes_; }  ///< 1, 4 or 8: no less than there are fields
  const double* data() const { return alone_ ? alone_->data() : values_.data(); }

 private:
  Index count_, lanes_;
  const Points<Rows>* alone_ = nullptr;
  std::vector<double> values_;
};
/// All of a list.
template <int Rows> std::vector<SideBySide<Rows>> side_by_side(const std::vector<const Points<Rows>*>& all) {
  std::vector<SideBySide<Rows>> parts;
  for (std::size_t first = 0; first < all.size(); first += most_side_by_side) parts.emplace_back(all, first);
  return parts;
}

/// What there is at a point, by component and lane.
template <int Dim> struct PointResponse {
  double strain[voigt_size<Dim> * most_side_by_side], stress[voigt_size<Dim> * most_side_by_side];
  double work[most_side_by_side];  ///< of the stress on the strain, per volume
};
/// Strains (in plane stress with those across it), stresses and work of displacements u where the row of a table has
/// gradients and a material is stiff. dilatations: by lane, of whoever has the pressure in the point's place; none: its
/// own.
template <int Dim> void respond(const SideBySide<Dim>& u, const ShapeRow<Dim>& row, const Stiffness<Dim>& stiffness,
                                const double* dilatations, PointResponse<Dim>& to);

/// A cell of finite elements whose material is the same everywhere.
template <int Dim> struct UniformCell {
  const Index *dofs, *places;
  std::array<const double*, Dim + 1> dN;  ///< gradients at its corners, by degree of freedom and direction
  const Stiffness<Dim>* stiffness;
  const double* root;         ///< of the mass matrix of a cell of volume 1: lower triangle, by columns
  const double* dilatations;  ///< as above
};
/// Squares of what recovered stresses are off those of displacements, and of these, in the energy norm, over the volume
/// of a cell; and the square of the largest displacement there.
struct CellSquares {
  double error[most_side_by_side], norm[most_side_by_side], displacement[most_side_by_side];
};
template <int Dim> void compare(const SideBySide<Dim>& displacement, const SideBySide<voigt_size<Dim>>& stress,
                                int degree, const UniformCell<Dim>& cell, CellSquares& to);

/// forces_of_stress, of each of several.
template <int Dim> std::vector<Points<Dim>> forces_of_stresses(const Discretization<Dim>& discretization,
                                                               const std::vector<const VoigtPoints<Dim>*>& stresses);

/// Sums of fields at points with the weights of rows of a table, of strains and stresses at once.
template <int Dim> void weighted_sums(const SparseRows& weights, const VoigtPoints<Dim>& strain,
                                      const VoigtPoints<Dim>& stress, VoigtPoints<Dim>& to_strain,
                                      VoigtPoints<Dim>& to_stress);

}  // namespace efree::internal
