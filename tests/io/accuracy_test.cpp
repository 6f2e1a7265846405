// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of cases: estimated, corrected, asked for, and refused.
#include "efree/tests/io/solved.hpp"

#include "efree/analysis/internal/refinement.hpp"
#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using test::json, test::plate, test::replaced, test::solved, test::Workspace;
namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// A sheet in a box of which walls are thinner than any node spacing: a cloud of 2 cannot bend it.
const std::string thin_beam = R"([geometry]
shape = "box"
parameters = { width = 10, depth = 1, height = 0.25 }
mesh_size = 0.25
[cloud]
spacing = 2
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "right"
traction = [0, 0, 1e-3]
)";

/// Of all but the facets: exact solutions are compared with on the mesh.
double beside_facets(const Estimates& errors) {
  return std::hypot(errors.cloud, errors.mesh);
}

TEST(Estimates, AreWithinAThirdOfTheTrueErrorOfThePlate) {
  const auto result = solved(plate);
  ASSERT_TRUE(result.estimates);
  EXPECT_LT(result.estimates->cloud, 0.01);
  EXPECT_GE(result.estimates->corrections, 1);
  EXPECT_GT(beside_facets(*result.estimates), 0.67 * *result.errors->energy_norm);
  EXPECT_LT(beside_facets(*result.estimates), 1.5 * *result.errors->energy_norm);
}

TEST(Estimates, SayHowFarTheCloudIsOffWithoutCorrection) {
  const auto corrected = solved(plate);
  const auto bare = solved(replaced(plate, "plane = \"stress\"", "plane = \"stress\"\ncorrection = \"off\""));
  ASSERT_TRUE(bare.estimates);
  EXPECT_EQ(bare.estimates->corrections, 0);
  EXPECT_FALSE(bare.elements);
  EXPECT_NEAR(bare.estimates->cloud, corrected.estimates->uncorrected, 0.1 * bare.estimates->cloud);
  EXPECT_NEAR(bare.estimates->total(), *bare.errors->energy_norm, 0.2 * *bare.errors->energy_norm);
}

TEST(Estimates, AreReachedWhenAnAccuracyIsAskedFor) {
  for (const double wanted : {0.05, 0.01, 0.003}) {
    const auto result = solved(plate + "[accuracy]\nenergy = " + std::to_string(wanted) + "\n");
    EXPECT_LE(result.estimates->total(), wanted);
    EXPECT_LE(*result.errors->energy_norm, wanted);
    ASSERT_FALSE(result.attempts.empty());
    EXPECT_EQ(result.attempts.back().error, result.estimates->total());
    EXPECT_TRUE(result.warnings.empty());
  }
}

/// At the notch recovery overlooks a fifth of the error, and the error falls like the root of the edges.
TEST(Accuracy, IsReachedAtANotchWithFewMeshes) {
  const std::string text = R"([geometry]
shape = "l_shape"
parameters = { side = 1 }
[analysis]
plane = "stress"
body_force = [0, -1]
[material]
E = 1
nu = 0.3
[[boundary]]
on = "top"
displacement = [0, 0]
)";
  const double energy = 0.79354;  // quadratic elements, extrapolated: bench_accuracy truth L
  for (const double wanted : {0.1, 0.05}) {
    const auto result = solved(text + "[accuracy]\nenergy = " + std::to_string(wanted) + "\n");
    EXPECT_LE(std::sqrt(1.0 - result.solution.strain_energy / energy), wanted);
    EXPECT_LE(result.attempts.size(), 4u);
    EXPECT_TRUE(result.warnings.empty());
  }
}

/// Meshes in the plane whose error falls like a power of the edges, each chosen after the ones before.
std::vector<Attempt> chosen_meshes(double power, double excess) {
  std::vector<Attempt> attempts{
      {.size = 1.0, .cells = 1000, .degree = 2, .error = 0.0, .seconds = 0.0, .excess = excess}};
  while (attempts.back().excess > 1.0) {
    Attempt next = attempts.back();
    const double finer = internal::refinement(attempts, 2);
    next.size *= finer;
    next.cells = static_cast<Index>(std::lround(1000.0 / (next.size * next.size)));
    next.excess = excess * std::pow(next.size, power);
    attempts.push_back(next);
  }
  return attempts;
}

