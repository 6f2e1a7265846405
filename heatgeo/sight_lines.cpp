// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/sight_lines.hpp"

#include "efree/heatgeo/internal/patch.hpp"

#include <algorithm>

namespace efree {
namespace {

Index local_index(const FineMesh<2>& mesh, Index c, Index v) {
  return mesh.cells()(0, c) == v ? 0 : mesh.cells()(1, c) == v ? 1 : 2;
}

/// Far end of the boundary facet that ends at v and belongs to the same fan of cells as facet f, which starts at v.
Index previous_on_boundary(const FineMesh<2>& mesh, Index v, Index f) {
  Index c = mesh.facet_cell(f);
  while (true) {
    const Index i = local_index(mesh, c, v);
    // Counterclockwise around v: through the edge from v to the cell's last vertex, opposite its next one.
    const Index next = mesh.neighbour((i + 1) % 3, c);
    if (next < 0) return mesh.cells()((i + 2) % 3, c);
    c = next;
  }
}

/// Body angle above 180 degrees. At the tip of a slit both sides point the same way.
bool is_reflex_corner(const Vec<2>& to_next, const Vec<2>& to_previous, double tolerance) {
  const double sine = cross(to_next, to_previous), length = std::max(to_next.norm(), to_previous.norm());
  return sine < (to_next.dot(to_previous) > 0.0 ? tolerance : -tolerance) * length;
}

}  // namespace

SightLines::SightLines(const FineMesh<2>& mesh) : mesh_(mesh), tolerance_(length_tolerance(mesh)) {
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    for (Index f : mesh.facets_of(v)) {
      if (mesh.facets()(0, f) != v) continue;
      const Index next = mesh.facets()(1, f), previous = previous_on_boundary(mesh, v, f);
      const Vec<2> x = mesh.vertex(v);
      corners_.items.push_back(
          {previous, next, is_reflex_corner(mesh.vertex(next) - x, mesh.vertex(previous) - x, tolerance_)});
    }
    corners_.close_row();
    const auto here = corners(v);
    reflex_.push_back(std::any_of(here.begin(), here.end(), [](const Corner& corner) { return corner.reflex; }));
  }
}

std::optional<BendingWedge> SightLines::bend(Index v, const Corner& corner, const Vec<2>& from, double reach) const {
  if (!corner.reflex) return std::nullopt;
  const Vec<2> x = mesh_.vertex(v), onward = (x - from).normalized();
  if (corners(v).size() > 1 && !opens(v, corner, -onward)) return std::nullopt;
  const Vec<2> to_next = mesh_.vertex(corner.next) - x, to_previous = mesh_.vertex(corner.previous) - x;
  // A short facet magnifies the rounding of its vertices over the reach.
  const auto wedge = [&](const Vec<2>& first, const Vec<2>& last, double facet) {
    return BendingWedge{first, last, tolerance_ * (1.0 + reach / facet)};
  };
  const double next_side = cross(onward, to_next), previous_side = cross(onward, to_previous);
  if (next_side < -tolerance_) return wedge(to_next.normalized(), onward, to_next.norm());
  if (previous_side > tolerance_) return wedge(onward, to_previous.normalized(), to_previous.norm());
  // Along a slit to its tip: the path may turn right back, and positions do not tell on which side it came.
  if (next_side < tolerance_ && previous_side > -tolerance_ && onward.dot(to_next) < 0.0 &&
      onward.dot(to_previous) < 0.0)
    return wedge(Vec<2>::Zero(), Vec<2>::Zero(), to_next.norm());
  return std::nullopt;
}

std::array<BendingWedge, 2> SightLines::bends(Index v, const Corner& corner, double reach) const {
  constexpr double wider = 100.0;  // than the slack of a bend
  const Vec<2> to_next = mesh_.vertex(corner.next) - mesh_.vertex(v),
               to_previous = mesh_.vertex(corner.previous) - mesh_.vertex(v);
  const double slack = wider * tolerance_ * (1.0 + reach / std::min(to_next.norm(), to_previous.norm()));
  const Vec<2> next = to_next.normalized(), previous = to_previous.normalized();
  return {BendingWedge{next, -previous, slack}, BendingWedge{-next, previous, slack}};
}

