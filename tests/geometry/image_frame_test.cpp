// SPDX-License-Identifier: GPL-3.0-or-later
/// Where images lie in the world, by what their files say.
#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/input/image_summary.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "meshes.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>

namespace efree {
namespace {

using namespace std::string_literals;

/// Pixels of a picture in the world, each with its label.
using Voxels = std::vector<std::pair<std::array<double, 3>, Label>>;

Voxels voxels_of(const LabelImage<3>& image) {
  Voxels voxels;
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (Index i = 0; i < image.size[0]; ++i) {
        const Vec<3> at = image.in_world(image.origin + image.spacing.cwiseProduct(Vec<3>(i + 0.5, j + 0.5, k + 0.5)));
        std::array<double, 3> rounded;
        for (int d = 0; d < 3; ++d) rounded[d] = std::round(1e6 * at[d]) / 1e6 + 0.0;
        voxels.push_back({rounded, image.at({i, j, k})});
      }
  std::ranges::sort(voxels);
  return voxels;
}

class ImageFrames : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) /
              ("efree_frames_"s + testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string put(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return (folder_ / name).string();
  }
  std::filesystem::path folder_;
};

const std::array<Index, 3> size{4, 3, 2};
const Vec<3> edges(0.5, 1.0, 0.75), first(3.0, -2.0, 1.5);  // centre of the first voxel

std::string labels() {
  std::string out(24, '\0');
  std::iota(out.begin(), out.end(), '\1');
  return out;
}

/// With these directions of its axes (columns).
std::string nrrd(const Mat<3>& axes) {
  std::string directions;
  for (int d = 0; d < 3; ++d) directions += fmt::format("({}) ", fmt::join((axes.col(d) * edges[d]).eval(), ","));
  return fmt::format(
             "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: {}\nspace directions: {}\n"
             "space origin: ({})\nencoding: raw\n\n",
             fmt::join(size, " "), directions, fmt::join(first, ",")) +
         labels();
}
std::string meta_image(const Mat<3>& axes) {
  return fmt::format(
             "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nTransformMatrix = {}\n"
             "Offset = {}\nElementSpacing = {}\nDimSize = {}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
             fmt::join(axes.reshaped(), " "), fmt::join(first, " "), fmt::join(edges, " "), fmt::join(size, " ")) +
         labels();
}
/// Header of NIfTI-1 with an s-form (nifti1.h of the NIMH).
std::string nifti(const Mat<3>& axes) {
  std::string out(352, '\0');
  const auto at = [&](std::size_t place, auto value) { std::memcpy(out.data() + place, &value, sizeof value); };
  at(0, std::int32_t(348));
  const std::array<std::int16_t, 8> dim{3, 4, 3, 2, 1, 1, 1, 1};
  at(40, dim);
  at(70, std::int16_t(2));  // uint8
  at(72, std::int16_t(8));
  at(76, std::array<float, 8>{1.0F, 0.5F, 1.0F, 0.75F, 1, 1, 1, 1});
  at(108, 352.0F);
  at(254, std::int16_t(1));
  for (int d = 0; d < 3; ++d) {
    std::array<float, 4> row{};
    for (int a = 0; a < 3; ++a) row[a] = static_cast<float>(axes(d, a) * edges[a]);
    row[3] = static_cast<float>(first[d]);
    at(280 + 16 * d, row);
  }
  std::memcpy(out.data() + 344, "n+1", 4);
  return out + labels();
}

/// What the header says, voxel by voxel.
Voxels expected(const Mat<3>& axes) {
  Voxels voxels;
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i) {
        const Vec<3> at = first + axes * edges.cwiseProduct(Vec<3>(i, j, k));
        std::array<double, 3> rounded;
        for (int d = 0; d < 3; ++d) rounded[d] = std::round(1e6 * at[d]) / 1e6 + 0.0;
        voxels.push_back({rounded, static_cast<Label>(1 + i + 4 * (j + 3 * k))});
      }
  std::ranges::sort(voxels);
  return voxels;
}

