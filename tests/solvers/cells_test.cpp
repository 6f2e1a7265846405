// SPDX-License-Identifier: GPL-3.0-or-later
/// Images on grids of cells against closed forms and finite elements.
#include "efree/tests/solvers/labelled_image.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/box_averages.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/cell_fields.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <random>

using namespace efree;

namespace {

using test::image_of, test::stretched_along_z;

DisplacementCondition<3> moved(const std::string& on, const std::function<Vec<3>(const Vec<3>&)>& u) {
  DisplacementCondition<3> condition{on, {}, {}};
  for (int c = 0; c < 3; ++c) condition.components[c] = [u, c](const Vec<3>& x) { return u(x)[c]; };
  return condition;
}

const std::vector<std::string> all_sides{"left", "right", "front", "back", "bottom", "top"};

}  // namespace

TEST(BoxAverages, KeepTheVolumeOfLabelsWhateverTheBoxes) {
  std::mt19937 random(1);
  const auto image = image_of({12, 7, 9}, [&](const Vec<3>& x) -> Label { return x[0] < 5.0 ? 1 : 2; });
  for (const std::array<Index, 3>& boxes : {std::array<Index, 3>{12, 7, 9}, {6, 3, 4}, {5, 11, 9}, {24, 14, 18}}) {
    const std::vector<float> means = box_averages(image, {0.0F, 1.0F, 3.0F}, boxes);
    double sum = 0.0;
    for (const float mean : means) sum += mean;
    EXPECT_NEAR(sum / static_cast<double>(means.size()), (5.0 * 1.0 + 7.0 * 3.0) / 12.0, 1e-6);
  }
}

TEST(BoxAverages, OfABallHaveItsVolumeBySmoothedLabelsAndByGreyValues) {
  for (const bool grey : {false, true})
    for (const Index boxes : {16, 32, 64}) {
      auto image =
          image_of({32, 32, 32}, [](const Vec<3>& x) -> Label { return (x - Vec<3>(16.1, 15.8, 16.3)).norm() < 11.0; });
      if (grey)
        for (Index k = 0; k < 32; ++k)
          for (Index j = 0; j < 32; ++j)
            for (Index i = 0; i < 32; ++i)
              image.grey.push_back(
                  static_cast<float>(11.0 - (Vec<3>(i + 0.5, j + 0.5, k + 0.5) - Vec<3>(16.1, 15.8, 16.3)).norm()));
      double sum = 0.0;
      for (const float mean : box_averages(image, {0.0F, 1.0F}, {boxes, boxes, boxes})) sum += mean;
      const double volume = sum * std::pow(32.0 / boxes, 3), exact = 4.0 / 3.0 * M_PI * std::pow(11.0, 3);
      EXPECT_NEAR(volume / exact, 1.0, grey ? 0.003 : 0.02) << boxes << (grey ? " grey" : " labels");
    }
}

TEST(Cells, PatchTestOnAnyGridWithVoidAndTwoMaterialsOfOneStiffness) {
  Mat<3> A;
  A << 1.0, 0.3, -0.2, 0.1, -0.5, 0.4, 0.2, 0.1, 0.7;
  const auto linear = [&](const Vec<3>& x) -> Vec<3> { return A * x + Vec<3>(0.1, 0.2, 0.3); };
  auto image = image_of({20, 15, 12}, [](const Vec<3>& x) -> Label { return x[0] + x[1] < 17.0 ? 1 : 2; });
  image.spacing = {1.0, 2.0, 0.5};
  image.origin = {-3.0, 4.0, 5.0};
  std::vector<DisplacementCondition<3>> held;
  for (const std::string& side : all_sides) held.push_back(moved(side, linear));
  for (const double size : {1.0, 1.7, 4.0}) {
    const CellSolution solution = solve_on_cells(image, {{}, LinearElastic(3.0, 0.2), LinearElastic(3.0, 0.2)}, held,
                                                 {}, {.size = size, .tolerance = 1e-9});
    double worst = 0.0;
    Eigen::Index point = 0;
    for (Index k = 0; k <= solution.grid.cubes[2]; ++k)
      for (Index j = 0; j <= solution.grid.cubes[1]; ++j)
        for (Index i = 0; i <= solution.grid.cubes[0]; ++i, ++point) {
          const Vec<3> x = solution.grid.origin + solution.grid.spacing.cwiseProduct(Vec<3>(i, j, k));
          worst = std::max(worst, (solution.displacement.col(point) - linear(x)).norm());
        }
    EXPECT_LT(worst, 1e-6 * A.norm() * 40.0) << "cells of " << size;
    const Lame lame = solid_lame({3.0, 0.2});
    const Mat<3> strain = 0.5 * (A + A.transpose());
    const double energy = (0.5 * lame.lambda * std::pow(strain.trace(), 2) + lame.mu * strain.squaredNorm()) * 20.0 *
                          15.0 * 12.0 * image.spacing.prod();
    EXPECT_NEAR(solution.finest().strain_energy, energy, 1e-5 * energy);
  }
}

