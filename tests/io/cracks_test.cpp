// SPDX-License-Identifier: GPL-3.0-or-later
/// efree cracks: meshes of the cracks of a finished run.
#include "efree/bench/elastic_block.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/io/records/crack_files.hpp"
#include "efree/io/records/dynamics_record.hpp"
#include "efree/tests/io/workspace.hpp"

#include <gmock/gmock.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <cmath>
#include <cstring>
#include <map>

namespace efree::test {
namespace {

using ::testing::HasSubstr;

/// A strip with a notch is torn in two by its ends.
const std::string torn = R"toml(title = "torn strip"
[geometry]
file = "notched.geo"
mesh_size = 0.25
[analysis]
kind = "dynamics"
plane = "strain"
[mpm]
cell = 0.1
[material]
model = "rankine"
E = 1
nu = 0.2
strength = 0.05
fracture_energy = 0.002
length = 0.2
density = 1
[[velocity]]
value = ["0.03 * (x - 1)", 0]
[[boundary]]
on = "left"
velocity = [-0.03, "free"]
[[boundary]]
on = "right"
velocity = [0.03, "free"]
[time]
end = 5
[output]
frames = 4
)toml";
const std::string notched = R"(
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 2, 1};
Rectangle(2) = {0.9, 0.7, 0, 0.2, 1};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }
Physical Surface("strip") = {1};
eps = 1e-3;
Physical Curve("left") = Curve In BoundingBox{-eps, -eps, -eps, eps, 1 + eps, eps};
Physical Curve("right") = Curve In BoundingBox{2 - eps, -eps, -eps, 2 + eps, 1 + eps, eps};
)";

/// The columns of a table.
std::map<std::string, std::vector<double>> table(const fs::path& file) {
  std::istringstream lines(content(file));
  std::string line, word;
  std::getline(lines, line);
  std::vector<std::string> names;
  for (std::istringstream words(line); std::getline(words, word, ',');) names.push_back(word);
  std::map<std::string, std::vector<double>> columns;
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    for (const std::string& name : names) std::getline(words, word, ','), columns[name].push_back(std::stod(word));
  }
  return columns;
}

/// The area of the cells of a file at the start.
double area_at_start(const fs::path& file) {
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  vtkUnstructuredGrid* grid = reader->GetOutput();
  vtkDataArray* start = grid->GetPointData()->GetArray("start");
  double sum = 0.0;
  for (vtkIdType c = 0; c < grid->GetNumberOfCells(); ++c) {
    std::array<std::array<double, 3>, 3> x{};
    for (int i = 0; i < 3; ++i) start->GetTuple(grid->GetCell(c)->GetPointId(i), x[i].data());
    sum += 0.5 * ((x[1][0] - x[0][0]) * (x[2][1] - x[0][1]) - (x[1][1] - x[0][1]) * (x[2][0] - x[0][0]));
  }
  return sum;
}

