// SPDX-License-Identifier: GPL-3.0-or-later
/// Finite elements whose regions share nodes: stresses jump there, and are recovered region by region.
#include "efree/bench/inclusion.hpp"
#include "efree/bench/layers.hpp"
#include "efree/bench/refined.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <random>

namespace efree {
namespace {

constexpr double stiff = 1000.0;

template <int Dim> struct Answer {
  Approximation<Dim> elements;
  Solution<Dim> solution;
  Fields<Dim> fields;
  double said;
};
template <int Dim> Answer<Dim> solve(const FineMesh<Dim>& mesh, BasisKind kind, const ElasticModel& model,
                                     const std::vector<DisplacementCondition<Dim>>& supports, const Loads<Dim>& loads) {
  Answer<Dim> a{approximate<Dim>(mesh, {.kind = kind, .axisymmetric = model.plane == Plane::axisymmetric}), {}, {}, 0};
  a.solution = ElasticSolver<Dim>(a.elements, model, supports).solve(loads);
  a.fields = recover_fields(a.elements, a.solution);
  a.said = recovery_error(a.elements, a.fields, materials_of(model, mesh)).relative;
  return a;
}

ElasticModel two_materials(double second, double nu, Plane plane) {
  return {.material = {},
          .plane = plane,
          .essential = Essential::strong,
          .regions = {LinearElastic(1.0, nu), LinearElastic(second, nu)}};
}

/// Calls visit(cell, place, its position) for all places of all cells.
template <int Dim, class Visit> void at_all_places(const FineSpace<Dim>& space, const Visit& visit) {
  for (Index c = 0; c < space.mesh().num_cells(); ++c)
    for (const Index place : space.places(c)) visit(c, place, Vec<Dim>(space.points().col(space.dof_at(place))));
}

/// Strips that are stretched side by side have one strain and carry what their moduli give them.
TEST(RegionsThatShareNodes, StripsSideBySideJumpInStressAndNothingIsSaidToBeLeft) {
  const FineMesh<2> mesh(bench::layers({0.0, 0.0}, {2.0, 1.0}, 1, {0.31, 0.72}, 0.15));
  const double nu = 0.3, strain = 0.01;
  const DisplacementCondition<2> pulled{"right", {[=](const Vec<2>&) { return 2.0 * strain; }, nullptr}, nullptr};
  for (const BasisKind kind : {BasisKind::p1, BasisKind::p2}) {
    const auto a = solve<2>(mesh, kind, two_materials(stiff, nu, Plane::stress),
                            {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), pulled}, {});
    const FineSpace<2>& space = a.elements.space;
    EXPECT_GT(space.num_places(), space.size());
    at_all_places<2>(space, [&](Index c, Index place, const Vec<2>& x) {
      const double E = mesh.region(c) == 1 ? stiff : 1.0;
      EXPECT_LT((a.fields.stress.col(place) - Voigt<2>(E * strain, 0.0, 0.0, 0.0)).norm(), 1e-9 * E * strain + 1e-10)
          << "at " << x.transpose() << ", region " << mesh.region(c);
      EXPECT_LT((a.fields.strain.col(place) - Voigt<2>(strain, -nu * strain, -nu * strain, 0.0)).norm(), 1e-11);
    });
    EXPECT_LT(a.said, 1e-10);
    // A probe on the interface has the stress of one side, not a mixture.
    const auto values = probe(space, a.fields, Vec<2>(1.0, 0.31));
    EXPECT_LT(std::min(std::abs(values.stress[0] - strain), std::abs(values.stress[0] - stiff * strain)), 1e-9);
  }
}

/// Slabs in a row carry one stress, and their strains jump.
TEST(RegionsThatShareNodes, SlabsInSeriesJumpInStrain) {
  auto data = testing::box(4, 0.0);
  data = bench::in_two_regions<3>(std::move(data), [](const Vec<3>& x) { return x.x() > 0.5; });
  const auto mesh = testing::with_sides(data);
  ElasticModel model = two_materials(stiff, 0.0, Plane::strain);
  for (const BasisKind kind : {BasisKind::p1, BasisKind::p2}) {
    const auto a = solve<3>(mesh, kind, model, {clamp<3>("left")}, {{tension<3>("right", 1.0)}, {}});
    at_all_places<3>(a.elements.space, [&](Index c, Index place, const Vec<3>& x) {
      const double E = mesh.region(c) == 1 ? stiff : 1.0;
      EXPECT_NEAR(a.fields.strain(0, place), 1.0 / E, 1e-9 / E) << "at " << x.transpose();
      EXPECT_NEAR(a.fields.stress(0, place), 1.0, 1e-9) << "at " << x.transpose();
    });
    EXPECT_LT(a.said, 1e-9);
  }
}

/// Two tubes, one shrunk on the other, under pressure from inside (Lame 1852): u = A r + B / r in each, equal
/// displacements and radial stresses between them.
struct TwoTubes {
  static constexpr double inner = 1.0, middle = 1.5, outer = 2.0, nu = 0.3;
  std::array<double, 2> moduli;
  std::array<double, 4> c;  ///< A, B of the inner one, A, B of the outer one

