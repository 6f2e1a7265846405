// SPDX-License-Identifier: GPL-3.0-or-later
/// What holds a body on cells.
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <Eigen/QR>
#include <algorithm>

namespace efree::internal {
namespace {

/// Splits forces at nodes among the conditions, the nearer ones first.
class ForceShares {
 public:
  explicit ForceShares(const CellProblem& problem)
      : problem_(problem), held_(*problem.held), weights_(held_.size()), shares_(held_.size()) {
    aligned_ = std::ranges::all_of(held_, [](const HeldSide& of) { return of.component >= 0; });
  }

  /// By condition: its share of a force at a node.
  const std::vector<Vec<3>>& operator()(const std::array<Index, 3>& node, const Vec<3>& force) {
    for (std::size_t h = 0; h < held_.size(); ++h) {
      const Side& side = held_[h].side;
      const Index steps = side.upper ? problem_.grid.cells[side.axis] - node[side.axis] : node[side.axis];
      weights_[h] = steps == 0 ? 1e30 : 1.0 / (steps * problem_.edges[side.axis]);
    }
    aligned_ ? split_aligned(force) : split_oblique(force);
    return shares_;
  }

 private:
  void split_aligned(const Vec<3>& force) {
    Vec<3> sums = Vec<3>::Zero();
    for (std::size_t h = 0; h < held_.size(); ++h) sums[held_[h].component] += weights_[h];
    for (std::size_t h = 0; h < held_.size(); ++h) {
      const int c = held_[h].component;
      shares_[h] = weights_[h] / sums[c] * force[c] * Vec<3>::Unit(c);
    }
  }
  void split_oblique(const Vec<3>& force) {
    const double most = *std::ranges::max_element(weights_);
    Mat<3> sum = Mat<3>::Zero();
    for (std::size_t h = 0; h < held_.size(); ++h)
      sum += weights_[h] / most * held_[h].direction * held_[h].direction.transpose();
    const Vec<3> multiplier = Eigen::CompleteOrthogonalDecomposition<Mat<3>>(sum).solve(force);
    for (std::size_t h = 0; h < held_.size(); ++h)
      shares_[h] = weights_[h] / most * held_[h].direction.dot(multiplier) * held_[h].direction;
  }

  const CellProblem& problem_;
  const std::vector<HeldSide>& held_;
  bool aligned_;
  std::vector<double> weights_;
  std::vector<Vec<3>> shares_;
};

}  // namespace

Resultants<3> CellProblem::reactions(const Field& out_of_balance) const {
  std::vector<std::vector<Resultant<3>>> layers(grid.cells[2] + 1, std::vector<Resultant<3>>(held->size()));
  parallel_chunks(grid.cells[2] + 1, 4, [&](Index begin, Index end) {
    ForceShares split(*this);
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j <= grid.cells[1]; ++j)
        for (Index i = 0; i <= grid.cells[0]; ++i) {
          const std::array<Index, 3> node{i, j, k};
          Vec<3> force;
          for (int c = 0; c < 3; ++c) force[c] = out_of_balance[dof(c, node)];
          if (force.isZero(0.0)) continue;
          const auto& shares = split(node, force);
          for (std::size_t h = 0; h < shares.size(); ++h) layers[k][h].add(place(node), axes * shares[h]);
        }
  });
  Resultants<3> sums;
  for (const auto& layer : layers)
    for (std::size_t h = 0; h < held->size(); ++h) sums[(*held)[h].on] += layer[h];
  return sums;
}

}  // namespace efree::internal
