// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/planar_domain.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/mesh/internal/extent.hpp"
#include "efree/geometry/mesh/internal/spatial_order.hpp"
#include "efree/geometry/meshing/internal/planar_regions.hpp"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_mesh_face_base_2.h>
#include <CGAL/Delaunay_mesh_size_criteria_2.h>
#include <CGAL/Delaunay_mesher_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>
#include <CGAL/Unique_hash_map.h>
#include <CGAL/box_intersection_d.h>
#include <CGAL/spatial_sort.h>
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <tuple>

namespace efree {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct VertexInfo {
  Index input = -1;   // point of the domain, -1 for a vertex that refinement added
  Index number = -1;  // vertex of the mesh
};
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<VertexInfo, Kernel>;
struct FaceInfo {
  Index region = -1;
};
using FaceBase = CGAL::Delaunay_mesh_face_base_2<
    Kernel, CGAL::Constrained_Delaunay_triangulation_face_base_2<
                Kernel, CGAL::Constrained_triangulation_face_base_2<
                            Kernel, CGAL::Triangulation_face_base_with_info_2<FaceInfo, Kernel>>>>;
using Cdt =
    CGAL::Constrained_Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>,
                                               CGAL::No_constraint_intersection_requiring_constructions_tag>;
using Criteria = CGAL::Delaunay_mesh_size_criteria_2<Cdt>;

Kernel::Point_2 to_cgal(const Vec<2>& p) {
  return {p.x(), p.y()};
}
std::string show(const Vec<2>& p) {
  return fmt::format("({}, {})", p.x(), p.y());
}

enum class Kind { boundary, embedded, slit };

/// A straight piece of a chain. Its end points are numbers of `Segments::points`; equal for an embedded point.
struct Segment {
  Index a, b;
  Kind kind;
  Index name;                   // -1: none
  Index left = -1, right = -1;  // regions beside it
  Index chord = -1;             // of Segments::chords; -1: it is no part of one

  std::pair<Index, Index> key() const { return std::minmax(a, b); }
};

/// A segment that stands for a curve through its ends.
struct Chord {
  Vec<2> a, b;
  Vec<2> bulge;  // from its middle to the curve

  /// From a point of the chord to the curve, as if that were a parabola.
  Vec<2> offset(const Vec<2>& x) const {
    const double t = (x - a).dot(b - a) / (b - a).squaredNorm();
    return 4.0 * t * (1.0 - t) * bulge;
  }
};

struct Segments {
  std::vector<Vec<2>> points;
  std::vector<Chord> chords{};
  std::vector<Segment> segments;
  std::vector<std::string> names;
  double tolerance = 0.0;  // points closer than this are one
};

Index name_number(std::vector<std::string>& names, const std::string& name) {
  if (name.empty()) return -1;
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) names.push_back(name);
  return static_cast<Index>(std::find(names.begin(), names.end(), name) - names.begin());
}

void add_chains(const std::vector<Polyline>& chains, Kind kind, Segments& out) {
  for (const Polyline& chain : chains) {
    const std::size_t least = kind == Kind::embedded ? 1 : 2;
    if (chain.points.size() < least)
      throw InputError(fmt::format("domain: chain \"{}\" has {} points, expected at least {}", chain.name,
                                   chain.points.size(), least));
    for (const Vec<2>& p : chain.points)
      if (!p.allFinite())
        throw InputError(
            fmt::format("domain: chain \"{}\" has the point {}, expected finite numbers", chain.name, show(p)));
    std::vector<Vec<2>> points = chain.points;
    // A slit that is a single fine edge between two tips would have no vertex to open at.
    if (kind == Kind::slit && points.size() == 2) points.insert(points.begin() + 1, 0.5 * (points[0] + points[1]));
    if (points.size() == 1) points.push_back(points[0]);
    const bool curved = kind == Kind::boundary && !chain.bulges.empty();
    if (curved && chain.bulges.size() + 1 != points.size())
      throw InputError(fmt::format("domain: chain \"{}\" has {} bulges, expected one for each of its {} segments",
                                   chain.name, chain.bulges.size(), points.size() - 1));
    const Index name = name_number(out.names, chain.name), first = static_cast<Index>(out.points.size());
    for (Index k = 0; k + 1 < static_cast<Index>(points.size()); ++k) {
      out.segments.push_back({first + k, first + k + 1, kind, name});
      if (!curved || chain.bulges[k].isZero(0.0)) continue;
      out.segments.back().chord = static_cast<Index>(out.chords.size());
      out.chords.push_back({points[k], points[k + 1], chain.bulges[k]});
    }
    out.points.insert(out.points.end(), points.begin(), points.end());
  }
}

