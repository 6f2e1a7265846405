// SPDX-License-Identifier: GPL-3.0-or-later
/// Points of the boundary where displacements are held or tied, and sums over them.
#pragma once

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/assembly/nitsche.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// Sums blocks with equal keys, in their order; input in any order, output sorted by key.
template <class Key, class Block> void combine(std::vector<std::pair<Key, Block>>& entries) {
  std::vector<std::pair<Key, Index>> order;
  order.reserve(entries.size());
  for (const auto& [key, block] : entries) order.emplace_back(key, static_cast<Index>(order.size()));
  std::ranges::sort(order);
  std::vector<std::pair<Key, Block>> sums;
  for (const auto& [key, k] : order)
    if (!sums.empty() && sums.back().first == key)
      sums.back().second += entries[k].second;
    else
      sums.push_back(entries[k]);
  entries = std::move(sums);
}

/// The same while the blocks come, so that there are never many more than different keys near each other.
template <class Key, class Block> class Combiner {
 public:
  void add(const Key& key, const Block& block) {
    recent_.emplace_back(key, block);
    if (recent_.size() == most) settle();
  }
  /// All of them, sorted by key.
  std::vector<std::pair<Key, Block>> take() {
    settle();
    combine(settled_);
    return std::move(settled_);
  }

 private:
  static constexpr std::size_t most = 1 << 16;
  void settle() {
    combine(recent_);
    settled_.insert(settled_.end(), recent_.begin(), recent_.end());
    recent_.clear();
  }
  std::vector<std::pair<Key, Block>> recent_, settled_;
};

/// A point of the boundary where displacements are held to a value (one side) or to each other (two sides).
template <int Dim> struct Constraint {
  struct Side {
    BoundaryPoint<Dim> point;
    double sign;  ///< of its displacement in the jump
  };
  std::vector<Side> sides;
  Vec<Dim> n;           ///< outward normal of the first side
  Mat<Dim> directions;  ///< sum of d d^T over an orthonormal set of directions held
  Vec<Dim> value;       ///< displacement along them
  double weight() const { return sides.front().point.weight; }
};

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

/// The restraints on each restrained facet: (facet, number of the restraint), ascending.
template <int Dim> std::vector<std::pair<Index, std::size_t>> by_facet(const FineMesh<Dim>& mesh,
                                                                       const std::vector<Restraint<Dim>>& restraints) {
  std::vector<std::pair<Index, std::size_t>> pairs;
  for (std::size_t r = 0; r < restraints.size(); ++r)
    for (const Index f : mesh.group(restraints[r].on)) pairs.emplace_back(f, r);
  std::ranges::sort(pairs);
  return pairs;
}

/// What restraints hold at a point: the sum of d d^T over an orthonormal set of directions, and the displacement along
/// them.
template <int Dim> struct HeldPoint {
  Mat<Dim> directions = Mat<Dim>::Zero();
  Vec<Dim> value = Vec<Dim>::Zero();
};

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