  explicit TwoTubes(double second) : moduli{1.0, second} {
    Eigen::Matrix4d M = Eigen::Matrix4d::Zero();
    const auto radial = [&](int tube, double r) -> Eigen::RowVector2d {
      const double mu = moduli[tube] / (2.0 * (1.0 + nu));
      return {2.0 * mu / (1.0 - 2.0 * nu), -2.0 * mu / (r * r)};
    };
    M.block<1, 2>(0, 0) = radial(0, inner);
    M.block<1, 2>(1, 0) = radial(0, middle);
    M.block<1, 2>(1, 2) = -radial(1, middle);
    M.row(2) << middle, 1.0 / middle, -middle, -1.0 / middle;
    M.block<1, 2>(3, 2) = radial(1, outer);
    const Eigen::Vector4d solution = M.fullPivLu().solve(Eigen::Vector4d(-1.0, 0.0, 0.0, 0.0));
    std::copy(solution.begin(), solution.end(), c.begin());
  }
  /// Radial, axial, hoop and shear stress in a tube whose ends do not move.
  Voigt<2> stress(int tube, double r) const {
    const double mu = moduli[tube] / (2.0 * (1.0 + nu)), A = c[2 * tube], B = c[2 * tube + 1] / (r * r);
    const double mean = 2.0 * mu / (1.0 - 2.0 * nu) * A;
    return {mean - 2.0 * mu * B, 2.0 * nu * mean, mean + 2.0 * mu * B, 0.0};
  }
  ExactSolution<2> exact() const {
    return {{}, [this](const Vec<2>& x) -> Voigt<2> { return stress(x.x() > middle, x.x()); }};
  }
};

TEST(RegionsThatShareNodes, HoopStressesOfTwoTubesUnderPressureJumpAsLameHasIt) {
  for (const double second : {stiff, 1.0 / stiff}) {
    const TwoTubes tubes(second);
    const auto model = two_materials(second, TwoTubes::nu, Plane::axisymmetric);
    for (const BasisKind kind : {BasisKind::p1, BasisKind::p2}) {
      const double order = kind == BasisKind::p1 ? 1.0 : 1.5;  // of recovery, one-sided at interfaces and walls
      std::vector<double> worst;
      for (const double h : {0.1, 0.05}) {
        const FineMesh<2> mesh(bench::layers({TwoTubes::inner, 0.0}, {TwoTubes::outer, 0.5}, 0, {TwoTubes::middle}, h));
        const auto a = solve<2>(mesh, kind, model, {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")},
                                {{pressure<2>("left", [](const Vec<2>&) { return 1.0; })}, {}});
        worst.push_back(0.0);
        at_all_places<2>(a.elements.space, [&](Index c, Index place, const Vec<2>& x) {
          const auto exact = tubes.stress(mesh.region(c), x.x());
          worst.back() = std::max(worst.back(), (a.fields.stress.col(place) - exact).norm() / exact.norm());
        });
        const auto errors = errors_against(a.elements, a.fields, materials_of(model, mesh), tubes.exact());
        if (kind == BasisKind::p1) {
          EXPECT_NEAR(a.said / *errors.energy_norm, 1.0, 0.1) << second << ", h = " << h;
          EXPECT_LT(*errors.energy_norm_recovered, 0.7 * *errors.energy_norm) << second << ", h = " << h;
        } else {  // so smooth that the planes of recovery are further off than quadratic elements, in one tube as well
          EXPECT_GT(a.said, 1.5 * *errors.energy_norm) << second << ", h = " << h;
          EXPECT_LT(a.said, 2.3 * *errors.energy_norm) << second << ", h = " << h;
        }
      }
      EXPECT_LT(worst[0], 0.1) << second;
      EXPECT_GT(std::log2(worst[0] / worst[1]), 0.8 * order) << second;
    }
  }
}

/// Truth: quadratic elements on the same polygon refined twice.
TEST(RegionsThatShareNodes, SaidErrorsOfAnInclusionOfAnotherModulusAreHalfToTwiceTheTruth) {
  for (const double ratio : {stiff, 1.0 / stiff}) {
    const bench::Inclusion inclusion(1.0, 0.6, ratio);
    const auto solved = [&](const FineMesh<2>& mesh, BasisKind kind) {
      return solve<2>(mesh, kind, inclusion.model(Essential::strong),
                      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")}, inclusion.loads());
    };
    const FineMesh<2> mesh(inclusion.mesh(0.2));
    const double exact = solved(bench::refined(bench::refined(mesh)), BasisKind::p2).solution.strain_energy;
    for (const BasisKind kind : {BasisKind::p1, BasisKind::p2}) {
      const auto a = solved(mesh, kind);
      const double truth = std::sqrt((exact - a.solution.strain_energy) / exact);
      EXPECT_GT(a.said, 0.5 * truth) << ratio;
      EXPECT_LT(a.said, 2.0 * truth) << ratio;
    }
  }
}

/// Specks of a cell or two have too little around them for a plane, and keep what they have.
template <int Dim> void expect_specks_keep_their_stress(const FineMesh<Dim>& mesh) {
  for (const BasisKind kind : {BasisKind::p1, BasisKind::p2}) {
    const auto model = two_materials(stiff, 0.3, Plane::stress);
    const auto a = solve<Dim>(mesh, kind, model, {clamp<Dim>("left")}, {{tension<Dim>("right", 1.0)}, {}});
    EXPECT_TRUE(a.fields.stress.allFinite());
    EXPECT_TRUE(std::isfinite(a.said));
    EXPECT_LT(a.said, 1.0);
    const FineSpace<Dim>& space = a.elements.space;
    std::vector<int> cells(space.num_places(), 0);
    at_all_places<Dim>(space, [&](Index, Index place, const Vec<Dim>&) { ++cells[place]; });
    Index alone = 0;
    for (Index c = 0; c < mesh.num_cells() && kind == BasisKind::p1; ++c)
      for (const Index place : space.places(c)) {
        if (cells[place] > 1) continue;
        ++alone;
        EXPECT_LT((a.fields.stress.col(place) - a.solution.stress.col(c)).norm(),
                  1e-12 * a.solution.stress.col(c).norm());
      }
    if (kind == BasisKind::p1) {
      EXPECT_GT(alone, 10);
    }
  }
}
TEST(RegionsThatShareNodes, SpecksOfACellKeepItsStress) {
  std::mt19937_64 generator(7);
  const auto one_in_ten = [&](const auto&) { return generator() % 10 == 0; };
  const auto domain = shapes::rectangle(0.0, 0.0, 1.0, 1.0);
  expect_specks_keep_their_stress<2>(
      FineMesh<2>(bench::in_two_regions<2>(triangulate_data(domain, {.size = 0.1}), one_in_ten)));
  expect_specks_keep_their_stress<3>(testing::with_sides(bench::in_two_regions<3>(testing::box(4), one_in_ten)));
}

/// Parted along its interface a mesh has the same places as degrees of freedom.
TEST(RegionsThatShareNodes, PlacesAreTheDegreesOfFreedomOfTheMeshPartedThere) {
  const auto data = bench::layers({0.0, 0.0}, {2.0, 1.0}, 1, {0.31, 0.72}, 0.15);
  const FineMesh<2> whole(data), parted(cut_regions(data));
  for (const int degree : {1, 2}) {
    const FineSpace<2> space(whole, degree), of_parted(parted, degree);
    EXPECT_EQ(of_parted.num_places(), of_parted.size());
    EXPECT_EQ(space.num_places(), of_parted.size());
    std::vector<Index> region(space.num_places(), -1);
    at_all_places<2>(space, [&](Index c, Index place, const Vec<2>&) {
      if (region[place] < 0) region[place] = whole.region(c);
      EXPECT_EQ(region[place], whole.region(c));
      EXPECT_EQ(space.place(space.dof_at(place), whole.region(c)), place);
    });
    for (Index c = 0; c < whole.num_cells(); ++c)
      for (std::size_t i = 0; i < space.cell(c).size(); ++i)
        EXPECT_EQ(space.dof_at(space.places(c)[i]), space.cell(c)[i]);
  }
}

}  // namespace
}  // namespace efree
