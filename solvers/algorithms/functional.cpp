// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/functional.hpp"

#include "efree/assembly/internal/finite_elements.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/geometry/mesh/locator.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <fmt/format.h>
#include <cmath>
#include <map>

namespace efree {

template <int Dim>
Functional<Dim> displacement_at(const FineSpace<Dim>& space, const Vec<Dim>& at, const Vec<Dim>& direction) {
  const auto [cell, inside] = locate(space.mesh(), at);
  Functional<Dim> functional{Points<Dim>::Zero(Dim, space.size()), {}, {}};
  const auto N = space.values(inside);
  const auto dofs = space.cell(cell);
  for (std::size_t i = 0; i < dofs.size(); ++i) functional.forces.col(dofs[i]) = N[static_cast<Index>(i)] * direction;
  return functional;
}

namespace {

template <int Dim> using RestraintsByPart = std::map<std::string, std::vector<Restraint<Dim>>>;

/// The directions that restraints of one part hold at the nodes, as projectors; zero where they hold nothing.
template <int Dim> std::vector<Mat<Dim>> held_at_nodes(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                       const std::vector<Restraint<Dim>>& of_part) {
  std::vector<Mat<Dim>> held(nodes.count, Mat<Dim>::Zero());
  const NodalConditions<Dim> conditions = nodal_conditions(space, nodes.at, of_part);
  for (std::size_t k = 0; k < conditions.nodes.size(); ++k) {
    const auto along = conditions.frames[k].leftCols(conditions.fixed[k]);
    held[conditions.nodes[k]] = along * along.transpose();
  }
  return held;
}
/// The components that weak restraints of one part act on at the nodes, likewise: where the part is curved there is no
/// direction to a node. Cells at its facets move as a whole, or Nitsche's terms would take their strain for a force;
/// `on_facets`, by node: those on facets that are held weakly.
template <int Dim> std::vector<Mat<Dim>> pushed_at_nodes(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                         const std::vector<Restraint<Dim>>& of_part,
                                                         const std::vector<char>& on_facets) {
  std::vector<Mat<Dim>> pushed(nodes.count, Mat<Dim>::Zero());
  for (const Restraint<Dim>& restraint : of_part)
    for (const Index f : space.mesh().group(restraint.on)) {
      const Vec<Dim> along = restraint.direction(space.mesh().facet_normal(f));
      const auto push = [&](Index node) {
        for (int d = 0; d < Dim; ++d)
          if (std::abs(along[d]) > 1e-12) pushed[node](d, d) = 1.0;
      };
      for (const Index dof : space.facet(f)) push(nodes.at[dof]);
      for (const Index dof : space.cell(space.mesh().facet_cell(f)))
        if (!on_facets[nodes.at[dof]]) push(nodes.at[dof]);
    }
  return pushed;
}

/// The motion of a part along a direction, as far as it holds that: of directions that several parts hold at a node
/// each has a like share. Empty if nothing of the part is among them.
template <int Dim, class AtNodes> Points<Dim> motion_of(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                        const RestraintsByPart<Dim>& held, const std::string& part,
                                                        const Vec<Dim>& direction, const AtNodes& at_nodes) {
  if (!held.contains(part)) return {};
  std::vector<Mat<Dim>> all(nodes.count, Mat<Dim>::Zero()), own;
  for (const auto& [name, of_part] : held) {
    auto one = at_nodes(of_part);
    for (Index node = 0; node < nodes.count; ++node) all[node] += one[node];
    if (name == part) own = std::move(one);
  }
  Points<Dim> motion = Points<Dim>::Zero(Dim, space.size());
  for (Index dof = 0; dof < space.size(); ++dof) {
    const Index node = nodes.at[dof];
    if (own[node].isZero(0.0)) continue;
    motion.col(dof) = internal::pseudo_inverse<Dim>(all[node]) * (own[node] * direction);
  }
  return motion;
}

/// What parts hold on a facet, as projectors: all of them, and the one that is asked about.
template <int Dim> struct HeldOnFacet { Mat<Dim> all = Mat<Dim>::Zero(), own = Mat<Dim>::Zero(); };

/// Work of the tractions of a stress on what a motion is beyond that of the facets of its part.
template <int Dim> double work_beyond(const FineSpace<Dim>& space, const RestraintsByPart<Dim>& held,
                                      const std::string& part, const Vec<Dim>& direction, const Points<Dim>& motion,
                                      const VoigtPoints<Dim>& stress) {
  if (motion.isZero(0.0)) return 0.0;
  std::map<Index, HeldOnFacet<Dim>> facets;
  for (const auto& [name, of_part] : held)
    for (const Index f : space.mesh().group(name)) {
      Mat<Dim> along = Mat<Dim>::Zero();
      for (const Restraint<Dim>& restraint : of_part) {
        const Vec<Dim> one = restraint.direction(space.mesh().facet_normal(f));
        along += one * one.transpose();
      }
      facets[f].all += along;
      if (name == part) facets[f].own += along;
    }
  const auto& rule = space.facet_rule();
  double work = 0.0;
  for (const auto& [f, on_facet] : facets) {
    const auto dofs = space.cell(space.mesh().facet_cell(f)), places = space.places(space.mesh().facet_cell(f));
    const Vec<Dim> n = space.mesh().facet_normal(f);
    const Mat<Dim> shares = internal::pseudo_inverse<Dim>(on_facet.all);
    const Vec<Dim> of_part = shares * (on_facet.own * direction);
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const auto at = space.facet_point(f, rule.points.col(q));
      const auto N = space.values(at);
      Vec<Dim> beyond = -of_part;
      Voigt<Dim> sigma = Voigt<Dim>::Zero();
      for (std::size_t i = 0; i < dofs.size(); ++i) {
        beyond += N[static_cast<Index>(i)] * motion.col(dofs[i]);
        sigma += N[static_cast<Index>(i)] * stress.col(places[i]);
      }
      const Vec<Dim> held_part = shares * (on_facet.all * beyond);
      work += space.mesh().facet_measure(f) * rule.weights[q] *
              space.measure(space.position(space.mesh().facet_cell(f), at)) * traction<Dim>(sigma, n).dot(held_part);
    }
  }
  return work;
}

/// Restraints by part: those that nodal values hold, and the others.
template <int Dim> std::pair<RestraintsByPart<Dim>, RestraintsByPart<Dim>> by_part(
    const FineSpace<Dim>& space, const std::vector<DisplacementCondition<Dim>>& conditions, bool all_weakly) {
  RestraintsByPart<Dim> strong, weak;
  for (const Restraint<Dim>& restraint : restraints(conditions))
    (all_weakly || !can_be_nodal(space, restraint) ? weak : strong)[restraint.on].push_back(restraint);
  return {std::move(strong), std::move(weak)};
}

}  // namespace

