// SPDX-License-Identifier: GPL-3.0-or-later
/// Points of the boundary where displacements are held or tied, and sums over them.
#pragma once

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/assembly/internal/gather.hpp"
#include "efree/assembly/nitsche.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <span>
#include <string>
#include <type_traits>
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

/// The restraints on each restrained facet: (facet, number of the restraint), ascending.
template <int Dim> std::vector<std::pair<Index, std::size_t>> by_facet(const FineMesh<Dim>& mesh,
                                                                       const std::vector<Restraint<Dim>>& restraints);

/// What restraints hold at a point: the sum of d d^T over an orthonormal set of directions, and the displacement along
/// them.
template <int Dim> struct HeldPoint {
  Mat<Dim> directions = Mat<Dim>::Zero();
  Vec<Dim> value = Vec<Dim>::Zero();
};

/// The constraints of all restraints, then those of the ties, in parts that do not depend on the number of threads.
/// What is prescribed is evaluated once.
template <int Dim> class Constraints {
 public:
  Constraints(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints, std::vector<TiedFacets> ties);

  Index num_parts() const { return parts(facets_.size()) + parts(ties_.size()); }
  using Visit = std::function<void(const Constraint<Dim>&)>;
  /// Those of one part, always in the same order.
  void for_each(Index part, const Visit& visit) const;
  void for_each(const Visit& visit) const {
    for (Index part = 0; part < num_parts(); ++part) for_each(part, visit);
  }

 private:
  static constexpr std::size_t facets_per_part = 512;
  static Index parts(std::size_t size) { return static_cast<Index>((size + facets_per_part - 1) / facets_per_part); }
  template <class T> static std::span<const T> range(const std::vector<T>& all, Index part) {
    const std::size_t begin = static_cast<std::size_t>(part) * facets_per_part;
    return std::span(all).subspan(begin, std::min(facets_per_part, all.size() - begin));
  }

  void for_each_held(std::span<const Index> facets, const Visit& visit) const;
  void for_each_tie(std::span<const TiedFacets> ties, const Visit& visit) const;

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

/// beta_K of one term at all its quadrature points; zero away from the constraints, and for pressures, which
/// `consistency` holds by their own means.
template <int Dim> std::vector<double> penalties(const StiffnessTerm<Dim>& term, const Constraints<Dim>& constraints);

/// beta at a boundary point: the sum over the terms.
template <int Dim> double penalty_at(const std::vector<StiffnessTerm<Dim>>& terms,
                                     const std::vector<std::vector<double>>& penalty, const BoundaryPoint<Dim>& point);

/// Share of each side in the flux, and the penalty of the constraint.
struct Shares {
  std::array<double, 2> flux;
  double beta;
};
template <int Dim> Shares shares(const std::vector<StiffnessTerm<Dim>>& terms,
                                 const std::vector<std::vector<double>>& penalty, const Constraint<Dim>& constraint);

/// A number by constraint.
template <int Dim> using ByConstraint = std::type_identity_t<std::function<double(const Constraint<Dim>&)>>;

/// The forces int beta g.[v] along the directions held, with beta(constraint): Dim x N.
template <int Dim> Points<Dim> penalty_forces(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const Constraints<Dim>& constraints, const ByConstraint<Dim>& beta);

/// int beta [u].[v] along the directions held, with beta(constraint).
template <int Dim> SymmetricMatrix penalty_matrix(const ShapeTable<Dim>& shape, const Constraints<Dim>& constraints,
                                                  const ByConstraint<Dim>& beta);

/// Rigid restraints and elastic ones.
template <int Dim> std::array<std::vector<Restraint<Dim>>, 2> by_kind(const std::vector<Restraint<Dim>>& restraints);
/// Checked.
template <int Dim> double stiffness_at(const Restraint<Dim>& spring, const Vec<Dim>& x);

/// The part of what is held on a facet that each part of the boundary holds: a matrix that takes it out of a traction.
template <int Dim> class FacetShares {
 public:
  using Shares = std::vector<std::pair<std::string, Mat<Dim>>>;
  /// Refers to the restraints.
  FacetShares(const FineMesh<Dim>& mesh, const std::vector<Restraint<Dim>>& restraints)
      : restraints_(restraints), pairs_(by_facet(mesh, restraints)) {}
  /// On a facet with this normal; kept until another facet is asked for.
  const Shares& at(Index facet, const Vec<Dim>& n);

 private:
  const std::vector<Restraint<Dim>>& restraints_;
  std::vector<std::pair<Index, std::size_t>> pairs_;  ///< facet, number of the restraint
  Index facet_ = -1;
  Shares shares_;
};

}  // namespace efree::internal
