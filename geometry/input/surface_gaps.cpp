// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/surface_gaps.hpp"

#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/internal/infinity.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/internal/find_gaps.hpp"
#include "efree/geometry/input/internal/surface_mesh.hpp"
#include "efree/geometry/input/internal/triangle_tree.hpp"
#include "efree/geometry/input/internal/winding.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace efree {
namespace {

using internal::facing_walls, internal::normal_of, internal::Triangle, internal::TriangleTree;
using Sample = SurfaceGap::Sample;

using internal::infinity;
constexpr double elongation = 8.0;  ///< area of a gap's walls over the square of its width, at least
constexpr double most_samples = 1e6;

/// Calls body(piece) for pieces of a triangle, cut in halves until no edge is longer than `spacing`.
template <class Body> void cut_up(const Triangle& whole, double spacing, const Body& body) {
  std::vector<Triangle> pieces{whole};
  while (!pieces.empty()) {
    const Triangle t = pieces.back();
    pieces.pop_back();
    int longest = 0;
    double length = 0.0;
    for (int k = 0; k < 3; ++k)
      if (const double edge = (t[(k + 1) % 3] - t[k]).norm(); edge > length) length = edge, longest = k;
    if (length <= spacing) {
      body(t);
      continue;
    }
    const Vec<3>&a = t[longest], &b = t[(longest + 1) % 3], &c = t[(longest + 2) % 3];
    const Vec<3> middle = 0.5 * (a + b);
    pieces.push_back({a, middle, c});
    pieces.push_back({middle, b, c});
  }
}

/// A gap of these samples.
SurfaceGap gap_of(std::vector<Sample> samples) {
  SurfaceGap gap;
  gap.narrowest = infinity;
  for (const Sample& sample : samples) {
    const double width = sample.width();
    if (width < gap.narrowest) {
      gap.narrowest = width;
      gap.at = 0.5 * (sample.from + sample.to);
    }
    gap.widest = std::max(gap.widest, width);
    gap.area += sample.area;
  }
  gap.samples = std::move(samples);
  return gap;
}

bool is_long(const SurfaceGap& gap) {
  return gap.area >= elongation * gap.widest * gap.widest;
}

/// Samples whose middles are in the same or in neighbouring cells of a grid are of one gap.
std::vector<SurfaceGap> gathered(const std::vector<Sample>& samples, double spacing) {
  using Cell = std::array<std::int64_t, 3>;
  std::map<Cell, std::vector<Index>> cells;
  for (Index s = 0; s < std::ssize(samples); ++s) {
    Cell cell;
    for (int d = 0; d < 3; ++d)
      cell[d] = static_cast<std::int64_t>(std::floor(0.5 * (samples[s].from[d] + samples[s].to[d]) / spacing));
    cells[cell].push_back(s);
  }
  internal::DisjointSets sets(static_cast<Index>(samples.size()));
  for (const auto& [cell, inside] : cells) {
    for (const Index s : inside) sets.join(inside.front(), s);
    for (int n = 14; n < 27; ++n)  // the other half of the neighbours have this one for theirs
      if (const auto next = cells.find({cell[0] + n / 9 - 1, cell[1] + n / 3 % 3 - 1, cell[2] + n % 3 - 1});
          next != cells.end())
        sets.join(inside.front(), next->second.front());
  }
  const std::vector<Index> first = std::move(sets).firsts();
  std::map<Index, std::vector<Sample>> members;
  for (Index s = 0; s < std::ssize(samples); ++s) members[first[s]].push_back(samples[s]);
  std::vector<SurfaceGap> gaps;
  for (auto& [number, of] : members) gaps.push_back(gap_of(std::move(of)));
  return gaps;
}

}  // namespace

