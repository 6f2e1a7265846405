// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/element_reactions.hpp"

#include "efree/assembly/internal/finite_elements.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/solvers/equations/internal/side_by_side.hpp"
#include "efree/solvers/equations/internal/stiffness_terms.hpp"

#include <algorithm>

namespace efree {

template <int Dim>
ElementReactions<Dim>::ElementReactions(const Approximation<Dim>& elements, const ElasticModel& model,
                                        const std::vector<DisplacementCondition<Dim>>& conditions)
    : elements_(elements) {
  const FineSpace<Dim>& space = elements.space;
  terms_ = stiffness_terms(elements, materials_of(model, space.mesh()));
  std::vector<Restraint<Dim>> nodal, weak;
  for (const auto& restraint : restraints(conditions))
    (can_be_nodal(space, restraint) ? nodal : weak).push_back(restraint);
  if (!weak.empty()) {
    system_ = nitsche(space, elements.shape, terms_, weak);
    weakly_ =
        std::make_unique<const NitscheReactions<Dim>>(space, elements.shape, terms_, weak, std::vector<TiedFacets>{});
  }
  node_at_ = element_nodes(space, tied_facets(space.mesh(), model.open_interface)).at;
  nodes_ = node_at_.empty() ? 0 : *std::ranges::max_element(node_at_) + 1;
  nodally_ = std::make_unique<const NodalReactions<Dim>>(space, node_at_, nodal, weak);
}

template <int Dim> std::vector<typename ElementReactions<Dim>::Held> ElementReactions<Dim>::operator()(
    const std::vector<Loads<Dim>>& loads, const std::vector<const Solution<Dim>*>& solutions) const {
  std::vector<Held> all;
  while (all.size() < solutions.size()) {
    const std::size_t first = all.size(), end = std::min(first + internal::most_side_by_side, solutions.size());
    std::vector<Points<Dim>> forces;
    if (terms_.size() == 1) {  // the stiffness is that of the points, and their stress is known
      std::vector<const VoigtPoints<Dim>*> stresses;
      for (std::size_t k = first; k < end; ++k) stresses.push_back(&solutions[k]->stress);
      forces = internal::forces_of_stresses(elements_.quadrature, stresses);
    } else {
      for (std::size_t k = first; k < end; ++k) forces.push_back(forces_of(terms_, solutions[k]->coefficients));
    }
    for (std::size_t k = first; k < end; ++k)
      all.push_back(held(loads[k], solutions[k]->coefficients, forces[k - first]));
  }
  return all;
}

template <int Dim> typename ElementReactions<Dim>::Held ElementReactions<Dim>::held(const Loads<Dim>& loads,
                                                                                    const Points<Dim>& u,
                                                                                    const Points<Dim>& internal) const {
  const FineSpace<Dim>& space = elements_.space;
  const Points<Dim> external = load_vector(space, elements_.shape, loads);
  const double load_work = external.cwiseProduct(u).sum();
  Points<Dim> forces = internal - external;
  Resultants<Dim> reactions;
  if (weakly_) {
    const Vector by_restraints = system_.matrix.template selfadjointView<Eigen::Lower>() * u.reshaped() - system_.rhs;
    forces += by_restraints.reshaped(Dim, space.size());
    reactions = (*weakly_)(u);
  }
  Points<Dim> at_nodes = Points<Dim>::Zero(Dim, nodes_);
  for (Index dof = 0; dof < space.size(); ++dof) at_nodes.col(node_at_[dof]) += forces.col(dof);
  for (const auto& [part, of] : (*nodally_)(at_nodes)) reactions[part] += of;
  return {std::move(reactions), nodally_->free_work(at_nodes, u), load_work};
}

template class ElementReactions<2>;
template class ElementReactions<3>;

}  // namespace efree
