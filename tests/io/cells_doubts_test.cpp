// SPDX-License-Identifier: GPL-3.0-or-later
/// What answers on cells have to warn of, and the errors that they state.
#include "efree/tests/io/workspace.hpp"

#include "efree/io/case/case_file.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <functional>
#include <limits>

namespace efree {
namespace {

using test::json, test::replaced, test::Workspace;
using ::testing::HasSubstr, ::testing::Not;

/// A bar of 40 x 8 x 8 voxels, pulled along x.
const std::string bar = R"([geometry]
file = "bar.raw"
[geometry.image]
raw = { size = [40, 8, 8], type = "uint8" }
[analysis]
largest_error = 10
[material]
E = 100
nu = 0
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "right"
traction = [1, 0, 0]
[[probe]]
name = "tip"
at = [40, 4, 4]
)";

struct Bar : Workspace {
  explicit Bar(
      const std::string& text, const std::function<int(int i, int j, int k)>& label = [](int, int, int) { return 1; })
      : Workspace(text) {
    std::ofstream image(*this / "bar.raw", std::ios::binary);
    for (int k = 0; k < 8; ++k)
      for (int j = 0; j < 8; ++j)
        for (int i = 0; i < 40; ++i) image.put(static_cast<char>(label(i, j, k)));
  }
  /// What was printed.
  std::string solve(int status = 0) const {
    const auto run = efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, status) << run.output;
    return run.output;
  }
};
std::string with_cells(const std::string& size) {
  return replaced(bar, "file = \"bar.raw\"", "file = \"bar.raw\"\nmesh_size = " + size);
}

TEST(CellsDoubts, SlitsThatCellsCloseAreWarnedOf) {
  const auto slit = [](int width) {
    return [width](int i, int, int k) { return i >= 20 && i < 20 + width && k >= 2 ? 0 : 1; };
  };
  EXPECT_THAT(Bar(with_cells("2"), slit(1)).solve(), HasSubstr("gaps narrower than two cells are closed by the grid"));
  EXPECT_THAT(Bar(with_cells("2"), slit(1)).solve(), HasSubstr("take mesh_size = 0.5 or less"));
  EXPECT_THAT(Bar(with_cells("2"), slit(2)).solve(), Not(HasSubstr("gaps"))) << "a whole cell";
  EXPECT_THAT(Bar(with_cells("0.5"), slit(1)).solve(), Not(HasSubstr("gaps")));
}

/// Two voxels wide and tilted: by turns a whole cell is in it and none.
TEST(CellsDoubts, SlitsObliqueToTheAxesAreWarnedOf) {
  const auto tilted = [](int i, int, int k) {
    const double x = i + 0.5 - 20.0, z = k + 0.5 - 4.0;
    return std::abs(x - 0.36 * z) < 1.06 && k < 7 ? 0 : 1;
  };
  EXPECT_THAT(Bar(with_cells("2"), tilted).solve(), HasSubstr("gaps narrower than two cells are closed"));
}

/// A voxel of soft material between stiff ones, within a row of cells of two: most of the compliance.
TEST(CellsDoubts, SoftLayersWithinARowOfCellsAreInTheStatedError) {
  const std::string two = replaced(with_cells("2"), "[material]\nE = 100\nnu = 0\n",
                                   "[[material]]\nregion = \"1\"\nE = 100\nnu = 0\n[[material]]\nregion = \"2\"\nE = "
                                   "1\nnu = 0\n");
  const Bar work(two, [](int i, int, int) { return i == 20 ? 2 : 1; });
  work.solve();
  const auto result = json(work / "out/result.json");
  const double exact = 32.0 * (39.0 / 100.0 + 1.0), energy = result["strain_energy"],
               said = result["estimates"]["energy"]["total"];
  const double off = std::sqrt(std::abs(energy / exact - 1.0));
  EXPECT_GT(off, 0.3);
  EXPECT_GT(said, 0.5 * off);
}

