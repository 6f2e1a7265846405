// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/body_picture.hpp"

#include "efree/io/pictures/internal/annotations.hpp"
#include "efree/io/pictures/internal/colours.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace efree::internal::drawing {
namespace {

const Colour held_colour{0.86F, 0.08F, 0.10F}, load_colour{1.0F, 0.45F, 0.85F};

/// A little cube at each of these places.
void draw_cubes(Canvas& canvas, const Projection& at, const std::vector<Vec3>& places, double size,
                const Colour& colour) {
  Surface cube;
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
      cube.triangles.push_back({first, first + 1, first + 2});
      cube.triangles.push_back({first, first + 2, first + 3});
    }
  cube.points = Eigen::Map<const Points<3>>(points.front().data(), 3, static_cast<Index>(points.size()));
  const auto paint = [&](std::size_t, float) { return colour; };
  for (const Vec3& place : places) {
    Surface here = cube;
    here.points.colwise() += place;
    draw_shaded(canvas, at, here, Eigen::VectorXf::Zero(here.points.cols()), paint);
  }
}

/// Points of these triangles, at most one to a cube of side `gap`.
std::vector<Vec3> sparse_points(const Surface& surface, const std::vector<Triangle>& triangles, double gap) {
  OnePerCube cubes(gap);
  std::vector<Vec3> points;
  for (const Triangle& t : triangles)
    for (const Index p : t)
      if (const Vec3 x = surface.points.col(p); cubes.take(x)) points.push_back(x);
  return points;
}

/// A ring around a place of the picture, and its name.
void draw_mark(Canvas& canvas, const Canvas::Position& at, const std::string& name) {
  constexpr double radius = 15.0;
  constexpr int around = 40;
  const auto rim = [&](int i) -> Canvas::Position {
    const double turn = 2.0 * std::numbers::pi * i / around;
    return {at.x() + radius * std::cos(turn), at.y() + radius * std::sin(turn), 0.0};
  };
  for (const auto& [pen, grey] : {std::pair{8.0, 1.0F}, {3.0, 0.0F}})
    for (int i = 0; i < around; ++i) canvas.line(rim(i), rim(i + 1), pen, Colour::Constant(grey));
  const double left = at.x() + 1.3 * radius, bottom = at.y() + 0.6 * radius;
  canvas.rectangle(left - 3.0, bottom, left + 16.0 * static_cast<double>(name.size()), bottom + 26.0,
                   Colour::Constant(1.0F));
  canvas.text(name, left, bottom, 26);
}

std::string text_of_place(const Vec3& x, bool solid) {
  return solid ? fmt::format("({:.4g}, {:.4g}, {:.4g})", x[0], x[1], x[2])
               : fmt::format("({:.4g}, {:.4g})", x[0], x[1]);
}

/// The largest, or smallest, of the values at points.
Peak peak_of(const Vector& values, const Points<3>& points, bool largest) {
  Index point = 0;
  const double value = largest ? values.maxCoeff(&point) : values.minCoeff(&point);
  return {value, points.col(point), point};
}

/// The body as it was and as it is.
template <int Dim> class DrawnBody {
 public:
  DrawnBody(const BodyPicture<Dim>& body, const PictureOptions& options)
      : body_(body), length_(box_of(body.undeformed.points).diagonal().norm()) {
    const double largest = largest_displacement();
    factor_ = largest > 0.0 ? length_ / (15.0 * largest) : 0.0;
    if (body.true_to_scale) factor_ = std::max(factor_, 1.0);
    if (options.deformation) factor_ = *options.deformation;
    moved_ = factor_ * body.displacement;
    deformed_ = {body.undeformed.points + moved_, body.undeformed.triangles, body.undeformed.skin};
  }
  double largest_displacement() const { return body_.displacement.colwise().norm().maxCoeff(); }
  double factor() const { return factor_; }
  const Surface& deformed() const { return deformed_; }
  /// The outer ends of the loads' arrows.
  Points<3> arrow_ends() const {
    Points<3> ends(3, std::ssize(body_.arrows));
    for (Index k = 0; k < ends.cols(); ++k) {
      const LoadArrow& arrow = body_.arrows[k];
      ends.col(k) = arrow.at + moved_.col(arrow.point) +
                    (arrow.presses ? -1.0 : 1.0) * arrow_length() * arrow.traction.stableNormalized();
    }
    return ends;
  }
  /// The undeformed body, a pale shadow that the deformed one always covers, and that one with its values.
  void draw(Canvas& canvas, const Projection& at, const ColourScale& scale) const {
    const Colour shadow = Colour::Constant(0.92F), outline = Colour::Constant(0.68F), ink = Colour::Constant(0.1F);
    const Surface& undeformed = body_.undeformed;
    std::vector<Segment> ends;
    if constexpr (Dim == 3) {
      draw_flat(canvas, at, undeformed, [&](std::size_t) { return shadow; });
      if (undeformed.skin == Skin::smooth) {
        draw_lines(canvas, at, undeformed.points, shape_edges(undeformed), 2.0, outline);
        ends = shape_edges(deformed_);
      }
    } else {
      ends = body_.rim;
      // Of pores in the plane it would show through those of the deformed body.
      draw_lines(canvas, at, undeformed.points, long_chains(undeformed.points, ends, length_), 2.0, outline);
    }
    canvas.begin_layer();
    const Eigen::VectorXf places = scale.places(body_.values);
    if constexpr (Dim == 3)
      draw_shaded(canvas, at, deformed_, places, [&](std::size_t, float place) { return scale.at(place); });
    else
      draw_scaled(canvas, at, deformed_, places, scale);
    draw_lines(canvas, at, deformed_.points, ends, Dim == 3 ? 1.5 : 2.0, ink);
  }
  /// Where it is held and loaded.
  void draw_conditions(Canvas& canvas, const Projection& at) const {
    for (const auto& [part, colour] : {std::pair{&body_.held, &held_colour}, {&body_.loaded, &load_colour}})
      if constexpr (Dim == 3)
        draw_lines(canvas, at, deformed_.points, edges_of(deformed_, *part, false), 4.0, *colour);
      else
        draw_lines(canvas, at, deformed_.points, *part, part == &body_.held ? 7.0 : 3.0, *colour);
    if constexpr (Dim == 3)
      draw_cubes(canvas, at, sparse_points(deformed_, body_.held, length_ / 30.0), length_ / 130.0, held_colour);
    draw_arrows(canvas, at, body_.arrows, moved_, arrow_length(), load_colour);
  }

 private:
  double arrow_length() const { return length_ / 14.0; }

  const BodyPicture<Dim>& body_;
  double length_, factor_ = 0.0;
  Points<3> moved_;
  Surface deformed_;
};

}  // namespace