TEST(Cells, LayersInSeriesHaveTheirExactStiffnessWhereCellsEndBetweenThem) {
  // A bar that cannot contract: each layer has its constrained modulus.
  const auto image = image_of({8, 8, 16}, [](const Vec<3>& x) -> Label { return x[2] < 8.0 ? 1 : 2; });
  std::vector<DisplacementCondition<3>> held = stretched_along_z(0.16);
  held.push_back(symmetry_plane<3>("right"));
  held.push_back(symmetry_plane<3>("back"));
  const auto modulus = [](const IsotropicModuli& m) {
    const Lame lame = solid_lame(m);
    return lame.lambda + 2.0 * lame.mu;
  };
  const IsotropicModuli soft{1.0, 0.3}, stiff{1000.0, 0.2};
  const CellSolution solution = solve_on_cells(image, {{}, LinearElastic(soft), LinearElastic(stiff)}, held, {},
                                               {.size = 1.0, .tolerance = 1e-8});
  const double stiffness = 64.0 / (8.0 / modulus(soft) + 8.0 / modulus(stiff));
  EXPECT_NEAR(solution.finest().strain_energy, 0.5 * stiffness * 0.16 * 0.16, 1e-5 * stiffness * 0.16 * 0.16);
  EXPECT_LE(solution.finest().iterations, 40);
}

TEST(Cells, TractionOnASlenderBarBendsItLikeABeam) {
  const double E = 200.0, length = 64.0, depth = 8.0, load = 0.01;
  auto image = image_of({64, 4, 8}, [](const Vec<3>&) -> Label { return 1; });
  const CellSolution solution =
      solve_on_cells(image, {{}, LinearElastic(E, 0.0)}, {clamp<3>("left")},
                     {.tractions = {{"right", [=](const Vec<3>&, const Vec<3>&) { return Vec<3>(0.0, 0.0, load); }}},
                      .body_force = {}},
                     {.size = 1.0, .tolerance = 1e-6});
  // Timoshenko: P L^3 / (3 E I) + 6/5 P L / (G A), P = load * A.
  const double P = load * 4.0 * depth, I = 4.0 * std::pow(depth, 3) / 12.0, G = E / 2.0;
  const double tip = P * std::pow(length, 3) / (3.0 * E * I) + 1.2 * P * length / (G * 4.0 * depth);
  EXPECT_NEAR(solution.finest().strain_energy, 0.5 * P * tip, 0.01 * 0.5 * P * tip);
  EXPECT_NEAR(solution.finest().potential, -solution.finest().strain_energy, 1e-4 * solution.finest().strain_energy);
}

TEST(Cells, CavityConcentratesStressAsGoodierSaysAndTheErrorIsKnown) {
  // An eighth of a cube with a small ball cut out, pulled along z: 2.045 at the equator for nu = 0.3 (Goodier 1933).
  const double radius = 10.0;
  const auto image = image_of({60, 60, 60}, [=](const Vec<3>& x) -> Label { return x.norm() > radius; });
  const CellSolution solution =
      solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)},
                     {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                     {.tractions = {tension<3>("top", 1.0)}, .body_force = {}}, {.size = 2.0});
  FineMesh<3> mesh(mesh_image<3>(image, {.size = 2.0}));
  const Fields<3> fields = recover_fields(solution, image, mesh, {-1, 0}, {LinearElastic(1.0, 0.3)});
  double most = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) most = std::max(most, fields.stress(2, v));
  EXPECT_NEAR(most, 2.045, 0.15);
  // Energy of the block less what the cavity adds; the extrapolated energy moves less than the error that is said.
  const CellSolution coarser =
      solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)},
                     {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                     {.tractions = {tension<3>("top", 1.0)}, .body_force = {}}, {.size = 4.0});
  const double truth = solution.extrapolated_energy;
  const double left = std::sqrt(std::abs(truth - coarser.finest().strain_energy) / truth);
  EXPECT_GT(coarser.grid_error / left, 0.5);
  EXPECT_LT(coarser.grid_error / left, 2.0);
}

