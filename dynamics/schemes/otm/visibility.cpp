// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions do not reach across cracks, slits and folds.
#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/dynamics/schemes/otm/internal/otm_state.hpp"

#include <numeric>

namespace efree::internal {
namespace {

/// Cosine of the angle between the surface's normal at a node and the direction to a point from which on the point may
/// be on the other side of a gap: in the body itself it is behind the surface, or little in front of a concave one.
constexpr double across_gap = 0.2;

}  // namespace

template <int Dim> void Visibility<Dim>::update(const World<Dim>& world) {
  const std::array now{world.num_eroded, world.surface_changes, world.point_changes};
  if (std::exchange(changes_, now) != now) find_cells(world);
  normals_.setZero(Dim, world.nodes.size());
  for (const Facets<Dim>& facets : surfaces_)
    for (Index f = 0; f < facets.cols(); ++f) {
      const Vec<Dim> area = area_of<Dim>(facet_corners(world.nodes.x, facets, f));
      for (const Index a : facets.col(f)) normals_.col(a) += area;
    }
  parallel_for(world.nodes.size(), [&](Index a) { normals_.col(a).normalize(); });  // leaves zero as it is
}

template <int Dim> void Visibility<Dim>::find_cells(const World<Dim>& world) {
  has_cracks_ = world.num_eroded > 0;
  cells_.assign(world.num_bodies(), {});
  surfaces_.assign(world.num_bodies(), Facets<Dim>(Dim, 0));
  for (Index b = 0; b < world.num_bodies(); ++b) {
    if (!has_cracks_ && !world.has_self_contact(b)) continue;
    if (world.has_self_contact(b)) surfaces_[b] = outer_facets(world, b);
    const Cells<Dim>& cells = world.bodies[b].cells;
    const auto for_each_corner = [&](const auto& visit) {
      for (Index c = 0; c < cells.cols(); ++c)
        if (const auto& [chunk, p] = world.locate(world.first_point[b] + c); !chunk.is_eroded(p))
          for (const Index a : cells.col(c)) visit(a, c);
    };
    auto& [offsets, around] = cells_[b];
    offsets.assign(world.first_node[b + 1] - world.first_node[b] + 1, 0);
    for_each_corner([&](Index a, Index) { ++offsets[a]; });
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());  // ends of the rows, which are filled backwards
    around.resize(offsets.back());
    for_each_corner([&](Index a, Index c) { around[--offsets[a]] = c; });
  }
}

template <int Dim> bool Visibility<Dim>::may_hide(const World<Dim>& world, Index body, const Vec<Dim>& at,
                                                  const std::vector<Index>& nodes) const {
  if (world.bodies[body].cells.cols() == 0) return false;
  return has_cracks_ || (surfaces_[body].cols() > 0 && std::ranges::any_of(nodes, [&](Index a) {
                           const Vec<Dim> to = at - world.nodes.x.col(a);
                           return normals_.col(a).dot(to) > across_gap * to.norm();
                         }));
}

template <int Dim> void Visibility<Dim>::keep_connected(const World<Dim>& world, Index body, Index point,
                                                        std::vector<Index>& nodes) const {
  const Cells<Dim>& cells = world.bodies[body].cells;
  const Index first_node = world.first_node[body];
  thread_local std::vector<char> reached;
  thread_local std::vector<Index> front;
  reached.assign(nodes.size(), 0);
  front.assign(cells.col(point).begin(), cells.col(point).end());
  while (!front.empty()) {
    const Index from = front.back();
    front.pop_back();
    for (const Index c : cells_[body][from])
      for (const Index a : cells.col(c)) {
        const Index node = world.nodes.master_of(first_node + a);
        const auto place = std::ranges::lower_bound(nodes, node);
        if (place == nodes.end() || *place != node || reached[place - nodes.begin()] != 0) continue;
        reached[place - nodes.begin()] = 1;
        front.push_back(a);
      }
  }
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes.size(); ++k)
    if (reached[k] != 0 || world.nodes.body[nodes[k]] != body) nodes[kept++] = nodes[k];
  nodes.resize(kept);
}

template class Visibility<2>;
template class Visibility<3>;

}  // namespace efree::internal
