// SPDX-License-Identifier: GPL-3.0-or-later
/// Corrected answers of nearly incompressible bodies, against closed forms: they must not lock.
#include "efree/assembly/operators.hpp"
#include "efree/bench/cavity.hpp"
#include "efree/bench/lame.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

constexpr double nu = 0.4999;

/// Relative distance of a displacement with a pressure of its own from the exact solution: of the shear in the energy
/// norm, and of the pressure.
template <int Dim> double distance_from(const VoigtField<Dim>& exact, const FineSpace<Dim>& space,
                                        const Fields<Dim>& fields, const Materials<Dim>& materials) {
  constexpr int normals = 3;  // in space and around an axis
  const Stiffness<Dim> stiffness = materials.stiffness(0, Vec<Dim>::Zero());
  const double kappa = stiffness.kappa, mu = stiffness.C(voigt_size<Dim> - 1, voigt_size<Dim> - 1);
  const auto rule = simplex_rule<Dim>(4);
  double distance = 0.0, norm = 0.0;
  for (Index c = 0; c < space.mesh().num_cells(); ++c)
    for (Index q = 0; q < rule.weights.size(); ++q) {
      const auto at = rule.points.col(q);
      const Vec<Dim> x = space.position(c, at);
      const double dV = space.mesh().volume(c) * rule.weights[q] * space.measure(x);
      Voigt<Dim> shear = exact(x);
      const double p = shear.template head<normals>().mean();
      shear.template head<normals>().array() -= p;
      const Voigt<Dim> eps = strain_at<Dim>(space, c, at, fields.displacement);
      Voigt<Dim> found = stiffness.C * eps;
      found.template head<normals>().array() -= kappa * eps.template head<normals>().sum();
      double found_p = 0.0;
      const auto N = space.values(at);
      const auto dofs = space.cell(c);
      for (std::size_t k = 0; k < dofs.size(); ++k)
        found_p += N[static_cast<Index>(k)] * fields.stress.col(dofs[k]).template head<normals>().mean();
      const auto energy = [&](Voigt<Dim> s, double mean) {
        s.template tail<voigt_size<Dim> - normals>() *= std::sqrt(2.0);
        return dV * (0.5 * s.squaredNorm() / mu + mean * mean / kappa);
      };
      distance += energy(found - shear, found_p - p);
      norm += energy(shear, p);
    }
  return std::sqrt(distance / norm);
}

