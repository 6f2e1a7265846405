// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacement conditions and ties through the gradients that materials see, whatever the materials.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/nitsche.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/assembly/resultants.hpp"

#include <memory>
#include <span>
#include <vector>

namespace efree {

/// What displacement conditions prescribe at one moment.
template <int Dim> struct PrescribedMotion {
  Gradients<Dim> gradients;  ///< by quadrature point: what it adds to gradients
  Points<Dim> forces;        ///< on coefficients (Dim x N), of penalties and springs [force]

  PrescribedMotion operator*(double factor) const { return {factor * gradients, factor * forces}; }
};

/// Gradients at the points of a quadrature that know the conditions on the boundary: the derivative of a field whose
/// displacement jumps to what is prescribed,
///   H_K(U) = (1/w_K) [int grad(u) Phi_K - int_Gamma (u - g) (x) n Phi_K],
/// along the directions held, and with the jump and the shares of Nitsche's method where regions are tied (Bassi &
/// Rebay 1997; Ten Eyck & Lew 2006, eq. 12). Work of stresses on such gradients is consistent and has a symmetric
/// tangent for every material, without the material's third derivative that Nitsche's method would need. For linear
/// materials it is Nitsche's method and half of the work of the jump itself, so that any positive penalty is stable:
/// c |Gamma_K| / w_K, c the stiffness along the normal where nothing has happened yet, is taken. Springs are
/// int k (d.u - g) d.v. `term` is the stiffness at the points there (of averaged dilatations the deviatoric part).
template <int Dim> class HeldGradient {
 public:
  /// Refers to space, shape and the term's quadrature. Throws InputError like `nitsche`.
  HeldGradient(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const StiffnessTerm<Dim>& term,
               std::vector<Restraint<Dim>> restraints, std::vector<TiedFacets> ties);

  Index size() const { return quadrature_.size(); }
  Index num_nodes() const { return shape_.num_nodes(); }
  const Quadrature<Dim>& quadrature() const { return quadrature_; }

  /// Gradients by coefficients (Dim x N), where nothing is prescribed: column = point.
  Gradients<Dim> of(const Points<Dim>& U) const;
  /// The adjoint: forces f (Dim x N) with <f, U> = sum_K w_K P_K : of(U)_K.
  Points<Dim> force(const Gradients<Dim>& P) const;
  /// Nodes that the gradient at a point depends on, ascending.
  std::span<const Index> nodes(Index K) const {
    return lifted_[K] < 0 ? quadrature_.shape.row(K).nodes : nodes_[lifted_[K]];
  }
  /// The gradient by the displacement of the k-th of them.
  GradientBlock<Dim> block(Index K, std::size_t k) const;
  /// Adds sum_K w_K G_b^T A_K G_a to the blocks of the column of node a; A symmetric, by point.
  template <class Column> void add_stiffness(const std::vector<Tangent<Dim>>& A, Index a, Column& column) const;

  /// Of penalties and springs, on all coefficients, with room for every pair of nodes that meet through a condition.
  const SymmetricMatrix& penalty() const { return penalty_; }
  /// What restraints on the same parts prescribe. Throws InputError for values that are not finite.
  PrescribedMotion<Dim> prescribed(const std::vector<Restraint<Dim>>& restraints) const;
  /// The largest distance of a body whose coefficients are U from what the restraints prescribe, at points of the
  /// boundary [length]; springs aside.
  double largest_gap(const std::vector<Restraint<Dim>>& restraints, const Points<Dim>& U) const;
  /// By part: the force and moment by which stresses P (column = point) and penalties hold a body, whose coefficients
  /// are U, at what the restraints prescribe. Moments are about the origin, of forces where the boundary is now if
  /// `moved`. So they balance the loads as far as U solves the equations.
  Resultants<Dim> reactions(const std::vector<Restraint<Dim>>& restraints, const Gradients<Dim>& P,
                            const Points<Dim>& U, bool moved) const;

 private:
  const FineSpace<Dim>& space_;
  const ShapeTable<Dim>& shape_;
  const Quadrature<Dim>& quadrature_;
  std::vector<StiffnessTerm<Dim>> term_;        ///< one
  std::vector<std::vector<double>> penalties_;  ///< by point of that term
  std::vector<TiedFacets> ties_;
  std::vector<Index> lifted_;               ///< by point: its place among those near conditions, or -1
  std::vector<Index> points_;               ///< near conditions, ascending
  Ragged<Index> nodes_;                     ///< of these, by place
  std::vector<GradientBlock<Dim>> blocks_;  ///< laid out as nodes_.items
  Ragged<NodePlace> places_;                ///< by node: (place, position)
  SymmetricMatrix penalty_;
};

template <int Dim> template <class Column>
void HeldGradient<Dim>::add_stiffness(const std::vector<Tangent<Dim>>& A, Index a, Column& column) const {
  for (const auto& [K, k] : quadrature_.shape.by_node()[a])
    if (lifted_[K] < 0) column.add(quadrature_.shape.row(K), k, quadrature_.weights[K], A[K]);
  for (const auto& [place, k] : places_[a]) {
    const Index K = points_[place];
    const auto row = nodes_[place];
    const GradientBlock<Dim>* blocks = blocks_.data() + nodes_.offsets[place];
    column.add(row.subspan(k), blocks + k, quadrature_.weights[K], A[K]);
  }
}

}  // namespace efree
