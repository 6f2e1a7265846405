// SPDX-License-Identifier: GPL-3.0-or-later
/// What is smooth in an error goes: a few functions as coarse space of the finite elements.
#pragma once

#include "efree/assembly/block_matrix.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/solvers/internal/held_nodes.hpp"
#include "efree/solvers/internal/scaled_cholesky.hpp"

#include <functional>
#include <memory>

namespace efree {

/// Some functions, one for each direction, and those that turn times rotations about their nodes (partition of unity:
/// Melenk & Babuska 1996). A wall or limb that bends turns from node to node; functions that only move it have to shear
/// it, and are too stiff by the square of spacing over thickness. Turning nodes bend it without shear, as nodes of
/// plates and rods do.
template <int Dim> class CoarseSpace {
 public:
  /// `shape`: the functions at the nodes of K, which are at `places`; `nodes`: theirs (Dim x shape.num_nodes()), which
  /// of them turn; free(node): projector onto the directions that are not held. Factors the stiffness.
  CoarseSpace(const BlockMatrix<Dim>& K, ShapeTable<Dim> shape, Points<Dim> places, Points<Dim> nodes,
              const std::vector<char>& turning, const std::function<Mat<Dim>(Index)>& free);

  /// The displacement that forces r without a part on what is held (Dim x K.size()) lead to in this space.
  Points<Dim> solve(const Points<Dim>& r) const;

 private:
  SymmetricMatrix stiffness(const BlockMatrix<Dim>& K) const;
  bool turns(Index I) const { return first_[I + 1] - first_[I] == 2; }

  ShapeTable<Dim> shape_;
  Points<Dim> places_, nodes_;
  Ragged<Place> rows_at_;  ///< rows of the table, by node
  HeldNodes<Dim> held_;
  std::vector<Index> first_;  ///< by node: its motion; if it turns, the next is that
  std::unique_ptr<ScaledCholesky> factor_;
};

/// Nodes of the cloud that had better turn: those whose functions act on something thin, unless they are so many that
/// their factor costs more than it saves. `shape`, `places`: as for CoarseSpace; `apart`: how far the nodes are from
/// each other, in `places`.
template <int Dim> std::vector<char> thin_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& places, double apart);

}  // namespace efree
