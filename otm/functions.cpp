// SPDX-License-Identifier: GPL-3.0-or-later
/// Functions of points: made, given, and made anew, with what nodes carry of the points.
#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/materials/internal/principal.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>

namespace efree::internal {
namespace {

/// A node's function as kernels read it; `hoop` is over the radius.
template <int Dim> OtmEntry entry_of(double N, const Vec<Dim>& dN, double hoop) {
  OtmEntry entry{{0.0, 0.0, hoop}, N};
  for (int i = 0; i < Dim; ++i) entry.dN[i] = dN[i];
  return entry;
}

/// Of a point's nodes.
template <int Dim> void complete(std::vector<std::pair<Index, OtmEntry>>& row) {
  otm_complete<Dim>(row.size(), [&](std::size_t k) -> OtmEntry& { return row[k].second; });
}

/// The metric with the same determinant whose axes have lengths of at most that ratio.
template <int Dim> Mat<Dim> rounded(const Mat<Dim>& metric, double ratio) {
  auto [value, axes] = spectrum<Dim>(metric);  // values ascending, 1 / length^2
  const double most = ratio * ratio;
  if (value[Dim - 1] <= most * value[0]) return metric;
  const double product = value.prod();
  // The two ends are brought in by as much, until the ratio is what it may be.
  Vec<Dim> log = value.array().log();
  const double excess = log[Dim - 1] - log[0] - std::log(most);
  log[0] += 0.5 * excess;
  log[Dim - 1] -= 0.5 * excess;
  if constexpr (Dim == 3) log[1] = std::clamp(log[1], log[0], log[2]);
  value = log.array().exp();
  value *= std::pow(product / value.prod(), 1.0 / Dim);
  return axes * value.asDiagonal() * axes.transpose();
}

/// Nodes that a point sees, over those it saw at first, below which its support is too small.
constexpr double least_seen = 0.6;

/// Points whose functions a thread makes anew at once.
constexpr Index points_at_once = 16;

/// Puts the elastic stretch in the place of an F by which much has flown, and C_p^-1 - 1, given by its components, at
/// what keeps J: an isotropic material has the same stress, by the same V_e^2 = F C_p^-1 F^T. That would be a small
/// difference of numbers of the size of |F|^4: at stretches of e^8 along one axis and e^-8 along another nothing is
/// left of it.
void forget_flow(Eigen::Ref<Mat<3>> F, Eigen::Ref<Vec<6>> flow) {
  constexpr double far = 30.0;
  const double J = F.determinant();
  if (!(J > 0.0) || F.squaredNorm() <= far * std::cbrt(J * J)) return;
  const Mat<3> left = F * (Mat<3>::Identity() + internal::symmetric(flow)) * F.transpose();  // V_e^2
  const auto [squares, axes] = spectrum<3>(0.5 * (left + left.transpose()));
  if (!(squares[0] > 0.0)) return;
  const Mat<3> V = axes * squares.cwiseSqrt().asDiagonal() * axes.transpose();
  const double growth = std::cbrt(J / V.determinant());
  F = growth * V;
  flow << Vec<3>::Constant(1.0 / (growth * growth) - 1.0), Vec<3>::Zero();
}

/// The rotation whose moment of momentum is that of first moments of velocities, on functions of that second moment; as
/// far as there is one (none about nodes that are in one place, nor about a line of them).
template <int Dim> Mat<Dim> rotation_of(const Mat<Dim>& velocities, const Mat<Dim>& moment) {
  const Mat<Dim> skew = velocities - velocities.transpose();
  if (!(moment.trace() > 0.0)) return Mat<Dim>::Zero();
  if constexpr (Dim == 2) {
    return skew / moment.trace();
  } else {
    const Mat<3> inertia = moment.trace() * Mat<3>::Identity() - moment;
    const Vec<3> spin = pseudo_inverse<3>(inertia) * Vec<3>(skew(2, 1), skew(0, 2), skew(1, 0));
    Mat<3> result;
    result << 0.0, -spin[2], spin[1], spin[2], 0.0, -spin[0], -spin[1], spin[0], 0.0;
    return result;
  }
}

/// How far nodes go before trees of them are built anew, over their least spacing.
constexpr double tree_skin = 0.1;

/// Width of functions, over the first one, below which a point that is next to a crack does not take them.
constexpr double least_width = 0.05;

/// Least stabilisation of points that see nodes of two bodies: those of both surfaces lie in one place, and points
/// tell motions of the ones against the others by nothing else.
constexpr double shared_stabilisation = 1.0;

/// Stabilisation by pressure, over that by stiffness. Functions that are made anew do not integrate exactly: motions
/// of the nodes between points may let all of these grow where the body does not. Pressure drives them, so that
/// shocks come out slow and nodes clump; what resists has to grow with it. The more of it, the closer shocks are to
/// Hugoniot's, and the shorter steps under pressure (docs/evidence.md).
constexpr double by_pressure = 70.0;

}  // namespace

/// The functions of a point where it and the nodes are now, and these nodes; its metric and lambda are those of before,
/// and of now on return. Counts what it takes.
template <int Dim> bool Motion<Dim>::find_functions(const OtmChunk<Dim>& chunk, Index p, bool first, Mat<Dim>& metric,
                                                    Vec<Dim>& lambda, LmeFunctions<Dim>& functions,
                                                    std::vector<Index>& used, OtmCounts& counted) const {
  const BodyOf& body = bodies[chunk.body];
  const double furthest = -std::log(options.lme.cutoff);
  const Vec<Dim> at = chunk.at.col(p);
  thread_local std::vector<Index> around, seen_bodies;
  partners_of(chunk, p, seen_bodies);
  const auto look = [&](double share) {
    used.clear();
    for (const Index b : seen_bodies) {
      trees[b]->within(at, std::sqrt(furthest * share / eigenvalues<Dim>(metric)[0]) + drift[b], around);
      for (const Index near_by : around) {
        const Index a = bodies[b].first_node + near_by;
        const Vec<Dim> d = x.col(a) - at;
        if (merged[a] < 0 && d.dot(metric * d) <= furthest * share) used.push_back(a);
      }
    }
  };
  if (!first) {
    const Mat<Dim> inverse = chunk.since[p].template topLeftCorner<Dim, Dim>().inverse();
    metric = rounded<Dim>(inverse.transpose() * metric * inverse, options.anisotropy);
    lambda = inverse.transpose() * lambda;
    // Where nodes have come apart from each other more than points say, supports follow the nodes.
    for (int wider = 0; wider < 20; ++wider) {
      look(1.0);
      if (static_cast<double>(used.size()) >= least_seen * chunk.count[p]) break;
      metric /= 1.2;
    }
  }
  for (double share = 1.0; share < (first ? 10.0 : 4.0); share *= 3.0) {
    look(share);
    if (!stars.empty() && body.cells.cols() != 0) keep_connected(chunk.body, chunk.number[p], used);
    if (share > 2.0 && !first) {
      // The nodes it had: it is a mean of them.
      const std::size_t found = used.size();
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const Index a = chunk.nodes[chunk.local[e]];
        if (merged[a] < 0 && !std::binary_search(used.begin(), used.begin() + static_cast<std::ptrdiff_t>(found), a))
          used.push_back(a);
      }
      ++counted.widened;
    }
    functions.clear();
    for (const Index a : used) functions.add(x.col(a) - at);
    const LmeStatus status = functions.find(metric, lambda);
    counted.iterations += functions.iterations();
    // Past a crack a point may be at the very edge of the nodes that are left to it.
    const bool is_edge = !stars.empty() && smallest_width<Dim>(functions.moment()) < least_width * chunk.width[p];
    if (status == LmeStatus::found && !is_edge) return true;
    lambda.setZero();
  }
  return false;
}

