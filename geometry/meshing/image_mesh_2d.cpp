// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/image_mesh.hpp"

#include "efree/core/memory.hpp"
#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/geometry/meshing/internal/planar_regions.hpp"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Constrained_triangulation_plus_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polyline_simplification_2/Squared_distance_cost.h>
#include <CGAL/Polyline_simplification_2/Stop_above_cost_threshold.h>
#include <CGAL/Polyline_simplification_2/simplify.h>
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>

namespace efree {
namespace {

using internal::PlanarRegions;

/// A place on the grid in half pixels, and pieces of contours between such places.
using Place = std::array<Index, 2>;
enum class Side : char { left, right, bottom, top, inside };
constexpr const char* side_names[] = {"left", "right", "bottom", "top", "pores"};
struct Piece {
  Place from, to;
  Index left, right;  // regions
  Side side;
};

class Tracer {
 public:
  Tracer(const LabelImage<2>& image, const internal::ImageRegions& regions, Contour contour)
      : image_(image), regions_(regions), contour_(contour) {}

  std::vector<Piece> pieces() const {
    std::vector<Piece> out;
    const auto [nx, ny] = image_.size;
    for (Index j = 0; j <= ny; ++j)
      for (Index i = 0; i <= nx; ++i) at_corner(i, j, out);
    return out;
  }

 private:
  Index region(Index i, Index j) const {
    const bool outside = i < 0 || j < 0 || i >= image_.size[0] || j >= image_.size[1];
    return outside ? -1 : regions_.of_label[image_.at({i, j})];
  }

  /// The contours within half a pixel of corner (i, j).
  void at_corner(Index i, Index j, std::vector<Piece>& out) const {
    // Quadrants counter-clockwise from the upper right one; arm k runs between quadrants k - 1 and k.
    const std::array<Index, 4> quadrant{region(i, j), region(i - 1, j), region(i - 1, j - 1), region(i, j - 1)};
    const std::array<Place, 4> step{{{1, 0}, {0, 1}, {-1, 0}, {0, -1}}};
    const auto before = [&](int k) { return quadrant[(k + 3) % 4]; };
    const auto is_arm = [&](int k) { return before(k) != quadrant[k]; };
    const auto end = [&](int k) { return Place{2 * i + step[k][0], 2 * j + step[k][1]}; };
    const bool on_frame = i == 0 || j == 0 || i == image_.size[0] || j == image_.size[1];
    const int arms = is_arm(0) + is_arm(1) + is_arm(2) + is_arm(3);
    // Bodies that touch in a corner only.
    const bool contact = arms == 4 && ((quadrant[0] < 0 && quadrant[2] < 0) || (quadrant[1] < 0 && quadrant[3] < 0));
    if (contour_ == Contour::smooth && !on_frame && (arms == 2 || contact)) {
      for (int k = 0; k < 4; ++k) {
        if (!is_arm(k)) continue;
        if (contact && quadrant[k] < 0) continue;
        int next = k + 1;
        while (!is_arm(next % 4)) ++next;
        out.push_back({end(k), end(next % 4), before(k), quadrant[k], Side::inside});
        if (!contact) return;  // the other arm would say the same
      }
      return;
    }
    for (int k = 0; k < 4; ++k)
      if (is_arm(k)) out.push_back({{2 * i, 2 * j}, end(k), quadrant[k], before(k), side(i, j, k)});
  }

  Side side(Index i, Index j, int arm) const {
    if (arm % 2 == 1) return i == 0 ? Side::left : i == image_.size[0] ? Side::right : Side::inside;
    return j == 0 ? Side::bottom : j == image_.size[1] ? Side::top : Side::inside;
  }

