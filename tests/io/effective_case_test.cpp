// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files of effective properties, from the image to result.json.
#include "efree/tests/io/workspace.hpp"

#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>

namespace efree {
namespace {

using test::json, test::replaced, test::Workspace;
using ::testing::HasSubstr;

/// Fibres along z, two across, in a matrix: 12 x 12 x 12 voxels.
const std::string fibres = R"([analysis]
kind = "effective"
[effective]
boundary = "periodic"
interfaces = "voxels"
[geometry]
file = "body.raw"
image = { raw = { size = [12, 12, 12], type = "uint8" }, regions = { 1 = "matrix", 2 = "fibre" } }
[[material]]
region = "matrix"
E = 1
nu = 0.3
conductivity = 1
[[material]]
region = "fibre"
E = 10
nu = 0.2
conductivity = 20
)";

struct Body : Workspace {
  explicit Body(const std::string& text, const std::function<int(double x, double y, double z)>& label = fibre)
      : Workspace(text) {
    std::ofstream image(*this / "body.raw", std::ios::binary);
    for (int p = 0; p < 12 * 12 * 12; ++p)
      image.put(static_cast<char>(label(p % 12 + 0.5, p / 12 % 12 + 0.5, p / 144 + 0.5)));
  }
  static int fibre(double x, double y, double) { return std::hypot(x - 6.0, y - 6.0) < 3.5 ? 2 : 1; }
};

std::string complaint(const std::string& text, const std::function<int(double, double, double)>& label = Body::fibre) {
  const Body body(text, label);
  try {
    std::visit(
        [](const auto& analysis) {
          if constexpr (requires { analysis.property; }) find_effective(analysis);
        },
        read_case(body / "case.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST(EffectiveCase, GapsThatCellsCloseAreWarnedOf) {
  const std::string text = R"([analysis]
kind = "effective"
[geometry]
file = "body.raw"
mesh_size = SIZE
image = { raw = { size = [12, 12, 12], type = "uint8" } }
[material]
E = 1
nu = 0.3
)";
  const auto slit = [](double x, double, double z) { return x > 6.0 && x < 7.0 && z > 2.0 ? 0 : 1; };
  for (const auto& [size, closed] : {std::pair("2", true), {"0.5", false}}) {
    const Body body(replaced(text, "SIZE", size), slit);
    const auto run = body.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    ASSERT_EQ(run.status, 0) << run.output;
    EXPECT_EQ(run.output.find("gaps narrower than two cells are closed") != std::string::npos, closed) << run.output;
  }
}

TEST(EffectiveCase, OfAMeshedBodyOfOneMaterialIsItsOwn) {
  for (const char* boundary : {"periodic", "kinematic", "static"}) {
    const Workspace work(replaced(R"([analysis]
kind = "effective"
[effective]
boundary = "BOUNDARY"
[geometry]
shape = "box"
parameters = { width = 1, depth = 2, height = 3 }
mesh_size = 0.4
[material]
E = 2
nu = 0.25
conductivity = 3
)",
                                  "BOUNDARY", boundary));
    const auto run = work.efree({"solve", "case.toml", "--out", "out"});
    ASSERT_EQ(run.status, 0) << run.output;
    const auto result = json(work / "out/result.json");
    EXPECT_NEAR(result["engineering"]["E"][0], 2.0, 1e-8);
    EXPECT_NEAR(result["tensor"][0][1], 0.8, 1e-8);
    EXPECT_NEAR(result["tensor"][5][5], 0.8, 1e-8);
    EXPECT_LT(result["error"]["grid"], 1e-8);
    EXPECT_NEAR(result["volume_fractions"].front(), 1.0, 1e-9);
  }
}

TEST(EffectiveCase, SubvolumesAreOfImagesAndImagesTakeNoMesher) {
  const Workspace box(
      "[analysis]\nkind = \"effective\"\n[effective]\nsubvolumes = 2\n[geometry]\nshape = \"box\"\nparameters = { "
      "width = 1, depth = 1, height = 1 }\n[material]\nE "
      "= 2\nnu = 0.25\n");
  auto run = box.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, HasSubstr("subvolumes is for images in space; this geometry is a mesh"));
  const Body mesh(replaced(fibres, "type = \"uint8\" }", "type = \"uint8\" }, mesher = \"delaunay\""));
  run = mesh.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, HasSubstr("images in space are solved on the grid of their voxels here"));
}

