// SPDX-License-Identifier: GPL-3.0-or-later
/// Corrections of the cloud's answer towards the finite elements of its fine mesh.
#include "efree/solvers/algorithms/correction.hpp"

#include "efree/bench/inclusion.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/solvers/linear/internal/hats.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

using ::testing::HasSubstr;

template <int Dim> struct Problem {
  FineMesh<Dim> mesh;
  ApproximationOptions cloud;
  ElasticModel model;
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;
};

template <int Dim> struct Corrected {
  Approximation<Dim> cloud;
  Solution<Dim> solution;
  Correction<Dim> correction;
};
template <int Dim> Corrected<Dim> correct(const Problem<Dim>& problem, const CorrectionOptions& options) {
  Corrected<Dim> result{approximate(problem.mesh, problem.cloud), {}, {}};
  result.solution = ElasticSolver<Dim>(result.cloud, problem.model, problem.supports).solve(problem.loads);
  if (result.cloud.averaged && result.cloud.space.degree() == 1) result.cloud = in_quadratic_space(result.cloud);
  result.correction =
      Corrector<Dim>(result.cloud, problem.model, problem.supports)
          .correct(interpolate(result.cloud.shape, result.solution.coefficients), problem.loads, options);
  return result;
}

/// The finite element solution by a direct solver on the same mesh.
template <int Dim>
Solution<Dim> elements(const Problem<Dim>& problem, int degree, Essential essential = Essential::strong) {
  const bool incompressible = materials_of(problem.model, problem.mesh).incompressibility(problem.mesh) > 50.0;
  const auto approximation = approximate<Dim>(
      problem.mesh, {.kind = degree == 1 ? BasisKind::p1 : BasisKind::p2,
                     .axisymmetric = problem.cloud.axisymmetric,
                     .dilatation = averaged_if(problem.cloud.dilatation == Dilatation::averaged && incompressible)});
  ElasticModel model = problem.model;
  model.essential = essential;
  return ElasticSolver<Dim>(approximation, model, problem.supports).solve(problem.loads);
}

/// The corrected answer and the one by a direct solver are the same, everywhere.
template <int Dim> void expect_same_as_elements(const Problem<Dim>& problem, Essential essential = Essential::strong,
                                                int most_iterations = 30) {
  const auto corrected = correct(problem, {.tolerance = 1e-9});
  const auto direct = elements(problem, corrected.cloud.space.degree(), essential);
  EXPECT_NEAR(corrected.correction.strain_energy, direct.strain_energy, 1e-9 * direct.strain_energy);
  EXPECT_LT((corrected.correction.displacement - direct.coefficients).cwiseAbs().maxCoeff(),
            1e-7 * direct.coefficients.cwiseAbs().maxCoeff());
  EXPECT_LE(corrected.correction.iterations, most_iterations);
}

