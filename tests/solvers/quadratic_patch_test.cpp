// SPDX-License-Identifier: GPL-3.0-or-later
/// Order 2 on a quadratic field. On quadratic cells, fully integrated, it is exact. On linear ones the basis reproduces
/// the field at every fine vertex only, so what is reached is O(h^2) in displacement.
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

/// Largest error at fine vertices, relative to the largest displacement. u = (x^2 + x y, y^2 - x y / 2), plane stress,
/// E = 1.
double quadratic_patch_error(double h, const ApproximationOptions& options) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = h});
  const auto approximation = approximate(mesh, options);
  const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  const Lame lame = plane_lame({1.0, 0.3}, Plane::stress);
  const VectorField<2> u = [](const Vec<2>& x) -> Vec<2> {
    return {x.x() * x.x() + x.x() * x.y(), x.y() * x.y() - 0.5 * x.x() * x.y()};
  };
  // eps_xx = 2x + y, eps_yy = 2y - x/2, gamma = x - y/2, so the forces are constant.
  const Vec<2> b(-(1.5 * lame.lambda + 4.0 * lame.mu - 0.5 * lame.mu), -(3.0 * lame.lambda + 4.0 * lame.mu + lame.mu));
  std::vector<DisplacementCondition<2>> conditions;
  for (const char* side : {"left", "bottom", "right", "top"}) conditions.push_back(testing::displacement<2>(side, u));
  const auto solution =
      ElasticSolver<2>(approximation, model, conditions).solve({{}, [&](const Vec<2>&) { return b; }});
  const Points<2> found = recover_fields(approximation, solution).displacement;
  double error = 0.0, largest = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    error = std::max(error, (found.col(v) - u(mesh.vertex(v))).cwiseAbs().maxCoeff());
    largest = std::max(largest, u(mesh.vertex(v)).cwiseAbs().maxCoeff());
  }
  return error / largest;
}

double order_between(double coarse, double fine, double refinement) {
  return std::log(coarse / fine) / std::log(refinement);
}

TEST(QuadraticPatch, QuadraticElementsAreExact) {
  EXPECT_LE(quadratic_patch_error(0.1, {.kind = BasisKind::p2}), 1e-12);
}

TEST(QuadraticPatch, OrderTwoOnQuadraticCellsIsExact) {
  EXPECT_LE(quadratic_patch_error(0.05, {.order = 2, .spacing = 0.25, .secondary = SecondaryKind::full}), 1e-11);
}

TEST(QuadraticPatch, OnLinearCellsTheErrorFallsWithTheSquareOfTheFineMeshSize) {
  const ApproximationOptions options{.order = 2, .interpolation = 1, .spacing = 0.25, .secondary = SecondaryKind::full};
  const double coarse = quadratic_patch_error(0.05, options), fine = quadratic_patch_error(0.0125, options);
  EXPECT_LE(coarse, 2e-4);
  EXPECT_NEAR(order_between(coarse, fine, 4.0), 2.0, 0.3);
}

class ProjectedQuadraticPatch : public ::testing::TestWithParam<SecondaryKind> {};

TEST_P(ProjectedQuadraticPatch, ErrorFallsWithTheSquareOfTheSpacing) {
  const auto worst = [](double H) {
    double error = 0.0;
    for (std::uint64_t seed = 1; seed <= 3; ++seed)
      error = std::max(
          error, quadratic_patch_error(H / 8.0, {.order = 2, .spacing = H, .seed = seed, .secondary = GetParam()}));
    return error;
  };
  const double coarse = worst(0.25), fine = worst(0.0625);
  EXPECT_LE(coarse, 2e-2);
  EXPECT_NEAR(order_between(coarse, fine, 4.0), 2.0, 0.4);
}

TEST_P(ProjectedQuadraticPatch, ErrorFallsWithTheNumberOfQuadraturePoints) {
  const auto error = [](double ratio) {
    return quadratic_patch_error(0.0125, {.order = 2, .spacing = 0.25, .secondary = GetParam(), .ratio = ratio});
  };
  EXPECT_LE(error(32.0), error(4.0) / 3.0);
}

INSTANTIATE_TEST_SUITE_P(Secondary, ProjectedQuadraticPatch,
                         ::testing::Values(SecondaryKind::cells, SecondaryKind::mls),
                         [](const auto& test) { return testing::name_of(test.param); });

/// Linear functions on clusters do the work of linear stresses exactly, whatever the cells, with fewer points than the
/// indicators need for an error of 2e-3.
class QuadraticPatch : public ::testing::TestWithParam<std::tuple<std::string, Essential>> {
 protected:
  /// Held on the whole outer boundary, or on the first part of it with tractions on the others.
  template <int Dim> static void expect_exact(const Approximation<Dim>& approximation, const ElasticModel& model,
                                              const std::vector<std::string>& outer,
                                              const std::vector<std::string>& inner, bool held) {
    std::vector<std::string> loaded(outer.begin() + 1, outer.end());
    loaded.insert(loaded.end(), inner.begin(), inner.end());
    for (const auto& field : testing::quadratic_fields<Dim>()) {
      const auto error = held ? testing::patch_error(approximation, model, field, outer, inner)
                              : testing::patch_error(approximation, model, field, {outer[0]}, loaded);
      EXPECT_LE(error.displacement, bar) << field.name << (held ? ", held" : ", loaded");
      EXPECT_LE(error.stress, bar) << field.name << (held ? ", held" : ", loaded");
      EXPECT_LE(error.recovered, bar) << field.name << (held ? ", held" : ", loaded");
    }
  }
  static constexpr double bar = 1e-11;
};

TEST_P(QuadraticPatch, IsExactOnLinearFunctionsOfClusters) {
  const auto [name, essential] = GetParam();
  const auto body = testing::body(name);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    ApproximationOptions options{
        .order = 2, .interpolation = 2, .spacing = body.spacing, .seed = seed, .secondary = SecondaryKind::linear};
    if (essential == Essential::strong) options.vanish_on = body.outer;
    const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = essential};
    expect_exact(approximate(body.mesh, options), model, body.outer, body.inner, seed % 2 == 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Bodies, QuadraticPatch,
                         ::testing::Combine(::testing::Values("square", "slivers", "plate_with_hole", "l_shape",
                                                              "slit"),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) +
                                  (std::get<1>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

class SolidQuadraticPatch : public QuadraticPatch {};

TEST_P(SolidQuadraticPatch, IsExactOnLinearFunctionsOfClusters) {
  const auto [name, essential] = GetParam();
  const auto mesh = testing::solid(name);
  ApproximationOptions options{.order = 2, .interpolation = 2, .spacing = 0.4, .secondary = SecondaryKind::linear};
  if (essential == Essential::strong) options.vanish_on = testing::box_sides;
  const std::vector<std::string> inner =
      name == "slit_box" ? std::vector<std::string>{"slit"} : std::vector<std::string>{};
  const ElasticModel model{.material = LinearElastic(1.0, 0.3), .essential = essential};
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    SCOPED_TRACE(seed);
    options.seed = seed;
    expect_exact(approximate(mesh, options), model, testing::box_sides, inner, seed % 2 == 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Solids, SolidQuadraticPatch,
                         ::testing::Combine(::testing::Values("box", "flat_cells", "slit_box"),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) +
                                  (std::get<1>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

}  // namespace
}  // namespace efree
