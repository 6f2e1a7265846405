// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/internal/periodic_coupling.hpp"

#include "efree/solvers/algorithms/internal/opposite_sides.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace efree::internal {
namespace {

/// Sums local matrices.
class MatrixSum {
 public:
  explicit MatrixSum(Index size) : sum_(size, size) {}

  /// The lower triangle of `local`, whose rows are `dofs`.
  void add(const std::vector<Index>& dofs, const Matrix& local) {
    for (std::size_t j = 0; j < dofs.size(); ++j)
      for (std::size_t i = 0; i < dofs.size(); ++i)
        if (dofs[i] >= dofs[j])
          entries_.emplace_back(dofs[i], dofs[j], local(static_cast<Index>(i), static_cast<Index>(j)));
    if (entries_.size() > most) flush();
  }
  const SymmetricMatrix& sum() {
    flush();
    return sum_;
  }

 private:
  static constexpr std::size_t most = 4'000'000;  // 64 MB

  void flush() {
    SymmetricMatrix part(sum_.rows(), sum_.cols());
    part.setFromTriplets(entries_.begin(), entries_.end());
    sum_ += part;
    entries_.clear();
  }

  SymmetricMatrix sum_;
  std::vector<Eigen::Triplet<double, Index>> entries_;
};

/// One of the two cells at an overlap.
template <int Dim> struct CellAtSide {
  const FineSpace<Dim>& space;
  Index cell;
  double delta;  // times Q: what the traction needs of a penalty

  typename FineSpace<Dim>::Barycentric barycentric(const Vec<Dim>& x) const {
    const FineMesh<Dim>& mesh = space.mesh();
    return (mesh.hat_gradients(cell).transpose() * (x - mesh.centroid(cell))).array() + 1.0 / (Dim + 1);
  }
  /// components x (components * functions).
  Matrix values(const typename FineSpace<Dim>::Barycentric& at, int components) const {
    const auto N = space.values(at);
    Matrix result = Matrix::Zero(components, components * N.size());
    for (Index i = 0; i < N.size(); ++i)
      for (int c = 0; c < components; ++c) result(c, components * i + c) = N[i];
    return result;
  }
  /// (components * Dim) x (components * functions).
  Matrix gradients(const typename FineSpace<Dim>::Barycentric& at, int components) const {
    const auto dN = space.gradients(cell, at);
    Matrix result = Matrix::Zero(components * Dim, components * dN.cols());
    for (Index i = 0; i < dN.cols(); ++i)
      for (int c = 0; c < components; ++c) result.col(components * i + c).template segment<Dim>(Dim * c) = dN.col(i);
    return result;
  }
};

/// By cell: measure of its facets on the sides across these axes.
template <int Dim>
std::vector<double> measure_on_sides(const FineMesh<Dim>& mesh, const Frame<Dim>& frame, const std::vector<int>& axes) {
  std::vector<double> measure(mesh.num_cells(), 0.0);
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (const int side = frame.side_of(mesh, f); side >= 0 && std::ranges::find(axes, side / 2) != axes.end())
      measure[mesh.facet_cell(f)] += mesh.facet_measure(f);
  return measure;
}

}  // namespace

