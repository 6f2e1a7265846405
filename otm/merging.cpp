// SPDX-License-Identifier: GPL-3.0-or-later
/// Nodes that have come too near to each other become one.
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace efree::internal {
namespace {

/// How far apart nodes may be that become one, over their spacing.
constexpr double reach = 0.5;

/// Width of functions, over the first, below which a point lies in a plane of its nodes.
constexpr double flat = 0.1;

/// Function of a node, where it is largest at a point, below which there is nothing of the body around it.
constexpr double least_seen = 0.02;

}  // namespace

/// The first goes on as a shadow of the other; its mass goes with the points that see it.
template <int Dim> void Motion<Dim>::become_one(Index a, Index with) {
  merged[a] = with;
  for (Index& other : merged)
    if (other == a) other = with;
  // Cells collapse with their edge.
  BodyOf& body = bodies[body_of_node[a]];
  for (Index& corner : body.cells.reshaped())
    if (corner == a - body.first_node) corner = with - body.first_node;
  body.outer.clear();
  surfaces.clear();
  seen_at.resize(Dim, 0);
  ++counts.merged;
  changed_nodes = true;
}

/// Whether all that is prescribed of the second is of the first.
template <int Dim> bool Motion<Dim>::holds_as(Index a, Index other) const {
  const auto held = [&](Index node) {
    std::set<std::pair<int, double>> by;
    for (const auto& [of, axis, velocity] : prescribed)
      if (of == node) by.insert({axis, velocity});
    return by;
  };
  const auto of_a = held(a), of_other = held(other);
  return std::includes(of_a.begin(), of_a.end(), of_other.begin(), of_other.end());
}

/// The first becomes one with the other, if all points that see it have functions without it, and that point of these
/// has wider ones: all are worn from now on. Nodes that these count on are locked.
template <int Dim>
bool Motion<Dim>::merge(Index a, Index with, Index of_chunk, Index of_point, std::set<Index>& locked, double wide) {
  if (locked.contains(a) || locked.contains(with) || !holds_as(with, a)) return false;
  merged[a] = with;
  LmeFunctions<Dim> functions(options.lme);
  std::vector<Index> used;
  OtmCounts tried;
  const auto has_functions = [&](Index c, Index p) {
    Mat<Dim> metric = chunks[c].metric[p];
    Vec<Dim> lambda = chunks[c].lambda[p];
    return find_functions(chunks[c], p, false, metric, lambda, functions, used, tried);
  };
  // Where it fails it does so at that point nearly always.
  bool good = has_functions(of_chunk, of_point) && smallest_width<Dim>(functions.moment()) >= wide;
  std::set<Index> counted_on;
  std::vector<std::pair<Index, Index>> seen_by;  // chunks and points
  for (Index k = node_offsets[a]; good && k < node_offsets[a + 1]; ++k) {
    const auto [c, l] = node_places[k];
    const OtmChunk<Dim>& chunk = chunks[c];
    for (Index p = 0; good && p < chunk.size(); ++p) {
      const auto begin = chunk.local.begin() + chunk.offsets[p], end = chunk.local.begin() + chunk.offsets[p + 1];
      if (std::find(begin, end, l) == end) continue;
      good = has_functions(c, p);
      seen_by.emplace_back(c, p);
      counted_on.insert(used.begin(), used.end());
    }
  }
  if (!good) {
    merged[a] = -1;
    return false;
  }
  locked.insert(counted_on.begin(), counted_on.end());
  become_one(a, with);
  for (const auto& [c, p] : seen_by) chunks[c].wear(p);
  return true;
}

/// A point with functions that narrow across n, as it is all but in a plane of nodes, and the nearest out of that plane
/// come nearer to each other, their centre of mass where it is.
template <int Dim> void Motion<Dim>::spread(OtmChunk<Dim>& chunk, Index p, const Vec<Dim>& n, double width) const {
  const auto is_free = [&](Index q) {
    return !chunk.is_crushed(q) && std::none_of(chunk.pairs.begin(), chunk.pairs.end(),
                                                [&](const auto& pair) { return pair.first == q || pair.second == q; });
  };
  if (!is_free(p)) return;
  Index with = -1;
  for (Index q = 0; q < chunk.size(); ++q) {
    const Vec<Dim> d = chunk.at.col(q) - chunk.at.col(p);
    if (!chunk.is_eroded(q) && std::abs(n.dot(d)) > 4.0 * width && is_free(q) &&
        (with < 0 || d.squaredNorm() < (chunk.at.col(with) - chunk.at.col(p)).squaredNorm()))
      with = q;
  }
  if (with < 0) return;
  const double share = chunk.mass[with] / (chunk.mass[p] + chunk.mass[with]);
  chunk.pairs.push_back({.first = p, .second = with, .way = 0.3 * share * (chunk.at.col(with) - chunk.at.col(p))});
  chunk.wear(p);
  chunk.wear(with);
}

/// Nodes that have left the points behind, as those at a rim that is thrown off, bear next to no mass, and fly
/// anywhere: each becomes one with the nearest of those that its points see, on the surface if it is on it.
template <int Dim> void Motion<Dim>::give_up_nodes() {
  Vector seen_most = Vector::Zero(x.cols());
  for (const auto& chunk : chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        double& most = seen_most[chunk.nodes[chunk.local[e]]];
        most = std::max(most, chunk.is_eroded(p) ? 1.0 : chunk.entries[e].N);
      }
  const auto is_left = [&](Index a) {
    return merged[a] < 0 && bodies[body_of_node[a]].renewed && seen_most[a] > 0.0 && seen_most[a] < least_seen;
  };
  std::vector<std::set<Index>> on_surface(bodies.size());
  for (Index a = 0; a < x.cols(); ++a) {
    if (!is_left(a)) continue;
    const Index b = body_of_node[a];
    std::set<Index>& surface = on_surface[b];
    if (surface.empty() && bodies[b].cells.cols() != 0)
      for (const auto& [one, other] : outer_edges(b))
        surface.insert({bodies[b].first_node + one, bodies[b].first_node + other});
    std::vector<std::pair<Index, Index>> seen_by;  // chunks and points
    Index with = -1;
    const auto away = [&](Index other) {
      const bool leaves = surface.contains(a) && !surface.contains(other);
      return std::pair(leaves, (x.col(other) - x.col(a)).squaredNorm());
    };
    for (Index k = node_offsets[a]; k < node_offsets[a + 1]; ++k) {
      const auto [c, l] = node_places[k];
      const OtmChunk<Dim>& chunk = chunks[c];
      for (Index p = 0; p < chunk.size(); ++p) {
        const auto begin = chunk.local.begin() + chunk.offsets[p], end = chunk.local.begin() + chunk.offsets[p + 1];
        if (std::find(begin, end, l) == end) continue;
        seen_by.emplace_back(c, p);
        for (auto place = begin; place != end; ++place)
          if (const Index other = chunk.nodes[*place]; other != a && merged[other] < 0 && !is_left(other) &&
                                                       body_of_node[other] == b && holds_as(other, a) &&
                                                       (with < 0 || away(other) < away(with)))
            with = other;
      }
    }
    if (with < 0) continue;
    become_one(a, with);
    for (const auto& [c, p] : seen_by) chunks[c].wear(p);
  }
}

template <int Dim> void Motion<Dim>::merge_nodes() {
  std::vector<char> is_built(bodies.size(), 0);
  std::vector<char> on_surface(x.cols(), 0);
  find_stars();
  const auto moment_of = [](const OtmChunk<Dim>& chunk, Index p) -> Mat<Dim> {
    const Mat<Dim> since = chunk.since[p].template topLeftCorner<Dim, Dim>();
    return since * chunk.moment[p] * since.transpose();
  };
  const auto is_narrow = [&](const OtmChunk<Dim>& chunk, Index p) {
    return !chunk.is_eroded(p) && !(smallest_width<Dim>(moment_of(chunk, p)) >= options.merging * chunk.width[p]);
  };
  std::vector<Index> first_narrow(chunks.size());
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    const OtmChunk<Dim>& chunk = chunks[c];
    Index& p = first_narrow[c];
    if (!bodies[chunk.body].renewed) p = chunk.size();
    while (p < chunk.size() && !is_narrow(chunk, p)) ++p;
  });
  std::set<Index> locked;
  for (std::size_t c = 0; c < chunks.size(); ++c) {
    OtmChunk<Dim>& chunk = chunks[c];
    bool is_placed = false;
    for (Index p = first_narrow[c]; p < chunk.size(); ++p) {
      if (!is_narrow(chunk, p)) continue;
      const Mat<Dim> moment = moment_of(chunk, p);
      const Mat<Dim> inverse = chunk.since[p].template topLeftCorner<Dim, Dim>().inverse();
      for (Index b = 0; b + 1 < static_cast<Index>(bodies.size()); ++b) {
        if (is_built[b] != 0 || (b != chunk.body && seized.empty())) continue;
        follow_nodes(b);
        for (const auto& [a, e] : outer_edges(b))
          on_surface[bodies[b].first_node + a] = on_surface[bodies[b].first_node + e] = 1;
        is_built[b] = 1;
      }
      if (!is_placed) {
        deform(chunk, x);
        for (Index q = 0; q < chunk.size(); ++q) place(chunk, q);
        is_placed = true;
      }
      Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
      axes.computeDirect(moment);
      const Vec<Dim> n = axes.eigenvectors().col(0);
      // What makes the functions narrow is what they change most by.
      std::vector<std::pair<double, Index>> by;
      for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
        const Index a = chunk.nodes[chunk.local[e]];
        Vec<Dim> dN;
        for (int i = 0; i < Dim; ++i) dN[i] = chunk.entries[e].dN[i];
        if (merged[a] < 0) by.emplace_back(-std::abs(n.dot(inverse.transpose() * dN)), a);
      }
      std::sort(by.begin(), by.end());
      if (by.size() > 4) by.resize(4);
      bool is_merged = false;
      for (const auto& [slope, a] : by) {
        Index nearest = -1;
        for (Index e = chunk.offsets[p]; e < chunk.offsets[p + 1]; ++e) {
          const Index b = chunk.nodes[chunk.local[e]];
          if (b != a && merged[b] < 0 && body_of_node[b] == body_of_node[a] &&
              (nearest < 0 || (x.col(b) - x.col(a)).squaredNorm() < (x.col(nearest) - x.col(a)).squaredNorm()))
            nearest = b;
        }
        if (nearest < 0 || (x.col(nearest) - x.col(a)).norm() > reach * 0.5 * (spacing[a] + spacing[nearest])) continue;
        // The surface stays where it is.
        const bool is_inner = !on_surface[a] || on_surface[nearest];
        if (merge(is_inner ? a : nearest, is_inner ? nearest : a, static_cast<Index>(c), p, locked,
                  1.3 * smallest_width<Dim>(moment))) {
          is_merged = true;
          break;
        }
      }
      if (!is_merged && smallest_width<Dim>(moment) < flat * chunk.width[p])
        spread(chunk, p, n, smallest_width<Dim>(moment));
    }
  }
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