/// Gives points closer than the tolerance one number.
void merge_points(Segments& s) {
  std::vector<Index> order(s.points.size()), number(s.points.size(), -1);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](Index i, Index j) {
    const Vec<2>&p = s.points[i], &q = s.points[j];
    return p.x() != q.x() ? p.x() < q.x() : p.y() != q.y() ? p.y() < q.y() : i < j;
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    number[order[i]] = order[i];
    for (std::size_t j = i; j-- > 0 && s.points[order[i]].x() - s.points[order[j]].x() <= s.tolerance;)
      if ((s.points[order[i]] - s.points[order[j]]).norm() <= s.tolerance) {
        number[order[i]] = number[order[j]];
        break;
      }
  }
  std::vector<Index> kept(s.points.size(), -1);
  std::vector<Vec<2>> points;
  for (std::size_t i = 0; i < number.size(); ++i) {
    if (kept[number[i]] < 0) {
      kept[number[i]] = static_cast<Index>(points.size());
      points.push_back(s.points[number[i]]);
    }
  }
  std::erase_if(s.segments, [&](Segment& segment) {
    const bool is_point = segment.kind == Kind::embedded && s.points[segment.a] == s.points[segment.b];
    segment.a = kept[number[segment.a]];
    segment.b = kept[number[segment.b]];
    return segment.a == segment.b && !is_point;
  });
  s.points = std::move(points);
}