/// A bar with a hole through it: beside the hole's walls probes are those of the walls.
TEST(CellsDoubts, ProbesInVoidAreTakenAtTheNearestMaterialAndSaidSo) {
  std::string text = with_cells("0.5");
  for (const char* at : {"20, 2, 4", "20, 2.4, 4", "20, 2.9, 4", "40.8, 4, 4", "40, 4, 4"})
    text += fmt::format("[[probe]]\nname = \"at {0}\"\nat = [{0}]\n", at);
  const Bar work(text, [](int i, int j, int) { return i >= 18 && i < 22 && j >= 2 && j < 6 ? 0 : 1; });
  const std::string printed = work.solve();
  EXPECT_THAT(printed, HasSubstr("the probe \"at 20, 2.4, 4\" lies 0.4 outside of the voxels of the material: taken at "
                                 "(20, 2, 4)"));
  const auto result = json(work / "out/result.json");
  const auto value = [&](const std::string& name) { return result["probes"][name]["displacement"]; };
  EXPECT_EQ(value("at 20, 2.4, 4"), value("at 20, 2, 4"));
  EXPECT_EQ(value("at 20, 2.9, 4"), value("at 20, 2, 4"));
  EXPECT_EQ(value("at 40.8, 4, 4"), value("at 40, 4, 4"));
  const std::string warnings = result["reports"]["warnings"].dump();
  EXPECT_THAT(warnings, HasSubstr("at 20, 2.9, 4\\\" lies 0.9 outside"));
  EXPECT_THAT(warnings, HasSubstr("at 40.8, 4, 4\\\" lies 0.8 outside"));
  EXPECT_THAT(warnings, Not(HasSubstr("2.4"))) << "as smoothed boundaries of voxels are";
}

TEST(CellsDoubts, BodiesThatCellsJoinAreWarnedOf) {
  const auto parted = [](int i, int, int) { return i == 20 ? 0 : 1; };
  EXPECT_THAT(Bar(with_cells("2"), parted).solve(),
              HasSubstr("bodies that do not hang together by faces of voxels are one on the grid"));
  EXPECT_THAT(Bar(with_cells("0.5"), parted).solve(2), HasSubstr("free to move (translation along x"));
}

TEST(CellsDoubts, BodiesThatNothingHoldsAreLeftOutAndStayWhereTheyAre) {
  const auto block_beside = [](int i, int, int) { return i >= 12 && i < 20 ? 0 : 1; };
  const std::string held = replaced(with_cells("1"), "on = \"right\"", "on = { box = [[12, -1, -1], [12, 9, 9]] }");
  const Bar work(held, block_beside);
  EXPECT_THAT(work.solve(2), HasSubstr("free to move")) << "it is the largest";
  const Bar lone(replaced(held, "at = [40, 4, 4]", "at = [12, 4, 4]"),
                 [](int i, int, int) { return (i >= 12 && i < 20) || i > 28 ? 0 : 1; });
  EXPECT_THAT(lone.solve(), HasSubstr("warning: a body that nothing holds or loads is left out, 43 % of the material"));
  const auto result = json(lone / "out/result.json");
  EXPECT_EQ(result["reports"]["free_bodies"], 1);
  EXPECT_NEAR(result["probes"]["tip"]["displacement"][0], 12.0 / 100.0, 4e-3) << "an inner face, of rounded edges";
  EXPECT_NEAR(result["extremes"]["displacement"]["value"], 12.0 / 100.0, 4e-3);
  const Bar asked(replaced(held, "at = [40, 4, 4]", "at = [24, 4, 4]"),
                  [](int i, int, int) { return (i >= 12 && i < 20) || i > 28 ? 0 : 1; });
  EXPECT_THAT(asked.solve(), HasSubstr("the probe \"tip\" is in a body that is left out"));
}

/// A part of two by two voxels is held: one point of the coarser grids.
TEST(CellsDoubts, BarsThatASmallPartHoldsAreSolved) {
  const Bar work(replaced(with_cells("1"), "on = \"left\"", "on = { box = [[0, 3, 3], [0, 5, 5]] }"));
  EXPECT_THAT(work.solve(), HasSubstr("use a smaller mesh_size"));
  const auto result = json(work / "out/result.json");
  EXPECT_LT(result["grids"][0]["iterations"], 40);
  const double pulled = 8.0 / 100.0 * 5.0;  // of the bar alone
  EXPECT_GT(result["probes"]["tip"]["displacement"][0], pulled);
}

