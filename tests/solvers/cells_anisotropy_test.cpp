// SPDX-License-Identifier: GPL-3.0-or-later
/// Anisotropic materials on grids of cells against closed forms.
#include "efree/tests/solvers/labelled_image.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/image_boundary.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/cell_fields.hpp"
#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/solvers/cells/internal/cell_grid.hpp"
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <random>

using namespace efree;

namespace {

using test::image_of, test::stretched_along_z;

Mat<3> turned(double angle, const Vec<3>& axis) {
  return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
}

/// E 10 : 3 : 1.
OrthotropicModuli bone(const Mat<3>& axes) {
  return {{10.0, 3.0, 1.0}, {0.3, 0.25, 0.35}, {0.7, 1.1, 2.0}, axes};
}

/// The stress of a strain tensor in the material's own axes (Lekhnitskii 1963), turned back.
Mat<3> stress_of_strain(const OrthotropicModuli& moduli, const Mat<3>& strain) {
  const auto& [E, nu, G, axes] = moduli;
  Mat<3> compliance = E.cwiseInverse().asDiagonal();
  compliance(1, 2) = compliance(2, 1) = -nu[0] / E[1];
  compliance(0, 2) = compliance(2, 0) = -nu[1] / E[0];
  compliance(0, 1) = compliance(1, 0) = -nu[2] / E[0];
  const Mat<3> own = axes.transpose() * strain * axes;
  const Vec<3> normal = compliance.inverse() * own.diagonal();
  Mat<3> stress = normal.asDiagonal();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (i != j) stress(i, j) = 2.0 * G[3 - i - j] * own(i, j);
  return axes * stress * axes.transpose();
}
double contracted(const Mat<3>& a, const Mat<3>& b) {
  return a.cwiseProduct(b).sum();
}

const std::vector<std::string> all_sides{"left", "right", "front", "back", "bottom", "top"};
std::vector<DisplacementCondition<3>> moved(const std::function<Vec<3>(const Vec<3>&)>& u,
                                            const std::vector<std::string>& sides = all_sides) {
  std::vector<DisplacementCondition<3>> held;
  for (const std::string& side : sides) {
    held.push_back({side, {}, {}});
    for (int c = 0; c < 3; ++c) held.back().components[c] = [u, c](const Vec<3>& x) { return u(x)[c]; };
  }
  return held;
}
/// Largest distance from a displacement field.
double farthest(const CellSolution& solution, const std::function<Vec<3>(const Vec<3>&)>& u) {
  double worst = 0.0;
  Eigen::Index point = 0;
  for (Index k = 0; k <= solution.grid.cubes[2]; ++k)
    for (Index j = 0; j <= solution.grid.cubes[1]; ++j)
      for (Index i = 0; i <= solution.grid.cubes[0]; ++i, ++point) {
        const Vec<3> x = solution.grid.origin + solution.axes * solution.grid.spacing.cwiseProduct(Vec<3>(i, j, k));
        worst = std::max(worst, (solution.displacement.col(point) - u(x)).norm());
      }
  return worst;
}

}  // namespace

