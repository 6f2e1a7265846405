// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/core/memory.hpp"
#include "image_meshes.hpp"
#include "meshes.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <span>
#include <vector>

namespace efree {
namespace {

using test::boundary_length;
using test::euler_characteristic;
using test::expect_consistent;
using test::length;
using test::side_area;
using test::volume;

/// One string to a row of pixels, the top one first; digits are labels, '.' is void.
LabelImage<2> picture(const std::vector<std::string>& rows) {
  LabelImage<2> image;
  image.size = {static_cast<Index>(rows[0].size()), static_cast<Index>(rows.size())};
  for (auto row = rows.rbegin(); row != rows.rend(); ++row)
    for (const char c : *row) image.labels.push_back(c == '.' ? 0 : static_cast<Label>(c - '0'));
  return image;
}

double area(const FineMesh<2>& mesh, Index region) {
  double sum = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (mesh.region(c) == region) sum += mesh.volume(c);
  return sum;
}

/// Length of the interface between two regions; every facet of it has a cell of either region, so it conforms.
double interface_length(const FineMesh<2>& mesh, Index a, Index b) {
  double sum = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (Index i = 0; i < 3; ++i)
      if (const Index other = mesh.neighbour(i, c); other >= 0 && mesh.region(c) == a && mesh.region(other) == b)
        sum += (mesh.vertex(mesh.cells()((i + 1) % 3, c)) - mesh.vertex(mesh.cells()((i + 2) % 3, c))).norm();
  return sum;
}

TEST(LabelImage, KeepsTheLargestBody) {
  const LabelImage<2> image = picture({"11..1",  //
                                       "11.2.",  //
                                       "...22"});
  const auto kept = keep_largest(image);
  EXPECT_EQ(kept.islands, 2);
  EXPECT_DOUBLE_EQ(kept.fraction, 0.5);  // four, three and one pixels
  EXPECT_EQ(kept.image.labels, picture({"11...", "11...", "....."}).labels);
  EXPECT_INPUT_ERROR(keep_largest(picture({"...", "..."})), "all of it is void");
}

TEST(LabelImage, RandomSpheresReachTheirPorosityReproducibly) {
  const LabelImage<3> image = random_spheres<3>(40, {.porosity = 0.3, .r_min = 3.0, .r_max = 6.0, .seed = 5});
  const auto counts = count_labels(image);
  ASSERT_EQ(counts.size(), 2u);
  EXPECT_GE(counts[0].pixels, 0.3 * 64000);
  EXPECT_LE(counts[0].pixels, 0.3 * 64000 + 905);  // by no more than one ball of radius 6
  EXPECT_EQ(image.labels, random_spheres<3>(40, {.porosity = 0.3, .r_min = 3.0, .r_max = 6.0, .seed = 5}).labels);
  EXPECT_NE(image.labels, random_spheres<3>(40, {.porosity = 0.3, .r_min = 3.0, .r_max = 6.0, .seed = 6}).labels);
  EXPECT_INPUT_ERROR(random_spheres<2>(0), "0 pixels a side");
  EXPECT_INPUT_ERROR(random_spheres<2>(10, {.porosity = 1.0}), "porosity 1");
}

TEST(LabelImage, RefusesWhatIsNoImage) {
  LabelImage<2> image = picture({"11", "11"});
  image.spacing = {1.0, 0.0};
  EXPECT_INPUT_ERROR(check_image(image), "the spacing is 1, 0");
  image = picture({"11", "11"});
  image.labels.pop_back();
  EXPECT_INPUT_ERROR(check_image(image), "3 labels for 2 x 2 pixels");
}

TEST(Memory, SaysWhatIsMissingBeforeItIsTaken) {
  EXPECT_GT(available_memory(), 0.0);
  EXPECT_NO_THROW(require_memory(1024.0, "a page"));
  EXPECT_INPUT_ERROR(require_memory(1e18, "a picture of everything"),
                     "a picture of everything takes about 9.31e+08 GiB");
}

TEST(Memory, TablesStayWhatTheyAreInLargePages) {
  std::vector<double> table(1 << 20, 0.0);
  std::iota(table.begin(), table.end(), 0.0);
  const double* where = table.data();
  const std::vector<double> none;
  const std::span<const std::byte> tables[] = {std::as_bytes(std::span(table)), std::as_bytes(std::span(none))};
  move_to_large_pages(tables);
  move_to_large_pages({});
  EXPECT_EQ(table.data(), where);
  for (std::size_t k = 0; k < table.size(); ++k) ASSERT_EQ(table[k], static_cast<double>(k));
}

TEST(ImageMesh2d, PixelContoursKeepAreasAndSides) {
  LabelImage<2> image = picture({"1111..",  //
                                 "1..111",  //
                                 "1..111",  //
                                 "111111"});
  image.spacing = {0.5, 0.25};
  image.origin = {3.0, -1.0};
  const FineMesh<2> mesh(mesh_image(image, {.size = 0.2}));
  expect_consistent(mesh);
  EXPECT_LE(mesh.size(), 0.2 * (1.0 + 1e-12));
  EXPECT_NEAR(mesh.volumes().sum(), 18 * 0.125, 1e-12);
  EXPECT_NEAR(length(mesh, "left"), 1.0, 1e-12);
  EXPECT_NEAR(length(mesh, "right"), 0.75, 1e-12);
  EXPECT_NEAR(length(mesh, "bottom"), 3.0, 1e-12);
  EXPECT_NEAR(length(mesh, "top"), 2.0, 1e-12);
  EXPECT_NEAR(length(mesh, "pores"), 2 * (2 * 0.5 + 2 * 0.25) + 2 * 0.5 + 0.25, 1e-12);
  EXPECT_EQ(euler_characteristic(mesh), 0);
  EXPECT_NEAR(mesh.vertices().row(0).minCoeff(), 3.0, 1e-15);
  EXPECT_NEAR(mesh.vertices().row(1).maxCoeff(), 0.0, 1e-15);
  EXPECT_EQ(mesh.region_names(), std::vector<std::string>{"1"});
}

TEST(ImageMesh2d, SmoothContoursCutTheCornersOff) {
  // One corner of a pixel is an eighth of it: taken off where the material's corner is convex, added where it is not.
  const LabelImage<2> image = picture({".....",  //
                                       ".111.",  //
                                       ".1.1.",  //
                                       ".11..",  //
                                       "....."});
  const FineMesh<2> mesh(mesh_image(image, {.size = 0.3, .contour = Contour::smooth}));
  expect_consistent(mesh);
  // Outside corners: 6 convex and 1 concave without the ones where pixels touch; the hole is open in a corner.
  EXPECT_NEAR(mesh.volumes().sum(), 7.0 + (3 - 7) / 8.0, 1e-12);
  EXPECT_EQ(euler_characteristic(mesh), 1);
  EXPECT_EQ(mesh.groups().size(), 1u);

  const FineMesh<2> dot(mesh_image(picture({"...", ".1.", "..."}), {.size = 2.0, .contour = Contour::smooth}));
  EXPECT_NEAR(dot.volumes().sum(), 0.5, 1e-14);
  EXPECT_NEAR(boundary_length(dot), 4.0 * std::sqrt(0.5), 1e-12);
}

TEST(ImageMesh2d, CornersThatTouchDoNotConnect) {
  const LabelImage<2> image = picture({".1.",  //
                                       "1.1",  //
                                       "11."});
  for (const Contour contour : {Contour::pixel, Contour::smooth}) {
    const FineMesh<2> mesh(mesh_image(image, {.size = 0.4, .contour = contour}));
    expect_consistent(mesh);
    EXPECT_EQ(mesh.num_components(), 3);
    EXPECT_EQ(euler_characteristic(mesh), 3);
  }
  // A ring closed by a corner only is open.
  const FineMesh<2> ring(mesh_image(picture({"11.", "1.1", "111"}), {.size = 0.4}));
  expect_consistent(ring);
  EXPECT_EQ(ring.num_components(), 1);
  EXPECT_EQ(euler_characteristic(ring), 1);
}

TEST(ImageMesh2d, SeveralLabelsConform) {
  const LabelImage<2> image = picture({"112233",  //
                                       "112233",  //
                                       "144.53",  //
                                       "144553"});
  for (const Contour contour : {Contour::pixel, Contour::smooth}) {
    const FineMesh<2> mesh(mesh_image(image, {.size = 0.3, .contour = contour}));
    expect_consistent(mesh);
    EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"1", "2", "3", "4", "5"}));
    EXPECT_EQ(mesh.num_components(), 1);
    if (contour == Contour::smooth) continue;
    const std::vector<double> pixels{6, 4, 6, 4, 3};
    for (Index r = 0; r < 5; ++r) EXPECT_NEAR(area(mesh, r), pixels[r], 1e-12);
    EXPECT_NEAR(interface_length(mesh, 0, 1), 2.0, 1e-12);
    EXPECT_NEAR(interface_length(mesh, 0, 3), 3.0, 1e-12);
    EXPECT_NEAR(interface_length(mesh, 3, 4), 1.0, 1e-12);
    EXPECT_NEAR(length(mesh, "pores"), 4.0, 1e-12);
  }
}