TEST(CellsDoubts, ByDefaultAFinerGridFollowsWhereASupportIsSmallerThanCells) {
  const auto on_a_voxel = [](const std::string& text) {
    return replaced(text, "on = \"left\"", "on = { box = [[0, 3, 3], [0, 4, 4]] }");
  };
  const Bar work(on_a_voxel(bar));
  work.solve();
  const auto result = json(work / "out/result.json");
  EXPECT_LE(result["grid"]["edges"][0].get<double>(), 1.0);
  EXPECT_GT(result["probes"]["tip"]["displacement"][0], 8.0 / 100.0 * 5.0);
  // Cells of two have one of their points on it.
  const Bar coarse(on_a_voxel(with_cells("2")));
  EXPECT_THAT(coarse.solve(2), HasSubstr("underconstrained"));
}

/// A plate of two voxels that grids of four voxels hold, grids of two do not, and those of one do: the finest begins
/// with what the coarsest found.
TEST(CellsDoubts, GridsThatDoNotHoldABodyAreSteppedOver) {
  const Workspace work(replaced(
      replaced(replaced(bar, "[40, 8, 8]", "[24, 8, 6]"), "on = \"left\"", "on = { box = [[0, 3, 0], [0, 5, 6]] }"),
      "at = [40, 4, 4]", "at = [24, 4, 3]"));
  std::ofstream image(work / "bar.raw", std::ios::binary);
  for (int k = 0; k < 6; ++k)
    for (int point = 0; point < 8 * 24; ++point) image.put(k == 2 || k == 3 ? 1 : 0);
  image.close();
  std::vector<double> energies;
  for (const char* freed : {"0", "255"}) {  // what memory holds must not matter
    setenv("MALLOC_PERTURB_", freed, 1);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    unsetenv("MALLOC_PERTURB_");
    ASSERT_EQ(run.status, 0) << run.output;
    const auto result = json(work / "out/result.json");
    EXPECT_LT(result["grids"][0]["iterations"], 40);
    energies.push_back(result["strain_energy"].get<double>());
  }
  EXPECT_EQ(energies[0], energies[1]);
}

/// Compliances add up; where the jump is within a cell the strain there is the same on both sides of it.
TEST(CellsDoubts, JumpsOfAModulusBetweenPlacesAreInTheErrorAsThoseBetweenLabelsAre) {
  for (const int place : {5, 13})
    for (const double contrast : {3.0, 100.0}) {
      const std::string text =
          replaced(with_cells("2"), "E = 100",
                   "E = \"x > " + std::to_string(place) + " ? " + std::to_string(100.0 * contrast) + " : 100\"");
      const Bar work(text);
      work.solve();
      const auto result = json(work / "out/result.json");
      const double exact = place / 100.0 + (40.0 - place) / (100.0 * contrast),
                   found = result["probes"]["tip"]["displacement"][0], said = result["probes"]["tip"]["error"][0],
                   energy = result["strain_energy"], total = result["estimates"]["energy"]["total"];
      EXPECT_LE(std::abs(found - exact), 1.5 * said + 1e-4 * exact) << place << ' ' << contrast;
      EXPECT_LE(std::abs(energy / (32.0 * exact) - 1.0), 2.0 * total * total + 1e-4) << place << ' ' << contrast;
    }
}

/// An eighth of a block with a spherical pore, pulled along z. At the equator the stresses along z and around are 2.045
/// and 0.136 for nu = 0.3 (Goodier 1933).
TEST(CellsDoubts, PeaksOfStressAtPoresAreAsFarOffAsTheirErrorSays) {
  const double peak = std::sqrt(2.045 * 2.045 + 0.136 * 0.136 - 2.045 * 0.136);
  for (const int radius : {5, 8, 12})
    for (const char* size : {"2", "1"}) {
      const int n = 6 * radius;
      const Workspace work(fmt::format(R"([geometry]
file = "pore.raw"
mesh_size = {1}
[geometry.image]
raw = {{ size = [{0}, {0}, {0}], type = "uint8" }}
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, "free", "free"]
[[boundary]]
on = "front"
displacement = ["free", 0, "free"]
[[boundary]]
on = "bottom"
displacement = ["free", "free", 0]
[[boundary]]
on = "top"
traction = [0, 0, 1]
)",
                                       n, size));
      std::ofstream image(work / "pore.raw", std::ios::binary);
      for (int k = 0; k < n; ++k)
        for (int j = 0; j < n; ++j)
          for (int i = 0; i < n; ++i) image.put(std::hypot(i + 0.5, j + 0.5, k + 0.5) > radius ? '\1' : '\0');
      image.close();
      const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
      ASSERT_EQ(run.status, 0) << run.output;
      const auto found = json(work / "out/result.json")["extremes"]["von_mises"];
      const double off = std::abs(found["value"].get<double>() - peak), said = found["error"];
      EXPECT_GT(said, 0.5 * off) << radius << ' ' << size;
      EXPECT_LT(said, 2.5 * off) << radius << ' ' << size;
    }
}