TEST(CellsAnisotropy, UniformStrainsHaveTheirExactStressAndEnergyWhateverTheAxes) {
  Mat<3> A;
  A << 1.0, 0.3, -0.2, 0.1, -0.5, 0.4, 0.2, 0.1, 0.7;
  A *= 1e-3;
  const Mat<3> strain = 0.5 * (A + A.transpose());
  const auto linear = [&](const Vec<3>& x) -> Vec<3> { return A * x + Vec<3>(0.1, 0.2, 0.3); };
  auto image = image_of({11, 9, 8}, [](const Vec<3>&) -> Label { return 1; });
  image.spacing = {1.0, 2.0, 0.5};
  image.origin = {-3.0, 4.0, 5.0};
  for (const bool turned_material : {false, true})
    for (const bool turned_image : {false, true}) {
      const OrthotropicModuli moduli =
          bone(turned_material ? turned(0.7, {1.0, -2.0, 0.5}) : Mat<3>(Mat<3>::Identity()));
      image.axes = turned_image ? turned(0.5, {1.0, 2.0, 3.0}) : Mat<3>(Mat<3>::Identity());
      const OrthotropicElastic material(moduli);
      const Mat<3> stress = stress_of_strain(moduli, strain);
      const double energy = 0.5 * contracted(stress, strain) * 11.0 * 9.0 * 8.0;
      for (const double size : {0.5, 2.3}) {
        const CellSolution solution =
            solve_on_cells(image, {{}, material}, moved(linear), {}, {.size = size, .tolerance = 1e-9});
        EXPECT_LT(farthest(solution, linear), 1e-6 * A.norm() * 40.0);
        EXPECT_NEAR(solution.finest().strain_energy, energy, 1e-6 * energy);
        const CellFields fields =
            recover_cell_fields(solution, image, {-1, 0}, {material}, {image.in_world(image.origin + Vec<3>(4, 8, 2))});
        const Voigt<3>& found = fields.probes[0].stress;
        EXPECT_NEAR(found[0], stress(0, 0), 1e-5 * stress.norm());
        EXPECT_NEAR(found[3], stress(1, 2), 1e-5 * stress.norm());
        EXPECT_NEAR(found[4], stress(0, 2), 1e-5 * stress.norm());
      }
    }
}

TEST(CellsAnisotropy, ForcesOfPartsAreThoseOfTheirWholeStiffness) {
  // An isotropic stiffness in two pieces, with shares of any size, against one piece.
  constexpr std::array<Index, 3> cells{21, 17, 40};
  const Vec<3> edges(1.0, 0.7, 1.3);
  const internal::IsotropicStiffness base{0.3, 0.2}, whole{1.0, 1.5};
  const VoigtMatrix<3> beyond = whole.matrix() - base.matrix();
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform(0.0F, 1.0F);
  internal::Parts pieces, one;
  pieces.shares.resize(2);
  const internal::PartOrder order(cells);
  pieces.shares[1].assign(order(0, 0, cells[2], 0), 0.0F);
  for (Index part = 0; part < static_cast<Index>(order(0, 0, cells[2], 0)); ++part) {
    const bool is_whole = part < static_cast<Index>(order(0, 0, 10, 0));
    const float share = is_whole ? 1.0F : std::round(8.0F * uniform(random)) / 8.0F;
    pieces.shares[0].push_back(share);
    if (!is_whole && share > 0.5F) {
      pieces.shares[0].back() = 0.5F;
      pieces.shares[1][part] = share - 0.5F;
    }
    pieces.shear.push_back(share * 0.3F);
    pieces.across.push_back(share * 0.2F);
    one.shear.push_back(share);
    one.across.push_back(share * 1.5F);
  }
  const internal::CellGrid in_pieces(cells, edges, internal::layers_of(pieces, cells), {}, {beyond, beyond}),
      in_one(cells, edges, internal::layers_of(one, cells));
  std::vector<double> u(in_one.size()), f(u.size()), g(u.size());
  for (double& value : u) value = static_cast<double>(uniform(random)) - 0.5;
  in_pieces.apply(u.data(), f.data());
  in_one.apply(u.data(), g.data());
  const std::vector<float> v(u.begin(), u.end());
  std::vector<float> h(v.size());
  in_pieces.apply(v.data(), h.data());
  for (std::size_t i = 0; i < u.size(); ++i) {
    ASSERT_NEAR(f[i], g[i], 3e-6);
    ASSERT_NEAR(static_cast<double>(h[i]), g[i], 1e-4);
  }
  const internal::Parts kept = in_pieces.layers(7, 21);
  for (const int m : {0, 1})
    for (std::size_t part = 0; part < kept.shares[m].size(); ++part)
      ASSERT_EQ(kept.shares[m][part], pieces.shares[m][order(0, 0, 7, 0) + part]);
}