/// The functions that a point has, as they are where it and the nodes are now. What a node had that has become one with
/// another is the other's: the point moves to the mean of them, and gradients are those of maximum entropy to these
/// weights, N_a J^-1 (x_a - x); else the point is one of `kept`. False if the nodes that are left do not span space.
template <int Dim> bool Motion<Dim>::keep_functions(OtmChunk<Dim>& chunk, Index p,
                                                    std::vector<std::pair<Index, OtmEntry>>& row,
                                                    std::vector<Index>& kept) const {
  const Mat<Dim> since = chunk.since[p].template topLeftCorner<Dim, Dim>(), inverse = since.inverse();
  place_anew(chunk, p);
  row.clear();
  bool is_lost = false;
  for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
    const OtmEntry& entry = chunk.entries[e];
    const Index a = chunk.nodes[chunk.local[e]];
    is_lost = is_lost || merged[a] >= 0;
    const Vec<Dim> dN = inverse.transpose() * Eigen::Map<const Vec<Dim>>(entry.dN);
    row.push_back({a, entry_of<Dim>(entry.N, dN, axisymmetric() ? entry.N / chunk.at(0, p) : 0.0)});
  }
  Mat<Dim> moment = since * chunk.moment[p] * since.transpose();
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
      row.push_back({a, entry_of<Dim>(N, N * slopes * (x.col(a) - at), axisymmetric() ? N / at[0] : 0.0)});
    chunk.at.col(p) = at;
    moment = spread;
  } else {
    kept.push_back(p);
  }
  chunk.penalty[p] *= moment.inverse().trace() / chunk.moment[p].inverse().trace();
  chunk.moment[p] = moment;
  return true;
}

