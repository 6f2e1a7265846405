// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/equations/nodal_reactions.hpp"

#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/internal/spectrum.hpp"

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

template <int Dim> struct NodalReactions<Dim>::Impl {
  const FineSpace<Dim>& space;
  std::vector<Index> dof_of;  ///< by node, -1 if there is none
  std::vector<HoldingPart<Dim>> parts;
  std::vector<Index> place_of;          ///< by node: into the next two, -1 where nothing is held
  std::vector<Mat<Dim>> inverse, free;  ///< of what all parts hold together, and what is free
  /// By axis: the parts that hold something along it, and their shares by node.
  struct Along {
    std::vector<std::size_t> parts;
    std::vector<std::vector<double>> shares;
  };
  std::array<Along, Dim> along;
};

template <int Dim> NodalReactions<Dim>::NodalReactions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                                       const std::vector<Restraint<Dim>>& nodal,
                                                       const std::vector<Restraint<Dim>>& weak) {
  const FineMesh<Dim>& mesh = space.mesh();
  const Index nodes = node_at.empty() ? 0 : *std::ranges::max_element(node_at) + 1;
  auto impl =
      std::make_unique<Impl>(Impl{space, std::vector<Index>(nodes, -1), {}, std::vector<Index>(nodes, -1), {}, {}, {}});
  for (Index dof = space.size() - 1; dof >= 0; --dof)
    if (node_at[dof] >= 0) impl->dof_of[node_at[dof]] = dof;
  impl->parts = holding_parts(space, node_at, impl->dof_of, nodal, weak);
  for (const auto& part : impl->parts)
    for (const auto& [node, own] : part.held) {
      Index& place = impl->place_of[node];
      if (place < 0) place = static_cast<Index>(impl->inverse.size()), impl->inverse.push_back(Mat<Dim>::Zero());
      impl->inverse[place] += own;
    }
  for (Mat<Dim>& all : impl->inverse) {
    const Mat<Dim> inverse = internal::pseudo_inverse<Dim>(all);
    impl->free.push_back(Mat<Dim>::Identity() - inverse * all);
    all = inverse;
  }
  const Twins twins(node_at, mesh.num_vertices());
  const auto edges = space.edges();
  for (int d = 0; d < Dim; ++d) {
    auto& along = impl->along[d];
    std::vector<const std::vector<Index>*> from;
    for (std::size_t p = 0; p < impl->parts.size(); ++p)
      if (!impl->parts[p].from[d].empty()) from.push_back(&impl->parts[p].from[d]), along.parts.push_back(p);
    if (from.empty()) continue;
    for (const auto& of_vertices : shares_along(mesh, twins, from)) {
      auto& shares = along.shares.emplace_back(nodes, 0.0);
      for (Index node = 0; node < nodes; ++node) {
        const Index dof = impl->dof_of[node], beyond = dof - mesh.num_vertices();
        if (dof < 0) continue;
        shares[node] =
            beyond < 0 ? of_vertices[dof] : 0.5 * (of_vertices[edges[beyond][0]] + of_vertices[edges[beyond][1]]);
      }
    }
  }
  impl_ = std::move(impl);
}

template <int Dim> NodalReactions<Dim>::~NodalReactions() = default;

template <int Dim>
Resultants<Dim> NodalReactions<Dim>::operator()(const Points<Dim>& forces, const Points<Dim>* moved_by) const {
  const auto& [space, dof_of, parts, place_of, inverse, free, along] = *impl_;
  const auto place = [&, &space = space, &dof_of = dof_of](Index node) {
    Vec<Dim> x = space.points().col(dof_of[node]);
    if (moved_by) x += moved_by->col(dof_of[node]);
    return x;
  };
  Resultants<Dim> reactions;
  // At nodes that are held: along what is held each part has its own, the rest is free.
  for (const auto& part : parts) {
    Resultant<Dim>& reaction = reactions[part.name];
    for (const auto& [node, own] : part.held)
      reaction.add(place(node), own * (inverse[place_of[node]] * Vec<Dim>(forces.col(node))));
  }
  const Index nodes = static_cast<Index>(forces.cols());
  for (int d = 0; d < Dim; ++d)
    for (std::size_t p = 0; p < along[d].parts.size(); ++p) {
      const std::vector<double>& shares = along[d].shares[p];
      Resultant<Dim> held;
      double force = 0.0;                // along the axis, of nodes where nothing is held
      Vec<Dim> arms = Vec<Dim>::Zero();  // times the places where it acts
      for (Index node = 0; node < nodes; ++node) {
        const double here = shares[node] * forces(d, node);
        if (here == 0.0) continue;
        if (place_of[node] >= 0) {
          held.add(place(node), free[place_of[node]] * (here * Vec<Dim>::Unit(d)));
        } else {
          force += here;
          arms += here * place(node);
        }
      }
      held.force[d] += force;
      held.moment += moment_of<Dim>(arms, Vec<Dim>::Unit(d));
      reactions[parts[along[d].parts[p]].name] += held;
    }
  if (space.axisymmetric())
    for (auto& [part, of] : reactions) of.moment.setZero();
  return reactions;
}

template <int Dim>
double NodalReactions<Dim>::free_work(const Points<Dim>& forces, const Points<Dim>& displacements) const {
  double work = 0.0;
  for (Index node = 0; node < static_cast<Index>(forces.cols()); ++node) {
    const Vec<Dim> u = displacements.col(impl_->dof_of[node]), force = forces.col(node);
    const Index place = impl_->place_of[node];
    work += u.dot(place < 0 ? force : Vec<Dim>(impl_->free[place] * force));
  }
  return work;
}

template class NodalReactions<2>;
template class NodalReactions<3>;

}  // namespace efree