TEST(Accuracy, IsHardlyOvershotAndTheMeshesOnTheWayCostLittle) {
  for (const double power : {0.5, 1.0, 1.5, 2.0})
    for (const double excess : {1.01, 1.2, 1.5, 2.0, 4.0}) {
      const std::vector<Attempt> attempts = chosen_meshes(power, excess);
      const double enough = 1000.0 * std::pow(excess, 2.0 / power);
      double cells = 0.0;
      for (const Attempt& attempt : attempts) cells += attempt.cells;
      EXPECT_GT(attempts.back().excess, 0.79) << power << ' ' << excess;
      EXPECT_LT(cells, 3.0 * enough) << power << ' ' << excess;
      EXPECT_LE(attempts.size(), 5u) << power << ' ' << excess;
    }
}

TEST(Accuracy, ARateIsBelievedTheLessTheLessMeshesDiffer) {
  const Attempt coarse{.size = 1.0, .cells = 1000, .degree = 2, .error = 0.0, .seconds = 0.0, .excess = 4.0};
  Attempt fine = coarse;
  fine.excess = 3.9;
  fine.cells = 1050;
  const double alike = internal::refinement({coarse, fine}, 2);
  fine.cells = 4000;
  EXPECT_GT(alike, 1.5 * internal::refinement({coarse, fine}, 2));
  fine.excess = 4.1;  // errors that grow: as slow as it gets, and no more than 12 times the cells
  EXPECT_NEAR(internal::refinement({coarse, fine}, 2), std::pow(12.0, -0.5), 1e-12);
  fine.excess = 1.5;
  fine.cells = 2000;  // faster than the degree
  EXPECT_NEAR(internal::refinement({coarse, fine}, 2), std::pow(1.25 * 1.5, -0.5), 1e-12);
  fine.degree = 1;  // another degree says nothing
  EXPECT_NEAR(internal::refinement({coarse, fine}, 2), std::pow(1.25, -0.5) / 1.5, 1e-12);
}

TEST(Accuracy, ForecastsTimesByWhatTheLastMeshesTook) {
  const Attempt coarse{.size = 1.0, .cells = 1000, .degree = 2, .error = 0.0, .seconds = 1.0, .excess = 4.0};
  Attempt fine = coarse;
  fine.cells = 8000;
  fine.seconds = 8.0 * std::sqrt(8.0);  // to the power of 1.5
  EXPECT_NEAR(internal::forecast_seconds({coarse}, 4000), std::pow(4.0, 1.2), 1e-12);
  EXPECT_NEAR(internal::forecast_seconds({coarse, fine}, 16000), fine.seconds * std::pow(2.0, 1.5), 1e-9);
  fine.degree = 1;  // of another degree says nothing
  EXPECT_NEAR(internal::forecast_seconds({coarse, fine}, 16000), fine.seconds * std::pow(2.0, 1.2), 1e-9);
}

TEST(Estimates, AMeshThatIsSaidIsKeptAndTheAccuracyItMissesIsSaid) {
  const auto result =
      solved(replaced(plate, "half_width = 4 }", "half_width = 4 }\nmesh_size = 1") + "[accuracy]\nenergy = 0.0001\n");
  EXPECT_EQ(result.attempts.size(), 1u);
  ASSERT_EQ(result.warnings.size(), 2u);
  EXPECT_THAT(result.warnings.back(), HasSubstr("leave mesh_size out"));
}