/// Smoothed particles: N is 1 at the point's own node. Volumes are those of the start, as if J were 1: gradients that
/// reproduce linear functions hardly notice.
template <int Dim>
void Motion<Dim>::make_particles(OtmChunk<Dim>& chunk, std::span<const Index> which, Rows& rows) const {
  const BodyOf& body = bodies[chunk.body];
  std::vector<Index> around;
  for (std::size_t k = 0; k < which.size(); ++k) {
    const Index p = which[k], own = body.first_node + chunk.number[p];
    const double h = 1.3 * spacing[own];
    trees[chunk.body]->within(x.col(own), 2.0 * h + drift[chunk.body], around);
    Mat<Dim> moment = Mat<Dim>::Zero();
    std::vector<std::pair<Index, Vec<Dim>>> slopes;
    for (const Index near_by : around) {
      const Index b = body.first_node + near_by;
      const Vec<Dim> d = x.col(b) - x.col(own);
      const double q = d.norm() / h;
      if (b == own || q >= 2.0) continue;
      // -W'(q) / q up to a factor, which the moment takes out.
      const double slope = q < 1.0 ? 3.0 - 2.25 * q : 0.75 * (2.0 - q) * (2.0 - q) / q;
      slopes.emplace_back(b, slope * d);
      moment += slope * d * d.transpose();
    }
    const Mat<Dim> inverse = moment.inverse();
    if (!inverse.allFinite())
      throw NumericalError(fmt::format("at time {:.6g} the particle at ({:.6g}) has {} others around it: too few", time,
                                       fmt::join(x.col(own), ", "), slopes.size()));
    Vec<Dim> sum = Vec<Dim>::Zero();
    rows[k].assign(1, {own, {}});
    for (const auto& [b, slope] : slopes) {
      const Vec<Dim> dN = inverse * slope;
      rows[k].push_back({b, entry_of<Dim>(0.0, dN, 0.0)});
      sum += dN;
    }
    rows[k].front().second = entry_of<Dim>(1.0, -sum, axisymmetric() ? 1.0 / x(0, own) : 0.0);
    chunk.penalty[p] = 0.0;
  }
}

/// Functions of these points, ascending.
template <int Dim> typename Motion<Dim>::Change Motion<Dim>::make_functions(OtmChunk<Dim>& chunk,
                                                                            std::span<const Index> which,
                                                                            bool first) const {
  Change result;
  result.rows.resize(which.size());
  if (options.functions == OtmFunctions::smoothed_particles) {
    make_particles(chunk, which, result.rows);
    return result;
  }
  LmeFunctions<Dim> functions(options.lme);
  std::vector<Index> used;
  for (std::size_t k = 0; k < which.size(); ++k) {
    const Index p = which[k];
    auto& row = result.rows[k];
    const Vec<Dim> at = chunk.at.col(p);
    if (chunk.is_crushed(p)) {
      result.lost.push_back(p);
      continue;
    }
    if (!find_functions(chunk, p, first, chunk.metric[p], chunk.lambda[p], functions, used, result.counted)) {
      if (first || !keep_functions(chunk, p, row, result.kept)) {
        row.clear();
        result.lost.push_back(p);
        continue;
      }
      complete<Dim>(row);
      ++result.counted.kept;
      continue;
    }
    for (std::size_t k_used = 0; k_used < used.size(); ++k_used) {
      const auto a = static_cast<Index>(k_used);
      const double N = functions.N(a);
      row.push_back({used[k_used], entry_of<Dim>(N, functions.dN(a), axisymmetric() ? N / at[0] : 0.0)});
    }
    complete<Dim>(row);
    if (first) {
      chunk.count[p] = static_cast<double>(row.size());
      chunk.width[p] = smallest_width<Dim>(functions.moment());
    }
    // Of the functions it had, where the nodes have gone.
    const Mat<Dim> since = chunk.since[p].template topLeftCorner<Dim, Dim>();
    const double squared_width = eigenvalues<Dim>(since * chunk.moment[p] * since.transpose())[0];
    const double penalty = chunk.penalty[p];
    chunk.moment[p] = functions.moment();
    // Stresses push nodes about that points do not see, as springs under load.
    const Mat<3> tau = first ? Mat<3>::Zero() : Mat<3>(chunk.response.stress(p) * chunk.now.gradient(p).transpose());
    const double shear = bodies[chunk.body].shear;
    // Stiffness is enough for pressures as large as the stabilisation that it makes.
    const double pressure = std::max(0.0, chunk.shock[p] - tau.trace() / 3.0 - options.stabilisation * shear);
    const bool is_shared =
        std::any_of(used.begin(), used.end(), [&](Index a) { return body_of_node[a] != chunk.body; });
    const double share = is_shared ? std::max(shared_stabilisation, options.stabilisation) : options.stabilisation;
    const double stiffness =
        share * (shear + tau.norm() + chunk.shock[p]) + options.stabilisation * by_pressure * pressure;
    chunk.penalty[p] = stiffness * chunk.volume[p] * functions.inverse_moment().trace() / Dim;
    const bool is_narrower = eigenvalues<Dim>(chunk.moment[p])[0] < 0.8 * squared_width;
    if (!first && (is_narrower || chunk.penalty[p] > 2.0 * penalty)) result.stiffened.push_back(p);
  }
  return result;
}