TEST(CrackCommand, TornStripFallsIntoTwoPartsWhoseFilesSayTheSame) {
  const Workspace work(torn);
  work.write("notched.geo", notched);
  const auto run = work.efree({"run", "case.toml", "--out", "out", "--quiet", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto cracks = work.efree({"cracks", "out"});
  ASSERT_EQ(cracks.status, 0) << cracks.output;
  EXPECT_THAT(cracks.output, HasSubstr("crack length"));
  const fs::path folder = work / "out/cracks";
  auto numbers = table(folder / "cracks.csv");
  ASSERT_EQ(numbers["t"].size(), 5);
  EXPECT_TRUE(std::ranges::is_sorted(numbers["cut_edges"]));
  EXPECT_EQ(numbers["cut_edges"].front(), 0.0);
  EXPECT_EQ(numbers["parts"].front(), 1.0);
  EXPECT_EQ(numbers["parts"].back(), 2.0);
  EXPECT_NEAR(numbers["largest_part"].back(), 0.5, 0.02);
  // Below the notch 0.7 are left; the crack has branches.
  EXPECT_GT(numbers["crack_area"].back(), 0.68);
  EXPECT_LT(numbers["crack_area"].back(), 2.5);

  for (const char* frame : {"0000", "0004"}) {
    const std::string name = std::string("cracks_") + frame;
    EXPECT_NEAR(area_at_start(folder / (name + ".vtu")), 1.94, 1e-9);
    EXPECT_GT(fs::file_size(folder / (name + ".png")), 10000);
    // Objects and indices.
    const std::string obj = content(folder / (name + ".obj"));
    EXPECT_THAT(obj, HasSubstr("\no surface\nf "));
    EXPECT_EQ(obj.find("\nl ") != std::string::npos, frame == std::string("0004"));
    // Lengths of a binary glTF file: of all, of its JSON, of its numbers.
    const std::string glb = content(folder / (name + ".glb"));
    const auto word = [&](std::size_t at) {
      std::uint32_t value = 0;
      std::memcpy(&value, glb.data() + at, 4);
      return value;
    };
    EXPECT_EQ(glb.substr(0, 4), "glTF");
    EXPECT_EQ(word(8), glb.size());
    const auto json = nlohmann::json::parse(glb.substr(20, word(12)));
    EXPECT_EQ(20 + word(12) + 8 + word(20 + word(12)), glb.size());
    EXPECT_EQ(json["buffers"][0]["byteLength"], word(20 + word(12)));
    for (const auto& accessor : json["accessors"]) {
      const auto& view = json["bufferViews"][accessor["bufferView"].get<std::size_t>()];
      const int components = accessor["type"] == "VEC3" ? 3 : 1;
      EXPECT_EQ(view["byteLength"].get<int>(), 4 * components * accessor["count"].get<int>());
    }
  }

  // Nothing of an earlier run stays; more stretch, less cuts.
  work.write("out/cracks/cracks_0017.vtu", "old");
  work.write("out/cracks/mine.txt", "kept");
  EXPECT_EQ(work.efree({"cracks", "out", "--stretch", "3", "--no-picture", "--colour", "J"}).status, 0);
  EXPECT_FALSE(fs::exists(folder / "cracks_0017.vtu"));
  EXPECT_FALSE(fs::exists(folder / "cracks_0004.png"));
  EXPECT_TRUE(fs::exists(folder / "mine.txt"));
  EXPECT_LT(table(folder / "cracks.csv")["cut_edges"].back(), numbers["cut_edges"].back());

  // Wrong input changes no earlier result.
  const std::string before = content(folder / "cracks.csv");
  const auto expect_refused = [&](const std::vector<std::string>& arguments, const std::string& message) {
    const auto refused = work.efree(arguments);
    EXPECT_EQ(refused.status, 2) << refused.output;
    EXPECT_THAT(refused.output, HasSubstr(message));
    EXPECT_EQ(content(folder / "cracks.csv"), before);
  };
  expect_refused({"cracks", "nowhere"}, "expected the folder of a run of explicit dynamics");
  expect_refused({"cracks", "out", "--stretch", "1"}, "--stretch: 1, expected a number of more than 1");
  expect_refused({"cracks", "out", "--stretch", "nan"}, "stretch");
  expect_refused({"cracks", "out", "--smoothing", "-1"}, "--smoothing");
  expect_refused({"cracks", "out", "--colour", "dammage"},
                 "there is no field \"dammage\"; the points have \"von_mises\"");
  const std::string series = content(work / "out/points.pvd");
  for (const char* time : {"nan", "1.5abc", "-1"}) {
    // Of the last frame.
    const auto begin = series.rfind("timestep=\"") + 10;
    std::string wrong = series;
    work.write("out/points.pvd", wrong.replace(begin, series.find('"', begin) - begin, time));
    expect_refused({"cracks", "out"}, "expected times that grow");
  }
  work.write("out/points.pvd", std::string(3000000, 'x') + "\n" + series);
  EXPECT_EQ(work.efree({"cracks", "out", "--no-picture", "--stretch", "3", "--colour", "J", "--out", "there"}).status,
            0);
  work.write("out/points.pvd", series);
  expect_refused({"cracks", "out", "--out", ""}, "empty");
  fs::resize_file(work / "out/points_0002.vtu", fs::file_size(work / "out/points_0002.vtu") / 2);
  expect_refused({"cracks", "out"}, "points_0002.vtu: the file is damaged, or empty");
  fs::remove(work / "out/points_0002.vtu");
  expect_refused({"cracks", "out"}, "points_0002.vtu: the file is missing");
  work.write("out/points_0002.vtu", "no grid");
  expect_refused({"cracks", "out"}, "points_0002.vtu: expected an unstructured grid");
  fs::copy_file(work / "out/nodes_0001.vtu", work / "out/points_0002.vtu", fs::copy_options::overwrite_existing);
  expect_refused({"cracks", "out"}, "frame 2 has");
}

TEST(CrackSeries, PointsWithoutAMeshAreJoinedByThemselvesAndNodesOfOtmByTheirCells) {
  const Workspace work;
  const FineMesh<2> mesh = bench::block<2>(1.0, 0.25);
  const MpmOptions options{.cell = 0.2};
  Dynamics<2> points({points_on_lattice<2>(mesh, options, 2, bench::soft(), 1.0)}, mpm<2>(options));
  DynamicsRecord<2>(work / "points").add_frame(points);
  ASSERT_EQ(recorded_dimension(work / "points"), 2);
  const RecordedRun<2> alone(work / "points");
  CrackSeries<2> series(alone, {});
  const CrackFrame<2> frame = series.next();
  EXPECT_FALSE(series.has_next());
  EXPECT_EQ(frame.mesh.current, points.points());
  EXPECT_NEAR(frame.mesh.volumes.sum(), 0.81, 1e-6);  // half a point's width is missing all around

  Dynamics<2> cells({deformable_body(mesh, bench::soft(), 1.0)}, otm<2>());
  DynamicsRecord<2> record(work / "cells");
  record.add_bodies(mesh);
  record.add_frame(cells);
  const RecordedRun<2> run(work / "cells");
  const CrackFrame<2> whole = CrackSeries<2>(run, {}).next();
  EXPECT_EQ(whole.mesh.cells, mesh.cells());
  EXPECT_EQ(whole.mesh.current, mesh.vertices());
}

TEST(CrackSeries, BodiesThatCannotBeFollowedAreRefused) {
  const Workspace work;
  const FineMesh<2> mesh = bench::block<2>(1.0, 0.25);
  DeformableBody<2> body = deformable_body(mesh, bench::soft(), 1.0);
  Dynamics<2> cells({body}, otm<2>());
  DynamicsRecord<2> record(work / "broken");
  record.add_bodies(mesh);
  record.add_frame(cells);
  cells.erode(7);
  record.add_frame(cells);
  const RecordedRun<2> broken(work / "broken");
  CrackSeries<2> series(broken, {});
  series.next();
  EXPECT_THAT([&] { series.next(); },
              testing::ThrowsMessage<InputError>(HasSubstr("in frame 1 nodes are merged or points")));

  const auto refused = [&](const std::string& folder) {
    const RecordedRun<2> run(work / folder);
    CrackSeries<2>(run, {});
  };
  // Points in a line, and too few of them.
  const MpmOptions options{.cell = 0.2};
  const auto record_points = [&](const std::string& folder, const Points<2>& points, const FineMesh<2>* of) {
    DeformableBody<2> some = points_on_lattice<2>(mesh, options, 2, bench::soft(), 1.0);
    some.points = points;
    some.volumes = Vector::Constant(points.cols(), 0.01);
    some.patches.clear();
    const Dynamics<2> dynamics({some}, mpm<2>(options));
    DynamicsRecord<2> of_points(work / folder);
    if (of) of_points.add_bodies(*of);
    of_points.add_frame(dynamics);
  };
  Points<2> line(2, 5);
  line << 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5;
  record_points("line", line, nullptr);
  EXPECT_THAT([&] { refused("line"); },
              testing::ThrowsMessage<InputError>(HasSubstr("points of body 0 are too far apart, or all in a line")));
  record_points("few", line.leftCols(2), nullptr);
  EXPECT_THAT([&] { refused("few"); },
              testing::ThrowsMessage<InputError>(HasSubstr("body 0 has 2 material points, expected 3")));
  record_points("elsewhere", line.array() + 7.0, &mesh);
  EXPECT_THAT([&] { refused("elsewhere"); }, testing::ThrowsMessage<InputError>(HasSubstr("it is of another run")));
}

/// In space, by the program: a block of two halves that fly apart is one body, and then two.
TEST(CrackCommand, InSpaceSurfacesAreClosedAndGltfHasCracks) {
  const Workspace work(R"toml(title = "halves"
[geometry]
shape = "box"
parameters = { width = 1, depth = 0.5, height = 0.5 }
mesh_size = 0.3
[analysis]
kind = "dynamics"
[mpm]
cell = 0.125
[material]
model = "rankine"
E = 1
nu = 0.2
strength = 0.01
fracture_energy = 0.0002
length = 0.25
density = 1
[[velocity]]
value = ["0.1*(x - 0.5)", 0, 0]
[[boundary]]
on = "left"
velocity = ["-0.05", 0, 0]
[[boundary]]
on = "right"
velocity = [0.05, 0, 0]
[time]
end = 9
[output]
frames = 1
)toml");
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "out", "--quiet", "--no-picture"}).status, 0);
  const auto cracks = work.efree({"cracks", "out", "--quiet"});
  ASSERT_EQ(cracks.status, 0) << cracks.output;
  EXPECT_GT(table(work / "out/cracks/cracks.csv")["parts"].back(), 1.0);
  // Every side of a triangle is that of another one, the other way.
  std::istringstream lines(content(work / "out/cracks/cracks_0001.obj"));
  std::map<std::pair<int, int>, int> sides;
  bool has_cracks = false;
  for (std::string line; std::getline(lines, line);) {
    has_cracks |= line == "o cracks";
    if (line.rfind("f ", 0) != 0) continue;
    std::istringstream words(line.substr(2));
    std::array<int, 3> corner{};
    words >> corner[0] >> corner[1] >> corner[2];
    for (int i = 0; i < 3; ++i) {
      const int a = corner[i], b = corner[(i + 1) % 3];
      sides[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  }
  EXPECT_TRUE(has_cracks);
  EXPECT_GT(sides.size(), 100);
  for (const auto& [side, sum] : sides) EXPECT_EQ(sum, 0);
  const std::string glb = content(work / "out/cracks/cracks_0001.glb");
  EXPECT_EQ(nlohmann::json::parse(glb.substr(20, glb.find("BIN") - 24))["meshes"][0]["primitives"].size(), 2);
}

}  // namespace
}  // namespace efree::test