template <int Dim> void draw_body(const std::filesystem::path& file, const BodyPicture<Dim>& body,
                                  const PictureOptions& options, const std::string& title) {
  constexpr bool solid = Dim == 3;
  const Surface& undeformed = body.undeformed;
  const DrawnBody<Dim> drawn(body, options);
  const Peak largest = body.largest.value_or(peak_of(body.values, undeformed.points, true)),
             smallest = body.smallest.value_or(peak_of(body.values, undeformed.points, false));
  View view;
  if constexpr (solid) {
    std::vector<Triangle> marked = body.held;
    marked.insert(marked.end(), body.loaded.begin(), body.loaded.end());
    view = options.view         ? view_from(*options.view)
           : largest.point >= 0 ? best_view(undeformed, marked, undeformed.points.col(largest.point))
                                : best_view(undeformed, marked);
  }
  const Points<3> arrow_ends = drawn.arrow_ends();
  const Projection at(view, {&undeformed.points, &drawn.deformed().points, &arrow_ends},
                      {0.01 * width, 0.06 * height, 0.85 * width, 0.87 * height});
  Canvas canvas;
  const ColourScale scale(options.range.value_or(colour_range(body.values)));
  drawn.draw(canvas, at, scale);

  std::string extremes;
  std::vector<std::pair<std::string, Canvas::Position>> marks;
  const auto describe = [&](const char* name, const char* mark, const Peak& peak) {
    extremes +=
        fmt::format("{}{} {:.4g} at {}", extremes.empty() ? "" : ", ", name, peak.value, text_of_place(peak.at, solid));
    constexpr double slack = 8.0;  // pixels
    const bool seen = peak.point >= 0 && canvas.shows(at(drawn.deformed().points.col(peak.point)), slack);
    if (seen)
      marks.emplace_back(mark, at(drawn.deformed().points.col(peak.point)));
    else
      extremes += peak.point < 0 ? " (inside)" : " (hidden in this view)";
  };
  if (largest.value > smallest.value) {
    describe("largest", "max", largest);
    if (smallest.value < 0.0) describe("smallest", "min", smallest);
  } else {
    extremes = fmt::format("{:.4g} everywhere", largest.value);
  }
  if (largest.value < scale.range()[0] || smallest.value > scale.range()[1]) extremes += "; all is beyond the colours";
  drawn.draw_conditions(canvas, at);

  canvas.begin_layer();
  for (const auto& [name, place] : marks) draw_mark(canvas, place, name);
  draw_scale(canvas, scale);
  draw_label(canvas, options);
  canvas.fitted_text(title, 50, 1140, 34, width - 100.0);
  canvas.text(
      fmt::format("displacements drawn x {:.3g}, the largest {:.4g}; body {}", drawn.factor(),
                  body.largest_displacement.value_or(drawn.largest_displacement()), text_of(box_of(undeformed.points))),
      50, 1098, 26);
  canvas.fitted_text(extremes, 50, 1062, 26, width - 100.0);
  double left = 50.0;
  if (!body.held.empty()) swatch(canvas, held_colour, "held, rigidly or by springs", left, 24, 26), left += 450.0;
  if (!body.loaded.empty()) swatch(canvas, load_colour, "loaded", left, 24, 26), left += 200.0;
  if (drawn.factor() > 0.0) swatch(canvas, Colour::Constant(0.85F), "undeformed", left, 24, 26);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

template void draw_body<2>(const std::filesystem::path&, const BodyPicture<2>&, const PictureOptions&,
                           const std::string&);
template void draw_body<3>(const std::filesystem::path&, const BodyPicture<3>&, const PictureOptions&,
                           const std::string&);

}  // namespace efree::internal::drawing