std::string nearly_incompressible(const std::string& correction) {
  return replaced(replaced(plate, "plane = \"stress\"", "plane = \"strain\"\n" + correction), "nu = 0.3",
                  "nu = 0.4999");
}
TEST(Estimates, HoldWhereDilatationsAreAveraged) {
  const auto corrected = solved(nearly_incompressible("")),
             bare = solved(nearly_incompressible("correction = \"off\""));
  ASSERT_TRUE(corrected.estimates && bare.estimates);
  EXPECT_GT(corrected.estimates->corrections, 1);
  EXPECT_EQ(corrected.basis().space.degree(), 2);
  EXPECT_LT(*corrected.errors->energy_norm, 0.025);
  EXPECT_GT(beside_facets(*corrected.estimates), 0.7 * *corrected.errors->energy_norm);
  EXPECT_LT(beside_facets(*corrected.estimates), 1.4 * *corrected.errors->energy_norm);
  EXPECT_EQ(bare.estimates->corrections, 0);
  EXPECT_EQ(bare.estimates->cloud, corrected.estimates->uncorrected);
  EXPECT_EQ(bare.estimates->mesh, corrected.estimates->mesh);
  EXPECT_FALSE(bare.elements);
}
TEST(Accuracy, IsReachedWhereDilatationsAreAveraged) {
  const auto result = solved(nearly_incompressible("") + "[accuracy]\nenergy = 0.01\n");
  EXPECT_LT(result.estimates->total(), 0.01);
  EXPECT_LT(*result.errors->energy_norm, 0.012);
}

/// The cloud alone is a hundred times too stiff; with exit status 0 that would be a lie.
TEST(Estimates, RefuseTheAnswerOfACloudThatIsBlindUnlessItIsAskedFor) {
  const std::string bare = "[analysis]\ncorrection = \"off\"\n" + thin_beam;
  const Workspace work(bare);
  const auto refused = work.efree({"solve", "case.toml", "--out", "out", "--no-picture", "--quiet"});
  EXPECT_EQ(refused.status, 3);
  EXPECT_THAT(refused.output, HasSubstr("to accept it say analysis.largest_error"));
  EXPECT_TRUE(fs::exists(work / "out/result.json"));
  EXPECT_THAT(json(work / "out/failure.json")["reason"].get<std::string>(), HasSubstr("correct it"));
  work.write("case.toml", replaced(bare, "\"off\"", "\"off\"\nlargest_error = 10"));
  const auto accepted = work.efree({"solve", "case.toml", "--out", "out", "--no-picture", "--quiet"});
  EXPECT_EQ(accepted.status, 0);
  EXPECT_THAT(accepted.output, HasSubstr("warning: "));
  EXPECT_FALSE(fs::exists(work / "out/failure.json"));
}

TEST(Estimates, CorrectedQuadraticCellsBendAThinBeamAsBernoulliDid) {
  const Workspace work(replaced(thin_beam, "spacing = 2", "spacing = 0.5"));
  const auto result = analyse(std::get<Case<3>>(read_case(work / "case.toml")));
  EXPECT_EQ(result.basis().space.degree(), 2);
  // F L^3 / (3 E I), which Timoshenko's shear hardly adds to; the clamp takes a little off.
  const double force = 1e-3 * 0.25, deflection = force * 1000.0 / (3.0 * std::pow(0.25, 3) / 12.0);
  EXPECT_NEAR(result.fields.displacement.row(2).maxCoeff(), deflection, 0.04 * deflection);
  EXPECT_TRUE(result.refusal.empty());
}

TEST(Accuracy, IsRefusedWhereItMakesNoSense) {
  const auto complaint = [](const std::string& text) {
    const Workspace work(text);
    try {
      read_case(work / "case.toml");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(complaint(plate + "[accuracy]\nenergy = 2\n"), HasSubstr("energy is 2, expected a number"));
  EXPECT_THAT(complaint(plate + "[accuracy]\n"), HasSubstr("key \"energy\" is missing"));
  EXPECT_THAT(complaint(plate + "[basis]\nkind = \"p1\"\n[accuracy]\nenergy = 0.1\n"), HasSubstr("basis.kind"));
  EXPECT_THAT(complaint(replaced(plate, "plane = \"stress\"", "plane = \"stress\"\ncorrection = 0")),
              HasSubstr("correction is 0, expected an integer"));
  EXPECT_THAT(complaint(replaced(plate, "plane = \"stress\"", "plane = \"stress\"\ncorrection = \"on\"")),
              HasSubstr("expected \"auto\" or \"off\""));
  const Workspace work(plate);
  for (const char* wrong : {"0", "1", "150%", "x"})
    EXPECT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--accuracy", wrong}).status, 2) << wrong;
  EXPECT_FALSE(fs::exists(work / "out"));
}

}  // namespace
}  // namespace efree
