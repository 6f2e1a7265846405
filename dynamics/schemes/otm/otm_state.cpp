// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree::internal {
namespace {

/// How far nodes move before trees of them are built again, over their least spacing.
constexpr double tree_skin = 0.1;

}  // namespace

template <int Dim> std::size_t OtmPoints<Dim>::place(Index p) const {
  return static_cast<std::size_t>(std::lower_bound(due.begin(), due.end(), p) - due.begin());
}

template <int Dim> bool OtmPoints<Dim>::is_due(Index p) const {
  const std::size_t at = place(p);
  return at < due.size() && due[at] == p;
}

template <int Dim> void OtmPoints<Dim>::mark(Index p) {
  if (!is_due(p)) due.insert(due.begin() + static_cast<std::ptrdiff_t>(place(p)), p);
}

template <int Dim> void OtmPoints<Dim>::take(const std::vector<Index>& from, const std::vector<Index>& first) {
  std::vector<Vec<Dim>> of_lambda;
  for (const Index p : from) of_lambda.push_back(lambda[p]);
  lambda = std::move(of_lambda);
  count = count(from).eval();
  width = width(from).eval();
  for (std::vector<Index>* points : {&due, &stiffened}) {
    std::vector<Index> result;
    for (const Index p : *points)
      for (Index q = first[p]; q < first[p + 1]; ++q) result.push_back(q);
    *points = std::move(result);
  }
}

template <int Dim> void NodeSearch<Dim>::build(const World<Dim>& world, Index body) {
  trees_.resize(world.num_bodies());
  moved_.resize(world.num_bodies());
  const Index first = world.first_node[body];
  trees_[body].build(world.nodes.x.middleCols(first, world.first_node[body + 1] - first));
  moved_[body] = 0.0;
}

template <int Dim> void NodeSearch<Dim>::follow(const World<Dim>& world, Index body) {
  const Index first = world.first_node[body], count = world.first_node[body + 1] - first;
  const Points<Dim>& then = trees_[body].points();
  if (then.cols() == count) {
    moved_[body] = std::sqrt((world.nodes.x.middleCols(first, count) - then).colwise().squaredNorm().maxCoeff());
    if (moved_[body] <= tree_skin * world.nodes.spacing.segment(first, count).minCoeff()) return;
  }
  build(world, body);
}

template <int Dim> void CrackVisibility<Dim>::update(const World<Dim>& world) {
  cells_.clear();
  offsets_.clear();
  if (world.num_eroded == 0) return;
  for (Index b = 0; b < world.num_bodies(); ++b) {
    const Cells<Dim>& cells = world.bodies[b].cells;
    std::vector<Index>& offsets = offsets_.emplace_back(world.first_node[b + 1] - world.first_node[b] + 1, 0);
    const auto is_whole = [&](Eigen::Index c) {
      const auto [in, p] = world.place_of_point[world.first_point[b] + c];
      return !world.chunks[in].is_eroded(p);
    };
    for (Eigen::Index c = 0; c < cells.cols(); ++c)
      for (const Index a : cells.col(c)) offsets[a + 1] += is_whole(c) ? 1 : 0;
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
    std::vector<Index>& around = cells_.emplace_back(offsets.back());
    std::vector<Index> next(offsets.begin(), offsets.end() - 1);
    for (Eigen::Index c = 0; c < cells.cols(); ++c)
      for (const Index a : cells.col(c))
        if (is_whole(c)) around[next[a]++] = static_cast<Index>(c);
  }
}

template <int Dim> void CrackVisibility<Dim>::keep_connected(const World<Dim>& world, Index of_body, Index point,
                                                             std::vector<Index>& nodes) const {
  const Cells<Dim>& cells = world.bodies[of_body].cells;
  const Index first_node = world.first_node[of_body];
  const std::vector<Index>&offsets = offsets_[of_body], &around = cells_[of_body];
  thread_local std::vector<char> reached;
  thread_local std::vector<Index> front;
  reached.assign(nodes.size(), 0);
  front.clear();
  for (const Index a : cells.col(point)) front.push_back(a);
  while (!front.empty()) {
    const Index from = front.back();
    front.pop_back();
    for (Index e = offsets[from]; e < offsets[from + 1]; ++e)
      for (const Index a : cells.col(around[e])) {
        const auto place = std::lower_bound(nodes.begin(), nodes.end(), first_node + a);
        if (place == nodes.end() || *place != first_node + a || reached[place - nodes.begin()] != 0) continue;
        reached[place - nodes.begin()] = 1;
        front.push_back(a);
      }
  }
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes.size(); ++k)
    if (reached[k] != 0 || world.nodes.body[nodes[k]] != of_body) nodes[kept++] = nodes[k];
  nodes.resize(kept);
}

template <int Dim> void OtmState<Dim>::mark_points_of(const World<Dim>& world, Index node) {
  for (Index k = world.node_chunks.offsets[node]; k < world.node_chunks.offsets[node + 1]; ++k) {
    const auto [c, l] = world.node_chunks.places[k];
    const Chunk<Dim>& chunk = world.chunks[c];
    for (Index p = 0; p < chunk.size(); ++p)
      if (!chunk.is_eroded(p) && chunk.table.has(p, l)) points[c].mark(p);
  }
}

template struct OtmPoints<2>;
template struct OtmPoints<3>;
template class NodeSearch<2>;
template class NodeSearch<3>;
template class CrackVisibility<2>;
template class CrackVisibility<3>;
template void OtmState<2>::mark_points_of(const World<2>&, Index);
template void OtmState<3>::mark_points_of(const World<3>&, Index);

}  // namespace efree::internal