Segments collect_segments(const PlanarDomain& domain) {
  Segments s;
  add_chains(domain.boundary, Kind::boundary, s);
  if (s.points.size() < 3)
    throw InputError(fmt::format("domain: the boundary has {} points, expected at least 3", s.points.size()));
  add_chains(domain.slits, Kind::slit, s);
  add_chains(domain.embedded, Kind::embedded, s);
  Vec<2> low = s.points[0], high = s.points[0];
  for (const Vec<2>& p : s.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  internal::require_extent<2>(low, high, "domain");
  internal::require_thickness<2>(low, high, "domain");
  s.tolerance = 1e-12 * (high - low).norm();
  merge_points(s);
  return s;
}

/// Pairs of segments whose boxes come within the tolerance of each other, in ascending order.
std::vector<std::pair<Index, Index>> close_pairs(const Segments& s) {
  using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 2, Index>;
  std::vector<Box> boxes;
  boxes.reserve(s.segments.size());
  for (std::size_t i = 0; i < s.segments.size(); ++i) {
    const Vec<2>&a = s.points[s.segments[i].a], &b = s.points[s.segments[i].b];
    const Vec<2> margin = Vec<2>::Constant(s.tolerance), low = a.cwiseMin(b) - margin, high = a.cwiseMax(b) + margin;
    boxes.emplace_back(CGAL::Bbox_2(low.x(), low.y(), high.x(), high.y()), static_cast<Index>(i));
  }
  std::vector<std::pair<Index, Index>> pairs;
  CGAL::box_self_intersection_d(boxes.begin(), boxes.end(), [&](const Box& a, const Box& b) {
    pairs.push_back(std::minmax({a.info(), b.info()}));
  });
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

/// Places where segments must be split: (segment, position along it, point).
struct Cut {
  Index segment;
  double position;
  Index point;
  friend bool operator<(const Cut& a, const Cut& b) {
    return a.segment != b.segment ? a.segment < b.segment : a.position < b.position;
  }
};

/// Position of point p along segment i if it touches the inside of the segment, else -1.
double position_inside(const Segments& s, Index i, Index p) {
  const Segment& segment = s.segments[i];
  if (segment.a == segment.b || p == segment.a || p == segment.b) return -1.0;
  const Vec<2> along = s.points[segment.b] - s.points[segment.a], to_p = s.points[p] - s.points[segment.a];
  const double position = along.dot(to_p) / along.squaredNorm();
  const bool touches = position > 0.0 && position < 1.0 && (to_p - position * along).norm() <= s.tolerance;
  return touches ? position : -1.0;
}

/// Splits both segments where they cross. Boundaries must not cross anything.
void cross(Segments& s, Index i, Index j, std::vector<Cut>& cuts) {
  const Segment &p = s.segments[i], &q = s.segments[j];
  const auto side = [&](const Segment& line, Index point) {
    return CGAL::orientation(to_cgal(s.points[line.a]), to_cgal(s.points[line.b]), to_cgal(s.points[point]));
  };
  if (side(p, q.a) * side(p, q.b) >= 0 || side(q, p.a) * side(q, p.b) >= 0) return;
  const Vec<2> u = s.points[p.b] - s.points[p.a], v = s.points[q.b] - s.points[q.a], w = s.points[q.a] - s.points[p.a];
  const double area = u.x() * v.y() - u.y() * v.x();
  const double along_p = (w.x() * v.y() - w.y() * v.x()) / area, along_q = (w.x() * u.y() - w.y() * u.x()) / area;
  const Vec<2> at = s.points[p.a] + along_p * u;
  if (p.kind == Kind::boundary || q.kind == Kind::boundary) {
    const auto label = [&](const Segment& segment) { return segment.name < 0 ? std::string() : s.names[segment.name]; };
    throw InputError(
        fmt::format("domain: segments of \"{}\" and \"{}\" cross at {}; a boundary must not cross anything", label(p),
                    label(q), show(at)));
  }
  cuts.push_back({i, along_p, static_cast<Index>(s.points.size())});
  cuts.push_back({j, along_q, static_cast<Index>(s.points.size())});
  s.points.push_back(at);
}

/// Splits segments where points of others lie on them and where slits and embedded chains cross, so that afterwards
/// segments meet at their ends only.
void resolve_contacts(Segments& s) {
  std::vector<Cut> cuts;
  for (const auto& [i, j] : close_pairs(s)) {
    const std::size_t before = cuts.size();
    for (const auto& [on, other] : {std::pair{i, j}, std::pair{j, i}})
      for (const Index p : {s.segments[other].a, s.segments[other].b})
        if (const double position = position_inside(s, on, p); position > 0.0) cuts.push_back({on, position, p});
    if (cuts.size() == before) cross(s, i, j, cuts);
  }
  if (cuts.empty()) return;
  std::sort(cuts.begin(), cuts.end());
  std::vector<Segment> pieces;
  auto cut = cuts.begin();
  for (Index i = 0; i < static_cast<Index>(s.segments.size()); ++i) {
    Segment rest = s.segments[i];
    for (; cut != cuts.end() && cut->segment == i; ++cut) {
      if (cut->point == rest.a) continue;
      pieces.push_back(rest);
      pieces.back().b = cut->point;
      rest.a = cut->point;
    }
    pieces.push_back(rest);
  }
  s.segments = std::move(pieces);
}

/// Segments that lie on each edge: rows by edge, edges ascending.
struct Edges {
  std::vector<std::pair<Index, Index>> keys;
  Ragged<Segment> segments;

  Index find(Index a, Index b) const {
    const std::pair<Index, Index> key = std::minmax(a, b);
    const auto it = std::lower_bound(keys.begin(), keys.end(), key);
    return it != keys.end() && *it == key ? static_cast<Index>(it - keys.begin()) : -1;
  }
  /// Whether the inside of the domain changes to its outside across the edge: the even-odd rule.
  bool is_boundary(Index edge) const {
    const auto row = segments[edge];
    return std::count_if(row.begin(), row.end(), [](const Segment& s) { return s.kind == Kind::boundary; }) % 2 == 1;
  }
};

Edges collect_edges(const Segments& s) {
  Edges edges;
  edges.segments.items = s.segments;
  auto& items = edges.segments.items;
  std::erase_if(items, [](const Segment& segment) { return segment.a == segment.b; });
  std::stable_sort(items.begin(), items.end(), [](const Segment& a, const Segment& b) { return a.key() < b.key(); });
  for (std::size_t i = 0; i < items.size(); ++i) {
    if (i == 0 || items[i].key() != items[i - 1].key()) {
      edges.keys.push_back(items[i].key());
      if (i > 0) edges.segments.offsets.push_back(static_cast<Index>(i));
    }
  }
  edges.segments.offsets.push_back(static_cast<Index>(items.size()));
  return edges;
}

void check_closed(const Segments& s, const Edges& edges) {
  std::vector<char> odd(s.points.size(), 0);
  for (Index e = 0; e < static_cast<Index>(edges.keys.size()); ++e)
    if (edges.is_boundary(e)) {
      odd[edges.keys[e].first] ^= 1;
      odd[edges.keys[e].second] ^= 1;
    }
  const auto loose = std::find(odd.begin(), odd.end(), 1);
  if (loose != odd.end())
    throw InputError(
        fmt::format("domain: the boundary is open, it has a loose end at {}", show(s.points[loose - odd.begin()])));
}

/// Triangulates the points and forces the edges. Returns the handle of every point.
std::vector<Cdt::Vertex_handle> insert(const Segments& s, const Edges& edges, Cdt& cdt) {
  std::vector<std::pair<Kernel::Point_2, VertexInfo>> points;
  for (std::size_t i = 0; i < s.points.size(); ++i)
    points.push_back({to_cgal(s.points[i]), {static_cast<Index>(i), -1}});
  cdt.insert(points.begin(), points.end());
  std::vector<Cdt::Vertex_handle> handles(s.points.size());
  for (auto v = cdt.finite_vertices_begin(); v != cdt.finite_vertices_end(); ++v) handles[v->info().input] = v;
  for (const auto& [a, b] : edges.keys) {
    try {
      cdt.insert_constraint(handles[a], handles[b]);
    } catch (const Cdt::Intersection_of_constraints_exception&) {
      throw InputError(
          fmt::format("domain: the segment from {} to {} crosses another", show(s.points[a]), show(s.points[b])));
    }
  }
  return handles;
}

/// Marks the faces inside the domain, walking in from infinity.
void mark_domain(const Edges& edges, Cdt& cdt) {
  CGAL::Unique_hash_map<Cdt::Face_handle, bool> seen(false, cdt.number_of_faces());
  std::vector<Cdt::Face_handle> stack{cdt.infinite_face()};
  seen[cdt.infinite_face()] = true;
  while (!stack.empty()) {
    const Cdt::Face_handle face = stack.back();
    stack.pop_back();
    for (int i = 0; i < 3; ++i) {
      const Cdt::Face_handle next = face->neighbor(i);
      if (seen[next]) continue;
      bool inside = face->is_in_domain();
      if (face->is_constrained(i) &&
          edges.is_boundary(edges.find(face->vertex(cdt.cw(i))->info().input, face->vertex(cdt.ccw(i))->info().input)))
        inside = !inside;
      next->set_in_domain(inside);
      seen[next] = true;
      stack.push_back(next);
    }
  }
}

double domain_area(const Cdt& cdt) {
  double area = 0.0;
  for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f)
    if (f->is_in_domain()) area += cdt.triangle(f).area();
  return area;
}

/// Something at abscissa(s) [low, high] in a row of the lattice.
struct Span {
  Index row;
  double low, high;
  friend bool operator<(const Span& a, const Span& b) {
    return std::tie(a.row, a.low, a.high) < std::tie(b.row, b.low, b.high);
  }
};

/// Points inside the domain that refinement would otherwise have to find one by one: a jittered hexagonal lattice,
/// clear of all segments by half its step.
class Lattice {
 public:
  Lattice(const Segments& s, const Edges& edges, double step) : step_(step), height_(step * std::sqrt(0.75)) {
    low_ = high_ = s.points[0];
    for (const Vec<2>& p : s.points) {
      low_ = low_.cwiseMin(p);
      high_ = high_.cwiseMax(p);
    }
    for (Index e = 0; e < static_cast<Index>(edges.keys.size()); ++e)
      if (edges.is_boundary(e)) add_crossings(s.points[edges.keys[e].first], s.points[edges.keys[e].second]);
    for (const Segment& segment : s.segments) add_shadow(s.points[segment.a], s.points[segment.b]);
    std::sort(crossings_.begin(), crossings_.end());
    std::sort(shadows_.begin(), shadows_.end());
  }

  std::vector<Kernel::Point_2> points() const {
    std::vector<Kernel::Point_2> out;
    std::mt19937_64 generator(1);
    const auto jitter = [&] { return 0.1 * step_ * (0x1p-52 * static_cast<double>(generator() >> 11) - 1.0); };
    auto shadow = shadows_.begin();
    double covered = 0.0;
    for (std::size_t k = 0; k + 1 < crossings_.size(); k += 2) {
      const Index row = crossings_[k].row;
      if (k == 0 || row != crossings_[k - 1].row) covered = low_.x();
      const double shift = row % 2 == 0 ? 0.0 : 0.5 * step_;
      const auto first = static_cast<Index>(std::ceil((crossings_[k].low - low_.x() - shift) / step_));
      for (Index column = first;; ++column) {
        const double x = low_.x() + shift + column * step_;
        if (x >= crossings_[k + 1].low) break;
        for (; shadow != shadows_.end() && std::tie(shadow->row, shadow->low) <= std::tie(row, x); ++shadow)
          if (shadow->row == row) covered = std::max(covered, shadow->high);
        if (!(x > covered)) continue;
        const double up = jitter(), along = jitter();  // drawn one by one: arguments are evaluated in any order
        out.emplace_back(x + along, ordinate(row) + up);
      }
    }
    return out;
  }

 private:
  double ordinate(Index row) const { return low_.y() + row * height_; }
  /// First row at or above y.
  Index row_above(double y) const { return static_cast<Index>(std::ceil((y - low_.y()) / height_)); }

  void add_crossings(Vec<2> a, Vec<2> b) {
    if (a.y() > b.y()) std::swap(a, b);
    for (Index row = std::max(0, row_above(a.y()) - 1); ordinate(row) < b.y(); ++row) {
      if (ordinate(row) < a.y()) continue;
      const double x = a.x() + (b.x() - a.x()) * (ordinate(row) - a.y()) / (b.y() - a.y());
      crossings_.push_back({row, x, x});
    }
  }

  /// Keeps the lattice away from a segment: the piece of it near a row hides the row there.
  void add_shadow(Vec<2> a, Vec<2> b) {
    if (a.y() > b.y()) std::swap(a, b);
    const double clearance = 0.6 * step_;  // half the step, and the jitter
    for (Index row = std::max(0, row_above(a.y() - clearance)); ordinate(row) <= b.y() + clearance; ++row) {
      const auto abscissa = [&](double y) {
        return b.y() > a.y() ? a.x() + (b.x() - a.x()) * std::clamp((y - a.y()) / (b.y() - a.y()), 0.0, 1.0) : a.x();
      };
      const double from = abscissa(ordinate(row) - clearance);
      const double to = b.y() > a.y() ? abscissa(ordinate(row) + clearance) : b.x();
      shadows_.push_back({row, std::min(from, to) - clearance, std::max(from, to) + clearance});
    }
  }

  double step_, height_;
  Vec<2> low_, high_;
  std::vector<Span> crossings_, shadows_;
};

/// Inserts points of the inside of the domain. Insertion changes faces at the new vertex only, so marks stay right.
void insert_inside(std::vector<Kernel::Point_2> points, Cdt& cdt) {
  CGAL::spatial_sort(points.begin(), points.end());
  Cdt::Face_handle hint;
  for (const Kernel::Point_2& p : points) {
    const Cdt::Vertex_handle v = cdt.insert(p, hint);
    auto face = cdt.incident_faces(v);
    const auto done = face;
    do face->set_in_domain(true);
    while (++face != done);
    hint = face;
  }
}

/// Midpoints of the edges that cut off a corner wider than a right angle with a single face. One element cannot follow
/// the stress in such a corner, where it may be infinite, and recovery, which compares it with that of other elements
/// around a point, does not see that: with one face at the wall of Cook's membrane errors are told half as large as
/// they are.
std::vector<Kernel::Point_2> across_wide_corners(const Cdt& cdt) {
  std::vector<Kernel::Point_2> points;
  for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f)
    for (int i = 0; i < 3; ++i) {
      const int j = Cdt::ccw(i), k = Cdt::cw(i);
      if (!f->is_in_domain() || f->is_constrained(i) || !f->is_constrained(j) || !f->is_constrained(k)) continue;
      const auto &corner = f->vertex(i)->point(), &a = f->vertex(j)->point(), &b = f->vertex(k)->point();
      const auto to_a = a - corner, to_b = b - corner;
      constexpr double wide = -0.1;  // cosine of 96 degrees: right ones are not meant, whatever their rounding
      if (to_a * to_b < wide * std::sqrt(to_a.squared_length() * to_b.squared_length()))
        points.push_back(CGAL::midpoint(a, b));
    }
  return points;
}

