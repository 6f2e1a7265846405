// SPDX-License-Identifier: GPL-3.0-or-later
/// What holds a body on cells.
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <limits>
#include <span>

namespace efree::internal {
namespace {

/// A restraint that can take a share of a force, in one direction.
struct Bearer {
  std::size_t restraint;
  Vec<3> direction;  ///< along the image's axes
  double weight = 0.0;
};

/// Where a restraint holds the body.
struct Reach {
  Eigen::AlignedBox3d box{};  ///< of its nodes, from the image's origin along its axes
  Vec<3> direction;           ///< in which it holds these
  bool one_direction = true;  ///< in all of them the same; else in any
};

std::vector<Reach> reaches_of(const CellProblem& problem) {
  std::vector<Reach> reaches(problem.restraints->size());
  const auto add = [&](std::size_t restraint, std::size_t node, const Vec<3>& direction) {
    Reach& reach = reaches[restraint];
    if (reach.box.isEmpty()) reach.direction = direction;
    reach.one_direction = reach.one_direction && reach.direction == direction;
    reach.box.extend(problem.local(problem.point(node)));
  };
  for (const HeldNode& at : problem.held) add(at.restraint, at.node, problem.direction(at));
  for (const SupportSprings& of : problem.springs.supports)
    for (const NodeSpring& at : of.nodes) {
      Index column = 0;
      at.stiffness.diagonal().maxCoeff(&column);
      if (at.stiffness(column, column) > 0.0) add(of.restraint, at.node, at.stiffness.col(column).normalized());
    }
  return reaches;
}

/// Splits forces at nodes among restraints.
class ForceShares {
 public:
  explicit ForceShares(const CellProblem& problem) : problem_(problem), reaches_(reaches_of(problem)) {}

  /// Calls take(restraint, share) for shares of a force at a node, which are all of it as far as directions are held.
  template <class Take>
  void split(std::size_t node, const Vec<3>& force, std::vector<Bearer>& bearers, const Take& take) const {
    find_bearers(node, bearers);
    const auto along_axis = [](const Bearer& of) { return of.direction.cwiseAbs().maxCoeff() == 1.0; };
    if (std::ranges::all_of(bearers, along_axis)) {
      Vec<3> sums = Vec<3>::Zero();
      for (const Bearer& of : bearers) sums += of.weight * of.direction.cwiseAbs();
      for (const Bearer& of : bearers)
        take(of.restraint, Vec<3>(of.direction.cwiseAbs().cwiseProduct(force).cwiseQuotient(
                                      sums.cwiseMax(std::numeric_limits<double>::min())) *
                                  of.weight));
      return;
    }
    double most = 0.0;
    for (const Bearer& of : bearers) most = std::max(most, of.weight);
    Mat<3> sum = Mat<3>::Zero();
    for (const Bearer& of : bearers) sum += of.weight / most * of.direction * of.direction.transpose();
    const Vec<3> multiplier = Eigen::CompleteOrthogonalDecomposition<Mat<3>>(sum).solve(force);
    for (const Bearer& of : bearers)
      take(of.restraint, Vec<3>(of.weight / most * of.direction.dot(multiplier) * of.direction));
  }

 private:
  /// Those that hold the node, and far behind them all others, the nearer ones first.
  void find_bearers(std::size_t node, std::vector<Bearer>& bearers) const {
    constexpr double holds = 1e30;
    bearers.clear();
    const auto first = std::ranges::lower_bound(problem_.held, node, {}, &HeldNode::node);
    for (auto at = first; at != problem_.held.end() && at->node == node; ++at)
      bearers.push_back({at->restraint, problem_.direction(*at), holds});
    const Vec<3> x = problem_.local(problem_.point(node));
    for (std::size_t r = 0; r < reaches_.size(); ++r) {
      const Reach& reach = reaches_[r];
      if (reach.box.isEmpty()) continue;
      const double weight = 1.0 / std::max(reach.box.exteriorDistance(x), problem_.edges.minCoeff());
      if (reach.one_direction)
        bearers.push_back({r, reach.direction, weight});
      else
        for (int c = 0; c < 3; ++c) bearers.push_back({r, Vec<3>::Unit(c), weight});
    }
  }

  const CellProblem& problem_;
  std::vector<Reach> reaches_;
};

}  // namespace

Resultants<3> CellProblem::reactions(const Field& u, const Field& out_of_balance) const {
  const std::size_t count = restraints->size();
  std::vector<std::vector<Resultant<3>>> layers(grid.cells[2] + 1, std::vector<Resultant<3>>(count));
  const ForceShares shares(*this);
  parallel_chunks(grid.cells[2] + 1, 4, [&](Index begin, Index end) {
    std::vector<Bearer> bearers;
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j <= grid.cells[1]; ++j)
        for (Index i = 0; i <= grid.cells[0]; ++i) {
          const std::array<Index, 3> at{i, j, k};
          Vec<3> force;
          for (int c = 0; c < 3; ++c) force[c] = out_of_balance[dof(c, at)];
          if (force.isZero(0.0)) continue;
          shares.split(grid.node(i, j, k), force, bearers, [&](std::size_t restraint, const Vec<3>& share) {
            layers[k][restraint].add(place(at), axes * share);
          });
        }
  });
  Resultants<3> sums;
  for (const auto& layer : layers)
    for (std::size_t r = 0; r < count; ++r) sums[(*restraints)[r].on] += layer[r];
  for (const SupportSprings& of : springs.supports)
    for (const NodeSpring& at : of.nodes)
      sums[(*restraints)[of.restraint].on].add(place(point(at.node)), axes * springs.force(u.data(), at));
  return sums;
}

}  // namespace efree::internal