TEST(Cells, PorousBlockComesWithinTwoPercentOfItsSpheresAndSaysItsError) {
  // 0.4653 +- 0.001: fine voxels of the spheres, extrapolated. Here half as large an image would do other spheres.
  const auto image = keep_largest(random_spheres<3>(128, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
  const CellSolution solution =
      solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, stretched_along_z(1.28), {}, {.size = 2.0});
  const double scale = 2.0 / (1e-4 * std::pow(128.0, 3)), reference = 0.4653;
  const double modulus = scale * solution.finest().strain_energy;
  EXPECT_NEAR(modulus, reference, 0.02 * reference);
  EXPECT_NEAR(scale * solution.extrapolated_energy, reference, 0.005 * reference);
  const double error = std::sqrt(modulus / reference - 1.0);
  EXPECT_GT(solution.grid_error / error, 0.7);
  EXPECT_LT(solution.grid_error / error, 1.4);
  for (const CellLevel& level : solution.levels) EXPECT_LE(level.iterations, 12);
}

TEST(Cells, NoiseIsSolvedWhereBodiesHangLooseAndBitwiseTheSameOnThreads) {
  std::mt19937 random(7);
  const auto image = image_of({24, 24, 24}, [&](const Vec<3>&) -> Label { return random() % 100 < 55 ? 1 : 0; });
  const int before = num_threads();
  std::vector<CellSolution> solutions;
  for (const int threads : {1, 3}) {
    set_num_threads(threads);
    solutions.push_back(
        solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, stretched_along_z(0.24), {}, {.size = 1.0}));
  }
  set_num_threads(before);
  EXPECT_EQ(solutions[0].displacement, solutions[1].displacement);
  EXPECT_TRUE(solutions[0].displacement.allFinite());
  EXPECT_GT(solutions[0].finest().strain_energy, 0.0);
  EXPECT_LE(solutions[0].finest().iterations, 60);
}

TEST(Cells, WallsAndSlitsAVoxelThickKeepTheirStiffness) {
  // Two blocks tied by a plate of one voxel, all pulled along it: stress and strain are uniform for nu = 0.
  const auto plates =
      image_of({16, 16, 16}, [](const Vec<3>& x) -> Label { return x[0] < 4.0 || (x[0] > 9.0 && x[0] < 10.0); });
  const LinearElastic material(2.0, 0.0);
  const CellSolution wall = solve_on_cells(plates, {{}, material}, stretched_along_z(0.16), {}, {.size = 2.0});
  const double energy = 0.5 * 2.0 * 1e-4 * 5.0 * 16.0 * 16.0;
  EXPECT_NEAR(wall.finest().strain_energy, energy, 1e-4 * energy);
  // A slit of one voxel across the pull, three quarters of the way through: softer than the solid block by far.
  const auto slit =
      image_of({16, 16, 16}, [](const Vec<3>& x) -> Label { return x[2] < 8.0 || x[2] > 9.0 || x[0] < 4.0; });
  const CellSolution open = solve_on_cells(slit, {{}, material}, stretched_along_z(0.16), {}, {.size = 1.0});
  const double solid = 0.5 * 2.0 * 1e-4 * std::pow(16.0, 3);
  EXPECT_LT(open.finest().strain_energy, 0.7 * solid);
}

TEST(Cells, PlatesAVoxelThickBearLoadsWhereCellsAreTwoVoxels) {
  const double E = 3.0, length = 23.0, load = 1e-3;
  const auto image =
      image_of({24, 8, 12}, [](const Vec<3>& x) -> Label { return x[0] < 1.0 || (x[2] > 6.0 && x[2] < 7.0); });
  for (const double size : {2.0, 1.0}) {
    const CellSolution solution =
        solve_on_cells(image, {{}, LinearElastic(E, 0.0)}, {clamp<3>("left")},
                       {.tractions = {{"right", [=](const Vec<3>&, const Vec<3>&) { return Vec<3>(0.0, 0.0, load); }}}},
                       {.size = size});
    const double deflection = load * std::pow(length, 3) / (3.0 * E / 12.0),
                 found = displacement_at(solution, 0, {23.5, 4.0, 6.5}).z();
    EXPECT_GT(found, 0.2 * deflection) << size;
    EXPECT_LT(found, 1.3 * deflection) << size;
  }
}