/// The constraints of all restraints, then those of the ties, in parts that do not depend on the number of threads.
/// What is prescribed is evaluated once.
template <int Dim> class Constraints {
 public:
  Constraints(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints, std::vector<TiedFacets> ties)
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

  Index num_parts() const { return parts(facets_.size()) + parts(ties_.size()); }
  /// Those of one part, always in the same order.
  template <class Visit> void for_each(Index part, const Visit& visit) const {
    const Index of_facets = parts(facets_.size());
    if (part < of_facets)
      for_each_held(range(facets_, part), visit);
    else
      for_each_tie(range(ties_, part - of_facets), visit);
  }
  template <class Visit> void for_each(const Visit& visit) const {
    for (Index part = 0; part < num_parts(); ++part) for_each(part, visit);
  }

 private:
  static constexpr std::size_t facets_per_part = 512;
  static Index parts(std::size_t size) { return static_cast<Index>((size + facets_per_part - 1) / facets_per_part); }
  template <class T> static std::span<const T> range(const std::vector<T>& all, Index part) {
    const std::size_t begin = static_cast<std::size_t>(part) * facets_per_part;
    return std::span(all).subspan(begin, std::min(facets_per_part, all.size() - begin));
  }

  template <class Visit> void for_each_held(std::span<const Index> facets, const Visit& visit) const {
    auto held = held_.begin() + (facets.data() - facets_.data()) * space_.facet_rule().weights.size();
    for_each_point<Dim>(space_, facets, [&](const BoundaryPoint<Dim>& point) {
      visit(Constraint<Dim>{{{point, 1.0}}, point.n, held->directions, held->value});
      ++held;
    });
  }
  template <class Visit> void for_each_tie(std::span<const TiedFacets> ties, const Visit& visit) const {
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

  const FineSpace<Dim>& space_;
  std::vector<TiedFacets> ties_;
  std::vector<Index> facets_;         ///< restrained ones, ascending
  std::vector<HeldPoint<Dim>> held_;  ///< at their points
};

/// The sums by key of what add(constraint, sums) adds for all constraints, sorted by key.
template <class Key, class Block, int Dim, class Add>
std::vector<std::pair<Key, Block>> summed(const Constraints<Dim>& constraints, const Add& add) {
  std::vector<std::vector<std::pair<Key, Block>>> parts(constraints.num_parts());
  parallel_chunks(constraints.num_parts(), 1, [&](Index part, Index) {
    Combiner<Key, Block> sums;
    constraints.for_each(part, [&](const Constraint<Dim>& constraint) { add(constraint, sums); });
    parts[part] = sums.take();
  });
  std::vector<std::pair<Key, Block>> all;
  for (auto& part : parts) {
    all.insert(all.end(), part.begin(), part.end());
    part = {};
  }
  combine(all);
  return all;
}

/// Stiffness along a normal: the largest (P n . d)^2 / (H : P) over unit directions d and all gradients H.
template <int Dim> double normal_stiffness(const Tangent<Dim>& A, const Vec<Dim>& n) {
  const NodalGradient<Dim> along{n};
  return Eigen::SelfAdjointEigenSolver<Mat<Dim>>(along.forces(along.stress(A)), Eigen::EigenvaluesOnly)
      .eigenvalues()
      .maxCoeff();
}

/// beta_K of one term at all its quadrature points; zero away from the constraints, and for pressures, which
/// `consistency` holds by their own means.
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

/// beta at a boundary point: the sum over the terms.
template <int Dim> double penalty_at(const std::vector<StiffnessTerm<Dim>>& terms,
                                     const std::vector<std::vector<double>>& penalty, const BoundaryPoint<Dim>& point) {
  double beta = 0.0;
  for (std::size_t t = 0; t < terms.size(); ++t)
    for (SparseRows::InnerIterator phi(terms[t].discretization->on_facets, point.row); phi; ++phi)
      beta += std::abs(phi.value()) * penalty[t][phi.col()];
  return beta;
}

/// Share of each side in the flux, and the penalty of the constraint.
struct Shares {
  std::array<double, 2> flux;
  double beta;
};
template <int Dim> Shares shares(const std::vector<StiffnessTerm<Dim>>& terms,
                                 const std::vector<std::vector<double>>& penalty, const Constraint<Dim>& constraint) {
  const double first = penalty_at(terms, penalty, constraint.sides[0].point);
  if (constraint.sides.size() == 1) return {{1.0, 0.0}, first};
  const double second = penalty_at(terms, penalty, constraint.sides[1].point);
  return {{second / (first + second), first / (first + second)}, first * second / (first + second)};
}

/// The forces int beta g.[v] along the directions held, with beta(constraint): Dim x N.
template <int Dim, class Beta> Points<Dim> penalty_forces(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                          const Constraints<Dim>& constraints, const Beta& beta) {
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

/// int beta [u].[v] along the directions held, with beta(constraint).
template <int Dim, class Beta>
SymmetricMatrix penalty_matrix(const ShapeTable<Dim>& shape, const Constraints<Dim>& constraints, const Beta& beta) {
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

/// Rigid restraints and elastic ones.
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

/// The part of what is held on a facet that each part of the boundary holds: a matrix that takes it out of a traction.
template <int Dim> class FacetShares {
 public:
  using Shares = std::vector<std::pair<std::string, Mat<Dim>>>;
  /// Refers to the restraints.
  FacetShares(const FineMesh<Dim>& mesh, const std::vector<Restraint<Dim>>& restraints)
      : restraints_(restraints), pairs_(by_facet(mesh, restraints)) {}
  /// On a facet with this normal; kept until another facet is asked for.
  const Shares& at(Index facet, const Vec<Dim>& n) {
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
    const Mat<Dim> inverse = Eigen::CompleteOrthogonalDecomposition<Mat<Dim>>(all).pseudoInverse();
    shares_.clear();
    for (const auto& [part, held] : own) shares_.emplace_back(part, held * inverse);
    return shares_;
  }

 private:
  const std::vector<Restraint<Dim>>& restraints_;
  std::vector<std::pair<Index, std::size_t>> pairs_;  ///< facet, number of the restraint
  Index facet_ = -1;
  Shares shares_;
};

}  // namespace efree::internal
