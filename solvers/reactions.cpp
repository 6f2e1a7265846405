// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/reactions.hpp"

#include "efree/assembly/internal/finite_elements.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/solvers/internal/stiffness_terms.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <array>

namespace efree {
namespace {

/// A part of the boundary that holds displacements.
template <int Dim> struct HoldingPart {
  std::string name;
  std::vector<std::pair<Index, Mat<Dim>>> held;  ///< nodes with the directions that nodal values hold, a projector
  std::array<std::vector<Index>, Dim> from;      ///< by axis: vertices where something along it is held
};

/// Vertices in the same place that are one node of the elements.
struct Twins {
  std::vector<Index> first;  ///< by vertex
  Ragged<Index> of_first;

  Twins(const std::vector<Index>& node_at, Index vertices) : first(vertices) {
    Index nodes = 0;
    for (const Index node : node_at) nodes = std::max(nodes, node + 1);
    std::vector<Index> vertex_of(nodes, -1);
    for (Index v = 0; v < vertices; ++v) {
      Index& known = node_at[v] < 0 ? first[v] = v : vertex_of[node_at[v]];
      if (known < 0) known = v;
      first[v] = known;
    }
    of_first.offsets.assign(vertices + 1, 0);
    for (const Index v : first) ++of_first.offsets[v + 1];
    for (Index v = 0; v < vertices; ++v) of_first.offsets[v + 1] += of_first.offsets[v];
    of_first.items.resize(vertices);
    std::vector<Index> cursor(of_first.offsets.begin(), of_first.offsets.end() - 1);
    for (Index v = 0; v < vertices; ++v) of_first.items[cursor[first[v]]++] = v;
  }
};

/// One over the steps through the mesh to each vertex from the nearest of some; zero where there is no way.
template <int Dim>
std::vector<double> nearness(const FineMesh<Dim>& mesh, const Twins& twins, const std::vector<Index>& from) {
  constexpr double here = 1e30;
  std::vector<Index> steps(mesh.num_vertices(), -1), front;
  const auto reach = [&](Index vertex, Index count) {
    if (steps[vertex] >= 0) return;
    for (const Index twin : twins.of_first[twins.first[vertex]]) {
      steps[twin] = count;
      front.push_back(twin);
    }
  };
  for (const Index v : from) reach(v, 0);
  for (std::size_t k = 0; k < front.size(); ++k)
    for (const Index c : mesh.cells_of(front[k]))
      for (int i = 0; i <= Dim; ++i) reach(mesh.cells()(i, c), steps[front[k]] + 1);
  std::vector<double> near(steps.size());
  for (std::size_t v = 0; v < near.size(); ++v) near[v] = steps[v] < 0 ? 0.0 : steps[v] == 0 ? here : 1.0 / steps[v];
  return near;
}

/// Shares of parts in the forces along an axis, by vertex, which sum to one; where there is no way to any all have a
/// like one.
template <int Dim> std::vector<std::vector<double>> shares_along(const FineMesh<Dim>& mesh, const Twins& twins,
                                                                 const std::vector<const std::vector<Index>*>& from) {
  if (from.size() == 1) return {std::vector<double>(mesh.num_vertices(), 1.0)};
  std::vector<std::vector<double>> shares;
  std::vector<double> sum(mesh.num_vertices(), 0.0);
  for (const auto* vertices : from) {
    shares.push_back(nearness(mesh, twins, *vertices));
    for (std::size_t v = 0; v < sum.size(); ++v) sum[v] += shares.back()[v];
  }
  for (auto& share : shares)
    for (std::size_t v = 0; v < sum.size(); ++v)
      share[v] = sum[v] > 0.0 ? share[v] / sum[v] : 1.0 / static_cast<double>(from.size());
  return shares;
}

template <int Dim>
std::vector<HoldingPart<Dim>> holding_parts(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                            const std::vector<Index>& dof_of, const std::vector<Restraint<Dim>>& nodal,
                                            const std::vector<Restraint<Dim>>& weak) {
  constexpr double something = 1e-12;
  std::vector<HoldingPart<Dim>> parts;
  const auto part = [&](const std::string& name) -> HoldingPart<Dim>& {
    const auto found = std::ranges::find(parts, name, &HoldingPart<Dim>::name);
    if (found != parts.end()) return *found;
    parts.push_back({name, {}, {}});
    return parts.back();
  };
  for (const auto& restraint : nodal) part(restraint.on);
  for (auto& one : parts) {
    std::vector<Restraint<Dim>> own;
    for (const auto& restraint : nodal)
      if (restraint.on == one.name) own.push_back(restraint);
    const NodalConditions<Dim> conditions = nodal_conditions(space, node_at, own);
    for (std::size_t k = 0; k < conditions.nodes.size(); ++k) {
      const auto along = conditions.frames[k].leftCols(conditions.fixed[k]);
      const Mat<Dim> held = along * along.transpose();
      one.held.emplace_back(conditions.nodes[k], held);
      const Index dof = dof_of[conditions.nodes[k]];
      for (int d = 0; d < Dim; ++d)
        if (held(d, d) > something && dof < space.mesh().num_vertices()) one.from[d].push_back(dof);
    }
  }
  for (const auto& restraint : weak) {
    auto& one = part(restraint.on);
    for (const Index f : space.mesh().group(restraint.on)) {
      const Vec<Dim> along = restraint.direction(space.mesh().facet_normal(f));
      for (int d = 0; d < Dim; ++d)
        if (along[d] * along[d] > something)
          for (int i = 0; i < Dim; ++i) one.from[d].push_back(space.mesh().facets()(i, f));
    }
  }
  return parts;
}

}  // namespace

template <int Dim> Resultants<Dim> nodal_reactions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                                   const std::vector<Restraint<Dim>>& nodal,
                                                   const std::vector<Restraint<Dim>>& weak, const Points<Dim>& forces,
                                                   const Points<Dim>* moved_by) {
  const FineMesh<Dim>& mesh = space.mesh();
  const auto nodes = static_cast<Index>(forces.cols());
  std::vector<Index> dof_of(nodes, -1);
  for (Index dof = space.size() - 1; dof >= 0; --dof)
    if (node_at[dof] >= 0) dof_of[node_at[dof]] = dof;
  const auto place = [&](Index node) {
    Vec<Dim> x = space.points().col(dof_of[node]);
    if (moved_by) x += moved_by->col(dof_of[node]);
    return x;
  };
  const auto parts = holding_parts(space, node_at, dof_of, nodal, weak);
  Resultants<Dim> reactions;

  // At nodes that are held: along what is held each part has its own, the rest is free.
  std::vector<Index> place_of(nodes, -1);
  std::vector<Mat<Dim>> held, free;
  for (const auto& part : parts)
    for (const auto& [node, own] : part.held) {
      if (place_of[node] < 0) place_of[node] = static_cast<Index>(held.size()), held.push_back(Mat<Dim>::Zero());
      held[place_of[node]] += own;
    }
  for (Mat<Dim>& all : held) {
    const Mat<Dim> inverse = Eigen::CompleteOrthogonalDecomposition<Mat<Dim>>(all).pseudoInverse();
    free.push_back(Mat<Dim>::Identity() - inverse * all);
    all = inverse;
  }
  for (const auto& part : parts) {
    Resultant<Dim>& reaction = reactions[part.name];
    for (const auto& [node, own] : part.held)
      reaction.add(place(node), own * (held[place_of[node]] * Vec<Dim>(forces.col(node))));
  }

  const Twins twins(node_at, mesh.num_vertices());
  const auto edges = space.edges();
  for (int d = 0; d < Dim; ++d) {
    std::vector<const std::vector<Index>*> from;
    std::vector<Resultant<Dim>*> to;
    for (const auto& part : parts)
      if (!part.from[d].empty()) from.push_back(&part.from[d]), to.push_back(&reactions[part.name]);
    if (from.empty()) continue;
    const auto shares = shares_along(mesh, twins, from);
    for (Index node = 0; node < nodes; ++node) {
      Vec<Dim> force = forces(d, node) * Vec<Dim>::Unit(d);
      if (place_of[node] >= 0) force = free[place_of[node]] * force;
      if (force.isZero(0.0)) continue;
      const Index dof = dof_of[node], beyond = dof - mesh.num_vertices();
      for (std::size_t p = 0; p < to.size(); ++p) {
        const double share =
            beyond < 0 ? shares[p][dof] : 0.5 * (shares[p][edges[beyond][0]] + shares[p][edges[beyond][1]]);
        to[p]->add(place(node), share * force);
      }
    }
  }
  if (space.axisymmetric())
    for (auto& [part, of] : reactions) of.moment.setZero();
  return reactions;
}

