// SPDX-License-Identifier: GPL-3.0-or-later
/// What is smooth in an error goes: a few functions as coarse space of the finite elements.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/solvers/internal/coarse_solver.hpp"
#include "efree/solvers/internal/held_nodes.hpp"
#include "efree/solvers/internal/scaled_cholesky.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <span>

namespace efree {

/// How nodes of a matrix follow fewer points: with the mean of their motions, as midpoints of edges follow the ends.
template <int Dim> struct Lift {
  struct Parent {
    Index point;
    double share;
  };
  Points<Dim> points;      ///< where they are
  Ragged<Parent> parents;  ///< by node, shares summing to one
};

/// Some functions, one for each direction, and those that turn times rotations about their nodes (partition of unity:
/// Melenk & Babuska 1996). A wall or limb that bends turns from node to node; functions that only move it have to shear
/// it, and are too stiff by the square of spacing over thickness. Turning nodes bend it without shear, as nodes of
/// plates and rods do.
template <int Dim> class CoarseSpace final : public CoarseSolver<Dim> {
 public:
  /// `shape`: the functions at the nodes of K, which are at `places`; `nodes`: theirs (Dim x shape.num_nodes()), which
  /// of them turn; free(node): projector onto the directions that are not held. With a lift the functions are at its
  /// points, and the nodes follow. Factors the stiffness.
  CoarseSpace(const BlockMatrix<Dim>& K, ShapeTable<Dim> shape, Points<Dim> places, Points<Dim> nodes,
              const std::vector<char>& turning, const std::function<Mat<Dim>(Index)>& free,
              std::optional<Lift<Dim>> lift = {});

  using CoarseSolver<Dim>::solve;
  std::vector<Points<Dim>> solve(const std::vector<const Points<Dim>*>& forces) const override;

 private:
  /// Solves for some forces side by side: in this many lanes, each with a column of its own at every node.
  template <int lanes>
  void solve_in(std::span<const Points<Dim>* const> forces, std::vector<Points<Dim>>& displacements) const;
  /// Forces at the nodes of the elements as forces on the functions.
  template <int lanes> Points<Dim> gathered(const Points<Dim>& r) const;
  /// The displacement of the nodes of the elements by that of the functions.
  template <int lanes> Points<Dim> spread(const Points<Dim>& moved, Index nodes) const;
  BlockMatrix<Dim> lifted_stiffness(const BlockMatrix<Dim>& K) const;
  SymmetricMatrix stiffness(const BlockMatrix<Dim>& K) const;
  const Points<Dim>& points() const { return lift_ ? lift_->points : places_; }
  bool turns(Index I) const { return first_[I + 1] - first_[I] == 2; }

  ShapeTable<Dim> shape_;
  Points<Dim> places_, nodes_;
  std::optional<Lift<Dim>> lift_;
  Ragged<Place> followers_;  ///< by point of the lift: the nodes that follow it, with its position among their parents
  HeldNodes<Dim> held_;
  std::vector<Index> first_;  ///< by node: its motion; if it turns, the next is that
  bool turning_;              ///< whether one does
  std::unique_ptr<ScaledCholesky> factor_;
};

/// Nodes of the cloud that had better turn: those whose functions act on something thin, unless they are so many that
/// their factor costs more than it saves. `shape` at `places`; `apart`: how far the nodes are from each other, in nodes
/// of the elements, of which there are `count`.
template <int Dim>
std::vector<char> thin_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& places, Index count, double apart);

}  // namespace efree
