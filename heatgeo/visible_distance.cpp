// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/visible_distance.hpp"

#include "efree/core/internal/infinity.hpp"

#include <algorithm>

namespace efree {
namespace {

using internal::infinity;

VertexGrid<2>::Box box_around(const Vec<2>& x, double radius) {
  return {x.array() - radius, x.array() + radius};
}

/// Box around the points nearer than `reach` whose directions from x lie in the wedge.
VertexGrid<2>::Box box_around(const Vec<2>& x, const BendingWedge& wedge, double reach) {
  const double cosine_of_half = 0.5 * (wedge.first + wedge.last).norm();
  if (cosine_of_half < 0.5) return box_around(x, reach);
  // A triangle around the sector.
  VertexGrid<2>::Box box(x);
  box.extend(x + reach / cosine_of_half * wedge.first);
  box.extend(x + reach / cosine_of_half * wedge.last);
  return {box.min().array() - wedge.slack, box.max().array() + wedge.slack};
}

}  // namespace

VisibleDistance::VisibleDistance(const SightLines& sight)
    : sight_(sight),
      grid_(sight.mesh()),
      viewpoint_(sight),
      distance_(sight.mesh().num_vertices(), infinity),
      fans_(sight.num_corners()) {}

void VisibleDistance::measure(Index source, double radius) {
  for (Index v : reached_) distance_[v] = infinity;
  reached_.clear();
  bends_.clear();
  radius_ = radius;
  const Vec<2> x = sight_.mesh().vertex(source);
  const VertexGrid<2>::Box box = box_around(x, radius);
  viewpoint_.look(source, box);
  grid_.for_each(box, [&](Index v, const Vec<2>& position) {
    const Vec<2> line = position - x;
    const double length = line.norm();
    if (length < radius && viewpoint_.sees(v, line, length)) offer(v, length, x);
  });
  if (!viewpoint_.obstructed()) return;
  while (!bends_.empty()) {
    std::pop_heap(bends_.begin(), bends_.end());
    const Bend nearest = bends_.back();
    bends_.pop_back();
    if (nearest.distance <= distance_[nearest.vertex]) bend(nearest);
  }
}

void VisibleDistance::offer(Index v, double distance, const Vec<2>& came_from) {
  if (distance_[v] == infinity) reached_.push_back(v);
  distance_[v] = distance;
  if (!sight_.is_reflex(v)) return;
  bends_.push_back({distance, v, came_from});
  std::push_heap(bends_.begin(), bends_.end());
}

void VisibleDistance::bend(const Bend& at) {
  const FineMesh<2>& mesh = sight_.mesh();
  const Vec<2> x = mesh.vertex(at.vertex);
  Index number = sight_.first_corner(at.vertex);
  for (const Corner& corner : sight_.corners(at.vertex)) {
    const auto wedge = sight_.bend(at.vertex, corner, at.came_from, radius_ - at.distance);
    if (wedge)
      for (const auto& [length, v] : fan(at.vertex, number, corner)) {
        const double distance = at.distance + length;
        if (distance >= radius_) break;
        if (distance < distance_[v] && wedge->contains(mesh.vertex(v) - x)) offer(v, distance, x);
      }
    ++number;
  }
}

const VisibleDistance::Seen& VisibleDistance::fan(Index vertex, Index number, const Corner& corner) {
  Fan& fan = fans_[number];
  if (fan.reach >= radius_) return fan.seen;
  const Vec<2> x = sight_.mesh().vertex(vertex);
  seen_.clear();
  for (const BendingWedge& wedge : sight_.bends(vertex, corner, radius_)) {
    const VertexGrid<2>::Box box = box_around(x, wedge, radius_);
    viewpoint_.look(vertex, box, &wedge);
    grid_.for_each(
        box, [&](const Vec<2>& centre, double margin) { return wedge.contains(centre - x, margin); },
        [&](Index v, const Vec<2>& position) {
          const Vec<2> line = position - x;
          if (v == vertex || !wedge.contains(line)) return;
          const double length = line.norm();
          if (length < radius_ && viewpoint_.sees(v, line, length)) seen_.push_back({length, v});
        });
  }
  std::sort(seen_.begin(), seen_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  fan = {radius_, seen_};
  return fan.seen;
}

}  // namespace efree