TEST_F(ImageFrames, AxesExchangedAndReversedAreThoseOfTheWorldInAllFormats) {
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Mat<3> axes = Mat<3>::Zero();
      for (int d = 0; d < 3; ++d) axes(order[d], d) = signs >> d & 1 ? -1.0 : 1.0;
      for (const auto& [name, bytes] :
           {std::pair{"a.nrrd"s, nrrd(axes)}, {"a.mha"s, meta_image(axes)}, {"a.nii"s, nifti(axes)}}) {
        const LabelImage<3> image = read_image<3>(put(name, bytes));
        EXPECT_FALSE(image.is_turned()) << name;
        EXPECT_TRUE(voxels_of(image) == expected(axes)) << name << ' ' << axes;
      }
    }
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_F(ImageFrames, OfTurnedImagesKeepTheirVoxelsWhereTheHeaderSaysAndShearedOnesAreRefused) {
  const Mat<3> turned = Eigen::AngleAxisd(0.35, Vec<3>(1.0, -2.0, 3.0).normalized()).toRotationMatrix();
  Mat<3> exchanged = turned;
  exchanged.col(0) = -turned.col(2);
  exchanged.col(2) = turned.col(0);
  Mat<3> mirrored = turned;
  mirrored.col(1) *= -1.0;
  for (const Mat<3>& axes : {turned, exchanged, mirrored})
    for (const auto& [name, bytes] : {std::pair{"a.nrrd"s, nrrd(axes)}, {"a.mha"s, meta_image(axes)}}) {
      const auto [image, remarks, warnings] = read_image_file<3>(put(name, bytes));
      EXPECT_TRUE(voxels_of(image) == expected(axes)) << name;
      EXPECT_LT((image.axes - turned).norm(), 1e-6) << name;
      EXPECT_NE(remarks.back().find("turned by 20.05 degrees"), std::string::npos) << remarks.back();
      EXPECT_TRUE(warnings.empty());
    }
  Mat<3> sheared = Mat<3>::Identity();
  sheared.col(1) = Vec<3>(0.1, 1.0, 0.0).normalized();
  EXPECT_INPUT_ERROR(read_image<3>(put("a.nrrd", nrrd(sheared))), "are not at right angles");
  EXPECT_INPUT_ERROR(read_image<3>(put("a.mha", meta_image(sheared))), "are not at right angles");
}

TEST_F(ImageFrames, WorldsOfAnatomyBecomeEachOther) {
  const auto lps = read_image<3>(put("a.nrrd", nrrd(Mat<3>::Identity())));
  const auto ras = read_image<3>(put("a.nii", nifti(Vec<3>(-1.0, -1.0, 1.0).asDiagonal())), {.world = "LPS"});
  EXPECT_EQ(ras.labels, lps.labels);
  EXPECT_NEAR(ras.origin[0], -first[0] - 0.25, 1e-6);
  EXPECT_INPUT_ERROR(read_image<3>(put("a.raw", labels()), {.world = "RAS", .raw = RawImage<3>{.size = size}}),
                     "does not say its anatomical axes");
}

