// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/nitsche.hpp"

#include "efree/assembly/internal/constraints.hpp"

namespace efree {
namespace {

using internal::BoundaryPoint;
using internal::by_kind;
using internal::Constraint;
using internal::Constraints;
using internal::penalties;
using internal::penalty_at;
using internal::penalty_forces;
using internal::penalty_matrix;
using internal::Shares;
using internal::shares;
using internal::stiffness_at;
using internal::summed;

/// -int (flux of u).[v] and its transpose, for one term of the stiffness; what belongs on the right goes to rhs. The
/// pressure kappa theta_K of a K sees of v only the volume J_K(v) = int Phi_K [v].n that crosses the boundary, so that
/// the penalty 4 kappa / w_K J_K(u) J_K(v) is enough for it. Held point by point, with a stiffness that grows beyond
/// all bounds as materials become incompressible, functions that are not interpolatory would lock.
template <int Dim>
SymmetricMatrix consistency(const ShapeTable<Dim>& shape, const std::vector<StiffnessTerm<Dim>>& terms,
                            const std::vector<std::vector<double>>& penalty, const Constraints<Dim>& constraints,
                            const StiffnessTerm<Dim>& term, Points<Dim>& rhs) {
  using Block = Eigen::Matrix<double, Dim, gradient_size<Dim>>;
  // Over the points of the term on the boundary: visit(K, what the flux at K is multiplied with, d n^T for all d held).
  const auto for_fluxes = [&](const Constraint<Dim>& constraint, const auto& visit) {
    Block normal;
    for (int i = 0; i < Dim; ++i) normal.row(i) = NodalGradient<Dim>{constraint.n}.of(Vec<Dim>::Unit(i)).transpose();
    const Shares share = shares(terms, penalty, constraint);
    for (std::size_t s = 0; s < constraint.sides.size(); ++s)
      for (SparseRows::InnerIterator phi(term.discretization->on_facets, constraint.sides[s].point.row); phi; ++phi)
        visit(static_cast<Index>(phi.col()), constraint.weight() * share.flux[s] * phi.value(), normal);
  };
  // (K, fine v): int Phi_K eta_v sum_d d (d n^T)
  const auto jumps = summed<std::pair<Index, Index>, Block>(constraints, [&](const auto& constraint, auto& sums) {
    for_fluxes(constraint, [&](Index K, double factor, const Block& normal) {
      const Block block = constraint.directions * normal;
      for (const auto& [point, sign] : constraint.sides)
        for (std::size_t i = 0; i < point.dofs.size(); ++i)
          if (point.N[i] != 0.0) sums.add({K, point.dofs[i]}, sign * factor * point.N[i] * block);
    });
  });
  // K: int Phi_K sum_d g d n^T
  const auto values = summed<Index, Gradient<Dim>>(constraints, [&](const auto& constraint, auto& sums) {
    for_fluxes(constraint, [&](Index K, double factor, const Block& normal) {
      sums.add(K, factor * (normal.transpose() * constraint.value));
    });
  });

  const auto& discretization = *term.discretization;
  for (const auto& [K, q] : values) {
    const auto row = discretization.shape.row(K);
    const Gradient<Dim> flux = term.tangents[K] * q;
    for (std::size_t k = 0; k < row.nodes.size(); ++k) rhs.col(row.nodes[k]) -= nodal_gradient(row, k).force(flux);
  }

  // One row for each K on the boundary: the nodes whose stress or whose jump it sees.
  struct Entry {
    Block jump = Block::Zero();  // int Phi_K phi_a sum_d d (B(n) d)^T
    Block flux = Block::Zero();  // stresses of the node, transposed
  };
  std::vector<std::size_t> first_jump;  // of each K
  for (std::size_t s = 0; s < jumps.size(); ++s)
    if (s == 0 || jumps[s].first.first != jumps[s - 1].first.first) first_jump.push_back(s);
  const Index rows = static_cast<Index>(first_jump.size());
  first_jump.push_back(jumps.size());
  constexpr Index chunk = 64;
  struct Part {
    Ragged<Index> nodes;
    std::vector<Entry> entries;
  };
  std::vector<Part> parts((rows + chunk - 1) / chunk);
  parallel_chunks(rows, chunk, [&](Index begin, Index end) {
    Part& part = parts[begin / chunk];
    Accumulator<Block> nodal(shape.num_nodes());
    for (Index r = begin; r < end; ++r) {
      const Index K = jumps[first_jump[r]].first.first;
      nodal.clear();
      for (std::size_t s = first_jump[r]; s < first_jump[r + 1]; ++s) {
        const auto row = shape.row(jumps[s].first.second);
        for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal[row.nodes[k]] += row.N[k] * jumps[s].second;
      }
      const auto row = discretization.shape.row(K);
      for (Index node : row.nodes) nodal[node];  // those that only the stress sees
      std::size_t k = 0;
      for (Index node : nodal.sorted()) {
        Entry entry{nodal[node]};
        if (k < row.nodes.size() && row.nodes[k] == node)
          entry.flux = nodal_gradient(row, k++).stress(term.tangents[K]).transpose();
        part.nodes.items.push_back(node);
        part.entries.push_back(entry);
      }
      part.nodes.close_row();
    }
  });
  const auto nodes_of = [&](Index row) { return parts[row / chunk].nodes[row % chunk]; };
  const auto entries_of = [&](Index row) {
    return parts[row / chunk].entries.data() + parts[row / chunk].nodes.offsets[row % chunk];
  };

  if (term.pressure) {
    const Gradient<Dim> trace = trace_direction<Dim>();
    auto value = values.begin();
    for (Index r = 0; r < rows; ++r) {
      const Index K = jumps[first_jump[r]].first.first;
      while (value->first != K) ++value;
      const double penalty_of_pressure = 4.0 * term.tangents[K](0, 0) / discretization.weights[K];
      if (!(penalty_of_pressure > 0.0)) continue;
      Entry* entry = entries_of(r);
      for (const Index node : nodes_of(r)) {
        const Vec<Dim> crossing = entry->jump * trace;
        entry->flux -= 0.5 * penalty_of_pressure * crossing * trace.transpose();  // half of it from each of the two
        rhs.col(node) += penalty_of_pressure * trace.dot(value->second) * crossing;
        ++entry;
      }
    }
  }
  const auto by_node = places_of_nodes(shape.num_nodes(), rows, nodes_of);
  return gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [row, k] : by_node[a]) {
      const auto row_nodes = nodes_of(row);
      const Entry* of_row = entries_of(row);
      for (std::size_t l = k; l < row_nodes.size(); ++l)
        sums[row_nodes[l]].noalias() -=
            of_row[l].jump * of_row[k].flux.transpose() + of_row[l].flux * of_row[k].jump.transpose();
    }
  });
}

}  // namespace

