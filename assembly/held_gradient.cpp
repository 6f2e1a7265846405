// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/held_gradient.hpp"

#include "efree/assembly/internal/constraints.hpp"
#include "efree/core/parallel.hpp"

#include <map>

namespace efree {

using internal::BoundaryPoint;
using internal::by_kind;
using internal::Constraint;
using internal::Constraints;
using internal::penalties;
using internal::penalty_forces;
using internal::penalty_matrix;
using internal::Shares;
using internal::shares;
using internal::stiffness_at;
using internal::summed;

namespace {

/// Share of the penalty of Nitsche's method, 4 c |Gamma_K| / w_K, that is enough here.
constexpr double share_of_penalty = 0.25;

/// Calls visit(K, factor of side and Phi_K times the weight) for the quadrature points that see a constraint.
template <int Dim, class Visit> void for_lifted(const Constraint<Dim>& constraint, const Shares& share,
                                                const Quadrature<Dim>& quadrature, const Visit& visit) {
  for (std::size_t s = 0; s < constraint.sides.size(); ++s)
    for (SparseRows::InnerIterator phi(quadrature.on_facets, constraint.sides[s].point.row); phi; ++phi) {
      const auto K = static_cast<Index>(phi.col());
      visit(K, share.flux[s] * constraint.weight() * phi.value() / quadrature.weights[K]);
    }
}
/// The gradient that u (x) n is, by u.
template <int Dim> GradientBlock<Dim> outer(const Vec<Dim>& n) {
  GradientBlock<Dim> result;
  for (int i = 0; i < Dim; ++i) result.col(i) = NodalGradient<Dim>{n}.of(Vec<Dim>::Unit(i));
  return result;
}

}  // namespace

template <int Dim> HeldGradient<Dim>::HeldGradient(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                   const StiffnessTerm<Dim>& term,
                                                   std::vector<Restraint<Dim>> restraints, std::vector<TiedFacets> ties)
    : space_(space), shape_(shape), quadrature_(*term.discretization), term_{term}, ties_(std::move(ties)) {
  const auto [rigid, elastic] = by_kind(restraints);
  const Constraints<Dim> constraints(space, rigid, ties_);
  penalties_.push_back(penalties(term, constraints));
  for (double& beta : penalties_.front()) beta *= share_of_penalty;
  const auto beta = [&](const Constraint<Dim>& constraint) { return shares(term_, penalties_, constraint).beta; };
  // (K, fine v): what the gradient at K loses by the displacement of v
  const auto lifted = summed<std::pair<Index, Index>, GradientBlock<Dim>>(
      constraints, [&](const Constraint<Dim>& constraint, auto& sums) {
        const GradientBlock<Dim> jump = outer(constraint.n) * constraint.directions;
        for_lifted(constraint, shares(term_, penalties_, constraint), quadrature_, [&](Index K, double factor) {
          for (const auto& [point, sign] : constraint.sides)
            for (std::size_t i = 0; i < point.dofs.size(); ++i)
              if (point.N[i] != 0.0) sums.add({K, point.dofs[i]}, sign * factor * point.N[i] * jump);
        });
      });
  lifted_.assign(quadrature_.size(), -1);
  Accumulator<GradientBlock<Dim>> nodal(shape.num_nodes());
  for (std::size_t s = 0; s < lifted.size();) {
    const Index K = lifted[s].first.first;
    nodal.clear();
    const auto row = quadrature_.shape.row(K);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      for (int i = 0; i < Dim; ++i) nodal[row.nodes[k]].col(i) += nodal_gradient(row, k).of(Vec<Dim>::Unit(i));
    for (; s < lifted.size() && lifted[s].first.first == K; ++s) {
      const auto values = shape.row(lifted[s].first.second);
      for (std::size_t k = 0; k < values.nodes.size(); ++k) nodal[values.nodes[k]] -= values.N[k] * lifted[s].second;
    }
    lifted_[K] = static_cast<Index>(points_.size());
    points_.push_back(K);
    for (const Index node : nodal.sorted()) nodes_.items.push_back(node), blocks_.push_back(nodal[node]);
    nodes_.close_row();
  }
  places_ = places_of_nodes(shape.num_nodes(), nodes_.rows(), [&](Index row) { return nodes_[row]; });

  penalty_ = penalty_matrix(shape, constraints, beta);
  for (const auto& spring : elastic)
    penalty_ += penalty_matrix(shape, Constraints<Dim>(space, {spring}, {}), [&](const Constraint<Dim>& at) {
      return stiffness_at<Dim>(spring, at.sides.front().point.x);
    });
  penalty_ += gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [place, k] : places_[a])
      for (const Index node : nodes_[place].subspan(k)) sums[node];
  });
}

template <int Dim> Gradients<Dim> HeldGradient<Dim>::of(const Points<Dim>& U) const {
  Gradients<Dim> H = gradient(quadrature_, U);
  parallel_for(static_cast<Index>(points_.size()), [&](Index place) {
    Gradient<Dim> sum = Gradient<Dim>::Zero();
    for (Index k = nodes_.offsets[place]; k < nodes_.offsets[place + 1]; ++k)
      sum += blocks_[k] * U.col(nodes_.items[k]);
    H.col(points_[place]) = sum;
  });
  return H;
}