TEST(CellsAnisotropy, IsotropicPartsAreTheLargestBelowTheStiffness) {
  const internal::IsotropicStiffness iso{0.4, 0.7};
  for (const bool nearly_incompressible : {false, true}) {
    const auto found = internal::isotropic_part(iso.matrix(), nearly_incompressible);
    EXPECT_NEAR(found.shear, iso.shear, 1e-8);
    EXPECT_NEAR(found.across, iso.across, 1e-8);
  }
  // Of a cubic stiffness, whose eigenvalues are 3 kappa, 2 mu and 2 mu': the smallest quotient is 1.
  VoigtMatrix<3> cubic = internal::IsotropicStiffness{2.0, 3.0}.matrix();
  cubic.bottomRightCorner<3, 3>() *= 5.0;
  const auto below = internal::isotropic_part(cubic, false);
  EXPECT_NEAR(below.shear, 2.0, 1e-6);
  EXPECT_LE(3.0 * below.across + 2.0 * below.shear, 13.0 + 1e-6);
  const Mat<3> axes = turned(1.1, {0.3, 0.2, -1.0});
  EXPECT_LT((internal::rotate_to_axes(iso.matrix(), axes) - iso.matrix()).norm(), 1e-12);
}

TEST(CellsAnisotropy, AnIsotropicMaterialWithThreeAxesIsTheIsotropicOne) {
  const auto image =
      image_of({16, 16, 16}, [](const Vec<3>& x) -> Label { return (x - Vec<3>::Constant(8.0)).norm() > 5.0; });
  const double E = 2.0, nu = 0.3, G = E / (2.0 * (1.0 + nu));
  const auto solve = [&](const SharedMaterial& material) {
    return solve_on_cells(image, {{}, material}, stretched_along_z(0.16), {}, {.size = 1.0, .tolerance = 1e-8});
  };
  const CellSolution isotropic = solve(LinearElastic(E, nu));
  // By a hair anisotropic, so that it is solved as such.
  const double hair = 1e-7;
  for (const double by : {0.0, hair}) {
    const CellSolution orthotropic = solve(OrthotropicElastic(
        {Vec<3>::Constant(E), Vec<3>::Constant(nu), Vec<3>(G * (1.0 + by), G, G), turned(0.4, {1, 1, 0})}));
    EXPECT_NEAR(orthotropic.finest().strain_energy, isotropic.finest().strain_energy,
                1e-6 * isotropic.finest().strain_energy);
    EXPECT_LT((orthotropic.displacement - isotropic.displacement).cwiseAbs().maxCoeff(), 1e-6 * 0.16);
    EXPECT_LE(orthotropic.finest().iterations, isotropic.finest().iterations + 2);
  }
}

TEST(CellsAnisotropy, LayersInSeriesAreExactWhereCellsEndBetweenThem) {
  // u depends on z only: tractions A a are the same in both layers, A = n . C . n the acoustic tensor.
  const OrthotropicModuli moduli = bone(turned(0.7, {1.0, -2.0, 0.5}));
  const double E = 4.0, nu = 0.2;
  const auto traction_of = [&](const Vec<3>& a, bool lower) -> Vec<3> {
    const Mat<3> gradient = a * Vec<3>::UnitZ().transpose(), strain = 0.5 * (gradient + gradient.transpose());
    if (!lower) return stress_of_strain(moduli, strain).col(2);
    const Lame lame = solid_lame({E, nu});
    return Mat<3>(lame.lambda * strain.trace() * Mat<3>::Identity() + 2.0 * lame.mu * strain).col(2);
  };
  Mat<3> acoustic[2];
  for (const bool lower : {false, true})
    for (int c = 0; c < 3; ++c) acoustic[lower].col(c) = traction_of(Vec<3>::Unit(c), lower);
  const Vec<3> traction(0.2, -0.1, 0.3), above = acoustic[0].inverse() * traction,
                                         below = acoustic[1].inverse() * traction;
  const auto u = [&](const Vec<3>& x) -> Vec<3> {
    return std::min(x[2], 8.0) * below + std::max(x[2] - 8.0, 0.0) * above;
  };
  const auto image = image_of({8, 8, 16}, [](const Vec<3>& x) -> Label { return x[2] < 8.0 ? 1 : 2; });
  const CellSolution solution = solve_on_cells(image, {{}, LinearElastic(E, nu), OrthotropicElastic(moduli)}, moved(u),
                                               {}, {.size = 1.0, .tolerance = 1e-9});
  const double energy = 0.5 * 64.0 * 8.0 * traction.dot(above + below);
  EXPECT_NEAR(solution.finest().strain_energy, energy, 1e-6 * energy);
  EXPECT_LT(farthest(solution, u), 1e-5 * u({0.0, 0.0, 16.0}).norm());
}