TEST(EffectiveCase, GivesTheTensorOfFibresAndWhatItSays) {
  const Body body(fibres);
  const Workspace::Run run = body.efree({"solve", "case.toml", "--out", "out", "--quiet"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(body / "out/result.json");
  EXPECT_EQ(result["property"], "stiffness");
  EXPECT_NEAR(result["volume_fractions"]["fibre"].get<double>() + result["volume_fractions"]["matrix"].get<double>(),
              1.0, 1e-12);
  const double f = result["volume_fractions"]["fibre"];
  // Along fibres nearly the mean (Hill 1964).
  EXPECT_NEAR(result["engineering"]["E"][2].get<double>(), f * 10.0 + (1.0 - f) * 1.0, 0.02);
  EXPECT_NEAR(result["tensor"][0][0].get<double>(), result["tensor"][1][1].get<double>(), 1e-6);
  EXPECT_GT(result["symmetry"]["distances"]["isotropic"].get<double>(), 0.1);
  EXPECT_LT(result["symmetry"]["distances"]["orthotropic"].get<double>(), 1e-6);
  EXPECT_LT(result["error"]["grid"].get<double>(), 0.05);
  EXPECT_GT(result["anisotropy"]["universal"].get<double>(), 0.1);
  for (const char* modulus : {"kappa", "mu"}) {
    const auto& bounds = result["bounds"][modulus];
    EXPECT_LE(bounds["reuss_voigt"][0].get<double>(), bounds["hashin_shtrikman"][0].get<double>());
    EXPECT_LE(bounds["hashin_shtrikman"][0].get<double>(), bounds["hashin_shtrikman"][1].get<double>());
    EXPECT_LE(bounds["hashin_shtrikman"][1].get<double>(), bounds["reuss_voigt"][1].get<double>());
  }
}

TEST(EffectiveCase, OrthotropicFibresCountByTheirModulusAlongThem) {
  const Body body(replaced(fibres, "E = 10\nnu = 0.2\n",
                           "model = \"orthotropic\"\nE = [10, 2, 2]\nnu = [0.3, 0.25, 0.25]\nG = [0.8, 1.5, 1.5]\n"
                           "axes = [[0, 0, 1], [1, 0, 0]]\n"));
  const Workspace::Run run = body.efree({"solve", "case.toml", "--out", "out", "--quiet"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(body / "out/result.json");
  const double f = result["volume_fractions"]["fibre"];
  EXPECT_NEAR(result["engineering"]["E"][2].get<double>(), f * 10.0 + (1.0 - f) * 1.0, 0.02);
  EXPECT_LT(result["engineering"]["E"][0].get<double>(), f * 2.0 + (1.0 - f) * 1.0);
  EXPECT_FALSE(result.contains("bounds")) << "those are of isotropic phases";
}

TEST(EffectiveCase, OfSubvolumesSaysHowTheyScatter) {
  const std::string text = replaced(fibres, "boundary = \"periodic\"",
                                    "property = \"conductivity\"\nsubvolumes = 2\nboundary = \"kinematic\"");
  const Body body(text, [](double x, double, double) { return x < 6.0 ? 1 : 2; });
  const EffectiveResult result = find_effective(std::get<EffectiveCase<3>>(read_case(body / "case.toml")));
  ASSERT_TRUE(result.subvolumes);
  EXPECT_EQ(result.subvolumes->count, 8);
  EXPECT_NEAR(result.subvolumes->mean(2, 2), 10.5, 1e-6);
  EXPECT_NEAR(result.subvolumes->deviation(2, 2), std::sqrt(8.0 / 7.0) * 9.5, 1e-6);
  EXPECT_GT(result.tensor.tensor(0, 0), 2.0 / (1.0 + 1.0 / 20.0));
  EXPECT_LT(result.tensor.tensor(0, 0), 10.5);
}

TEST(EffectiveCase, SaysAlongWhichAxisVoidCutsIt) {
  const Body body(fibres, [](double x, double, double) { return x < 6.0 ? 1 : x < 9.0 ? 2 : 0; });
  const EffectiveResult result = find_effective(std::get<EffectiveCase<3>>(read_case(body / "case.toml")));
  EXPECT_TRUE(result.is_cut[0]);
  EXPECT_FALSE(result.is_cut[1]);
  EXPECT_EQ(result.inverse.size(), 0);
  EXPECT_THAT(result.warnings.at(0), HasSubstr("no stiffness along x"));
}

EffectiveResult result_of_planar(const std::filesystem::path& file) {
  return find_effective(std::get<EffectiveCase<2>>(read_case(file)));
}

/// Stiffness: isotropic. Conductivity: a series in the fraction of fibres (Perrins, McKenzie & McPhedran 1979).
TEST(EffectiveCase, OfAHexagonalArrayOfFibresIsIsotropicInThePlane) {
  const std::filesystem::path file = std::filesystem::path(EFREE_EXAMPLES) / "fibre_composite/case.toml";
  EffectiveCase<2> analysis = std::get<EffectiveCase<2>>(read_case(file));
  const EffectiveResult stiffness = find_effective(analysis);
  EXPECT_EQ(stiffness.plane_nearest, PlaneSymmetryClass::isotropic);
  EXPECT_LT(stiffness.plane_symmetry->distances[0], 1e-3);
  EXPECT_LT(stiffness.tensor.grid_error, 0.02);
  const Workspace work(replaced(R"([analysis]
kind = "effective"
[effective]
property = "conductivity"
[geometry]
file = "CELL"
parameters = { fraction = 0.6 }
mesh_size = 0.05
[[material]]
region = "matrix"
conductivity = 1
[[material]]
region = "fibres"
conductivity = 10
)",
                                "CELL", (file.parent_path() / "cell.geo").string()));
  const EffectiveResult result = result_of_planar(work / "case.toml");
  const double f = 0.6, T = -11.0 / 9.0,
               exact = 1.0 - 2.0 * f /
                                 (T + f - 0.075422 * std::pow(f, 6) * T / (T * T - 1.060283 * std::pow(f, 12)) -
                                  0.000076 * std::pow(f, 12) / T);
  EXPECT_NEAR(result.tensor.tensor(0, 0), exact, 0.005 * exact);
  EXPECT_NEAR(result.tensor.tensor(1, 1), exact, 0.005 * exact);
  EXPECT_NEAR(result.tensor.tensor(0, 0), exact, 1.5 * result.tensor.grid_error * exact);
  EXPECT_LT(result.tensor.grid_error, 0.01);
  EXPECT_GT(result.tensor.tensor(0, 0), result.conductivity_bounds->hashin_shtrikman[0]);
  EXPECT_LT(result.tensor.tensor(0, 0), result.conductivity_bounds->hashin_shtrikman[1]);
}

/// sqrt(k1 k2) (Keller 1964). The field is singular where four squares meet: cells of a file that grow from there.
TEST(EffectiveCase, OfACheckerboardIsTheGeometricMean) {
  const Workspace work(R"([analysis]
kind = "effective"
[effective]
property = "conductivity"
[geometry]
file = "board.geo"
[[material]]
region = "a"
conductivity = 1
[[material]]
region = "b"
conductivity = 10
)");
  std::ofstream(work / "board.geo") << R"(
For i In {0:2}
  For j In {0:2}
    Point(1 + i + 3 * j) = {0.5 * i, 0.5 * j, 0};
  EndFor
EndFor
For j In {0:2}
  Line(1 + 2 * j) = {1 + 3 * j, 2 + 3 * j};
  Line(2 + 2 * j) = {2 + 3 * j, 3 + 3 * j};
  Line(11 + 2 * j) = {1 + j, 4 + j};
  Line(12 + 2 * j) = {4 + j, 7 + j};
EndFor
Curve Loop(1) = {1, 13, -3, -11}; Plane Surface(1) = {1};
Curve Loop(2) = {2, 15, -4, -13}; Plane Surface(2) = {2};
Curve Loop(3) = {3, 14, -5, -12}; Plane Surface(3) = {3};
Curve Loop(4) = {4, 16, -6, -14}; Plane Surface(4) = {4};
Physical Surface("a") = {1, 4};
Physical Surface("b") = {2, 3};
Field[1] = Distance; Field[1].PointsList = {1:9};
Field[2] = MathEval; Field[2].F = "0.0005 + 0.2 * F1";
Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0; Mesh.MeshSizeFromPoints = 0;
)";
  const EffectiveResult result = result_of_planar(work / "case.toml");
  const double exact = std::sqrt(10.0);
  for (int d = 0; d < 2; ++d) {
    EXPECT_NEAR(result.tensor.tensor(d, d), exact, 0.005 * exact);
    EXPECT_LT(std::abs(result.tensor.tensor(d, d) - exact), result.tensor.grid_error * exact);
  }
}

/// Layers along y of a planar image, in plane strain and stress, by the closed form for both (Backus 1962).
TEST(EffectiveCase, OfLayersInThePlaneIsExact) {
  const std::string layers = R"([analysis]
kind = "effective"
plane = "PLANE"
[effective]
boundary = "periodic"
[geometry]
file = "layers.raw"
mesh_size = 0.4
image = { raw = { size = [2, 4], type = "uint8" }, regions = { 1 = "a", 2 = "b" } }
[[material]]
region = "a"
E = 1
nu = 0.3
[[material]]
region = "b"
E = 10
nu = 0.2
)";
  for (const bool is_stress : {false, true}) {
    const Workspace work(replaced(layers, "PLANE", is_stress ? "stress" : "strain"));
    std::ofstream(work / "layers.raw", std::ios::binary) << "\1\1\1\1\1\1\2\2";
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--quiet"});
    ASSERT_EQ(run.status, 0) << run.output;
    const auto result = json(work / "out/result.json");
    const auto stiffness = [&](double E, double nu) {
      const double e = is_stress ? E : E / (1.0 - nu * nu), n = is_stress ? nu : nu / (1.0 - nu);
      return Vec<2>(e / (1.0 - n * n), n);  // along one axis, and the ratio of the other stress to it
    };
    const Vec<2> a = stiffness(1.0, 0.3), b = stiffness(10.0, 0.2);
    const double M = 1.0 / (0.75 / a[0] + 0.25 / b[0]), ratio = 0.75 * a[1] + 0.25 * b[1],
                 G = 1.0 / (0.75 * 2.6 + 0.25 * 2.4 / 10.0),
                 along = 0.75 * a[0] * (1.0 - a[1] * a[1]) + 0.25 * b[0] * (1.0 - b[1] * b[1]) + ratio * ratio * M;
    EXPECT_EQ(result["plane"], is_stress ? "stress" : "strain");
    EXPECT_NEAR(result["tensor"][1][1], M, 1e-8);
    EXPECT_NEAR(result["tensor"][0][1], ratio * M, 1e-8);
    EXPECT_NEAR(result["tensor"][0][0], along, 1e-8);
    EXPECT_NEAR(result["tensor"][2][2], G, 1e-8);
    EXPECT_LT(result["error"]["grid"], 1e-8);
    EXPECT_EQ(result["symmetry"]["nearest"], "orthotropic");
    EXPECT_NEAR(result["engineering"]["G"]["xy"], G, 1e-8);
    EXPECT_NEAR(result["engineering"]["E"][1], M - ratio * ratio * M * M / along, 1e-7);
    EXPECT_EQ(result["volume_fractions"].size(), 2);
    for (const char* modulus : {"kappa", "mu"}) {
      const auto& bounds = result["bounds"][modulus];
      const double value = result["isotropic_part"][modulus];
      EXPECT_LT(bounds["reuss_voigt"][0], bounds["hashin_shtrikman"][0]);
      EXPECT_LT(bounds["hashin_shtrikman"][1], bounds["reuss_voigt"][1]);
      EXPECT_LT(bounds["reuss_voigt"][0], value);
      EXPECT_GT(bounds["reuss_voigt"][1], value);
    }
  }
}

/// Conditions in their order (Huet 1990), and the composite cylinders of Hashin & Rosen (1964), whose plane bulk
/// modulus is Hashin's bound, as the least a square array can have.
TEST(EffectiveCase, OfAPlanarPictureIsBetweenItsBounds) {
  const std::string disk = R"([analysis]
kind = "effective"
plane = "strain"
[effective]
boundary = "BOUNDARY"
[geometry]
file = "disk.raw"
image = { raw = { size = [20, 20], type = "uint8" }, contour = "smooth", regions = { 1 = "matrix", 2 = "disk" } }
mesh_size = 1.5
[[material]]
region = "matrix"
E = 1
nu = 0.3
[[material]]
region = "disk"
E = 10
nu = 0.2
)";
  std::vector<EffectiveResult> results;
  for (const char* boundary : {"static", "periodic", "kinematic"}) {
    const Workspace work(replaced(disk, "BOUNDARY", boundary));
    std::ofstream image(work / "disk.raw", std::ios::binary);
    for (int p = 0; p < 400; ++p) image.put(std::hypot(p % 20 - 9.5, p / 20 - 9.5) < 6.0 ? 2 : 1);
    image.close();
    results.push_back(result_of_planar(work / "case.toml"));
  }
  for (std::size_t i = 1; i < results.size(); ++i)
    EXPECT_GT(
        Eigen::SelfAdjointEigenSolver<Matrix>(results[i].tensor.tensor - results[i - 1].tensor.tensor).eigenvalues()[0],
        0.0);
  const EffectiveResult& periodic = results[1];
  EXPECT_EQ(periodic.plane_nearest, PlaneSymmetryClass::square);
  EXPECT_GT(periodic.plane_symmetry->kappa, periodic.kappa_bounds->hashin_shtrikman[0]);
  EXPECT_LT(periodic.plane_symmetry->kappa, 1.02 * periodic.kappa_bounds->hashin_shtrikman[0]);
  EXPECT_GT(periodic.plane_symmetry->mu, periodic.mu_bounds->hashin_shtrikman[0]);
}