TEST(ImageMesh2d, FourLabelsMeetInAPoint) {
  for (const Contour contour : {Contour::pixel, Contour::smooth}) {
    const FineMesh<2> four(mesh_image(picture({"1122", "1122", "3344", "3344"}), {.size = 0.5, .contour = contour}));
    expect_consistent(four);
    for (Index r = 0; r < 4; ++r) EXPECT_NEAR(area(four, r), 4.0, 1e-12);
    EXPECT_EQ(euler_characteristic(four), 1);
    // Two labels across each other: material all around, so it stays in one piece.
    const FineMesh<2> chess(mesh_image(picture({"1212", "2121", "1212", "2121"}), {.size = 0.5, .contour = contour}));
    expect_consistent(chess);
    for (Index r = 0; r < 2; ++r) EXPECT_NEAR(area(chess, r), 8.0, 1e-12);
    EXPECT_EQ(euler_characteristic(chess), 1);
  }
}

TEST(ImageMesh2d, LabelsTakeTheNamesOfRegions) {
  const LabelImage<2> image = picture({"1123"});
  const FineMesh<2> mesh(mesh_image(image, {.size = 1.0, .names = {{1, "matrix"}, {2, "grain"}, {3, "matrix"}}}));
  EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"matrix", "grain"}));
  EXPECT_NEAR(area(mesh, mesh.region("matrix")), 3.0, 1e-14);
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0, .names = {{1, "matrix"}, {2, "grain"}}}),
                     "label 3 has no region; the image has the labels 1, 2, 3");
  EXPECT_INPUT_ERROR(mesh_image(picture({"1"}), {.size = 1.0, .names = {{1, "matrix"}, {7, "grain"}}}),
                     "label 7 has a region but no pixel; the image has the labels 1");
}

