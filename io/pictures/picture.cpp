// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/picture.hpp"

#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/pictures/internal/canvas.hpp"

#include <fmt/format.h>
#include <vtkColorTransferFunction.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkMath.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <vector>

namespace efree {
namespace {

using internal::Canvas;
using internal::Colour;
using Vec3 = Vec<3>;
using Triangle = std::array<Index, 3>;
using Segment = std::array<Index, 2>;

constexpr double width = Canvas::width, height = Canvas::height;
const Colour held_colour{0.86F, 0.08F, 0.10F}, load_colour{1.0F, 0.45F, 0.85F}, no_group{0.85F, 0.85F, 0.85F};
const double crease = std::cos(std::numbers::pi / 6.0);  ///< edges with a larger angle are drawn and not shaded over
constexpr double lift = 4.0;                             ///< of lines on faces towards the viewer [pixels]

/// Colours from dark blue over green to yellow, even in lightness so that they survive grey printing (viridis,
/// sampled).
class Scale {
 public:
  explicit Scale(const std::array<double, 2>& range) : range_(range) {
    vtkNew<vtkColorTransferFunction> stops;
    stops->AddRGBPoint(0, 0.267, 0.005, 0.329);
    stops->AddRGBPoint(1, 0.254, 0.265, 0.530);
    stops->AddRGBPoint(2, 0.164, 0.471, 0.558);
    stops->AddRGBPoint(3, 0.135, 0.659, 0.518);
    stops->AddRGBPoint(4, 0.478, 0.821, 0.318);
    stops->AddRGBPoint(5, 0.993, 0.906, 0.144);
    stops->GetTable(0.0, 5.0, size, table_[0].data());
    std::ranges::transform(table_, pixels_.begin(), Canvas::pixel);
  }
  const std::array<double, 2>& range() const { return range_; }
  /// 0 to 1 inside the range.
  Eigen::VectorXf places(const Vector& values) const {
    return ((values.array() - range_[0]) / (range_[1] - range_[0])).cast<float>();
  }
  const Colour& at(float place) const { return table_[entry(place)]; }
  Canvas::Pixel pixel_at(float place) const { return pixels_[entry(place)]; }

 private:
  std::array<double, 2> range_;
  static constexpr std::size_t size = 256;
  /// Also for NaN.
  static std::size_t entry(float place) {
    return place > 0.0F ? static_cast<std::size_t>(std::min(place, 0.9999F) * size) : 0;
  }
  std::array<Colour, size> table_{};
  std::array<Canvas::Pixel, size> pixels_{};
};

/// As many colours as wanted, neighbours in the list far apart in hue.
Colour distinct(Index i) {
  const double hue = std::fmod(0.58 + 0.618034 * i, 1.0);
  const double saturation = i % 3 == 1 ? 0.40 : 0.62, value = i % 3 == 2 ? 0.72 : 0.92;
  Vec3 rgb;
  vtkMath::HSVToRGB(hue, saturation, value, &rgb[0], &rgb[1], &rgb[2]);
  return rgb.cast<float>();
}
/// The same, behind others.
Colour pale(Index i) {
  return 1.0F - 0.4F * (1.0F - distinct(i));
}
Colour uncoloured(Index) {
  return {0.87F, 0.89F, 0.92F};
}
using Palette = Colour (*)(Index);

/// Triangles in space; in 2D all of the body, at z = 0.
struct Surface {
  Points<3> points;
  std::vector<Triangle> triangles;

  Vec3 normal(const Triangle& t) const {
    return (points.col(t[1]) - points.col(t[0])).cross(points.col(t[2]) - points.col(t[0]));
  }
};

using Box = Eigen::AlignedBox3d;
Box box_of(const Points<3>& points) {
  return {points.rowwise().minCoeff(), points.rowwise().maxCoeff()};
}
bool is_flat(const Box& box) {
  return box.sizes()[2] == 0.0;
}
std::string text_of(const Box& box) {
  const Vec3 s = box.sizes();
  return is_flat(box) ? fmt::format("{:.4g} x {:.4g}", s[0], s[1])
                      : fmt::format("{:.4g} x {:.4g} x {:.4g}", s[0], s[1], s[2]);
}

template <int Dim> Points<3> in_space(const Points<Dim>& points) {
  Points<3> out = Points<3>::Zero(3, points.cols());
  out.topRows(Dim) = points;
  return out;
}

/// Where the viewer stands: directions to the viewer and upwards, both of length one.
struct View {
  Vec3 towards = Vec3::UnitZ(), up = Vec3::UnitY();
  /// Rows: to the right, upwards, to the viewer.
  Mat<3> axes() const {
    Mat<3> rows;
    rows << up.cross(towards).transpose(), up.transpose(), towards.transpose();
    return rows;
  }
};

/// A view from above and from the side with the largest faces of the box; of its four sides the one that shows most of
/// the triangles `marked`.
View oblique(const Surface& surface, const std::vector<Triangle>& marked) {
  const Vec3 size = box_of(surface.points).sizes();
  const Vec3 area{size[1] * size[2], size[0] * size[2], size[0] * size[1]};
  const Vec3 share = 0.35 + 0.65 * area.array() / area.maxCoeff();
  std::array<Vec3, 4> directions;
  for (std::size_t side = 0; side < 4; ++side)
    directions[side] =
        Vec3((side % 2 ? -0.6 : 0.6) * share[0], (side < 2 ? -1.0 : 1.0) * share[1], 0.75 * share[2]).normalized();
  std::array<double, 4> seen{};
  for (const Triangle& t : marked)
    for (std::size_t side = 0; side < 4; ++side) seen[side] += std::max(0.0, surface.normal(t).dot(directions[side]));
  // Only a clear gain is worth leaving the usual side for.
  std::size_t best = 0;
  for (std::size_t side = 1; side < 4; ++side)
    if (seen[side] > 1.1 * seen[best]) best = side;
  View view{directions[best], {}};
  view.up = view.towards.cross(Vec3::UnitZ().cross(view.towards).normalized());
  return view;
}

/// Where things in space appear: a parallel projection.
class Projection {
 public:
  /// All `points` just fit into the viewport, which is given in pixels (left, bottom, right, top).
  Projection(const View& view, const std::vector<const Points<3>*>& points, const Eigen::Array4d& viewport)
      : axes_(view.axes()) {
    Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const Points<3>* some : points)
      for (Index p = 0; p < some->cols(); ++p) {
        const Vec3 x = axes_ * some->col(p);
        low = low.cwiseMin(x);
        high = high.cwiseMax(x);
      }
    const Eigen::Array2d room = viewport.tail<2>() - viewport.head<2>();
    const double widest = ((high - low).head<2>().array() / room).maxCoeff();
    scale_ = widest > 0.0 ? 1.0 / (1.08 * widest) : 1.0;
    offset_ << 0.5 * (viewport.head<2>() + viewport.tail<2>()), 0.0;
    offset_ -= 0.5 * scale_ * (low + high);
  }
  Canvas::Position operator()(const Vec3& x) const { return scale_ * (axes_ * x) + offset_; }
  Points<3> all(const Points<3>& points) const { return (scale_ * axes_ * points).colwise() + offset_; }
  const Mat<3>& axes() const { return axes_; }

