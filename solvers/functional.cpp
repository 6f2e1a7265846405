// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/functional.hpp"

#include "efree/assembly/boundary.hpp"
#include "efree/assembly/finite_elements.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/static_analysis.hpp"

#include <fmt/format.h>
#include <Eigen/QR>
#include <map>

namespace efree {

template <int Dim>
Functional<Dim> displacement_at(const FineSpace<Dim>& space, const Vec<Dim>& at, const Vec<Dim>& direction) {
  const auto [cell, inside] = locate(space.mesh(), at);
  Functional<Dim> functional{Points<Dim>::Zero(Dim, space.size()), {}};
  const auto N = space.values(inside);
  const auto dofs = space.cell(cell);
  for (std::size_t i = 0; i < dofs.size(); ++i) functional.forces.col(dofs[i]) = N[static_cast<Index>(i)] * direction;
  return functional;
}

template <int Dim> Functional<Dim> reaction_of(const FineSpace<Dim>& space,
                                               const std::vector<DisplacementCondition<Dim>>& conditions,
                                               const std::vector<TiedFacets>& ties, const std::string& part,
                                               const Vec<Dim>& direction, bool all_weakly) {
  std::map<std::string, std::vector<Restraint<Dim>>> strong;  // by part
  bool known = false, weakly = false;
  for (const Restraint<Dim>& restraint : restraints(conditions)) {
    const bool nodal = !all_weakly && can_be_nodal(space, restraint);
    if (nodal) strong[restraint.on].push_back(restraint);
    if (restraint.on == part) known = true, weakly = !nodal;
  }
  if (!known) throw InputError(fmt::format("no displacement is prescribed on \"{}\": it has no reaction", part));
  const Points<Dim> nothing = Points<Dim>::Zero(Dim, space.size());
  Functional<Dim> functional{nothing, nothing, weakly};
  if (weakly) {
    for (const Index f : space.mesh().group(part))
      for (const Index dof : space.facet(f)) functional.motion.col(dof) = direction;
    return functional;
  }
  // Of directions that several parts hold at a node, each part gets a like share.
  const ElementNodes nodes = element_nodes(space, ties);
  std::vector<Mat<Dim>> all(nodes.count, Mat<Dim>::Zero()), own = all;
  for (const auto& [name, of_part] : strong) {
    const NodalConditions<Dim> held = nodal_conditions(space, nodes.at, of_part);
    for (std::size_t k = 0; k < held.nodes.size(); ++k) {
      const auto along = held.frames[k].leftCols(held.fixed[k]);
      const Mat<Dim> projector = along * along.transpose();
      all[held.nodes[k]] += projector;
      if (name == part) own[held.nodes[k]] = projector;
    }
  }
  for (Index dof = 0; dof < space.size(); ++dof) {
    const Index node = nodes.at[dof];
    if (own[node].isZero(0.0)) continue;
    functional.motion.col(dof) =
        Eigen::CompleteOrthogonalDecomposition<Mat<Dim>>(all[node]).solve(own[node] * direction);
  }
  return functional;
}

template Functional<2> displacement_at<2>(const FineSpace<2>&, const Vec<2>&, const Vec<2>&);
template Functional<3> displacement_at<3>(const FineSpace<3>&, const Vec<3>&, const Vec<3>&);
template Functional<2> reaction_of<2>(const FineSpace<2>&, const std::vector<DisplacementCondition<2>>&,
                                      const std::vector<TiedFacets>&, const std::string&, const Vec<2>&, bool);
template Functional<3> reaction_of<3>(const FineSpace<3>&, const std::vector<DisplacementCondition<3>>&,
                                      const std::vector<TiedFacets>&, const std::string&, const Vec<3>&, bool);

}  // namespace efree