TEST(Cells, SlenderBarsAreRightOnEveryGridAndThinSheetsHaveFewCells) {
  const auto bar = image_of({2, 2, 400}, [](const Vec<3>&) -> Label { return 1; });
  const CellSolution solution =
      solve_on_cells(bar, {{}, LinearElastic(1.0, 0.0)}, {clamp<3>("bottom")},
                     {.tractions = {tension<3>("top", 1.0)}, .body_force = {}}, {.size = 1.0, .tolerance = 1e-6});
  for (const CellLevel& level : solution.levels) EXPECT_NEAR(level.strain_energy, 0.5 * 400.0 * 4.0, 0.01);
  const auto sheet = image_of({1, 80, 80}, [](const Vec<3>&) -> Label { return 1; });
  const CellSolution flat =
      solve_on_cells(sheet, {{}, LinearElastic(1.0, 0.3)}, stretched_along_z(0.8), {}, {.size = 2.0});
  EXPECT_LE(flat.finest().cells, 4 * 48 * 48);
  EXPECT_NEAR(flat.finest().strain_energy, 0.5 * 1e-4 * 6400.0, 1e-3);
}

TEST(Cells, RigidMotionsHaveNoEnergyAndNoError) {
  const auto image = image_of({12, 12, 12}, [](const Vec<3>& x) -> Label { return x.norm() > 5.0; });
  const auto turned = [](const Vec<3>& x) { return Vec<3>(-0.3 * x[1] + 1.0, 0.3 * x[0], 2.0); };
  std::vector<DisplacementCondition<3>> held;
  for (const std::string& side : all_sides) held.push_back(moved(side, turned));
  const CellSolution solution =
      solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, held, {}, {.size = 2.0, .half_voxel = true});
  EXPECT_EQ(solution.finest().strain_energy, 0.0);
  EXPECT_EQ(solution.grid_error, 0.0);
  EXPECT_EQ(solution.half_voxel, 0.0);
}

TEST(Cells, UnitsDoNotMatter) {
  auto image = image_of({12, 12, 12}, [](const Vec<3>& x) -> Label { return x.norm() > 5.0; });
  const double energy =
      solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, stretched_along_z(0.12), {}).finest().strain_energy;
  for (const double E : {1e-40, 1e40})
    for (const double length : {1e-12, 1e9}) {
      image.spacing = Vec<3>::Constant(length);
      const CellSolution scaled =
          solve_on_cells(image, {{}, LinearElastic(E, 0.3)}, stretched_along_z(0.12 * length), {});
      EXPECT_NEAR(scaled.finest().strain_energy / (energy * E * std::pow(length, 3)), 1.0, 1e-5) << E << ' ' << length;
    }
}

/// Uniaxial under its own weight: tip rho g L^2 / 2 E, energy A rho^2 g^2 L^3 / 6 E.
TEST(Cells, BarsHangUnderTheirWeightAndAreSolvedTogetherWithOtherCases) {
  LabelImage<3> image = image_of({6, 6, 24}, [](const Vec<3>& x) -> Label { return x[0] < 3.0 ? 1 : 2; });
  const double E = 50.0, density = 2.0, g = 0.1, length = 24.0, load = 0.3;
  for (const bool turned : {false, true}) {
    if (turned) image.axes = Eigen::AngleAxisd(0.5, Vec<3>(1.0, 2.0, 3.0).normalized()).toRotationMatrix();
    const Vec<3> down = -image.axes.col(2);
    Loads<3> weight{.tractions = {}, .mass_forces = {acceleration<3>(Vec<3>(g * down))}}, force{.tractions = {}};
    weight.density = {Parameter(0.0), Parameter(density), Parameter(density)};
    force.body_force = [=](const Vec<3>&) { return Vec<3>(density * g * down); };
    const Loads<3> pull{.tractions = {{"bottom", [=](const Vec<3>&, const Vec<3>& n) { return Vec<3>(load * n); }}}};
    const auto solutions =
        solve_cases_on_cells(image, {{}, LinearElastic(E, 0.0), LinearElastic(E, 0.0)}, {clamp<3>("top")},
                             {weight, force, pull}, {.size = 1.0, .tolerance = 1e-6});
    ASSERT_EQ(solutions.size(), 3u);
    const double area = 36.0, tip = density * g * length * length / (2.0 * E);
    const Vec<3> bottom = image.in_world(image.origin + Vec<3>(3.0, 3.0, 0.0));
    for (const int of : {0, 1}) {
      EXPECT_NEAR(displacement_at(solutions[of], 0, bottom).dot(down), tip, 1e-3 * tip) << of;
      EXPECT_NEAR(solutions[of].extrapolated_energy, area * std::pow(density * g, 2) * std::pow(length, 3) / (6.0 * E),
                  1e-3 * area * tip);
      EXPECT_LT((solutions[of].finest().reactions.at("top").force + area * length * density * g * down).norm(), 1e-4);
      ASSERT_EQ(solutions[of].applied.size(), 1u);
      EXPECT_LT((solutions[of].applied[0].of.force - area * length * density * g * down).norm(), 1e-5);
    }
    EXPECT_EQ(solutions[0].applied[0].kind, "acceleration");
    EXPECT_NEAR(displacement_at(solutions[2], 0, bottom).dot(down), load * length / E, 1e-5);
  }
}