void refine(const Segments& segments, const Edges& edges, const TriangulateOptions& options, Cdt& cdt) {
  const double area = domain_area(cdt), expected = 4.0 * area / (options.size * options.size);
  if (!(area > 0.0)) throw InputError("domain: it is empty, no point has an odd number of boundary segments around it");
  // About 300 bytes to a triangle of CGAL's and of the mesh together.
  require_memory(300.0 * expected, fmt::format("domain: a mesh of size {} on an area of {:.4g}", options.size, area),
                 "use a larger size");
  if (expected > 1e8)
    throw InputError(
        fmt::format("domain: a size of {} on an area of {} takes about {:.1e} triangles, expected at most 1e8",
                    options.size, area, expected));
  // Edges of the lattice are at most 1.3 steps long, nearly all of them less than 1.2.
  insert_inside(Lattice(segments, edges, 0.8 * options.size).points(), cdt);
  const double sine = std::sin(options.min_angle * std::numbers::pi / 180.0);
  CGAL::Delaunay_mesher_2<Cdt, Criteria> mesher(cdt, Criteria(sine * sine, options.size));
  mesher.init(/*domain_specified=*/true);
  mesher.refine_mesh();
  insert_inside(across_wide_corners(cdt), cdt);
}

/// Vertices along a space-filling curve and cells by their first vertex: neighbours in space are neighbours in memory.
void number_mesh(Cdt& cdt, MeshData<2>& mesh) {
  std::vector<Cdt::Vertex_handle> vertices;
  Points<2> points(2, cdt.number_of_vertices());
  for (auto v = cdt.finite_vertices_begin(); v != cdt.finite_vertices_end(); ++v) {
    points.col(std::ssize(vertices)) << v->point().x(), v->point().y();
    vertices.push_back(v);
  }
  const std::vector<std::size_t> order = internal::along_curve<2>(points);
  for (std::size_t k = 0; k < order.size(); ++k) vertices[order[k]]->info().number = static_cast<Index>(k);
  mesh.vertices = points(Eigen::all, order);
  std::vector<std::array<Index, 4>> cells;  // vertices and region
  for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f) {
    if (!f->is_in_domain()) continue;
    std::array<Index, 4> cell;
    for (int i = 0; i < 3; ++i) cell[i] = f->vertex(i)->info().number;
    std::rotate(cell.begin(), std::min_element(cell.begin(), cell.begin() + 3), cell.begin() + 3);
    cell[3] = f->info().region;
    cells.push_back(cell);
  }
  std::sort(cells.begin(), cells.end(),
            [](const auto& a, const auto& b) { return std::tie(a[0], a[1], a[2]) < std::tie(b[0], b[1], b[2]); });
  mesh.cells.resize(3, static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size(); ++c)
    for (int i = 0; i < 3; ++i) mesh.cells(i, static_cast<Index>(c)) = cells[c][i];
  mesh.regions.clear();
  if (cells.empty() || cells.front()[3] < 0) return;  // a domain of one region
  for (const auto& cell : cells) mesh.regions.push_back(cell[3]);
}