TEST(ImageMesh2d, SimplerContoursStayClose) {
  const LabelImage<2> image = random_spheres<2>(100, {.porosity = 0.3, .r_min = 5.0, .r_max = 12.0, .seed = 3});
  const ImageMeshOptions kept{.size = 20.0, .contour = Contour::smooth};
  ImageMeshOptions simple = kept;
  simple.simplify = 0.8;
  const FineMesh<2> a(mesh_image(image, kept)), b(mesh_image(image, simple));
  expect_consistent(b);
  EXPECT_LT(b.num_cells(), 0.65 * a.num_cells());
  EXPECT_EQ(euler_characteristic(a), euler_characteristic(b));
  EXPECT_EQ(a.num_components(), b.num_components());
  EXPECT_NEAR(b.volumes().sum(), a.volumes().sum(), 0.8 * length(a, "pores"));
  EXPECT_NEAR(b.volumes().sum(), a.volumes().sum(), 0.01 * a.volumes().sum());
  for (const char* side : {"left", "right", "bottom", "top"}) EXPECT_NEAR(length(a, side), length(b, side), 1e-12);
}

TEST(ImageMesh2d, SimplerContoursAreTheSameEveryTime) {
  const LabelImage<2> image = random_spheres<2>(150, {.porosity = 0.3, .r_min = 4.0, .r_max = 10.0, .seed = 1});
  const ImageMeshOptions options{.size = 5.0, .contour = Contour::smooth, .simplify = 0.7};
  const MeshData<2> first = mesh_image(image, options);
  const std::vector<std::vector<char>> elsewhere(100, std::vector<char>(777));  // moves what is allocated later
  for (int repeat = 0; repeat < 3; ++repeat) {
    const MeshData<2> again = mesh_image(image, options);
    ASSERT_EQ(again.vertices, first.vertices);
    ASSERT_EQ(again.cells, first.cells);
  }
}

