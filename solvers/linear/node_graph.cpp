// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/node_graph.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <ranges>
#include <utility>

namespace efree {

NodeGraph node_graph(const SymmetricMatrix& lower, const std::vector<Index>& node_of) {
  NodeGraph graph;
  const Index unknowns = static_cast<Index>(lower.cols());
  std::vector<Index> node(unknowns);
  for (Index unknown = 0; unknown < unknowns; ++unknown) {
    if (unknown > 0 && (node_of.empty() || node_of[unknown] != node_of[unknown - 1])) graph.first.push_back(unknown);
    node[unknown] = graph.size();
  }
  if (unknowns > 0) graph.first.push_back(unknowns);
  std::vector<Index> last_seen_by(graph.size(), -1);
  for (Index a = 0; a < graph.size(); ++a) {
    for (Index column = graph.first[a]; column < graph.first[a + 1]; ++column)
      for (SymmetricMatrix::InnerIterator entry(lower, column); entry; ++entry)
        if (const Index b = node[entry.row()]; std::exchange(last_seen_by[b], a) != a) graph.rows.push_back(b);
    graph.offsets.push_back(static_cast<Index>(graph.rows.size()));
  }
  return graph;
}

bool has_whole_blocks(const SymmetricMatrix& lower, const NodeGraph& graph) {
  for (Index a = 0; a < graph.size(); ++a)
    for (Index column = graph.first[a]; column < graph.first[a + 1]; ++column) {
      Index at = lower.outerIndexPtr()[column];
      const Index end = lower.outerIndexPtr()[column + 1];
      for (Index k = graph.offsets[a]; k < graph.offsets[a + 1]; ++k) {
        const Index b = graph.rows[k];
        for (Index row = b == a ? column : graph.first[b]; row < graph.first[b + 1]; ++row, ++at)
          if (at == end || lower.innerIndexPtr()[at] != row) return false;
      }
      if (at != end) return false;
    }
  return true;
}

namespace {

/// By node, all that it meets but itself.
Ragged<Index> neighbours(const NodeGraph& graph) {
  const Index n = graph.size();
  const auto for_pairs = [&](const auto& visit) {
    for (Index a = 0; a < n; ++a)
      for (Index k = graph.offsets[a]; k < graph.offsets[a + 1]; ++k)
        if (graph.rows[k] != a) visit(a, graph.rows[k]);
  };
  Ragged<Index> all;
  all.offsets.assign(n + 1, 0);
  for_pairs([&](Index a, Index b) { ++all.offsets[a + 1], ++all.offsets[b + 1]; });
  for (Index a = 0; a < n; ++a) all.offsets[a + 1] += all.offsets[a];
  all.items.resize(all.offsets.back());
  std::vector<Index> cursor(all.offsets.begin(), all.offsets.end() - 1);
  for_pairs([&](Index a, Index b) { all.items[cursor[a]++] = b, all.items[cursor[b]++] = a; });
  return all;
}

}  // namespace

Followers followers(const NodeGraph& graph) {
  const Index n = graph.size();
  const Ragged<Index> neighbours = efree::neighbours(graph);
  std::vector<std::array<Index, 2>> pairs;  // a node, and one that it follows
  std::vector<Index> seen_by(n, -1), number(n, 0);
  for (Index a = 0; a < n; ++a) {
    for (const Index b : neighbours[a]) seen_by[b] = a;
    seen_by[a] = a;
    for (const Index b : neighbours[a])
      if (neighbours[b].size() < neighbours[a].size() &&
          std::ranges::all_of(neighbours[b], [&](Index c) { return seen_by[c] == a; }))
        pairs.push_back({b, a}), number[b] = -1;
  }
  Followers result;
  for (Index a = 0; a < n; ++a)
    if (number[a] == 0) number[a] = result.size(), result.leaders.push_back(a);
  std::erase_if(pairs, [&](const auto& pair) { return number[pair[1]] < 0; });
  auto& [offsets, items] = result.followed;
  offsets.assign(n + 1, 0);
  for (const auto& [follower, leader] : pairs) ++offsets[follower + 1];
  std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
  items.resize(pairs.size());
  std::vector<Index> cursor(offsets.begin(), offsets.end() - 1);
  for (const auto& [follower, leader] : pairs) items[cursor[follower]++] = number[leader];
  for (const Index a : result.leaders) {
    for (Index k = graph.offsets[a]; k < graph.offsets[a + 1]; ++k)
      if (number[graph.rows[k]] >= 0) result.rows.push_back(number[graph.rows[k]]);
    result.offsets.push_back(static_cast<Index>(result.rows.size()));
  }
  return result;
}

bool Followers::are_mostly_between_two() const {
  Index count = 0;
  for (Index a = 0; a < followed.rows(); ++a) count += followed[a].size() == 2 ? 1 : 0;
  return 2 * count > followed.rows();
}

std::vector<Index> Followers::order(const std::vector<Index>& of_leaders) const {
  std::vector<Index> rank(of_leaders.size());
  for (Index k = 0; k < size(); ++k) rank[of_leaders[k]] = k;
  // By the first of those it follows, then the last.
  std::vector<std::array<Index, 3>> places;
  for (Index a = 0; a < followed.rows(); ++a) {
    if (followed[a].empty()) continue;
    const auto [first, last] =
        std::ranges::minmax(followed[a] | std::views::transform([&](Index leader) { return rank[leader]; }));
    places.push_back({first, last, a});
  }
  for (Index k = 0; k < size(); ++k) places.push_back({k, size(), leaders[of_leaders[k]]});
  std::ranges::sort(places);
  std::vector<Index> ordered;
  for (const auto& place : places) ordered.push_back(place[2]);
  return ordered;
}

std::vector<std::vector<Index>> clusters(const NodeGraph& graph, Index size) {
  const Index n = graph.size();
  const Ragged<Index> neighbours = efree::neighbours(graph);
  std::vector<char> taken(n, 0);
  std::vector<Index> left(n), inside(n, 0);  // neighbours that no cluster has, and those that this one has
  for (Index a = 0; a < n; ++a) left[a] = static_cast<Index>(neighbours[a].size());
  const auto share = [&](Index a) {
    return static_cast<double>(inside[a]) / static_cast<double>(neighbours[a].size());
  };
  std::vector<std::vector<Index>> result;
  for (Index rest = n, parts = (n + size - 1) / size; rest > 0; --parts) {
    const Index wanted = parts > 0 ? (rest + parts - 1) / parts : size;
    Index next = -1;
    for (Index a = 0; a < n; ++a)
      if (!taken[a] && (next < 0 || left[a] < left[next])) next = a;
    std::vector<Index> cluster, around;  // `around`: its neighbours in no cluster
    while (next >= 0) {
      taken[next] = 1;
      cluster.push_back(next);
      for (const Index b : neighbours[next]) {
        --left[b];
        if (!taken[b] && inside[b]++ == 0) around.push_back(b);
      }
      std::erase(around, next);
      if (static_cast<Index>(cluster.size()) == wanted) break;
      next = around.empty() ? -1 : *std::ranges::max_element(around, {}, share);
    }
    for (const Index b : around) inside[b] = 0;
    rest -= static_cast<Index>(cluster.size());
    result.push_back(std::move(cluster));
  }
  return result;
}

}  // namespace efree