template <int Dim>
double shared_work(const FineSpace<Dim>& space, const std::vector<DisplacementCondition<Dim>>& conditions,
                   const std::string& part, const Vec<Dim>& direction, const Functional<Dim>& reaction,
                   const VoigtPoints<Dim>& stress, bool all_weakly) {
  const auto [strong, weak] = by_part(space, conditions, all_weakly);
  return work_beyond<Dim>(space, strong, part, direction, reaction.motion, stress) +
         work_beyond<Dim>(space, weak, part, direction, reaction.weak_motion, stress);
}

template <int Dim> Functional<Dim> reaction_of(const FineSpace<Dim>& space,
                                               const std::vector<DisplacementCondition<Dim>>& conditions,
                                               const std::vector<TiedFacets>& ties, const std::string& part,
                                               const Vec<Dim>& direction, bool all_weakly) {
  const auto [strong, weak] = by_part(space, conditions, all_weakly);
  if (!strong.contains(part) && !weak.contains(part))
    throw InputError(fmt::format("no displacement is prescribed on \"{}\": it has no reaction", part));
  const ElementNodes nodes = element_nodes(space, ties);
  std::vector<char> on_facets(nodes.count, 0);
  for (const auto& [name, of_part] : weak)
    for (const Index f : space.mesh().group(name))
      for (const Index dof : space.facet(f)) on_facets[nodes.at[dof]] = 1;
  const auto held = [&](const auto& of_part) { return held_at_nodes(space, nodes, of_part); };
  const auto pushed = [&](const auto& of_part) { return pushed_at_nodes(space, nodes, of_part, on_facets); };
  return {Points<Dim>::Zero(Dim, space.size()), motion_of<Dim>(space, nodes, strong, part, direction, held),
          motion_of<Dim>(space, nodes, weak, part, direction, pushed)};
}

template double shared_work<3>(const FineSpace<3>&, const std::vector<DisplacementCondition<3>>&, const std::string&,
                               const Vec<3>&, const Functional<3>&, const VoigtPoints<3>&, bool);
template double shared_work<2>(const FineSpace<2>&, const std::vector<DisplacementCondition<2>>&, const std::string&,
                               const Vec<2>&, const Functional<2>&, const VoigtPoints<2>&, bool);
template Functional<2> displacement_at<2>(const FineSpace<2>&, const Vec<2>&, const Vec<2>&);
template Functional<3> displacement_at<3>(const FineSpace<3>&, const Vec<3>&, const Vec<3>&);
template Functional<2> reaction_of<2>(const FineSpace<2>&, const std::vector<DisplacementCondition<2>>&,
                                      const std::vector<TiedFacets>&, const std::string&, const Vec<2>&, bool);
template Functional<3> reaction_of<3>(const FineSpace<3>&, const std::vector<DisplacementCondition<3>>&,
                                      const std::vector<TiedFacets>&, const std::string&, const Vec<3>&, bool);

}  // namespace efree