/// Constrained edges at v, each as the face it belongs to and the index opposite to it.
template <class Body> void for_each_constrained_edge(const Cdt& cdt, Cdt::Vertex_handle v, const Body& body) {
  auto edge = cdt.incident_edges(v);
  const auto done = edge;
  do {
    if (!cdt.is_infinite(edge) && cdt.is_constrained(*edge)) body(*edge);
  } while (++edge != done);
}

Cdt::Vertex_handle other_end(const Cdt::Edge& edge, Cdt::Vertex_handle v) {
  const Cdt::Vertex_handle a = edge.first->vertex(Cdt::cw(edge.second)), b = edge.first->vertex(Cdt::ccw(edge.second));
  return a == v ? b : a;
}

/// Calls body(edge number, fine edge) for every fine edge that refinement made out of an edge. Vertices added on an
/// edge have exactly two constrained edges, so following them needs no geometry (split points are rounded).
template <class Body> void for_each_fine_edge(const Cdt& cdt, const std::vector<Cdt::Vertex_handle>& handles,
                                              const Edges& edges, const Body& body) {
  std::vector<Cdt::Edge> path;
  for (const Cdt::Vertex_handle start : handles)
    for_each_constrained_edge(cdt, start, [&](const Cdt::Edge& first) {
      path.assign(1, first);
      Cdt::Vertex_handle v = other_end(first, start), previous = start;
      while (v->info().input < 0) {
        Cdt::Vertex_handle next;
        for_each_constrained_edge(cdt, v, [&](const Cdt::Edge& edge) {
          if (other_end(edge, v) == previous) return;
          next = other_end(edge, v);
          path.push_back(edge);
        });
        previous = std::exchange(v, next);
      }
      if (v->info().input < start->info().input) return;  // comes again from its other end
      for (const Cdt::Edge& edge : path) body(edges.find(start->info().input, v->info().input), edge);
    });
}