Problem<2> plate(int interpolation = 1) {
  return {testing::body("plate_with_hole").mesh,
          {.interpolation = interpolation, .spacing = 0.2},
          {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          {.tractions = {tension<2>("right", 1.0)}, .body_force = {}}};
}
Problem<3> bar(double length = 2.0) {
  return {FineMesh<3>(solids::box({length, 1.0, 1.0}, 0.15)),
          {.spacing = 0.45},
          {.material = LinearElastic(1.0, 0.3)},
          {clamp<3>("left")},
          {.tractions = {{"right",
                          [](const Vec<3>&, const Vec<3>&) -> Vec<3> {
                            return {0.0, 0.0, 1.0};
                          }}},
           .body_force = [](const Vec<3>& x) -> Vec<3> {
             return {0.1 * x[1], 0.0, 0.2};
           }}};
}
/// Every third cell has dihedral angles of half a degree.
Problem<3> flat_cells() {
  return {testing::solid("flat_cells"),
          {.spacing = 0.4},
          {.material = LinearElastic(1.0, 0.3)},
          {clamp<3>("left")},
          {.tractions = {tension<3>("right", 1.0)}, .body_force = {}}};
}

TEST(Correction, EndsAtTheLinearElementsOfThePlate) {
  expect_same_as_elements(plate());
}
TEST(Correction, EndsAtTheQuadraticElementsOfThePlate) {
  expect_same_as_elements(plate(2));
}
TEST(Correction, EndsAtTheTetrahedraOfABentBar) {
  expect_same_as_elements(bar());
}
/// Single precision, in which smoothers work, holds no such moduli.
TEST(Correction, EndsAtTheElementsInWhateverUnits) {
  for (const double unit : {1e-59, 1e59}) {
    Problem<2> problem = plate(2);
    problem.model.material = LinearElastic(unit, 0.3);
    problem.loads.tractions = {tension<2>("right", unit)};
    expect_same_as_elements(problem);
  }
}
TEST(Correction, EndsAtTheElementsWithOrderTwo) {
  Problem<2> problem = plate(2);
  problem.cloud.order = 2;
  expect_same_as_elements(problem);
}
/// Cells as flat as 0.1 degree in a third of the body: point by point they would be smoothed slowly.
TEST(Correction, EndsAtTheElementsOnSliversAsSoonAsElsewhere) {
  for (const int interpolation : {1, 2})
    expect_same_as_elements<2>({testing::body("slivers").mesh,
                                {.interpolation = interpolation, .spacing = 0.25},
                                {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                                {clamp<2>("left")},
                                {.tractions = {tension<2>("right", 1.0)}, .body_force = {}}},
                               Essential::strong, 15);
}
TEST(Correction, EndsAtTheTetrahedraOfHalfADegreeAsSoonAsElsewhere) {
  expect_same_as_elements(flat_cells(), Essential::strong, 20);
}
TEST(Correction, EndsAtTheElementsAroundASlit) {
  expect_same_as_elements<2>({testing::body("slit").mesh,
                              {.spacing = 0.25},
                              {.material = LinearElastic(1.0, 0.3), .plane = Plane::strain},
                              {clamp<2>("left")},
                              {.tractions = {tension<2>("right", 1.0)}, .body_force = {}}});
}
TEST(Correction, EndsAtTheElementsOfABodyOfRevolution) {
  expect_same_as_elements<2>(
      {triangulate(shapes::rectangle(0.0, 0.0, 1.0, 2.0), {.size = 0.06}),
       {.axisymmetric = true, .spacing = 0.3},
       {.material = LinearElastic(1.0, 0.3), .plane = Plane::axisymmetric},
       {symmetry_plane<2>("bottom")},
       {.tractions = {tension<2>("top", 1.0), pressure<2>("right", [](const Vec<2>& x) { return x[1]; })},
        .body_force = {}}});
}
/// Nearly incompressible: quadratic elements with the mean dilatation of each cell.
TEST(Correction, EndsAtTheElementsWithMeanDilatationsInPlaneStrain) {
  Problem<2> problem = plate(2);
  problem.cloud.dilatation = Dilatation::averaged;
  problem.model = {.material = LinearElastic(1.0, 0.495), .plane = Plane::strain};
  expect_same_as_elements(problem);
  problem.cloud.interpolation = 1;
  expect_same_as_elements(problem);
}
TEST(Correction, EndsAtPlainQuadraticElementsWhereTheseHardlyLock) {
  Problem<2> problem = plate(2);
  problem.cloud.dilatation = Dilatation::averaged;
  problem.model = {.material = LinearElastic(1.0, 0.48), .plane = Plane::strain};
  expect_same_as_elements(problem);
}
TEST(Correction, EndsAtTheElementsWithMeanDilatationsInSpace) {
  Problem<3> problem = bar(1.0);
  problem.mesh = FineMesh<3>(solids::box({1.0, 1.0, 1.0}, 0.2));
  problem.cloud.dilatation = Dilatation::averaged;
  problem.model.material = LinearElastic(1.0, 0.495);
  expect_same_as_elements(problem, Essential::strong, 40);
}
TEST(Correction, EndsAtTheElementsWithMeanDilatationsHeldByNitsche) {
  expect_same_as_elements<2>({testing::body("random_holes").mesh,
                              {.interpolation = 2, .spacing = 0.1, .dilatation = Dilatation::averaged},
                              {.material = LinearElastic(1.0, 0.495), .plane = Plane::strain},
                              {{"holes", {}, [](const Vec<2>& x) { return 0.01 * x[0]; }}},
                              {.tractions = {tension<2>("right", 1.0)}, .body_force = {}}},
                             Essential::nitsche, 40);
}
TEST(Correction, KeepsDisplacementsThatAreNotZero) {
  Problem<2> problem = plate();
  problem.supports.push_back({"right", {[](const Vec<2>& x) { return 0.1 + 0.05 * x[1] * x[1]; }, nullptr}, nullptr});
  problem.loads = {};
  expect_same_as_elements(problem);
}
/// The walls of round holes can only be held weakly.
TEST(Correction, EndsAtTheElementsHeldByNitscheWhereWallsAreCurved) {
  expect_same_as_elements<2>({testing::body("random_holes").mesh,
                              {.interpolation = 1, .spacing = 0.1},
                              {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                              {{"holes", {}, [](const Vec<2>& x) { return 0.01 * x[0]; }}},
                              {.tractions = {tension<2>("right", 1.0)}, .body_force = {}}},
                             Essential::nitsche);
}

/// Regions that the cloud ties weakly share their nodes in the elements: the same mesh, not parted.
TEST(Correction, EndsAtTheConformingElementsOfInclusionsAThousandTimesAsStiffOrAsSoft) {
  for (const double contrast : {1000.0, 0.001}) {
    const bench::Inclusion inclusion(1.0, 0.6, contrast);
    const MeshData<2> data = inclusion.mesh(0.06);
    const std::vector<DisplacementCondition<2>> supports{symmetry_plane<2>("left"), symmetry_plane<2>("bottom")};
    const auto corrected = correct<2>({FineMesh<2>(cut_regions(data)),
                                       {.interpolation = 1, .spacing = 0.3},
                                       inclusion.model(Essential::nitsche),
                                       supports,
                                       inclusion.loads()},
                                      {.tolerance = 1e-9});
    const auto direct =
        elements<2>({FineMesh<2>(data), {}, inclusion.model(Essential::strong), supports, inclusion.loads()}, 1);
    EXPECT_NEAR(corrected.correction.strain_energy, direct.strain_energy, 1e-9 * direct.strain_energy) << contrast;
    EXPECT_LE(corrected.correction.iterations, 30);
  }
}

/// Linear fields are in both spaces.
TEST(Correction, HasNothingToDoInThePatchTest) {
  const auto body = testing::body("square");
  const auto field = testing::linear_fields<2>().front();
  const VectorField<2> u = [&](const Vec<2>& x) { return field.displacement(x); };
  std::vector<DisplacementCondition<2>> supports;
  for (const auto& side : body.outer) supports.push_back(testing::displacement<2>(side, u));
  const auto corrected = correct<2>({body.mesh,
                                     {.spacing = body.spacing},
                                     {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                                     supports,
                                     {}},
                                    {});
  EXPECT_LT(corrected.correction.error, 1e-11);
  EXPECT_LT(corrected.correction.start_error, 1e-11);
  for (Index dof = 0; dof < corrected.cloud.space.size(); ++dof)
    EXPECT_LT((corrected.correction.displacement.col(dof) - u(corrected.cloud.space.points().col(dof))).norm(), 1e-12);
}

/// Functions of order 2 on quadratic cells with linear functions on clusters reproduce quadratic fields, and so do
/// quadratic elements: iterations from elsewhere end farther away.
TEST(Correction, KeepsAnAnswerThatIsNearerThanItsIterates) {
  const auto body = testing::body("square");
  const VectorField<2> u = [](const Vec<2>& x) -> Vec<2> {
    return {x.x() * x.x() + x.x() * x.y(), x.y() * x.y() - 0.5 * x.x() * x.y()};
  };
  // eps_xx = 2x + y, eps_yy = 2y - x/2, gamma = x - y/2, so the forces are constant.
  const Lame lame = plane_lame({1.0, 0.3}, Plane::stress);
  const Vec<2> b(-(1.5 * lame.lambda + 4.0 * lame.mu - 0.5 * lame.mu), -(3.0 * lame.lambda + 4.0 * lame.mu + lame.mu));
  std::vector<DisplacementCondition<2>> supports;
  for (const auto& side : body.outer) supports.push_back(testing::displacement<2>(side, u));
  Loads<2> loads;
  loads.body_force = [b](const Vec<2>&) { return b; };
  const Problem<2> problem{
      body.mesh,
      {.order = 2, .interpolation = 2, .spacing = body.spacing, .secondary = SecondaryKind::linear},
      {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
      supports,
      loads};
  for (const int iterations : {-1, 0, 1, 3}) {
    const auto corrected = correct<2>(problem, {.iterations = iterations});
    EXPECT_EQ(corrected.correction.iterations, 0) << iterations;
    EXPECT_LT(corrected.correction.error, 1e-10) << iterations;
    double off = 0.0;
    for (Index dof = 0; dof < corrected.cloud.space.size(); ++dof)
      off = std::max(off,
                     (corrected.correction.displacement.col(dof) - u(corrected.cloud.space.points().col(dof))).norm());
    EXPECT_LT(off, 1e-11) << iterations;
  }
  // Loads that act beside it are corrected from what the cloud has for them.
  Problem<2> other = problem;
  other.loads.body_force = [b](const Vec<2>& x) -> Vec<2> { return b * std::exp(4.0 * x[0]); };
  const auto exact = elements(other, 2);
  const auto some = correct<2>(other, {.tolerance = 1e-6}).correction;
  EXPECT_GT(some.iterations, 0);
  EXPECT_NEAR(some.strain_energy, exact.strain_energy, 1e-9 * exact.strain_energy);
}

/// Errors said against errors found, for the cloud and after some iterations.
template <int Dim> void expect_honest(const Problem<Dim>& problem) {
  const auto exact = correct(problem, {.tolerance = 1e-8}).correction;
  const double energy = exact.strain_energy;
  for (const int iterations : {0, 1, 2, 3}) {
    const auto some = correct(problem, {.iterations = iterations}).correction;
    ASSERT_EQ(some.iterations, iterations);
    // Loads are the same, and nothing that is prescribed moves: the energies differ by that of the error.
    const double error = std::sqrt(std::abs(some.strain_energy - energy) / energy);
    EXPECT_GT(some.error, 0.9 * error) << iterations;
    EXPECT_LT(some.error, 1.1 * error) << iterations;
    EXPECT_GT(some.start_error, 0.95 * exact.start_error) << iterations;
    EXPECT_LT(some.start_error, 1.05 * exact.start_error) << iterations;
  }
}
TEST(Correction, SaysItsErrorOnThePlate) {
  expect_honest(plate());
}
TEST(Correction, SaysItsErrorInTheBar) {
  expect_honest(bar());
}
TEST(Correction, StopsAtTheToleranceAskedFor) {
  const double energy = elements(plate(), 1).strain_energy;
  int before = 0;
  for (const double tolerance : {0.1, 1e-2, 1e-4}) {
    const auto corrected = correct(plate(), {.tolerance = tolerance}).correction;
    EXPECT_LT(corrected.error, tolerance);
    EXPECT_LT(std::sqrt(std::abs(corrected.strain_energy - energy) / energy), tolerance);
    EXPECT_GE(corrected.iterations, before);
    before = corrected.iterations;
  }
}
TEST(Correction, RefusesToGiveBackLessThanWasAskedFor) {
  try {
    correct(plate(), {.tolerance = 1e-8, .most = 3});
    FAIL();
  } catch (const NumericalError& error) {
    EXPECT_THAT(error.what(), HasSubstr("after 3 iterations, 1e-08 was asked for"));
  }
}
/// A beam of height 0.2 bent at its end.
Problem<2> thin_beam(double length, double size, double spacing) {
  return {triangulate(shapes::rectangle(0.0, 0.0, length, 0.2), {.size = size}),
          {.interpolation = 1, .spacing = spacing},
          {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
          {clamp<2>("left")},
          {.tractions = {{"right",
                          [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                            return {0.0, 1.0};
                          }}},
           .body_force = {}}};
}
/// Functions that only move shear a thin wall where it should bend, and are too stiff by the square of spacing over
/// thickness: it takes more than 20 iterations.
TEST(Correction, BendsThinBeamsAndPlatesByNodesThatTurn) {
  const auto beam = correct(thin_beam(10.0, 0.05, 1.0), {.tolerance = 1e-6}).correction;
  EXPECT_GT(beam.start_error, 0.5);
  EXPECT_LE(beam.iterations, 15);
  Problem<3> plate{FineMesh<3>(solids::box({3.0, 2.0, 0.2}, 0.1)),
                   {.spacing = 0.4},
                   {.material = LinearElastic(1.0, 0.3)},
                   {clamp<3>("left")},
                   {.tractions = {}, .body_force = [](const Vec<3>&) -> Vec<3> {
                      return {0.0, 0.0, 1.0};
                    }}};
  std::vector<int> iterations;
  for (const std::uint64_t seed : {1, 2, 3}) {
    plate.cloud.seed = seed;
    const auto bent = correct(plate, {.tolerance = 1e-6}).correction;
    EXPECT_GT(bent.start_error, 0.5);
    iterations.push_back(bent.iterations);
  }
  std::ranges::sort(iterations);
  EXPECT_LE(iterations[1], 15);
  EXPECT_LE(iterations[2], 16);
}
/// One function is hardly more than a few motions of the whole beam: functions of the fine mesh take over.
TEST(Correction, BendsLongBeamsToWhichTheCloudIsBlind) {
  const Problem<2> beam = thin_beam(30.0, 0.1, 3.0);
  const auto direct = elements(beam, 1);
  for (const double tolerance : {1e-2, 1e-3, 1e-6}) {
    const auto corrected = correct(beam, {.tolerance = tolerance}).correction;
    EXPECT_LE(corrected.iterations, 20);
    EXPECT_GT(corrected.start_error, 0.9);
    // The energy is off by the square of the error, which is said within a third. Rounding of the elements: the fourth
    // power of 150 heights.
    EXPECT_NEAR(corrected.strain_energy, direct.strain_energy,
                std::max(1.8 * tolerance * tolerance, 1e-6) * direct.strain_energy);
    EXPECT_LT(corrected.error, tolerance);
  }
}
/// A rod with so few nodes that they lie nearly on a line: its functions reach along all of it.
Problem<3> rod() {
  return {FineMesh<3>(solids::box({4.0, 0.2, 0.2}, 0.07)),
          {.spacing = 0.5},
          {.material = LinearElastic(1.0, 0.3)},
          {clamp<3>("left")},
          {.tractions = {{"right",
                          [](const Vec<3>&, const Vec<3>&) -> Vec<3> {
                            return {1.0, 0.0, 0.1};
                          }}},
           .body_force = {}}};
}
TEST(Correction, PullsAndBendsRodsOfAFewNodes) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Problem<3> one = rod();
    one.cloud.seed = seed;
    EXPECT_LE(correct(one, {.tolerance = 1e-6}).correction.iterations, 20) << seed;
  }
}
/// Nearly incompressible, where every coarse space locks.
TEST(Correction, SolvesDirectlyWhereIterationsHardlyHelp) {
  Problem<2> problem = plate(2);
  problem.cloud.dilatation = Dilatation::averaged;
  problem.model = {.material = LinearElastic(1.0, 0.4999), .plane = Plane::strain};
  const auto corrected = correct(problem, {.tolerance = 1e-7}).correction;
  const auto direct = elements(problem, 2);
  EXPECT_EQ(corrected.iterations, 21);
  EXPECT_NEAR(corrected.strain_energy, direct.strain_energy, 1e-9 * direct.strain_energy);
}
TEST(Correction, RefusesLinearElementsWhereDilatationsAreAveraged) {
  Problem<2> problem = plate();
  problem.cloud.dilatation = Dilatation::averaged;
  const auto cloud = approximate(problem.mesh, problem.cloud);
  EXPECT_THROW(Corrector<2>(cloud, problem.model, problem.supports), InputError);
}
TEST(Correction, OneAndTwoThreadsAgreeBitwise) {
  for (const auto& [problem, tolerance] : {std::pair{flat_cells(), 1e-4}, {bar(), 1e-4}, {rod(), 1e-6}}) {
    set_num_threads(1);
    const auto one = correct(problem, {.tolerance = tolerance}).correction;
    set_num_threads(2);
    const auto two = correct(problem, {.tolerance = tolerance}).correction;
    set_num_threads(1);
    EXPECT_TRUE((one.displacement.array() == two.displacement.array()).all());
    EXPECT_EQ(one.error, two.error);
    EXPECT_EQ(one.strain_energy, two.strain_energy);
  }
}
TEST(Correction, OneFactorServesSeveralLoads) {
  Problem<3> problem = bar();
  const auto cloud = approximate(problem.mesh, problem.cloud);
  const Corrector<3> corrector(cloud, problem.model, problem.supports);
  const ElasticSolver<3> solver(cloud, problem.model, problem.supports);
  for (const Loads<3>& loads : {problem.loads, Loads<3>{{tension<3>("top", 1.0)}, {}}}) {
    problem.loads = loads;
    const auto direct = elements(problem, 1);
    const auto corrected =
        corrector.correct(interpolate(cloud.shape, solver.solve(loads).coefficients), loads, {.tolerance = 1e-8});
    EXPECT_NEAR(corrected.strain_energy, direct.strain_energy, 1e-9 * direct.strain_energy);
  }
}

/// Bodies of their own, too many for a cheap factor of one hat each: that they cannot be fewer is no reason to go on.
TEST(Correction, HatsOfManyBodiesAreOneEach) {
  const Index count = 100;
  BlockMatrix<3> K;
  K.chunks.resize(1);
  Points<3> places(3, count);
  for (Index i = 0; i < count; ++i) {
    K.chunks[0].columns.push_back(i);
    K.chunks[0].blocks.push_back(Mat<3>::Identity());
    K.chunks[0].close_row(i);
    places.col(i) = Vec<3>(i, 0.0, 0.0);
  }
  K.chunks[0].close();
  EXPECT_EQ(make_hats(K, places).shape.num_nodes(), count);
}

/// Ten cases, so that they go in groups of eight and two, that end after different numbers of iterations: one is of no
/// force, one needs many. BLAS rounds a block of right-hand sides otherwise than a single one, and how depends on the
/// processor. The smoother works in single precision: the last bit of a double may become the last bit of a float, and
/// each iteration's step is known to a few roundoffs of floats, relative to the whole correction.
template <int Dim> void expect_same_as_alone(const Problem<Dim>& problem) {
  constexpr double rounding = 8.0 * 0x1p-24;
  const auto cloud = approximate(problem.mesh, problem.cloud);
  const ElasticSolver<Dim> solver(cloud, problem.model, problem.supports);
  const Corrector<Dim> corrector(cloud, problem.model, problem.supports);
  std::vector<Loads<Dim>> cases;
  std::vector<Points<Dim>> starts;
  for (int k = 0; k < 10; ++k) {
    Loads<Dim> loads{.tractions = {}, .body_force = {}};
    if (k != 3)
      loads.tractions = {{k % 2 == 0 ? "right" : "top", [k](const Vec<Dim>& x, const Vec<Dim>& n) -> Vec<Dim> {
                            return (1.0 + std::cos(k * x[1] + x[0])) * n;
                          }}};
    if (k == 5)
      loads.body_force = [](const Vec<Dim>& x) -> Vec<Dim> { return std::sin(40.0 * x[0]) * Vec<Dim>::Unit(1); };
    const Solution<Dim> solution = solver.solve(loads);
    starts.push_back(interpolate(cloud.shape, solution.coefficients));
    cases.push_back(std::move(loads));
  }
  for (const CorrectionOptions options : {CorrectionOptions{.tolerance = 1e-5}, CorrectionOptions{.iterations = 1}}) {
    const auto together = corrector.correct_all(starts, cases, options);
    ASSERT_EQ(together.size(), cases.size());
    for (std::size_t k = 0; k < cases.size(); ++k) {
      const auto alone = corrector.correct(starts[k], cases[k], options);
      EXPECT_EQ(together[k].iterations, alone.iterations) << k;
      ASSERT_EQ(together[k].taken.size(), alone.taken.size()) << k;
      const double roundoff = rounding * alone.iterations;
      const double moved = (alone.displacement - starts[k]).cwiseAbs().maxCoeff();
      const double taken = std::accumulate(alone.taken.begin(), alone.taken.end(), 0.0);
      EXPECT_LE((together[k].displacement - alone.displacement).cwiseAbs().maxCoeff(), roundoff * moved) << k;
      for (std::size_t i = 0; i < alone.taken.size(); ++i)
        EXPECT_NEAR(together[k].taken[i], alone.taken[i], roundoff * taken) << k;
      EXPECT_NEAR(together[k].error, alone.error, roundoff * alone.start_error) << k;
      EXPECT_NEAR(together[k].start_error, alone.start_error, roundoff * alone.start_error) << k;
      EXPECT_NEAR(together[k].strain_energy, alone.strain_energy, roundoff * taken + 1e-13 * alone.strain_energy) << k;
    }
  }
  EXPECT_THROW(corrector.correct_all({starts[0]}, cases), InputError);

  const int threads = num_threads();
  const auto on = [&](int count) {
    set_num_threads(count);
    return corrector.correct_all(starts, cases);
  };
  const auto one = on(1), three = on(3);
  set_num_threads(threads);
  for (std::size_t k = 0; k < cases.size(); ++k) {
    EXPECT_EQ(one[k].displacement, three[k].displacement) << k;
    EXPECT_EQ(one[k].taken, three[k].taken) << k;
    EXPECT_EQ(one[k].strain_energy, three[k].strain_energy) << k;
  }
}

TEST(Correction, OfSeveralLoadCasesIsThatOfEach) {
  const ElasticModel plane{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  for (const int degree : {1, 2})
    expect_same_as_alone<2>({triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.05}),
                             {.interpolation = degree, .spacing = 0.2},
                             plane,
                             {clamp<2>("left")},
                             {}});
  expect_same_as_alone<3>({FineMesh<3>(solids::box({2.0, 1.0, 1.0}, 0.15)),
                           {.spacing = 0.4},
                           {.material = LinearElastic(1.0, 0.3)},
                           {clamp<3>("left")},
                           {}});
}

/// Loads that are sums of others: their answers are, too, and nothing is iterated for them.
TEST(Correction, OfLoadsThatAreSumsOfOthersIsTheirSum) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.05});
  const ElasticModel plane{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  const auto cloud = approximate(mesh, {.spacing = 0.2});
  const auto loads = [](double right, double top) {
    return Loads<2>{.tractions = {tension<2>("right", right), tension<2>("top", top)}};
  };
  for (const double held : {0.0, 0.3}) {  // where something is prescribed factors have to add up to one
    DisplacementCondition<2> left = clamp<2>("left");
    left.components[0] = [held](const Vec<2>& x) { return held * x[1]; };
    const std::vector<Loads<2>> cases{loads(1.0, 0.0), loads(0.0, 1.0), loads(0.25, 0.75), loads(2.0, -3.0)};
    const ElasticSolver<2> solver(cloud, plane, {left});
    const Corrector<2> corrector(cloud, plane, {left});
    std::vector<Points<2>> starts;
    for (const auto& solution : solver.solve_all(cases))
      starts.push_back(interpolate(cloud.shape, solution.coefficients));
    const auto all = corrector.correct_all(starts, cases, {.tolerance = 1e-3});
    int sums = 0;
    for (std::size_t k = 0; k < cases.size(); ++k) {
      const auto alone = corrector.correct(starts[k], cases[k], {.tolerance = 1e-3});
      const auto exact = corrector.correct(starts[k], cases[k], {.tolerance = 1e-9});
      if (all[k].taken.empty()) ++sums;
      EXPECT_LE(all[k].error, 1e-3) << k;
      EXPECT_GT(all[k].error, 0.0) << k;
      EXPECT_NEAR(all[k].start_error, exact.start_error, 2e-3 * exact.start_error) << k;
      EXPECT_NEAR(all[k].strain_energy, exact.strain_energy, 1e-5 * exact.strain_energy) << k;
      const double moved = exact.displacement.cwiseAbs().maxCoeff();
      EXPECT_LE((all[k].displacement - exact.displacement).cwiseAbs().maxCoeff(), 1e-3 * moved) << k;
      EXPECT_LE(alone.iterations, all[k].iterations + 1) << k;
    }
    EXPECT_EQ(sums, held == 0.0 ? 2 : 1);
  }
}

/// Small loads are loads beside a large one where something is prescribed.
TEST(Correction, OfSmallLoadsBesideALargeOneIsTheirs) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.1});
  const ElasticModel plane{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  const auto cloud = approximate(mesh, {.spacing = 0.3});
  DisplacementCondition<2> left = clamp<2>("left");
  left.components[0] = [](const Vec<2>& x) { return 0.3 * x[1]; };
  const Corrector<2> corrector(cloud, plane, {left});
  std::vector<Loads<2>> cases;
  for (const double right : {1.0, 2.0, 1e13}) cases.push_back({.tractions = {tension<2>("right", right)}});
  cases[1].tractions.push_back(tension<2>("top", 0.5));
  const std::vector<Points<2>> nothing(cases.size(), Points<2>::Zero(2, cloud.space.size()));
  const auto all = corrector.correct_all(nothing, cases, {.tolerance = 1e-5});
  for (std::size_t k = 0; k < cases.size(); ++k) {
    const auto alone = corrector.correct(nothing[k], cases[k], {.tolerance = 1e-5});
    EXPECT_LE((all[k].displacement - alone.displacement).cwiseAbs().maxCoeff(),
              1e-4 * alone.displacement.cwiseAbs().maxCoeff())
        << k;
  }
}

