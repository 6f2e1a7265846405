// SPDX-License-Identifier: GPL-3.0-or-later
/// What is smooth in an error goes: the cloud as coarse space of the finite elements.
#pragma once

#include "efree/assembly/block_matrix.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/solvers/internal/scaled_cholesky.hpp"

#include <functional>
#include <memory>

namespace efree {

/// The functions of the cloud, one for each direction, and, where the body is thin, those functions times rotations
/// about their nodes, unless that makes too many. A wall or limb that bends turns from node to node; functions that
/// only move it have to shear it, and are too stiff by the square of spacing over thickness. Turning nodes bend it
/// without shear, as nodes of plates and rods do (partition of unity: Melenk & Babuska 1996).
template <int Dim> class CoarseSpace {
 public:
  /// `shape`: the functions at the nodes of K, which are at `places`; `nodes`: those of the cloud (Dim x
  /// shape.num_nodes()); free(node): projector onto the directions that are not held; `reach`: as for Smoother. Factors
  /// the stiffness.
  CoarseSpace(const BlockMatrix<Dim>& K, ShapeTable<Dim> shape, Points<Dim> places, const Points<Dim>& nodes,
              const std::function<Mat<Dim>(Index)>& free, double reach);

  /// The displacement that forces r without a part on what is held (Dim x K.size()) lead to in this space.
  Points<Dim> solve(const Points<Dim>& r) const;

 private:
  SymmetricMatrix stiffness(const BlockMatrix<Dim>& K) const;
  bool turns(Index I) const { return first_[I + 1] - first_[I] == 2; }

  ShapeTable<Dim> shape_;
  Points<Dim> places_, nodes_;
  Ragged<Place> rows_at_;                         ///< rows of the table, by node of the cloud
  std::vector<std::pair<Index, Mat<Dim>>> held_;  ///< nodes of K, ascending, with what is free there
  std::vector<Index> held_at_;                    ///< by node of K: index into held_, -1 if it is free
  std::vector<Index> first_;                      ///< by node of the cloud: its motion; if it turns, the next is that
  std::unique_ptr<ScaledCholesky> factor_;
};

}  // namespace efree
