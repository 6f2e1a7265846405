// SPDX-License-Identifier: GPL-3.0-or-later
/// By which forces and moments the parts of the boundary hold a body, from the equilibrium of the discrete problem.
#pragma once

#include "efree/assembly/resultants.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"
#include "efree/solvers/equations/equilibrium.hpp"

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

/// Reactions of the finite elements that a Corrector leads to; conditions set as it sets them.
template <int Dim> class ElementReactions {
 public:
  /// Keeps a reference to the elements.
  ElementReactions(const Approximation<Dim>& elements, const ElasticModel& model,
                   const std::vector<DisplacementCondition<Dim>>& conditions);
  struct Held {
    Resultants<Dim> reactions;  ///< by part with displacement conditions: what holds the body
    double free_work;           ///< of the forces that nothing holds, along the displacements: what iterations leave
    double load_work;           ///< of the loads
  };
  /// With these displacements (coefficients) and stresses, under these loads; several in less time than one by one.
  std::vector<Held> operator()(const std::vector<Loads<Dim>>& loads,
                               const std::vector<const Solution<Dim>*>& solutions) const;

 private:
  Held held(const Loads<Dim>& loads, const Points<Dim>& u, const Points<Dim>& internal) const;

  const Approximation<Dim>& elements_;
  std::vector<StiffnessTerm<Dim>> terms_;
  NitscheSystem<Dim> system_;                            ///< of the weak restraints, if there are any
  std::unique_ptr<const NitscheReactions<Dim>> weakly_;  ///< likewise
  std::vector<Index> node_at_;                           ///< by degree of freedom
  Index nodes_ = 0;
  std::unique_ptr<const NodalReactions<Dim>> nodally_;
};

}  // namespace efree
