// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of geometries.
#include "efree/io/pictures/internal/annotations.hpp"
#include "efree/io/pictures/internal/colours.hpp"
#include "efree/io/pictures/internal/scene.hpp"
#include "efree/io/pictures/picture.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <functional>
#include <numeric>
#include <string>
#include <vector>

namespace efree {
namespace {

using namespace internal::drawing;
using internal::Canvas, internal::Colour;

const Colour no_group{0.85F, 0.85F, 0.85F};

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
  const View view = solid ? best_view(surface, {}) : View{};
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

template void draw_pieces<2>(const std::filesystem::path&, const Inspection<2>&);
template void draw_pieces<3>(const std::filesystem::path&, const Inspection<3>&);

}  // namespace efree