/// Layers of one material whose axes differ: the traction is that of layers in series, which continuous strains lack.
TEST(CellsAnisotropy, InterfacesWithinCellsBetweenAxesAreInTheStatedError) {
  const double stiff = 1000.0, soft = 30.0;
  const Vec<3> G = Vec<3>::Constant(100.0);
  const OrthotropicElastic along({{soft, soft, stiff}, Vec<3>::Zero(), G}),
      across({{stiff, soft, soft}, Vec<3>::Zero(), G});
  for (const Index interface : {13, 14, 17}) {
    const auto image = image_of({8, 8, 31}, [&](const Vec<3>& x) -> Label { return x[2] < interface ? 1 : 2; });
    const double exact = 0.5 * 64.0 * 0.01 / (interface / soft + (31.0 - interface) / stiff);
    const CellSolution solution = solve_on_cells(image, {{}, across, along}, stretched_along_z(0.1), {});
    const double truth = std::sqrt(solution.finest().strain_energy / exact - 1.0),
                 stated = std::hypot(solution.grid_error, solution.interface_error);
    EXPECT_GT(stated, 0.7 * truth) << interface;
    EXPECT_LT(stated, 1.4 * truth) << interface;
    EXPECT_NEAR(solution.extrapolated_energy, exact, 5e-3 * exact) << interface;
  }
}

/// Where several grains meet each alone has gaps and overlaps with the others.
TEST(CellsAnisotropy, GrainsOfOneMaterialAreThatMaterial) {
  const std::vector<Vec<3>> seeds{{3, 4, 5}, {13, 3, 11}, {4, 14, 12}, {12, 12, 3}, {9, 8, 14}};
  const auto grains = image_of({16, 16, 16}, [&](const Vec<3>& x) -> Label {
    std::size_t nearest = 0;
    for (std::size_t s = 1; s < seeds.size(); ++s)
      if ((x - seeds[s]).norm() < (x - seeds[nearest]).norm()) nearest = s;
    return static_cast<Label>(nearest + 1);
  });
  const auto crystal = image_of({16, 16, 16}, [](const Vec<3>&) -> Label { return 1; });
  const Mat<3> axes = turned(0.7, {1.0, -2.0, 0.5});
  std::vector<SharedMaterial> materials{{}};
  for (std::size_t s = 0; s < seeds.size(); ++s)
    materials.emplace_back(OrthotropicElastic(bone(axes), 1.0 + 1e-7 * static_cast<double>(s)));
  for (const double size : {1.0, 2.0}) {
    const CellOptions options{.size = size, .tolerance = 1e-7};
    const double energy =
        solve_on_cells(crystal, materials, stretched_along_z(0.1), {}, options).finest().strain_energy;
    EXPECT_NEAR(solve_on_cells(grains, materials, stretched_along_z(0.1), {}, options).finest().strain_energy, energy,
                1e-5 * energy);
  }
}