/// Fills the groups of the mesh. Returns the fine edges of slits.
std::vector<std::array<Index, 2>> name_facets(const Cdt& cdt, const std::vector<Cdt::Vertex_handle>& handles,
                                              const Segments& s, const Edges& edges, MeshData<2>& mesh) {
  std::vector<std::array<Index, 2>> cut;
  for (const std::string& name : s.names) mesh.groups.push_back({name, {}});
  for_each_fine_edge(cdt, handles, edges, [&](Index number, const Cdt::Edge& edge) {
    const auto row = edges.segments[number];
    const Cdt::Vertex_handle a = edge.first->vertex(Cdt::cw(edge.second)),
                             b = edge.first->vertex(Cdt::ccw(edge.second));
    const std::array<Index, 2> facet{a->info().number, b->info().number};
    const int sides = edge.first->is_in_domain() + edge.first->neighbor(edge.second)->is_in_domain();
    const auto slit =
        std::find_if(row.begin(), row.end(), [](const Segment& segment) { return segment.kind == Kind::slit; });
    if (slit != row.end()) {
      if (sides == 0)
        throw InputError(fmt::format("domain: slit \"{}\" leaves the body at ({}, {})",
                                     slit->name < 0 ? "" : s.names[slit->name], a->point().x(), a->point().y()));
      cut.push_back(facet);
    }
    if (sides == 0) return;
    for (const Segment& segment : row)
      if (segment.name >= 0) mesh.groups[segment.name].facets.push_back(facet);
  });
  return cut;
}

/// Offsets of the fine edges that lie on chords.
BoundaryOffsets<2> offsets_of(const Cdt& cdt, const std::vector<Cdt::Vertex_handle>& handles, const Segments& s,
                              const Edges& edges, const MeshData<2>& mesh) {
  std::vector<std::pair<Vec<2>, Vec<2>>> found;
  const auto add = [&](const Vec<2>& x, const Chord& chord) {
    if (const Vec<2> offset = chord.offset(x); offset.norm() > 1e-9 * chord.bulge.norm()) found.emplace_back(x, offset);
  };
  if (!s.chords.empty())
    for_each_fine_edge(cdt, handles, edges, [&](Index number, const Cdt::Edge& edge) {
      const auto row = edges.segments[number];
      const auto curved = std::ranges::find_if(row, [](const Segment& segment) { return segment.chord >= 0; });
      if (curved == row.end()) return;
      const Vec<2> a = mesh.vertices.col(edge.first->vertex(Cdt::cw(edge.second))->info().number),
                   b = mesh.vertices.col(edge.first->vertex(Cdt::ccw(edge.second))->info().number);
      for (const Vec<2>& x : {a, b, edge_midpoint<2>(a, b)}) add(x, s.chords[curved->chord]);
    });
  const auto count = static_cast<Index>(found.size());
  BoundaryOffsets<2> out{Points<2>(2, count), Points<2>(2, count)};
  for (Index k = 0; k < count; ++k) {
    out.points.col(k) = found[k].first;
    out.offsets.col(k) = found[k].second;
  }
  return out;
}

/// Gives every face inside the domain the region beside the chains around it.
void mark_regions(const std::vector<Cdt::Vertex_handle>& handles, const Segments& s, const Edges& edges, Cdt& cdt) {
  for (auto f = cdt.all_faces_begin(); f != cdt.all_faces_end(); ++f) f->info().region = -1;
  std::vector<Cdt::Face_handle> stack;
  for_each_fine_edge(cdt, handles, edges, [&](Index number, const Cdt::Edge& edge) {
    const Segment& segment = edges.segments[number].front();
    const auto &a = edge.first->vertex(Cdt::ccw(edge.second))->point(),
               &b = edge.first->vertex(Cdt::cw(edge.second))->point();  // the face lies to the left of ab
    const Vec<2> along = s.points[segment.b] - s.points[segment.a];
    const bool same = along.x() * (b.x() - a.x()) + along.y() * (b.y() - a.y()) > 0.0;
    const Cdt::Face_handle left = edge.first, right = edge.first->neighbor(edge.second);
    for (const auto& [face, region] : {std::pair{left, same ? segment.left : segment.right},
                                       std::pair{right, same ? segment.right : segment.left}}) {
      if (!face->is_in_domain() || face->info().region >= 0) continue;
      face->info().region = region;
      stack.push_back(face);
    }
  });
  while (!stack.empty()) {
    const Cdt::Face_handle face = stack.back();
    stack.pop_back();
    for (int i = 0; i < 3; ++i) {
      const Cdt::Face_handle next = face->neighbor(i);
      if (face->is_constrained(i) || !next->is_in_domain() || next->info().region >= 0) continue;
      next->info().region = face->info().region;
      stack.push_back(next);
    }
  }
}

