// SPDX-License-Identifier: GPL-3.0-or-later
/// By which forces and moments the parts of the boundary hold a body at nodes, from the equilibrium of the discrete
/// problem.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/resultants.hpp"
#include "efree/basis/fine_space.hpp"

#include <memory>
#include <vector>

namespace efree {

/// By part on which nodal values hold displacements (all, or those of the restraints that are not `weak`), what holds
/// the body, from forces at nodes. Where parts meet each has what its own directions hold, of what several hold a like
/// share. What iterations left out of balance at free nodes goes to the parts that hold its direction, the nearer (in
/// steps through the mesh) the more: so reactions and loads balance to rounding, and where one part alone holds a
/// direction its reaction is exact. That of weak restraints is in the result as far as it comes from there.
template <int Dim> class NodalReactions {
 public:
  /// `node_at`: by degree of freedom of the space, -1 where there is none; several may share one. Keeps a reference to
  /// the space.
  NodalReactions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                 const std::vector<Restraint<Dim>>& nodal, const std::vector<Restraint<Dim>>& weak);
  ~NodalReactions();
  /// Of forces that are internal less external (Dim x nodes). Moments are those of forces at rest, or with `moved_by`
  /// (Dim x space.size()) where the body has moved since.
  Resultants<Dim> operator()(const Points<Dim>& forces, const Points<Dim>* moved_by = nullptr) const;
  /// Work of these forces along displacements (Dim x space.size()) of what no nodal value holds.
  double free_work(const Points<Dim>& forces, const Points<Dim>& displacements) const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace efree
