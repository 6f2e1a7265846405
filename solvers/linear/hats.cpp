// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/hats.hpp"

#include "efree/core/internal/infinity.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <numeric>
#include <queue>

namespace efree {
namespace {

using internal::infinity;

/// Least distance between nodes, in edges, and how far a hat reaches, in units of it: docs/evidence.md, "Iterations".
constexpr double edges_apart = 2.5, hat_reach = 2.0;
/// Nodes, squared, that are worth their factor, over those of the elements, which measure an iteration. In space
/// factors grow with the square; in the plane they are always cheap.
constexpr double most_hats = 50.0;

/// Paths along the entries of K, longest edges at their ends as unit: what is short in a cell is no step.
template <int Dim> class Paths {
 public:
  Paths(const BlockMatrix<Dim>& K, const Points<Dim>& places) : K_(K), places_(places), longest_(K.size(), 0.0) {
    for (Index v = 0; v < K.size(); ++v)
      K.for_row(v, [&](Index w, const auto&) {
        longest_[v] = std::max(longest_[v], (places.col(v) - places.col(w)).norm());
      });
  }
  /// Lowers `distance` to the one from a node, where that is less and within reach (Dijkstra 1959). Returns the nodes
  /// where it did, nearest first.
  std::vector<Index> spread(Index from, double reach, std::vector<double>& distance) const {
    using Reached = std::pair<double, Index>;
    std::priority_queue<Reached, std::vector<Reached>, std::greater<>> front;
    std::vector<Index> settled;
    distance[from] = 0.0;
    front.emplace(0.0, from);
    while (!front.empty()) {
      const auto [at, v] = front.top();
      front.pop();
      if (at > distance[v]) continue;
      settled.push_back(v);
      const double reached = at;
      K_.for_row(v, [&, v = v](Index w, const auto&) {
        const double length = (places_.col(v) - places_.col(w)).norm();
        const double next = length > 0.0 ? reached + 2.0 * length / (longest_[v] + longest_[w]) : reached;
        if (next <= reach && next < distance[w]) front.emplace(distance[w] = next, w);
      });
    }
    return settled;
  }

 private:
  const BlockMatrix<Dim>& K_;
  const Points<Dim>& places_;
  std::vector<double> longest_;
};

}  // namespace

template <int Dim> Hats<Dim> make_hats(const BlockMatrix<Dim>& K, const Points<Dim>& places) {
  const Paths<Dim> paths(K, places);
  std::vector<double> nearest;
  std::vector<Index> chosen;
  double least = edges_apart;
  const auto is_eliminated = [&](Index v) { return K.diagonal(v).isZero(0.0); };
  for (;; least *= 1.2) {
    const std::size_t before = chosen.size();
    nearest.assign(K.size(), infinity);
    chosen.clear();
    for (Index v = 0; v < K.size(); ++v)
      if (nearest[v] > least && !is_eliminated(v)) {
        chosen.push_back(v);
        paths.spread(v, infinity, nearest);
      }
    const auto n = static_cast<double>(chosen.size());
    // Bodies of their own need one each, however many they are.
    if (Dim == 2 || n * n <= most_hats * K.size() || chosen.size() == before) break;
  }
  std::erase(nearest, infinity);
  const double apart = 2.0 * std::accumulate(nearest.begin(), nearest.end(), 0.0) / static_cast<double>(nearest.size());

  const double reach = hat_reach * least;
  const auto count = static_cast<Index>(chosen.size());
  std::vector<std::vector<std::pair<Index, double>>> weights(count);
  parallel_chunks(count, 64, [&](Index begin, Index end) {
    std::vector<double> distance(K.size(), infinity);
    for (Index I = begin; I < end; ++I)
      for (const Index v : paths.spread(chosen[I], reach, distance)) {
        const double inside = 1.0 - distance[v] / reach;
        weights[I].emplace_back(v, inside * inside);
        distance[v] = infinity;
      }
  });
  std::vector<double> total(K.size(), 0.0);
  std::vector<Offset> offsets(K.size() + 1, 0);
  for (const auto& hat : weights)
    for (const auto& [v, weight] : hat) total[v] += weight, ++offsets[v + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  std::vector<Offset> cursor(offsets.begin(), offsets.end() - 1);
  std::vector<Index> columns(offsets.back());
  std::vector<double> N(offsets.back());
  for (Index I = 0; I < count; ++I)
    for (const auto& [v, weight] : weights[I]) {
      const Index at = cursor[v]++;
      columns[at] = I;
      N[at] = weight / total[v];
    }
  return {{count, std::move(offsets), std::move(columns), std::move(N)}, places(Eigen::all, chosen), apart};
}

template Hats<2> make_hats<2>(const BlockMatrix<2>&, const Points<2>&);
template Hats<3> make_hats<3>(const BlockMatrix<3>&, const Points<3>&);

}  // namespace efree