TEST(CellsAnisotropy, PolycrystalsWithPoresAreBitwiseTheSameOnThreadsAndBetweenTheirBounds) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> angle(0.0, 3.0), uniform(-1.0, 1.0);
  std::vector<Vec<3>> seeds;
  std::vector<SharedMaterial> materials{{}};
  for (int s = 0; s < 12; ++s) {
    seeds.emplace_back(Vec<3>(uniform(random), uniform(random), uniform(random)) * 12.0 + Vec<3>::Constant(12.0));
    materials.emplace_back(
        OrthotropicElastic(bone(turned(angle(random), Vec<3>(uniform(random), uniform(random), uniform(random))))));
  }
  const auto image = image_of({24, 24, 24}, [&](const Vec<3>& x) -> Label {
    if ((x - Vec<3>(12.0, 10.0, 13.0)).norm() < 5.0) return 0;
    std::size_t nearest = 0;
    for (std::size_t s = 1; s < seeds.size(); ++s)
      if ((x - seeds[s]).norm() < (x - seeds[nearest]).norm()) nearest = s;
    return static_cast<Label>(nearest + 1);
  });
  const int before = num_threads();
  std::vector<CellSolution> solutions;
  for (const int threads : {1, 2}) {
    set_num_threads(threads);
    solutions.push_back(
        solve_on_cells(image, materials, stretched_along_z(0.24), {}, {.size = 1.0, .half_voxel = true}));
  }
  set_num_threads(before);
  EXPECT_EQ(solutions[0].displacement, solutions[1].displacement);
  EXPECT_EQ(solutions[0].finest().strain_energy, solutions[1].finest().strain_energy);
  EXPECT_EQ(solutions[0].half_voxel, solutions[1].half_voxel);
  // Uniaxial stress in the stiffest direction of all, and in the softest of a block that the pore cuts through.
  const double modulus = 2.0 * solutions[0].finest().strain_energy / (1e-4 * std::pow(24.0, 3));
  EXPECT_LT(modulus, 10.0);
  EXPECT_GT(modulus, 0.8);
  for (const CellLevel& level : solutions[0].levels) EXPECT_LE(level.iterations, 40);
}

/// The bar alone bears, E A strain^2 / 2: A and what half a voxel takes off it are those of an isotropic one.
TEST(CellsAnisotropy, ABarAlongXWithVoidAroundItConverges) {
  const auto image = image_of(
      {24, 14, 14}, [](const Vec<3>& x) -> Label { return std::abs(x[1] - 7.0) < 3.0 && std::abs(x[2] - 7.0) < 3.0; });
  const OrthotropicElastic anisotropic({{10.0, 3.0, 1.0}, {0.3, 0.25, 0.35}, {0.7, 1.1, 2.0}});
  const LinearElastic isotropic(10.0, 0.3);
  const auto along_x = [](double by) {
    DisplacementCondition<3> condition{"left", {}, {}};
    condition.components[0] = [=](const Vec<3>&) { return by; };
    return condition;
  };
  std::vector<DisplacementCondition<3>> held{along_x(0.0), along_x(0.24)};
  held[1].on = "right";
  for (const double size : {2.0, 1.0}) {
    const CellOptions options{.size = size, .tolerance = 1e-6, .half_voxel = true};
    const CellSolution solution = solve_on_cells(image, {{}, anisotropic}, held, {}, options),
                       other = solve_on_cells(image, {{}, isotropic}, held, {}, options);
    const double energy = 0.5 * 10.0 * 1e-4 * 24.0 * 36.0;
    EXPECT_NEAR(solution.finest().strain_energy, energy, 0.05 * energy) << "the bar has round edges";
    EXPECT_NEAR(solution.finest().strain_energy, other.finest().strain_energy, 1e-5 * energy);
    EXPECT_NEAR(solution.finest().reactions.at("right").force.x(), 2.0 * solution.finest().strain_energy / 0.24, 1e-5);
    EXPECT_NEAR(solution.half_voxel, other.half_voxel, 1e-3);
    EXPECT_LE(solution.finest().iterations, 80);
  }
}

