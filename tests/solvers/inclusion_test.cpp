// SPDX-License-Identifier: GPL-3.0-or-later
/// Regions of different moduli, tied to each other by Nitsche.
#include "efree/bench/inclusion.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using bench::Inclusion;

struct Result {
  double l2, energy, recovered;
};

Result solve(const Inclusion& inclusion, double H, ApproximationOptions options = {}) {
  const bool elements = options.kind != BasisKind::mls;
  const FineMesh<2> mesh(elements ? inclusion.mesh(H) : cut_regions(inclusion.mesh(H / 5.0)));
  options.spacing = H;
  const auto approximation = approximate(mesh, options);
  const ElasticModel model = inclusion.model(elements ? Essential::strong : Essential::nitsche);
  const ElasticSolver<2> solver(approximation, model, {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")});
  const auto errors = errors_against(approximation, recover_fields(approximation, solver.solve(inclusion.loads())),
                                     materials_of(model, mesh), inclusion.exact());
  return {*errors.l2_displacement, *errors.energy_norm, *errors.energy_norm_recovered};
}

TEST(InclusionSolution, IsContinuousAcrossTheInterfaceAndInEquilibrium) {
  for (const double ratio : {0.1, 10.0, 1000.0})
    for (const double b : {1.0, 0.5}) {
      const Inclusion exact(1.0, b, ratio);
      for (const double t : {0.1, 0.7, 1.4}) {
        const Vec<2> on(std::cos(t), b * std::sin(t));
        const Vec<2> n = Vec<2>(b * std::cos(t), std::sin(t)).normalized();
        const double step = 1e-9;
        EXPECT_LT((exact.displacement(on + step * n) - exact.displacement(on - step * n)).norm(), 1e-7);
        EXPECT_LT((traction<2>(exact.stress(on + step * n), n) - traction<2>(exact.stress(on - step * n), n)).norm(),
                  1e-7);
        const double d = 1e-5;
        const Vec<2> x = 1.7 * on;
        const auto derivative = [&](int i) -> Voigt<2> {
          return (exact.stress(x + d * Vec<2>::Unit(i)) - exact.stress(x - d * Vec<2>::Unit(i))) / (2.0 * d);
        };
        const Voigt<2> dx = derivative(0), dy = derivative(1);
        EXPECT_NEAR(dx[0] + dy[3], 0.0, 1e-8);
        EXPECT_NEAR(dx[3] + dy[1], 0.0, 1e-8);
      }
    }
}

/// u = H x in the matrix and in the inclusion, with equal tractions and displacements on the line between them: two
/// stripes in series.
TEST(Regions, StripesInSeriesAreExact) {
  const double ratio = 50.0;
  MeshData<2> data = triangulate_data(
      [] {
        PlanarDomain domain = shapes::rectangle(0, 0, 1, 1);
        domain.embedded.push_back({"", {{0.37, 0.0}, {0.37, 1.0}}});
        return domain;
      }(),
      {.size = 0.05});
  data.region_names = {"soft", "stiff"};
  for (Index c = 0; c < data.cells.cols(); ++c) {
    double x = 0.0;
    for (int i = 0; i < 3; ++i) x += data.vertices(0, data.cells(i, c)) / 3.0;
    data.regions.push_back(x > 0.37);
  }
  const FineMesh<2> mesh(cut_regions(data));
  // nu = 0, so that the stripes do not pull each other sideways.
  const ElasticModel model{
      .material = {}, .plane = Plane::strain, .regions = {LinearElastic(1.0, 0.0), LinearElastic(ratio, 0.0)}};
  const auto exact = [&](const Vec<2>& x) { return Vec<2>(x.x() < 0.37 ? x.x() : 0.37 + (x.x() - 0.37) / ratio, 0.0); };
  for (const auto secondary : {SecondaryKind::cells, SecondaryKind::mls})
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const auto approximation = approximate(mesh, {.spacing = 0.2, .seed = seed, .secondary = secondary});
      const auto solution = ElasticSolver<2>(approximation, model, {clamp<2>("left")})
                                .solve({.tractions = {tension<2>("right", 1.0)}, .body_force = {}});
      const Matrix u = interpolate(approximation.shape, solution.coefficients);
      for (Index v = 0; v < mesh.num_vertices(); ++v)
        EXPECT_LT((u.col(v) - exact(mesh.vertex(v))).norm(), 1e-11) << "at " << mesh.vertex(v).transpose();
      for (Index K = 0; K < solution.stress.cols(); ++K)
        EXPECT_LT((solution.stress.col(K) - Voigt<2>(1.0, 0.0, 0.0, 0.0)).norm(), 1e-10);
    }
}

TEST(Regions, MaterialsAndCutsAreAskedFor) {
  const Inclusion inclusion(1.0, 1.0, 10.0);
  const FineMesh<2> whole(inclusion.mesh(0.2)), parted(cut_regions(inclusion.mesh(0.2)));
  EXPECT_THROW(approximate(whole, {.spacing = 0.5}), InputError);
  const auto approximation = approximate(parted, {.spacing = 0.5});
  EXPECT_THROW(
      ElasticSolver<2>(approximation, {.material = {}, .plane = Plane::stress, .regions = {LinearElastic(1.0, 0.3)}},
                       {clamp<2>("left")}),
      InputError);
}

class InclusionConvergence : public ::testing::TestWithParam<std::pair<double, double>> {};

TEST_P(InclusionConvergence, DisplacementIsOfSecondOrderAndStrainDoesNotSmear) {
  const auto [b, ratio] = GetParam();
  const Inclusion inclusion(1.0, b, ratio);
  const Result coarse = solve(inclusion, 0.4), fine = solve(inclusion, 0.1);
  EXPECT_GE(std::log2(coarse.l2 / fine.l2) / 2.0, 1.8);
  EXPECT_LE(std::log2(coarse.l2 / fine.l2) / 2.0, 3.2);
  EXPECT_GE(std::log2(coarse.energy / fine.energy) / 2.0, 0.95);  // a smeared jump would leave one half
  EXPECT_GE(std::log2(coarse.recovered / fine.recovered) / 2.0, 1.1);
}

INSTANTIATE_TEST_SUITE_P(Shapes, InclusionConvergence,
                         ::testing::Values(std::pair{1.0, 10.0}, std::pair{1.0, 1000.0}, std::pair{0.5, 10.0},
                                           std::pair{0.5, 1000.0}));

}  // namespace
}  // namespace efree
