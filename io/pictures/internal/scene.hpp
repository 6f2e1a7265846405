// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies in space and how a viewer sees them.
#pragma once

#include "efree/io/pictures/internal/canvas.hpp"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace efree::internal::drawing {

using Vec3 = Vec<3>;
using Triangle = std::array<Index, 3>;  ///< points
using Segment = std::array<Index, 2>;   ///< likewise

constexpr double width = Canvas::width, height = Canvas::height;

/// What triangles are of.
enum class Skin {
  smooth,  ///< a surface that may be open and face either way; normals between its creases are means
  faces    ///< the closed skin of flat faces, whose normals point outwards: faces turned away are hidden
};

/// Triangles in space; in 2D all of the body, at z = 0.
struct Surface {
  Points<3> points;
  std::vector<Triangle> triangles;
  Skin skin = Skin::smooth;

  Vec3 normal(const Triangle& t) const {
    return (points.col(t[1]) - points.col(t[0])).cross(points.col(t[2]) - points.col(t[0]));
  }
};

using Box = Eigen::AlignedBox3d;
inline Box box_of(const Points<3>& points) {
  return {points.rowwise().minCoeff(), points.rowwise().maxCoeff()};
}
/// Whether all of it lies at one z.
inline bool is_flat(const Box& box) {
  return box.sizes()[2] == 0.0;
}
/// Its edges as text.
std::string text_of(const Box& box);

/// Points of the plane at z = 0.
template <int Dim> Points<3> in_space(const Points<Dim>& points) {
  Points<3> out = Points<3>::Zero(3, points.cols());
  out.topRows(Dim) = points;
  return out;
}

/// The corners of a box, first those with the smallest last coordinate; no triangles.
template <int Dim> Surface corners_of(const Eigen::AlignedBox<double, Dim>& box) {
  Surface corners{Points<3>::Zero(3, 1 << Dim), {}};
  for (int k = 0; k < 1 << Dim; ++k)
    for (int i = 0; i < Dim; ++i) corners.points(i, k) = (k >> i & 1) != 0 ? box.max()[i] : box.min()[i];
  return corners;
}

/// Thins out places: takes one of those in each cube of space.
class OnePerCube {
 public:
  explicit OnePerCube(double side) : side_(side) {}
  /// Whether it is the first in its cube.
  bool take(const Vec3& x) {
    return taken_.insert({std::lround(x[0] / side_), std::lround(x[1] / side_), std::lround(x[2] / side_)}).second;
  }

 private:
  double side_;
  std::set<std::array<long, 3>> taken_;
};

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

/// From the angle about z, from the x axis on, and that above the xy plane [degrees]; z is upwards, or what is nearest
/// to it.
View view_from(const std::array<double, 2>& angles);

/// A view from above and from the side with the largest faces of the box. Of its four sides those from which `shown`, a
/// point of the surface, can be seen; if it can be seen from below only, from there; of these, and without any, the one
/// that shows most of the triangles `marked`.
View best_view(const Surface& surface, const std::vector<Triangle>& marked, const std::optional<Vec3>& shown = {});

/// Where things in space appear: a parallel projection.
class Projection {
 public:
  /// All `points` just fit into the viewport, which is given in pixels (left, bottom, right, top).
  Projection(const View& view, const std::vector<const Points<3>*>& points, const Eigen::Array4d& viewport);
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
Colour brightness(Vec3 normal);

/// Unit normals at the corners of each triangle: means over those around a point that turn by less than a crease.
std::vector<std::array<Vec3, 3>> corner_normals(const Surface& surface);

/// Edges of one triangle alone, and with `creases` those where two meet at an angle.
std::vector<Segment> edges_of(const Surface& surface, const std::vector<Triangle>& triangles, bool creases);

/// The chains of lines that are connected and longer than `least`.
std::vector<Segment> long_chains(const Points<3>& points, std::vector<Segment> lines, double least);

/// Edges that say something about the shape of a body in space: ends and creases but for short bits of these, and none
/// at all if most of it is rough, as the faces of voxels are.
std::vector<Segment> shape_edges(const Surface& surface);

/// Lines a little in front of the faces they lie on.
void draw_lines(Canvas& canvas, const Projection& at, const Points<3>& points, const std::vector<Segment>& lines,
                double line_width, const Colour& colour);

/// Whether a triangle's normal points towards the viewer.
inline bool faces_viewer(const std::array<Canvas::Position, 3>& corners) {
  const Vec3 ab = corners[1] - corners[0], ac = corners[2] - corners[0];
  return ab.x() * ac.y() > ab.y() * ac.x();
}

/// Triangles in one colour each, paint(i), unlit.
template <class Paint>
void draw_flat(Canvas& canvas, const Projection& at, const Surface& surface, const Paint& paint) {
  const Points<3> positions = at.all(surface.points);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto& [a, b, c] = surface.triangles[i];
    const std::array<Canvas::Position, 3> corners{positions.col(a), positions.col(b), positions.col(c)};
    if (surface.skin == Skin::smooth || faces_viewer(corners)) canvas.triangle(corners, paint(i));
  }
}

/// Shaded triangles of colour paint(i, place), where places(p) of points are interpolated.
template <class Paint> void draw_shaded(Canvas& canvas, const Projection& at, const Surface& surface,
                                        const Eigen::VectorXf& places, const Paint& paint) {
  const Points<3> positions = at.all(surface.points);
  const auto for_triangles = [&](auto& corners, const auto& draw) {
    for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) corners[k].at = positions.col(surface.triangles[i][k]);
      draw(i, surface.triangles[i]);
    }
  };
  if (surface.skin == Skin::faces) {
    std::array<Canvas::Corner<1>, 3> corners;
    for_triangles(corners, [&](std::size_t i, const Triangle& t) {
      if (!faces_viewer({corners[0].at, corners[1].at, corners[2].at})) return;
      const Colour light = brightness(at.axes() * surface.normal(t).stableNormalized());
      for (std::size_t k = 0; k < 3; ++k) corners[k].values << places[t[k]];
      canvas.triangle<1>(corners, [&](const auto& v) { return Canvas::pixel(paint(i, v[0]) * light); });
    });
    return;
  }
  const auto normals = corner_normals(surface);
  std::array<Canvas::Corner<4>, 3> corners;
  for_triangles(corners, [&](std::size_t i, const Triangle& t) {
    for (std::size_t k = 0; k < 3; ++k) corners[k].values << places[t[k]], brightness(at.axes() * normals[i][k]);
    canvas.triangle<4>(corners, [&](const auto& v) { return Canvas::pixel(paint(i, v[0]) * v.template tail<3>()); });
  });
}

}  // namespace efree::internal::drawing
