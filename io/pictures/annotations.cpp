// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/annotations.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace efree::internal::drawing {

void draw_label(Canvas& canvas, const PictureOptions& options) {
  std::string label = options.field == "von_mises" ? "von Mises stress" : options.field;
  std::ranges::replace(label, '_', ' ');
  if (!options.unit.empty()) label += fmt::format(" [{}]", options.unit);
  constexpr double right = 1570.0, widest = 550.0, letter = 13.0;
  canvas.fitted_text(label, right - std::min(widest, letter * static_cast<double>(label.size())), 1092, 26, widest);
}

void swatch(Canvas& canvas, const Colour& colour, const std::string& text, double x, double y, int size) {
  const double side = 0.8 * size;
  canvas.rectangle(x, y, x + side, y + side, colour);
  canvas.text(text, x + 1.5 * size, y, size);
}

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

void draw_scale(Canvas& canvas, const ColourScale& scale) {
  constexpr double left = 1393.0, right = 1440.0, bottom = 246.0, top = 1032.0;
  constexpr int steps = 64, labels = 6;
  canvas.rectangle(left - 8.0, bottom - 20.0, width, top + 60.0, Colour::Constant(1.0F));
  for (int i = 0; i < steps; ++i)
    canvas.rectangle(left, bottom + (top - bottom) * i / steps, right, bottom + (top - bottom) * (i + 1) / steps,
                     scale.at((i + 0.5F) / steps));
  for (int i = 0; i < labels; ++i) {
    const double t = static_cast<double>(i) / (labels - 1);
    canvas.text(fmt::format("{:#.3g}", scale.range()[0] + t * (scale.range()[1] - scale.range()[0])), right + 2.0,
                bottom + t * (top - bottom) - 13.0, 26);
  }
}

void draw_scaled(Canvas& canvas, const Projection& at, const Surface& surface, const Eigen::VectorXf& places,
                 const ColourScale& scale) {
  const Points<3> positions = at.all(surface.points);
  std::array<Canvas::Corner<1>, 3> corners;
  for (const Triangle& t : surface.triangles) {
    for (std::size_t k = 0; k < 3; ++k) corners[k] = {positions.col(t[k]), Eigen::Array<float, 1, 1>(places[t[k]])};
    canvas.triangle<1>(corners, [&](const auto& v) { return scale.pixel_at(v[0]); });
  }
}

}  // namespace efree::internal::drawing