/// Three layers, the middle one with a density that grows upwards: what hangs below a section is its weight.
TEST(Cells, WeightsAreThoseOfEachLabelsDensityBitwiseOnAnyNumberOfThreads) {
  const auto image = image_of({8, 8, 24}, [](const Vec<3>& x) -> Label {
    return x[2] < 8.0 ? 1 : x[2] < 16.0 ? 2 : 3;
  });
  const LinearElastic soft(50.0, 0.0);
  Loads<3> weight{.tractions = {}, .mass_forces = {acceleration<3>(Vec<3>(0, 0, -1))}};
  weight.density = {Parameter(0.0), Parameter(3.0), Parameter([](const Vec<3>& x) { return 0.1 * x[2]; }),
                    Parameter(0.5)};
  const auto hung = [&] {
    return solve_on_cells(image, {{}, soft, soft, soft}, {clamp<3>("top")}, weight, {.size = 1.0, .tolerance = 1e-6});
  };
  const CellSolution two = hung();
  const double exact = 64.0 * (8.0 * 3.0 + 0.1 * 12.0 * 8.0 + 8.0 * 0.5);
  for (const CellLevel& level : two.levels)
    EXPECT_NEAR(level.reactions.at("top").force.z(), exact, 1e-4 * exact) << level.edges.transpose();
  set_num_threads(1);
  const CellSolution one = hung();
  set_num_threads(2);
  EXPECT_EQ(one.displacement, two.displacement);
  EXPECT_EQ(one.applied[0].of.force, two.applied[0].of.force);
}

/// The soft side of an interface within a cell takes more strain than a continuous one has: 12 % of the energy here.
TEST(Cells, InterfacesWithinCellsAreInTheStatedError) {
  for (const Index interface : {13, 14, 17}) {
    const auto image = image_of({8, 8, 31}, [&](const Vec<3>& x) -> Label { return x[2] < interface ? 1 : 2; });
    const std::vector<SharedMaterial> materials{{}, LinearElastic(1000.0, 0.0), LinearElastic(1e6, 0.0)};
    const double exact = 0.5 * 64.0 * 0.01 / (interface / 1000.0 + (31.0 - interface) / 1e6);
    const CellSolution solution = solve_on_cells(image, materials, stretched_along_z(0.1), {});
    const double truth = std::sqrt(solution.finest().strain_energy / exact - 1.0),
                 stated = std::hypot(solution.grid_error, solution.interface_error);
    EXPECT_GT(truth, 0.1);
    EXPECT_GT(stated, 0.8 * truth) << interface;
    EXPECT_LT(stated, 1.25 * truth) << interface;
    EXPECT_NEAR(solution.extrapolated_energy, exact, 2e-3 * exact) << interface;
    // Cells of a voxel are voxels, whatever their number.
    const CellSolution by_voxels = solve_on_cells(image, materials, stretched_along_z(0.1), {}, {.size = 1.0});
    EXPECT_NEAR(by_voxels.finest().strain_energy, exact, 1e-5 * exact) << interface;
    EXPECT_EQ(by_voxels.interface_error, 0.0);
    const CellSolution along = solve_on_cells(image, materials,
                                              {symmetry_plane<3>("front"),
                                               symmetry_plane<3>("bottom"),
                                               symmetry_plane<3>("left"),
                                               {"right", {}, [=](const Vec<3>&) { return 0.1; }}},
                                              {});
    EXPECT_LT(along.interface_error, 1e-3) << "layers along the load bear it together";
  }
}

