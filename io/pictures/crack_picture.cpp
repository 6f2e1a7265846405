// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of bodies with cracks.
#include "efree/io/pictures/internal/annotations.hpp"
#include "efree/io/pictures/internal/colours.hpp"
#include "efree/io/pictures/internal/scene.hpp"
#include "efree/io/pictures/picture.hpp"

#include <vector>

namespace efree {
namespace {

using namespace internal::drawing;
using internal::Canvas, internal::Colour;

const Colour crack_colour{0.75F, 0.16F, 0.12F};

void draw_body(Canvas& canvas, const Projection& at, const CrackedMesh<2>& mesh, const Eigen::VectorXf& places,
               const ColourScale& scale) {
  Surface body{in_space<2>(mesh.current), {}};
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    body.triangles.push_back({mesh.cells(0, c), mesh.cells(1, c), mesh.cells(2, c)});
  draw_scaled(canvas, at, body, places, scale);
  std::vector<Segment> boundary, cracks;
  for (Index f = 0; f < mesh.surface.cols(); ++f)
    (mesh.is_crack[f] != 0 ? cracks : boundary).push_back({mesh.surface(0, f), mesh.surface(1, f)});
  draw_lines(canvas, at, body.points, boundary, 2.0, Colour::Constant(0.1F));
  draw_lines(canvas, at, body.points, cracks, 2.0, crack_colour);
}

void draw_body(Canvas& canvas, const Projection& at, const CrackedMesh<3>& mesh, const Eigen::VectorXf& places,
               const ColourScale& scale) {
  Surface body{mesh.current, {}};
  for (Index f = 0; f < mesh.surface.cols(); ++f)
    body.triangles.push_back({mesh.surface(0, f), mesh.surface(1, f), mesh.surface(2, f)});
  draw_shaded(canvas, at, body, places, [&](std::size_t triangle, float place) {
    return mesh.is_crack[triangle] != 0 ? crack_colour : scale.at(place);
  });
}

}  // namespace

template <int Dim> void draw_cracks(const std::filesystem::path& file, const CrackPicture<Dim>& picture) {
  constexpr bool solid = Dim == 3;
  const Surface box = corners_of(picture.view);
  const View view = solid ? best_view(box, {}) : View{};
  const Projection at(view, {&box.points}, {0.01 * width, 0.06 * height, 0.85 * width, 0.9 * height});
  Canvas canvas;
  const ColourScale scale(picture.range);
  draw_body(canvas, at, picture.mesh, scale.places(picture.values), scale);
  draw_scale(canvas, scale);
  canvas.fitted_text(picture.title, 50, 1140, 34, width - 100.0);
  canvas.text(picture.field, 1570.0 - 13.0 * static_cast<double>(picture.field.size()), 1060, 26);
  if (picture.mesh.crack_area > 0.0) swatch(canvas, crack_colour, "cracks", 50, 24, 26);
  draw_axes(canvas, view, solid);
  canvas.save(file);
}

template void draw_cracks<2>(const std::filesystem::path&, const CrackPicture<2>&);
template void draw_cracks<3>(const std::filesystem::path&, const CrackPicture<3>&);

}  // namespace efree
