// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/image_reader.hpp"
#include "meshes.hpp"

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace efree {
namespace {

using namespace std::string_literals;

std::string bytes_of(const std::string& hex) {
  std::string out;
  for (std::size_t k = 0; k < hex.size(); k += 2)
    out.push_back(static_cast<char>(std::stoi(hex.substr(k, 2), nullptr, 16)));
  return out;
}

// 3 x 2 grey pixels, 0 1 2 above 2 2 0; one red and one black pixel; two pixels 1 and 0 with three equal channels.
const std::string grey_png = bytes_of(
    "89504e470d0a1a0a0000000d4948445200000003000000020800000000b81f39c6000000104944415478da63606064626062"
    "6200000022000805c123ea0000000049454e44ae426082");
const std::string colour_png = bytes_of(
    "89504e470d0a1a0a0000000d49484452000000020000000108020000007b40e8dd0000000c4944415478da63f8cf00020006"
    "01010041088ff10000000049454e44ae426082");
const std::string equal_png = bytes_of(
    "89504e470d0a1a0a0000000d49484452000000020000000108020000007b40e8dd0000000f4944415478da63606464646060"
    "000000160004670a61620000000049454e44ae426082");

/// Uncompressed TIFF of 8 bits, a page for each element.
std::string tiff(Index width, Index height, const std::vector<std::string>& pages) {
  std::string out = "II*\0"s;
  const auto number = [&](std::uint32_t value, int bytes) {
    for (int b = 0; b < bytes; ++b) out.push_back(static_cast<char>(value >> 8 * b & 255));
  };
  number(8, 4);
  for (std::size_t k = 0; k < pages.size(); ++k) {
    const std::vector<std::array<std::uint32_t, 2>> tags{{256, static_cast<std::uint32_t>(width)},
                                                         {257, static_cast<std::uint32_t>(height)},
                                                         {258, 8},
                                                         {259, 1},
                                                         {262, 1},
                                                         {273, 0},
                                                         {277, 1},
                                                         {278, static_cast<std::uint32_t>(height)},
                                                         {279, static_cast<std::uint32_t>(width * height)}};
    const auto data = static_cast<std::uint32_t>(out.size() + 2 + 12 * tags.size() + 4);
    number(static_cast<std::uint32_t>(tags.size()), 2);
    for (const auto& [tag, value] : tags) {
      number(tag, 2);
      number(4, 2);
      number(1, 4);
      number(tag == 273 ? data : value, 4);
    }
    number(k + 1 == pages.size() ? 0 : data + static_cast<std::uint32_t>(pages[k].size()), 4);
    out += pages[k];
  }
  return out;
}

std::string inr(const std::string& type, int bits, const std::string& cpu, const std::string& values) {
  std::string header = "#INRIMAGE-4#{\nXDIM=2\nYDIM=2\nZDIM=2\nVDIM=1\nTYPE=" + type +
                       "\nPIXSIZE=" + std::to_string(bits) + " bits\nCPU=" + cpu + "\nVX=0.5\nVY=0.25\nVZ=2\n";
  header += std::string(252 - header.size(), '\n') + "##}\n";
  return header + values;
}

class ReadImage : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) /
              ("efree_"s + testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string put(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return (folder_ / name).string();
  }
  std::filesystem::path folder_;
};

const std::string eight("\1\0\2\2\0\3\1\1", 8);
const std::vector<Label> eight_labels{1, 0, 2, 2, 0, 3, 1, 1};
const std::vector<Label> upright{2, 2, 0, 0, 1, 2};  // of the picture 0 1 2 above 2 2 0

TEST_F(ReadImage, PlanePicturesStandUpright) {
  for (const auto& [name, bytes] :
       std::vector<std::pair<std::string, std::string>>{{"a.png", grey_png},
                                                        {"a.tif", tiff(3, 2, {"\0\1\2\2\2\0"s})},
                                                        {"a.pgm", "P5\n# made by hand\n3 2\n255\n\0\1\2\2\2\0"s},
                                                        {"b.pgm", "P2 3 2 9\n0 1 2\n2 2 0\n"},
                                                        {"c.pgm", "P5 3 2 1000\n\0\0\0\1\0\2\0\2\0\2\0\0"s},
                                                        {"d.PGM", "P2 3 2 2 0 1 2 2 2 0"}}) {
    const LabelImage<2> image = read_image<2>(put(name, bytes));
    EXPECT_EQ(image.size, (std::array<Index, 2>{3, 2})) << name;
    EXPECT_EQ(image.labels, upright) << name;
    EXPECT_EQ(image.spacing, Vec<2>(1.0, 1.0)) << name;
    EXPECT_EQ(image.origin, Vec<2>(0.0, 0.0)) << name;
  }
  EXPECT_EQ(read_image<2>(put("a.raw", "\0\1\2\2\2\0"s), {.raw = RawImage<2>{.size = {3, 2}}}).labels, upright);
  EXPECT_EQ(read_image<2>(put("a.pbm", "P1 3 2\n011\n1 1 0\n")).labels, (std::vector<Label>{1, 1, 0, 0, 1, 1}));
  EXPECT_EQ(read_image<2>(put("b.pbm", "P4 3 2\n\x60\xc0"s)).labels, (std::vector<Label>{1, 1, 0, 0, 1, 1}));
  EXPECT_EQ(read_image<2>(put("equal.png", equal_png)).labels, (std::vector<Label>{1, 0}));
}

TEST_F(ReadImage, VolumesComeWithTheirSpacing) {
  const std::string meta =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nOffset = 1 2 3\n"
      "ElementSpacing = 0.5 0.25 2\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = ";
  put("values.zyx", eight);
  const std::string nrrd = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nspacings: 0.5 0.25 2\nendian: little\n";
  for (const auto& [name, bytes] : std::vector<std::pair<std::string, std::string>>{
           {"a.mha", meta + "LOCAL\n" + eight},
           {"a.mhd", meta + "values.zyx\n"},
           {"a.nrrd", nrrd + "encoding: raw\n\n" + eight},
           {"b.nrrd", nrrd + "encoding: ascii\n\n1 0 2 2\n0 3 1 1\n"},
           {"c.nhdr", nrrd + "encoding: raw\ndata file: values.zyx\n"},
           {"d.nrrd",
            nrrd + "encoding: gzip\n\n" + bytes_of("1f8b0800000000000203636460626260666404001292daf208000000")},
           {"a.inr", inr("unsigned fixed", 8, "decm", eight)},
           {"b.inr", inr("signed fixed", 16, "sun", "\0\1\0\0\0\2\0\2\0\0\0\3\0\1\0\1"s)}}) {
    const LabelImage<3> image = read_image<3>(put(name, bytes));
    EXPECT_EQ(image.size, (std::array<Index, 3>{2, 2, 2})) << name;
    EXPECT_EQ(image.labels, eight_labels) << name;
    EXPECT_EQ(image.spacing, Vec<3>(0.5, 0.25, 2.0)) << name;
    // The first voxel's centre is what MetaImage gives.
    if (name.starts_with("a.mh")) {
      EXPECT_EQ(image.origin, Vec<3>(0.75, 1.875, 2.0)) << name;
    }
  }
  std::string negative = meta + "LOCAL\n" + eight;
  EXPECT_INPUT_ERROR(read_image<3>(put("n.mha", negative.replace(negative.find("0.5 0.25"), 3, "-.5"))),
                     "ElementSpacing = -.5 0.25 2, expected edges of a voxel > 0");
  EXPECT_INPUT_ERROR(read_image<3>(put("e.nrrd", nrrd + "encoding: ascii\n\n1 0 2 2\n0 1e6 1 1\n")),
                     "the value 1000000 is none of type");
  const LabelImage<3> finer = read_image<3>(put("a.mha", meta + "LOCAL\n" + eight), {.spacing = {0.125}});
  EXPECT_EQ(finer.spacing, Vec<3>(0.125, 0.125, 0.125));
  EXPECT_EQ(read_image<3>(put("a.inr", inr("unsigned fixed", 8, "decm", eight)), {.spacing = {1, 2, 3}}).spacing,
            Vec<3>(1.0, 2.0, 3.0));
  const LabelImage<3> raw =
      read_image<3>(put("a.raw", "head" + std::string("\0\1\0\0\0\2\0\2\0\0\0\3\0\1\0\1", 16)),
                    {.raw = RawImage<3>{.size = {2, 2, 2}, .type = "uint16", .big_endian = true, .header = 4}});
  EXPECT_EQ(raw.labels, eight_labels);
  // A stack is the array that it is in any other format, not its mirror image.
  EXPECT_EQ(read_image<3>(put("stack.tiff", tiff(2, 2, {"\1\2\3\4"s, "\5\6\7\0"s}))).labels,
            (std::vector<Label>{1, 2, 3, 4, 5, 6, 7, 0}));
}

TEST_F(ReadImage, WritesWhatItReads) {
  LabelImage<3> image = random_spheres<3>(7, {.r_min = 1.0, .r_max = 2.0});
  image.spacing = {0.1, 0.2, 0.3};
  image.origin = {-1.0, 0.5, 2.0};
  for (const Label most : {1, 300}) {
    image.labels[5] = most;
    const std::string path = (folder_ / "block.mha").string();
    write_image(image, path);
    const LabelImage<3> again = read_image<3>(path);
    EXPECT_EQ(again.labels, image.labels);
    EXPECT_EQ(again.spacing, image.spacing);
    EXPECT_LT((again.origin - image.origin).norm(), 1e-15);
  }
  LabelImage<2> plane = random_spheres<2>(9, {.r_min = 1.0, .r_max = 2.0});
  plane.labels[3] = 300;
  for (const char* name : {"plane.pgm", "plane.mha"}) {
    write_image(plane, (folder_ / name).string());
    EXPECT_EQ(read_image<2>((folder_ / name).string()).labels, plane.labels);
  }
  EXPECT_INPUT_ERROR(write_image(plane, (folder_ / "plane.gif").string()), "images are written as .pgm or .mha");
  EXPECT_INPUT_ERROR(write_image(image, (folder_ / "none" / "block.mha").string()), "cannot be written");
}

TEST_F(ReadImage, ThresholdsAndBackgrounds) {
  std::string grey;
  for (int k = 0; k < 100; ++k) grey.push_back(static_cast<char>(2 * k));
  const std::string path = put("grey.pgm", "P5 10 10 255\n" + grey);
  EXPECT_INPUT_ERROR(read_image<2>(path), "it has 100 different values and looks like a grey image: give a threshold");
  EXPECT_EQ(count_labels(read_image<2>(path, {.max_labels = 100})).size(), 100u);
  EXPECT_EQ(count_labels(read_image<2>(path, {.threshold = 50.0})).back().pixels, 75);
  for (const bool below : {false, true}) {
    const auto image = read_image<2>(path, {.threshold = 50.0, .below = below});  // checks itself
    EXPECT_EQ(image.grey.size(), image.labels.size());
    EXPECT_NEAR(*std::ranges::max_element(image.grey) - *std::ranges::min_element(image.grey), 198.0, 1e-5);
  }
  EXPECT_EQ(count_labels(read_image<2>(path, {.threshold = 50.0, .below = true})).back().pixels, 25);
  EXPECT_INPUT_ERROR(read_image<2>(path, {.threshold = 500.0}), "all of it is background");
  EXPECT_EQ(read_image<2>(put("a.png", grey_png), {.background = {0, 2}}).labels,
            (std::vector<Label>{0, 0, 0, 0, 1, 0}));
  const auto missing = read_image_file<2>(put("a.png", grey_png), {.background = {0, 2, 7}});
  EXPECT_EQ(std::ranges::count(missing.warnings, "no pixel of the image has the label 7, which background names"), 1);
  const float values[4] = {0.25f, 1.0f, 2.0f, 0.0f};
  const std::string floats = put("a.raw", std::string(reinterpret_cast<const char*>(values), sizeof values));
  const RawImage<2> raw{.size = {2, 2}, .type = "float32"};
  EXPECT_INPUT_ERROR(read_image<2>(floats, {.raw = raw}), "the value 0.25 is no label");
  EXPECT_EQ(read_image<2>(floats, {.threshold = 0.5, .raw = raw}).labels, (std::vector<Label>{1, 0, 0, 1}));
}

TEST_F(ReadImage, GreyValuesAreThoseOfTheFile) {
  // The first row of a picture is the top one.
  const auto picture = read_grey_image<2>(put("a.png", grey_png));
  EXPECT_EQ(picture.values, (std::vector<float>{2, 2, 0, 0, 1, 2}));
  EXPECT_EQ(picture.size, (std::array<Index, 2>{3, 2}));
  const auto stack = read_grey_image<3>(put("a.tif", tiff(2, 2, {"\1\2\3\4", "\5\6\7\10"})), {.spacing = {0.5}});
  EXPECT_EQ(stack.values, (std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(stack.spacing, Vec<3>::Constant(0.5));
  const float values[4] = {0.25f, -1e9f, 2.0f, 0.0f};
  const std::string floats = put("a.raw", std::string(reinterpret_cast<const char*>(values), sizeof values));
  EXPECT_EQ(read_grey_image<2>(floats, {.raw = RawImage<2>{.size = {2, 2}, .type = "float32"}}).values,
            (std::vector<float>{2.0f, 0.0f, 0.25f, -1e9f}));
  EXPECT_EQ(read_grey_image<2>(put("e.png", equal_png)).values, (std::vector<float>{1, 0}));
  EXPECT_INPUT_ERROR(read_grey_image<2>(put("c.png", colour_png)), "it is a colour image");
  EXPECT_INPUT_ERROR(read_grey_image<3>(put("a.png", grey_png)), "single layer");
}

TEST(GreyValue, IsLinearBetweenCentresOfPixelsAndConstantBeyond) {
  GreyImage<3> image{.size = {4, 3, 2}, .spacing = {0.5, 1.0, 2.0}, .origin = {1.0, -1.0, 0.0}};
  const Vec<3> slope(3.0, -2.0, 5.0), low = image.origin + 0.5 * image.spacing;
  const Vec<3> high = low + image.spacing.cwiseProduct(Vec<3>(3, 2, 1));
  for (Index k = 0; k < 2; ++k)
    for (Index j = 0; j < 3; ++j)
      for (Index i = 0; i < 4; ++i)
        image.values.push_back(static_cast<float>(7.0 + slope.dot(low + image.spacing.cwiseProduct(Vec<3>(i, j, k)))));
  const ScalarField<3> grey = grey_value(image);
  double worst = 0.0;
  for (double x = 0.5; x < 4.0; x += 0.17)
    for (double y = -1.5; y < 3.0; y += 0.23)
      for (double z = -0.5; z < 5.0; z += 0.31) {
        const Vec<3> at(x, y, z);
        worst = std::max(worst, std::abs(grey(at) - 7.0 - slope.dot(at.cwiseMax(low).cwiseMin(high))));
      }
  EXPECT_LT(worst, 1e-5);  // of single precision
  image.values.pop_back();
  EXPECT_INPUT_ERROR(grey_value(image), "23 grey values for 4 x 3 x 2 pixels");
}

TEST(GreyValue, OfASinglePixelIsConstant) {
  const ScalarField<2> grey = grey_value(GreyImage<2>{.size = {1, 1}, .values = {3.5f}});
  EXPECT_EQ(grey({0.2, 5.0}), 3.5);
}

TEST_F(ReadImage, RefusesBadFilesWithOneClearMessage) {
  EXPECT_INPUT_ERROR(read_image<2>((folder_ / "no.png").string()), "no.png: there is no such file");
  EXPECT_INPUT_ERROR(read_image<2>(folder_.string()), "it is no file");
  EXPECT_INPUT_ERROR(read_image<2>(put("empty.png", "")), "it is empty");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.jpg", "abc")), "unknown ending");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.raw", "abc")), "give size and type");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.png", grey_png), {.raw = RawImage<2>{}}), "this one has a header");
  for (const auto& file : std::vector<std::pair<std::string, std::string>>{{"a.png", "PNG"},
                                                                           {"a.tif", "TIFF"},
                                                                           {"a.ppm", "PNM"},
                                                                           {"a.nrrd", "NRRD"},
                                                                           {"a.mha", "MetaImage"},
                                                                           {"a.inr", "INR"}})
    EXPECT_INPUT_ERROR(read_image<2>(put(file.first, "something else altogether")),
                       "it is no " + file.second + " file");
  EXPECT_INPUT_ERROR(read_image<2>(put("red.png", colour_png)), "it is a colour image");
  EXPECT_INPUT_ERROR(read_image<2>(put("void.pgm", "P2 2 2 1 0 0 0 0")), "all of it is background");
  EXPECT_INPUT_ERROR(read_image<2>(put("stack.tif", tiff(2, 2, {"\1\1\1\1"s, "\1\1\1\1"s}))), "it has 2 layers");
  EXPECT_INPUT_ERROR(read_image<3>(put("a.png", grey_png)), "it has a single layer");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.raw", "abc"), {.raw = RawImage<2>{.size = {2, 2}}}),
                     "2 x 2 pixels of uint8 after a header of 0 bytes are 4 bytes, but the file has 3");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.raw", "abc"), {.raw = RawImage<2>{.size = {2, 2}, .type = "short"}}),
                     "values of type \"short\"");
  const auto nrrd = [&](const std::string& lengths) {
    return put("a.nrrd", "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 2 2\nencoding: raw\n" + lengths + "\n\n\1\1\1\1");
  };
  EXPECT_INPUT_ERROR(read_image<2>(nrrd("spacings: 0 1")), "a.nrrd: the spacing of its pixels along x is 0");
  EXPECT_INPUT_ERROR(read_image<2>(nrrd("spacings: 1 nan")), "a.nrrd: the spacing of its pixels along y is nan");
  EXPECT_INPUT_ERROR(read_image<2>(nrrd("space directions: (1,0) (0,0)")), "along y is 0");
  EXPECT_EQ(read_image<2>(nrrd("spacings: 0 nan"), {.spacing = {2.0}}).spacing, Vec<2>(2, 2));
  EXPECT_INPUT_ERROR(read_image<2>(put("a.png", grey_png), {.spacing = {1.0, -2.0}}),
                     "along y is -2, expected a positive length");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.png", grey_png), {.spacing = {1.0, 2.0, 3.0}}), "3 spacings given");
}

