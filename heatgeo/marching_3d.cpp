// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/marching_3d.hpp"

#include "efree/heatgeo/patch.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

SpatialSight::SpatialSight(const FineMesh<3>& mesh) : mesh_(mesh), tolerance_(length_tolerance(mesh)) {
  std::vector<Index> around;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    around.clear();
    for (Index c : mesh.cells_of(v))
      for (Index w : mesh.cells().col(c))
        if (w != v) around.push_back(w);
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    neighbours_.items.insert(neighbours_.items.end(), around.begin(), around.end());
    neighbours_.close_row();
  }
}

double SpatialSight::side(Index c, int i, const Vec<3>& x) const {
  const auto& cell = mesh_.cells();
  const Vec<3> a = mesh_.vertex(cell((i + 1) % 4, c)), b = mesh_.vertex(cell((i + 2) % 4, c)) - a,
               d = mesh_.vertex(cell((i + 3) % 4, c)) - a;
  const double height = b.cross(d).dot(x - a);
  return i % 2 == 0 ? -height : height;
}

/// Whether x lies on the far side of that facet, by more than rounding.
bool SpatialSight::beyond(Index c, int i, const Vec<3>& x) const {
  const auto& cell = mesh_.cells();
  const Vec<3> a = mesh_.vertex(cell((i + 1) % 4, c)), b = mesh_.vertex(cell((i + 2) % 4, c)) - a,
               d = mesh_.vertex(cell((i + 3) % 4, c)) - a, normal = b.cross(d), arm = x - a;
  const double height = i % 2 == 0 ? -normal.dot(arm) : normal.dot(arm);
  if (height >= 0.0) return false;
  const double longest = std::max(b.norm(), d.norm());
  return -height > 4.0 * tolerance_ * longest * (longest + arm.norm());
}

SpatialSight::Start SpatialSight::start(Index v, const Vec<3>& x) const {
  for (Index c : mesh_.cells_of(v)) {
    const auto cell = mesh_.cells().col(c);
    const int corner = cell[0] == v ? 0 : cell[1] == v ? 1 : cell[2] == v ? 2 : 3;
    bool inside = true;
    for (int i = 0; i < 4 && inside; ++i) inside = i == corner || !beyond(c, i, x);
    if (!inside) continue;
    // On the plane of a facet, in front of it or behind: the facet opposite v must be ahead, or x in the cell.
    const Vec<3> ahead = mesh_.vertex(v) + 0.5 * mesh_.size() / (x - mesh_.vertex(v)).norm() * (x - mesh_.vertex(v));
    if (side(c, corner, mesh_.vertex(v)) > side(c, corner, ahead)) return {c, corner};
  }
  return {};
}

bool SpatialSight::reaches(Start from, Index target) const {
  const Vec<3> x = mesh_.vertex(target);
  const Vec<3> start = mesh_.vertex(mesh_.cells()(from.corner, from.cell));
  Index cell = from.cell;
  Index behind = -1;
  // Much longer than any line through cells of one size; lines that circle an edge by rounding end here, unseen.
  for (int step = 0; step < 10000; ++step) {
    const auto corners = mesh_.cells().col(cell);
    if ((corners.array() == target).any()) return true;
    // Leave by the first facet that has the target on its far side.
    int exit = -1;
    double first = infinity;
    for (int i = 0; i < 4; ++i) {
      if (mesh_.neighbour(i, cell) == behind && behind >= 0) continue;
      if (!beyond(cell, i, x)) continue;
      const double here = side(cell, i, start), there = side(cell, i, x);
      const double at = here / (here - there);  // along the line, 0 at its start; there < 0
      if (at < first || exit < 0) first = at, exit = i;
    }
    if (exit < 0) return false;  // a twin of the target across a slit
    const Index next = mesh_.neighbour(exit, cell);
    if (next < 0) return false;
    behind = cell;
    cell = next;
  }
  return false;
}

SpatialMarching::SpatialMarching(const SpatialSight& sight)
    : sight_(sight), distance_(sight.mesh().num_vertices(), infinity), origin_(sight.mesh().num_vertices(), -1) {}

void SpatialMarching::march(std::span<const Index> sources, double radius) {
  const FineMesh<3>& mesh = sight_.mesh();
  for (Index v : reached_) distance_[v] = infinity;
  reached_.clear();
  radius_ = radius;
  for (Index s : sources) offer(s, 0.0, s);
  while (!front_.empty()) {
    std::pop_heap(front_.begin(), front_.end());
    const auto [distance, a] = front_.back();
    front_.pop_back();
    if (distance > distance_[a]) continue;
    const Index origin = origin_[a];
    const double before = distance_[origin];
    const bool may_bend = origin == a || mesh.on_boundary(a);
    for (Index v : sight_.neighbours(a)) {
      const double straight = before + (mesh.vertex(v) - mesh.vertex(origin)).norm();
      if (straight >= distance_[v] - sight_.tolerance() || straight >= radius_) continue;  // bends are longer still
      if (origin == a || sees(v, origin)) {
        offer(v, straight, origin);
      } else if (may_bend || distance_[v] == infinity) {
        // Paths bend at the boundary; inside only where nothing better has come yet.
        offer(v, distance + (mesh.vertex(v) - mesh.vertex(a)).norm(), a);
      }
    }
  }
}

/// Whether nothing lies between v and the origin. Where the facet through which the line leaves v's cells is in sight of
/// the origin the line is taken to be free: only a spike thinner than that facet could be in the way.
bool SpatialMarching::sees(Index v, Index origin) const {
  const FineMesh<3>& mesh = sight_.mesh();
  const auto start = sight_.start(v, mesh.vertex(origin));
  if (start.cell < 0) return false;
  bool facet_in_sight = true;
  for (int i = 0; i < 4 && facet_in_sight; ++i) {
    const Index w = mesh.cells()(i, start.cell);
    facet_in_sight = i == start.corner || w == origin || (distance_[w] < infinity && origin_[w] == origin);
  }
  return facet_in_sight || sight_.reaches(start, origin);
}

void SpatialMarching::offer(Index v, double distance, Index origin) {
  // Differences of rounding size would only send the same front around again.
  if (distance >= radius_ || distance >= distance_[v] - sight_.tolerance()) return;
  if (distance_[v] == infinity) reached_.push_back(v);
  distance_[v] = distance;
  origin_[v] = origin;
  front_.push_back({distance, v});
  std::push_heap(front_.begin(), front_.end());
}

}  // namespace efree
