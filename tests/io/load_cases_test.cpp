// SPDX-License-Identifier: GPL-3.0-or-later
/// Several load cases of one body.
#include "efree/tests/io/solved.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <string>

namespace efree {
namespace {

using test::json, test::solved, test::Workspace;
using ::testing::HasSubstr;

TEST(LoadCases, AreInResultAndFieldsByTheirNames) {
  const std::string two =
      test::strip_case +
      "[[case]]\nname = \"up\"\n[[case.boundary]]\non = \"top\"\ntraction = [0, 1]\n[[case]]\nname = "
      "\"bare\"\n[[case]]\nname = 'a & <b> \"c\"'\n";
  const Workspace work(two);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("case \"bare\":"));
  const auto result = json(work / "out/result.json");
  EXPECT_NEAR(result["cases"]["bare"]["probes"]["end"]["displacement"][0], 2.0, 1e-3);
  EXPECT_NEAR(result["cases"]["up"]["probes"]["end"]["displacement"][0], 1.4, 1e-3);
  EXPECT_NEAR(result["cases"]["up"]["reactions"]["bottom"]["force"][1], -2.0, 1e-9);
  EXPECT_EQ(result["cases"]["up"]["loads"].size(), 2u);
  EXPECT_EQ(result["strain_energy"], result["cases"]["up"]["strain_energy"]) << "the first";
  EXPECT_THAT(test::content(work / "out/fields.vtu"), HasSubstr("bare: von_mises"));
  EXPECT_THAT(test::content(work / "out/fields.vtu"), HasSubstr("a &amp; &lt;b&gt; &quot;c&quot;: von_mises"));
}

TEST(LoadCases, HaveElementsThatAreFineEnoughForEachInWhateverOrder) {
  const std::string bar =
      "[geometry]\nshape = \"box\"\nparameters = { width = 2, depth = 1, height = 1 }\nmesh_size = 0.25\n"
      "[material]\nE = 210e3\nnu = 0.3\n[[boundary]]\non = \"left\"\ndisplacement = [0, 0, 0]\n";
  const std::string bare = "[[case]]\nname = \"bare\"\n",
                    bent =
                        "[[case]]\nname = \"bent\"\n[[case.boundary]]\non = \"right\"\ntraction = [0.3, -0.5, "
                        "\"z\"]\n";
  const auto first = solved<3>(bar + bent + bare), last = solved<3>(bar + bare + bent);
  const Answer<3>& other = last.more[0];
  EXPECT_EQ(first.basis().space.degree(), 2);
  EXPECT_EQ(last.basis().space.degree(), 2);
  EXPECT_NEAR(other.solution.strain_energy / first.solution.strain_energy, 1.0, 1e-3);
  EXPECT_LT(other.estimates->total(), 0.1);
  EXPECT_GT(other.estimates->uncorrected, 0.01);
}

TEST(LoadCases, InThePlaneShareAFactorOfQuadraticElementsUnlessACloudIsAskedFor) {
  const std::string rectangle =
      "[geometry]\nshape = \"rectangle\"\nparameters = { width = 2, height = 1 }\nmesh_size = 0.05\n"
      "[analysis]\nplane = \"stress\"\n[material]\nE = 210e3\nnu = 0.3\n"
      "[[boundary]]\non = \"left\"\ndisplacement = [0, 0]\n";
  const std::string both =
      "[[case]]\nname = \"pulled\"\n[[case.boundary]]\non = \"right\"\ntraction = [1, 0]\n"
      "[[case]]\nname = \"bent\"\n[[case.boundary]]\non = \"right\"\ntraction = [0, 1]\n";
  const auto together = solved<2>(rectangle + both),
             by_cloud = solved<2>(rectangle + "[cloud]\nspacing = 0.2\n" + both);
  EXPECT_EQ(together.solution.coefficients.cols(), together.basis().space.size());
  EXPECT_FALSE(together.elements);
  EXPECT_TRUE(by_cloud.elements);
  const Answer<2>&bent = together.more[0], &corrected = by_cloud.more[0];
  EXPECT_EQ(bent.estimates->corrections, 0);
  EXPECT_GT(bent.estimates->mesh, 1e-4);
  EXPECT_LT(bent.estimates->mesh, 0.03);
  EXPECT_NEAR(bent.solution.strain_energy / corrected.solution.strain_energy, 1.0, 1e-3);
  EXPECT_LT(bent.balance.error, 1e-8);
}

TEST(LoadCases, SlideOnHolesAndSlitsAsOneAloneDoes) {
  const std::string body =
      "[geometry]\nshape = \"annulus\"\nparameters = { inner = 1, outer = 2 }\nmesh_size = 0.2\n"
      "[analysis]\nplane = \"strain\"\n[material]\nE = 1\nnu = 0.3\n"
      "[[boundary]]\non = \"inner\"\nnormal_displacement = 0\n"
      "[[boundary]]\non = { box = [[1.9, -0.3], [2.1, 0.3]] }\ndisplacement = [\"free\", 0]\n";
  const std::string pulled = "[[case]]\nname = \"a\"\n[[case.boundary]]\non = \"outer\"\npressure = 1\n",
                    pushed = "[[case]]\nname = \"b\"\n[[case.boundary]]\non = \"outer\"\npressure = -2\n";
  const auto alone = solved<2>(body + pulled), together = solved<2>(body + pulled + pushed);
  EXPECT_NEAR(together.solution.strain_energy / alone.solution.strain_energy, 1.0, 0.01);
  EXPECT_NEAR(together.more[0].solution.strain_energy / together.solution.strain_energy, 4.0, 1e-9);
}

}  // namespace
}  // namespace efree