std::vector<SurfaceGap> internal::find_gaps(const std::vector<Triangle>& triangles, double widest, double spacing) {
  if (triangles.empty() || !(widest > 0.0) || !(spacing > 0.0)) return {};
  double area = 0.0;
  Eigen::AlignedBox3d box;
  for (const Triangle& t : triangles) {
    area += 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).norm();
    for (const Vec<3>& corner : t) box.extend(corner);
  }
  const double apart = std::max(spacing, std::sqrt(4.0 * area / most_samples));  // pieces have a quarter of its square
  const double nearest = 1e-9 * box.diagonal().norm();                           // closer is touching
  const TriangleTree tree(triangles);
  std::vector<std::vector<Sample>> found(triangles.size());
  parallel_for(static_cast<Index>(triangles.size()), [&](Index t) {
    const Vec<3> normal = normal_of(triangles[t]);
    cut_up(triangles[t], apart, [&](const Triangle& piece) {
      const Vec<3> from = (piece[0] + piece[1] + piece[2]) / 3.0;
      const auto hit = tree.first_hit(from, normal, nearest, widest, t);
      if (!hit || normal.dot(normal_of(triangles[hit->triangle])) > facing_walls) return;
      const Vec<3> to = from + hit->distance * normal;
      const auto behind = tree.first_hit(from, -normal, nearest, widest, t);
      const auto beyond = tree.first_hit(to, normal, nearest, widest, hit->triangle);
      found[t].push_back({from, to, 0.5 * (piece[1] - piece[0]).cross(piece[2] - piece[0]).norm(),
                          behind ? behind->distance : infinity, beyond ? beyond->distance : infinity});
    });
  });
  std::vector<Sample> samples;
  for (const auto& of : found) samples.insert(samples.end(), of.begin(), of.end());
  std::vector<SurfaceGap> gaps = gathered(samples, apart);
  std::erase_if(gaps, [](const SurfaceGap& gap) { return !is_long(gap); });
  std::ranges::stable_sort(gaps, std::ranges::greater{}, &SurfaceGap::area);
  return gaps;
}

std::vector<SurfaceGap> find_gaps(const SurfaceSoup& surface, double widest, double spacing) {
  internal::check_triangles(surface);
  return internal::find_gaps(internal::orient_triangles(surface).triangles, widest, spacing);
}

std::vector<SurfaceGap> closed_gaps(const std::vector<SurfaceGap>& gaps, const MeshData<3>& mesh, double reach) {
  if (gaps.empty()) return {};
  const FineMesh<3> body(mesh);
  std::vector<Triangle> boundary;
  for (Index f = 0; f < body.num_facets(); ++f) {
    const auto corners = body.facets().col(f);
    Triangle t{body.vertex(corners[0]), body.vertex(corners[1]), body.vertex(corners[2])};
    if (normal_of(t).dot(body.facet_normal(f)) < 0.0) std::swap(t[1], t[2]);
    boundary.push_back(t);
  }
  const TriangleTree tree(boundary);
  const internal::Winding winding(std::move(boundary));
  std::vector<SurfaceGap> closed;
  for (const SurfaceGap& gap : gaps) {
    std::vector<char> is_closed(gap.samples.size());
    parallel_for(static_cast<Index>(gap.samples.size()), [&](Index s) {
      const Sample& sample = gap.samples[s];
      const double width = sample.width(), before = std::min(reach, 0.5 * sample.behind_from),
                   after = std::min(reach, 0.5 * sample.behind_to);
      const Vec<3> across = (sample.to - sample.from) / width, start = sample.from - before * across;
      // Nothing of it in the mesh: what is lost is a wall, not a gap.
      is_closed[s] =
          !tree.first_hit(start, across, 0.0, before + width + after) && winding(0.5 * (sample.from + sample.to)) > 0.5;
    });
    std::vector<Sample> samples;
    for (std::size_t s = 0; s < is_closed.size(); ++s)
      if (is_closed[s]) samples.push_back(gap.samples[s]);
    if (!samples.empty()) closed.push_back(gap_of(std::move(samples)));
  }
  return closed;
}

}  // namespace efree