template <int Dim> NitscheSystem<Dim> nitsche(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const std::vector<StiffnessTerm<Dim>>& terms,
                                              const std::vector<Restraint<Dim>>& restraints,
                                              const std::vector<TiedFacets>& ties) {
  Points<Dim> rhs = Points<Dim>::Zero(Dim, shape.num_nodes());
  const auto [rigid, elastic] = by_kind(restraints);
  const Constraints<Dim> constraints(space, rigid, ties);
  std::vector<std::vector<double>> penalty;
  for (const auto& term : terms) penalty.push_back(penalties(term, constraints));
  const auto beta = [&](const Constraint<Dim>& constraint) { return shares(terms, penalty, constraint).beta; };
  NitscheSystem<Dim> system;
  system.matrix = penalty_matrix(shape, constraints, beta);
  rhs += penalty_forces(space, shape, constraints, beta);
  for (const auto& term : terms) system.matrix += consistency(shape, terms, penalty, constraints, term, rhs);
  for (const auto& spring : elastic) {
    const auto k = [&](const Constraint<Dim>& at) { return stiffness_at<Dim>(spring, at.sides.front().point.x); };
    const Constraints<Dim> held(space, {spring}, {});
    system.matrix += penalty_matrix(shape, held, k);
    rhs += penalty_forces(space, shape, held, k);
  }
  system.rhs = rhs.reshaped();
  return system;
}

