// SPDX-License-Identifier: GPL-3.0-or-later
/// A picture of triangles, lines and texts, drawn in memory: needs no display and no graphics driver, and is the same
/// on every machine.
#pragma once

#include "efree/core/types.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace efree::internal {

using Colour = Eigen::Array3f;  ///< red, green, blue in 0 to 1

/// 1600 x 1200 pixels. Positions are in pixels, x to the right and y upwards from the lower left corner, z towards the
/// viewer: what is nearer hides what is farther, and of equals the later one hides the earlier.
class Canvas {
 public:
  static constexpr int width = 1600, height = 1200;
  using Position = Eigen::Vector3d;
  using Pixel = std::array<std::uint8_t, 3>;
  /// With what a triangle's colour is made of: N values, interpolated between its corners.
  template <int N> struct Corner {
    Position at;
    Eigen::Array<float, N, 1> values;
  };

  Canvas();

  /// What is drawn from now on hides all that was drawn so far, wherever it lies.
  void begin_layer() { ++layer_; }

  /// Whether triangles drawn from now on take every other sample only: what is behind them shines through.
  void set_veiled(bool veiled) { veiled_ = veiled; }

  /// Calls paint(values) for the pixel at each sample.
  template <int N, class Paint> void triangle(const std::array<Corner<N>, 3>& corners, const Paint& paint);
  void triangle(const std::array<Position, 3>& corners, const Colour& colour);
  /// A line with round ends, moved `lift` towards the viewer so that faces it lies on do not hide it.
  void line(const Position& from, const Position& to, double line_width, const Colour& colour, double lift = 0.0);
  /// A rectangle parallel to the sides of the picture.
  void rectangle(double left, double bottom, double right, double top, const Colour& colour);
  /// Whether nothing that is drawn hides a place by more than so much in depth.
  bool shows(const Position& at, double slack) const {
    const auto row = static_cast<int>(at.y() * rows_per_pixel), column = static_cast<int>(at.x());
    return row >= 0 && row < rows && column >= 0 && column < width &&
           depth(at.z() + slack) >= depths_[sample(row, column)];
  }
  /// In black in front of everything, on one line; x, y is the lower left corner of its box, `size` its height. Letters
  /// of the fonts are those of ASCII: others are written as nearly as these can, as ? where nothing comes near.
  void text(const std::string& words, double x, double y, int size);
  /// The same, smaller where it would be wider than so many pixels, and then cut.
  void fitted_text(std::string words, double x, double y, int size, double widest);

  /// Writes a PNG file. Throws InputError if that is not possible.
  void save(const std::filesystem::path& file) const;

  /// Clamped to 0 to 1.
  static Pixel pixel(const Colour& colour) {
    const Eigen::Array3f scaled = 255.0F * colour.max(0.0F).min(1.0F) + 0.5F;
    return {static_cast<std::uint8_t>(scaled[0]), static_cast<std::uint8_t>(scaled[1]),
            static_cast<std::uint8_t>(scaled[2])};
  }

 private:
  /// Each pixel has four samples in four rows, none above another (a rotated grid), so that steep and flat edges are
  /// smoothed alike.
  static constexpr int rows_per_pixel = 4, rows = rows_per_pixel * height;
  static constexpr std::array<double, rows_per_pixel> shift{0.375, 0.875, 0.125, 0.625};
  struct Text {
    std::string words;
    double x, y;
    int size;
  };

  /// Rows with samples between these heights, from the bottom.
  static std::pair<int, int> row_range(double low, double high) {
    return {std::max(0, static_cast<int>(std::ceil(std::max(low, 0.0) * rows_per_pixel - 0.5))),
            std::min(rows - 1, static_cast<int>(std::floor(std::min(high, 1.0 * height) * rows_per_pixel - 0.5)))};
  }
  static double height_of(int row) { return (row + 0.5) / rows_per_pixel; }
  /// Columns of that row with samples between left (included) and right.
  static std::pair<int, int> column_range(int row, double left, double right) {
    const double offset = shift[row % rows_per_pixel];
    return {std::max(0, static_cast<int>(std::ceil(std::max(left, 0.0) - offset))),
            std::min(width - 1, static_cast<int>(std::ceil(std::min(right, 1.0 * width) - offset)) - 1)};
  }
  static double place_of(int row, int column) { return column + shift[row % rows_per_pixel]; }
  static std::size_t sample(int row, int column) { return static_cast<std::size_t>(row) * width + column; }

  /// Of a letter, on average, over its height.
  static constexpr double letter_width = 0.55;

  /// How near a sample is, in the order of layers first; z is at most a few pictures deep.
  float depth(double z) const { return static_cast<float>(1e5 * layer_ + z); }

  std::vector<Pixel> colours_;  ///< by rows of samples, from the bottom
  std::vector<float> depths_;
  int layer_ = 1;
  bool veiled_ = false;
  std::vector<Text> texts_;
};

template <int N, class Paint> void Canvas::triangle(const std::array<Corner<N>, 3>& corners, const Paint& paint) {
  const Position &a = corners[0].at, &b = corners[1].at, &c = corners[2].at;
  const auto [first, last] = row_range(std::min({a.y(), b.y(), c.y()}), std::max({a.y(), b.y(), c.y()}));
  if (first > last) return;
  const Eigen::Vector2d ab = (b - a).head<2>(), ac = (c - a).head<2>();
  const double area = ab.x() * ac.y() - ab.y() * ac.x();
  if (area == 0.0) return;
  // Values and depth are planes over the picture.
  using Plane = Eigen::Array<float, N + 1, 1>;
  const auto all = [this](const Corner<N>& corner) {
    Plane plane;
    plane << corner.values, depth(corner.at.z());
    return plane;
  };
  const Plane start = all(corners[0]), to_b = all(corners[1]) - start, to_c = all(corners[2]) - start;
  const Plane along_x = (to_b * static_cast<float>(ac.y()) - to_c * static_cast<float>(ab.y())) / area;
  const Plane along_y = (to_c * static_cast<float>(ab.x()) - to_b * static_cast<float>(ac.x())) / area;
  for (int row = first; row <= last; ++row) {
    if (veiled_ && row % 2 != 0) continue;
    const double y = height_of(row);
    double left = width, right = 0.0;
    for (const auto& [p, q] : {std::pair<const Position&, const Position&>{a, b}, {b, c}, {c, a}}) {
      if ((p.y() <= y) == (q.y() <= y)) continue;
      // From the lower end whichever way the edge goes, so that triangles at an edge leave no gap.
      const Position &low = p.y() < q.y() ? p : q, &high = p.y() < q.y() ? q : p;
      const double x = low.x() + (y - low.y()) * (high.x() - low.x()) / (high.y() - low.y());
      left = std::min(left, x);
      right = std::max(right, x);
    }
    const auto [begin, end] = column_range(row, left, right);
    for (int column = begin; column <= end; ++column) {
      const Plane here =
          start + along_x * static_cast<float>(place_of(row, column) - a.x()) + along_y * static_cast<float>(y - a.y());
      float& nearest = depths_[sample(row, column)];
      if (here[N] < nearest) continue;
      nearest = here[N];
      colours_[sample(row, column)] = paint(here.template head<N>());
    }
  }
}

}  // namespace efree::internal