TEST(CellsDoubts, ErrorsOfReactionsHoldWhatInterfacesWithinCellsLack) {
  const std::string pulled = replaced(
      replaced(with_cells("2"), "traction = [1, 0, 0]", "displacement = [1, 0, 0]"), "[material]\nE = 100\nnu = 0\n",
      "[[material]]\nregion = \"1\"\nE = 100\nnu = 0\n[[material]]\nregion = \"2\"\nE = "
      "10000\nnu = 0\n");
  const Bar work(pulled + "[[reaction]]\nname = \"pull\"\non = \"right\"\n",
                 [](int i, int, int) { return i < 21 ? 1 : 2; });
  work.solve();
  const auto reaction = json(work / "out/result.json")["reactions"]["pull"];
  const double exact = 64.0 / (21.0 / 100.0 + 19.0 / 10000.0),
               off = std::abs(reaction["force"][0].get<double>() - exact);
  EXPECT_GT(off, 0.01 * exact);
  EXPECT_GT(reaction["error"][0].get<double>(), 0.5 * off);
  EXPECT_LT(reaction["error"][0].get<double>(), 2.0 * off);
}

TEST(CellsDoubts, RegionsFillTheImageWhereThreeOrMoreMeet) {
  std::string text = replaced(with_cells("2"), "[material]\nE = 100\nnu = 0\n", "");
  for (int region = 1; region <= 8; ++region)
    text += "[[material]]\nregion = \"" + std::to_string(region) + "\"\nE = 100\nnu = 0\n";
  const Bar work(text, [](int i, int j, int k) { return 1 + (i > 18) + 2 * (j > 2) + 4 * (k > 4); });
  work.solve();
  const auto regions = json(work / "out/result.json")["by_region"];
  double all = 0.0;
  for (const auto& [name, of] : regions.items()) all += of["volume"].get<double>();
  EXPECT_NEAR(all, 40.0 * 8.0 * 8.0, 1e-3);
  EXPECT_NEAR(regions["1"]["volume"], 19.0 * 3.0 * 5.0, 0.03 * 19.0 * 3.0 * 5.0);
}

TEST(CellsDoubts, MomentsOnWallsOfPoresAreExact) {
  const Bar work(
      replaced(replaced(with_cells("1"), "on = \"right\"\ntraction = [1, 0, 0]", "on = \"pores\"\nmoment = [0, 0, 5]"),
               "at = [40, 4, 4]", "at = [40, 1, 1]"),
      [](int i, int j, int k) { return std::hypot(i - 19.5, j - 3.5, k - 3.5) < 3.0 ? 0 : 1; });
  work.solve();
  const auto load = json(work / "out/result.json")["loads"][0];
  EXPECT_NEAR(load["moment"][2], 5.0, 1e-9);
  EXPECT_NEAR(load["force"][1], 0.0, 1e-9);
}

TEST(CellsDoubts, WhatIsNoNumberIsVoidAndSaidSo) {
  std::string text = replaced(bar, "type = \"uint8\" }", "type = \"float32\" }\nthreshold = 0.5");
  text = replaced(text, "on = \"right\"", "on = { box = [[36, -1, -1], [36, 9, 9]] }");
  const Bar work(replaced(text, "at = [40, 4, 4]", "at = [36, 4, 4]"));
  std::ofstream image(work / "bar.raw", std::ios::binary);
  for (int p = 0; p < 40 * 8 * 8; ++p) {
    const float value = p % 40 < 36 ? 1.0F : std::numeric_limits<float>::quiet_NaN();
    image.write(reinterpret_cast<const char*>(&value), sizeof value);
  }
  image.close();
  EXPECT_THAT(work.solve(), HasSubstr("256 voxels of the image are not numbers, and are taken as void"));
  EXPECT_NEAR(json(work / "out/result.json")["by_region"]["1"]["volume"], 36.0 * 64.0, 1.0);
}

}  // namespace
}  // namespace efree