template <int Dim> struct NitscheReactions<Dim>::Impl {
  const FineSpace<Dim>& space;
  const ShapeTable<Dim>& shape;
  const std::vector<StiffnessTerm<Dim>>& terms;
  std::vector<Restraint<Dim>> rigid, elastic;
  Constraints<Dim> constraints;
  std::vector<Constraints<Dim>> springs;  ///< of each elastic restraint
  std::vector<std::vector<double>> penalty;

  /// Some of many, and which one each of the many is.
  struct Few {
    std::vector<Index> all, place;

    explicit Few(Index many) : place(many, -1) {}
    void add(Index one) {
      if (place[one] < 0) place[one] = static_cast<Index>(all.size()), all.push_back(one);
    }
    Index size() const { return static_cast<Index>(all.size()); }
  };
  Few dofs;                 ///< of the space, whose displacement a constraint sees
  std::vector<Few> points;  ///< by term: whose stress one sees
};

template <int Dim> NitscheReactions<Dim>::NitscheReactions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                           const std::vector<StiffnessTerm<Dim>>& terms,
                                                           const std::vector<Restraint<Dim>>& restraints,
                                                           const std::vector<TiedFacets>& ties) {
  auto [rigid, elastic] = by_kind(restraints);
  const Constraints<Dim> constraints(space, rigid, ties);
  auto impl = std::make_unique<Impl>(Impl{space,
                                          shape,
                                          terms,
                                          std::move(rigid),
                                          std::move(elastic),
                                          constraints,
                                          {},
                                          {},
                                          typename Impl::Few(space.size()),
                                          {}});
  const auto add_dofs = [&](const Constraint<Dim>& constraint) {
    for (const auto& [point, sign] : constraint.sides)
      for (const Index dof : point.dofs) impl->dofs.add(dof);
  };
  constraints.for_each(add_dofs);
  for (const auto& spring : impl->elastic) {
    impl->springs.emplace_back(space, std::vector{spring}, std::vector<TiedFacets>{});
    impl->springs.back().for_each(add_dofs);
  }
  for (const auto& term : terms) {
    impl->penalty.push_back(penalties(term, constraints));
    auto& points = impl->points.emplace_back(term.discretization->size());
    constraints.for_each([&](const Constraint<Dim>& constraint) {
      for (const auto& [point, sign] : constraint.sides)
        for (SparseRows::InnerIterator phi(term.discretization->on_facets, point.row); phi; ++phi)
          points.add(static_cast<Index>(phi.col()));
    });
  }
  impl_ = std::move(impl);
}

template <int Dim> NitscheReactions<Dim>::~NitscheReactions() = default;

