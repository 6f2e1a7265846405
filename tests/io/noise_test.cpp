// SPDX-License-Identifier: GPL-3.0-or-later
/// Images of noise from image to corrected answer.
#include "efree/bench/noise.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/io/workspace.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

TEST(Noise, FiftyImagesEndAtTheirFiniteElementsWhateverTheirSpecksAndIslands) {
  constexpr int images = 51;
  for (int k = 0; k < images; ++k) {
    Case<3> analysis =
        bench::pulled(bench::noise(k % 3, 0.2 + 0.7 * (k / 3) / 16.0, static_cast<unsigned>(k), 10), 1.0, {1.0});
    analysis.correction.tolerance = 1e-6;
    analysis.largest_error = 1e9;
    const Result<3> result = analyse(analysis);
    analysis.common.approximation.kind = BasisKind::p1;
    analysis.common.model.essential = Essential::strong;
    const double truth = analyse(analysis).solution.strain_energy;
    EXPECT_NEAR(result.solution.strain_energy, truth, 1e-10 * truth + 1e-20) << k;
    EXPECT_LE(result.estimates->corrections, 60) << k;
  }
}

TEST(Noise, BodiesThatNobodyPullsHaveNoEnergy) {
  // Two plates that do not touch, each held on its side.
  LabelImage<3> image{.size = {12, 8, 8}};
  for (Index p = 0; p < 12 * 64; ++p) image.labels.push_back(p % 12 < 4 || p % 12 > 7);
  const Result<3> result = analyse(bench::pulled(image, 1.0, {1.0}));
  EXPECT_LT(result.solution.strain_energy, 1e-20);
  EXPECT_EQ(result.estimates->total(), 0.0);
  EXPECT_EQ(result.refusal, "");
  EXPECT_THAT(result.warnings, ::testing::ElementsAre(::testing::HasSubstr("the body moves as a whole")));
}

TEST(Noise, WhereOnlyWhatIsHeldIsPulledNothingMoves) {
  const test::Workspace work(
      "[geometry]\nshape = \"box\"\nparameters = { width = 1, depth = 1, height = 1 }\nmesh_size = 0.2\n"
      "[cloud]\nspacing = 0.5\n[material]\nE = 1\nnu = 0.3\n"
      "[[boundary]]\non = { box = [[-9, -9, -9], [9, 9, 9]] }\ndisplacement = [0, 0, 0]\n"
      "[[boundary]]\non = \"top\"\ntraction = [0, 0, 1]\n");
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = test::json(work / "out/result.json");
  EXPECT_EQ(result["extremes"]["displacement"]["value"], 0.0);
  EXPECT_EQ(result["corrections"], 0);
}

TEST(Noise, ImagesWithNothingWhereTheyAreHeldAreRefused) {
  LabelImage<3> image{.size = {8, 8, 8}};
  for (Index p = 0; p < 512; ++p) image.labels.push_back(p % 8 > 1);
  try {
    prepare(bench::pulled(image, 1.0, {1.0}));
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("\"left\""), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace efree