template <int Dim> std::string Motion<Dim>::has_no_functions(const OtmChunk<Dim>& chunk, Index p) const {
  return fmt::format("at time {:.6g} the material point at ({:.6g}) is outside of the nodes around it", time,
                     fmt::join(chunk.at.col(p), ", "));
}

/// Functions that are given, for good. What LME functions say of motions that points do not see, others do not.
template <int Dim>
typename Motion<Dim>::Rows Motion<Dim>::rows_of(const OtmChunk<Dim>& chunk, const ShapeTable<Dim>& shape) const {
  Rows rows(chunk.size());
  for (Index p = 0; p < chunk.size(); ++p) {
    const ShapeRow<Dim> row = shape.row(chunk.number[p]);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      rows[p].push_back({bodies[chunk.body].first_node + row.nodes[k],
                         entry_of<Dim>(row.N[k], row.dN[k], axisymmetric() ? row.hoop[k] : 0.0)});
    complete<Dim>(rows[p]);
  }
  return rows;
}

template <int Dim> void Motion<Dim>::put_rows(OtmChunk<Dim>& chunk, const std::vector<Index>& which, const Rows& rows) {
  // Local numbers are given as nodes come up.
  thread_local std::vector<Index> number;
  thread_local std::vector<Index> nodes, offsets;
  thread_local std::vector<std::uint16_t> local;
  thread_local OtmTable<OtmEntry> entries;
  number.resize(std::max(number.size(), static_cast<std::size_t>(x.cols())), -1);
  nodes.clear();
  offsets.assign(1, 0);
  local.clear();
  entries.clear();
  const auto put = [&](Index node, const OtmEntry& entry) {
    if (number[node] < 0) {
      number[node] = static_cast<Index>(nodes.size());
      nodes.push_back(node);
    }
    local.push_back(static_cast<std::uint16_t>(number[node]));
    entries.push_back(entry);
  };
  std::size_t next = 0;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (next < which.size() && which[next] == p)
      for (const auto& [node, entry] : rows[next++]) put(node, entry);
    else
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e)
        put(chunk.nodes[chunk.local[e]], chunk.entries[e]);
    offsets.push_back(static_cast<Index>(entries.size()));
  }
  for (const Index node : nodes) number[node] = -1;
  if (nodes.size() > 65535) throw NumericalError("material points that lie together see more than 65535 nodes");
  chunk.offsets = offsets;
  chunk.local = local;
  chunk.entries = entries;
  chunk.nodes = nodes;
  chunk.x.assign(4 * nodes.size(), 0.0);
  chunk.force.assign(4 * nodes.size(), 0.0);
}

/// Numbers of points, after some came in or went.
template <int Dim> void Motion<Dim>::find_points() {
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b) {
    const Index change =
        static_cast<Index>(bodies[b].cells.cols()) - (bodies[b + 1].first_point - bodies[b].first_point);
    if (bodies[b].cells.cols() == 0 || change == 0) continue;
    for (std::size_t later = b + 1; later < bodies.size(); ++later) bodies[later].first_point += change;
  }
  place_of_point.resize(bodies.back().first_point);
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (Index p = 0; p < chunks[c].size(); ++p)
      place_of_point[bodies[chunks[c].body].first_point + chunks[c].number[p]] = {static_cast<Index>(c), p};
}

