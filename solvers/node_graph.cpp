// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/internal/node_graph.hpp"

#include <algorithm>
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