TEST(CellsAnisotropy, SlenderBarsBendByTheirModulusAlongThem) {
  // Timoshenko: P L^3 / (3 E I) + 6/5 P L / (G A).
  const double E = 200.0, G = 20.0, length = 64.0, depth = 8.0, load = 0.01;
  const auto image = image_of({64, 4, 8}, [](const Vec<3>&) -> Label { return 1; });
  const CellSolution solution = solve_on_cells(
      image, {{}, OrthotropicElastic({{E, 20.0, 20.0}, Vec<3>::Zero(), Vec<3>::Constant(G)})}, {clamp<3>("left")},
      {.tractions = {{"right", [=](const Vec<3>&, const Vec<3>&) { return Vec<3>(0.0, 0.0, load); }}}},
      {.size = 1.0, .tolerance = 1e-6});
  const double P = load * 4.0 * depth, I = 4.0 * std::pow(depth, 3) / 12.0,
               tip = P * std::pow(length, 3) / (3.0 * E * I) + 1.2 * P * length / (G * 4.0 * depth);
  EXPECT_NEAR(solution.finest().strain_energy, 0.5 * P * tip, 0.015 * 0.5 * P * tip);
  EXPECT_LT((solution.finest().reactions.at("left").force + Vec<3>(0.0, 0.0, P)).norm(), 1e-8 * P);
}

/// The same bar with kappa / G = 33 in the shears along the axes and 50 in the others.
TEST(CellsAnisotropy, NearlyIncompressibleBarsDoNotLock) {
  const double E = 200.0, nu = 0.49, G = 1.5 * E / (2.0 * (1.0 + nu)), length = 64.0, depth = 8.0, load = 0.01;
  const auto image = image_of({64, 4, 8}, [](const Vec<3>&) -> Label { return 1; });
  const CellSolution solution = solve_on_cells(
      image, {{}, OrthotropicElastic({Vec<3>::Constant(E), Vec<3>::Constant(nu), Vec<3>::Constant(G)})},
      {clamp<3>("left")},
      {.tractions = {{"right", [=](const Vec<3>&, const Vec<3>&) { return Vec<3>(0.0, 0.0, load); }}}}, {.size = 1.0});
  const double P = load * 4.0 * depth, I = 4.0 * std::pow(depth, 3) / 12.0,
               tip = P * std::pow(length, 3) / (3.0 * E * I) + 1.2 * P * length / (G * 4.0 * depth);
  EXPECT_TRUE(solution.mean_dilatation);
  EXPECT_NEAR(solution.finest().strain_energy, 0.5 * P * tip, 0.03 * 0.5 * P * tip);
}

/// u depends on z only: tractions f A a are the same everywhere, A = n . C . n the acoustic tensor and f the factor.
TEST(CellsAnisotropy, FactorsThatDifferFromPlaceToPlaceConvergeAtSecondOrder) {
  const OrthotropicModuli moduli = bone(turned(0.7, {1.0, -2.0, 0.5}));
  Mat<3> acoustic;
  for (int c = 0; c < 3; ++c) {
    const Mat<3> gradient = Vec<3>::Unit(c) * Vec<3>::UnitZ().transpose();
    acoustic.col(c) = stress_of_strain(moduli, 0.5 * (gradient + gradient.transpose())).col(2);
  }
  const Vec<3> traction(0.2, -0.1, 0.3), slope = acoustic.inverse() * traction;
  const auto u = [&](const Vec<3>& x) -> Vec<3> { return 8.0 * std::log(1.0 + x[2] / 8.0) * slope; };
  const OrthotropicElastic varying(moduli, Parameter([](const Vec<3>& x) { return 1.0 + x[2] / 8.0; }));
  const auto image = image_of({8, 8, 16}, [](const Vec<3>&) -> Label { return 1; });
  const double energy = 0.5 * 64.0 * traction.dot(u({0.0, 0.0, 16.0}));
  std::vector<double> errors;
  for (const double size : {2.0, 1.0}) {
    const CellSolution solution = solve_on_cells(image, {{}, varying}, moved(u), {}, {.size = size, .tolerance = 1e-8});
    errors.push_back(std::abs(solution.finest().strain_energy / energy - 1.0));
  }
  EXPECT_LT(errors[0], 0.01);
  EXPECT_GT(errors[0] / errors[1], 3.5);
  EXPECT_LT(errors[0] / errors[1], 4.5);
}
