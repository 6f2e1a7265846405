// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/constraints.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <cmath>
#include <map>

namespace efree::internal {
namespace {

/// Coordinates on `other` of the facet rule's points on f; the two facets have their vertices in the same places.
template <int Dim>
std::vector<Eigen::Matrix<double, Dim, 1>> points_on_twin(const FineSpace<Dim>& space, Index f, Index other) {
  const auto& mesh = space.mesh();
  std::vector<Eigen::Matrix<double, Dim, 1>> points;
  for (Index g = 0; g < space.facet_rule().weights.size(); ++g) {
    Eigen::Matrix<double, Dim, 1> at;
    for (int k = 0; k < Dim; ++k)
      for (int l = 0; l < Dim; ++l)
        if (mesh.vertex(mesh.facets()(k, other)) == mesh.vertex(mesh.facets()(l, f)))
          at[k] = space.facet_rule().points(l, g);
    points.push_back(at);
  }
  return points;
}

/// What all restraints on a facet hold at one of its points, every direction once however many prescribe it.
template <int Dim>
HeldPoint<Dim> held_at(const BoundaryPoint<Dim>& point, const std::vector<const Restraint<Dim>*>& restraints) {
  HeldPoint<Dim> result;
  std::vector<Vec<Dim>> directions;
  std::vector<double> values;
  bool orthogonal = true;
  for (const Restraint<Dim>* restraint : restraints) {
    const Vec<Dim> d = restraint->direction(point.n);
    for (const Vec<Dim>& other : directions) orthogonal = orthogonal && d.dot(other) == 0.0;
    directions.push_back(d);
    values.push_back(prescribed(*restraint, point.x));
  }
  if (orthogonal) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      result.directions += directions[k] * directions[k].transpose();
      result.value += values[k] * directions[k];
    }
    return result;
  }
  const auto held = held_by<Dim>(directions, values);
  if (!held) {
    std::vector<std::string> parts;
    for (const Restraint<Dim>* restraint : restraints) parts.push_back(restraint->on);
    contradict(parts, place_text<Dim>(point.x));
  }
  const auto span = held->frame.leftCols(held->rank);
  result.directions = span * span.transpose();
  result.value = held->value;
  return result;
}

/// Stiffness along a normal: the largest (P n . d)^2 / (H : P) over unit directions d and all gradients H.
template <int Dim> double normal_stiffness(const Tangent<Dim>& A, const Vec<Dim>& n) {
  const NodalGradient<Dim> along{n};
  return eigenvalues<Dim>(along.forces(along.stress(A))).maxCoeff();
}

}  // namespace

template <int Dim> std::vector<std::pair<Index, std::size_t>> by_facet(const FineMesh<Dim>& mesh,
                                                                       const std::vector<Restraint<Dim>>& restraints) {
  std::vector<std::pair<Index, std::size_t>> pairs;
  for (std::size_t r = 0; r < restraints.size(); ++r)
    for (const Index f : mesh.group(restraints[r].on)) pairs.emplace_back(f, r);
  std::ranges::sort(pairs);
  return pairs;
}

template <int Dim>
Constraints<Dim>::Constraints(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                              std::vector<TiedFacets> ties)
    : space_(space), ties_(std::move(ties)) {
  const auto pairs = by_facet(space.mesh(), restraints);
  for (std::size_t s = 0; s < pairs.size();) {
    const Index f = pairs[s].first;
    std::vector<const Restraint<Dim>*> on_facet;
    for (; s < pairs.size() && pairs[s].first == f; ++s) on_facet.push_back(&restraints[pairs[s].second]);
    facets_.push_back(f);
    for_each_point<Dim>(space, {&f, 1},
                        [&](const BoundaryPoint<Dim>& point) { held_.push_back(held_at(point, on_facet)); });
  }
}

template <int Dim> void Constraints<Dim>::for_each(Index part, const Visit& visit) const {
  const Index of_facets = parts(facets_.size());
  if (part < of_facets)
    for_each_held(range(facets_, part), visit);
  else
    for_each_tie(range(ties_, part - of_facets), visit);
}

template <int Dim> void Constraints<Dim>::for_each_held(std::span<const Index> facets, const Visit& visit) const {
  auto held = held_.begin() + (facets.data() - facets_.data()) * space_.facet_rule().weights.size();
  for_each_point<Dim>(space_, facets, [&](const BoundaryPoint<Dim>& point) {
    visit(Constraint<Dim>{{{point, 1.0}}, point.n, held->directions, held->value});
    ++held;
  });
}