TEST(ImageMesh2d, APorousImageKeepsItsAreaAndTopology) {
  const LabelImage<2> image = random_spheres<2>(256, {.porosity = 0.35, .r_min = 1.0, .r_max = 8.0, .seed = 2});
  const auto counts = count_labels(image);
  const FineMesh<2> pixels(mesh_image(image, {.size = 4.0}));
  expect_consistent(pixels);
  EXPECT_LE(pixels.size(), 4.0 * (1.0 + 1e-12));
  const double solid = static_cast<double>(counts[1].pixels);
  EXPECT_NEAR(pixels.volumes().sum(), solid, 1e-12 * solid);
  // Bodies are the components of pixels connected through edges.
  EXPECT_EQ(pixels.num_components(), keep_largest(image).islands + 1);
  const FineMesh<2> smooth(mesh_image(image, {.size = 4.0, .contour = Contour::smooth}));
  expect_consistent(smooth);
  EXPECT_EQ(smooth.num_components(), pixels.num_components());
  EXPECT_EQ(euler_characteristic(smooth), euler_characteristic(pixels));
  EXPECT_NEAR(smooth.volumes().sum(), solid, 0.02 * solid);
  const MeshData<2> again = mesh_image(image, {.size = 4.0});
  EXPECT_EQ(FineMesh<2>(again).vertices(), pixels.vertices());
}

TEST(ImageMesh3d, ABlockIsABlock) {
  LabelImage<3> image;
  image.size = {6, 4, 5};
  image.spacing = {0.5, 1.0, 0.25};
  image.origin = {1.0, -2.0, 3.0};
  image.labels.assign(120, 7);
  const FineMesh<3> mesh(mesh_image(image, {.size = 0.8, .mesher = Mesher::delaunay}));
  expect_consistent(mesh, image);
  EXPECT_NEAR(mesh.volumes().sum(), 15.0, 1e-12 * 15.0);
  EXPECT_NEAR(side_area(mesh, "left"), 5.0, 1e-11);
  EXPECT_NEAR(side_area(mesh, "back"), 3.75, 1e-11);
  EXPECT_NEAR(side_area(mesh, "top"), 12.0, 1e-11);
  EXPECT_EQ(mesh.groups().size(), 6u);
  EXPECT_EQ(mesh.region_names(), std::vector<std::string>{"7"});
  const MeshData<3> again = mesh_image(image, {.size = 0.8, .mesher = Mesher::delaunay});
  EXPECT_EQ(FineMesh<3>(again).vertices(), mesh.vertices());
}

TEST(ImageMesh3d, APorousBlockKeepsItsVolumeAndItsSides) {
  const LabelImage<3> image = random_spheres<3>(32, {.porosity = 0.3, .r_min = 4.0, .r_max = 7.0, .seed = 2});
  const double solid = static_cast<double>(count_labels(image).back().pixels);
  const FineMesh<3> mesh(mesh_image(image, {.size = 2.5, .mesher = Mesher::delaunay}));
  expect_consistent(mesh, image);
  EXPECT_NEAR(mesh.volumes().sum(), solid, 0.01 * solid);
  const auto voxels = [&](int d, Index at) {
    double count = 0.0;
    for (Index a = 0; a < 32; ++a)
      for (Index b = 0; b < 32; ++b) {
        std::array<Index, 3> voxel;
        voxel[d] = at;
        voxel[(d + 1) % 3] = a;
        voxel[(d + 2) % 3] = b;
        count += image.at(voxel) != 0;
      }
    return count;
  };
  const char* sides[] = {"left", "right", "front", "back", "bottom", "top"};
  for (int s = 0; s < 6; ++s) {
    const double pixels = voxels(s / 2, s % 2 == 1 ? 31 : 0);
    EXPECT_NEAR(side_area(mesh, sides[s]), pixels, 0.02 * 1024.0) << sides[s];
  }
}