bool SightLines::opens(Index v, const Corner& corner, const Vec<2>& direction) const {
  const Vec<2> to_next = mesh_.vertex(corner.next) - mesh_.vertex(v),
               to_previous = mesh_.vertex(corner.previous) - mesh_.vertex(v);
  const double from_next = cross(to_next, direction), from_previous = cross(direction, to_previous);
  const double inwards = corner.reflex ? std::max(from_next, from_previous) : std::min(from_next, from_previous);
  return inwards >= -tolerance_ * (direction.norm() + to_next.norm() + to_previous.norm());
}

bool SightLines::passes(Index v, const Vec<2>& direction) const {
  const auto here = corners(v);
  return here.size() < 2 || std::any_of(here.begin(), here.end(), [&](const Corner& corner) {
           return opens(v, corner, direction) && opens(v, corner, -direction);
         });
}

SightLines::Departure SightLines::depart(Index v, const Vec<2>& direction) const {
  const Vec<2> x = mesh_.vertex(v);
  const double slack = tolerance_ * direction.norm();
  Departure departure;
  for (Index c : mesh_.cells_of(v)) {
    const Index i = local_index(mesh_, c, v);
    const Index right = mesh_.cells()((i + 1) % 3, c), left = mesh_.cells()((i + 2) % 3, c);
    const Vec<2> to_right = mesh_.vertex(right) - x, to_left = mesh_.vertex(left) - x;
    const double right_side = cross(direction, to_right), left_side = cross(direction, to_left);
    if (right_side < -slack && left_side > slack) {
      departure.cell = c;
      departure.facet = i;
    }
    const auto try_edge = [&](Index w, const Vec<2>& edge, double side) {
      if (std::abs(side) > slack || direction.dot(edge) <= 0.0 || w == departure.along) return;
      (departure.along < 0 ? departure.along : departure.also_along) = w;
    };
    try_edge(right, to_right, right_side);
    try_edge(left, to_left, left_side);
  }
  return departure;
}

Index SightLines::next_on_line(const Vec<2>& origin, const Vec<2>& direction, Index cell, Index facet) const {
  const double slack = tolerance_ * direction.norm();
  Index right = mesh_.cells()((facet + 1) % 3, cell);
  while (true) {
    const Index next = mesh_.neighbour(facet, cell);
    if (next < 0) return -1;
    // In the cell entered, counterclockwise: right end of the facet, apex, left end. The entry's right end is its last
    // vertex.
    const Index i = local_index(mesh_, next, right);
    const Index apex = mesh_.cells()((i + 1) % 3, next);
    const double side = cross(direction, mesh_.vertex(apex) - origin);
    if (std::abs(side) <= slack) return apex;
    cell = next;
    if (side > 0.0) {
      facet = (i + 2) % 3;
    } else {
      facet = i;
      right = apex;
    }
  }
}

bool SightLines::visible(Index from, Index to) const {
  const Vec<2> target = mesh_.vertex(to);
  while (from != to) {
    const Vec<2> origin = mesh_.vertex(from), direction = target - origin;
    if (direction.norm() <= tolerance_) return false;  // arrived on the other side of a slit
    const Departure departure = depart(from, direction);
    if (departure.also_along >= 0 && passes(departure.also_along, direction) && visible(departure.also_along, to))
      return true;
    if (departure.along >= 0)
      from = departure.along;
    else
      from = departure.cell < 0 ? -1 : next_on_line(origin, direction, departure.cell, departure.facet);
    if (from < 0 || (from != to && !passes(from, direction))) return false;
    if (direction.dot(target - mesh_.vertex(from)) < -tolerance_ * direction.norm())
      return false;  // passed it on another sheet
  }
  return true;
}

}  // namespace efree
