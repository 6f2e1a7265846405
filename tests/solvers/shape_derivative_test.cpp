// SPDX-License-Identifier: GPL-3.0-or-later
/// What facets of curved boundaries change, as the shape derivative has it, against closed forms.
#include "efree/solvers/algorithms/shape_derivative.hpp"

#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"
#include "kirsch.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using std::numbers::pi;

/// The strain energy of quadratic elements, and its change by the derivative.
template <int Dim>
std::pair<double, ShapeChange> energy_and_change(const CurvedMesh<Dim>& curved, const ElasticModel& model,
                                                 const std::vector<DisplacementCondition<Dim>>& supports,
                                                 const Loads<Dim>& loads) {
  const FineMesh<Dim> mesh(curved.mesh);
  const auto elements = approximate<Dim>(mesh, {.kind = BasisKind::p2});
  const auto solution = ElasticSolver<Dim>(elements, model, supports).solve(loads);
  const auto materials = materials_of(model, mesh);
  const ShapeDerivative<Dim> derivative(elements.space, facet_offsets(mesh, curved.boundary), materials, supports, {});
  return {solution.strain_energy, derivative.potential_energy(solution.coefficients, loads)};
}

/// Under pressure inside, plane strain: half the pressure times the area that the bore opens by.
double energy_of_tube(double inner, double outer, const IsotropicModuli& moduli) {
  const double u = (1.0 + moduli.nu) * inner * inner / (moduli.E * (outer * outer - inner * inner)) * inner *
                   (1.0 - 2.0 * moduli.nu + outer * outer / (inner * inner));
  return pi * inner * u;
}

TEST(ShapeDerivative, TellsWhatFacetsOfATubeUnderPressureLeave) {
  const IsotropicModuli moduli{1.0, 0.3};
  for (const double inner : {1.0, 1.9})
    for (const int turn : {32, 64}) {
      const double size = 2.0 * 2.0 * pi / turn;
      const auto [energy, change] = energy_and_change<2>(
          triangulate_curved(shapes::annulus(inner, 2.0, size * inner / 2.0),
                             {.size = std::min(size, inner > 1.5 ? 0.05 : 0.2)}),
          {.material = LinearElastic(moduli), .plane = Plane::strain, .essential = Essential::nitsche},
          {elastic_support<2>("outer", 1e-9)}, {.tractions = {tension<2>("inner", -1.0)}, .body_force = {}});
      const double truth = energy_of_tube(inner, 2.0, moduli) - energy;
      EXPECT_GT(change.size(), 0.25 * std::abs(truth)) << inner << ' ' << turn;  // 0.5 to 2 in the energy norm
      EXPECT_LT(change.size(), 4.0 * std::abs(truth)) << inner << ' ' << turn;
    }
}

/// Stress and displacement are linear in the radius: no elements are in it.
TEST(ShapeDerivative, IsExactToFirstOrderWhereStressesAreTheSameEverywhere) {
  const IsotropicModuli moduli{1.0, 0.3};
  const CurvedMesh<3> ring = solids::half_torus(2.0, 0.5, 0.35);
  const auto [energy, change] =
      energy_and_change<3>(ring, {.material = LinearElastic(moduli), .essential = Essential::strong},
                           {symmetry_plane<3>("start"), symmetry_plane<3>("end"), elastic_support<3>("surface", 1e-9)},
                           {.tractions = {tension<3>("surface", -1.0)}, .body_force = {}});
  const double bulk = moduli.E / (3.0 * (1.0 - 2.0 * moduli.nu)), volume = pi * pi * 2.0 * 0.25;
  const double truth = volume / (2.0 * bulk) - energy;
  EXPECT_GT(truth, 0.01 * energy);
  EXPECT_NEAR(-change.sum, truth, 0.1 * truth);
}

/// Half the work of the tractions on the outer sides.
double energy_of_the_plate() {
  namespace kirsch = testing::kirsch;
  constexpr int steps = 1000;
  double work = 0.0;
  for (int k = 0; k < steps; ++k)
    for (const Vec<2>& x : {Vec<2>(4.0, 4.0 * (k + 0.5) / steps), Vec<2>(4.0 * (k + 0.5) / steps, 4.0)}) {
      const Vec<2> n = x.x() == 4.0 ? Vec<2>(1.0, 0.0) : Vec<2>(0.0, 1.0);
      work += 4.0 / steps * traction<2>(kirsch::stress(x), n).dot(kirsch::displacement(x));
    }
  return 0.5 * work;
}

TEST(ShapeDerivative, TellsWhatChordsOfAHoleLeaveAndIsABetterAnswerWithIt) {
  namespace kirsch = testing::kirsch;
  const auto pulled = [](const Vec<2>& x, const Vec<2>& n) { return traction<2>(kirsch::stress(x), n); };
  for (const double size : {2.0 * pi / 24, 2.0 * pi / 48}) {
    const auto [energy, change] = energy_and_change<2>(
        triangulate_curved(shapes::quarter_plate_with_hole(1.0, 4.0, size), {.size = size}),
        {.material = LinearElastic(kirsch::E, kirsch::nu), .plane = Plane::stress, .essential = Essential::strong},
        {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
        {.tractions = {{"right", pulled}, {"top", pulled}}, .body_force = {}});
    const double truth = energy_of_the_plate() - energy;
    EXPECT_GT(truth, 0.0);
    EXPECT_NEAR(-change.sum, truth, 0.2 * truth);
  }
}

TEST(ShapeDerivative, OfTheEnergyIsHalfThatOfTheWork) {
  const CurvedMesh<2> curved = triangulate_curved(shapes::annulus(1.0, 2.0, 0.3), {.size = 0.3});
  const FineMesh<2> mesh(curved.mesh);
  const ElasticModel model{
      .material = LinearElastic(IsotropicModuli{1.0, 0.3}), .plane = Plane::stress, .essential = Essential::nitsche};
  const std::vector<DisplacementCondition<2>> supports{elastic_support<2>("outer", 1e-3)};
  const Loads<2> loads{.tractions = {}, .body_force = [](const Vec<2>& x) -> Vec<2> { return {x.x(), 2.0 * x.y()}; }};
  const auto elements = approximate<2>(mesh, {.kind = BasisKind::p2});
  const auto u = ElasticSolver<2>(elements, model, supports).solve(loads).coefficients;
  const auto materials = materials_of(model, mesh);
  const ShapeDerivative<2> derivative(elements.space, facet_offsets(mesh, curved.boundary), materials, supports, {});
  const ShapeChange potential = derivative.potential_energy(u, {}), work = derivative.functional(u, u, {});
  EXPECT_NE(potential.sum, 0.0);
  EXPECT_NEAR(work.sum, -2.0 * potential.sum, 1e-12 * potential.magnitude);
  EXPECT_GE(potential.size(), 0.05 * potential.magnitude);
  EXPECT_TRUE(
      ShapeDerivative<2>(elements.space, Matrix::Zero(6, mesh.num_facets()), materials, supports, {}).is_flat());
}

}  // namespace
}  // namespace efree
