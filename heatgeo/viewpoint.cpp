// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/viewpoint.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

constexpr int sectors = 256;
constexpr double sector_slack = 1e-6;  // far more than the rounding of a direction, far less than a sector
constexpr double doubt_per_tolerance = 100.0;
constexpr double close_per_tolerance = 1e6;  // directions to points nearer than this may be off by the sector slack

/// Grows with the angle of v from 0 to `sectors`, without trigonometry.
double sector_coordinate(const Vec<2>& v) {
  const double p = v.x() / (std::abs(v.x()) + std::abs(v.y()));
  return 0.25 * sectors * (v.y() < 0.0 ? 3.0 + p : 1.0 - p);
}

double distance_to_segment(const Vec<2>& a, const Vec<2>& b) {
  const Vec<2> along = b - a;
  const double t = std::clamp(-a.dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (a + t * along).norm();
}

std::vector<Index> boundary_vertices(const FineMesh<2>& mesh) {
  std::vector<Index> vertices;
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (mesh.on_boundary(v)) vertices.push_back(v);
  return vertices;
}

}  // namespace

Viewpoint::Viewpoint(const SightLines& sight)
    : sight_(sight),
      boundary_(sight.mesh(), boundary_vertices(sight.mesh())),
      doubt_(doubt_per_tolerance * sight.tolerance()) {
  for (Index f = 0; f < sight.mesh().num_facets(); ++f)
    longest_facet_ = std::max(longest_facet_, sight.mesh().facet_measure(f));
}

void Viewpoint::look(Index origin, const VertexGrid<2>::Box& box, const BendingWedge* wedge) {
  const FineMesh<2>& mesh = sight_.mesh();
  origin_ = origin;
  position_ = mesh.vertex(origin);
  opening_ = opening(origin);
  obstructed_ = false;
  screens_.clear();
  const Vec<2> around = Vec<2>::Constant(longest_facet_);
  boundary_.for_each(
      {box.min() - around, box.max() + around},
      [&](const Vec<2>& centre, double margin) {
        return !wedge || wedge->contains(centre - position_, margin + longest_facet_);
      },
      [&](Index v, const Vec<2>& position) {
        for (const Corner& corner : sight_.corners(v)) add(v, position - position_, corner.next, wedge);
      });
  if (obstructed_) sort_into_sectors();
}

/// Facets are looked at from their outer side, where they run clockwise.
void Viewpoint::add(Index left_vertex, const Vec<2>& left, Index right_vertex, const BendingWedge* wedge) {
  if (left_vertex == origin_ || right_vertex == origin_) return;
  const Vec<2> right = sight_.mesh().vertex(right_vertex) - position_;
  if (wedge && wedge->misses(left, right)) return;
  const double height = cross(left, right), extent = left.lpNorm<1>() + (right - left).lpNorm<1>();
  if (height > doubt_ * extent) return;
  const bool outer = height < -doubt_ * extent;
  const bool twin = std::min(left.cwiseAbs().maxCoeff(), right.cwiseAbs().maxCoeff()) <= sight_.tolerance();
  obstructed_ = obstructed_ || outer || twin;
  // Whatever leaves the origin into the body leaves a facet behind that touches it there.
  if (!twin)
    screens_.push_back(
        {distance_to_segment(left, right) - doubt_, left, right, extent, left_vertex, right_vertex, outer});
}

void Viewpoint::sort_into_sectors() {
  order_.clear();
  for (const Screen& screen : screens_) order_.push_back({screen.distance, static_cast<Index>(order_.size())});
  std::sort(order_.begin(), order_.end());
  ranges_.clear();
  sectors_.offsets.assign(sectors + 1, 0);
  for (const Screen& screen : screens_) {
    int first = 0, last = sectors - 1;
    if (screen.distance > close_per_tolerance * sight_.tolerance()) {
      first = static_cast<int>(std::floor(sector_coordinate(screen.right) - sector_slack));
      last = static_cast<int>(std::floor(sector_coordinate(screen.left) + sector_slack));
      if (last < first) last += sectors;
    }
    ranges_.push_back({first, last});
    for (int k = first; k <= last; ++k) ++sectors_.offsets[(k + sectors) % sectors + 1];
  }
  std::partial_sum(sectors_.offsets.begin(), sectors_.offsets.end(), sectors_.offsets.begin());
  sectors_.items.resize(sectors_.offsets.back());
  cursor_.assign(sectors_.offsets.begin(), sectors_.offsets.end() - 1);
  for (const auto& [distance, i] : order_)
    for (int k = ranges_[i].first; k <= ranges_[i].second; ++k) sectors_.items[cursor_[(k + sectors) % sectors]++] = i;
}

bool Viewpoint::sees(Index v, const Vec<2>& line, double length) const {
  if (!obstructed_ || v == origin_) return true;
  const Verdict verdict = judge(v, line, length);
  return verdict == Verdict::doubtful ? sight_.visible(origin_, v) : verdict == Verdict::seen;
}

Viewpoint::Verdict Viewpoint::judge(Index v, const Vec<2>& line, double length) const {
  if (length <= doubt_) return Verdict::doubtful;
  Verdict verdict = leave(opening_, line, length);
  if (verdict == Verdict::hidden) return verdict;
  for (Index k : sectors_[static_cast<int>(sector_coordinate(line)) % sectors]) {
    const Screen& screen = screens_[k];
    if (screen.distance >= length) break;
    // At its own corner, where the line ends, it left into the body.
    if (screen.left_vertex == v || screen.right_vertex == v) continue;
    const double left = cross(line, screen.left), right = cross(line, screen.right), doubt = doubt_ * length;
    if (std::min(left, right) > doubt || std::max(left, right) < -doubt) continue;
    const double behind = cross(screen.right - screen.left, line - screen.left);
    const double doubt_behind = doubt_ * (screen.extent + length);
    if (screen.outer && behind < -doubt_behind) continue;
    if (screen.outer && behind > doubt_behind && left > doubt && right < -doubt) return Verdict::hidden;
    verdict = Verdict::doubtful;
  }
  return std::min(verdict, leave(opening(v), -line, length));
}

Viewpoint::Opening Viewpoint::opening(Index v) const {
  const auto corners = sight_.corners(v);
  if (corners.empty()) return {Opening::everywhere, {}, {}};
  if (corners.size() > 1) return {Opening::several, {}, {}};
  const FineMesh<2>& mesh = sight_.mesh();
  const Corner& corner = corners.front();
  const Vec<2> x = mesh.vertex(v);
  return {corner.reflex ? Opening::reflex : Opening::convex, mesh.vertex(corner.next) - x,
          mesh.vertex(corner.previous) - x};
}

/// Whether a line leaves a vertex into the body.
Viewpoint::Verdict Viewpoint::leave(const Opening& opening, const Vec<2>& line, double length) const {
  if (opening.kind == Opening::everywhere) return Verdict::seen;
  if (opening.kind == Opening::several) return Verdict::doubtful;
  const double from_next = cross(opening.to_next, line), from_previous = cross(line, opening.to_previous);
  const double inwards =
      opening.kind == Opening::reflex ? std::max(from_next, from_previous) : std::min(from_next, from_previous);
  const double doubt = doubt_ * (length + 2.0 * longest_facet_);
  return inwards > doubt ? Verdict::seen : inwards < -doubt ? Verdict::hidden : Verdict::doubtful;
}

}  // namespace efree