 private:
  Mat<3> axes_;
  double scale_ = 1.0;
  Vec3 offset_;
};

/// How bright a matt face with that normal (in the viewer's axes, either sign) is in red, green and blue: a warm key
/// light from above, a bluish one from below, two weak ones from the sides and one from the viewer.
Colour lit(Vec3 normal) {
  struct Light {
    double elevation, azimuth;
    float strength;
    Colour colour;
  };
  constexpr float key = 0.85F;
  static const std::array<Light, 5> lights{{{50.0, 10.0, key, {1.0F, 0.972F, 0.902F}},
                                            {-75.0, -10.0, key / 2.2F, {0.908F, 0.933F, 1.0F}},
                                            {0.0, 110.0, key / 3.5F, {1.0F, 1.0F, 1.0F}},
                                            {0.0, -110.0, key / 3.5F, {1.0F, 1.0F, 1.0F}},
                                            {0.0, 0.0, key / 3.0F, {1.0F, 1.0F, 1.0F}}}};
  static const auto directions = [] {
    std::array<Vec3, 5> out;
    constexpr double degree = std::numbers::pi / 180.0;
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double e = lights[i].elevation * degree, a = lights[i].azimuth * degree;
      out[i] = {std::cos(e) * std::sin(a), std::sin(e), std::cos(e) * std::cos(a)};
    }
    return out;
  }();
  if (normal.z() < 0.0) normal = -normal;
  constexpr float ambient = 0.35F, diffuse = 0.75F;
  Colour sum = Colour::Constant(ambient);
  for (std::size_t i = 0; i < lights.size(); ++i)
    sum +=
        diffuse * lights[i].strength * static_cast<float>(std::max(0.0, normal.dot(directions[i]))) * lights[i].colour;
  return sum;
}

/// Unit normals at the corners of each triangle: means over those around a point that turn by less than a crease.
std::vector<std::array<Vec3, 3>> corner_normals(const Surface& surface) {
  std::vector<Vec3> normals;
  for (const Triangle& t : surface.triangles) normals.push_back(surface.normal(t).stableNormalized());
  std::vector<Index> begin(surface.points.cols() + 1, 0);
  for (const Triangle& t : surface.triangles)
    for (const Index p : t) ++begin[p + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<Index> around(begin.back()), next(begin.begin(), begin.end() - 1);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i)
    for (const Index p : surface.triangles[i]) around[next[p]++] = static_cast<Index>(i);
  std::vector<std::array<Vec3, 3>> out(surface.triangles.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const Index p = surface.triangles[i][k];
      Vec3 sum = Vec3::Zero();
      for (Index j = begin[p]; j < begin[p + 1]; ++j) {
        const double turn = normals[around[j]].dot(normals[i]);
        // Triangles of a surface from a file may face either way.
        if (std::abs(turn) >= crease) sum += std::copysign(1.0, turn) * normals[around[j]];
      }
      out[i][k] = sum.stableNormalized();
    }
  return out;
}

/// Edges of one triangle alone, and with `creases` those where two meet at an angle.
std::vector<Segment> edges_of(const Surface& surface, const std::vector<Triangle>& triangles, bool creases) {
  struct Side {
    Segment ends;
    Index triangle;
    bool operator<(const Side& other) const { return ends < other.ends; }
  };
  std::vector<Side> sides;
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const Index a = triangles[i][k], b = triangles[i][(k + 1) % 3];
      sides.push_back({{std::min(a, b), std::max(a, b)}, static_cast<Index>(i)});
    }
  std::sort(sides.begin(), sides.end());
  std::vector<Segment> out;
  for (std::size_t i = 0, end = 0; i < sides.size(); i = end) {
    while (end < sides.size() && sides[end].ends == sides[i].ends) ++end;
    const auto bent = [&] {
      const Vec3 one = surface.normal(triangles[sides[i].triangle]).stableNormalized();
      return std::abs(one.dot(surface.normal(triangles[sides[i + 1].triangle]).stableNormalized())) < crease;
    };
    if (end - i == 1 || (creases && end - i == 2 && bent())) out.push_back(sides[i].ends);
  }
  return out;
}

/// The chains of lines that are connected and longer than `least`.
std::vector<Segment> long_chains(const Points<3>& points, std::vector<Segment> lines, double least) {
  internal::DisjointSets sets(static_cast<Index>(points.cols()));
  for (const auto& [a, b] : lines) sets.join(a, b);
  const std::vector<Index> chain = std::move(sets).firsts();
  std::vector<double> total(chain.size(), 0.0);
  for (const auto& [a, b] : lines) total[chain[a]] += (points.col(b) - points.col(a)).norm();
  std::erase_if(lines, [&](const Segment& line) { return total[chain[line[0]]] < least; });
  return lines;
}

