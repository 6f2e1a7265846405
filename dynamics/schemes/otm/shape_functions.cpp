// SPDX-License-Identifier: GPL-3.0-or-later
/// Local maximum-entropy shape functions of material points.
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <iterator>
#include <map>

namespace efree::internal {
namespace {

/// Nodes in a point's support over those at first, below which the support is too small.
constexpr double least_nodes = 0.6;
/// Width of shape functions, over the first one, below which a point that is next to a crack does not take them.
constexpr double least_width = 0.05;
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

/// Bodies whose nodes may be in a point's support: its own, those of its nodes so far, and those seized by these nodes.
template <int Dim> void find_partners(const World<Dim>& world, const OtmState<Dim>& state, const Chunk<Dim>& chunk,
                                      Index p, std::vector<Index>& partners) {
  partners.assign(1, chunk.body);
  if (state.seized.empty()) return;
  const auto add = [&](Index body) {
    const auto place = std::lower_bound(partners.begin(), partners.end(), body);
    if (place == partners.end() || *place != body) partners.insert(place, body);
  };
  for (Index e = chunk.table.offsets[p]; e < chunk.table.offsets[p + 1]; ++e) {
    const Index a = chunk.table.nodes[chunk.table.local[e]];
    add(world.nodes.body[a]);
    for (auto by = std::lower_bound(state.seized.begin(), state.seized.end(), std::pair(a, Index(0)));
         by != state.seized.end() && by->first == a; ++by)
      add(by->second);
  }
}

template <int Dim> void complete(TableRow& row) {
  complete_row<Dim>(row.size(), [&](std::size_t k) -> TableEntry& { return row[k].second; });
}

/// The shape functions that a point has, as they are where it and the nodes are now. Those of nodes that have been
/// merged with another are the other's: the point moves to the mean of its nodes, and gradients are those of maximum
/// entropy to these weights, N_a J^-1 (x_a - x); else the point is one of `kept`. False if the nodes that are left do
/// not span space.
template <int Dim> bool keep_shape_functions(const World<Dim>& world, const OtmState<Dim>& state, Chunk<Dim>& chunk,
                                             Index p, TableRow& row, std::vector<Index>& kept) {
  const PointTable<Dim>& table = chunk.table;
  const Points<Dim>& x = world.nodes.x;
  const std::vector<Index>& merged = state.merged;
  const Mat<Dim> since = chunk.matter.F_since[p].template topLeftCorner<Dim, Dim>(), inverse = since.inverse();
  update_position_again(world, chunk, p);
  row.clear();
  bool is_lost = false;
  for (Index e = table.offsets[p]; e < table.offsets[p + 1]; ++e) {
    const TableEntry& entry = table.entries[e];
    const Index a = table.nodes[table.local[e]];
    is_lost = is_lost || merged[a] >= 0;
    const Vec<Dim> dN = inverse.transpose() * Eigen::Map<const Vec<Dim>>(entry.dN);
    row.push_back({a, table_entry<Dim>(entry.N, dN, world.axisymmetric() ? entry.N / chunk.matter.x(0, p) : 0.0)});
  }
  Mat<Dim> moment = since * chunk.support.moment[p] * since.transpose();
  if (is_lost) {
    std::map<Index, double> weights;
    for (const auto& [a, entry] : row) weights[merged[a] >= 0 ? merged[a] : a] += entry.N;
    Vec<Dim> at = Vec<Dim>::Zero();
    for (const auto& [a, N] : weights) at += N * x.col(a);
    Mat<Dim> spread = Mat<Dim>::Zero();
    for (const auto& [a, N] : weights) spread += N * (x.col(a) - at) * (x.col(a) - at).transpose();
    if (!(eigenvalues<Dim>(spread)[0] > 1e-3 * eigenvalues<Dim>(moment)[0])) return false;
    const Mat<Dim> slopes = spread.inverse();
    row.clear();
    for (const auto& [a, N] : weights)
      row.push_back({a, table_entry<Dim>(N, N * slopes * (x.col(a) - at), world.axisymmetric() ? N / at[0] : 0.0)});
    chunk.matter.x.col(p) = at;
    moment = spread;
  } else {
    kept.push_back(p);
  }
  chunk.support.stabilisation[p] *= moment.inverse().trace() / chunk.support.moment[p].inverse().trace();
  chunk.support.moment[p] = moment;
  return true;
}

/// Stiffness against zero-energy modes of a point with new shape functions on these nodes.
template <int Dim> double stabilisation_of(const World<Dim>& world, const OtmOptions& options, Chunk<Dim>& chunk,
                                           Index p, bool first, const std::vector<Index>& used, double inverse_trace) {
  const double shear = world.bodies[chunk.body].shear, shock = chunk.matter.shock[p];
  // Stresses drive zero-energy modes, as they drive springs under load.
  const Mat<3> tau =
      first ? Mat<3>::Zero() : Mat<3>(chunk.matter.response.stress(p) * chunk.matter.now.gradient(p).transpose());
  // Stiffness is enough for pressures as large as the stabilisation that it makes.
  const double pressure = std::max(0.0, shock - tau.trace() / 3.0 - options.stabilisation * shear);
  const bool is_shared =
      std::any_of(used.begin(), used.end(), [&](Index a) { return world.nodes.body[a] != chunk.body; });
  const double share = is_shared ? std::max(shared_stabilisation, options.stabilisation) : options.stabilisation;
  const double stiffness = share * (shear + tau.norm() + shock) + options.stabilisation * by_pressure * pressure;
  return stiffness * chunk.matter.volume[p] * inverse_trace / Dim;
}

}  // namespace

template <int Dim> bool find_shape_functions(const World<Dim>& world, const OtmState<Dim>& state, Index number, Index p,
                                             bool first, Mat<Dim>& metric, Vec<Dim>& lambda,
                                             LmeFunctions<Dim>& functions, std::vector<Index>& used,
                                             Reconnection<Dim>& counted) {
  const Chunk<Dim>& chunk = world.chunks[number];
  const OtmPoints<Dim>& points = state.points[number];
  const Points<Dim>& x = world.nodes.x;
  const double furthest = -std::log(state.options.lme.cutoff);
  const Vec<Dim> at = chunk.matter.x.col(p);
  thread_local std::vector<Index> around, partners;
  find_partners(world, state, chunk, p, partners);
  const auto search = [&](double share) {
    used.clear();
    for (const Index b : partners) {
      state.search.within(b, at, std::sqrt(furthest * share / eigenvalues<Dim>(metric)[0]), around);
      for (const Index near_by : around) {
        const Index a = world.first_node[b] + near_by;
        const Vec<Dim> d = x.col(a) - at;
        if (state.merged[a] < 0 && d.dot(metric * d) <= furthest * share) used.push_back(a);
      }
    }
  };
  if (!first) {
    const Mat<Dim> inverse = chunk.matter.F_since[p].template topLeftCorner<Dim, Dim>().inverse();
    metric = limited<Dim>(inverse.transpose() * metric * inverse, state.options.anisotropy);
    lambda = inverse.transpose() * lambda;
    // Where nodes have moved apart more than F at the point says, supports follow the nodes.
    for (int wider = 0; wider < 20; ++wider) {
      search(1.0);
      if (static_cast<double>(used.size()) >= least_nodes * points.count[p]) break;
      metric /= 1.2;
    }
  }
  for (double share = 1.0; share < (first ? 10.0 : 4.0); share *= 3.0) {
    search(share);
    if (state.cracks.any() && world.bodies[chunk.body].cells.cols() != 0)
      state.cracks.keep_connected(world, chunk.body, chunk.number[p], used);
    if (share > 2.0 && !first) {
      // The nodes it had: it is a mean of them.
      const std::size_t found = used.size();
      for (Index e = chunk.table.offsets[p]; e < chunk.table.offsets[p + 1]; ++e) {
        const Index a = chunk.table.nodes[chunk.table.local[e]];
        if (state.merged[a] < 0 &&
            !std::binary_search(used.begin(), used.begin() + static_cast<std::ptrdiff_t>(found), a))
          used.push_back(a);
      }
      ++counted.enlarged;
    }
    functions.clear();
    for (const Index a : used) functions.add(x.col(a) - at);
    const LmeStatus status = functions.find(metric, lambda);
    counted.iterations += functions.iterations();
    // Past a crack a point may be at the very edge of the nodes that are left to it.
    const bool is_edge = state.cracks.any() && smallest_width<Dim>(functions.moment()) < least_width * points.width[p];
    if (status == LmeStatus::found && !is_edge) return true;
    lambda.setZero();
  }
  return false;
}

template <int Dim> Reconnection<Dim> compute_shape_functions(World<Dim>& world, OtmState<Dim>& state, Index number,
                                                             std::span<const Index> which, bool first) {
  Chunk<Dim>& chunk = world.chunks[number];
  OtmPoints<Dim>& points = state.points[number];
  Support<Dim>& support = chunk.support;
  Reconnection<Dim> result;
  result.rows.resize(which.size());
  LmeFunctions<Dim> functions(state.options.lme);
  std::vector<Index> used;
  for (std::size_t k = 0; k < which.size(); ++k) {
    const Index p = which[k];
    TableRow& row = result.rows[k];
    const Vec<Dim> at = chunk.matter.x.col(p);
    if (chunk.is_inverted(p)) {
      result.lost.push_back(p);
      continue;
    }
    if (!find_shape_functions(world, state, number, p, first, support.metric[p], points.lambda[p], functions, used,
                              result)) {
      if (first || !keep_shape_functions(world, state, chunk, p, row, result.kept)) {
        row.clear();
        result.lost.push_back(p);
        continue;
      }
      complete<Dim>(row);
      ++result.num_kept;
      continue;
    }
    for (std::size_t k_used = 0; k_used < used.size(); ++k_used) {
      const auto a = static_cast<Index>(k_used);
      const double N = functions.N(a);
      row.push_back({used[k_used], table_entry<Dim>(N, functions.dN(a), world.axisymmetric() ? N / at[0] : 0.0)});
    }
    complete<Dim>(row);
    if (first) {
      points.count[p] = static_cast<double>(row.size());
      points.width[p] = smallest_width<Dim>(functions.moment());
    }
    // Of the shape functions it had, where the nodes have gone.
    const Mat<Dim> since = chunk.matter.F_since[p].template topLeftCorner<Dim, Dim>();
    const double squared_width = eigenvalues<Dim>(since * support.moment[p] * since.transpose())[0];
    const double stabilisation = support.stabilisation[p];
    support.moment[p] = functions.moment();
    support.stabilisation[p] =
        stabilisation_of(world, state.options, chunk, p, first, used, functions.inverse_moment().trace());
    const bool is_narrower = eigenvalues<Dim>(support.moment[p])[0] < 0.8 * squared_width;
    if (!first && (is_narrower || support.stabilisation[p] > 2.0 * stabilisation)) result.stiffened.push_back(p);
  }
  return result;
}

template <int Dim> std::string no_shape_functions(const World<Dim>& world, const Chunk<Dim>& chunk, Index p) {
  return fmt::format("at time {:.6g} the material point at ({:.6g}) is outside of the nodes around it", world.time,
                     fmt::join(chunk.matter.x.col(p), ", "));
}

template <int Dim> void Reconnection<Dim>::add(Reconnection&& more) {
  std::ranges::move(more.rows, std::back_inserter(rows));
  lost.insert(lost.end(), more.lost.begin(), more.lost.end());
  kept.insert(kept.end(), more.kept.begin(), more.kept.end());
  stiffened.insert(stiffened.end(), more.stiffened.begin(), more.stiffened.end());
  iterations += more.iterations;
  enlarged += more.enlarged;
  num_kept += more.num_kept;
  shared += more.shared;
  stabilisation += more.stabilisation;
}

#define EFREE_INSTANTIATE(Dim)                                                                                   \
  template bool find_shape_functions(const World<Dim>&, const OtmState<Dim>&, Index, Index, bool, Mat<Dim>&,     \
                                     Vec<Dim>&, LmeFunctions<Dim>&, std::vector<Index>&, Reconnection<Dim>&);    \
  template Reconnection<Dim> compute_shape_functions(World<Dim>&, OtmState<Dim>&, Index, std::span<const Index>, \
                                                     bool);                                                      \
  template std::string no_shape_functions(const World<Dim>&, const Chunk<Dim>&, Index);                          \
  template struct Reconnection<Dim>;
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