template <int Dim> Points<Dim> HeldGradient<Dim>::force(const Gradients<Dim>& P) const {
  Points<Dim> force(Dim, num_nodes());
  parallel_for(num_nodes(), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const auto& [K, k] : quadrature_.shape.by_node()[a])
      if (lifted_[K] < 0) sum += quadrature_.weights[K] * nodal_gradient(quadrature_.shape.row(K), k).force(P.col(K));
    for (const auto& [place, k] : places_[a])
      sum += quadrature_.weights[points_[place]] *
             (blocks_[nodes_.offsets[place] + k].transpose() * P.col(points_[place]));
    force.col(a) = sum;
  });
  return force;
}

template <int Dim> GradientBlock<Dim> HeldGradient<Dim>::block(Index K, std::size_t k) const {
  if (lifted_[K] >= 0) return blocks_[nodes_.offsets[lifted_[K]] + k];
  GradientBlock<Dim> result;
  const auto of_node = nodal_gradient(quadrature_.shape.row(K), k);
  for (int i = 0; i < Dim; ++i) result.col(i) = of_node.of(Vec<Dim>::Unit(i));
  return result;
}

template <int Dim>
PrescribedMotion<Dim> HeldGradient<Dim>::prescribed(const std::vector<Restraint<Dim>>& restraints) const {
  const auto [rigid, elastic] = by_kind(restraints);
  const Constraints<Dim> constraints(space_, rigid, {});
  PrescribedMotion<Dim> result{Gradients<Dim>::Zero(gradient_size<Dim>, size()), {}};
  const auto lifted = summed<Index, Gradient<Dim>>(constraints, [&](const Constraint<Dim>& constraint, auto& sums) {
    const Gradient<Dim> jump = outer(constraint.n) * constraint.value;
    for_lifted(constraint, shares(term_, penalties_, constraint), quadrature_,
               [&](Index K, double factor) { sums.add(K, factor * jump); });
  });
  for (const auto& [K, value] : lifted) result.gradients.col(K) = value;
  result.forces = penalty_forces(space_, shape_, constraints, [&](const Constraint<Dim>& constraint) {
    return shares(term_, penalties_, constraint).beta;
  });
  for (const auto& spring : elastic)
    result.forces +=
        penalty_forces(space_, shape_, Constraints<Dim>(space_, {spring}, {}),
                       [&](const Constraint<Dim>& at) { return stiffness_at<Dim>(spring, at.sides.front().point.x); });
  return result;
}

template <int Dim>
double HeldGradient<Dim>::largest_gap(const std::vector<Restraint<Dim>>& restraints, const Points<Dim>& U) const {
  const Points<Dim> u = interpolate(shape_, U);
  double largest = 0.0;
  Constraints<Dim>(space_, by_kind(restraints)[0], {}).for_each([&](const Constraint<Dim>& constraint) {
    const BoundaryPoint<Dim>& point = constraint.sides.front().point;
    Vec<Dim> there = Vec<Dim>::Zero();
    for (std::size_t i = 0; i < point.dofs.size(); ++i) there += point.N[i] * u.col(point.dofs[i]);
    largest = std::max(largest, (constraint.directions * there - constraint.value).norm());
  });
  return largest;
}

template <int Dim> Resultants<Dim> HeldGradient<Dim>::reactions(const std::vector<Restraint<Dim>>& restraints,
                                                                const Gradients<Dim>& P, const Points<Dim>& U,
                                                                bool moved) const {
  const auto [rigid, elastic] = by_kind(restraints);
  const Points<Dim> u = interpolate(shape_, U);
  const auto displacement = [&](const Constraint<Dim>& constraint) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    const auto& point = constraint.sides.front().point;
    for (std::size_t i = 0; i < point.dofs.size(); ++i) sum += point.N[i] * u.col(point.dofs[i]);
    return sum;
  };
  Resultants<Dim> reactions;
  internal::FacetShares<Dim> parts(space_.mesh(), rigid);
  Constraints<Dim>(space_, rigid, {}).for_each([&](const Constraint<Dim>& constraint) {
    const BoundaryPoint<Dim>& point = constraint.sides.front().point;
    const Shares share = shares(term_, penalties_, constraint);
    const Vec<Dim> there = displacement(constraint), gap = constraint.directions * there - constraint.value;
    Vec<Dim> traction = Vec<Dim>::Zero();
    for_lifted(constraint, share, quadrature_, [&](Index K, double factor) {
      traction += factor * quadrature_.weights[K] * NodalGradient<Dim>{point.n}.force(P.col(K));
    });
    const Vec<Dim> held = constraint.directions * traction, push = -point.weight * share.beta * gap;
    const Vec<Dim> now = moved ? Vec<Dim>(point.x + there) : point.x;
    for (const auto& [part, of_part] : parts.at(point.facet, point.n)) {
      reactions[part].add(now, of_part * (held + push));
      // Stresses turn with the body as far as the gap is taken from their gradients, also across what is held.
      if (moved) reactions[part].moment -= moment_of<Dim>(of_part * gap, traction);
    }
  });
  for (const auto& spring : elastic)
    Constraints<Dim>(space_, {spring}, {}).for_each([&](const Constraint<Dim>& constraint) {
      const BoundaryPoint<Dim>& point = constraint.sides.front().point;
      const Vec<Dim> there = displacement(constraint), gap = constraint.directions * there - constraint.value;
      reactions[spring.on].add(moved ? Vec<Dim>(point.x + there) : point.x,
                               -point.weight * stiffness_at<Dim>(spring, point.x) * gap);
    });
  if (space_.axisymmetric())
    for (auto& [part, of] : reactions) of.moment.setZero();
  return reactions;
}

template class HeldGradient<2>;
template class HeldGradient<3>;

}  // namespace efree