  const LabelImage<2>& image_;
  const internal::ImageRegions& regions_;
  Contour contour_;
};

/// Joins the pieces to chains from junction to junction, or closed ones, and leaves out the points within straight
/// runs.
PlanarRegions join(const std::vector<Piece>& pieces, const LabelImage<2>& image) {
  // Ends of pieces, sorted by place.
  std::vector<Index> ends(2 * pieces.size());
  for (std::size_t e = 0; e < ends.size(); ++e) ends[e] = static_cast<Index>(e);
  const auto place = [&](Index end) { return end % 2 == 0 ? pieces[end / 2].from : pieces[end / 2].to; };
  std::sort(ends.begin(), ends.end(), [&](Index a, Index b) {
    const Place p = place(a), q = place(b);
    return p[1] != q[1] ? p[1] < q[1] : p[0] != q[0] ? p[0] < q[0] : a < b;
  });
  std::vector<Index> number(ends.size());  // of the place of an end
  std::vector<Index> first;                // by place: in `ends`
  for (std::size_t e = 0; e < ends.size(); ++e) {
    if (e == 0 || place(ends[e]) != place(ends[e - 1])) first.push_back(static_cast<Index>(e));
    number[ends[e]] = static_cast<Index>(first.size()) - 1;
  }
  first.push_back(static_cast<Index>(ends.size()));
  const auto is_joint = [&](Index p) {
    return first[p + 1] - first[p] != 2 || pieces[ends[first[p]] / 2].side != pieces[ends[first[p] + 1] / 2].side;
  };

  PlanarRegions out;
  std::vector<Index> point(first.size() - 1, -1);  // by place
  const auto point_at = [&](Index p) {
    if (point[p] < 0) {
      point[p] = static_cast<Index>(out.points.size());
      const Place at = place(ends[first[p]]);
      out.points.push_back(image.origin + 0.5 * image.spacing.cwiseProduct(Vec<2>(at[0], at[1])));
    }
    return point[p];
  };
  std::vector<char> used(pieces.size(), 0);
  const auto direction = [&](Index end) {
    const Place a = place(end), b = place(end ^ 1);
    return Place{b[0] - a[0], b[1] - a[1]};
  };
  // Goes along the chain that leaves by `end`, as far as a joint or round to the start.
  const auto follow = [&](Index end) {
    const Piece& piece = pieces[end / 2];
    const bool forward = end % 2 == 0;
    PlanarRegions::Chain chain{side_names[static_cast<int>(piece.side)],
                               {point_at(number[end])},
                               forward ? piece.left : piece.right,
                               forward ? piece.right : piece.left};
    const Index start = number[end];
    while (true) {
      used[end / 2] = 1;
      const Index at = number[end ^ 1];
      if (is_joint(at) || at == start) {
        chain.points.push_back(point_at(at));
        break;
      }
      const Index next = ends[first[at]] == (end ^ 1) ? ends[first[at] + 1] : ends[first[at]];
      const Place u = direction(end), v = direction(next);
      if (u[0] * v[1] != u[1] * v[0]) chain.points.push_back(point_at(at));
      end = next;
    }
    out.chains.push_back(std::move(chain));
  };
  for (const bool from_joints : {true, false})
    for (const Index end : ends) {
      // Closed chains start at their first place in the order of `ends`, and there they turn.
      if (!used[end / 2] && (!from_joints || is_joint(number[end]))) follow(end);
    }
  return out;
}

/// Squared distance that a contour moves by, in pixels, plus less than 1e-9 by place. On a grid many distances are
/// equal, and CGAL takes ties in the order of addresses: another one every time.
struct CostWithoutTies {
  template <class Triangulation, class Vertex> auto operator()(const Triangulation& plus, Vertex at) const {
    auto cost = CGAL::Polyline_simplification_2::Squared_distance_cost()(plus, at);
    const auto& p = (*at)->point();
    const auto half_pixels = [](double x) { return static_cast<std::uint64_t>(std::llround(2.0 * x)); };
    // Multipliers of Steele, Lea & Flood 2014.
    std::uint64_t bits = (half_pixels(p.x()) << 32 | half_pixels(p.y())) * 0xbf58476d1ce4e5b9ull;
    bits = (bits ^ bits >> 31) * 0x94d049bb133111ebull;
    if (cost) *cost += 1e-9 * 0x1p-53 * static_cast<double>(bits >> 11);
    return cost;
  }
};

/// Leaves out points of chains that are no more than `tolerance` away from what replaces them.
PlanarRegions simplify(const PlanarRegions& plane, double tolerance, const LabelImage<2>& image) {
  namespace PS = CGAL::Polyline_simplification_2;
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Vertex = PS::Vertex_base_2<Kernel>;
  using Face = CGAL::Constrained_triangulation_face_base_2<Kernel>;
  using Cdt = CGAL::Constrained_Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<Vertex, Face>,
                                                         CGAL::Exact_predicates_tag>;
  using Plus = CGAL::Constrained_triangulation_plus_2<Cdt>;
  // In pixels, so that the tolerance is the same in x and y.
  const auto to_pixels = [&](Index p) {
    const Vec<2> at = (plane.points[p] - image.origin).cwiseQuotient(image.spacing);
    return Kernel::Point_2(0.5 * std::round(2.0 * at.x()), 0.5 * std::round(2.0 * at.y()));
  };
  Plus plus;
  std::vector<Plus::Constraint_id> ids;
  std::vector<Kernel::Point_2> points;
  for (const auto& chain : plane.chains) {
    points.clear();
    for (const Index p : chain.points) points.push_back(to_pixels(p));
    ids.push_back(plus.insert_constraint(points.begin(), points.end()));
  }
  PS::simplify(plus, CostWithoutTies(), PS::Stop_above_cost_threshold(tolerance * tolerance));

  PlanarRegions out;
  std::map<std::pair<double, double>, Index> numbers;
  for (std::size_t c = 0; c < ids.size(); ++c) {
    PlanarRegions::Chain chain = plane.chains[c];
    chain.points.clear();
    for (auto v = plus.vertices_in_constraint_begin(ids[c]); v != plus.vertices_in_constraint_end(ids[c]); ++v) {
      const auto& p = (*v)->point();
      const auto [it, fresh] = numbers.insert({{p.x(), p.y()}, static_cast<Index>(out.points.size())});
      if (fresh) out.points.push_back(image.origin + image.spacing.cwiseProduct(Vec<2>(p.x(), p.y())));
      chain.points.push_back(it->second);
    }
    out.chains.push_back(std::move(chain));
  }
  return out;
}

}  // namespace

PlanarRegions internal::contours(const LabelImage<2>& image, const ImageRegions& regions, Contour contour) {
  return join(Tracer(image, regions, contour).pieces(), image);
}

template <> MeshData<2> mesh_image<2>(const LabelImage<2>& image, const ImageMeshOptions& options) {
  const internal::ImageRegions regions = internal::image_regions(image, options);
  PlanarRegions plane = internal::contours(image, regions, options.contour);
  double area = 0.0;
  for (const LabelCount& count : count_labels(image))
    if (count.label != 0) area += static_cast<double>(count.pixels) * image.pixel_volume();
  // About 300 bytes to a triangle of CGAL's and of the mesh together; two triangles to a point of a contour.
  require_memory(
      300.0 * (4.0 * area / (options.size * options.size) + 4.0 * static_cast<double>(plane.points.size())),
      fmt::format("image: meshing {} x {} pixels with a size of {}", image.size[0], image.size[1], options.size));
  if (options.simplify > 0.0) plane = simplify(plane, options.simplify, image);
  MeshData<2> mesh = internal::triangulate_regions(plane, {.size = options.size, .min_angle = 0.0});
  mesh.region_names = regions.names;
  internal::turn_to_world(image, mesh.vertices);
  return mesh;
}

}  // namespace efree
