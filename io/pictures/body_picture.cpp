// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/body_picture.hpp"

#include "efree/io/pictures/internal/annotations.hpp"
#include "efree/io/pictures/internal/colours.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <tuple>
#include <utility>

namespace efree::internal::drawing {
namespace {

const Colour held_colour{0.86F, 0.08F, 0.10F}, load_colour{1.0F, 0.45F, 0.85F};

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

}  // namespace

template <int Dim> void draw_body(const std::filesystem::path& file, const BodyPicture<Dim>& body,
                                  const std::string& title, const std::string& name) {
  constexpr bool solid = Dim == 3;
  const Surface& undeformed = body.undeformed;
  const double length = box_of(undeformed.points).diagonal().norm();
  const double largest = body.displacement.colwise().norm().maxCoeff();
  double drawn = largest > 0.0 ? length / (15.0 * largest) : 0.0;
  if (body.true_to_scale) drawn = std::max(drawn, 1.0);
  const Surface deformed{undeformed.points + drawn * body.displacement, undeformed.triangles, undeformed.skin};

  View view;
  if constexpr (solid) {
    std::vector<Triangle> marked = body.held;
    marked.insert(marked.end(), body.loaded.begin(), body.loaded.end());
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
    if (undeformed.skin == Skin::smooth) {
      draw_lines(canvas, at, undeformed.points, shape_edges(undeformed), 2.0, outline);
      ends = shape_edges(deformed);
    }
  } else {
    ends = body.rim;
    // Of pores in the plane it would show through those of the deformed body.
    draw_lines(canvas, at, undeformed.points, long_chains(undeformed.points, ends, length), 2.0, outline);
  }
  canvas.begin_layer();
  const ColourScale scale(colour_range(body.values));
  const Eigen::VectorXf places = scale.places(body.values);
  if constexpr (solid)
    draw_shaded(canvas, at, deformed, places, [&](std::size_t, float place) { return scale.at(place); });
  else
    draw_scaled(canvas, at, deformed, places, scale);
  draw_lines(canvas, at, deformed.points, ends, solid ? 1.5 : 2.0, ink);
  for (const auto& [part, colour, cubes] :
       {std::tuple{&body.held, &held_colour, true}, {&body.loaded, &load_colour, false}})
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
  std::string facts = fmt::format("body {}, largest displacement {:.4g}", text_of(box_of(undeformed.points)),
                                  body.largest_displacement.value_or(largest));
  if (const double peak = body.largest_value.value_or(body.values.maxCoeff()); peak > scale.range()[1])
    facts += fmt::format(", largest {} {:.4g}, beyond the scale", name, peak);
  canvas.text(facts, 50, 1098, 26);
  double left = 50.0;
  if (!body.held.empty()) swatch(canvas, held_colour, "displacement prescribed", left, 24, 26), left += 420.0;
  if (!body.loaded.empty()) swatch(canvas, load_colour, "loaded", left, 24, 26), left += 200.0;
  if (largest > 0.0) swatch(canvas, Colour::Constant(0.85F), "undeformed", left, 24, 26);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

template void draw_body<2>(const std::filesystem::path&, const BodyPicture<2>&, const std::string&, const std::string&);
template void draw_body<3>(const std::filesystem::path&, const BodyPicture<3>&, const std::string&, const std::string&);

}  // namespace efree::internal::drawing
