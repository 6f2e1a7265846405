// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/nodal_conditions.hpp"

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/core/internal/setting_error.hpp"

#include <map>

namespace efree {

using internal::contradict;
using internal::held_by;
using internal::place_text;
using internal::prescribed;

namespace {

/// Degrees of freedom on a part with the normals of the facets they are on, ascending.
template <int Dim>
std::vector<std::pair<Index, Vec<Dim>>> normals_on(const FineSpace<Dim>& space, const std::string& part) {
  std::vector<std::pair<Index, Vec<Dim>>> normals;
  for (const Index f : space.mesh().group(part)) {
    const Vec<Dim> n = space.mesh().facet_normal(f);
    for (const Index dof : space.facet(f)) normals.emplace_back(dof, n);
  }
  std::ranges::stable_sort(normals, {}, &std::pair<Index, Vec<Dim>>::first);
  return normals;
}
/// The first of them at which the part is not flat.
template <int Dim> std::optional<Index> curved_at(const std::vector<std::pair<Index, Vec<Dim>>>& normals) {
  for (std::size_t k = 1; k < normals.size(); ++k)
    if (normals[k].first == normals[k - 1].first && (normals[k].second - normals[k - 1].second).norm() > 1e-6)
      return normals[k].first;
  return std::nullopt;
}

}  // namespace

template <int Dim> bool can_be_nodal(const FineSpace<Dim>& space, const Restraint<Dim>& restraint) {
  if (restraint.is_elastic()) return false;
  return restraint.component >= 0 || !curved_at<Dim>(normals_on(space, restraint.on)).has_value();
}

template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                                         const std::vector<Restraint<Dim>>& restraints) {
  struct Condition {
    Index dof;
    std::vector<Vec<Dim>> directions;
    std::vector<double> values;
    std::vector<std::string> parts;
  };
  std::map<Index, Condition> by_node;
  for (const auto& restraint : restraints) {
    const auto normals = normals_on(space, restraint.on);
    if (restraint.component < 0)
      if (const auto dof = curved_at<Dim>(normals))
        throw internal::SettingError(
            "analysis.essential",
            fmt::format("normal displacement on \"{}\" cannot be set strongly: the part is not flat at {}; use "
                        "essential = \"nitsche\"",
                        restraint.on, place_text<Dim>(space.points().col(*dof))));
    for (std::size_t k = 0; k < normals.size(); ++k) {
      const auto& [dof, n] = normals[k];
      if (node_at[dof] < 0 || (k > 0 && normals[k - 1].first == dof)) continue;
      Condition& condition = by_node.try_emplace(node_at[dof], Condition{dof, {}, {}, {}}).first->second;
      condition.directions.push_back(restraint.direction(n));
      condition.values.push_back(prescribed(restraint, Vec<Dim>(space.points().col(dof))));
      condition.parts.push_back(restraint.on);
    }
  }

  NodalConditions<Dim> result;
  for (const auto& [I, condition] : by_node) {
    auto held = held_by<Dim>(condition.directions, condition.values);
    if (!held) contradict(condition.parts, place_text<Dim>(space.points().col(condition.dof)));
    if (held->rank == Dim) held->frame.setIdentity();
    result.nodes.push_back(I);
    result.frames.push_back(held->frame);
    result.fixed.push_back(held->rank);
    result.values.push_back(held->frame.transpose() * held->value);
  }
  return result;
}

template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                         const std::vector<Index>& node_dofs,
                                                         const std::vector<Restraint<Dim>>& restraints) {
  std::vector<Index> node_at(space.size(), -1);
  for (std::size_t I = 0; I < node_dofs.size(); ++I) node_at[node_dofs[I]] = static_cast<Index>(I);
  std::vector<char> on_part(space.size());
  for (const auto& restraint : restraints) {
    const auto normals = normals_on(space, restraint.on);
    std::ranges::fill(on_part, 0);
    for (const auto& [dof, n] : normals) on_part[dof] = 1;
    for (const auto& [dof, n] : normals)
      for (Index I : shape.row(dof).nodes)
        if (!on_part[node_dofs[I]])
          throw internal::SettingError(
              "analysis.essential",
              fmt::format("displacement on \"{}\" cannot be set strongly: the function of the node at {} does not "
                          "vanish at {}; "
                          "build the basis with vanish_on = \"{}\", or use essential = \"nitsche\"",
                          restraint.on, place_text<Dim>(space.points().col(node_dofs[I])),
                          place_text<Dim>(space.points().col(dof)), restraint.on));
  }
  return nodal_conditions(space, node_at, restraints);
}

template bool can_be_nodal<2>(const FineSpace<2>&, const Restraint<2>&);
template NodalConditions<2> nodal_conditions<2>(const FineSpace<2>&, const std::vector<Index>&,
                                                const std::vector<Restraint<2>>&);
template NodalConditions<2> nodal_conditions<2>(const FineSpace<2>&, const ShapeTable<2>&, const std::vector<Index>&,
                                                const std::vector<Restraint<2>>&);
template bool can_be_nodal<3>(const FineSpace<3>&, const Restraint<3>&);
template NodalConditions<3> nodal_conditions<3>(const FineSpace<3>&, const std::vector<Index>&,
                                                const std::vector<Restraint<3>>&);
template NodalConditions<3> nodal_conditions<3>(const FineSpace<3>&, const ShapeTable<3>&, const std::vector<Index>&,
                                                const std::vector<Restraint<3>>&);

}  // namespace efree