template <int Dim> Resultants<Dim> NitscheReactions<Dim>::operator()(const Points<Dim>& U, double factor) const {
  const auto& [space, shape, terms, rigid, elastic, constraints, springs, penalty, dofs, points] = *impl_;
  Points<Dim> u = Points<Dim>::Zero(Dim, dofs.size());
  for (Index i = 0; i < dofs.size(); ++i) {
    const auto row = shape.row(dofs.all[i]);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) u.col(i) += row.N[k] * U.col(row.nodes[k]);
  }
  // What is held at a constraint, less what is prescribed.
  const auto gap = [&, &dofs = dofs](const Constraint<Dim>& constraint) {
    Vec<Dim> jump = Vec<Dim>::Zero();
    for (const auto& [point, sign] : constraint.sides)
      for (std::size_t i = 0; i < point.dofs.size(); ++i) jump += sign * point.N[i] * u.col(dofs.place[point.dofs[i]]);
    return Vec<Dim>(constraint.directions * jump - factor * constraint.value);
  };
  std::vector<Gradients<Dim>> fluxes;  // by term and point: stress, with what holds the volume that crosses
  const Gradient<Dim> trace = trace_direction<Dim>();
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const auto& term = terms[t];
    const auto& table = *term.discretization;
    const auto& seen = points[t];
    Gradients<Dim>& flux = fluxes.emplace_back(gradient_size<Dim>, seen.size());
    for (Index i = 0; i < seen.size(); ++i) {
      const auto row = table.shape.row(seen.all[i]);
      Gradient<Dim> H = Gradient<Dim>::Zero();
      for (std::size_t k = 0; k < row.nodes.size(); ++k) H += nodal_gradient(row, k).of(U.col(row.nodes[k]));
      flux.col(i) = term.tangents[seen.all[i]] * H;
    }
    if (!term.pressure) continue;
    constraints.for_each([&, &terms = terms, &penalty = penalty](const Constraint<Dim>& constraint) {
      const Shares share = shares(terms, penalty, constraint);
      const double crossing = constraint.weight() * gap(constraint).dot(constraint.n);
      for (std::size_t s = 0; s < constraint.sides.size(); ++s)
        for (SparseRows::InnerIterator phi(table.on_facets, constraint.sides[s].point.row); phi; ++phi) {
          const auto K = static_cast<Index>(phi.col());
          flux.col(seen.place[K]) -=
              4.0 * term.tangents[K](0, 0) / table.weights[K] * share.flux[s] * phi.value() * crossing * trace;
        }
    });
  }
  internal::FacetShares<Dim> parts(space.mesh(), rigid);
  Resultants<Dim> reactions;
  constraints.for_each([&, &terms = terms, &penalty = penalty, &points = points](const Constraint<Dim>& constraint) {
    if (constraint.sides.size() > 1) return;  // ties are within the body
    const BoundaryPoint<Dim>& point = constraint.sides.front().point;
    Vec<Dim> traction = -penalty_at(terms, penalty, point) * gap(constraint);
    for (std::size_t t = 0; t < terms.size(); ++t)
      for (SparseRows::InnerIterator phi(terms[t].discretization->on_facets, point.row); phi; ++phi)
        traction += phi.value() * (constraint.directions * NodalGradient<Dim>{point.n}.force(fluxes[t].col(
                                                               points[t].place[static_cast<Index>(phi.col())])));
    for (const auto& [part, share] : parts.at(point.facet, point.n))
      reactions[part].add(point.x, point.weight * (share * traction));
  });
  for (std::size_t k = 0; k < elastic.size(); ++k) {
    const Restraint<Dim>& spring = elastic[k];
    Resultant<Dim>& reaction = reactions[spring.on];
    springs[k].for_each([&](const Constraint<Dim>& constraint) {
      const BoundaryPoint<Dim>& point = constraint.sides.front().point;
      reaction.add(point.x, -point.weight * stiffness_at<Dim>(spring, point.x) * gap(constraint));
    });
  }
  if (space.axisymmetric())
    for (auto& [part, of] : reactions) of.moment.setZero();
  return reactions;
}

template NitscheSystem<2> nitsche<2>(const FineSpace<2>&, const ShapeTable<2>&, const std::vector<StiffnessTerm<2>>&,
                                     const std::vector<Restraint<2>>&, const std::vector<TiedFacets>&);
template NitscheSystem<3> nitsche<3>(const FineSpace<3>&, const ShapeTable<3>&, const std::vector<StiffnessTerm<3>>&,
                                     const std::vector<Restraint<3>>&, const std::vector<TiedFacets>&);
template class NitscheReactions<2>;
template class NitscheReactions<3>;

}  // namespace efree
