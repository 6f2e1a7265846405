// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/spatial_sight.hpp"

#include "efree/heatgeo/internal/patch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

std::vector<BoxTree::Box> vertex_boxes(const FineMesh<3>& mesh) {
  std::vector<BoxTree::Box> boxes(mesh.num_vertices());
  for (Index v = 0; v < mesh.num_vertices(); ++v) boxes[v] = BoxTree::Box(mesh.vertex(v));
  return boxes;
}

std::vector<BoxTree::Box> facet_boxes(const FineMesh<3>& mesh) {
  std::vector<BoxTree::Box> boxes(mesh.num_facets());
  for (Index f = 0; f < mesh.num_facets(); ++f)
    for (const Index v : mesh.facets().col(f)) boxes[f].extend(mesh.vertex(v));
  return boxes;
}

}  // namespace

SpatialSight::SpatialSight(const FineMesh<3>& mesh, Search search) : mesh_(mesh), tolerance_(length_tolerance(mesh)) {
  const Index vertices = mesh.num_vertices();
  std::vector<Index> seen_from(vertices, -1);
  neighbours_.items.reserve(2 *
                            (vertices + mesh.num_cells()));  // about: edges = vertices + cells + half the facets - 1
  neighbours_.offsets.reserve(vertices + 1);
  for (Index v = 0; v < vertices; ++v) {
    seen_from[v] = v;
    for (const Index c : mesh.cells_of(v))
      for (const Index w : mesh.cells().col(c))
        if (seen_from[w] != v) {
          seen_from[w] = v;
          neighbours_.items.push_back({w, c});
        }
    neighbours_.close_row();
  }

  facets_.reserve(mesh.num_facets());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const auto corners = mesh.facets().col(f);
    const Vec<3> a = mesh.vertex(corners[0]), b = mesh.vertex(corners[1]) - a, c = mesh.vertex(corners[2]) - a,
                 normal = b.cross(c);
    const double longest = std::sqrt(std::max({b.squaredNorm(), c.squaredNorm(), (c - b).squaredNorm()})),
                 twice_area = normal.norm();
    // A short facet far away magnifies the rounding of its own vertices.
    facets_.push_back({normal / twice_area, longest, 4.0 * tolerance_ * longest / twice_area});
  }
  if (search == Search::none) return;
  vertex_tree_ = BoxTree(vertex_boxes(mesh));
  facet_tree_ = BoxTree(facet_boxes(mesh));
  placed_vertices_.reserve(vertex_tree_.order().size());
  for (const Index v : vertex_tree_.order()) placed_vertices_.push_back({mesh.vertex(v), v, mesh.component()[v]});
  placed_facets_.reserve(facet_tree_.order().size());
  for (const Index f : facet_tree_.order()) {
    const auto corners = mesh.facets().col(f);
    placed_facets_.push_back(
        {facets_[f], mesh.vertex(corners[0]), {corners[0], corners[1], corners[2]}, mesh.component()[corners[0]]});
  }
}

bool SpatialSight::begins_inside(Index v, const Vec<3>& x) const {
  const Answer answer = begins_inside_from(v, x - mesh_.vertex(v), mesh_.cells_of(v).front());
  return answer == Answer::unsure ? start(v, x).cell >= 0 : answer == Answer::yes;
}

bool SpatialSight::sees(Index v, Index target) const {
  const Start from = start(v, mesh_.vertex(target));
  return from.cell >= 0 && reaches(from, target);
}