/// Layers that are pulled along themselves press on each other: each of the tractions across them, the strains along
/// them and what both do together has its part in what cells lack. Closed form: the strains along the layers are
/// uniform, those across them add up to nothing.
TEST(Cells, InterfacesWithinCellsOfLayersPulledAlongThemselvesAreInTheStatedError) {
  const double M1 = 1.0, nu1 = 0.25, contrast = 20.0, nu2 = 0.4, strain = 0.1 / 12.0;
  const auto modulus = [](double M, double nu) { return M * (1.0 + nu) * (1.0 - 2.0 * nu) / (1.0 - nu); };
  const double M2 = contrast * M1, lambda1 = M1 * nu1 / (1.0 - nu1), lambda2 = M2 * nu2 / (1.0 - nu2);
  for (const Index interface : {13, 14, 17}) {
    const auto image = image_of({12, 12, 31}, [&](const Vec<3>& x) -> Label { return x[2] < interface ? 1 : 2; });
    const double d1 = static_cast<double>(interface), d2 = 31.0 - d1;
    const double traction = (d1 * lambda1 / M1 + d2 * lambda2 / M2) * strain / (d1 / M1 + d2 / M2);
    const auto energy = [&](double M, double lambda) {
      return 0.5 * (M * strain + lambda * (traction - lambda * strain) / M) * strain;
    };
    const double exact = 144.0 * (d1 * energy(M1, lambda1) + d2 * energy(M2, lambda2));
    std::vector<DisplacementCondition<3>> held{{"right", {}, [](const Vec<3>&) { return 0.1; }}};
    for (const char* side : {"left", "front", "back", "bottom", "top"}) held.push_back(symmetry_plane<3>(side));
    const CellSolution solution = solve_on_cells(
        image, {{}, LinearElastic(modulus(M1, nu1), nu1), LinearElastic(modulus(M2, nu2), nu2)}, held, {});
    const double truth = std::sqrt(solution.finest().strain_energy / exact - 1.0),
                 stated = std::hypot(solution.grid_error, solution.interface_error);
    EXPECT_GT(truth, 0.01);
    EXPECT_GT(stated, 0.8 * truth) << interface;
    EXPECT_LT(stated, 1.4 * truth) << interface;
    EXPECT_NEAR(solution.extrapolated_energy, exact, 3e-3 * exact) << interface;
  }
}

/// On cells smaller than the eighths of voxels whose shares are known, interfaces are as wide as these.
TEST(Cells, CurvedInterfacesLackNothingMoreOnCellsSmallerThanVoxels) {
  const auto image =
      image_of({8, 8, 8}, [](const Vec<3>& x) -> Label { return (x - Vec<3>(4.5, 3.5, 3.5)).norm() < 2.2 ? 2 : 1; });
  const std::vector<SharedMaterial> materials{{}, LinearElastic(1000.0, 0.3), LinearElastic(1.0, 0.3)};
  std::vector<CellSolution> solutions;
  for (const double size : {1.0, 0.5, 0.25, 0.125})
    solutions.push_back(solve_on_cells(image, materials, stretched_along_z(0.1), {}, {.size = size}));
  const double exact = solutions.back().extrapolated_energy;
  EXPECT_LT(exact, solutions.back().finest().strain_energy);
  for (const CellSolution& solution : solutions) {
    const double edge = solution.finest().edges[0];
    EXPECT_NEAR(solution.extrapolated_energy, exact, 0.03 * edge * exact) << edge;
    const double truth = std::sqrt(solution.finest().strain_energy / exact - 1.0),
                 stated = std::hypot(solution.grid_error, solution.interface_error);
    EXPECT_GT(stated, 0.5 * truth) << edge;
    EXPECT_LT(stated, 2.0 * truth) << edge;
  }
}