void check_options(const TriangulateOptions& options) {
  if (!(options.size > 0.0))
    throw InputError(fmt::format("triangulate: size is {}, expected a positive length", options.size));
  if (!(options.min_angle >= 0.0 && options.min_angle <= 20.7))
    throw InputError(fmt::format("triangulate: min_angle is {}, expected 0 to 20.7 degrees", options.min_angle));
}

}  // namespace

MeshData<2> internal::triangulate_regions(const PlanarRegions& plane, const TriangulateOptions& options) {
  check_options(options);
  Segments segments;
  segments.points = plane.points;
  for (const PlanarRegions::Chain& chain : plane.chains) {
    const bool boundary = (chain.left < 0) != (chain.right < 0);
    const Index name = boundary ? name_number(segments.names, chain.name) : -1;
    for (std::size_t k = 0; k + 1 < chain.points.size(); ++k)
      segments.segments.push_back({chain.points[k], chain.points[k + 1], boundary ? Kind::boundary : Kind::embedded,
                                   name, chain.left, chain.right});
  }
  const Edges edges = collect_edges(segments);
  check_closed(segments, edges);

  Cdt cdt;
  const auto handles = insert(segments, edges, cdt);
  mark_domain(edges, cdt);
  refine(segments, edges, options, cdt);
  mark_regions(handles, segments, edges, cdt);

  MeshData<2> mesh;
  number_mesh(cdt, mesh);
  name_facets(cdt, handles, segments, edges, mesh);
  std::vector<std::array<Index, 2>> boundary;
  for (const auto& group : mesh.groups) boundary.insert(boundary.end(), group.facets.begin(), group.facets.end());
  return cut_open<2>(std::move(mesh), boundary);  // opens nothing but vertices in which parts of the body touch
}

CurvedMesh<2> triangulate_curved(const PlanarDomain& domain, const TriangulateOptions& options) {
  check_options(options);
  Segments segments = collect_segments(domain);
  resolve_contacts(segments);
  const Edges edges = collect_edges(segments);
  check_closed(segments, edges);

  Cdt cdt;
  const auto handles = insert(segments, edges, cdt);
  mark_domain(edges, cdt);
  refine(segments, edges, options, cdt);

  MeshData<2> mesh;
  number_mesh(cdt, mesh);
  const auto cut = name_facets(cdt, handles, segments, edges, mesh);
  BoundaryOffsets<2> offsets = offsets_of(cdt, handles, segments, edges, mesh);
  return {cut_open<2>(std::move(mesh), cut), std::move(offsets)};
}

MeshData<2> triangulate_data(const PlanarDomain& domain, const TriangulateOptions& options) {
  return triangulate_curved(domain, options).mesh;
}

FineMesh<2> triangulate(const PlanarDomain& domain, const TriangulateOptions& options) {
  return FineMesh<2>(triangulate_data(domain, options));
}

