// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/inspect.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/input/surface_check.hpp"
#include "workspace.hpp"

#include <gmock/gmock.h>
#include <cmath>
#include <numbers>
#include <regex>

namespace efree::test {
namespace {

/// The box [0, x] x [0, y] x [0, z] as 12 triangles, counted so that the first two are its bottom; in no orientation.
std::string box_off(double x, double y, double z, int left_out = 0) {
  const int quads[6][4] = {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  std::ostringstream text;
  text << "OFF\n8 " << 12 - left_out << " 0\n";
  for (int corner = 0; corner < 8; ++corner)
    text << (corner & 1 ? x : 0) << ' ' << (corner & 2 ? y : 0) << ' ' << (corner & 4 ? z : 0) << '\n';
  int count = 0;
  for (const auto& q : quads)
    for (const auto& t : {std::array{q[0], q[1], q[2]}, std::array{q[0], q[2], q[3]}})
      if (count++ >= left_out) text << "3 " << t[0] << ' ' << t[1] << ' ' << t[2] << '\n';
  return text.str();
}

double fact(const auto& inspection, const std::string& name) {
  for (const auto& [key, value] : inspection.facts)
    if (key == name) return value;
  ADD_FAILURE() << "no fact " << name;
  return NAN;
}
const auto& group(const auto& inspection, const std::string& name) {
  for (const auto& part : inspection.groups)
    if (part.name == name) return part;
  throw std::runtime_error("no part " + name);
}

TEST(Inspect, AClosedSurfaceHasAVolumeSidesThatFaceOutwardsAndAThinnestWall) {
  const Workspace work;
  work.write("box.off", box_off(3, 2, 0.5));
  const auto box = std::get<Inspection<3>>(inspect(work / "box.off"));
  EXPECT_EQ(box.kind, "surface");
  EXPECT_NEAR(box.volume, 3.0, 1e-12);
  EXPECT_NEAR(box.boundary, 17.0, 1e-12);
  ASSERT_EQ(box.groups.size(), 6u);
  Vec<3> sum = Vec<3>::Zero();
  for (const auto& part : box.groups) {
    EXPECT_EQ(part.num_facets, 2);
    ASSERT_TRUE(part.normal.has_value());
    sum += part.measure * part.mean_normal;
    const Vec<3> middle = part.box.center() - Vec<3>(1.5, 1, 0.25);
    EXPECT_GT(middle.dot(*part.normal), 0.0) << part.name;
  }
  EXPECT_LT(sum.norm(), 1e-12);
  EXPECT_NEAR(group(box, "surface 1").measure, 6.0, 1e-12);
  EXPECT_NEAR(group(box, "surface 6").measure, 1.0, 1e-12);
  ASSERT_TRUE(box.smallest.has_value());
  EXPECT_NEAR(box.smallest->size, 0.5, 1e-12);
  EXPECT_EQ(fact(box, "open_edges"), 0.0);
  EXPECT_TRUE(box.remarks.empty());
}

/// A sheet of 0.5: two edges across it. Its smallest features are told together where there are many.
TEST(Inspect, SuggestsSizesAndTellsSmallPartsTogether) {
  const Workspace work;
  work.write("box.off", box_off(3, 2, 0.5));
  const auto box = std::get<Inspection<3>>(inspect(work / "box.off"));
  ASSERT_TRUE(box.suggestion.has_value());
  const double diagonal = std::sqrt(9 + 4 + 0.25);
  EXPECT_NEAR(box.suggestion->mesh_size, std::min(0.25, diagonal / 20.0), 1e-12);
  EXPECT_GT(box.suggestion->spacing, box.suggestion->mesh_size);
  EXPECT_THAT(inspection_text(box), ::testing::HasSubstr("to begin with: mesh_size = 0.18"));

  // A square of 1 with 59 parts along 0.59 of a side, each 0.01 of 4 long; and one of the rest.
  std::string comb = "Point(1) = {0, 0, 0};\nPoint(2) = {1, 0, 0};\nPoint(3) = {1, 1, 0};\nPoint(4) = {0, 1, 0};\n";
  std::string loop;
  for (int k = 0; k < 60; ++k) {
    comb += "Point(" + std::to_string(10 + k) + ") = {" + std::to_string(0.01 * (k + 1)) + ", 0, 0};\n";
    comb += "Line(" + std::to_string(10 + k) + ") = {" + std::to_string(k == 0 ? 1 : 9 + k) + ", " +
            std::to_string(10 + k) + "};\nPhysical Curve(\"tooth " + std::to_string(k) + "\") = {" +
            std::to_string(10 + k) + "};\n";
    loop += std::to_string(10 + k) + ", ";
  }
  comb += "Line(1) = {69, 2};\nLine(2) = {2, 3};\nLine(3) = {3, 4};\nLine(4) = {4, 1};\nCurve Loop(1) = {" + loop +
          "1, 2, 3, 4};\nPlane Surface(1) = {1};\nPhysical Curve(\"rest\") = {1, 2, 3, 4};\nPhysical Surface(\"comb\") "
          "= {1};\n";
  work.write("comb.geo", comb);
  const auto inspection = std::get<Inspection<2>>(inspect(work / "comb.geo"));
  const std::string text = inspection_text(inspection);
  EXPECT_THAT(text, ::testing::HasSubstr("\"rest\""));
  EXPECT_THAT(text, ::testing::Not(::testing::HasSubstr("\"tooth 7\"")));
  EXPECT_THAT(text, ::testing::ContainsRegex(
                        "and 60 of less than 1 % of the boundary each \\(--json has all\\): [0-9]+ facets, "
                        "length 0.6\n"));
  EXPECT_EQ(nlohmann::json::parse(inspection_json(inspection))["parts"].size(), 61u);
  EXPECT_TRUE(nlohmann::json::parse(inspection_json(inspection))["suggestion"]["mesh_size"].is_number());
}

TEST(Inspect, SaysWhatKeepsASurfaceFromBeingClosed) {
  const Workspace work;
  work.write("open.off", box_off(1, 1, 1, 2));
  const auto open = std::get<Inspection<3>>(inspect(work / "open.off"));
  EXPECT_EQ(fact(open, "open_edges"), 4.0);
  EXPECT_EQ(open.volume, 0.0);
  EXPECT_FALSE(open.smallest.has_value());
  ASSERT_EQ(open.remarks.size(), 1u);
  EXPECT_NE(open.remarks[0].find("wrap = true"), std::string::npos);
  EXPECT_NE(open.remarks[0].find("boundary edge"), std::string::npos);

  work.write("needle.off",
             "OFF\n8 6 0\n0 0 0\n2 0 0\n0 2 0\n0 0 2\n0.5 0.5 -1\n0.7 0.5 -1\n0.5 0.7 -1\n0.5 0.5 0.3\n"
             "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n3 4 5 7\n3 0 0 1\n");
  const auto needle = std::get<Inspection<3>>(inspect(work / "needle.off"));
  EXPECT_EQ(fact(needle, "shells"), 2.0);
  EXPECT_EQ(fact(needle, "open_edges"), 3.0);
  EXPECT_EQ(fact(needle, "degenerate_triangles"), 1.0);
  EXPECT_GE(fact(needle, "crossing_pairs_of_triangles"), 1.0);
}

TEST(Inspect, ASharpEdgePartsASurfaceOnlyAboveTheAngle) {
  // A roof whose sides meet at 40 degrees between their normals.
  SurfaceSoup roof;
  roof.points.resize(3, 4);
  const double rise = std::tan(20.0 * std::numbers::pi / 180.0);
  roof.points << -1, 0, 0, 1, 0, 0, 1, 0, 0, rise, rise, 0;
  roof.triangles = {{0, 1, 2}, {2, 1, 3}};
  EXPECT_EQ(check_surface(roof, 39.0).groups.size(), 2u);
  EXPECT_EQ(check_surface(roof, 41.0).groups.size(), 1u);
  std::swap(roof.triangles[1][0], roof.triangles[1][1]);  // turned over: the same roof
  EXPECT_EQ(check_surface(roof, 39.0).groups.size(), 2u);
  EXPECT_EQ(check_surface(roof, 41.0).groups.size(), 1u);
}

/// 6 x 5 pixels of 1 with a strip of 2, two closed pores, an open one, and an island.
LabelImage<2> small_image() {
  LabelImage<2> image{.size = {6, 5}, .spacing = {0.5, 2.0}, .origin = {1.0, -1.0}};
  for (const char* row : {"111101",  //
                          "101110",  //
                          "112211",  //
                          "110011",  //
                          "111111"})
    for (const char* c = row; *c; ++c) image.labels.push_back(static_cast<Label>(*c - '0'));
  return image;
}

TEST(Inspect, AnImageIsMeasuredByItsPixels) {
  const Workspace work;
  write_image(small_image(), (work / "image.mha").string());
  const auto image = std::get<Inspection<2>>(inspect(work / "image.mha"));
  EXPECT_EQ(image.kind, "label image");
  EXPECT_EQ(image.box.min(), Vec<2>(1.0, -1.0));
  EXPECT_EQ(image.box.max(), Vec<2>(4.0, 9.0));
  ASSERT_EQ(image.bodies.size(), 2u);
  EXPECT_EQ(image.bodies[1].name, "2");
  EXPECT_DOUBLE_EQ(image.bodies[1].volume, 2.0);
  EXPECT_EQ(image.bodies[1].box.min(), Vec<2>(2.0, 3.0));
  EXPECT_EQ(image.bodies[1].box.max(), Vec<2>(3.0, 5.0));
  EXPECT_DOUBLE_EQ(image.volume, 25.0);
  // Rows run upwards, the first is the lowest.
  EXPECT_DOUBLE_EQ(group(image, "bottom").measure, 2.5);
  EXPECT_DOUBLE_EQ(group(image, "top").measure, 3.0);
  EXPECT_DOUBLE_EQ(group(image, "left").measure, 10.0);
  EXPECT_DOUBLE_EQ(group(image, "right").measure, 8.0);
  EXPECT_EQ(group(image, "right").mean_normal, Vec<2>(1, 0));
  EXPECT_FALSE(group(image, "pores").normal.has_value());
  EXPECT_EQ(fact(image, "closed_pores"), 2.0);
  EXPECT_EQ(fact(image, "connected_bodies"), 2.0);
  EXPECT_NEAR(fact(image, "material_fraction"), 25.0 / 30.0, 1e-15);
  ASSERT_TRUE(image.smallest.has_value());
  EXPECT_NEAR(image.smallest->size, 2.0 / std::sqrt(std::numbers::pi), 1e-12);
  EXPECT_EQ(image.smallest->at, Vec<2>(1.75, 2.0));
  // What is drawn has the body's area and the boundary's length.
  double area = 0.0, length = 0.0;
  for (const auto& piece : image.pieces) {
    const Vec<2> along = image.points.col(piece.corners[1]) - image.points.col(piece.corners[0]);
    if (piece.corners[2] < 0)
      length += along.norm();
    else
      area += along.norm() * (image.points.col(piece.corners[2]) - image.points.col(piece.corners[1])).norm();
  }
  EXPECT_NEAR(area, image.volume, 1e-12);
  EXPECT_NEAR(length, image.boundary, 1e-12);
}

TEST(Inspect, ASolidImageHasTheFacesOfItsVoxels) {
  const Workspace work;
  LabelImage<3> image{.size = {4, 3, 5}, .spacing = {1, 2, 3}, .labels = std::vector<Label>(60, 7)};
  image.labels[image.index({1, 1, 2})] = 0;
  image.labels[image.index({2, 1, 2})] = 0;
  write_image(image, (work / "image.mha").string());
  const auto solid = std::get<Inspection<3>>(inspect(work / "image.mha"));
  EXPECT_DOUBLE_EQ(solid.volume, 58.0 * 6.0);
  EXPECT_DOUBLE_EQ(group(solid, "left").measure, 90.0);
  EXPECT_DOUBLE_EQ(group(solid, "front").measure, 60.0);
  EXPECT_DOUBLE_EQ(group(solid, "top").measure, 24.0);
  EXPECT_DOUBLE_EQ(group(solid, "pores").measure, 2 * (6.0 + 2 * 3.0 + 2 * 2.0));
  EXPECT_LT(group(solid, "pores").mean_normal.norm(), 1e-15);
  EXPECT_EQ(fact(solid, "closed_pores"), 1.0);
  EXPECT_NEAR(solid.smallest->size, std::cbrt(6.0 * 12.0 / std::numbers::pi), 1e-12);
  EXPECT_EQ(solid.smallest->at, Vec<3>(2.0, 3.0, 7.5));
  double area = 0.0;
  for (const auto& piece : solid.pieces)
    area += (solid.points.col(piece.corners[1]) - solid.points.col(piece.corners[0])).norm() *
            (solid.points.col(piece.corners[2]) - solid.points.col(piece.corners[1])).norm();
  EXPECT_NEAR(area, solid.boundary, 1e-9);
}

TEST(Inspect, AGreyImageIsPartedByTheBestThreshold) {
  const Workspace work;
  std::string pgm = "P2\n40 40\n255\n";
  for (int p = 0; p < 1600; ++p) pgm += std::to_string(p % 4 == 0 ? 20 + p % 37 : 180 + p % 61) + "\n";
  work.write("grey.pgm", pgm);
  const auto grey = std::get<Inspection<2>>(inspect(work / "grey.pgm"));
  EXPECT_EQ(grey.kind, "grey image");
  EXPECT_GT(fact(grey, "threshold"), 56.0);
  EXPECT_LE(fact(grey, "threshold"), 180.0);
  EXPECT_DOUBLE_EQ(grey.volume, 1200.0);
  ASSERT_FALSE(grey.remarks.empty());
  EXPECT_NE(grey.remarks[0].find("threshold"), std::string::npos);
}

TEST(Inspect, AGmshFileHasItsPhysicalNames) {
  const Workspace work;
  const auto strip = std::get<Inspection<2>>(inspect(work / "strip.geo"));
  ASSERT_EQ(strip.bodies.size(), 1u);
  EXPECT_EQ(strip.bodies[0].name, "strip");
  EXPECT_NEAR(strip.volume, 2.0, 1e-12);
  EXPECT_EQ(strip.groups.size(), 4u);
  EXPECT_NEAR(group(strip, "top").measure, 2.0, 1e-12);
  EXPECT_LT((group(strip, "top").mean_normal - Vec<2>(0, 1)).norm(), 1e-12);
  ASSERT_TRUE(strip.smallest.has_value());
  EXPECT_NEAR(strip.smallest->size, 1.0, 0.2);  // its height, told from the mesh

  work.write("two.geo",
             "SetFactory(\"OpenCASCADE\");\nBox(1) = {0, 0, 0, 1, 1, 1};\nBox(2) = {1, 0, 0, 3, 1, 1};\nCoherence;\n");
  const auto two = std::get<Inspection<3>>(inspect(work / "two.geo"));
  ASSERT_EQ(two.bodies.size(), 2u);
  EXPECT_NEAR(two.bodies[0].volume + two.bodies[1].volume, 4.0, 1e-9);
  EXPECT_EQ(two.groups.size(), 11u);
}

TEST(Inspect, ACaseIsSeenWithItsSelections) {
  const Workspace work(replaced(strip_case, "on = \"right\"", "on = { normal = [1, 0] }"));
  const auto strip = std::get<Inspection<2>>(inspect(work / "case.toml"));
  EXPECT_EQ(strip.kind, "case");
  EXPECT_NEAR(group(strip, "normal 1").measure, 1.0, 1e-12);
  EXPECT_LE(fact(strip, "longest_edge"), 0.1 + 1e-12);
}

TEST(Inspect, OfASheetSaysHowManyNodesAndEdgesSpanIt) {
  const Workspace work;
  const std::string rest = R"([material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, 0, 0]
)";
  work.write("sheet.toml", R"([geometry]
shape = "box"
parameters = { width = 2, depth = 1.5, height = 0.2 }
mesh_size = 0.1
[cloud]
spacing = 0.4
)" + rest);
  const auto sheet = std::get<Inspection<3>>(inspect(work / "sheet.toml"));
  ASSERT_TRUE(sheet.walls.has_value());
  EXPECT_DOUBLE_EQ(sheet.walls->share, 1.0);
  EXPECT_DOUBLE_EQ(sheet.walls->spacing, 0.4);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(sheet.walls->thickness[k], 0.2, 1e-12);
    EXPECT_NEAR(sheet.walls->nodes[k], 0.5, 1e-12);
    EXPECT_GT(sheet.walls->edges[k], 2.0);  // none is longer than half of the sheet is thick
    EXPECT_LT(sheet.walls->edges[k], 4.0);
  }
  EXPECT_LT(std::abs(std::abs(sheet.walls->at.z() - 0.1) - 0.1), 1e-12);
  ASSERT_EQ(sheet.remarks.size(), 1u);
  EXPECT_NE(sheet.remarks[0].find("takes more iterations"), std::string::npos) << sheet.remarks[0];

