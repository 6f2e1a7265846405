// SPDX-License-Identifier: GPL-3.0-or-later
/// By which forces and moments the parts of the boundary hold the finite elements of a mesh.
#pragma once

#include "efree/solvers/algorithms/static_analysis.hpp"
#include "efree/solvers/equations/nodal_reactions.hpp"

#include <memory>
#include <vector>

namespace efree {

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