template <int Dim> void Constraints<Dim>::for_each_tie(std::span<const TiedFacets> ties, const Visit& visit) const {
  for (const TiedFacets& tie : ties) {
    const Index f = tie.first, other = tie.second;
    const auto twins = points_on_twin(space_, f, other);
    const Index per_facet = static_cast<Index>(twins.size());
    const Index c = space_.mesh().facet_cell(other);
    Index g = 0;
    for_each_point<Dim>(space_, {&f, 1}, [&](const BoundaryPoint<Dim>& point) {
      BoundaryPoint<Dim> twin = point;
      twin.facet = other;
      // Phi_K of the far side at the rule point nearest to this one: the rule is symmetric, so it is the same place.
      Index row = 0;
      for (Index q = 0; q < per_facet; ++q)
        if ((space_.facet_rule().points.col(q) - twins[g]).squaredNorm() <
            (space_.facet_rule().points.col(row) - twins[g]).squaredNorm())
          row = q;
      twin.row = other * per_facet + row;
      twin.n = -point.n;
      twin.dofs = space_.cell(c);
      twin.N = space_.values(space_.facet_point(other, twins[g]));
      visit(Constraint<Dim>{{{point, 1.0}, {twin, -1.0}}, point.n, Mat<Dim>::Identity(), Vec<Dim>::Zero()});
      ++g;
    });
  }
}

template <int Dim> std::vector<double> penalties(const StiffnessTerm<Dim>& term, const Constraints<Dim>& constraints) {
  const auto& discretization = *term.discretization;
  std::vector<double> penalty(discretization.size(), 0.0);
  if (term.pressure) return penalty;
  constraints.for_each([&](const Constraint<Dim>& constraint) {
    // Once for every direction held: more than the inequality asks for where all are.
    const double times = constraint.sides.size() == 1 ? std::round(constraint.directions.trace()) : 1.0;
    for (const auto& [point, sign] : constraint.sides)
      for (SparseRows::InnerIterator phi(discretization.on_facets, point.row); phi; ++phi) {
        const Index K = static_cast<Index>(phi.col());
        penalty[K] += 4.0 * normal_stiffness<Dim>(term.tangents[K], point.n) / discretization.weights[K] * times *
                      std::abs(point.weight * phi.value());
      }
  });
  return penalty;
}

template <int Dim> double penalty_at(const std::vector<StiffnessTerm<Dim>>& terms,
                                     const std::vector<std::vector<double>>& penalty, const BoundaryPoint<Dim>& point) {
  double beta = 0.0;
  for (std::size_t t = 0; t < terms.size(); ++t)
    for (SparseRows::InnerIterator phi(terms[t].discretization->on_facets, point.row); phi; ++phi)
      beta += std::abs(phi.value()) * penalty[t][phi.col()];
  return beta;
}

template <int Dim> Shares shares(const std::vector<StiffnessTerm<Dim>>& terms,
                                 const std::vector<std::vector<double>>& penalty, const Constraint<Dim>& constraint) {
  const double first = penalty_at(terms, penalty, constraint.sides[0].point);
  if (constraint.sides.size() == 1) return {{1.0, 0.0}, first};
  const double second = penalty_at(terms, penalty, constraint.sides[1].point);
  return {{second / (first + second), first / (first + second)}, first * second / (first + second)};
}

template <int Dim> Points<Dim> penalty_forces(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const Constraints<Dim>& constraints, const ByConstraint<Dim>& beta) {
  const auto forces = summed<Index, Vec<Dim>>(constraints, [&](const auto& constraint, auto& sums) {
    const double factor = constraint.weight() * beta(constraint);
    for (const auto& [at, sign] : constraint.sides)
      for (std::size_t i = 0; i < at.dofs.size(); ++i)
        if (at.N[i] != 0.0) sums.add(at.dofs[i], sign * factor * at.N[i] * constraint.value);
  });
  Points<Dim> fine = Points<Dim>::Zero(Dim, space.size());
  for (const auto& [v, force] : forces) fine.col(v) = force;
  return to_nodes(shape, fine);
}

template <int Dim> SymmetricMatrix penalty_matrix(const ShapeTable<Dim>& shape, const Constraints<Dim>& constraints,
                                                  const ByConstraint<Dim>& beta) {
  const auto beta_at = [&](const Constraint<Dim>& constraint) { return constraint.weight() * beta(constraint); };
  const auto fine = summed<std::pair<Index, Index>, Mat<Dim>>(constraints, [&](const auto& constraint, auto& sums) {
    const double factor = beta_at(constraint);
    for (const auto& [at, sign] : constraint.sides)
      for (std::size_t i = 0; i < at.dofs.size(); ++i)
        for (const auto& [other, other_sign] : constraint.sides)
          for (std::size_t j = 0; j < other.dofs.size(); ++j)
            if (at.N[i] != 0.0 && other.N[j] != 0.0)
              sums.add({at.dofs[i], other.dofs[j]},
                       (sign * other_sign * factor * at.N[i] * other.N[j]) * constraint.directions);
  });

  // One row for each fine v on the boundary: its nodes against the sum over its neighbours w there.
  std::vector<Index> vertices;
  Ragged<Index> columns;
  std::vector<Mat<Dim>> sums_over_neighbours;
  Accumulator<Mat<Dim>> nodal(shape.num_nodes());
  for (std::size_t s = 0; s < fine.size();) {
    const Index v = fine[s].first.first;
    nodal.clear();
    for (; s < fine.size() && fine[s].first.first == v; ++s) {
      const auto row = shape.row(fine[s].first.second);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) nodal[row.nodes[k]] += row.N[k] * fine[s].second;
    }
    vertices.push_back(v);
    for (Index node : nodal.sorted()) columns.items.push_back(node), sums_over_neighbours.push_back(nodal[node]);
    columns.close_row();
  }
  const auto by_node = places_of_nodes(shape.num_nodes(), static_cast<Index>(vertices.size()),
                                       [&](Index row) { return shape.row(vertices[row]).nodes; });
  return gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [row, k] : by_node[a]) {
      const double N = shape.row(vertices[row]).N[k];
      const auto others = columns[row];
      const auto first = std::lower_bound(others.begin(), others.end(), a) - others.begin();
      for (std::size_t l = first; l < others.size(); ++l)
        sums[others[l]] += N * sums_over_neighbours[columns.offsets[row] + l].transpose();
    }
  });
}