template <int Dim> void Motion<Dim>::find_places() {
  all_chunks.resize(chunks.size());
  std::iota(all_chunks.begin(), all_chunks.end(), 0);
  node_offsets.assign(x.cols() + 1, 0);
  for (const auto& chunk : chunks)
    for (const Index a : chunk.nodes) ++node_offsets[a + 1];
  std::partial_sum(node_offsets.begin(), node_offsets.end(), node_offsets.begin());
  node_places.resize(node_offsets.back());
  node_forces.resize(node_places.size());
  std::vector<Index> next(node_offsets.begin(), node_offsets.end() - 1);
  for (std::size_t c = 0; c < chunks.size(); ++c)
    for (std::size_t l = 0; l < chunks[c].nodes.size(); ++l) {
      const Index place = next[chunks[c].nodes[l]]++;
      node_places[place] = {static_cast<Index>(c), static_cast<Index>(l)};
      node_forces[place] = chunks[c].force.data() + 4 * l;
    }
}

template <int Dim> void Motion<Dim>::Change::add(Change&& more) {
  std::ranges::move(more.rows, std::back_inserter(rows));
  lost.insert(lost.end(), more.lost.begin(), more.lost.end());
  kept.insert(kept.end(), more.kept.begin(), more.kept.end());
  stiffened.insert(stiffened.end(), more.stiffened.begin(), more.stiffened.end());
  counted.iterations += more.counted.iterations;
  counted.widened += more.counted.widened;
  counted.kept += more.counted.kept;
  counted.joined += more.counted.joined;
  unseen += more.unseen;
}

/// Points that have no functions go to the nearest of the chunk that has some, and take its.
template <int Dim> void Motion<Dim>::join(OtmChunk<Dim>& chunk, Change& change) const {
  std::vector<Index>& lost = change.lost;
  const auto is_second = [&](Index q) {
    return std::any_of(chunk.pairs.begin(), chunk.pairs.end(),
                       [&](const auto& pair) { return pair.fuses() && pair.second == q; });
  };
  for (std::size_t k = 0; k < lost.size(); ++k) {
    const Index p = lost[k];
    if (is_second(p)) continue;  // the first of its pair has them
    const auto away = [&](Index q) { return (chunk.at.col(q) - chunk.at.col(p)).squaredNorm(); };
    for (;;) {
      Index with = -1;
      for (Index q = 0; q < chunk.size(); ++q)
        if (!chunk.is_eroded(q) && (with < 0 || away(q) < away(with)) && std::ranges::count(lost, q) == 0 &&
            !is_second(q))
          with = q;
      if (with < 0) throw NumericalError(has_no_functions(chunk, p));
      const std::size_t place_of_it = chunk.worn_place(with);
      if (place_of_it == chunk.worn.size() || chunk.worn[place_of_it] != with) {
        // It wears with them.
        place_anew(chunk, with);
        if (!hold_crushed(chunk, with)) change.unseen += unseen(chunk, with, 0.5 * last_step);
        Change of_it = make_functions(chunk, std::span(&with, 1), false);
        chunk.wear(with);
        const bool has_some = of_it.lost.empty();
        change.rows.insert(change.rows.begin() + static_cast<std::ptrdiff_t>(place_of_it),
                           std::move(of_it.rows.front()));
        of_it.rows.clear();
        change.add(std::move(of_it));
        if (!has_some) continue;
      }
      chunk.at.col(p) = chunk.at.col(with);
      chunk.metric[p] = chunk.metric[with];
      chunk.lambda[p] = chunk.lambda[with];
      chunk.moment[p] = chunk.moment[with];
      chunk.penalty[p] = chunk.penalty[with] * chunk.volume[p] / chunk.volume[with];
      change.rows[chunk.worn_place(p)] = change.rows[chunk.worn_place(with)];
      chunk.pairs.push_back({.first = with, .second = p, .pairing = OtmPairing::join});
      ++change.counted.joined;
      break;
    }
  }
}