TEST(ImageMesh3d, FindsPoresFarSmallerThanItsCells) {
  LabelImage<3> image;
  image.size = {24, 24, 24};
  image.labels.assign(24 * 24 * 24, 1);
  for (Index k = 11; k < 13; ++k)
    for (Index j = 11; j < 13; ++j)
      for (Index i = 11; i < 13; ++i) image.labels[image.index({i, j, k})] = 0;
  const FineMesh<3> mesh(mesh_image(image, {.size = 6.0, .mesher = Mesher::delaunay}));
  expect_consistent(mesh, image);
  const double pore = 24.0 * 24.0 * 24.0 - mesh.volumes().sum();
  EXPECT_GT(pore, 3.0);
  EXPECT_LT(pore, 8.0);
}

TEST(ImageMesh3d, RegionsConform) {
  // A ball of label 2 in a block of label 1 above a layer of label 3.
  LabelImage<3> image;
  image.size = {20, 20, 20};
  for (Index k = 0; k < 20; ++k)
    for (Index j = 0; j < 20; ++j)
      for (Index i = 0; i < 20; ++i)
        image.labels.push_back(Vec<3>(i - 9.5, j - 9.5, k - 12.5).norm() < 5.0 ? 2 : k < 4 ? 3 : 1);
  const auto counts = count_labels(image);
  const FineMesh<3> mesh(mesh_image(
      image, {.size = 2.5, .mesher = Mesher::delaunay, .names = {{1, "matrix"}, {2, "grain"}, {3, "layer"}}}));
  expect_consistent(mesh, image);
  EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"matrix", "grain", "layer"}));
  EXPECT_NEAR(mesh.volumes().sum(), 8000.0, 1e-8);  // no void: the block without a gap
  for (Index r = 0; r < 3; ++r) {
    const double voxels = static_cast<double>(counts[r].pixels);
    EXPECT_NEAR(volume(mesh, r), voxels, 0.05 * voxels) << mesh.region_names()[r];
  }
  EXPECT_EQ(mesh.num_components(), 1);
  double interface = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (Index i = 0; i < 4; ++i)
      if (const Index other = mesh.neighbour(i, c); other >= 0 && mesh.region(c) == 1 && mesh.region(other) != 1) {
        const Vec<3> a = mesh.vertex(mesh.cells()((i + 1) % 4, c)), b = mesh.vertex(mesh.cells()((i + 2) % 4, c)),
                     d = mesh.vertex(mesh.cells()((i + 3) % 4, c));
        interface += 0.5 * (b - a).cross(d - a).norm();
      }
  EXPECT_NEAR(interface, 4.0 * 3.14159 * 25.0, 0.08 * 314.0);
  EXPECT_INPUT_ERROR(mesh_image(image, {}), "size is 0");
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1e-3, .mesher = Mesher::delaunay}), "GiB are available");
  EXPECT_INPUT_ERROR(mesh_image(image, {.size = 1.0, .facet_distance = 0.0}), "facet_distance is 0");
}

TEST(ImageMesh2d, RefusesWhatCannotBeMeshed) {
  EXPECT_INPUT_ERROR(mesh_image(picture({"1"}), {}), "size is 0, expected a positive length");
  EXPECT_INPUT_ERROR(mesh_image(picture({".."}), {.size = 1.0}), "all of it is void");
  EXPECT_INPUT_ERROR(mesh_image(picture({"1"}), {.size = 1.0, .simplify = -1.0}), "simplify is -1");
  EXPECT_INPUT_ERROR(mesh_image(picture({"1"}), {.size = 1e-6}), "GiB are available");
}

}  // namespace
}  // namespace efree
