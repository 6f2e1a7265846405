// SPDX-License-Identifier: GPL-3.0-or-later
/// What stands beside a body in a picture: scales, axes, explanations of colours.
#pragma once

#include "efree/io/case/picture_options.hpp"
#include "efree/io/pictures/internal/colours.hpp"
#include "efree/io/pictures/internal/scene.hpp"

#include <string>

namespace efree::internal::drawing {

/// The field of a picture and its unit, above the scale.
void draw_label(Canvas& canvas, const PictureOptions& options);

/// A coloured square and what it stands for; x, y in pixels.
void swatch(Canvas& canvas, const Colour& colour, const std::string& text, double x, double y, int size);

/// Little axes as seen in `view`, in the lower right corner.
void draw_axes(Canvas& canvas, const View& view, bool solid);

/// The colours of a scale with their values, at the right.
void draw_scale(Canvas& canvas, const ColourScale& scale);

/// Triangles in the colours of a scale at `places` of points, unlit.
void draw_scaled(Canvas& canvas, const Projection& at, const Surface& surface, const Eigen::VectorXf& places,
                 const ColourScale& scale);

}  // namespace efree::internal::drawing
