// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/canvas.hpp"

#include <gtest/gtest.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>
#include <filesystem>

using efree::internal::Canvas;
using efree::internal::Colour;

namespace {

const Colour red{1.0F, 0.0F, 0.0F}, green{0.0F, 1.0F, 0.0F};

/// What a canvas looks like once it is a file.
class Picture {
 public:
  explicit Picture(const Canvas& canvas) {
    const auto file = std::filesystem::temp_directory_path() /
                      ("efree_canvas_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    canvas.save(file);
    reader_->SetFileName(file.c_str());
    reader_->Update();
    std::filesystem::remove(file);
  }
  std::array<int, 3> at(int x, int y) const {
    const auto* p = static_cast<const unsigned char*>(reader_->GetOutput()->GetScalarPointer(x, y, 0));
    return {p[0], p[1], p[2]};
  }
  /// Sum of the ink over the picture, in pixels that are not white in `channel`.
  double ink(int channel) const {
    double sum = 0.0;
    for (int y = 0; y < Canvas::height; ++y)
      for (int x = 0; x < Canvas::width; ++x) sum += 1.0 - at(x, y)[static_cast<std::size_t>(channel)] / 255.0;
    return sum;
  }

 private:
  vtkNew<vtkPNGReader> reader_;
};

constexpr std::array<int, 3> is_white{255, 255, 255}, is_red{255, 0, 0}, is_green{0, 255, 0};

}  // namespace

TEST(Canvas, AreasAreCovered) {
  Canvas canvas;
  canvas.triangle({Canvas::Position{100.3, 100.2, 0.0}, {420.9, 131.7, 0.0}, {233.1, 580.4, 0.0}}, red);
  const double area = 0.5 * (320.6 * 480.2 - 31.5 * 132.8);
  EXPECT_NEAR(Picture(canvas).ink(1) / area, 1.0, 2e-3);
  Canvas strokes;
  strokes.line({300.0, 300.0, 0.0}, {700.0, 600.0, 0.0}, 20.0, red);  // 500 long, with half a disc at each end
  EXPECT_NEAR(Picture(strokes).ink(1) / (500.0 * 20.0 + 3.14159265 * 100.0), 1.0, 2e-3);
}

TEST(Canvas, TextsAreWrittenInAsciiAndFitTheirWidth) {
  const auto ink_of = [](const auto& write) {
    Canvas canvas;
    write(canvas);
    return Picture(canvas).ink(0);
  };
  const double micro = ink_of([](Canvas&canvas) { canvas.text("\u00b5m/\u00b2", 100.0, 100.0, 30); }),
               plain = ink_of([](Canvas&canvas) { canvas.text("um/^2", 100.0, 100.0, 30); });
  EXPECT_GT(plain, 100.0);
  EXPECT_EQ(micro, plain);
  Canvas canvas;
  canvas.fitted_text(std::string(300, 'm'), 100.0, 100.0, 30, 500.0);
  const Picture picture(canvas);
  double beyond = 0.0, within = 0.0;
  for (int y = 90; y < 140; ++y)
    for (int x = 100; x < Canvas::width; ++x) (x < 1100 ? within : beyond) += 255 - picture.at(x, y)[0];
  EXPECT_GT(within, 1000.0);
  EXPECT_EQ(beyond, 0.0);
}

TEST(Canvas, TrianglesAtAnEdgeLeaveNoGap) {
  Canvas canvas;
  // A fan around a point, clockwise and counterclockwise.
  const Canvas::Position centre{800.37, 600.73, 0.0};
  const auto rim = [&](int i) -> Canvas::Position {
    return centre + 400.0 * Canvas::Position(std::cos(0.1 * i), std::sin(0.1 * i), 0.0);
  };
  for (int i = 0; i < 63; ++i)
    if (i % 2)
      canvas.triangle({centre, rim(i), rim(i + 1)}, red);
    else
      canvas.triangle({rim(i + 1), rim(i), centre}, red);
  const Picture picture(canvas);
  for (int y = 400; y < 800; ++y)
    for (int x = 600; x < 1000; ++x) EXPECT_EQ(picture.at(x, y), is_red) << x << ' ' << y;
}

TEST(Canvas, WhatIsNearerHidesWhatIsFartherAndLaterLayersHideEarlierOnes) {
  Canvas canvas;
  const auto square = [&](double left, double z, const Colour& colour) {
    canvas.triangle({Canvas::Position{left, 100.0, z}, {left + 100.0, 100.0, z}, {left + 100.0, 200.0, z}}, colour);
    canvas.triangle({Canvas::Position{left, 100.0, z}, {left + 100.0, 200.0, z}, {left, 200.0, z}}, colour);
  };
  square(100.0, 5.0, red);
  square(150.0, 4.0, green);
  const Picture behind(canvas);
  EXPECT_EQ(behind.at(170, 150), is_red);
  EXPECT_EQ(behind.at(220, 150), is_green);
  EXPECT_EQ(behind.at(270, 150), is_white);
  canvas.begin_layer();
  square(50.0, -1000.0, green);
  EXPECT_EQ(Picture(canvas).at(120, 150), is_green);
  EXPECT_EQ(Picture(canvas).at(170, 150), is_red);
}

TEST(Canvas, WhatReachesBeyondThePictureIsCut) {
  Canvas canvas;
  canvas.triangle({Canvas::Position{-5000.0, -5000.0, 0.0}, {9000.0, -5000.0, 0.0}, {800.0, 9000.0, 0.0}}, red);
  canvas.line({-100.0, 600.0, 0.0}, {1e6, 600.0, 0.0}, 4.0, green, 1.0);
  canvas.text("beyond", 1590.0, -7.0, 26);
  const Picture picture(canvas);
  EXPECT_EQ(picture.at(0, 0), is_red);
  EXPECT_EQ(picture.at(0, 600), is_green);
  EXPECT_EQ(picture.at(1599, 600), is_green);
}