/// Masses and momenta of nodes change as the functions of a point do, or of some: what they carry of momentum, and of
/// its moment, stays what it is.
template <int Dim> void Motion<Dim>::hand_over(const OtmChunk<Dim>& chunk, const std::vector<PointRow>& rows,
                                               Vector& masses, Points<Dim>& momenta) const {
  if (options.functions == OtmFunctions::smoothed_particles) return;  // nodes are the points
  double m = 0.0;
  Vec<Dim> at = Vec<Dim>::Zero();
  for (const auto& [p, row] : rows) {
    m += chunk.mass[p];
    at += chunk.mass[p] * chunk.at.col(p);
  }
  at /= m;
  Vec<Dim> mean = Vec<Dim>::Zero();
  Mat<Dim> affine = Mat<Dim>::Zero(), moment = affine;
  for (const auto& [p, row] : rows) {
    for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
      const Index a = chunk.nodes[chunk.local[e]];
      const double part = chunk.mass[p] * chunk.entries[e].N;
      mean += part / m * v.col(a);
      affine += part / m * v.col(a) * (x.col(a) - at).transpose();
      masses[a] -= part;
      momenta.col(a) -= part * v.col(a);
    }
  }
  Vec<Dim> shift = Vec<Dim>::Zero();
  Mat<Dim> turn = Mat<Dim>::Zero();
  if (options.momentum == OtmMomentum::affine) {
    shift = mean;
    turn = affine;
    for (const auto& [p, row] : rows)
      for (const auto& [a, entry] : *row) {
        const double part = chunk.mass[p] * entry.N / m;
        const Vec<Dim> d = x.col(a) - at;
        shift -= part * v.col(a);
        turn -= part * v.col(a) * d.transpose();
        moment += part * d * d.transpose();
      }
    const Mat<Dim> turned = rotation_of<Dim>(turn, moment);
    // Where functions are narrow the inverse would keep fewer digits of the moment of momentum.
    turn = moment.ldlt().solve(turn.transpose()).transpose().eval();
    // No more of what is no rotation than makes no energy: on narrow functions it would be many times what there was.
    // Over half the mass, against the mean velocity.
    double before = 0.0, after = 0.0, mixed = 0.0, stretched = 0.0;
    for (const auto& [p, row] : rows) {
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e)
        before += chunk.mass[p] / m * chunk.entries[e].N * (v.col(chunk.nodes[chunk.local[e]]) - mean).squaredNorm();
      for (const auto& [a, entry] : *row) {
        const double part = chunk.mass[p] * entry.N / m;
        const Vec<Dim> d = x.col(a) - at, speed = v.col(a) + shift + turned * d - mean, stretch = (turn - turned) * d;
        after += part * speed.squaredNorm();
        mixed += part * speed.dot(stretch);
        stretched += part * stretch.squaredNorm();
      }
    }
    if (after + 2.0 * mixed + stretched > before && stretched > 0.0) {
      const double root = mixed * mixed - stretched * (after - before);
      const double share = (std::sqrt(std::max(0.0, root)) - mixed) / stretched;
      turn = turned + std::min(1.0, share) * (turn - turned);
    }
  }
  for (const auto& [p, row] : rows)
    for (const auto& [a, entry] : *row) {
      const double part = chunk.mass[p] * entry.N;
      masses[a] += part;
      if (options.momentum == OtmMomentum::points)
        momenta.col(a) += part * mean;
      else
        momenta.col(a) += part * (v.col(a) + shift + turn * (x.col(a) - at));
    }
}

template <int Dim> void Motion<Dim>::build_tree(Index body) {
  trees[body]->build(x.middleCols(bodies[body].first_node, bodies[body + 1].first_node - bodies[body].first_node));
  drift[body] = 0.0;
}

/// A tree is built anew when nodes have gone so far that who looks for some would get many that are too far away.
template <int Dim> void Motion<Dim>::follow_nodes(Index body) {
  const Index first = bodies[body].first_node, count = bodies[body + 1].first_node - first;
  const Points<Dim>& then = trees[body]->points();
  if (then.cols() == count) {
    drift[body] = std::sqrt((x.middleCols(first, count) - then).colwise().squaredNorm().maxCoeff());
    if (drift[body] <= tree_skin * spacing.segment(first, count).minCoeff()) return;
  }
  build_tree(body);
}