/// Whether the line begins inside, from how often an arc of directions at v from there into one of its cells crosses
/// boundary facets.
SpatialSight::Answer SpatialSight::begins_inside_from(Index v, const Vec<3>& line, Index c) const {
  constexpr double rounding = 1e-9;
  const Vec<3> from = mesh_.vertex(v);
  Vec<3> into = -4.0 * from;
  for (const Index w : mesh_.cells().col(c)) into += mesh_.vertex(w);
  const Vec<3> pole = line.cross(into);
  if (pole.squaredNorm() < rounding * line.squaredNorm() * into.squaredNorm()) return Answer::unsure;
  const double least = rounding * pole.cwiseAbs().sum(), edge = least * line.cwiseAbs().sum(),
               far_edge = least * into.cwiseAbs().sum();
  bool inside = true;
  for (const Index f : mesh_.facets_of(v)) {
    const auto corners = mesh_.facets().col(f);
    const int first = corners[0] == v ? 1 : corners[1] == v ? 2 : 0;
    const Vec<3> p = mesh_.vertex(corners[first]) - from, q = mesh_.vertex(corners[(first + 1) % 3]) - from;
    const double hp = pole.dot(p), hq = pole.dot(q), small = least * (p.cwiseAbs().sum() + q.cwiseAbs().sum());
    if (std::abs(hp) < small || std::abs(hq) < small) return Answer::unsure;
    if ((hp > 0.0) == (hq > 0.0)) continue;
    // Where the facet meets the plane of the arc: after its beginning and before its end?
    const Vec<3> at = hp > 0.0 ? hp * q - hq * p : hq * p - hp * q;
    const double size = at.cwiseAbs().sum(), after = pole.dot(line.cross(at)), before = pole.dot(at.cross(into));
    if (after < -edge * size || before < -far_edge * size) continue;
    if (after < edge * size || before < far_edge * size) return Answer::unsure;
    inside = !inside;
  }
  return inside ? Answer::yes : Answer::no;
}

/// Twice the area of the facet opposite corner i of cell c times the height of x over it; positive inside.
double SpatialSight::height(Index c, int i, const Vec<3>& x) const {
  const auto& cell = mesh_.cells();
  const Vec<3> a = mesh_.vertex(cell((i + 1) % 4, c)), b = mesh_.vertex(cell((i + 2) % 4, c)) - a,
               d = mesh_.vertex(cell((i + 3) % 4, c)) - a;
  const double above = b.cross(d).dot(x - a);
  return i % 2 == 0 ? -above : above;
}

/// Whether x lies on the far side of that facet, by more than rounding.
bool SpatialSight::beyond(Index c, int i, const Vec<3>& x) const {
  const auto& cell = mesh_.cells();
  const Vec<3> a = mesh_.vertex(cell((i + 1) % 4, c)), b = mesh_.vertex(cell((i + 2) % 4, c)) - a,
               d = mesh_.vertex(cell((i + 3) % 4, c)) - a, normal = b.cross(d), arm = x - a;
  const double above = i % 2 == 0 ? -normal.dot(arm) : normal.dot(arm);
  if (above >= 0.0) return false;
  const double longest = std::max(b.norm(), d.norm());
  return -above > 4.0 * tolerance_ * longest * (longest + arm.norm());
}

/// Cell at the vertex that the straight line to x enters, and the local number of the vertex there; cell -1 if the line
/// leaves the body at once.
SpatialSight::Start SpatialSight::start(Index vertex, const Vec<3>& x) const {
  for (const Index c : mesh_.cells_of(vertex)) {
    const auto cell = mesh_.cells().col(c);
    const int corner = cell[0] == vertex ? 0 : cell[1] == vertex ? 1 : cell[2] == vertex ? 2 : 3;
    bool inside = true;
    for (int i = 0; i < 4 && inside; ++i) inside = i == corner || !beyond(c, i, x);
    if (!inside) continue;
    // On the plane of a facet, in front of it or behind: the facet opposite the vertex must be ahead, or x in the cell.
    const Vec<3> from = mesh_.vertex(vertex), ahead = from + 0.5 * mesh_.size() / (x - from).norm() * (x - from);
    if (height(c, corner, from) > height(c, corner, ahead)) return {c, corner};
  }
  return {};
}

/// Whether the line goes on from there to vertex `target` without leaving the body: a walk from cell to cell
/// (visibility walk of Devillers, Pion & Teillaud 2002).
bool SpatialSight::reaches(Start from, Index target) const {
  const Vec<3> x = mesh_.vertex(target);
  const Vec<3> origin = mesh_.vertex(mesh_.cells()(from.corner, from.cell));
  Index cell = from.cell;
  Index behind = -1;
  // Much longer than any line through cells of one size; lines that circle an edge by rounding end here, unseen.
  for (int step = 0; step < 10000; ++step) {
    const auto corners = mesh_.cells().col(cell);
    if ((corners.array() == target).any()) return true;
    // Leave by the first facet that has the target on its far side.
    int exit = -1;
    double first = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 4; ++i) {
      if (mesh_.neighbour(i, cell) == behind && behind >= 0) continue;
      if (!beyond(cell, i, x)) continue;
      const double here = height(cell, i, origin), there = height(cell, i, x);
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

}  // namespace efree