  const auto run = work.efree({"inspect", "sheet.toml"});
  EXPECT_NE(run.output.find("walls: 0.5 nodes across at the thinnest, 0.5 at 5 %, 0.5 at half of the boundary"),
            std::string::npos)
      << run.output;
  EXPECT_EQ(nlohmann::json::parse(work.efree({"inspect", "sheet.toml", "--json"}).output)["walls"]["nodes"].size(), 3u);

  work.write("elements.toml", R"([geometry]
shape = "box"
parameters = { width = 2, depth = 1.5, height = 0.2 }
mesh_size = 0.25
[basis]
kind = "p1"
)" + rest);
  const auto elements = std::get<Inspection<3>>(inspect(work / "elements.toml"));
  ASSERT_TRUE(elements.walls.has_value());
  EXPECT_EQ(elements.walls->spacing, 0.0);
  EXPECT_LT(elements.walls->edges[2], 2.0);
  ASSERT_EQ(elements.remarks.size(), 1u);
  EXPECT_NE(elements.remarks[0].find("smaller mesh_size or quadratic"), std::string::npos) << elements.remarks[0];
}

TEST(Inspect, FindsTheThinnestPlaceOfAPlateAndCountsTheCloudThatIsDenserThere) {
  const Workspace work;
  work.write("plate.geo",
             "SetFactory(\"OpenCASCADE\");\nRectangle(1) = {0, 0, 0, 4, 2};\nDisk(2) = {3, 1.4, 0, 0.5};\n"
             "BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }\n");
  const auto text = [](const std::string& cloud) {
    return R"([geometry]
file = "plate.geo"
mesh_size = 0.04
[analysis]
plane = "stress"
[material]
E = 1
nu = 0.3
[[boundary]]
on = { plane = { point = [0, 0], normal = [1, 0] } }
displacement = [0, 0]
)" + cloud;
  };
  work.write("even.toml", text("[cloud]\nspacing = 0.4\n"));
  const auto even = std::get<Inspection<2>>(inspect(work / "even.toml"));
  ASSERT_TRUE(even.walls.has_value());
  EXPECT_NEAR(even.walls->thickness[0], 0.1, 0.002);  // the hole is a polygon
  EXPECT_NEAR(even.walls->nodes[0], 0.25, 0.005);
  EXPECT_NEAR(even.walls->thickness[2], 2.0, 0.02);
  EXPECT_NEAR(even.walls->at.x(), 3.0, 0.1);
  EXPECT_GT(even.walls->at.y(), 1.85);

