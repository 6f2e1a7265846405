// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/internal/opposite_sides.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <utility>

namespace efree::internal {
namespace {

/// Finds degrees of freedom by their place.
template <int Dim> class DofsByPlace {
 public:
  explicit DofsByPlace(const Frame<Dim>& frame) : frame_(frame) {}

  void add(const Vec<Dim>& x, Index dof) { dofs_.emplace(key_of(x), dof); }
  /// -1: none there.
  Index find(const Vec<Dim>& x) const {
    // The same place may be rounded to the next key.
    const Key key = key_of(x);
    Key near;
    for (int n = 0; n < (Dim == 2 ? 9 : 27); ++n) {
      int rest = n;
      for (int d = 0; d < Dim; ++d, rest /= 3) near[d] = key[d] + rest % 3 - 1;
      if (const auto found = dofs_.find(near); found != dofs_.end()) return found->second;
    }
    return -1;
  }

 private:
  using Key = std::array<std::int64_t, Dim>;
  Key key_of(const Vec<Dim>& x) const {
    Key key;
    for (int d = 0; d < Dim; ++d)
      key[d] = std::llround((x[d] - frame_.low[d]) / (4.0 * Frame<Dim>::rounding * frame_.lengths[d]));
    return key;
  }

  const Frame<Dim>& frame_;
  std::map<Key, Index> dofs_;
};

/// A convex polygon, or the two ends of an interval, in the plane of a side.
template <int Dim> using Outline = std::vector<Vec<Dim - 1>>;

double measure_of(const Outline<2>& interval) {
  return interval.empty() ? 0.0 : interval[1][0] - interval[0][0];
}
double measure_of(const Outline<3>& polygon) {
  double twice = 0.0;
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    const Vec<2> a = polygon[i - 1] - polygon[0], b = polygon[i] - polygon[0];
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return 0.5 * twice;
}

/// Of a facet, across the axis: from its lower to its upper end, counterclockwise.
template <int Dim> Outline<Dim> outline_of(const FineMesh<Dim>& mesh, Index facet, int axis) {
  Outline<Dim> outline;
  for (const Index v : mesh.facets().col(facet)) {
    const Vec<Dim> x = mesh.vertex(v);
    Vec<Dim - 1> flat;
    for (int d = 0, k = 0; d < Dim; ++d)
      if (d != axis) flat[k++] = x[d];
    outline.push_back(flat);
  }
  if (measure_of(outline) < 0.0) std::swap(outline[0], outline[1]);
  return outline;
}

Outline<2> intersection(const Outline<2>& a, const Outline<2>& b) {
  const double from = std::max(a[0][0], b[0][0]), to = std::min(a[1][0], b[1][0]);
  if (from >= to) return {};
  return {Vec<1>(from), Vec<1>(to)};
}
Outline<3> intersection(Outline<3> polygon, const Outline<3>& window) {
  for (std::size_t e = 0; e < window.size(); ++e) {
    const Vec<2>& from = window[e];
    const Vec<2> along = window[(e + 1) % window.size()] - from;
    const auto inside = [&](const Vec<2>& x) { return along[0] * (x[1] - from[1]) - along[1] * (x[0] - from[0]); };
    Outline<3> kept;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const Vec<2>&a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
      const double at_a = inside(a), at_b = inside(b);
      if (at_a >= 0.0) kept.push_back(a);
      if ((at_a > 0.0 && at_b < 0.0) || (at_a < 0.0 && at_b > 0.0)) kept.push_back(a + at_a / (at_a - at_b) * (b - a));
    }
    polygon = std::move(kept);
  }
  return polygon;
}

/// A facet with its outline and the box around that.
template <int Dim> struct Tile {
  Index facet;
  Outline<Dim> outline;
  double measure;
  Vec<Dim - 1> low, high;

  Tile(const FineMesh<Dim>& mesh, Index of, int axis) : facet(of), outline(outline_of(mesh, of, axis)) {
    measure = measure_of(outline);
    low = high = outline[0];
    for (const auto& x : outline) {
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
  }
};

}  // namespace

template <int Dim> OppositeSides opposite_sides(const FineMesh<Dim>& mesh, const Frame<Dim>& frame, int axis) {
  OppositeSides sides;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (const int side = frame.side_of(mesh, f); side / 2 == axis && side >= 0)
      (side % 2 == 1 ? sides.upper : sides.lower).push_back(f);
  return sides;
}

template <int Dim> std::optional<std::vector<std::array<Index, 2>>> matching_dofs(const FineSpace<Dim>& space,
                                                                                  const Frame<Dim>& frame, int axis) {
  const OppositeSides sides = opposite_sides(space.mesh(), frame, axis);
  if (sides.lower.size() != sides.upper.size()) return std::nullopt;
  DofsByPlace<Dim> below(frame);
  std::set<std::vector<Index>> lower_facets;
  const auto sorted = [](std::vector<Index> dofs) {
    std::ranges::sort(dofs);
    return dofs;
  };
  for (const Index f : sides.lower) {
    const std::vector<Index> dofs = space.facet(f);
    for (const Index dof : dofs) below.add(space.points().col(dof), dof);
    lower_facets.insert(sorted(dofs));
  }
  std::set<std::array<Index, 2>> pairs;
  for (const Index f : sides.upper) {
    std::vector<Index> opposite;
    for (const Index dof : space.facet(f)) {
      Vec<Dim> x = space.points().col(dof);
      x[axis] = frame.low[axis];
      opposite.push_back(below.find(x));
      pairs.insert({dof, opposite.back()});
    }
    if (!lower_facets.contains(sorted(opposite))) return std::nullopt;
  }
  return std::vector<std::array<Index, 2>>(pairs.begin(), pairs.end());
}

template <int Dim>
std::vector<FacetOverlap<Dim>> facet_overlaps(const FineMesh<Dim>& mesh, const Frame<Dim>& frame, int axis) {
  constexpr double nothing = 1e-14;  // of the smaller facet
  const OppositeSides sides = opposite_sides(mesh, frame, axis);
  std::vector<Tile<Dim>> lower;
  double widest = 0.0;
  for (const Index f : sides.lower) {
    lower.emplace_back(mesh, f, axis);
    widest = std::max(widest, lower.back().high[0] - lower.back().low[0]);
  }
  std::ranges::sort(lower, {}, [](const Tile<Dim>& tile) { return std::pair(tile.low[0], tile.facet); });
  std::vector<FacetOverlap<Dim>> overlaps;
  for (const Index f : sides.upper) {
    const Tile<Dim> tile(mesh, f, axis);
    const auto first =
        std::ranges::lower_bound(lower, tile.low[0] - widest, {}, [](const Tile<Dim>& other) { return other.low[0]; });
    for (auto other = first; other != lower.end() && other->low[0] < tile.high[0]; ++other) {
      if ((other->high - tile.low).minCoeff() <= 0.0 || (tile.high - other->low).minCoeff() <= 0.0) continue;
      const Outline<Dim> common = intersection(tile.outline, other->outline);
      for (std::size_t i = Dim - 1; i < common.size(); ++i) {
        Outline<Dim> simplex{common[0]};
        for (int d = 1; d < Dim; ++d) simplex.push_back(common[i + d - (Dim - 1)]);
        const double measure = measure_of(simplex);
        if (measure <= nothing * std::min(tile.measure, other->measure)) continue;
        FacetOverlap<Dim> overlap{.upper = f, .lower = other->facet, .corners = {}, .measure = measure};
        for (int corner = 0; corner < Dim; ++corner)
          for (int d = 0, k = 0; d < Dim; ++d)
            overlap.corners(d, corner) = d == axis ? frame.low[axis] : simplex[corner][k++];
        overlaps.push_back(std::move(overlap));
      }
    }
  }
  return overlaps;
}

template OppositeSides opposite_sides(const FineMesh<2>&, const Frame<2>&, int);
template OppositeSides opposite_sides(const FineMesh<3>&, const Frame<3>&, int);
template std::optional<std::vector<std::array<Index, 2>>> matching_dofs(const FineSpace<2>&, const Frame<2>&, int);
template std::optional<std::vector<std::array<Index, 2>>> matching_dofs(const FineSpace<3>&, const Frame<3>&, int);
template std::vector<FacetOverlap<2>> facet_overlaps(const FineMesh<2>&, const Frame<2>&, int);
template std::vector<FacetOverlap<3>> facet_overlaps(const FineMesh<3>&, const Frame<3>&, int);

}  // namespace efree::internal
