// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elements as coarse space of the quadratic ones on the same cells.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/assembly/internal/finite_elements.hpp"
#include "efree/solvers/linear/internal/coarse_solver.hpp"
#include "efree/solvers/linear/internal/held_nodes.hpp"
#include "efree/solvers/linear/internal/scaled_cholesky.hpp"

#include <array>
#include <functional>
#include <memory>
#include <vector>

namespace efree {

/// The second of two levels of degree (p-multigrid: Rønquist & Patera 1987). Whatever the mesh, and however thin its
/// body, one sweep over the quadratic problem removes what linear elements cannot; their factor has a quarter of its
/// unknowns.
template <int Dim> class LinearElements final : public CoarseSolver<Dim> {
 public:
  /// K: of the quadratic space on its `nodes`; free(node): projector onto the directions that are not held. Factors the
  /// stiffness of linear elements, as K has it for displacements that are linear along edges.
  LinearElements(const BlockMatrix<Dim>& K, const FineSpace<Dim>& space, const ElementNodes& nodes,
                 const std::function<Mat<Dim>(Index)>& free);

  using CoarseSolver<Dim>::solve;
  std::vector<Points<Dim>> solve(const std::vector<const Points<Dim>*>& forces) const override;

 private:
  SymmetricMatrix stiffness(const BlockMatrix<Dim>& K) const;
  /// The share that a vertex has in the displacement of a node next to it.
  double share(Index node) const { return ends_[node][0] == ends_[node][1] ? 1.0 : 0.5; }

  std::vector<std::array<Index, 2>> ends_;  ///< by node: the vertices of its edge; a vertex is both of its own
  Ragged<Index> around_;                    ///< nodes by vertex: itself, and the midpoints of its edges
  HeldNodes<Dim> held_;
  std::unique_ptr<ScaledCholesky> factor_;
};

}  // namespace efree