TEST(Cells, TurnedImagesHaveTheAnswerOfStraightOnesTurned) {
  LabelImage<3> image = image_of({18, 12, 10}, [](const Vec<3>& x) -> Label { return x[1] < 8.0 || x[0] > 12.0; });
  image.origin = {2.0, -1.0, 0.5};
  const auto solve = [&](const std::vector<DisplacementCondition<3>>& supports, const Vec<3>& traction) {
    Loads<3> loads;
    loads.tractions = {{"right", [=](const Vec<3>&, const Vec<3>&) { return traction; }}};
    return solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, supports, loads, {.size = 1.0, .tolerance = 1e-9});
  };
  const Vec<3> traction(0.3, -0.2, 0.1);
  const auto difference = [&](const CellSolution& one, const CellSolution& turned) {
    const Points<3> back = turned.axes.transpose() * turned.displacement;
    return (back - one.displacement).cwiseAbs().maxCoeff() / one.displacement.cwiseAbs().maxCoeff();
  };
  const std::vector<DisplacementCondition<3>> clamped{
      moved("left", [](const Vec<3>&) { return Vec<3>::Zero().eval(); })};
  // Components of the world that are other axes of the image, so that they are held as if they were oblique.
  DisplacementCondition<3> along_x{"left", {}, {}}, along_y{"left", {}, {}}, both{"bottom", {}, {}};
  along_x.components[0] = along_y.components[1] = [](const Vec<3>&) { return 0.0; };
  both.components[0] = [](const Vec<3>&) { return 0.0; };
  both.components[2] = [](const Vec<3>&) { return 0.1; };
  DisplacementCondition<3> turned_both{"bottom", {}, {}};
  turned_both.components[1] = both.components[0];
  turned_both.components[2] = both.components[2];
  const DisplacementCondition<3> front = symmetry_plane<3>("front");
  const CellSolution straight = solve(clamped, traction), parts = solve({along_x, both, front}, traction);
  for (const double angle : {0.5 * M_PI, 0.4}) {
    const Vec<3> axis = angle > 1.0 ? Vec<3>::UnitZ().eval() : Vec<3>(1.0, 2.0, -1.0).normalized();
    image.axes = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    const CellSolution turned = solve(clamped, image.axes * traction);
    EXPECT_LT(difference(straight, turned), 1e-8);
    EXPECT_LT(
        (turned.finest().reactions.at("left").force - image.axes * straight.finest().reactions.at("left").force).norm(),
        1e-8);
    if (angle < 1.0) continue;
    const CellSolution turned_parts = solve({along_y, turned_both, front}, image.axes * traction);
    EXPECT_LT(difference(parts, turned_parts), 1e-6);
    for (const char* side : {"left", "bottom", "front"}) {
      const Vec<3> wanted = image.axes * parts.finest().reactions.at(side).force;
      EXPECT_LT((turned_parts.finest().reactions.at(side).force - wanted).norm(), 1e-6 * traction.norm() * 120.0)
          << side;
    }
  }
}

TEST(Cells, ObliqueConditionsThatContradictEachOtherAreRefused) {
  LabelImage<3> image = image_of({8, 8, 8}, [](const Vec<3>&) -> Label { return 1; });
  image.axes = Eigen::AngleAxisd(0.4, Vec<3>::UnitZ()).toRotationMatrix();
  const auto held = moved("left", [](const Vec<3>&) { return Vec<3>::Zero().eval(); }),
             pulled = moved("bottom", [](const Vec<3>&) { return Vec<3>(0.0, 0.1, 0.0); });
  try {
    solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)}, {held, pulled}, {}, {.size = 1.0});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("contradict each other"), std::string::npos) << error.what();
  }
}

TEST(Cells, SidesThatContradictEachOtherAreRefused) {
  const auto image = image_of({8, 8, 8}, [](const Vec<3>&) -> Label { return 1; });
  EXPECT_THROW(solve_on_cells(image, {{}, LinearElastic(1.0, 0.3)},
                              {clamp<3>("bottom"), moved("left", [](const Vec<3>&) { return Vec<3>(1, 0, 0); })}, {}),
               InputError);
}

TEST(Cells, RefuseWhatTheyCannotDo) {
  const auto image = image_of({8, 8, 8}, [](const Vec<3>&) -> Label { return 1; });
  const std::vector<SharedMaterial> materials{{}, LinearElastic(1.0, 0.3)};
  EXPECT_THROW(solve_on_cells(image, materials, {clamp<3>("pores")}, {}), InputError);
  EXPECT_THROW(solve_on_cells(image, materials, {clamp<3>("left")},
                              {.tractions = {}, .mass_forces = {acceleration<3>(Vec<3>(0, 0, 1))}}),
               InputError)
      << "no density";
  EXPECT_THROW(solve_on_cells(image, {{}}, {clamp<3>("left")}, {}), InputError);
  EXPECT_THROW(solve_on_cells(image, materials, {clamp<3>("left")}, {}, {.size = -1.0}), InputError);
  // Loaded, but free to move.
  EXPECT_THROW(solve_on_cells(image, materials, {symmetry_plane<3>("bottom")},
                              {.tractions = {{"right", [](const Vec<3>&, const Vec<3>&) { return Vec<3>(0, 1, 0); }}},
                               .body_force = {}}),
               InputError);
}