template <int Dim> PeriodicCoupling couple_sides(const FineSpace<Dim>& space, const Frame<Dim>& frame,
                                                 const std::vector<int>& axes, int components,
                                                 const TractionOperator<Dim>& traction, const Matrix& units) {
  const FineMesh<Dim>& mesh = space.mesh();
  const double trace = space.degree() * (space.degree() - 1.0 + Dim) / Dim;
  const std::vector<double> on_sides = measure_on_sides(mesh, frame, axes);
  const SimplexRule<Dim - 1>& rule = space.facet_rule();
  MatrixSum sum(components * space.size());
  PeriodicCoupling result{.matrix = {}, .forces = Matrix::Zero(components * space.size(), units.cols())};
  for (const int axis : axes) {
    Vec<Dim> period = Vec<Dim>::Zero();
    period[axis] = frame.lengths[axis];
    // Columns of dn u_c in the gradient.
    std::vector<Index> normal;
    for (int c = 0; c < components; ++c) normal.push_back(c * Dim + axis);
    const std::vector<FacetOverlap<Dim>> overlaps = facet_overlaps(mesh, frame, axis);
    double covered = 0.0;
    for (std::size_t first = 0; first < overlaps.size();) {
      std::array<CellAtSide<Dim>, 2> sides{CellAtSide<Dim>{space, mesh.facet_cell(overlaps[first].upper), 0.0},
                                           CellAtSide<Dim>{space, mesh.facet_cell(overlaps[first].lower), 0.0}};
      std::vector<Index> dofs;
      for (CellAtSide<Dim>& side : sides) {
        side.delta = 2.0 * trace * on_sides[side.cell] / mesh.volume(side.cell);
        for (const Index dof : space.cell(side.cell))
          for (int c = 0; c < components; ++c) dofs.push_back(components * dof + c);
      }
      const Index half = static_cast<Index>(dofs.size()) / 2;
      Matrix K = Matrix::Zero(2 * half, 2 * half), F = Matrix::Zero(2 * half, units.cols());
      std::size_t one = first;
      for (; one < overlaps.size() && overlaps[one].upper == overlaps[first].upper &&
             overlaps[one].lower == overlaps[first].lower;
           ++one) {
        covered += overlaps[one].measure;
        for (Index q = 0; q < rule.weights.size(); ++q) {
          const Vec<Dim> x = overlaps[one].corners * rule.points.col(q);
          std::array<Matrix, 2> by_gradient, penalty;
          Matrix jump(components, 2 * half), mean(components, 2 * half);
          bool carries = true;
          for (int s = 0; s < 2; ++s) {
            const Vec<Dim> there = s == 0 ? Vec<Dim>(x + period) : x;
            const auto at = sides[s].barycentric(there);
            by_gradient[s] = traction(mesh.region(sides[s].cell), there, axis);
            penalty[s] = sides[s].delta * by_gradient[s](Eigen::all, normal);
            carries = carries && penalty[s].diagonal().minCoeff() > 0.0;
            jump.middleCols(s * half, half) = (s == 0 ? 1.0 : -1.0) * sides[s].values(at, components);
            mean.middleCols(s * half, half) = by_gradient[s] * sides[s].gradients(at, components);
          }
          if (!carries) continue;
          // tau A_upper = P_lower (P_upper + P_lower)^-1 with P = delta Q = A^-1.
          const Matrix inverse = (penalty[0] + penalty[1]).inverse();
          const std::array<Matrix, 2> share{penalty[1] * inverse, penalty[0] * inverse};
          for (int s = 0; s < 2; ++s)
            mean.middleCols(s * half, half) = (share[s] * mean.middleCols(s * half, half)).eval();
          const Matrix tau = penalty[1] * inverse * penalty[0];
          const double weight = overlaps[one].measure * rule.weights[q];
          const Matrix consistency = jump.transpose() * mean;
          K += weight * (jump.transpose() * tau * jump - consistency - consistency.transpose());
          F += weight * jump.transpose() * ((share[0] * by_gradient[0] + share[1] * by_gradient[1]) * units);
        }
      }
      sum.add(dofs, K);
      for (std::size_t i = 0; i < dofs.size(); ++i) result.forces.row(dofs[i]) += F.row(static_cast<Index>(i));
      first = one;
    }
    const OppositeSides facets = opposite_sides(mesh, frame, axis);
    for (const auto* side : {&facets.lower, &facets.upper}) {
      double all = 0.0;
      for (const Index f : *side) all += mesh.facet_measure(f);
      result.uncovered = std::max(result.uncovered, 1.0 - covered / all);
    }
  }
  result.matrix = sum.sum();
  return result;
}

template PeriodicCoupling couple_sides(const FineSpace<2>&, const Frame<2>&, const std::vector<int>&, int,
                                       const TractionOperator<2>&, const Matrix&);
template PeriodicCoupling couple_sides(const FineSpace<3>&, const Frame<3>&, const std::vector<int>&, int,
                                       const TractionOperator<3>&, const Matrix&);

}  // namespace efree::internal