  work.write("denser.toml",
             text("[cloud]\nspacing = 0.4\nboxes = [{ box = [[2.5, 1.8], [3.5, 2]], spacing = 0.05 }]\n"));
  EXPECT_NEAR(std::get<Inspection<2>>(inspect(work / "denser.toml")).walls->nodes[0], 2.0, 0.05);
  // What the cloud may not be is a remark, not the end.
  work.write("too_dense.toml",
             text("[cloud]\nspacing = 0.4\nboxes = [{ box = [[2.5, 1.8], [3.5, 2]], spacing = 0.01 }]\n"));
  const auto refused = std::get<Inspection<2>>(inspect(work / "too_dense.toml"));
  ASSERT_FALSE(refused.remarks.empty());
  EXPECT_NE(refused.remarks[0].find("below the edges of the fine mesh"), std::string::npos);
  EXPECT_EQ(refused.walls->spacing, 0.0);
}

TEST(Inspect, ProgramWritesTextOrJsonAndAPicture) {
  const Workspace work;
  work.write("box.off", box_off(3, 2, 0.5));
  const auto text = work.efree({"inspect", "box.off"});
  EXPECT_EQ(text.status, 0) << text.output;
  EXPECT_NE(text.output.find("\"surface 6\"       2     1"), std::string::npos) << text.output;
  EXPECT_NE(text.output.find("smallest feature: wall 0.5"), std::string::npos) << text.output;

  const auto run = work.efree({"inspect", "box.off", "--json", "--out", "seen"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto report = json(work / "seen/inspection.json");
  EXPECT_NEAR(report["volume"], 3.0, 1e-12);
  EXPECT_EQ(report["parts"].size(), 6u);
  EXPECT_EQ(report["facts"]["open_edges"], 0);
  EXPECT_TRUE(fs::exists(work / "seen/geometry.vtu"));
  EXPECT_GT(fs::file_size(work / "seen/geometry.png"), 5000u);
  EXPECT_EQ(nlohmann::json::parse(run.output), report);
}

TEST(Inspect, RefusesBadFilesWithOneMessage) {
  const Workspace work;
  work.write("empty.stl", "");
  work.write("cut.off", box_off(1, 1, 1).substr(0, 60));
  work.write("cut.png", "\x89PNG\r\n\x1a\n");
  work.write("fake.tif", "not a picture");
  work.write("data.raw", "0123");
  work.write("notes.txt", "hello");
  work.write("void.pgm", "P2\n2 2\n1\n0 0 0 0\n");
  work.write("flat.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n");
  work.write("broken.step", "ISO-10303-21;\nHEADER;\n");
  fs::create_directory(work / "folder");
  const std::pair<const char*, const char*> bad[] = {{"none.stl", "there is no file"},
                                                     {"folder", "there is no image in this folder"},
                                                     {"empty.stl", "empty"},
                                                     {"cut.off", "truncated"},
                                                     {"cut.png", "truncated|broken"},
                                                     {"fake.tif", "no TIFF file"},
                                                     {"data.raw", "raw"},
                                                     {"notes.txt", "unknown kind.*stl"},
                                                     {"void.pgm", "background"},
                                                     {"broken.step", "broken.step"}};
  for (const auto& [name, message] : bad) {
    const auto run = work.efree({"inspect", name, "--out", "seen"});
    EXPECT_EQ(run.status, 2) << name << ": " << run.output;
    EXPECT_TRUE(std::regex_search(run.output, std::regex(message))) << run.output;
    EXPECT_EQ(run.output.find('\n'), run.output.size() - 1) << run.output;
    EXPECT_FALSE(fs::exists(work / "seen")) << name;
  }
  const auto flat = std::get<Inspection<3>>(inspect(work / "flat.off"));
  EXPECT_EQ(fact(flat, "degenerate_triangles"), 1.0);
  EXPECT_FALSE(flat.remarks.empty());
}

}  // namespace
}  // namespace efree::test
