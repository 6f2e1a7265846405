// SPDX-License-Identifier: GPL-3.0-or-later
/// Local maximum-entropy shape functions of material points.
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <map>

namespace efree::internal {
namespace {

/// How far nodes move before trees of them are built again, over their least spacing.
constexpr double tree_skin = 0.3;
/// Nodes in a point's support over those at first, below which the support is too small.
constexpr double least_nodes = 0.6;
/// Width of shape functions, over the first one, below which a point that is next to a crack does not take them.
constexpr double least_width = 0.05;
/// Likewise over that of the weights, below which a point takes more nodes at first.
constexpr double least_first_width = 0.05;
/// Least stabilisation of points that have nodes of two bodies in their support: those of both surfaces lie in one
/// place, and nothing else resists motions of the ones against the others.
constexpr double shared_stabilisation = 1.0;
/// Stabilisation by pressure, over that by stiffness. Shape functions that are computed anew do not integrate exactly:
/// motions of the nodes between points may let all of these expand where the body does not. Pressure drives them, so
/// that shocks come out slow and nodes clump; the stabilisation has to grow with it. The more of it, the closer shocks
/// are to Hugoniot's, and the shorter steps under pressure (docs/evidence.md).
constexpr double by_pressure = 70.0;

/// The metric with the same determinant whose axes have lengths of at most that ratio.
template <int Dim> Mat<Dim> limited(const Mat<Dim>& metric, double ratio) {
  auto [value, axes] = spectrum<Dim>(metric);  // values ascending, 1 / length^2
  const double most = ratio * ratio;
  if (value[Dim - 1] <= most * value[0]) return metric;
  const double product = value.prod();
  // Both ends change by as much, until the ratio is as given.
  Vec<Dim> log = value.array().log();
  const double excess = log[Dim - 1] - log[0] - std::log(most);
  log[0] += 0.5 * excess;
  log[Dim - 1] -= 0.5 * excess;
  if constexpr (Dim == 3) log[1] = std::clamp(log[1], log[0], log[2]);
  value = log.array().exp();
  value *= std::pow(product / value.prod(), 1.0 / Dim);
  return axes * value.asDiagonal() * axes.transpose();
}

}  // namespace

template <int Dim> void NodeSearch<Dim>::follow(const World<Dim>& world) {
  trees_.resize(world.num_bodies());
  parallel_chunks(world.num_bodies(), 1, [&](Index b, Index) {
    auto& [nodes, shift, moved] = trees_[b];
    const Index first = world.first_node[b], count = world.first_node[b + 1] - first;
    const auto x = world.nodes.x.middleCols(first, count);
    if (const Points<Dim>& then = nodes.points(); then.cols() == count) {
      shift = (x - then).rowwise().mean();
      moved = std::sqrt(((x - then).colwise() - shift).colwise().squaredNorm().maxCoeff());
      if (moved <= tree_skin * world.nodes.spacing.segment(first, count).minCoeff()) return;
    }
    nodes.build(x);
    shift.setZero();
    moved = 0.0;
  });
}

/// Bodies whose nodes may be in a point's support: its own, those of its nodes so far, and those seized by these nodes.
template <int Dim> void ShapeFunctions<Dim>::find_partners(const Chunk<Dim>& chunk, Index p) {
  partners_.assign(1, chunk.body);
  if (state_.seized.empty()) return;
  for (const auto& [a, entry] : chunk.table.row(p)) {
    partners_.push_back(world_.nodes.body[a]);
    for (const auto& [node, body] : std::ranges::equal_range(state_.seized, a, {}, &NodePair::first))
      partners_.push_back(body);
  }
  std::ranges::sort(partners_);
  partners_.erase(std::unique(partners_.begin(), partners_.end()), partners_.end());
}

/// Nodes whose weights are not below the cutoff to the power of `share`.
template <int Dim> void ShapeFunctions<Dim>::search(const Vec<Dim>& at, const Mat<Dim>& metric, double share) {
  const double furthest = -std::log(state_.options.lme.cutoff);
  const auto is_merged = [&nodes = world_.nodes](Index a) {
    return nodes.follows(a) && nodes.body[nodes.master[a]] == nodes.body[a];
  };
  nodes_.clear();
  for (const Index body : partners_) {
    state_.search.within(body, at, std::sqrt(furthest * share / eigenvalues<Dim>(metric)[0]), around_);
    for (const Index near_by : around_) {
      const Index a = world_.first_node[body] + near_by;
      const Vec<Dim> d = world_.nodes.x.col(a) - at;
      // A node that was merged has the one it follows near by, too; one that is tied stands for it here.
      if (is_merged(a)) continue;
      if (d.dot(metric * d) <= furthest * share) nodes_.push_back(world_.nodes.master_of(a));
    }
  }
  if (world_.options.tied) {
    std::ranges::sort(nodes_);
    nodes_.erase(std::unique(nodes_.begin(), nodes_.end()), nodes_.end());
  }
}

template <int Dim> bool ShapeFunctions<Dim>::find(Index number, Index p, Mat<Dim>& metric, Vec<Dim>& lambda) {
  const Chunk<Dim>& chunk = world_.chunks[number];
  const OtmPoints<Dim>& points = state_.points[number];
  const Visibility<Dim>& visibility = state_.visibility;
  const Vec<Dim> at = chunk.matter.x.col(p);
  const bool is_first = points.count[p] == 0.0;
  find_partners(chunk, p);
  if (!is_first) {
    const Mat<Dim> inverse = deformation_since_table(chunk, p).inverse();
    metric = limited<Dim>(inverse.transpose() * metric * inverse, state_.options.anisotropy);
    lambda = inverse.transpose() * lambda;
    // Where nodes have moved apart more than F at the point says, supports follow the nodes.
    for (int wider = 0; wider < 20; ++wider) {
      search(at, metric, 1.0);
      if (static_cast<double>(nodes_.size()) >= least_nodes * points.count[p]) break;
      metric /= 1.2;
    }
  }
  for (double share = 1.0; share < (is_first ? 10.0 : 4.0); share *= 3.0) {
    search(at, metric, share);
    if (visibility.may_hide(world_, chunk.body, at, nodes_))
      visibility.keep_connected(world_, chunk.body, chunk.number[p], nodes_);
    if (share > 2.0 && !is_first) {
      // The nodes it had: it is a mean of them.
      for (const auto& [a, entry] : chunk.table.row(p))
        if (!world_.nodes.follows(a) && std::ranges::count(nodes_, a) == 0) nodes_.push_back(a);
      ++change_.enlarged;
    }
    functions_.clear();
    for (const Index a : nodes_) functions_.add(world_.nodes.x.col(a) - at);
    const LmeStatus status = functions_.find(metric, lambda);
    change_.iterations += functions_.iterations();
    // Past a crack a point may be at the very edge of the nodes that are left to it.
    const bool is_edge = visibility.has_cracks() && smallest_width<Dim>(moment()) < least_width * points.width[p];
    // In a flat cell all nodes that are near may be on one side, as good as: gradients are without bounds.
    const bool is_narrow = is_first && share < 2.0 && status == LmeStatus::found &&
                           smallest_width<Dim>(moment()) < least_first_width / std::sqrt(metric(0, 0));
    if (status == LmeStatus::found && !is_edge && !is_narrow) return true;
    lambda.setZero();
  }
  return false;
}

/// The shape functions that a point has, as they are where it and the nodes are now. Those of nodes that have been
/// merged with another are the other's: the point moves to the mean of its nodes, and gradients are those of maximum
/// entropy to these weights, N_a J^-1 (x_a - x). False if the nodes that are left do not span space.
template <int Dim> bool ShapeFunctions<Dim>::keep(Chunk<Dim>& chunk, Index p, TableRow& row) {
  const Points<Dim>& x = world_.nodes.x;
  const Mat<Dim> inverse = deformation_since_table(chunk, p).inverse();
  Mat<Dim> moment = current_moment(chunk, p);
  update_position_again(world_, chunk, p);
  bool has_merged = false;
  for (const auto& [a, entry] : chunk.table.row(p)) {
    has_merged = has_merged || world_.nodes.follows(a);
    const Vec<Dim> dN = inverse.transpose() * Eigen::Map<const Vec<Dim>>(entry.dN);
    row.push_back({a, make_entry(entry.N, dN, chunk.matter.x(0, p))});
  }
  if (has_merged) {
    std::map<Index, double> weights;
    for (const auto& [a, entry] : row) weights[world_.nodes.master_of(a)] += entry.N;
    Vec<Dim> at = Vec<Dim>::Zero();
    for (const auto& [a, N] : weights) at += N * x.col(a);
    Mat<Dim> spread = Mat<Dim>::Zero();
    for (const auto& [a, N] : weights) spread += N * (x.col(a) - at) * (x.col(a) - at).transpose();
    if (!(eigenvalues<Dim>(spread)[0] > 1e-3 * eigenvalues<Dim>(moment)[0])) return false;
    const Mat<Dim> slopes = spread.inverse();
    row.clear();
    for (const auto& [a, N] : weights) row.push_back({a, make_entry(N, N * slopes * (x.col(a) - at), at[0])});
    chunk.matter.x.col(p) = at;
    moment = spread;
  }
  change_.same = !has_merged;
  change_.kept = 1;
  chunk.support.stabilisation[p] *= moment.inverse().trace() / chunk.support.moment[p].inverse().trace();
  chunk.support.moment[p] = moment;
  return true;
}

/// Stiffness against zero-energy modes of a point with the shape functions found.
template <int Dim> double ShapeFunctions<Dim>::stabilisation(Chunk<Dim>& chunk, Index p, bool is_first) const {
  const double share = state_.options.stabilisation;
  const double shear = world_.bodies[chunk.body].shear, shock = chunk.matter.shock[p];
  // Stresses drive zero-energy modes, as they drive springs under load.
  Mat<3> tau = Mat<3>::Zero();
  if (!is_first || world_.bodies[chunk.body].runs_together) tau = kirchhoff_stress(world_, chunk, p);
  // Stiffness is enough for pressures as large as the stabilisation that it makes.
  const double pressure = std::max(0.0, shock - tau.trace() / 3.0 - share * shear);
  const bool is_shared = std::ranges::any_of(nodes_, [&](Index a) { return world_.nodes.body[a] != chunk.body; });
  const double shared = is_shared ? std::max(shared_stabilisation, share) : share;
  const double stiffness = shared * (shear + tau.norm() + shock) + share * by_pressure * pressure;
  return stiffness * chunk.matter.volume[p] * functions_.inverse_moment().trace() / Dim;
}

template <int Dim> PointChange ShapeFunctions<Dim>::compute(Index number, Index p, TableRow& row) {
  Chunk<Dim>& chunk = world_.chunks[number];
  OtmPoints<Dim>& points = state_.points[number];
  Support<Dim>& support = chunk.support;
  const bool is_first = points.count[p] == 0.0;
  change_ = {};
  if (!chunk.is_inverted(p) && find(number, p, support.metric[p], points.lambda[p])) {
    for (Index k = 0; k < functions_.size(); ++k)
      row.push_back({nodes_[k], make_entry(functions_.N(k), functions_.dN(k), chunk.matter.x(0, p))});
    if (is_first) {
      points.count[p] = static_cast<double>(row.size());
      points.width[p] = smallest_width<Dim>(moment());
    }
    // Of the shape functions it had, where the nodes have gone.
    const double squared_width = eigenvalues<Dim>(current_moment(chunk, p))[0], before = support.stabilisation[p];
    support.moment[p] = moment();
    support.stabilisation[p] = stabilisation(chunk, p, is_first);
    const bool is_narrower = eigenvalues<Dim>(support.moment[p])[0] < 0.8 * squared_width;
    change_.stiffened = !is_first && (is_narrower || support.stabilisation[p] > 2.0 * before);
  } else if (is_first || chunk.is_inverted(p) || !keep(chunk, p, row)) {
    row.clear();
    change_.lost = true;
  }
  complete_row<Dim>(row.size(), [&](std::size_t k) -> TableEntry& { return row[k].second; });
  return change_;
}

template <int Dim> void ShapeFunctions<Dim>::share(Reconnection& change) {
  Chunk<Dim>& chunk = world_.chunks[change.chunk];
  OtmPoints<Dim>& points = state_.points[change.chunk];
  Support<Dim>& support = chunk.support;
  Points<Dim>& x = chunk.matter.x;
  const auto is_second = [&](Index q) {
    return std::ranges::any_of(points.pairs, [&](const auto& pair) { return pair.merges && pair.second == q; });
  };
  std::vector<Index> lost;
  const auto list = [&](Index p, const PointChange& point) {
    if (point.lost) lost.push_back(p);
    if (point.same) change.kept.push_back(p);
    if (point.stiffened) points.stiffened.push_back(p);
  };
  for (std::size_t k = 0; k < points.due.size(); ++k) list(points.due[k], change.points[k]);
  const auto has_some = [&](Index q) {
    return !chunk.is_eroded(q) && std::ranges::count(lost, q) == 0 && !is_second(q);
  };
  for (std::size_t k = 0; k < lost.size(); ++k) {
    const Index p = lost[k];
    if (is_second(p)) continue;  // the first of its pair has them
    const auto distance = [&](Index q) { return (x.col(q) - x.col(p)).squaredNorm(); };
    Index with = -1;
    while (with < 0) {
      with = find_nearest(std::views::iota(0, chunk.size()), distance, has_some);
      if (with < 0) fail_at(chunk, p);
      if (points.is_due(with)) continue;
      // It is reconnected with them.
      update_position_again(world_, chunk, with);
      if (!OtmState<Dim>::hold_if_inverted(world_, chunk, with))
        change.stabilisation += stabilisation_energy(world_, chunk, with, 0.5 * world_.last_step);
      points.mark(with);
      const auto at = static_cast<std::ptrdiff_t>(points.place(with));
      TableRow& row = *change.rows.emplace(change.rows.begin() + at);
      list(with, *change.points.insert(change.points.begin() + at, compute(change.chunk, with, row)));
      if (change.points[at].lost) with = -1;
    }
    x.col(p) = x.col(with);
    support.metric[p] = support.metric[with];
    points.lambda[p] = points.lambda[with];
    support.moment[p] = support.moment[with];
    support.stabilisation[p] = support.stabilisation[with] * chunk.matter.volume[p] / chunk.matter.volume[with];
    change.rows[points.place(p)] = change.rows[points.place(with)];
    change.points[points.place(p)].shared = 1;
    points.pairs.push_back({.first = with, .second = p});
  }
}

template <int Dim> void ShapeFunctions<Dim>::fail_at(const Chunk<Dim>& chunk, Index p) const {
  throw NumericalError(fmt::format("at time {:.6g} the material point at ({:.6g}) is outside of the nodes around it",
                                   world_.time, fmt::join(chunk.matter.x.col(p), ", ")));
}

template class NodeSearch<2>;
template class NodeSearch<3>;
template class ShapeFunctions<2>;
template class ShapeFunctions<3>;

}  // namespace efree::internal