/// Edges that say something about the shape of a body in space: ends and creases but for short bits of these, and none
/// at all if most of it is rough, as the faces of voxels are.
std::vector<Segment> shape_edges(const Surface& surface) {
  const auto is_rough = [&](const std::vector<Segment>& lines) {
    return static_cast<double>(lines.size()) > 0.18 * static_cast<double>(surface.triangles.size());
  };
  const std::vector<Segment> edges = edges_of(surface, surface.triangles, true);
  if (!is_rough(edges)) return long_chains(surface.points, edges, 0.15 * box_of(surface.points).diagonal().norm());
  std::vector<Segment> ends = edges_of(surface, surface.triangles, false);
  return is_rough(ends) ? std::vector<Segment>{} : ends;
}

void draw_lines(Canvas& canvas, const Projection& at, const Points<3>& points, const std::vector<Segment>& lines,
                double line_width, const Colour& colour) {
  for (const auto& [a, b] : lines) canvas.line(at(points.col(a)), at(points.col(b)), line_width, colour, lift);
}

/// Triangles in one colour each, paint(i), unlit.
template <class Paint>
void draw_flat(Canvas& canvas, const Projection& at, const Surface& surface, const Paint& paint) {
  const Points<3> positions = at.all(surface.points);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto& [a, b, c] = surface.triangles[i];
    canvas.triangle({positions.col(a), positions.col(b), positions.col(c)}, paint(i));
  }
}

/// Shaded triangles of colour paint(i, place), where places(p) of points are interpolated.
template <class Paint> void draw_shaded(Canvas& canvas, const Projection& at, const Surface& surface,
                                        const Eigen::VectorXf& places, const Paint& paint) {
  const Points<3> positions = at.all(surface.points);
  const auto normals = corner_normals(surface);
  std::array<Canvas::Corner<4>, 3> corners;
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Index p = surface.triangles[i][k];
      corners[k].at = positions.col(p);
      corners[k].values << places[p], lit(at.axes() * normals[i][k]);
    }
    canvas.triangle<4>(corners, [&](const auto& v) { return Canvas::pixel(paint(i, v[0]) * v.template tail<3>()); });
  }
}

/// Triangles in the colours of a scale at `places` of points, unlit.
void draw_scaled(Canvas& canvas, const Projection& at, const Surface& surface, const Eigen::VectorXf& places,
                 const Scale& scale) {
  const Points<3> positions = at.all(surface.points);
  std::array<Canvas::Corner<1>, 3> corners;
  for (const Triangle& t : surface.triangles) {
    for (std::size_t k = 0; k < 3; ++k) corners[k] = {positions.col(t[k]), Eigen::Array<float, 1, 1>(places[t[k]])};
    canvas.triangle<1>(corners, [&](const auto& v) { return scale.pixel_at(v[0]); });
  }
}

/// A little solid at each of these places, a cube or a ball.
void draw_markers(Canvas& canvas, const Projection& at, const std::vector<Vec3>& places, double size, bool cubes,
                  const Colour& colour) {
  Surface marker;
  if (cubes) {
    // Faces of their own points, so that their edges stay sharp.
    std::vector<Vec3> points;
    for (int axis = 0; axis < 3; ++axis)
      for (const double side : {-0.5, 0.5}) {
        const auto first = static_cast<Index>(points.size());
        for (const auto& [a, b] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}) {
          Vec3 x = Vec3::Constant(side * size);
          x[(axis + 1) % 3] = a * size;
          x[(axis + 2) % 3] = b * size;
          points.push_back(x);
        }
        marker.triangles.push_back({first, first + 1, first + 2});
        marker.triangles.push_back({first, first + 2, first + 3});
      }
    marker.points = Eigen::Map<const Points<3>>(points.front().data(), 3, static_cast<Index>(points.size()));
  } else {
    constexpr Index around = 16, rings = 9;
    marker.points.resize(3, around * rings);
    for (Index ring = 0; ring < rings; ++ring)
      for (Index i = 0; i < around; ++i) {
        const double polar = std::numbers::pi * ring / (rings - 1), turn = 2.0 * std::numbers::pi * i / around;
        marker.points.col(ring * around + i) =
            0.55 * size * Vec3(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), std::cos(polar));
        if (ring == 0) continue;
        const Index a = ring * around + i, b = ring * around + (i + 1) % around;
        marker.triangles.push_back({a, b, a - around});
        marker.triangles.push_back({b, b - around, a - around});
      }
  }
  const auto paint = [&](std::size_t, float) { return colour; };
  for (const Vec3& place : places) {
    Surface here = marker;
    here.points.colwise() += place;
    draw_shaded(canvas, at, here, Eigen::VectorXf::Zero(here.points.cols()), paint);
  }
}

/// Points of these triangles, at most one to a cube of side `gap`.
std::vector<Vec3> sparse_points(const Surface& surface, const std::vector<Triangle>& triangles, double gap) {
  std::set<std::array<long, 3>> taken;
  std::vector<Vec3> points;
  for (const Triangle& t : triangles)
    for (const Index p : t) {
      const Vec3 x = surface.points.col(p);
      if (taken.insert({std::lround(x[0] / gap), std::lround(x[1] / gap), std::lround(x[2] / gap)}).second)
        points.push_back(x);
    }
  return points;
}

/// A coloured square and what it stands for; x, y in pixels.
void swatch(Canvas& canvas, const Colour& colour, const std::string& text, double x, double y, int size) {
  const double side = 0.8 * size;
  canvas.rectangle(x, y, x + side, y + side, colour);
  canvas.text(text, x + 1.5 * size, y, size);
}

