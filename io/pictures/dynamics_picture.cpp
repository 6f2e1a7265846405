// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of explicit dynamics.
#include "efree/core/parallel.hpp"
#include "efree/io/pictures/internal/annotations.hpp"
#include "efree/io/pictures/internal/colours.hpp"
#include "efree/io/pictures/internal/scene.hpp"
#include "efree/io/pictures/picture.hpp"

#include <fmt/format.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <numbers>
#include <vector>

namespace efree {
namespace {

using namespace internal::drawing;
using internal::Canvas, internal::Colour;

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

/// Walls: in the plane lines with hatches behind them, in space squares, unless they are seen from behind.
template <int Dim>
void draw_walls(Canvas& canvas, const Projection& at, const View& view, const DynamicsPicture<Dim>& picture) {
  const double reach = picture.view.diagonal().norm();
  const Vec<Dim> centre = picture.view.center();
  for (const Wall<Dim>& wall : picture.walls) {
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

/// As pixels of a grid.
void draw_rigid_bodies(Canvas& canvas, const Projection& at, const DynamicsPicture<2>& picture) {
  constexpr int squares = 400;
  const double size = 2.0 * picture.view.diagonal().norm() / squares;
  const Vec<2> low = picture.view.center() - Vec<2>::Constant(0.5 * size * squares);
  const auto place = [&](double i, double j) { return at(Vec3(low[0] + size * i, low[1] + size * j, 0.0)); };
  for (const auto& body : picture.rigid_bodies)
    for (int i = 0; i < squares; ++i)
      for (int j = 0; j < squares; ++j) {
        Vec<2> middle = low + size * Vec<2>(i + 0.5, j + 0.5);
        if (picture.axisymmetric) middle[0] = std::abs(middle[0]);
        if (!(body(middle) < 0.0)) continue;
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

/// As far as there is room in the picture; transparent, and without what is seen from inside, as the lower side of a
/// plate above the bodies.
void draw_rigid_bodies(Canvas& canvas, const Projection& at, const View& view, const DynamicsPicture<3>& picture) {
  const Vec3 room = Vec3::Constant(0.25 * picture.view.diagonal().norm());
  canvas.set_veiled(true);
  for (const auto& body : picture.rigid_bodies) {
    Surface surface = zero_surface(body, {picture.view.min() - room, picture.view.max() + room});
    std::erase_if(surface.triangles, [&](const Triangle& t) {
      const Vec3 middle = (surface.points.col(t[0]) + surface.points.col(t[1]) + surface.points.col(t[2])) / 3.0;
      return body(middle + 1e-3 * room.norm() * view.towards) < 0.0;
    });
    draw_shaded(canvas, at, surface, Eigen::VectorXf::Zero(surface.points.cols()),
                [](std::size_t, float) { return Colour::Constant(0.72F); });
  }
  canvas.set_veiled(false);
}

/// Bodies with their outlines, in space with creases.
template <int Dim> void draw_skin(Canvas& canvas, const Projection& at, const BodySkin<Dim>& skin, double side,
                                  bool has_axis, const ColourScale& scale) {
  if (skin.triangles.empty()) return;
  Surface surface{in_space<Dim>(skin.nodes), skin.triangles};
  surface.points.row(0) *= side;
  const Eigen::VectorXf places = scale.places(skin.values);
  if constexpr (Dim == 3)
    draw_shaded(canvas, at, surface, places, [&](std::size_t, float place) { return scale.at(place); });
  else
    draw_scaled(canvas, at, surface, places, scale);
  auto ends = Dim == 3 ? shape_edges(surface) : edges_of(surface, surface.triangles, false);
  // The two halves of a section that is drawn on both sides have no edge on the axis.
  if (has_axis)
    std::erase_if(
        ends, [&](const Segment& of) { return surface.points(0, of[0]) == 0.0 && surface.points(0, of[1]) == 0.0; });
  draw_lines(canvas, at, surface.points, ends, 1.5, Colour::Constant(0.1F));
}

}  // namespace

template <int Dim> std::array<double, 2> range_of(const DynamicsPicture<Dim>& picture) {
  Vector all_values(picture.values.size() + picture.skin.values.size());
  all_values << picture.values, picture.skin.values;
  return colour_range(all_values);
}

template <int Dim> void draw_dynamics(const std::filesystem::path& file, const DynamicsPicture<Dim>& picture) {
  constexpr bool solid = Dim == 3;
  const auto n = static_cast<Index>(picture.points.cols());
  Surface box = corners_of(picture.view);
  if (picture.axisymmetric)
    for (int k = 0; k < 1 << Dim; ++k)
      if (box.points(0, k) == picture.view.min()[0]) box.points(0, k) = -picture.view.max()[0];
  const View view = !solid ? View{} : picture.options.view ? view_from(*picture.options.view) : best_view(box, {});
  const Projection at(view, {&box.points}, {0.01 * width, 0.06 * height, 0.85 * width, 0.9 * height});
  Canvas canvas;
  draw_walls(canvas, at, view, picture);
  if constexpr (solid)
    draw_rigid_bodies(canvas, at, view, picture);
  else
    draw_rigid_bodies(canvas, at, picture);
  const ColourScale scale(picture.options.range.value());
  const Eigen::VectorXf places = scale.places(picture.values);
  const std::vector<double> sides = picture.axisymmetric ? std::vector<double>{1.0, -1.0} : std::vector<double>{1.0};
  for (const double side : sides) draw_skin(canvas, at, picture.skin, side, picture.axisymmetric, scale);
  const Surface marker = round_marker<Dim>(n);
  std::vector<Vec3> normals;  // of the sphere's triangles
  for (const Triangle& t : marker.triangles)
    normals.push_back((marker.points.col(t[0]) + marker.points.col(t[1]) + marker.points.col(t[2])).normalized());
  Points<3> corners(3, marker.points.cols());
  for (const double side : sides)
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
          ink *= brightness(normal);
        }
        canvas.triangle({corners.col(a), corners.col(b), corners.col(c)}, ink);
      }
    }
  canvas.begin_layer();
  draw_scale(canvas, scale);
  canvas.fitted_text(picture.title, 50, 1140, 34, width - 100.0);
  draw_label(canvas, picture.options);
  canvas.text(fmt::format("from {:.4g} to {:.4g}", picture.extremes[0], picture.extremes[1]), 50, 1098, 26);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

template std::array<double, 2> range_of<2>(const DynamicsPicture<2>&);
template std::array<double, 2> range_of<3>(const DynamicsPicture<3>&);
template void draw_dynamics<2>(const std::filesystem::path&, const DynamicsPicture<2>&);
template void draw_dynamics<3>(const std::filesystem::path&, const DynamicsPicture<3>&);

}  // namespace efree