template <int Dim> std::array<std::vector<Restraint<Dim>>, 2> by_kind(const std::vector<Restraint<Dim>>& restraints) {
  std::array<std::vector<Restraint<Dim>>, 2> kinds;
  for (const auto& restraint : restraints) kinds[restraint.is_elastic()].push_back(restraint);
  return kinds;
}
template <int Dim> double stiffness_at(const Restraint<Dim>& spring, const Vec<Dim>& x) {
  const double k = spring.stiffness(x);
  if (!(k >= 0.0 && std::isfinite(k)))
    throw InputError(fmt::format("stiffness on \"{}\" is {} at {}, expected a finite number >= 0", spring.on, k,
                                 place_text<Dim>(x)));
  return k;
}

template <int Dim> const typename FacetShares<Dim>::Shares& FacetShares<Dim>::at(Index facet, const Vec<Dim>& n) {
  if (std::exchange(facet_, facet) == facet) return shares_;
  std::map<std::string, Mat<Dim>> own;
  Mat<Dim> all = Mat<Dim>::Zero();
  for (auto pair = std::ranges::lower_bound(pairs_, std::pair(facet, std::size_t{0}));
       pair != pairs_.end() && pair->first == facet; ++pair) {
    const Restraint<Dim>& restraint = restraints_[pair->second];
    const Vec<Dim> d = restraint.direction(n);
    own.try_emplace(restraint.on, Mat<Dim>::Zero()).first->second += d * d.transpose();
    all += d * d.transpose();
  }
  const Mat<Dim> inverse = pseudo_inverse<Dim>(all);
  shares_.clear();
  for (const auto& [part, held] : own) shares_.emplace_back(part, held * inverse);
  return shares_;
}

template std::vector<std::pair<Index, std::size_t>> by_facet<2>(const FineMesh<2>&, const std::vector<Restraint<2>>&);
template class Constraints<2>;
template std::vector<double> penalties<2>(const StiffnessTerm<2>&, const Constraints<2>&);
template double penalty_at<2>(const std::vector<StiffnessTerm<2>>&, const std::vector<std::vector<double>>&,
                              const BoundaryPoint<2>&);
template Shares shares<2>(const std::vector<StiffnessTerm<2>>&, const std::vector<std::vector<double>>&,
                          const Constraint<2>&);
template Points<2> penalty_forces<2>(const FineSpace<2>&, const ShapeTable<2>&, const Constraints<2>&,
                                     const ByConstraint<2>&);
template SymmetricMatrix penalty_matrix<2>(const ShapeTable<2>&, const Constraints<2>&, const ByConstraint<2>&);
template std::array<std::vector<Restraint<2>>, 2> by_kind<2>(const std::vector<Restraint<2>>&);
template double stiffness_at<2>(const Restraint<2>&, const Vec<2>&);
template class FacetShares<2>;
template std::vector<std::pair<Index, std::size_t>> by_facet<3>(const FineMesh<3>&, const std::vector<Restraint<3>>&);
template class Constraints<3>;
template std::vector<double> penalties<3>(const StiffnessTerm<3>&, const Constraints<3>&);
template double penalty_at<3>(const std::vector<StiffnessTerm<3>>&, const std::vector<std::vector<double>>&,
                              const BoundaryPoint<3>&);
template Shares shares<3>(const std::vector<StiffnessTerm<3>>&, const std::vector<std::vector<double>>&,
                          const Constraint<3>&);
template Points<3> penalty_forces<3>(const FineSpace<3>&, const ShapeTable<3>&, const Constraints<3>&,
                                     const ByConstraint<3>&);
template SymmetricMatrix penalty_matrix<3>(const ShapeTable<3>&, const Constraints<3>&, const ByConstraint<3>&);
template std::array<std::vector<Restraint<3>>, 2> by_kind<3>(const std::vector<Restraint<3>>&);
template double stiffness_at<3>(const Restraint<3>&, const Vec<3>&);
template class FacetShares<3>;

}  // namespace efree::internal