/// Little axes as seen in `view`, in the lower right corner.
void draw_axes(Canvas& canvas, const View& view, bool solid) {
  const Colour grey = Colour::Constant(0.25F);
  const double length = solid ? 64.0 : 101.0;
  const Mat<3> axes = length * view.axes();
  const Vec3 centre{1480.0, 96.0, 0.0};
  const Vec3 origin = centre - axes * (solid ? Vec3(0.25, 0.25, 0.25) : Vec3(0.5, 0.5, 0.0));
  canvas.begin_layer();
  for (int k = 0; k < (solid ? 3 : 2); ++k) {
    const Vec3 tip = origin + axes.col(k), neck = origin + 0.8 * axes.col(k);
    canvas.line(origin, neck, 3.0, grey);
    constexpr int around = 24;
    const auto rim = [&](int i) -> Canvas::Position {
      const double turn = 2.0 * std::numbers::pi * i / around;
      return neck + 0.08 * (std::cos(turn) * axes.col((k + 1) % 3) + std::sin(turn) * axes.col((k + 2) % 3));
    };
    for (int i = 0; i < around; ++i) {
      canvas.triangle({tip, rim(i), rim(i + 1)}, grey);
      canvas.triangle({neck, rim(i), rim(i + 1)}, grey);
    }
    // Beside the tip, away from the shaft.
    const Vec3 outward = axes.col(k).head<2>().norm() > 0.0 ? Vec3(axes.col(k)).normalized() : Vec3::UnitX();
    canvas.text(std::string(1, "xyz"[k]), tip.x() + 12.0 * outward.x() - 6.0, tip.y() + 14.0 * outward.y() - 12.0, 26);
  }
}

/// What the colours span: all values, unless a few (one in 200) stand out of the others by half.
std::array<double, 2> colour_range(const Vector& values) {
  std::vector<double> finite(values.begin(), values.end());
  std::erase_if(finite, [](double v) { return !std::isfinite(v); });
  if (finite.empty()) return {0.0, 1.0};
  const auto [least, most] = std::minmax_element(finite.begin(), finite.end());
  std::array<double, 2> range{*least, *most};
  const auto usual = finite.begin() + static_cast<long>(0.995 * static_cast<double>(finite.size() - 1));
  std::nth_element(finite.begin(), usual, finite.end());
  if (range[1] > 1.5 * *usual && *usual > 0.0) range[1] = *usual;
  // A uniform field would have a scale of round-off.
  if (range[1] - range[0] <= 1e-6 * std::abs(range[1])) range = {0.0, range[1] > 0.0 ? 1.25 * range[1] : 1.0};
  return range;
}

void draw_scale(Canvas& canvas, const Scale& scale) {
  constexpr double left = 1393.0, right = 1440.0, bottom = 246.0, top = 1032.0;
  constexpr int steps = 64, labels = 6;
  for (int i = 0; i < steps; ++i)
    canvas.rectangle(left, bottom + (top - bottom) * i / steps, right, bottom + (top - bottom) * (i + 1) / steps,
                     scale.at((i + 0.5F) / steps));
  for (int i = 0; i < labels; ++i) {
    const double t = static_cast<double>(i) / (labels - 1);
    canvas.text(fmt::format("{:#.3g}", scale.range()[0] + t * (scale.range()[1] - scale.range()[0])), right + 2.0,
                bottom + t * (top - bottom) - 13.0, 26);
  }
}

/// Boundary facet f as triangles (lines in 2D) between places, in 3D facing outwards.
template <int Dim> auto facet_pieces(const FineSpace<Dim>& space, Index f) {
  using Piece = std::conditional_t<Dim == 3, Triangle, Segment>;
  std::vector<Index> dofs = space.facet(f);
  for (Index& dof : dofs) dof = space.place(dof, space.mesh().region(space.mesh().facet_cell(f)));
  if constexpr (Dim == 2) {
    if (space.degree() == 1) return std::vector<Piece>{{dofs[0], dofs[1]}};
    return std::vector<Piece>{{dofs[0], dofs[2]}, {dofs[2], dofs[1]}};
  } else {
    if (space.degree() == 1) return std::vector<Piece>{{dofs[0], dofs[1], dofs[2]}};
    const auto at = [&](Index place) { return space.points().col(space.dof_at(place)); };
    const auto between = [&](Index a, Index b) {
      const Vec3 middle = 0.5 * (at(a) + at(b));
      return *std::min_element(dofs.begin() + 3, dofs.end(), [&](Index m, Index n) {
        return (at(m) - middle).squaredNorm() < (at(n) - middle).squaredNorm();
      });
    };
    const Index ab = between(dofs[0], dofs[1]), bc = between(dofs[1], dofs[2]), ca = between(dofs[2], dofs[0]);
    return std::vector<Piece>{{dofs[0], ab, ca}, {ab, dofs[1], bc}, {ca, bc, dofs[2]}, {ab, bc, ca}};
  }
}

/// What to draw of the body: its skin, in 2D all of it.
template <int Dim> std::vector<Triangle> faces(const FineSpace<Dim>& space) {
  std::vector<Triangle> out;
  if constexpr (Dim == 3) {
    for (Index f = 0; f < space.mesh().num_facets(); ++f)
      for (const Triangle& t : facet_pieces(space, f)) out.push_back(t);
  } else {
    for (Index c = 0; c < space.mesh().num_cells(); ++c) {
      const auto d = space.places(c);
      if (space.degree() == 1)
        out.push_back({d[0], d[1], d[2]});
      else  // midpoints of edges (0, 1), (0, 2), (1, 2)
        out.insert(out.end(), {{d[0], d[3], d[4]}, {d[3], d[1], d[5]}, {d[4], d[5], d[2]}, {d[3], d[5], d[4]}});
    }
  }
  return out;
}