/// 40 x 40 x 84 cells are halved along z only from the third grid on, where 21 become 11: a preconditioner that is too
/// stiff there ended iterations before bars had bent.
TEST(Cells, EnergiesOfNearlyIncompressibleBarsGrowOnGridsThatHalveOneAxis) {
  const auto image = image_of({40, 40, 84}, [](const Vec<3>&) -> Label { return 1; });
  const CellSolution solution = solve_on_cells(
      image, {{}, LinearElastic(1.0, 0.499)}, {clamp<3>("bottom")},
      {.tractions = {{"top", [](const Vec<3>&, const Vec<3>&) { return Vec<3>(0.2, 0.3, 1.0); }}}, .body_force = {}},
      {.size = 1.0});
  ASSERT_EQ(solution.levels.size(), 4u);
  for (std::size_t l = 0; l + 1 < solution.levels.size(); ++l)
    EXPECT_GT(solution.levels[l].strain_energy, solution.levels[l + 1].strain_energy) << l;
  EXPECT_LT(solution.finest().iterations, 60);
}

TEST(Cells, MaterialsThatRoundingLosesAreRefused) {
  const auto image = image_of({8, 8, 8}, [](const Vec<3>& x) -> Label { return x[2] < 4.0 ? 1 : 2; });
  EXPECT_THROW(solve_on_cells(image, {{}, LinearElastic(1.0, 0.3), LinearElastic(1e-12, 0.3)},
                              {clamp<3>("bottom"), {"top", {}, [](const Vec<3>&) { return 0.1; }}}, {}),
               InputError);
}

/// Around a spherical hole without traction u = (A + B / r^3) x, with 3 K A = 4 G B / a^3 (G. Lame, 1852): prescribed
/// on the frame, so that the hole takes up what volume is left.
TEST(Cells, NearlyIncompressibleMaterialsDoNotLock) {
  constexpr double radius = 10.0, half = 16.0, G = 1.0, A = 1e-3;
  const auto image =
      image_of({32, 32, 32}, [&](const Vec<3>& x) -> Label { return (x - Vec<3>::Constant(half)).norm() > radius; });
  for (const double nu : {0.3, 0.49, 0.499}) {
    const double K = 2.0 * G * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu)), B = 3.0 * K * A / (4.0 * G) * std::pow(radius, 3);
    const auto from_centre = [&](const Vec<3>& x) { return Vec<3>(x - Vec<3>::Constant(half)); };
    const auto u = [&](const Vec<3>& x) {
      const Vec<3> arm = from_centre(x);
      return Vec<3>((A + B / std::pow(arm.norm(), 3)) * arm);
    };
    const auto stress = [&](const Vec<3>& x) {
      const Vec<3> arm = from_centre(x);
      const double r = arm.norm();
      return Mat<3>(3.0 * K * A * Mat<3>::Identity() +
                    2.0 * G * B / std::pow(r, 3) * (Mat<3>::Identity() - 3.0 * arm * arm.transpose() / (r * r)));
    };
    double energy = 0.0;  // half the work on the frame, six times that on one side
    constexpr int parts = 100;
    const double edge = 2.0 * half / parts;
    for (int i = 0; i < parts; ++i)
      for (int j = 0; j < parts; ++j) {
        const Vec<3> x((i + 0.5) * edge, (j + 0.5) * edge, 2.0 * half);
        energy += 3.0 * edge * edge * u(x).dot(stress(x).col(2));
      }
    std::vector<DisplacementCondition<3>> conditions;
    for (const std::string& side : all_sides) conditions.push_back(moved(side, u));
    const std::vector<SharedMaterial> materials{{}, LinearElastic(2.0 * G * (1.0 + nu), nu)};
    const CellSolution solution = solve_on_cells(image, materials, conditions, {}, {.size = 1.0});
    EXPECT_EQ(solution.mean_dilatation, nu > 0.4);
    EXPECT_NEAR(solution.finest().strain_energy, energy, 0.02 * energy) << nu;
    EXPECT_NEAR(solution.extrapolated_energy, energy, 0.01 * energy) << nu;
    EXPECT_LE(solution.finest().iterations, 10.0 + 7.0 * std::sqrt(K / G)) << nu;
    // Stresses, whose pressure is 3 K A everywhere, away from steps of voxels.
    const Vec<3> probe(half, half + 13.5, half + 1.5);
    const CellFields fields = recover_cell_fields(solution, image, {-1, 0}, {materials[1]}, {probe});
    const Voigt<3>& found = fields.probes[0].stress;
    const Mat<3> exact = stress(probe);
    EXPECT_NEAR(found.head<3>().mean(), 3.0 * K * A, 0.03 * exact.norm()) << nu;
    EXPECT_NEAR(found[1], exact(1, 1), 0.04 * exact.norm()) << nu;
    EXPECT_NEAR(found[3], exact(1, 2), 0.04 * exact.norm()) << nu;
  }
}
