// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of results.
#include "efree/io/pictures/internal/annotations.hpp"
#include "efree/io/pictures/internal/colours.hpp"
#include "efree/io/pictures/internal/scene.hpp"
#include "efree/io/pictures/picture.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <vector>

namespace efree {
namespace {

using namespace internal::drawing;
using internal::Canvas, internal::Colour;

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
  const ColourScale scale(colour_range(values));
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

template void draw_error<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void draw_error<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);
template void draw_fields<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void draw_fields<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);

}  // namespace efree