TEST_F(ReadImage, RefusesTruncatedFiles) {
  const std::string meta = "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n";
  const std::string nrrd = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\nendian: little\n\n";
  for (const auto& file :
       std::vector<std::pair<std::string, std::string>>{{"a.png", grey_png.substr(0, grey_png.size() - 14)},
                                                        {"b.png", grey_png.substr(0, 40)},
                                                        {"a.tif", tiff(3, 2, {"\0\1\2\2\2\0"s}).substr(0, 125)},
                                                        {"b.tif", tiff(3, 2, {"\0\1\2\2\2\0"s}).substr(0, 30)},
                                                        {"a.pgm", "P5 3 2 255 \0\1"s},
                                                        {"b.pgm", "P2 3 2 255 0 1"},
                                                        {"c.pgm", "P5 3"}})
    EXPECT_INPUT_ERROR(read_image<2>(put(file.first, file.second)), "truncated") << file.first;
  for (const auto& file :
       std::vector<std::pair<std::string, std::string>>{{"a.mha", meta + "ElementDataFile = LOCAL\n123"},
                                                        {"a.nrrd", nrrd + "123"},
                                                        {"b.nrrd", nrrd.substr(0, 30)},
                                                        {"a.inr", inr("unsigned fixed", 8, "decm", "123")},
                                                        {"b.inr", inr("unsigned fixed", 8, "decm", "").substr(0, 100)}})
    EXPECT_INPUT_ERROR(read_image<3>(put(file.first, file.second)), "truncated") << file.first;
  EXPECT_INPUT_ERROR(read_image<3>(put("a.mhd", meta + "ElementDataFile = none.raw\n")), "which does not exist");
}

TEST_F(ReadImage, RefusesMetaImagesOfManyDimensionsAtOnce) {
  for (const std::string& dimensions : {"2147483647"s, "4"s, "0"s, "nan"s, "-3"s})
    EXPECT_INPUT_ERROR(read_image<3>(put("a.mha", "ObjectType = Image\nNDims = " + dimensions +
                                                      "\nDimSize = 2 2 2\nElementType = MET_UCHAR\n"
                                                      "ElementDataFile = LOCAL\n12345678")),
                       "dimensions (NDims), expected 2 or 3");
}

TEST_F(ReadImage, SaysFromTheHeaderThatMemoryIsShort) {
  const std::string meta = "ObjectType = Image\nNDims = 3\nDimSize = 20000 20000 20000\nElementType = MET_DOUBLE\n";
  EXPECT_INPUT_ERROR(read_image<3>(put("a.mha", meta + "ElementDataFile = LOCAL\n123")), "GiB are available");
  EXPECT_INPUT_ERROR(read_image<2>(put("a.pgm", "P5 2000000000 2000000000 255 ")), "GiB are available");
}

}  // namespace
}  // namespace efree