TEST(EffectiveCase, OfAPlasticMaterialSaysThatItsStiffnessAtRestIsTaken) {
  const Workspace work(R"([analysis]
kind = "effective"
plane = "strain"
[geometry]
shape = "rectangle"
parameters = { width = 1, height = 2 }
[material]
model = "j2"
E = 2
nu = 0.25
yield = 0.01
)");
  const EffectiveResult result = result_of_planar(work / "case.toml");
  EXPECT_NEAR(result.tensor.tensor(0, 0), 2.4, 1e-8);
  EXPECT_THAT(result.warnings, ::testing::Contains(HasSubstr("is not linear, and its stiffness where nothing")));
}

TEST(EffectiveCase, IsRefusedInOneSentence) {
  EXPECT_THAT(complaint(fibres + "[[boundary]]\non = \"left\"\ndisplacement = [0, 0, 0]\n"),
              HasSubstr("[boundary] means nothing for effective properties"));
  EXPECT_THAT(complaint(fibres + "[cloud]\nspacing = 1\n"), HasSubstr("[cloud] means nothing"));
  EXPECT_THAT(complaint(replaced(fibres, "\"periodic\"", "\"period\"")),
              HasSubstr("boundary is \"period\", expected \"periodic\" or \"kinematic\" or \"static\""));
  EXPECT_THAT(complaint(replaced(fibres, "[effective]", "[effective]\nsubvolumes = 5")),
              HasSubstr("subvolumes is 5, which does not divide the 12 voxels along x"));
  EXPECT_THAT(complaint(replaced(fibres, "\"fibre\"\nE", "\"fibres\"\nE")), HasSubstr("region \"fibre\""));
  EXPECT_THAT(complaint(replaced(replaced(fibres, "[effective]", "[effective]\nproperty = \"conductivity\""),
                                 "conductivity = 20\n", "")),
              HasSubstr("key \"conductivity\" is missing"));
  EXPECT_THAT(complaint(replaced(fibres, "size = [12, 12, 12]", "size = [12, 144]")),
              HasSubstr("key \"plane\" is missing"));
  EXPECT_THAT(complaint(fibres, [](double, double, double) { return 0; }), HasSubstr("all of it is background"));
  EXPECT_THAT(complaint(fibres,
                        [](double x, double y, double z) {
                          return std::hypot(x - 6.0, y - 6.0, z - 6.0) < 4.0 ? 2 : x + y + z < 2.0 ? 1 : 0;
                        }),
              HasSubstr("the volume has no stiffness"));
  EXPECT_THAT(complaint(replaced(fibres, "\"effective\"", "\"static\"")), HasSubstr("[effective] is for effective"));
  EXPECT_THAT(complaint(replaced(fibres, "\"effective\"", "\"effective\"\nessential = \"strong\"")),
              HasSubstr("unknown key \"essential\" in [analysis]"));
  const auto planar = [](const std::string& more) {
    return "[analysis]\nkind = \"effective\"\n" + more +
           "[geometry]\nshape = \"rectangle\"\nparameters = { width = 1, height = 1 }\n";
  };
  const std::string steel = "[material]\nE = 2\nnu = 0.25\nconductivity = 3\n";
  EXPECT_THAT(complaint(planar("plane = \"axisymmetric\"\n") + steel),
              HasSubstr("plane is \"axisymmetric\", expected \"strain\" or \"stress\""));
  EXPECT_THAT(complaint(planar("plane = \"strain\"\n[effective]\nsubvolumes = 2\n") + steel),
              HasSubstr("subvolumes is for images in space; this geometry is planar"));
  EXPECT_THAT(complaint(planar("plane = \"strain\"\n") + "mesh_ratio = 3\n" + steel),
              HasSubstr("mesh_ratio is relative to a cloud"));
  EXPECT_THAT(complaint(planar("[effective]\nproperty = \"conductivity\"\n") +
                        "[[material]]\nregion = \"x\"\nconductivity = 1\n"),
              HasSubstr("there is no region \"x\" in the mesh"));
}

}  // namespace efree
