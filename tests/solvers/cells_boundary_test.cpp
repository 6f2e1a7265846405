// SPDX-License-Identifier: GPL-3.0-or-later
/// Conditions, loads and springs on any part of an image's boundary, on cells.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>

namespace efree {
namespace {

using ::testing::HasSubstr;

LabelImage<3> voxels_of(const std::array<Index, 3>& size, const std::function<bool(const Vec<3>&)>& is_material) {
  LabelImage<3> image;
  image.size = size;
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i)
        image.labels.push_back(is_material(Vec<3>(i + 0.5, j + 0.5, k + 0.5)) ? 1 : 0);
  return image;
}
/// A block with a ball of void inside.
LabelImage<3> block_with_pore() {
  return voxels_of({20, 16, 18}, [](const Vec<3>& x) { return (x - Vec<3>(9.3, 8.2, 9.1)).norm() > 5.0; });
}
const std::vector<SharedMaterial> unit_material{{}, LinearElastic(1.0, 0.3)};

DisplacementCondition<3> prescribed(const std::string& on, const std::function<Vec<3>(const Vec<3>&)>& u) {
  DisplacementCondition<3> condition{on, {}, {}};
  for (int c = 0; c < 3; ++c) condition.components[c] = [u, c](const Vec<3>& x) { return u(x)[c]; };
  return condition;
}
TractionCondition<3> traction_on(const std::string& on, const Vec<3>& t) {
  return {on, [t](const Vec<3>&, const Vec<3>&) { return t; }};
}
Resultant<3> sum_of(const CellSolution& solution) {
  Resultant<3> sum;
  for (const auto& load : solution.applied) sum += load.of;
  for (const auto& [part, reaction] : solution.finest().reactions) sum += reaction;
  return sum;
}

TEST(CellsOnParts, ThickSpheresUnderPressureInsideWidenAsLameSays) {
  const double a = 8.0, b = 24.0, E = 10.0, nu = 0.3, p = 0.2;
  const LabelImage<3> image = voxels_of({26, 26, 26}, [=](const Vec<3>& x) { return x.norm() > a && x.norm() < b; });
  const VoxelParts parts{{"inner", ImageBoundary(image).select(NearestPatch<3>{{4, 4, 4}})}};
  const CellSolution solution = solve_on_cells(
      image, {{}, LinearElastic(E, nu)},
      {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
      {.tractions = {pressure<3>("inner", [=](const Vec<3>&) { return p; })}}, {.size = 1.0, .parts = parts});
  const auto exact = [=](double r) {
    return p * std::pow(a, 3) / (E * (std::pow(b, 3) - std::pow(a, 3))) *
           ((1.0 - 2.0 * nu) * r + (1.0 + nu) * std::pow(b, 3) / (2.0 * r * r));
  };
  for (const Vec<3>& along : {Vec<3>(1, 1, 1), Vec<3>(1, 0.4, 0.3), Vec<3>(0.05, 0.05, 1)})
    for (const auto& [r, bearable] : {std::pair(9.0, 0.04), {12.0, 0.022}, {23.0, 0.015}}) {
      const Vec<3> e = along.normalized(), u = displacement_at(solution, 0, r * e);
      EXPECT_NEAR(u.dot(e) / exact(r), 1.0, bearable) << r << " along " << e.transpose();  // a quarter of a cell: 3 %
    }
  // Work of the pressure: p u(a) over the sphere's eighth.
  const double energy = 0.5 * p * exact(a) * 0.5 * M_PI * a * a;
  EXPECT_NEAR(solution.extrapolated_energy / energy, 1.0, 0.04) << "half a voxel of the radius is 18 %";
  EXPECT_LT(sum_of(solution).force.norm(), 1e-10 * p * a * a);
}

/// Edges and corners whose cells have one or two octants of material have fewer strains than corners.
TEST(CellsOnParts, CubesAndBarsInVoidAreSolved) {
  for (const Index size : {3, 4, 5, 6, 8})
    for (const Index length : {size, 3 * size}) {
      const auto inside = [&](double x, Index of) { return x > 4.0 && x < 4.0 + of; };
      const LabelImage<3> image = voxels_of({size + 8, size + 8, length + 8}, [&](const Vec<3>& x) {
        return inside(x[0], size) && inside(x[1], size) && inside(x[2], length);
      });
      const ImageBoundary boundary(image);
      const VoxelParts parts{{"base", boundary.select(OnPlane<3>{{0.0, 0.0, 4.0}, Vec<3>::UnitZ(), 0.01})},
                             {"end", boundary.select(OnPlane<3>{{0.0, 0.0, 4.0 + length}, Vec<3>::UnitZ(), 0.01})}};
      const CellSolution solution =
          solve_on_cells(image, unit_material, {clamp<3>("base")}, {.tractions = {traction_on("end", Vec<3>::UnitZ())}},
                         {.parts = parts});
      for (const CellLevel& level : solution.levels) EXPECT_LE(level.iterations, 80) << size << " x " << length;
      EXPECT_GT(solution.finest().strain_energy, 0.0);
      EXPECT_LT(sum_of(solution).force.norm(), 1e-9 * size * size);
    }
}

TEST(CellsOnParts, PoresThatAreHeldAsTheBodyMovesLeaveItsFieldLinear) {
  Mat<3> A;
  A << 0.1, 0.03, -0.02, 0.01, -0.05, 0.04, 0.02, 0.01, 0.07;
  const auto linear = [&](const Vec<3>& x) -> Vec<3> { return A * x + Vec<3>(0.1, 0.2, 0.3); };
  const LabelImage<3> image = block_with_pore();
  std::vector<DisplacementCondition<3>> held;
  for (const char* part : {"left", "right", "front", "back", "bottom", "top", "pores"})
    held.push_back(prescribed(part, linear));
  const CellSolution solution = solve_on_cells(image, unit_material, held, {}, {.size = 1.0, .tolerance = 1e-6});
  // But for half of the cells at the pore, which are softer than what is held.
  for (const Vec<3>& x : {Vec<3>(2.2, 3.1, 4.7), Vec<3>(16.0, 8.0, 9.0), Vec<3>(9.0, 8.0, 2.0), Vec<3>(18.0, 15, 17)})
    EXPECT_LT((displacement_at(solution, 0, x) - linear(x)).norm(), 2e-3) << x.transpose();
  const Lame lame = solid_lame({1.0, 0.3});
  const Mat<3> strain = 0.5 * (A + A.transpose());
  const double energy = (0.5 * lame.lambda * std::pow(strain.trace(), 2) + lame.mu * strain.squaredNorm()) *
                        (20.0 * 16.0 * 18.0 - 4.0 / 3.0 * M_PI * 125.0);
  EXPECT_NEAR(solution.finest().strain_energy / energy, 1.0, 0.01);
}

TEST(CellsOnParts, ResultantsOnAPatchOfASideAreHeldByItsSupportsToRounding) {
  const LabelImage<3> image = block_with_pore();
  const ImageBoundary boundary(image);
  const VoxelParts parts{{"patch", boundary.select(InBox<3>{{3.5, 2.5, 18}, {12, 9, 18}})},
                         {"feet", boundary.select(InBox<3>{{0, 0, 0}, {20, 5, 0}})}};
  const ResultantLoad<3> load{"patch", {0.3, -0.2, 1.0}, {2.0, 0.0, -1.0}, Vec<3>(10.0, 9.0, 25.0)};
  const CellSolution solution = solve_on_cells(image, unit_material, {clamp<3>("feet")},
                                               {.tractions = {}, .resultants = {load}}, {.size = 1.0, .parts = parts});
  const Resultant<3> sum = sum_of(solution);
  EXPECT_LT(sum.force.norm(), 1e-10);
  EXPECT_LT(sum.moment.norm(), 1e-10 * 30.0);
  EXPECT_LT((solution.applied[0].of.force - load.force).norm(), 1e-12);
  EXPECT_LT((solution.applied[0].of.moment - load.moment - load.at->cross(load.force)).norm(), 1e-10);
}

TEST(CellsOnParts, PressureAroundAPoreHasNoResultantAndThatOfADiscItsArea) {
  const LabelImage<3> image = block_with_pore();
  const CellSolution solution = solve_on_cells(
      image, unit_material, {clamp<3>("bottom")},
      {.tractions = {pressure<3>("pores", [](const Vec<3>&) { return 1.0; }), traction_on("pores", {0, 0, 0.1})}},
      {.size = 1.5});
  EXPECT_LT(solution.applied[0].of.force.norm(), 1e-10);
  EXPECT_LT(solution.applied[0].of.moment.norm(), 1e-9);
  EXPECT_NEAR(solution.applied[1].of.force.z(), 0.1 * 4.0 * M_PI * 25.0, 0.03 * 0.1 * 4.0 * M_PI * 25.0);
  EXPECT_NEAR(solution.finest().reactions.at("bottom").force.z(), -solution.applied[1].of.force.z(), 1e-9);
}

TEST(CellsOnParts, BlocksOnABeddingSettleByPressureOverStiffness) {
  const LabelImage<3> image = voxels_of({10, 8, 6}, [](const Vec<3>&) { return true; });
  const double p = 0.3, k = 0.02;
  for (const double size : {1.0, 1.3, 3.0}) {
    const CellSolution solution = solve_on_cells(
        image, {{}, LinearElastic(1.0, 0.0)},
        {{"bottom", {}, [](const Vec<3>&) { return 0.0; }, [=](const Vec<3>&) { return k; }},
         symmetry_plane<3>("left"),
         symmetry_plane<3>("front")},
        {.tractions = {pressure<3>("top", [=](const Vec<3>&) { return p; })}}, {.size = size, .tolerance = 1e-9});
    EXPECT_NEAR(displacement_at(solution, 0, {3.3, 4.0, 0.0}).z(), -p / k, 1e-6 * p / k);
    EXPECT_NEAR(displacement_at(solution, 0, {3.3, 4.0, 6.0}).z(), -p / k - p * 6.0, 1e-6 * p / k);
    EXPECT_NEAR(solution.finest().reactions.at("bottom").force.z(), p * 80.0, 1e-9);
    EXPECT_NEAR(solution.finest().support_energy, 0.5 * p * p / k * 80.0, 1e-5 * p * p / k * 80.0);
    EXPECT_NEAR(solution.finest().strain_energy, 0.5 * p * p * 480.0, 1e-5 * p * p / k * 80.0);
    EXPECT_LT(solution.grid_error, 1e-3);
    EXPECT_LT(sum_of(solution).moment.norm(), 1e-8);
  }
}

TEST(CellsOnParts, SpringsAloneHoldABodyAndPullItToWhatIsPrescribed) {
  const LabelImage<3> image = block_with_pore();
  DisplacementCondition<3> springs = elastic_support<3>("pores", 0.05);
  for (int c = 0; c < 3; ++c) springs.components[c] = [c](const Vec<3>&) { return 0.1 * (c + 1); };
  const CellSolution moved =
      solve_on_cells(image, unit_material, {springs}, {}, {.size = 1.0, .tolerance = 1e-8, .held = true});
  EXPECT_LT((displacement_at(moved, 0, {2, 3, 4}) - Vec<3>(0.1, 0.2, 0.3)).norm(), 1e-6);
  EXPECT_NEAR(moved.finest().support_energy, 0.0, 1e-9);
  const CellSolution loaded = solve_on_cells(image, unit_material, {elastic_support<3>("pores", 0.05)},
                                             {.tractions = {traction_on("right", {0.01, 0.02, 0})}}, {.size = 1.0});
  EXPECT_LT(sum_of(loaded).force.norm(), 1e-10);
  EXPECT_LT(sum_of(loaded).moment.norm(), 1e-9);
}

TEST(CellsOnParts, TurnedImagesHaveTheSameAnswerTurned) {
  LabelImage<3> image = block_with_pore();
  image.origin = {1.0, -2.0, 0.5};
  const VoxelParts parts{{"feet", ImageBoundary(image).select(InBox<3>{{0, -2, 0.5}, {10, 14, 0.5}})}};
  const auto solve = [&](const Mat<3>& turn) {
    image.axes = turn;
    const auto turned = [&](const Vec<3>& v) -> Vec<3> { return turn * v; };
    DisplacementCondition<3> bedding{"left", {}, [](const Vec<3>&) { return 0.0; }, [](const Vec<3>&) { return 0.3; }};
    return solve_on_cells(image, unit_material, {clamp<3>("feet"), bedding, elastic_support<3>("pores", 0.02)},
                          {.tractions = {pressure<3>("pores", [](const Vec<3>&) { return 0.1; }),
                                         traction_on("top", turned({0.1, 0, 0.2}))}},
                          {.size = 1.0, .tolerance = 1e-9, .parts = parts});
  };
  const CellSolution straight = solve(Mat<3>::Identity());
  const Mat<3> turn = Eigen::AngleAxisd(0.8, Vec<3>(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
  const CellSolution other = solve(turn);
  const double most = straight.displacement.cwiseAbs().maxCoeff();
  EXPECT_LT((turn.transpose() * other.displacement - straight.displacement).cwiseAbs().maxCoeff(), 1e-6 * most);
  for (const auto& [part, reaction] : straight.finest().reactions)
    EXPECT_LT((other.finest().reactions.at(part).force - turn * reaction.force).norm(), 1e-5) << part;
}

TEST(CellsOnParts, AnswersAreBitwiseTheSameOnThreads) {
  const LabelImage<3> image = block_with_pore();
  const int before = num_threads();
  std::vector<CellSolution> solutions;
  for (const int threads : {1, 2}) {
    set_num_threads(threads);
    solutions.push_back(solve_on_cells(
        image, unit_material, {elastic_support<3>("pores", 0.02), symmetry_plane<3>("bottom")},
        {.tractions = {pressure<3>("pores", [](const Vec<3>& x) { return 0.1 * x[0]; })}}, {.size = 1.0}));
  }
  set_num_threads(before);
  EXPECT_EQ(solutions[0].displacement, solutions[1].displacement);
  EXPECT_EQ(solutions[0].finest().reactions.at("pores").force, solutions[1].finest().reactions.at("pores").force);
}

TEST(CellsOnParts, SurfacesSlideAlongTheirNormals) {
  // A ball in a socket: the pore may turn about its centre, but not move; the far side is turned by a little.
  const Vec<3> centre(9.3, 8.2, 9.1);
  const LabelImage<3> image = block_with_pore();
  const CellSolution solution = solve_on_cells(
      image, unit_material,
      {symmetry_plane<3>("pores"),
       prescribed("right", [&](const Vec<3>& x) { return Vec<3>(Vec<3>(0.0, 0.0, 0.01).cross(x - centre)); })},
      {}, {.size = 1.0});
  // It turns as a whole, but for the steps of voxels.
  EXPECT_LT(solution.finest().strain_energy, 2e-3 * 0.5 * 0.01 * 0.01 * 20.0 * 16.0 * 18.0 * 100.0);
  EXPECT_LT((displacement_at(solution, 0, {2, 3, 9}) - Vec<3>(0.0, 0.0, 0.01).cross(Vec<3>(2, 3, 9) - centre)).norm(),
            0.01);
}

TEST(CellsOnParts, WhatIsWrongIsSaid) {
  const LabelImage<3> image = block_with_pore();
  const auto message = [&](const std::vector<DisplacementCondition<3>>& held, const Loads<3>& loads,
                           const VoxelParts& parts = {}) -> std::string {
    try {
      solve_on_cells(image, unit_material, held, loads, {.parts = parts});
    } catch (const InputError& error) {
      return error.what();
    }
    return "nothing";
  };
  EXPECT_THAT(message({clamp<3>("inside")}, {}), HasSubstr("there is no boundary \"inside\""));
  EXPECT_THAT(message({clamp<3>("none")}, {}, {{"none", {}}}), HasSubstr("no material on \"none\""));
  EXPECT_THAT(message({clamp<3>("pores"), prescribed("cap", [](const Vec<3>&) { return Vec<3>(0, 0, 1); })}, {},
                      {{"cap", ImageBoundary(image).select(NearestPatch<3>{{9, 8, 5}, 5.0})}}),
              HasSubstr("displacements prescribed on \"pores\" and \"cap\" contradict each other at"));
  EXPECT_THAT(message({elastic_support<3>("left", -1.0)}, {}), HasSubstr("the stiffness on \"left\" is -1"));
  EXPECT_THAT(message({symmetry_plane<3>("left")}, {.tractions = {traction_on("pores", {0, 1, 0})}}),
              HasSubstr("loaded, but free to move"));
  EXPECT_THAT(message({{"left", {}, [](const Vec<3>&) { return 0.0; }, [](const Vec<3>&) { return 1.0; }}},
                      {.tractions = {traction_on("pores", {0, 1, 0})}}),
              HasSubstr("loaded, but free to move"));
  EXPECT_THAT(
      message({clamp<3>("left")}, {.tractions = {}, .followers = {{"pores", [](const Vec<3>&) { return 1.0; }}}}),
      HasSubstr("follows the body"));
}

}  // namespace
}  // namespace efree
