// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/lme.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace efree {
namespace {

/// Nodes of a lattice of the unit cube, those inside moved by up to a third of the spacing, then turned: no face of the
/// hull is along an axis.
template <int Dim> struct Cloud {
  LmeNodes<Dim> nodes;
  Mat<Dim> turn;
  static constexpr int cells = Dim == 2 ? 12 : 6;

  explicit Cloud(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> shift(-0.3, 0.3);
    turn = Mat<Dim>::Identity();
    const double c = std::cos(0.7), s = std::sin(0.7);
    turn.template topLeftCorner<2, 2>() << c, -s, s, c;
    if constexpr (Dim == 3) {
      Mat<3> other = Mat<3>::Identity();
      other.template bottomRightCorner<2, 2>() << c, -s, s, c;
      turn = other * turn;
    }
    std::vector<Vec<Dim>> at;
    const int layers = Dim == 3 ? cells : 0;
    for (int k = 0; k <= layers; ++k)
      for (int j = 0; j <= cells; ++j)
        for (int i = 0; i <= cells; ++i) {
          const int place[3] = {i, j, k};
          Vec<Dim> x;
          for (int d = 0; d < Dim; ++d)
            x[d] = (place[d] + (place[d] > 0 && place[d] < cells ? shift(random) : 0.0)) / cells;
          at.push_back(turn * x);
        }
    nodes.positions.resize(Dim, static_cast<Index>(at.size()));
    for (std::size_t a = 0; a < at.size(); ++a) nodes.positions.col(static_cast<Index>(a)) = at[a];
    nodes.spacing = Vector::Constant(nodes.positions.cols(), 1.0 / cells);
  }

  /// Points of the cube; of every eight, seven lie near a face, edge or vertex, down to 1e-12 from it, or on it.
  Points<Dim> points(Index n, unsigned seed) const {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> any(0.0, 1.0);
    Points<Dim> x(Dim, n);
    for (Index p = 0; p < n; ++p) {
      Vec<Dim> y;
      for (int d = 0; d < Dim; ++d) {
        y[d] = any(random);
        if (random() % 2 == 0) y[d] = random() % 8 == 0 ? 0.0 : std::pow(10.0, -12.0 * any(random));
        if (random() % 2 == 0) y[d] = 1.0 - y[d];
      }
      x.col(p) = turn * y;
    }
    return x;
  }
};

template <class T> class LmeTable : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(LmeTable, Dimensions);

TYPED_TEST(LmeTable, ReproducesLinearFunctionsAndTheirGradientsUpToTheHullsBoundary) {
  constexpr int Dim = TypeParam::value;
  const Cloud<Dim> cloud(1);
  for (const double gamma : {0.6, 1.8, 4.0, 6.0}) {
    const Index n = 25000;
    const Points<Dim> points = cloud.points(n, 2);
    const auto table = lme(cloud.nodes, points, {.gamma = gamma});
    double unity = 0.0, linear = 0.0, no_gradient = 0.0, gradient = 0.0, negative = 0.0;
    for (Index p = 0; p < n; ++p) {
      const auto row = table.row(p);
      double sum = 0.0;
      Vec<Dim> x = Vec<Dim>::Zero(), of_one = x;
      Mat<Dim> of_x = Mat<Dim>::Zero();
      for (std::size_t k = 0; k < row.nodes.size(); ++k) {
        const Vec<Dim> at = cloud.nodes.positions.col(row.nodes[k]);
        sum += row.N[k];
        x += row.N[k] * at;
        of_one += row.dN[k];
        of_x += at * row.dN[k].transpose();
        negative = std::min(negative, row.N[k]);
      }
      const double h = cloud.nodes.spacing[0];
      unity = std::max(unity, std::abs(sum - 1.0));
      linear = std::max(linear, (x - points.col(p)).norm());
      no_gradient = std::max(no_gradient, h * of_one.norm());
      gradient = std::max(gradient, (of_x - Mat<Dim>::Identity()).norm());
    }
    EXPECT_LT(unity, 1e-11) << gamma;
    EXPECT_LT(linear, 1e-11) << gamma;
    EXPECT_LT(no_gradient, 1e-11) << gamma;
    EXPECT_LT(gradient, 1e-11) << gamma;
    EXPECT_GT(negative, -1e-11) << gamma;
  }
}

TYPED_TEST(LmeTable, GradientsAreThoseOfTheFunctions) {
  constexpr int Dim = TypeParam::value;
  const Cloud<Dim> cloud(3);
  const Vec<Dim> x = cloud.turn * Vec<Dim>::Constant(0.4137);
  const double step = 1e-5;
  // Wide enough that no node comes or goes with the step.
  const LmeOptions options{.gamma = 1.8, .cutoff = 1e-12, .tolerance = 1e-8};
  const auto row = lme(cloud.nodes, Points<Dim>(x), options);
  Vector N(cloud.nodes.positions.cols());
  for (int i = 0; i < Dim; ++i) {
    Vector difference = Vector::Zero(N.size());
    for (const double sign : {1.0, -1.0}) {
      const auto there = lme(cloud.nodes, Points<Dim>(x + sign * step * Vec<Dim>::Unit(i)), options);
      for (std::size_t k = 0; k < there.row(0).nodes.size(); ++k)
        difference[there.row(0).nodes[k]] += sign * there.row(0).N[k] / (2.0 * step);
    }
    for (std::size_t k = 0; k < row.row(0).nodes.size(); ++k)
      EXPECT_NEAR(row.row(0).dN[k][i], difference[row.row(0).nodes[k]], 1e-6 / cloud.nodes.spacing[0]);
  }
}

TYPED_TEST(LmeTable, FunctionsOfAFaceAreThoseOfItsNodes) {
  constexpr int Dim = TypeParam::value;
  const Cloud<Dim> cloud(4);
  Vec<Dim> y = Vec<Dim>::Constant(0.37);
  y[0] = 1.0;
  const auto table = lme(cloud.nodes, Points<Dim>(cloud.turn * y));
  double others = 0.0, on = 0.0;
  for (std::size_t k = 0; k < table.row(0).nodes.size(); ++k) {
    const Vec<Dim> back = cloud.turn.transpose() * cloud.nodes.positions.col(table.row(0).nodes[k]);
    (back[0] > 1.0 - 1e-9 ? on : others) += table.row(0).N[k];
  }
  EXPECT_NEAR(on, 1.0, 1e-10);
  EXPECT_NEAR(others, 0.0, 1e-10);
}

TYPED_TEST(LmeTable, EveryPointOutsideIsFoundOut) {
  constexpr int Dim = TypeParam::value;
  const Cloud<Dim> cloud(5);
  const double h = cloud.nodes.spacing[0];
  std::mt19937 random(6);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  for (int trial = 0; trial < 2000; ++trial) {
    Vec<Dim> y;
    for (int d = 0; d < Dim; ++d) y[d] = any(random);
    y[random() % Dim] = 1.0 + h * std::pow(10.0, -5.0 * any(random));
    const Vec<Dim> x = cloud.turn * y;
    for (const double gamma : {0.6, 1.8, 6.0}) {
      LmeFunctions<Dim> functions({.gamma = gamma});
      for (Index a = 0; a < cloud.nodes.positions.cols(); ++a)
        if (const Vec<Dim> d = cloud.nodes.positions.col(a) - x; d.norm() < 3.0 * h) functions.add(d);
      Vec<Dim> lambda = Vec<Dim>::Zero();
      ASSERT_EQ(functions.find(gamma / (h * h) * Mat<Dim>::Identity(), lambda), LmeStatus::outside)
          << y.transpose() << " after " << functions.iterations();
    }
  }
  EXPECT_THAT([&] { lme(cloud.nodes, Points<Dim>(cloud.turn * Vec<Dim>::Constant(1.2))); },
              testing::ThrowsMessage<NumericalError>(testing::HasSubstr("outside their hull")));
}

TYPED_TEST(LmeTable, NoPointInsideFailsFromAnyStart) {
  constexpr int Dim = TypeParam::value;
  const Cloud<Dim> cloud(7);
  const double h = cloud.nodes.spacing[0];
  const Points<Dim> points = cloud.points(2000, 8);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> any(-20.0, 20.0);
  for (Index p = 0; p < points.cols(); ++p) {
    LmeFunctions<Dim> functions;
    for (Index a = 0; a < cloud.nodes.positions.cols(); ++a)
      if (const Vec<Dim> d = cloud.nodes.positions.col(a) - points.col(p); d.norm() < 2.8 * h) functions.add(d);
    Vec<Dim> lambda;
    for (int d = 0; d < Dim; ++d) lambda[d] = any(random) / h;
    ASSERT_EQ(functions.find(1.8 / (h * h) * Mat<Dim>::Identity(), lambda), LmeStatus::found) << p;
  }
}

TEST(Lme, TablesAreTheSameOnAnyNumberOfThreads) {
  const Cloud<3> cloud(1);
  const Points<3> points = cloud.points(3000, 2);
  const int before = num_threads();
  set_num_threads(1);
  const auto one = lme(cloud.nodes, points);
  set_num_threads(3);
  const auto three = lme(cloud.nodes, points);
  set_num_threads(before);
  for (Index p = 0; p < one.num_points(); ++p)
    for (std::size_t k = 0; k < one.row(p).nodes.size(); ++k) {
      ASSERT_EQ(one.row(p).N[k], three.row(p).N[k]);
      ASSERT_EQ(one.row(p).dN[k], three.row(p).dN[k]);
    }
}

TEST(Lme, RefusesWhatIsNoLocality) {
  EXPECT_THAT([] { LmeFunctions<2>({.gamma = -1.0}); },
              testing::ThrowsMessage<InputError>(testing::HasSubstr("gamma -1")));
  EXPECT_THAT([] { LmeFunctions<2>({.cutoff = 2.0}); },
              testing::ThrowsMessage<InputError>(testing::HasSubstr("cutoff 2")));
  EXPECT_THROW(lme(LmeNodes<2>{Points<2>::Random(2, 3), Vector::Zero(3)}, Points<2>(Points<2>::Zero(2, 1))),
               InputError);
}

}  // namespace
}  // namespace efree
