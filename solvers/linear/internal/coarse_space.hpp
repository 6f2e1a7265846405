// SPDX-License-Identifier: GPL-3.0-or-later
/// What is smooth in an error goes: a few functions as coarse space of the finite elements.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/solvers/linear/internal/coarse_solver.hpp"
#include "efree/solvers/linear/internal/held_nodes.hpp"
#include "efree/solvers/linear/internal/rigid_map.hpp"
#include "efree/solvers/linear/internal/scaled_cholesky.hpp"

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
  struct Functions;  ///< what it is made of
  explicit CoarseSpace(Functions functions, const BlockMatrix<Dim>& K);
  /// Solves for some forces side by side, in this many lanes.
  void solve_in(int lanes, std::span<const Points<Dim>* const> forces, std::vector<Points<Dim>>& displacements) const;

  HeldNodes<Dim> held_;
  std::vector<Index> first_;  ///< by node: its motion; if it turns, the next is that
  bool turning_;              ///< whether one does
  /// What the functions move, by those of the nodes; and the nodes of K by the points of a lift.
  RigidMap<Dim> by_nodes_, of_nodes_;  ///< and mirrored
  std::optional<RigidMap<Dim>> by_points_, of_points_;
  std::unique_ptr<ScaledCholesky> factor_;
};

/// Nodes of the cloud that had better turn: those whose functions act on something thin, unless they are so many that
/// their factor costs more than it saves. `shape` at `places`; `apart`: how far the nodes are from each other, in nodes
/// of the elements, of which there are `count`.
template <int Dim>
std::vector<char> thin_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& places, Index count, double apart);

}  // namespace efree