TEST_F(ImageFrames, MeshesAndSummariesOfTurnedImagesAreTurned) {
  const Mat<3> turn = Eigen::AngleAxisd(0.6, Vec<3>::UnitZ()).toRotationMatrix();
  LabelImage<3> image{.size = {6, 5, 4}, .origin = {1.0, 2.0, 3.0}, .labels = std::vector<Label>(120, 1)};
  const auto straight = mesh_image<3>(image, {.size = 1.0});
  const auto summary = summarize_image(image);
  image.axes = turn;
  const auto turned = mesh_image<3>(image, {.size = 1.0});
  const auto turned_summary = summarize_image(image);
  const Points<3> back = (turn.transpose() * (turned.vertices.colwise() - image.origin)).colwise() + image.origin;
  EXPECT_LT((back - straight.vertices).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_EQ(turned.cells, straight.cells);
  for (std::size_t g = 0; g < summary.groups.size(); ++g)
    EXPECT_LT((turned_summary.groups[g].mean_normal - turn * summary.groups[g].mean_normal).norm(), 1e-12);
  write_image(image, (folder_ / "turned.mha").string());
  EXPECT_LT((read_image<3>((folder_ / "turned.mha").string()).axes - turn).norm(), 1e-12);
  image.axes *= 2.0;
  EXPECT_INPUT_ERROR(check_image(image), "its axes are no rotation");
}

TEST_F(ImageFrames, SlicesAreStackedInTheOrderOfTheirNumbers) {
  for (const auto& [number, value] : {std::pair{10, 3}, {2, 2}, {1, 1}})
    put(fmt::format("s_{}.pgm", number), fmt::format("P2 2 2 9 {0} 0 {0} {0}\n", value));
  put("notes.txt", "no slice");
  const std::vector<Label> labels_of_stack{1, 0, 1, 1, 2, 0, 2, 2, 3, 0, 3, 3};
  EXPECT_EQ(read_image<3>(folder_.string()).labels, labels_of_stack);
  EXPECT_EQ(read_image<3>((folder_ / "s_*.pgm").string(), {.spacing = {1, 1, 3}}).labels, labels_of_stack);
  EXPECT_INPUT_ERROR(read_image<3>((folder_ / "t_*.pgm").string()), "no file has such a name");
  put("s_3.pgm", "P2 3 1 9 1 1 1\n");
  EXPECT_INPUT_ERROR(read_image<3>(folder_.string()), "a slice of 3 x 1 pixels");
  put("s_4.pbm", "P1 2 2 1 1 1 1\n");
  EXPECT_INPUT_ERROR(read_image<3>(folder_.string()), "slices of several formats");
}

/// Uncompressed, two pages of 2 x 2, with a description and pixels to a unit.
std::string tiff(const std::string& description, std::uint32_t pixels, std::uint32_t units, std::uint32_t unit) {
  std::string out = "II*\0"s;
  const auto number = [&](std::uint32_t value, int bytes) {
    for (int b = 0; b < bytes; ++b) out.push_back(static_cast<char>(value >> 8 * b & 255));
  };
  const std::string text = description + std::string(8 - description.size() % 4, '\0');
  const auto data = static_cast<std::uint32_t>(8), length = static_cast<std::uint32_t>(text.size());
  number(data + 4 + 8 + length, 4);
  out += "\1\1\1\1";
  number(pixels, 4), number(units, 4);
  out += text;
  for (int page = 0; page < 2; ++page) {
    const std::vector<std::array<std::uint32_t, 4>> tags{
        {256, 4, 1, 2},    {257, 4, 1, 2},        {258, 4, 1, 8},
        {259, 4, 1, 1},    {262, 4, 1, 1},        {270, 2, length, data + 12},
        {273, 4, 1, data}, {277, 4, 1, 1},        {278, 4, 1, 2},
        {279, 4, 1, 4},    {282, 5, 1, data + 4}, {283, 5, 1, data + 4},
        {296, 3, 1, unit}};
    const auto end = static_cast<std::uint32_t>(out.size() + 2 + 12 * tags.size() + 4);
    number(static_cast<std::uint32_t>(tags.size()), 2);
    for (const auto& [tag, type, count, value] : tags)
      number(tag, 2), number(type, 2), number(count, 4), number(value, 4);
    number(page == 0 ? end : 0, 4);
  }
  return out;
}

TEST_F(ImageFrames, SpacingOfTiffIsThatOfImageJOfOmeOrNotThatOfADisplay) {
  const auto read = [&](const std::string& bytes) { return read_image_file<3>(put("a.tif", bytes)); };
  const auto image_j = read(tiff("ImageJ=1.53\nslices=2\nunit=micron\nspacing=2.5\n", 4, 1, 1));
  EXPECT_EQ(image_j.image.spacing, Vec<3>(0.25, 0.25, 2.5));
  EXPECT_NE(image_j.remarks[0].find("ImageJ, in micron"), std::string::npos) << image_j.remarks[0];
  EXPECT_TRUE(image_j.warnings.empty());
  const auto ome =
      read(tiff("<OME><Pixels PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.75\" PhysicalSizeZ=\"3\"/>", 72, 1, 2));
  EXPECT_EQ(ome.image.spacing, Vec<3>(0.5, 0.75, 3.0));
  for (const std::uint32_t dots : {72, 96, 300}) {
    const auto display = read(tiff("made by hand", dots, 1, 2));
    EXPECT_EQ(display.image.spacing, Vec<3>(1.0, 1.0, 1.0));
    ASSERT_EQ(display.warnings.size(), 1u);
    EXPECT_NE(display.warnings[0].find("dots an inch"), std::string::npos);
  }
  const auto scan = read(tiff("", 20, 1, 3));  // to a centimetre
  EXPECT_EQ(scan.image.spacing, Vec<3>(0.5, 0.5, 0.5));
  ASSERT_EQ(scan.warnings.size(), 1u);
  EXPECT_NE(scan.warnings[0].find("how far apart its slices are"), std::string::npos);
}

}  // namespace
}  // namespace efree