/// Errors of a corrected answer against the exact solution, and what is said of them.
struct Found {
  Errors errors;
  double largest;   ///< error of the displacement anywhere, of the largest one
  double recovery;  ///< estimate of errors.energy_norm
  double said;      ///< of the cloud, against the corrected answer
  double cloud;     ///< of the cloud, against the exact solution
};
template <int Dim> Found corrected(const FineMesh<Dim>& mesh, double spacing, const ElasticModel& model,
                                   const std::vector<DisplacementCondition<Dim>>& supports, const Loads<Dim>& loads,
                                   const ExactSolution<Dim>& exact) {
  const bool axisymmetric = Dim == 2 && model.plane == Plane::axisymmetric;
  const auto cloud = approximate<Dim>(
      mesh, {.axisymmetric = axisymmetric, .interpolation = 2, .spacing = spacing, .dilatation = Dilatation::averaged});
  const auto materials = materials_of(model, mesh);
  const auto start = recover_fields(cloud, ElasticSolver<Dim>(cloud, model, supports).solve(loads));
  const auto u = Corrector<Dim>(cloud, model, supports).correct(start.displacement, loads).displacement;
  const auto elements = approximate<Dim>(mesh, {.kind = BasisKind::p2,
                                                .axisymmetric = axisymmetric,
                                                .dilatation = averaged_if(takes_mean_dilatation(cloud, model))});
  const auto fields = recover_fields(elements, evaluate(elements, model, u));
  Found found{errors_against<Dim>(elements, fields, materials, exact), 0.0,
              recovery_error(elements, fields, materials).relative, mixed_distance(elements, u, start, materials),
              distance_from<Dim>(exact.stress, cloud.space, start, materials)};
  double size = 0.0;
  for (Index dof = 0; dof < elements.space.size(); ++dof) {
    const Vec<Dim> there = exact.displacement(elements.space.points().col(dof));
    size = std::max(size, there.norm());
    found.largest = std::max(found.largest, (u.col(dof) - there).norm());
  }
  found.largest /= size;
  return found;
}
Found cylinder(double size, double spacing) {
  const bench::ThickWall wall{false, {1.0, nu}};
  return corrected<2>(
      wall.mesh<2>(1.0, size, size), spacing, {.material = LinearElastic(wall.material), .plane = Plane::axisymmetric},
      {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")}, wall.loads<2>(),
      {[&](const Vec<2>& x) { return wall.displacement<2>(x); }, [&](const Vec<2>& x) { return wall.stress<2>(x); }});
}
template <int TenThousandths> Found cavity(double size, double spacing) {
  using Cavity = bench::CavityIn<TenThousandths>;
  return corrected<3>(Cavity::mesh(size), spacing, {.material = LinearElastic(Cavity::material)},
                      {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                      Cavity::loads(), {Cavity::displacement, Cavity::stress});
}

void expect_cloud_known(const Found& found) {
  EXPECT_GT(found.said, 0.7 * found.cloud);
  EXPECT_LT(found.said, 1.4 * found.cloud);
}

/// The divergence of the exact displacement is constant: the elements are better than their order, which recovery
/// cannot see.
TEST(NearlyIncompressible, CorrectedCylinderIsThatOfLame) {
  const Found found = cylinder(0.1, 0.3);
  EXPECT_LT(found.largest, 1e-4);
  EXPECT_LT(*found.errors.energy_norm, 1e-3);
  EXPECT_GT(found.recovery, *found.errors.energy_norm);
  EXPECT_LT(found.recovery, 2e-3);
  expect_cloud_known(found);
}
/// Most of the displacement's error is that of the chords across the sphere, whatever Poisson's ratio.
TEST(NearlyIncompressible, CorrectedCavityIsThatOfGoodier) {
  const Found found = cavity<4999>(0.4, 1.2), compressible = cavity<3000>(0.4, 1.2);
  EXPECT_LT(found.largest, 0.025);
  EXPECT_LT(*found.errors.energy_norm, 0.04);
  EXPECT_LT(*found.errors.l2_displacement, 1.1 * *compressible.errors.l2_displacement);
  EXPECT_GT(found.recovery, 0.7 * *found.errors.energy_norm);
  EXPECT_LT(found.recovery, 1.4 * *found.errors.energy_norm);
  expect_cloud_known(found);
  expect_cloud_known(compressible);
}

/// Tension in plane strain where 1/E falls linearly along the bar, to a hundredth: strains are linear, so that a
/// uniform uniaxial stress is compatible. The bulk modulus grows a hundredfold within a few pressure patches.
TEST(NearlyIncompressible, BarWhoseModulusGrowsAHundredfoldHasTheClosedFormEnergy) {
  constexpr double poisson = 0.45, slope = 0.99, length = 1.0, height = 0.4;
  constexpr double along = 1.0 - poisson * poisson,
                   across = -poisson * (1.0 + poisson);  // strains of a unit stress times E
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, length, height), {.size = 0.02});
  const auto approximation = approximate(mesh, {.spacing = 0.08, .dilatation = Dilatation::averaged});
  ASSERT_GT(approximation.pressures.cols(), 3);
  const VectorField<2> exact = [&](const Vec<2>& x) -> Vec<2> {
    return {along * (x[0] - 0.5 * slope * x[0] * x[0]) + 0.5 * across * slope * x[1] * x[1],
            across * (1.0 - slope * x[0]) * x[1]};
  };
  const ElasticModel model{
      .material = LinearElastic([](const Vec<3>& x) { return 1.0 / (1.0 - slope * x[0]); }, poisson),
      .plane = Plane::strain};
  const Loads<2> pull{.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(1.0, 0.0); }}},
                      .body_force = {}};
  const auto solution = ElasticSolver<2>(approximation, model, {testing::displacement<2>("left", exact)}).solve(pull);
  EXPECT_NEAR(solution.strain_energy, 0.5 * along * height * (length - 0.5 * slope * length * length),
              0.01 * solution.strain_energy);
  const auto fields = recover_fields(approximation, solution);
  const auto& places = approximation.space.points();
  for (Index v = 0; v < places.cols(); ++v) {
    const Vec<2> x = places.col(v);
    ASSERT_LT((fields.displacement.col(v) - exact(x)).norm(), 0.01) << x.transpose();
    const bool grows_most = x[0] > 0.6 && x[0] < 0.95 && std::abs(x[1] - 0.5 * height) < 0.03;
    if (!grows_most) continue;
    EXPECT_NEAR(fields.stress(0, v), 1.0, 0.13) << x.transpose();
    EXPECT_NEAR(fields.stress(1, v), 0.0, 0.13) << x.transpose();
  }
}

}  // namespace
}  // namespace efree