/// Functions of worn points are made anew where nodes and points are now; what their nodes carry of them follows.
template <int Dim> void Motion<Dim>::renew() {
  std::vector<Index> worn_chunks;
  for (std::size_t c = 0; c < chunks.size(); ++c)
    if (!chunks[c].worn.empty()) worn_chunks.push_back(static_cast<Index>(c));
  if (worn_chunks.empty()) return;
  std::vector<char> body_is_worn(bodies.size(), 0);
  for (const Index c : worn_chunks) body_is_worn[chunks[c].body] = 1;
  auto start = Clock::now();
  for (std::size_t b = 0; b + 1 < bodies.size(); ++b)
    if (body_is_worn[b] || !seized.empty()) follow_nodes(static_cast<Index>(b));
  find_stars();
  std::vector<Change> changes(worn_chunks.size());
  parallel_chunks(static_cast<Index>(worn_chunks.size()), 1, [&](Index k, Index) {
    OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    // Where points are now, and how they are deformed, by the functions they had.
    deform(chunk, x);
    for (const Index p : chunk.worn) {
      place(chunk, p);
      // Velocities are those of half a step ago: so is all energy that is lost here.
      if (!hold_crushed(chunk, p)) changes[k].unseen += unseen(chunk, p, 0.5 * last_step);
    }
    for (const auto& pair : chunk.pairs) {
      const auto& [p, q, way, pairing] = pair;
      chunk.at.col(p) +=
          pair.fuses() ? Vec<Dim>(chunk.mass[q] / (chunk.mass[p] + chunk.mass[q]) * (chunk.at.col(q) - chunk.at.col(p)))
                       : way;
      if (pair.fuses())
        chunk.at.col(q) = chunk.at.col(p);
      else
        chunk.at.col(q) -= chunk.mass[p] / chunk.mass[q] * way;
    }
  });
  // Some points at a time, as there are few such chunks, and of many points at once where much is going on.
  struct Piece {
    std::size_t of;
    Index begin;
    Change change;
  };
  std::vector<Piece> pieces;
  for (std::size_t k = 0; k < worn_chunks.size(); ++k)
    for (Index begin = 0; begin < static_cast<Index>(chunks[worn_chunks[k]].worn.size()); begin += points_at_once)
      pieces.push_back({k, begin, {}});
  parallel_chunks(static_cast<Index>(pieces.size()), 1, [&](Index i, Index) {
    auto& [k, begin, change] = pieces[i];
    OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    const std::span<const Index> rest = std::span<const Index>(chunk.worn).subspan(begin);
    change = make_functions(chunk, rest.first(std::min<std::size_t>(rest.size(), points_at_once)), false);
  });
  for (Piece& piece : pieces) changes[piece.of].add(std::move(piece.change));
  parallel_chunks(static_cast<Index>(worn_chunks.size()), 1, [&](Index k, Index) {
    OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    join(chunk, changes[k]);
    for (const auto& pair : chunk.pairs) {
      if (!pair.fuses()) continue;
      chunk.at.col(pair.second) = chunk.at.col(pair.first);
      changes[k].rows[chunk.worn_place(pair.second)] = changes[k].rows[chunk.worn_place(pair.first)];
      std::erase(changes[k].kept, pair.second);
    }
    const auto& body = bodies[chunk.body];
    const Index metric = body.fracture.stretch > 0.0 ? -1 : body.plastic_metric;  // what breaks by stretches keeps them
    for (const Index p : chunk.worn) {
      Eigen::Map<Mat<3>> made(chunk.made.col(p).data());
      made = Mat<3>(chunk.since[p] * made);
      if (metric >= 0) forget_flow(made, chunk.now.history.col(p).template segment<6>(metric));
    }
  });
  // Masses and momenta of the nodes, in the order of the points.
  const auto energy = [&] {
    double sum = 0.0;
    for (Index a = 0; a < mass.size(); ++a) sum += 0.5 * mass[a] * v.col(a).squaredNorm();
    return sum;
  };
  const double before = energy();
  Points<Dim> momentum = Points<Dim>::Zero(Dim, x.cols());
  Vector change = Vector::Zero(mass.size());
  for (std::size_t k = 0; k < worn_chunks.size(); ++k) {
    const OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    counts.renewals += static_cast<std::int64_t>(chunk.worn.size());
    counts.iterations += changes[k].counted.iterations;
    counts.widened += changes[k].counted.widened;
    counts.kept += changes[k].counted.kept;
    counts.joined += changes[k].counted.joined;
    renewal_loss += changes[k].unseen;
    // Points that pairs bind, one by another, go together; by the first of them.
    std::vector<std::size_t> first(chunk.worn.size());
    std::iota(first.begin(), first.end(), 0);
    for (const auto& pair : chunk.pairs) {
      const std::size_t one = first[chunk.worn_place(pair.first)], other = first[chunk.worn_place(pair.second)];
      std::ranges::replace(first, std::max(one, other), std::min(one, other));
    }
    std::vector<std::vector<PointRow>> together(chunk.worn.size());
    for (std::size_t w = 0; w < chunk.worn.size(); ++w)
      together[first[w]].push_back({chunk.worn[w], &changes[k].rows[w]});
    for (const auto& rows : together)
      if (!rows.empty()) hand_over(chunk, rows, change, momentum);
  }
  for (Index a = 0; a < mass.size(); ++a) {
    if (change[a] == 0.0 && momentum.col(a).isZero(0.0)) continue;
    const Vec<Dim> l = mass[a] * v.col(a) + momentum.col(a);
    mass[a] = merged[a] < 0 ? mass[a] + change[a] : 0.0;
    if (options.momentum != OtmMomentum::nodes && mass[a] > 0.0) v.col(a) = l / mass[a];
  }
  for (const auto& [node, axis, velocity] : prescribed) v(axis, node) = velocity;
  renewal_loss += before - energy();
  parallel_chunks(static_cast<Index>(worn_chunks.size()), 1, [&](Index k, Index) {
    OtmChunk<Dim>& chunk = chunks[worn_chunks[k]];
    put_rows(chunk, chunk.worn, changes[k].rows);
    for (const Index p : chunk.worn) chunk.since[p].setIdentity();
    // What points do not see of their nodes' motion stays with the functions they keep.
    for (const Index p : changes[k].kept) chunk.lost -= unseen(chunk, p, 0.5 * last_step);
    // By new functions points may be squeezed faster than by those they had.
    for (const auto& row : changes[k].rows) {
      Mat<Dim> rate = Mat<Dim>::Zero();
      double around = 0.0;
      for (const auto& [a, entry] : row) {
        rate -= v.col(a) * Eigen::Map<const Vec<Dim>>(entry.dN).transpose();
        if (axisymmetric()) around -= v(0, a) * entry.dN[2];
      }
      Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
      axes.computeDirect(0.5 * (rate + rate.transpose()), Eigen::EigenvaluesOnly);
      chunk.squeeze = std::max({chunk.squeeze, axes.eigenvalues()[Dim - 1], around});
    }
    chunk.crushed.clear();
    chunk.stiffened = std::move(changes[k].stiffened);
    for (const auto& pair : chunk.pairs) chunk.stiffened.insert(chunk.stiffened.end(), {pair.first, pair.second});
  });
  fuse_pairs();
  find_places();
  follow_others();
  times.functions += lap(start);
  // Stiffer functions may be stiffer than any before, and nodes that lost others around them, or got them, light: there
  // the iteration is told to look.
  bool stiffened = false, changed = std::exchange(changed_nodes, false);
  for (const Index c : worn_chunks) {
    stiffened = stiffened || !chunks[c].stiffened.empty();
    changed = changed || !chunks[c].pairs.empty();
  }
  Points<Dim> shape;
  std::vector<char> where;
  if (stiffened || changed) {
    shape = shaken;
    where.assign(x.cols(), 0);
  }
  const double size = 0.1 / std::sqrt(mass.sum());
  for (const Index c : worn_chunks) {
    OtmChunk<Dim>& chunk = chunks[c];
    for (const Index p : chunk.stiffened)
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const Index a = chunk.nodes[chunk.local[e]];
        where[a] = 1;
        for (int i = 0; i < Dim; ++i) shape(i, a) += (e + a + i) % 2 == 0 ? size : -size;
      }
    if (changed)
      for (const Index p : chunk.worn)
        for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) where[chunk.nodes[chunk.local[e]]] = 1;
    chunk.stiffened.clear();
    chunk.worn.clear();
    chunk.pairs.clear();
  }
  if (stiffened || changed) shake_near(where, std::move(shape), changed ? 8 : 5);
}