template <int Dim>
ElementReactions<Dim>::ElementReactions(const Approximation<Dim>& elements, const ElasticModel& model,
                                        const std::vector<DisplacementCondition<Dim>>& conditions)
    : elements_(elements) {
  const FineSpace<Dim>& space = elements.space;
  terms_ = stiffness_terms(elements, materials_of(model, space.mesh()));
  for (const auto& restraint : restraints(conditions))
    (can_be_nodal(space, restraint) ? nodal_ : weak_).push_back(restraint);
  if (!weak_.empty()) system_ = nitsche(space, elements.shape, terms_, weak_);
  node_at_ = element_nodes(space, tied_facets(space.mesh(), model.open_interface)).at;
}

template <int Dim>
Resultants<Dim> ElementReactions<Dim>::operator()(const Loads<Dim>& loads, const Points<Dim>& u) const {
  const FineSpace<Dim>& space = elements_.space;
  Points<Dim> forces = forces_of(terms_, u) - load_vector(space, elements_.shape, loads);
  Resultants<Dim> reactions;
  if (!weak_.empty()) {
    const Vector held = system_.matrix.template selfadjointView<Eigen::Lower>() * u.reshaped() - system_.rhs;
    forces += held.reshaped(Dim, space.size());
    reactions = nitsche_reactions<Dim>(space, elements_.shape, terms_, weak_, {}, u);
  }
  const Index nodes = node_at_.empty() ? 0 : *std::ranges::max_element(node_at_) + 1;
  Points<Dim> at_nodes = Points<Dim>::Zero(Dim, nodes);
  for (Index dof = 0; dof < space.size(); ++dof) at_nodes.col(node_at_[dof]) += forces.col(dof);
  for (const auto& [part, of] : nodal_reactions(space, node_at_, nodal_, weak_, at_nodes)) reactions[part] += of;
  return reactions;
}

template Resultants<2> nodal_reactions<2>(const FineSpace<2>&, const std::vector<Index>&,
                                          const std::vector<Restraint<2>>&, const std::vector<Restraint<2>>&,
                                          const Points<2>&, const Points<2>*);
template Resultants<3> nodal_reactions<3>(const FineSpace<3>&, const std::vector<Index>&,
                                          const std::vector<Restraint<3>>&, const std::vector<Restraint<3>>&,
                                          const Points<3>&, const Points<3>*);
template class ElementReactions<2>;
template class ElementReactions<3>;

}  // namespace efree