/// A sum that nearly cancels, as energies go: its error would be that of its terms, and it is iterated by itself.
TEST(Correction, OfASumThatCancelsIsItsOwn) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 8.0, 1.0), {.size = 0.1});
  const ElasticModel plane{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  const auto cloud = approximate(mesh, {.spacing = 0.4});
  const auto loads = [](double bending, double wrinkling) {
    return Loads<2>{.tractions = {{"right", [=](const Vec<2>& x, const Vec<2>&) -> Vec<2> {
                                     return {wrinkling * std::cos(2.0 * std::numbers::pi * x[1]), bending};
                                   }}}};
  };
  const std::vector<Loads<2>> cases{loads(1.0, 1.0), loads(1.0, 0.0), loads(0.0, 1.0)};
  const Corrector<2> corrector(cloud, plane, {clamp<2>("left")});
  const std::vector<Points<2>> nothing(cases.size(), Points<2>::Zero(2, cloud.space.size()));
  const auto all = corrector.correct_all(nothing, cases);
  for (std::size_t k = 0; k < cases.size(); ++k) {
    EXPECT_LE(all[k].error, 0.01) << k;
    EXPECT_FALSE(all[k].taken.empty()) << k;
    const auto exact = corrector.correct(nothing[k], cases[k], {.tolerance = 1e-8});
    EXPECT_NEAR(all[k].strain_energy, exact.strain_energy, 1e-3 * exact.strain_energy) << k;
  }
}

}  // namespace
}  // namespace efree
