// SPDX-License-Identifier: GPL-3.0-or-later
/// Faces of voxels between material and void, and on the frame.
#include "efree/geometry/input/image_boundary.hpp"

#include "efree/tests/geometry/meshes.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>

namespace efree {
namespace {

LabelImage<3> voxels(Index n, const std::function<bool(const Vec<3>&)>& is_material) {
  LabelImage<3> image;
  image.size = {n, n, n};
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) image.labels.push_back(is_material(Vec<3>(i + 0.5, j + 0.5, k + 0.5)) ? 1 : 0);
  return image;
}
LabelImage<3> ball_of_void(double radius) {
  return voxels(32, [=](const Vec<3>& x) { return (x - Vec<3>(16.1, 15.8, 16.3)).norm() > radius; });
}

TEST(ImageBoundary, HasSidesOfTheFrameAndPores) {
  const LabelImage<3> image =
      voxels(4, [](const Vec<3>& x) { return x[2] < 3.0 && (x - Vec<3>(1.5, 1.5, 1.5)).norm() > 0.1; });
  const ImageBoundary boundary(image);
  EXPECT_EQ(boundary.named("bottom").size(), 16u);
  EXPECT_EQ(boundary.named("left").size(), 12u);
  EXPECT_TRUE(boundary.named("top").empty());
  EXPECT_EQ(boundary.named("pores").size(), 16u + 6u);
  EXPECT_EQ(boundary.facets().size(), 16u + 4 * 12u + 16u + 6u);
  EXPECT_TRUE(std::ranges::is_sorted(boundary.facets()));
  EXPECT_INPUT_ERROR(boundary.named("inside"), "there is no boundary \"inside\"; the image has \"left\"");
}

TEST(ImageBoundary, AreasOfSpheresAndTiltedPlanesAreNotThoseOfTheirSteps) {
  for (const double radius : {5.0, 8.0, 12.0}) {
    const LabelImage<3> image = ball_of_void(radius);
    const double exact = 4.0 * M_PI * radius * radius;
    EXPECT_NEAR(surface_area(image, ImageBoundary(image).named("pores")) / exact, 1.0, 0.02) << radius;
  }
  // Away from the frame, where a plane ends.
  for (const Vec<3>& n : {Vec<3>(1, 0.5, 0.2), Vec<3>(1, 1, 1), Vec<3>(0.1, 0.05, 1), Vec<3>(1, 0, 1)}) {
    const Vec<3> normal = n.normalized();
    const LabelImage<3> image =
        voxels(40, [&](const Vec<3>& x) { return normal.dot(x - Vec<3>::Constant(20.0)) < 0.0; });
    const ImageBoundary boundary(image);
    double area = 0.0;
    Vec<3> vector = Vec<3>::Zero();
    for (const VoxelFacet& facet : boundary.select(InBox<3>{Vec<3>::Constant(10.0), Vec<3>::Constant(30.0)})) {
      area += facet.sign() * smooth_normal(image, facet)[facet.axis()];
      vector += facet.sign() * Vec<3>::Unit(facet.axis());
    }
    EXPECT_NEAR(area / normal.dot(vector), 1.0, 0.02) << n.transpose();
  }
}

TEST(ImageBoundary, SmoothedNormalsOfASphereAreRadialAndSelectWhatFacesADirection) {
  const LabelImage<3> image = ball_of_void(10.0);
  const ImageBoundary boundary(image);
  double worst = 1.0, area = 0.0;
  const auto facing = boundary.select(Facing<3>{{0, 0, -1}, 60.0});
  for (const VoxelFacet& facet : boundary.named("pores")) {
    const std::size_t v = facet.voxel();
    const Vec<3> x(v % 32 + 0.5, v / 32 % 32 + 0.5, v / 1024 + 0.5);
    worst = std::min(worst, smooth_normal(image, facet).dot((Vec<3>(16.1, 15.8, 16.3) - x).normalized()));
  }
  EXPECT_GT(worst, std::cos(14.0 * M_PI / 180.0));
  std::vector<VoxelFacet> above;
  for (const VoxelFacet& facet : facing)
    if (!is_on_frame(image, facet)) above.push_back(facet);
  area = surface_area(image, above);
  EXPECT_NEAR(area, 2.0 * M_PI * 100.0 * 0.5, 0.04 * M_PI * 100.0) << "a cap of 60 degrees";
}

TEST(ImageBoundary, PatchesFollowCurvedWallsAndEndAtEdges) {
  const LabelImage<3> image = ball_of_void(9.0);
  const ImageBoundary boundary(image);
  EXPECT_EQ(boundary.select(NearestPatch<3>{{16, 16, 16}}), boundary.named("pores"));
  EXPECT_EQ(boundary.select(NearestPatch<3>{{16, 16, 40}}), boundary.named("top"));
  // A step: its tread has the nearest facet, its riser and the top are other patches.
  const LabelImage<3> step = voxels(16, [](const Vec<3>& x) { return x[2] < 6.0 || x[0] < 8.0; });
  const ImageBoundary of_step(step);
  EXPECT_EQ(of_step.select(NearestPatch<3>{{12, 8, 7}}), of_step.select(OnPlane<3>{{0, 0, 6}, {0, 0, 1}}));
}

TEST(ImageBoundary, SelectionsAreInTheWorldWhereTheImageIsTurned) {
  LabelImage<3> image = ball_of_void(9.0);
  image.spacing = {1.0, 0.5, 2.0};
  const ImageBoundary straight(image);
  const auto by_plane = straight.select(OnPlane<3>{{3, 0, 0}, {1, 0, 0}, 3.5});
  const auto by_normal = straight.select(Facing<3>{{1, 2, 3}, 40.0});
  image.axes = Eigen::AngleAxisd(0.7, Vec<3>(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
  const ImageBoundary turned(image);
  EXPECT_EQ(turned.select(OnPlane<3>{image.axes * Vec<3>(3, 0, 0), image.axes.col(0), 3.5}), by_plane);
  EXPECT_EQ(turned.select(Facing<3>{image.axes * Vec<3>(1, 2, 3), 40.0}), by_normal);
  EXPECT_FALSE(by_plane.empty());
  EXPECT_FALSE(by_normal.empty());
}

}  // namespace
}  // namespace efree
