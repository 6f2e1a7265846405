// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/nitsche.hpp"

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/assembly/internal/gather.hpp"

#include <Eigen/QR>
#include <array>
#include <map>

namespace efree {
namespace {

using internal::BoundaryPoint;
using internal::contradict;
using internal::for_each_point;
using internal::held_by;
using internal::place_text;
using internal::prescribed;
using internal::to_nodes;

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
  Constraints(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
              const std::vector<TiedFacets>& ties)
      : space_(space), ties_(ties) {
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
  const std::vector<TiedFacets>& ties_;
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
  Ragged<Index> nodes;
  std::vector<Entry> entries;
  Accumulator<Block> nodal(shape.num_nodes());
  const Gradient<Dim> trace = trace_direction<Dim>();
  auto value = values.begin();
  for (std::size_t s = 0; s < jumps.size();) {
    const Index K = jumps[s].first.first;
    while (value->first != K) ++value;
    const double kappa = term.pressure ? term.tangents[K](0, 0) : 0.0;
    const double penalty_of_pressure = 4.0 * kappa / discretization.weights[K];
    nodal.clear();
    for (; s < jumps.size() && jumps[s].first.first == K; ++s) {
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
      if (penalty_of_pressure > 0.0) {
        const Vec<Dim> crossing = entry.jump * trace;
        entry.flux -= 0.5 * penalty_of_pressure * crossing * trace.transpose();  // half of it from each of the two
        rhs.col(node) += penalty_of_pressure * trace.dot(value->second) * crossing;
      }
      nodes.items.push_back(node);
      entries.push_back(entry);
    }
    nodes.close_row();
  }
  const auto by_node = places_of_nodes(shape.num_nodes(), nodes.rows(), [&](Index row) { return nodes[row]; });
  return gather_blocks<Dim>(shape.num_nodes(), [&](Index a, Accumulator<Mat<Dim>>& sums) {
    for (const auto& [row, k] : by_node[a]) {
      const auto row_nodes = nodes[row];
      const Entry* of_row = entries.data() + nodes.offsets[row];
      for (std::size_t l = k; l < row_nodes.size(); ++l)
        sums[row_nodes[l]].noalias() -=
            of_row[l].jump * of_row[k].flux.transpose() + of_row[l].flux * of_row[k].jump.transpose();
    }
  });
}

/// int beta [u].[v] along the directions held, with beta(constraint).
template <int Dim, class Beta> SymmetricMatrix penalty_matrix(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                              const Constraints<Dim>& constraints, const Beta& beta,
                                                              Points<Dim>& rhs) {
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
  const auto forces = summed<Index, Vec<Dim>>(constraints, [&](const auto& constraint, auto& sums) {
    const double factor = beta_at(constraint);
    for (const auto& [at, sign] : constraint.sides)
      for (std::size_t i = 0; i < at.dofs.size(); ++i)
        if (at.N[i] != 0.0) sums.add(at.dofs[i], sign * factor * at.N[i] * constraint.value);
  });
  Points<Dim> fine_rhs = Points<Dim>::Zero(Dim, space.size());
  for (const auto& [v, force] : forces) fine_rhs.col(v) = force;
  rhs += to_nodes(shape, fine_rhs);

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
  system.matrix = penalty_matrix(space, shape, constraints, beta, rhs);
  for (const auto& term : terms) system.matrix += consistency(shape, terms, penalty, constraints, term, rhs);
  for (const auto& spring : elastic) {
    const auto k = [&](const Constraint<Dim>& at) { return stiffness_at<Dim>(spring, at.sides.front().point.x); };
    system.matrix += penalty_matrix(space, shape, Constraints<Dim>(space, {spring}, {}), k, rhs);
  }
  system.rhs = rhs.reshaped();
  return system;
}

namespace {

/// The part of what is held on a facet that each part of the boundary holds: a matrix that takes it out of a traction.
template <int Dim>
std::vector<std::pair<std::string, Mat<Dim>>> shares_of_parts(const std::vector<const Restraint<Dim>*>& restraints,
                                                              const Vec<Dim>& n) {
  std::map<std::string, Mat<Dim>> own;
  Mat<Dim> all = Mat<Dim>::Zero();
  for (const Restraint<Dim>* restraint : restraints) {
    const Vec<Dim> d = restraint->direction(n);
    own.try_emplace(restraint->on, Mat<Dim>::Zero()).first->second += d * d.transpose();
    all += d * d.transpose();
  }
  const Mat<Dim> inverse = Eigen::CompleteOrthogonalDecomposition<Mat<Dim>>(all).pseudoInverse();
  std::vector<std::pair<std::string, Mat<Dim>>> shares;
  for (const auto& [part, held] : own) shares.emplace_back(part, held * inverse);
  return shares;
}

}  // namespace

template <int Dim> Resultants<Dim> nitsche_reactions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                     const std::vector<StiffnessTerm<Dim>>& terms,
                                                     const std::vector<Restraint<Dim>>& restraints,
                                                     const std::vector<TiedFacets>& ties, const Points<Dim>& U,
                                                     double factor) {
  const auto [rigid, elastic] = by_kind(restraints);
  const Constraints<Dim> constraints(space, rigid, ties);
  std::vector<std::vector<double>> penalty;
  for (const auto& term : terms) penalty.push_back(penalties(term, constraints));
  const Points<Dim> u = interpolate(shape, U);
  // What is held at a constraint, less what is prescribed.
  const auto gap = [&](const Constraint<Dim>& constraint) {
    Vec<Dim> jump = Vec<Dim>::Zero();
    for (const auto& [point, sign] : constraint.sides)
      for (std::size_t i = 0; i < point.dofs.size(); ++i) jump += sign * point.N[i] * u.col(point.dofs[i]);
    return Vec<Dim>(constraint.directions * jump - factor * constraint.value);
  };
  std::vector<Gradients<Dim>> fluxes;  // by term and point: stress, with what holds the volume that crosses
  const Gradient<Dim> trace = trace_direction<Dim>();
  for (const auto& term : terms) {
    const auto& points = *term.discretization;
    Gradients<Dim>& flux = fluxes.emplace_back(gradient(points, U));
    for (Index K = 0; K < points.size(); ++K) flux.col(K) = term.tangents[K] * Gradient<Dim>(flux.col(K));
    if (!term.pressure) continue;
    constraints.for_each([&](const Constraint<Dim>& constraint) {
      const Shares share = shares(terms, penalty, constraint);
      const double crossing = constraint.weight() * gap(constraint).dot(constraint.n);
      for (std::size_t s = 0; s < constraint.sides.size(); ++s)
        for (SparseRows::InnerIterator phi(points.on_facets, constraint.sides[s].point.row); phi; ++phi) {
          const auto K = static_cast<Index>(phi.col());
          flux.col(K) -=
              4.0 * term.tangents[K](0, 0) / points.weights[K] * share.flux[s] * phi.value() * crossing * trace;
        }
    });
  }
  const auto pairs = by_facet(space.mesh(), rigid);
  std::vector<std::pair<std::string, Mat<Dim>>> parts;
  Index facet = -1;
  Resultants<Dim> reactions;
  constraints.for_each([&](const Constraint<Dim>& constraint) {
    if (constraint.sides.size() > 1) return;  // ties are within the body
    const BoundaryPoint<Dim>& point = constraint.sides.front().point;
    Vec<Dim> traction = -penalty_at(terms, penalty, point) * gap(constraint);
    for (std::size_t t = 0; t < terms.size(); ++t)
      for (SparseRows::InnerIterator phi(terms[t].discretization->on_facets, point.row); phi; ++phi)
        traction += phi.value() * (constraint.directions *
                                   NodalGradient<Dim>{point.n}.force(fluxes[t].col(static_cast<Index>(phi.col()))));
    if (std::exchange(facet, point.facet) != point.facet) {
      std::vector<const Restraint<Dim>*> on_facet;
      for (auto pair = std::ranges::lower_bound(pairs, std::pair(point.facet, std::size_t{0}));
           pair != pairs.end() && pair->first == point.facet; ++pair)
        on_facet.push_back(&rigid[pair->second]);
      parts = shares_of_parts(on_facet, point.n);
    }
    for (const auto& [part, share] : parts) reactions[part].add(point.x, point.weight * (share * traction));
  });
  for (const auto& spring : elastic) {
    Resultant<Dim>& reaction = reactions[spring.on];
    Constraints<Dim>(space, {spring}, {}).for_each([&](const Constraint<Dim>& constraint) {
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
template Resultants<2> nitsche_reactions<2>(const FineSpace<2>&, const ShapeTable<2>&,
                                            const std::vector<StiffnessTerm<2>>&, const std::vector<Restraint<2>>&,
                                            const std::vector<TiedFacets>&, const Points<2>&, double);
template Resultants<3> nitsche_reactions<3>(const FineSpace<3>&, const ShapeTable<3>&,
                                            const std::vector<StiffnessTerm<3>>&, const std::vector<Restraint<3>>&,
                                            const std::vector<TiedFacets>&, const Points<3>&, double);

}  // namespace efree
