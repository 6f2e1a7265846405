// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files of effective properties, from the image to result.json.
#include "efree/tests/io/workspace.hpp"

#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
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
    find_effective(std::get<EffectiveCase>(read_case(body / "case.toml")));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST(EffectiveCase, OfAMeshedBodyOfOneMaterialIsItsOwn) {
  const Workspace work(R"([analysis]
kind = "effective"
[effective]
boundary = "kinematic"
[geometry]
shape = "box"
parameters = { width = 1, depth = 2, height = 3 }
[material]
E = 2
nu = 0.25
conductivity = 3
)");
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(work / "out/result.json");
  EXPECT_NEAR(result["engineering"]["E"][0], 2.0, 1e-6);
  EXPECT_NEAR(result["tensor"][0][1], 0.8, 1e-6);
  EXPECT_NEAR(result["tensor"][5][5], 0.8, 1e-6);
  EXPECT_LT(result["error"]["grid"], 1e-6);
  EXPECT_NEAR(result["volume_fractions"].front(), 1.0, 1e-9);
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
  const EffectiveResult result = find_effective(std::get<EffectiveCase>(read_case(body / "case.toml")));
  ASSERT_TRUE(result.subvolumes);
  EXPECT_EQ(result.subvolumes->count, 8);
  EXPECT_NEAR(result.subvolumes->mean(2, 2), 10.5, 1e-6);
  EXPECT_NEAR(result.subvolumes->deviation(2, 2), std::sqrt(8.0 / 7.0) * 9.5, 1e-6);
  EXPECT_GT(result.tensor.tensor(0, 0), 2.0 / (1.0 + 1.0 / 20.0));
  EXPECT_LT(result.tensor.tensor(0, 0), 10.5);
}

TEST(EffectiveCase, SaysAlongWhichAxisVoidCutsIt) {
  const Body body(fibres, [](double x, double, double) { return x < 6.0 ? 1 : x < 9.0 ? 2 : 0; });
  const EffectiveResult result = find_effective(std::get<EffectiveCase>(read_case(body / "case.toml")));
  EXPECT_TRUE(result.is_cut[0]);
  EXPECT_FALSE(result.is_cut[1]);
  EXPECT_EQ(result.inverse.size(), 0);
  EXPECT_THAT(result.warnings.at(0), HasSubstr("no stiffness along x"));
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
  EXPECT_THAT(complaint(replaced(fibres, "size = [12, 12, 12]", "size = [12, 144]")), HasSubstr("planar"));
  EXPECT_THAT(complaint(fibres, [](double, double, double) { return 0; }), HasSubstr("all of it is background"));
  EXPECT_THAT(complaint(fibres,
                        [](double x, double y, double z) {
                          return std::hypot(x - 6.0, y - 6.0, z - 6.0) < 4.0 ? 2 : x + y + z < 2.0 ? 1 : 0;
                        }),
              HasSubstr("the volume has no stiffness"));
  EXPECT_THAT(complaint(replaced(fibres, "\"effective\"", "\"static\"")), HasSubstr("[effective] is for effective"));
}

}  // namespace efree