/// Pieces of the boundary where conditions hold.
template <int Dim, class Conditions> auto where(const FineSpace<Dim>& space, const Conditions& conditions) {
  std::set<Index> facets;
  for (const auto& condition : conditions)
    for (const Index f : space.mesh().group(condition.on)) facets.insert(f);
  decltype(facet_pieces(space, 0)) out;
  for (const Index f : facets)
    for (const auto& piece : facet_pieces(space, f)) out.push_back(piece);
  return out;
}

}  // namespace

namespace {

/// Values at the places of the space on the deformed body, under a title; `name` is what values beyond the scale are
/// called.
template <int Dim> void paint(const std::filesystem::path& file, const Settings<Dim>& settings,
                              const Result<Dim>& result, const Vector& values, const std::string& title,
                              const std::string& name) {
  constexpr bool solid = Dim == 3;
  const FineSpace<Dim>& space = result.basis().space;
  const Points<Dim> u = space.at_places(result.fields.displacement), x = space.at_places(space.points());
  const Surface undeformed{in_space<Dim>(x), faces(space)};
  const double length = box_of(undeformed.points).diagonal().norm();
  const double largest = u.colwise().norm().maxCoeff();
  double drawn = largest > 0.0 ? length / (15.0 * largest) : 0.0;
  if (!result.history.empty()) drawn = std::max(drawn, 1.0);  // large displacements as they are
  const Surface deformed{in_space<Dim>(x + drawn * u), undeformed.triangles};
  const auto held = where(space, settings.supports);
  const Loads<Dim> loads = loads_by_case(settings).front();  // those of the answer that is drawn
  auto loaded = where(space, loads.tractions);
  for (const auto& of : {where(space, loads.followers), where(space, loads.resultants)})
    loaded.insert(loaded.end(), of.begin(), of.end());

  View view;
  if constexpr (solid) {
    std::vector<Triangle> marked = held;
    marked.insert(marked.end(), loaded.begin(), loaded.end());
    view = oblique(undeformed, marked);
  }
  const Projection at(view, {&undeformed.points, &deformed.points},
                      {0.01 * width, 0.06 * height, 0.85 * width, 0.9 * height});
  Canvas canvas;
  // The undeformed body: a pale shadow that the deformed one always covers.
  const Colour shadow = Colour::Constant(0.92F), outline = Colour::Constant(0.68F), ink = Colour::Constant(0.1F);
  std::vector<Segment> ends;
  if constexpr (solid) {
    draw_flat(canvas, at, undeformed, [&](std::size_t) { return shadow; });
    draw_lines(canvas, at, undeformed.points, shape_edges(undeformed), 2.0, outline);
    ends = shape_edges(deformed);
  } else {
    for (Index f = 0; f < space.mesh().num_facets(); ++f)
      for (const Segment& s : facet_pieces(space, f)) ends.push_back(s);
    // Of pores in the plane it would show through those of the deformed body.
    draw_lines(canvas, at, undeformed.points, long_chains(undeformed.points, ends, length), 2.0, outline);
  }
  canvas.begin_layer();
  const Scale scale(colour_range(values));
  const Eigen::VectorXf places = scale.places(values);
  if constexpr (solid)
    draw_shaded(canvas, at, deformed, places, [&](std::size_t, float place) { return scale.at(place); });
  else
    draw_scaled(canvas, at, deformed, places, scale);
  draw_lines(canvas, at, deformed.points, ends, solid ? 1.5 : 2.0, ink);
  for (const auto& [part, colour, cubes] : {std::tuple{&held, &held_colour, true}, {&loaded, &load_colour, false}})
    if constexpr (solid) {
      // Lines along the rim and markers all over; held and loaded at once, they must not sit in each other.
      draw_lines(canvas, at, deformed.points, edges_of(deformed, *part, false), 4.0, *colour);
      draw_markers(canvas, at, sparse_points(deformed, *part, length / (cubes ? 30.0 : 25.0)), length / 130.0, cubes,
                   *colour);
    } else {
      draw_lines(canvas, at, deformed.points, *part, 7.0, *colour);
    }

  draw_scale(canvas, scale);
  canvas.text(fmt::format("{}, displacements drawn x {:.3g}", title, drawn), 50, 1140, 34);
  std::string facts = fmt::format("body {}, largest displacement {:.4g}", text_of(box_of(undeformed.points)), largest);
  if (const double peak = values.maxCoeff(); peak > scale.range()[1])
    facts += fmt::format(", largest {} {:.4g}, beyond the scale", name, peak);
  canvas.text(facts, 50, 1098, 26);
  double left = 50.0;
  if (!held.empty()) swatch(canvas, held_colour, "displacement prescribed", left, 24, 26), left += 420.0;
  if (!loaded.empty()) swatch(canvas, load_colour, "loaded", left, 24, 26), left += 200.0;
  if (largest > 0.0) swatch(canvas, Colour::Constant(0.85F), "undeformed", left, 24, 26);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

/// Means of the cells around each place, by volume.
template <int Dim> Vector means_at_places(const FineSpace<Dim>& space, const Vector& by_cell) {
  Vector values = Vector::Zero(space.num_places()), volumes = values;
  for (Index c = 0; c < space.mesh().num_cells(); ++c)
    for (const Index p : space.places(c)) values[p] += space.volume(c) * by_cell[c], volumes[p] += space.volume(c);
  return values.cwiseQuotient(volumes);
}

}  // namespace

template <int Dim>
void draw_fields(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result) {
  paint(file, settings, result, von_mises_at_places(result.fields), "von Mises stress", "stress");
}

template <int Dim>
void draw_error(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result) {
  std::string title = "Estimated error of the mesh";
  if (result.estimates) title += fmt::format(" ({:.2g} % of all in the energy norm)", 100.0 * result.estimates->mesh);
  paint(file, settings, result, means_at_places(result.basis().space, result.error_density), title, "error");
}

namespace {

/// Names with their colours in columns from (x, y) downwards, as many as there is room for.
template <class Part> void legend(Canvas& canvas, const std::string& title, const std::vector<Part>& parts,
                                  Palette palette, double x, double y, double right, double bottom) {
  constexpr int size = 22;
  constexpr double line = 1.4 * size;
  canvas.text(title, x, y, size + 2);
  std::size_t longest = 6;
  for (const Part& part : parts) longest = std::max(longest, std::min<std::size_t>(part.name.size(), 24));
  const double column = size * (2.2 + 0.52 * static_cast<double>(longest));
  const auto rows = static_cast<std::size_t>((y - bottom) / line);
  const std::size_t columns = std::max<std::size_t>(1, static_cast<std::size_t>((right - x) / column));
  const std::size_t room = rows * columns, shown = parts.size() <= room ? parts.size() : room - 1;
  for (std::size_t i = 0; i <= shown && i < parts.size(); ++i) {
    const double at_x = x + column * static_cast<double>(i / rows), at_y = y - line * static_cast<double>(i % rows + 1);
    const std::string& name = parts[i].name;
    if (i < shown)
      swatch(canvas, palette(static_cast<Index>(i)), name.size() > 24 ? name.substr(0, 23) + "..." : name, at_x, at_y,
             size);
    else
      canvas.text(fmt::format("and {} more", parts.size() - shown), at_x, at_y, size);
  }
}

/// The names of the parts that show most, each on the piece in the middle of what shows of it.
template <int Dim>
void draw_names(Canvas& canvas, const Projection& at, const Inspection<Dim>& in, const Points<3>& points, bool solid) {
  constexpr std::size_t most = 12;
  constexpr int size = 26;
  constexpr double slack = 10.0;  // pixels: lines are drawn a little in front
  struct Shown {
    double weight = 0.0;
    Vec3 middle = Vec3::Zero();
    std::vector<Vec3> pieces;
  };
  std::vector<Shown> parts(in.groups.size());
  for (const auto& piece : in.pieces) {
    if (piece.group < 0 || (piece.corners[2] >= 0) != solid) continue;
    std::vector<Vec3> corners;
    for (const Index c : piece.corners)
      if (c >= 0) corners.push_back(at(points.col(c)));
    const Vec3 a = corners[1] - corners[0], b = corners.back() - corners[0];
    const double weight = solid ? 0.5 * (a.x() * b.y() - a.y() * b.x()) : a.norm();  // what faces the viewer
    Vec3 middle = Vec3::Zero();
    for (const Vec3& corner : corners) middle += corner / static_cast<double>(corners.size());
    if (!(weight > 0.0) || (solid && !canvas.shows(middle, slack))) continue;
    Shown& part = parts[piece.group];
    part.weight += weight;
    part.middle += weight * middle;
    part.pieces.push_back(middle);
  }
  std::vector<std::size_t> order(parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::greater<>{}, [&](std::size_t g) { return parts[g].weight; });
  for (std::size_t k = 0; k < std::min(most, order.size()); ++k) {
    const Shown& part = parts[order[k]];
    const std::string& name = in.groups[order[k]].name;
    if (part.pieces.empty() || name.size() > 24) continue;
    const Vec3 middle = part.middle / part.weight;
    const Vec3 there = *std::ranges::min_element(part.pieces, {}, [&](const Vec3& x) { return (x - middle).norm(); });
    canvas.text(name, there.x() - 0.26 * size * static_cast<double>(name.size()), there.y() - 0.5 * size, size);
  }
}

}  // namespace

template <int Dim> void draw_pieces(const std::filesystem::path& file, const Inspection<Dim>& in) {
  using Piece = typename Inspection<Dim>::Piece;
  Surface surface{in_space<Dim>(in.points), {}};
  const bool solid = Dim == 3 && !is_flat(box_of(surface.points));  // surfaces are all there is of solids
  std::vector<const Piece*> piece_of;                               // by triangle
  std::vector<Segment> mesh_lines;
  Index num_faces = 0;
  bool pixels = false;
  for (const Piece& piece : in.pieces) {
    const auto& c = piece.corners;
    const bool quadrilateral = c[3] >= 0;
    if (c[2] < 0) continue;
    ++num_faces;
    pixels = pixels || quadrilateral;
    surface.triangles.push_back({c[0], c[1], c[2]});
    if (quadrilateral) surface.triangles.push_back({c[0], c[2], c[3]});
    piece_of.resize(surface.triangles.size(), &piece);
    for (std::size_t k = 0; k < 3; ++k) mesh_lines.push_back({c[k], c[(k + 1) % 3]});
  }
  // In the plane a face and its edges show both; in space each takes a picture of its own.
  struct Panel {
    bool regions;
  };
  std::vector<Panel> panels{{true}};
  if (solid && !in.groups.empty())
    panels = in.bodies.size() > 1 ? std::vector<Panel>{{true}, {false}} : std::vector<Panel>{{false}};
  const View view = solid ? oblique(surface, {}) : View{};
  const Palette palette = solid ? distinct : in.bodies.size() > 1 ? pale : uncoloured;
  const double top = 0.92 * height;
  const double bottom = (solid || !in.groups.empty() || in.bodies.size() > 1 ? 0.26 : 0.04) * height;
  Canvas canvas;
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const double panel = width / static_cast<double>(panels.size()), left = panel * static_cast<double>(i);
    const Projection at(view, {&surface.points}, {left + 0.01 * width, bottom, left + panel - 0.01 * width, top});
    const auto colour = [&](std::size_t t) -> Colour {
      const Index part = panels[i].regions ? piece_of[t]->region : piece_of[t]->group;
      return part < 0 ? no_group : palette(part);
    };
    if (solid)
      draw_shaded(canvas, at, surface, Eigen::VectorXf::Zero(surface.points.cols()),
                  [&](std::size_t t, float) { return colour(t); });
    else
      draw_flat(canvas, at, surface, colour);
    if (num_faces < 60000 && !pixels) draw_lines(canvas, at, surface.points, mesh_lines, 1.0, Colour::Constant(0.45F));
    if (solid)
      draw_lines(canvas, at, surface.points, shape_edges(surface), 2.0, Colour::Constant(0.1F));
    else
      for (const Piece& piece : in.pieces)
        if (const auto& c = piece.corners; c[1] >= 0 && c[2] < 0)
          draw_lines(canvas, at, surface.points, {{c[0], c[1]}}, 7.0,
                     piece.group < 0 ? no_group : distinct(piece.group));
    if (!solid || !panels[i].regions) draw_names(canvas, at, in, surface.points, solid);
    const std::string title = panels[i].regions ? "regions" : "boundary";
    const double right = left + panel - 30.0 - (i + 1 == panels.size() ? 0.13 * width : 0.0);
    if (solid || in.bodies.size() > 1) {
      if (panels[i].regions)
        legend(canvas, title, in.bodies, palette, 50.0 + left, bottom - 30.0, right, 10.0);
      else
        legend(canvas, title, in.groups, palette, 50.0 + left, bottom - 30.0, right, 10.0);
    }
    if (!solid && !in.groups.empty())
      legend(canvas, "boundary", in.groups, distinct, in.bodies.size() > 1 ? 0.5 * width : 50.0, bottom - 30.0,
             0.86 * width, 10.0);
  }
  canvas.text(fmt::format("body {}", text_of(box_of(surface.points))), 50, 1140, 32);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

namespace {

/// In the plane a polygon for a circle; in space the triangles of a sphere, with radius one: the fewer the more points
/// there are.
template <int Dim> Surface round_marker(Index points) {
  Surface marker;
  const Index around = Dim == 2 ? 16 : points > 200000 ? 4 : points > 20000 ? 6 : 10;
  const auto turn = [&](Index i) { return 2.0 * std::numbers::pi * i / around; };
  if constexpr (Dim == 2) {
    marker.points = Points<3>::Zero(3, around);
    for (Index i = 0; i < around; ++i) marker.points.col(i) << std::cos(turn(i)), std::sin(turn(i)), 0.0;
    for (Index i = 1; i + 1 < around; ++i) marker.triangles.push_back({0, i, i + 1});
  } else {
    const Index rings = around == 4 ? 3 : around == 6 ? 5 : 7;
    marker.points.resize(3, around * rings);
    for (Index ring = 0; ring < rings; ++ring)
      for (Index i = 0; i < around; ++i) {
        const double polar = std::numbers::pi * ring / (rings - 1);
        marker.points.col(ring * around + i) << std::sin(polar) * std::cos(turn(i)),
            std::sin(polar) * std::sin(turn(i)), std::cos(polar);
        if (ring == 0) continue;
        const Index a = ring * around + i, b = ring * around + (i + 1) % around;
        if (ring + 1 < rings) marker.triangles.push_back({a, b, a - around});
        if (ring > 1) marker.triangles.push_back({b, b - around, a - around});
      }
  }
  return marker;
}

/// Walls: in the plane lines with hatches behind them, in space squares, where they are seen from in front.
template <int Dim>
void draw_walls(Canvas& canvas, const Projection& at, const View& view, const MotionPicture<Dim>& picture) {
  const double reach = picture.view.diagonal().norm();
  const Vec<Dim> centre = picture.view.center();
  for (const OtmWall<Dim>& wall : picture.walls) {
    const Vec<Dim> foot = centre + (wall.level - centre.dot(wall.normal)) * wall.normal;
    if constexpr (Dim == 2) {
      const Vec<2> along(-wall.normal[1], wall.normal[0]);
      const auto place = [&](double s, double behind) {
        const Vec<2> x = foot + s * reach * along - behind * reach * wall.normal;
        return at(Vec3(x[0], x[1], 0.0));
      };
      canvas.line(place(-0.7, 0.0), place(0.7, 0.0), 4.0, Colour::Constant(0.3F));
      for (int k = -35; k < 35; ++k)
        canvas.line(place(0.02 * k, 0.02), place(0.02 * (k + 1), 0.0), 1.5, Colour::Constant(0.55F));
    } else {
      if (wall.normal.dot(view.towards) < 0.0) continue;
      const Vec3 one = wall.normal.unitOrthogonal() * 0.6 * reach, other = wall.normal.cross(one);
      const Canvas::Position a = at(foot - one - other), b = at(foot + one - other), c = at(foot + one + other),
                             d = at(foot - one + other);
      canvas.triangle({a, b, c}, Colour::Constant(0.86F));
      canvas.triangle({a, c, d}, Colour::Constant(0.86F));
    }
  }
}

/// In squares.
void draw_tools(Canvas& canvas, const Projection& at, const MotionPicture<2>& picture) {
  constexpr int squares = 400;
  const double size = 2.0 * picture.view.diagonal().norm() / squares;
  const Vec<2> low = picture.view.center() - Vec<2>::Constant(0.5 * size * squares);
  const auto place = [&](double i, double j) { return at(Vec3(low[0] + size * i, low[1] + size * j, 0.0)); };
  for (const auto& tool : picture.tools)
    for (int i = 0; i < squares; ++i)
      for (int j = 0; j < squares; ++j) {
        Vec<2> middle = low + size * Vec<2>(i + 0.5, j + 0.5);
        if (picture.axisymmetric) middle[0] = std::abs(middle[0]);
        if (!(tool(middle) < 0.0)) continue;
        canvas.triangle({place(i, j), place(i + 1, j), place(i + 1, j + 1)}, Colour::Constant(0.72F));
        canvas.triangle({place(i, j), place(i + 1, j + 1), place(i, j + 1)}, Colour::Constant(0.72F));
      }
}

/// Where a field is zero in a box.
Surface zero_surface(const ScalarField<3>& field, const Box& box) {
  constexpr int points = 64;  // along each axis
  const Vec3 step = box.sizes() / (points - 1);
  vtkNew<vtkFloatArray> values;
  values->SetNumberOfTuples(points * points * points);
  parallel_for(points, [&](Index k) {
    float* to = values->GetPointer(points * points * k);
    for (int j = 0; j < points; ++j)
      for (int i = 0; i < points; ++i) *to++ = static_cast<float>(field(box.min() + step.cwiseProduct(Vec3(i, j, k))));
  });
  vtkNew<vtkImageData> image;
  image->SetDimensions(points, points, points);
  image->SetOrigin(box.min().data());
  image->SetSpacing(step.data());
  image->GetPointData()->SetScalars(values);
  vtkNew<vtkFlyingEdges3D> contour;
  contour->SetInputData(image);
  contour->SetValue(0, 0.0);
  contour->ComputeNormalsOff();
  contour->ComputeScalarsOff();
  contour->Update();
  vtkPolyData* found = contour->GetOutput();
  Surface surface{Points<3>(3, found->GetNumberOfPoints()), {}};
  for (vtkIdType p = 0; p < found->GetNumberOfPoints(); ++p)
    found->GetPoint(p, surface.points.col(static_cast<Index>(p)).data());
  for (vtkIdType c = 0; c < found->GetNumberOfCells(); ++c) {
    const vtkIdType* corners = nullptr;
    vtkIdType count = 0;
    found->GetCellPoints(c, count, corners);
    surface.triangles.push_back(
        {static_cast<Index>(corners[0]), static_cast<Index>(corners[1]), static_cast<Index>(corners[2])});
  }
  return surface;
}

/// As far as there is room in the picture; bodies are seen through them.
void draw_tools(Canvas& canvas, const Projection& at, const MotionPicture<3>& picture) {
  const Vec3 room = Vec3::Constant(0.25 * picture.view.diagonal().norm());
  canvas.set_veiled(true);
  for (const auto& tool : picture.tools) {
    const Surface surface = zero_surface(tool, {picture.view.min() - room, picture.view.max() + room});
    draw_shaded(canvas, at, surface, Eigen::VectorXf::Zero(surface.points.cols()),
                [](std::size_t, float) { return Colour::Constant(0.72F); });
  }
  canvas.set_veiled(false);
}

}  // namespace

template <int Dim> void draw_motion(const std::filesystem::path& file, const MotionPicture<Dim>& picture) {
  constexpr bool solid = Dim == 3;
  const auto n = static_cast<Index>(picture.points.cols());
  Surface box{Points<3>::Zero(3, 1 << Dim), {}};
  for (int k = 0; k < 1 << Dim; ++k)
    for (int i = 0; i < Dim; ++i) box.points(i, k) = (k >> i & 1) != 0 ? picture.view.max()[i] : picture.view.min()[i];
  if (picture.axisymmetric)
    for (int k = 0; k < 1 << Dim; ++k)
      if (box.points(0, k) == picture.view.min()[0]) box.points(0, k) = -picture.view.max()[0];
  const View view = solid ? oblique(box, {}) : View{};
  const Projection at(view, {&box.points}, {0.01 * width, 0.06 * height, 0.85 * width, 0.9 * height});
  Canvas canvas;
  draw_walls(canvas, at, view, picture);
  draw_tools(canvas, at, picture);
  const Scale scale(colour_range(picture.values));
  const Eigen::VectorXf places = scale.places(picture.values);
  const Surface marker = round_marker<Dim>(n);
  std::vector<Vec3> normals;  // of the sphere's triangles
  for (const Triangle& t : marker.triangles)
    normals.push_back((marker.points.col(t[0]) + marker.points.col(t[1]) + marker.points.col(t[2])).normalized());
  Points<3> corners(3, marker.points.cols());
  for (const double side : picture.axisymmetric ? std::vector<double>{1.0, -1.0} : std::vector<double>{1.0})
    for (Index p = 0; p < n; ++p) {
      // As large as the point, and a little more: gaps between circles are no gaps.
      Mat<3> F = 0.8 * picture.size[p] * Eigen::Map<const Mat<3>>(picture.F.col(p).data());
      Vec3 middle = Vec3::Zero();
      middle.template head<Dim>() = picture.points.col(p);
      if (Dim == 2) F.col(2).setZero();
      F.row(0) *= side;
      middle[0] *= side;
      corners = at.all((F * marker.points).colwise() + middle);
      const Colour colour = scale.at(places[p]);
      const Mat<3> turned = solid ? Mat<3>(at.axes() * F.inverse().transpose()) : Mat<3>::Identity();
      for (std::size_t t = 0; t < marker.triangles.size(); ++t) {
        const auto& [a, b, c] = marker.triangles[t];
        Colour ink = colour;
        if (solid) {
          const Vec3 normal = (turned * normals[t]).stableNormalized();
          if (normal.z() < 0.0) continue;
          ink *= lit(normal);
        }
        canvas.triangle({corners.col(a), corners.col(b), corners.col(c)}, ink);
      }
    }
  draw_scale(canvas, scale);
  canvas.text(picture.title, 50, 1140, 34);
  canvas.text(picture.field, 1570.0 - 13.0 * static_cast<double>(picture.field.size()), 1060, 26);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

template void draw_motion<2>(const std::filesystem::path&, const MotionPicture<2>&);
template void draw_motion<3>(const std::filesystem::path&, const MotionPicture<3>&);
template void draw_error<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void draw_error<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);
template void draw_fields<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void draw_fields<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);
template void draw_pieces<2>(const std::filesystem::path&, const Inspection<2>&);
template void draw_pieces<3>(const std::filesystem::path&, const Inspection<3>&);

}  // namespace efree