/// Nodes that no point sees any more have no mass but rounding: they go on as shadows of the nearest.
template <int Dim> void Motion<Dim>::follow_others() {
  const auto is_seen = [&](Index a) { return merged[a] < 0 && node_offsets[a + 1] > node_offsets[a]; };
  for (Index a = 0; a < x.cols(); ++a) {
    if (merged[a] >= 0 || is_seen(a)) continue;
    const BodyOf &body = bodies[body_of_node[a]], &next = bodies[body_of_node[a] + 1];
    Index nearest = -1;
    for (Index b = body.first_node; b < next.first_node; ++b)
      if (is_seen(b) &&
          (nearest < 0 || (x.col(b) - x.col(a)).squaredNorm() < (x.col(nearest) - x.col(a)).squaredNorm()))
        nearest = b;
    if (nearest < 0) continue;
    mass[a] = 0.0;
    become_one(a, nearest);
  }
}

/// Energy of the motions of its nodes that a point does not see, by where these were that time ago.
template <int Dim> double Motion<Dim>::unseen(const OtmChunk<Dim>& chunk, Index p, double ago) const {
  double spread = 0.0;
  Vec<Dim> at = Vec<Dim>::Zero();
  Mat<Dim> since = Mat<Dim>::Zero();
  for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
    const OtmEntry& entry = chunk.entries[e];
    const Index a = chunk.nodes[chunk.local[e]];
    const Vec<Dim> d = x.col(a) - chunk.at.col(p) - ago * v.col(a);
    at += entry.N * d;
    since += d * Eigen::Map<const Vec<Dim>>(entry.dN).transpose();
    spread += entry.N * d.squaredNorm();
  }
  return 0.5 * chunk.penalty[p] * (spread - at.squaredNorm() - (since * chunk.moment[p] * since.transpose()).trace());
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