namespace shapes {
namespace {

constexpr double pi = std::numbers::pi;

/// How finely an arc is sampled.
struct ArcSampling {
  double size;       // longest chord
  double sagitta;    // largest distance between chord and arc, over the wall or the radius if that is less; 0: any
  double thickness;  // of the wall beside it
};

/// A circular arc around `centre`, both ends included, of at least 16 chords a turn.
Polyline arc(std::string name, const Vec<2>& centre, double radius, double from, double to,
             const ArcSampling& sampling) {
  const double size = sampling.size;
  if (!(size > 0.0)) throw InputError(fmt::format("shape: size is {}, expected a positive length", size));
  if (!(sampling.sagitta >= 0.0 && sampling.sagitta < 1.0))
    throw InputError(fmt::format("shape: sagitta is {}, expected a share of the wall from 0 to 1", sampling.sagitta));
  constexpr double most = 1e7;
  const double angle = std::abs(to - from);
  double wanted = std::max(8.0 * angle / pi, angle * radius / size);
  if (sampling.sagitta > 0.0) {
    const double height = sampling.sagitta * std::min(1.0, sampling.thickness / radius);  // over the radius
    wanted = std::max(wanted, 0.5 * angle / std::acos(1.0 - height));
  }
  wanted = std::ceil(wanted - 1e-9);
  if (!(wanted <= most))
    throw InputError(fmt::format("shape: size {} makes {:.2g} chords of an arc of radius {}, expected no more than {}",
                                 size, wanted, radius, most));
  const int chords = static_cast<int>(wanted);
  Polyline out{std::move(name), {}};
  const double step = (to - from) / chords, height = radius * (1.0 - std::cos(0.5 * step));
  for (int k = 0; k <= chords; ++k) {
    const double at = from + (to - from) * k / chords, middle = at - 0.5 * step;
    out.points.push_back(centre + radius * Vec<2>(std::cos(at), std::sin(at)));
    if (k > 0) out.bulges.push_back(height * Vec<2>(std::cos(middle), std::sin(middle)));
  }
  return out;
}

Polyline circle(std::string name, const Vec<2>& centre, double radius, const ArcSampling& sampling) {
  Polyline out = arc(std::move(name), centre, radius, 0.0, 2.0 * pi, sampling);
  out.points.back() = out.points.front();
  return out;
}

/// Closed polygon whose k-th side (from corner k to the next) has the k-th name.
PlanarDomain polygon(const std::vector<Vec<2>>& corners, const std::vector<std::string>& names) {
  PlanarDomain domain;
  for (std::size_t k = 0; k < corners.size(); ++k)
    domain.boundary.push_back({names[k], {corners[k], corners[(k + 1) % corners.size()]}});
  return domain;
}

}  // namespace

PlanarDomain rectangle(double x0, double y0, double x1, double y1) {
  if (!(x0 < x1 && y0 < y1)) throw InputError(fmt::format("rectangle: [{}, {}] x [{}, {}] is empty", x0, x1, y0, y1));
  return polygon({{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}, {"bottom", "right", "top", "left"});
}

PlanarDomain quarter_plate_with_hole(double radius, double half_width, double size, double sagitta) {
  if (!(radius > 0.0 && radius < half_width))
    throw InputError(fmt::format("quarter plate: radius {} and half width {}, expected 0 < radius < half width", radius,
                                 half_width));
  PlanarDomain domain =
      polygon({{radius, 0.0}, {half_width, 0.0}, {half_width, half_width}, {0.0, half_width}, {0.0, radius}},
              {"bottom", "right", "top", "left", "hole"});
  domain.boundary.back() = arc("hole", {0.0, 0.0}, radius, 0.5 * pi, 0.0, {size, sagitta, half_width - radius});
  domain.boundary.back().points.front() = {0.0, radius};
  return domain;
}

PlanarDomain l_shape(double side) {
  if (!(side > 0.0)) throw InputError(fmt::format("l_shape: side is {}, expected a positive length", side));
  const double half = 0.5 * side;
  return polygon({{0.0, 0.0}, {side, 0.0}, {side, half}, {half, half}, {half, side}, {0.0, side}},
                 {"bottom", "right", "notch", "notch", "top", "left"});
}

PlanarDomain cook() {
  return polygon({{0.0, 0.0}, {48.0, 44.0}, {48.0, 60.0}, {0.0, 44.0}}, {"bottom", "right", "top", "left"});
}

PlanarDomain annulus(double inner, double outer, double size, double sagitta) {
  if (!(inner > 0.0 && inner < outer))
    throw InputError(fmt::format("annulus: radii {} and {}, expected 0 < inner < outer", inner, outer));
  const ArcSampling sampling{size, sagitta, outer - inner};
  return {
      .boundary = {circle("inner", {0.0, 0.0}, inner, sampling), circle("outer", {0.0, 0.0}, outer, sampling)},
  };
}

PlanarDomain slit_rectangle(double x0, double y0, double x1, double y1, Vec<2> a, Vec<2> b) {
  PlanarDomain domain = rectangle(x0, y0, x1, y1);
  domain.slits.push_back({"slit", {a, b}});
  return domain;
}

PlanarDomain plate_with_random_holes(double width, int count, double r_min, double r_max, double gap,
                                     std::uint64_t seed, double size, double sagitta) {
  if (!(r_min > 0.0 && r_min <= r_max && gap > 0.0 && 2.0 * (r_max + gap) < width && count >= 0))
    throw InputError(fmt::format(
        "holes: count {}, radii {} to {}, gap {} in width {}, expected 0 < r_min <= r_max, gap > 0, and room for one",
        count, r_min, r_max, gap, width));
  std::mt19937_64 generator(seed);
  const auto uniform = [&](double from, double to) {
    return from + (to - from) * 0x1p-53 * static_cast<double>(generator() >> 11);
  };
  std::vector<double> radii(count);
  for (double& r : radii) r = uniform(r_min, r_max);
  std::sort(radii.begin(), radii.end(), std::greater<>());  // the largest first: they find room most easily

  PlanarDomain domain = rectangle(0.0, 0.0, width, width);
  std::vector<Vec<2>> centres;
  for (const double r : radii) {
    const auto fits = [&](const Vec<2>& at) {
      for (std::size_t k = 0; k < centres.size(); ++k)
        if ((at - centres[k]).norm() < r + radii[k] + gap) return false;
      return true;
    };
    Vec<2> at;
    int attempts = 0;
    do {
      if (++attempts > 100000)
        throw InputError(fmt::format("holes: found room for {} of {} holes of radii {} to {} with gap {} in width {}",
                                     centres.size(), count, r_min, r_max, gap, width));
      at.x() = uniform(r + gap, width - r - gap);
      at.y() = uniform(r + gap, width - r - gap);
    } while (!fits(at));
    centres.push_back(at);
  }
  for (std::size_t k = 0; k < centres.size(); ++k) {
    double ligament = std::min({centres[k].x(), centres[k].y(), width - centres[k].x(), width - centres[k].y()});
    for (std::size_t other = 0; other < centres.size(); ++other)
      if (other != k) ligament = std::min(ligament, (centres[other] - centres[k]).norm() - radii[other]);
    domain.boundary.push_back(circle("holes", centres[k], radii[k], {size, sagitta, ligament - radii[k]}));
  }
  return domain;
}

}  // namespace shapes
}  // namespace efree
