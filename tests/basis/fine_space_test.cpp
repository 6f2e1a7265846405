// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/fine_space.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

double factorial(int n) {
  return std::tgamma(n + 1.0);
}

TEST(SimplexRule, IntegratesMonomialsOnSegmentsExactly) {
  for (int degree = 1; degree <= 5; ++degree) {
    const auto rule = simplex_rule<1>(degree);
    for (int a = 0; a <= degree; ++a) {
      const Vector values = rule.points.row(1).array().pow(a);
      EXPECT_NEAR(rule.weights.dot(values), 1.0 / (a + 1), 1e-15) << "degree " << degree << ", x^" << a;
    }
  }
  EXPECT_THROW(simplex_rule<1>(6), InputError);
}

TEST(SimplexRule, IntegratesMonomialsOnTrianglesExactly) {
  for (int degree = 1; degree <= 5; ++degree) {
    const auto rule = simplex_rule<2>(degree);
    for (int a = 0; a <= degree; ++a)
      for (int b = 0; a + b <= degree; ++b) {
        const Vector values = rule.points.row(1).array().pow(a) * rule.points.row(2).array().pow(b);
        const double exact = 2.0 * factorial(a) * factorial(b) / factorial(a + b + 2);  // mean over the triangle
        EXPECT_NEAR(rule.weights.dot(values), exact, 1e-15) << "degree " << degree << ", x^" << a << " y^" << b;
      }
  }
  EXPECT_THROW(simplex_rule<2>(6), InputError);
}

TEST(SimplexRule, IntegratesMonomialsOnTetrahedraExactly) {
  for (int degree = 1; degree <= 5; ++degree) {
    const auto rule = simplex_rule<3>(degree);
    for (int a = 0; a <= degree; ++a)
      for (int b = 0; a + b <= degree; ++b)
        for (int c = 0; a + b + c <= degree; ++c) {
          const Vector values =
              rule.points.row(1).array().pow(a) * rule.points.row(2).array().pow(b) * rule.points.row(3).array().pow(c);
          const double exact = 6.0 * factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3);
          EXPECT_NEAR(rule.weights.dot(values), exact, 1e-15) << "degree " << degree << ", " << a << b << c;
        }
  }
  EXPECT_THROW(simplex_rule<3>(6), InputError);
}

TEST(FineSpace, HoldsPolynomialsOfItsDegreeInEveryCell) {
  const auto mesh = testing::body("plate_with_hole").mesh;
  for (int degree : {1, 2}) {
    const FineSpace<2> space(mesh, degree);
    const auto p = [&](const Vec<2>& x) {
      return 1.0 + 2.0 * x.x() - x.y() + (degree - 1) * (x.x() * x.y() - 3.0 * x.y() * x.y());
    };
    const auto dp = [&](const Vec<2>& x) -> Vec<2> {
      return Vec<2>(2.0, -1.0) + (degree - 1) * Vec<2>(x.y(), x.x() - 6.0 * x.y());
    };
    const auto rule = simplex_rule<2>(4);
    double value_error = 0.0, gradient_error = 0.0;
    for (Index c = 0; c < mesh.num_cells(); ++c)
      for (Index q = 0; q < rule.weights.size(); ++q) {
        const auto dofs = space.cell(c);
        const auto N = space.values(rule.points.col(q));
        const auto dN = space.gradients(c, rule.points.col(q));
        const Vec<2> x = space.position(c, rule.points.col(q));
        double value = 0.0;
        Vec<2> gradient = Vec<2>::Zero();
        for (std::size_t i = 0; i < dofs.size(); ++i) {
          const double at_dof = p(space.points().col(dofs[i]));
          value += N[i] * at_dof;
          gradient += dN.col(i) * at_dof;
        }
        value_error = std::max(value_error, std::abs(value - p(x)));
        gradient_error = std::max(gradient_error, (gradient - dp(x)).norm());
      }
    EXPECT_LT(value_error, 1e-14) << "degree " << degree;
    EXPECT_LT(gradient_error, 1e-11) << "degree " << degree;
  }
}

TEST(FineSpace, MidpointsAreSharedAndFacetsFindThem) {
  const auto mesh = testing::body("square").mesh;
  const FineSpace<2> space(mesh, 2);
  const Index edges = (3 * mesh.num_cells() + mesh.num_facets()) / 2;
  EXPECT_EQ(space.size(), mesh.num_vertices() + edges);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const auto dofs = space.facet(f);
    ASSERT_EQ(dofs.size(), 3u);
    const Vec<2> middle = 0.5 * (mesh.vertex(mesh.facets()(0, f)) + mesh.vertex(mesh.facets()(1, f)));
    EXPECT_LT((space.points().col(dofs[2]) - middle).norm(), 1e-15);
    const Vec<2> at = space.position(mesh.facet_cell(f), space.facet_point(f, {0.25, 0.75}));
    EXPECT_LT((at - 0.25 * mesh.vertex(mesh.facets()(0, f)) - 0.75 * mesh.vertex(mesh.facets()(1, f))).norm(), 1e-15);
  }
}

TEST(FineSpace, KnowsDegreesOneAndTwoOnly) {
  EXPECT_THROW(FineSpace<2>(testing::body("square").mesh, 3), InputError);
}

}  // namespace
}  // namespace efree
