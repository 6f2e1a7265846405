// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"

#include "efree/bench/elastic_block.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/io/records/dynamics_record.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/quadrature/approximation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numbers>

namespace efree {
namespace {

using bench::block;
using bench::frequency_error;
using bench::soft;
using testing::HasSubstr;
using testing::ThrowsMessage;

template <class T> class OtmBlock : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(OtmBlock, Dimensions);

TYPED_TEST(OtmBlock, AffineMotionsAreExactHoweverOftenPointsReconnect) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = deformable_body(block<Dim>(1.0, 0.3), soft(), 1.0);
  Dynamics<Dim> dynamics({body}, otm<Dim>({.reconnection_strain = 0.02}));
  Mat<Dim> rate = Mat<Dim>::Zero();
  rate(0, 0) = 0.8;
  rate(1, 0) = -0.4;
  rate(0, 1) = 0.7;
  rate(Dim - 1, Dim - 1) += -0.3;
  for (Index a = 0; a < dynamics.num_nodes(); ++a)
    for (int i = 0; i < Dim; ++i) dynamics.prescribe(a, i, rate.row(i).dot(body.nodes.col(a)));
  while (dynamics.time() < 1.0 - 1e-9) dynamics.step(0.01);
  EXPECT_GT(dynamics.count("reconnections"), 5 * dynamics.num_points());
  Mat<3> F = Mat<3>::Identity();
  F.template topLeftCorner<Dim, Dim>() += rate;
  const Tensors found = dynamics.deformation();
  double worst = 0.0;
  for (Index p = 0; p < dynamics.num_points(); ++p)
    worst = std::max(worst, (Eigen::Map<const Mat<3>>(found.col(p).data()) - F).norm());
  EXPECT_LT(worst, 1e-11);
  const Points<Dim> moved = (Mat<Dim>::Identity() + rate) * body.points;
  EXPECT_LT((dynamics.points() - moved).colwise().norm().maxCoeff(), 1e-11);
}

TYPED_TEST(OtmBlock, AtRestRoundingIsNoEnergyThatIsLost) {
  constexpr int Dim = TypeParam::value;
  Dynamics<Dim> dynamics({deformable_body(block<Dim>(1.0, 0.3), soft(), 1.0)}, otm<Dim>());
  for (int k = 0; k < 1100; ++k) dynamics.step();
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

TYPED_TEST(OtmBlock, ThrownAndSpinningBodiesKeepTheirMomentaToRounding) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = deformable_body(block<Dim>(2.0, 0.35), soft(), 1.0);
  body.velocity.setZero(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const auto x = body.nodes.col(a);
    body.velocity(0, a) = 0.2 - 0.5 * (x[1] - 0.5) + 0.25 * std::sin(3.0 * x[0]);
    body.velocity(1, a) = 0.1 + 0.5 * (x[0] - 1.0);
  }
  for (const double limit : {0.05, OtmOptions{}.reconnection_strain}) {
    Dynamics<Dim> dynamics({body}, otm<Dim>({.reconnection_strain = limit}));
    const auto before = dynamics.balance();
    dynamics.run(3.0);
    const auto after = dynamics.balance();
    EXPECT_GT(dynamics.count("reconnections"), limit < 0.1 ? dynamics.num_points() : 0);
    EXPECT_LT((after.momentum - before.momentum).norm(), 1e-13 * before.momentum.norm() * dynamics.steps());
    EXPECT_LT((after.momentum - before.momentum).norm(), 1e-12 * before.momentum.norm());
    EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-11 * before.angular_momentum.norm());
    // Momentum is transferred half a step off: the energy this takes is in proportion to the step and the
    // reconnections.
    EXPECT_NEAR(after.total(), before.total(), (limit < 0.1 ? 0.02 : 0.005) * before.total()) << limit;
  }
}

/// A block of metal that flies apart, spinning, to more than twice its length and breadth.
TYPED_TEST(OtmBlock, InsertedNodesAndPointsKeepMassMomentaAndEnergy) {
  constexpr int Dim = TypeParam::value;
  const double size = Dim == 2 ? 0.15 : 0.35;
  const J2 metal({.moduli = {.E = 100.0, .nu = 0.3}, .yield = 0.2, .strain = Strain::finite});
  DeformableBody<Dim> body = deformable_body(block<Dim>(1.0, size), metal, 1.0);
  body.velocity.setZero(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const auto x = body.nodes.col(a);
    body.velocity(0, a) = 0.2 + 1.5 * (x[0] - 0.5) - 0.5 * (x[1] - 0.5);
    body.velocity(1, a) = 0.1 - 0.5 * (x[1] - 0.5) + 0.5 * (x[0] - 0.5);
  }
  const OtmOptions options{.insertion = 1.5};
  Dynamics<Dim> dynamics({body}, otm<Dim>(options));
  const auto before = dynamics.balance();
  const double mass = dynamics.masses().sum();
  const Index num_nodes = dynamics.num_nodes(), num_points = dynamics.num_points();
  dynamics.run(0.6);
  const std::string state = dynamics.state();
  dynamics.run(1.2);
  EXPECT_GT(dynamics.count("inserted nodes"), 5);
  EXPECT_EQ(dynamics.num_nodes(), num_nodes + dynamics.count("inserted nodes"));
  EXPECT_GT(dynamics.num_points(), num_points);
  const auto after = dynamics.balance();
  EXPECT_NEAR(dynamics.masses().sum(), mass, 1e-13 * mass);
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-12 * before.momentum.norm());
  EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-11 * before.angular_momentum.norm());
  EXPECT_NEAR(after.total(), before.total(), 0.01 * before.total());
  EXPECT_LT(std::abs(after["reconnection"]), 0.1 * before["kinetic"]);  // three spacings wide
  Dynamics<Dim> other({body}, otm<Dim>(options));
  other.restore(state);
  other.run(1.2);
  EXPECT_EQ(other.nodes(), dynamics.nodes());
  EXPECT_EQ(other.cauchy_stress(), dynamics.cauchy_stress());
}

TYPED_TEST(OtmBlock, RotationCausesNoReconnection) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = deformable_body(block<Dim>(1.0, 0.3), soft(), 1.0);
  body.velocity.setZero(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    body.velocity(0, a) = -0.05 * (body.nodes(1, a) - 0.5);
    body.velocity(1, a) = 0.05 * (body.nodes(0, a) - 0.5);
  }
  Dynamics<Dim> dynamics({body}, otm<Dim>());
  dynamics.run(2.0 * std::numbers::pi / 0.05);
  EXPECT_EQ(dynamics.count("reconnections"), 0);
  // A full turn: back where it was, but for what centrifugal stretch does to the speed.
  EXPECT_LT((dynamics.nodes() - body.nodes).colwise().norm().maxCoeff(), 0.02);
}

TYPED_TEST(OtmBlock, ResultsAreBitwiseTheSameOnAnyNumberOfThreads) {
  constexpr int Dim = TypeParam::value;
  const auto result = [](int threads) {
    const int before = num_threads();
    set_num_threads(threads);
    DeformableBody<Dim> body = deformable_body(block<Dim>(2.0, Dim == 2 ? 0.1 : 0.3), soft(), 1.0);
    body.velocity = 0.6 * (body.nodes.array() - 0.5).matrix();
    Dynamics<Dim> dynamics({body}, otm<Dim>());
    dynamics.add_wall({.normal = Vec<Dim>::Unit(0), .level = -0.05, .friction = 0.3});
    dynamics.run(1.0);
    set_num_threads(before);
    EXPECT_GT(dynamics.count("reconnections"), 0);
    return std::pair(dynamics.nodes(), dynamics.cauchy_stress());
  };
  const auto one = result(1), three = result(3);
  EXPECT_EQ(one.first, three.first);
  EXPECT_EQ(one.second, three.second);
}

TYPED_TEST(OtmBlock, RunsThatGoOnFromAStateEndBitwiseWhereTheyWouldHave) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = deformable_body(block<Dim>(2.0, Dim == 2 ? 0.1 : 0.3), soft(), 1.0);
  body.velocity = 0.6 * (body.nodes.array() - 0.5).matrix();
  const auto made = [&](Index walls) {
    Dynamics<Dim> dynamics({body}, otm<Dim>(), {.shock = {.linear = 0.06, .quadratic = 1.5}});
    for (Index w = 0; w < walls; ++w) dynamics.add_wall({.normal = Vec<Dim>::Unit(0), .level = -0.05, .friction = 0.3});
    return dynamics;
  };
  Dynamics<Dim> straight = made(1), broken = made(1);
  straight.run(0.5);
  const std::string state = straight.state();
  straight.run(1.0);
  broken.restore(state);
  broken.run(1.0);
  EXPECT_GT(broken.count("reconnections"), 0);
  EXPECT_EQ(broken.nodes(), straight.nodes());
  EXPECT_EQ(broken.cauchy_stress(), straight.cauchy_stress());
  EXPECT_EQ(broken.balance().total(), straight.balance().total());
  Dynamics<Dim> other = made(0);
  EXPECT_THROW(other.restore(state), InputError);
  EXPECT_THROW(broken.restore(state.substr(0, state.size() / 2)), InputError);
}

/// Squares of that size, cut along one diagonal or the other in turn.
FineMesh<2> lattice(double length, double size) {
  const auto nx = static_cast<Index>(std::lround(length / size)), ny = static_cast<Index>(std::lround(1.0 / size));
  MeshData<2> mesh;
  mesh.vertices.resize(2, (nx + 1) * (ny + 1));
  for (Index j = 0; j <= ny; ++j)
    for (Index i = 0; i <= nx; ++i) mesh.vertices.col(i + j * (nx + 1)) << i * size, j * size;
  mesh.cells.resize(3, 2 * nx * ny);
  for (Index j = 0, c = 0; j < ny; ++j)
    for (Index i = 0; i < nx; ++i) {
      const Index a = i + j * (nx + 1), b = a + 1, d = a + nx + 1, e = d + 1;
      if ((i + j) % 2 == 0) {
        mesh.cells.col(c++) << a, b, d;
        mesh.cells.col(c++) << b, e, d;
      } else {
        mesh.cells.col(c++) << a, b, e;
        mesh.cells.col(c++) << a, e, d;
      }
    }
  return FineMesh<2>(std::move(mesh));
}

TEST(EnergyWatch, EnergyGainedByReconnectionIsAnErrorAndEnergyLostIsAccountedFor) {
  Ledger now;
  const auto change = [&now](double kinetic, double reconnection) {
    now.add_energy("kinetic", EnergyKind::kinetic, kinetic);
    now.add_energy("reconnection", EnergyKind::transfer, reconnection);
  };
  change(1.0, 0.0);
  EnergyWatch watch;
  watch.look(now);
  change(-0.5, 0.5);
  watch.look(now);
  EXPECT_DOUBLE_EQ(watch.error(), 0.0);
  change(39.5, -39.5);
  watch.look(now);
  EXPECT_DOUBLE_EQ(watch.error(), 39.0);
}

TEST(OtmBar, FrequencyOfABarConvergesWithOrderTwo) {
  const auto with = [](double size) {
    return frequency_error(deformable_body(lattice(4.0, size), soft(0.0), 1.0), 4.0);
  };
  const double coarse = with(0.25), fine = with(0.125);
  EXPECT_LT(std::abs(fine), 0.003);
  const double order = std::log2(std::abs(coarse / fine));
  EXPECT_GT(order, 1.8) << coarse << " " << fine;
  EXPECT_LT(order, 2.4) << coarse << " " << fine;
}

/// The error by the spacing is the same in steps of any length; leapfrog raises frequencies by (omega dt)^2 / 24.
TEST(OtmBar, FrequencyConvergesWithOrderTwoInTimeAsWell) {
  const DeformableBody<2> body = deformable_body(lattice(4.0, 0.25), soft(0.0), 1.0);
  const auto with = [&](double dt) { return frequency_error(body, 4.0, {}, {}, dt); };
  const double dt = 0.08, omega = std::numbers::pi / 4.0;
  ASSERT_GT(Dynamics<2>({body}, otm<2>()).stable_step(), dt);
  const double coarse = with(dt) - with(dt / 2.0), fine = with(dt / 2.0) - with(dt / 4.0);
  EXPECT_NEAR(std::log2(coarse / fine), 2.0, 0.1) << coarse << " " << fine;
  const double expected = omega * omega * dt * dt / 24.0 * (1.0 - 1.0 / 4.0);
  EXPECT_NEAR(coarse, expected, 0.05 * expected);
}

/// By default; without, it is of order one in the plane, and does not converge in space.
TEST(OtmBar, FrequencyConvergesWithOrderTwoOnCarelessTrianglesAsWell) {
  const auto with = [](double size, const OtmOptions& options = {}) {
    return frequency_error(deformable_body(block<2>(4.0, size), soft(0.0), 1.0), 4.0, options);
  };
  const double coarse = with(0.25), middle = with(0.125), fine = with(0.0625);
  EXPECT_LT(std::abs(middle), 0.001);
  for (const double ratio : {coarse / middle, middle / fine}) {
    EXPECT_GT(std::log2(ratio), 1.8) << coarse << " " << middle << " " << fine;
    EXPECT_LT(std::log2(ratio), 2.2) << coarse << " " << middle << " " << fine;
  }
  EXPECT_GT(std::abs(with(0.125, {.exact_integration = false})), 2.0 * std::abs(middle));
}

TEST(OtmBar, FrequencyConvergesWithOrderTwoOnCarelessTetrahedraAsWell) {
  const auto with = [](double size, const OtmOptions& options = {}) {
    return frequency_error(deformable_body(block<3>(4.0, size), soft(0.0), 1.0), 4.0, options);
  };
  const double coarse = with(0.5), fine = with(0.25);
  EXPECT_LT(std::abs(fine), 0.0015);
  const double order = std::log2(coarse / fine);
  EXPECT_GT(order, 1.6) << coarse << " " << fine;
  EXPECT_LT(order, 2.4) << coarse << " " << fine;
  EXPECT_GT(std::abs(with(0.5, {.exact_integration = false})), 2.5 * std::abs(coarse));
}

/// Linear momentum over the sum of |m v| at the start; angular momentum about the centre of mass over that of |d| |m
/// v|.
TEST(OtmLongRun, MomentaStayToRoundingForAHundredThousandSteps) {
  DeformableBody<2> body = deformable_body(block<2>(2.0, 0.3), soft(), 1.0);
  body.velocity.setZero(2, body.nodes.cols());
  const auto measured = [](const Dynamics<2>& dynamics) {
    const Points<2> v = dynamics.velocities(), &x = dynamics.nodes();
    const Vec<2> centre = x * dynamics.masses() / dynamics.masses().sum();
    Vec<2> linear = Vec<2>::Zero();
    std::array<double, 3> more{};  // angular momentum, and the scales of both
    for (Index a = 0; a < dynamics.num_nodes(); ++a) {
      const Vec<2> l = dynamics.masses()[a] * v.col(a), d = x.col(a) - centre;
      linear += l;
      more[0] += d[0] * l[1] - d[1] * l[0];
      more[1] += l.norm();
      more[2] += d.norm() * l.norm();
    }
    return std::pair(linear, more);
  };
  for (const double spin : {0.0, 0.1}) {
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      const auto x = body.nodes.col(a);
      body.velocity.col(a) = spin * Vec<2>(1.5 - x[1], x[0] - 0.5);
      body.velocity(0, a) += 0.02 * std::sin(2.0 * x[0]);
    }
    Dynamics<2> dynamics({body}, otm<2>());
    const auto [linear, more] = measured(dynamics);
    for (int k = 0; k < 100000; ++k) dynamics.step();
    const auto [linear_after, more_after] = measured(dynamics);
    EXPECT_LT((linear_after - linear).norm(), 1e-13 * more[1]) << spin;
    EXPECT_LT(std::abs(more_after[0] - more[0]), 1e-12 * more[2]) << spin;
  }
}

TEST(TotalLagrangianBar, VibratesOnShapeFunctionsOfTheStaticSolver) {
  const double length = 4.0;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, length, 1.0), {.size = 0.05});
  const auto with = [&](double spacing) {
    const Approximation<2> cloud = approximate(mesh, {.spacing = spacing});
    const DeformableBody<2> body{.nodes = cloud.nodes,
                                 .velocity = {},
                                 .points = cloud.quadrature.points,
                                 .volumes = cloud.quadrature.weights,
                                 .patches = cloud.patch_of,
                                 .material = soft(0.0),
                                 .density = 1.0,
                                 .shape = cloud.quadrature.shape};
    return frequency_error(body, length);
  };
  const double coarse = with(0.3), fine = with(0.15);
  EXPECT_LT(std::abs(fine), 0.005);
  const double order = std::log2(std::abs(coarse / fine));
  EXPECT_GT(order, 1.5) << coarse << " " << fine;
  EXPECT_LT(order, 3.0) << coarse << " " << fine;
}

TEST(OtmBar, EnergySwingsWithTheSquareOfTheStepAndStaysForTenThousands) {
  const auto swing = [](double courant, int steps) {
    DeformableBody<2> body = deformable_body(lattice(2.0, 0.25), soft(), 1.0);
    body.velocity.setZero(2, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a) body.velocity(0, a) = 0.02 * std::sin(2.0 * body.nodes(0, a));
    Dynamics<2> dynamics({body}, otm<2>(), {.courant = courant});
    const double before = dynamics.balance().total();
    double worst = 0.0;
    for (int k = 0; k < steps; ++k) {
      dynamics.step();
      worst = std::max(worst, std::abs(dynamics.balance().total() / before - 1.0));
    }
    EXPECT_EQ(dynamics.count("reconnections"), 0);
    return worst;
  };
  const double coarse = swing(0.5, 20000), fine = swing(0.25, 40000);
  EXPECT_LT(coarse, 3e-3);
  EXPECT_GT(coarse / fine, 2.5) << coarse << " " << fine;
  EXPECT_LT(coarse / fine, 8.0) << coarse << " " << fine;
}

TEST(OtmMomentumTransfer, OnlyTheAffineOneKeepsBothMomentaAndEnergy) {
  const auto run = [](MomentumTransfer momentum) {
    DeformableBody<2> body = deformable_body(
        block<2>(2.0, 0.15), J2({.moduli = {.E = 100.0, .nu = 0.3}, .yield = 0.2, .strain = Strain::finite}), 1.0);
    body.velocity.setZero(2, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      body.velocity(0, a) = body.nodes(0, a) < 1.0 ? 0.7 : -0.3;  // the two halves run into each other
      body.velocity(1, a) = 0.3 * (body.nodes(0, a) - 1.0);
    }
    Dynamics<2> dynamics({body}, otm<2>({.momentum = momentum}));
    const auto before = dynamics.balance();
    dynamics.run(0.8);
    const auto after = dynamics.balance();
    EXPECT_GT(dynamics.count("reconnections"), dynamics.num_points());
    return std::array{(after.momentum - before.momentum).norm() / before.momentum.norm(),
                      std::abs(after.angular_momentum[0] / before.angular_momentum[0] - 1.0),
                      after["reconnection"] / before["kinetic"]};
  };
  const auto affine = run(MomentumTransfer::affine), nodes = run(MomentumTransfer::nodes),
             points = run(MomentumTransfer::points);
  EXPECT_LT(affine[0], 1e-12);
  EXPECT_LT(affine[1], 1e-11);
  EXPECT_GT(nodes[0] + nodes[1], 1e-6);
  EXPECT_LT(points[0], 1e-12);
  EXPECT_GT(points[1], 1e-6);
  EXPECT_GT(points[2], affine[2]);
}

TEST(WallContact, FrictionHoldsWhatFrictionlessWallsLetGo) {
  const auto slid = [](double friction) {
    DeformableBody<2> body = deformable_body(block<2>(1.0, 0.3), soft(), 1.0);
    body.velocity.setZero(2, body.nodes.cols());
    body.velocity.row(0).setConstant(0.1);
    body.velocity.row(1).setConstant(-0.2);
    Dynamics<2> dynamics({body}, otm<2>());
    dynamics.add_wall({.normal = Vec<2>::Unit(1), .friction = friction});
    Vec<2> impulse = Vec<2>::Zero();
    const Vec<2> before = dynamics.balance().momentum;
    double last = 0.0;
    while (dynamics.time() < 1.5) {
      const double dt = dynamics.step();
      impulse -= 0.5 * (dt + last) * dynamics.wall_forces().col(0);
      last = dt;
    }
    EXPECT_LT((dynamics.balance().momentum - before - impulse).norm(), 1e-12);
    EXPECT_GE(dynamics.nodes().row(1).minCoeff(), -1e-12);
    return dynamics.balance().momentum[0] / before[0];
  };
  EXPECT_NEAR(slid(0.0), 1.0, 1e-12);
  EXPECT_LT(slid(0.2), 0.9);
  EXPECT_LT(slid(std::numeric_limits<double>::infinity()), slid(0.2));
}

/// Couette's flow: every node is moved as it is there, so stress is viscosity times rate from the first step on.
TEST(OtmFluid, ShearedBetweenPlatesHasTheStressOfItsViscosity) {
  constexpr double viscosity = 0.3, rate = 0.5;
  DeformableBody<2> body = deformable_body(
      block<2>(1.0, 0.25),
      Fluid({.state = EquationOfState::tait(10.0, 7.15), .viscosity = viscosity, .bulk_viscosity = 0.1}), 1.0);
  Dynamics<2> dynamics({body}, otm<2>());
  for (Index a = 0; a < dynamics.num_nodes(); ++a) {
    dynamics.prescribe(a, 0, rate * body.nodes(1, a));
    dynamics.prescribe(a, 1, 0.0);
  }
  dynamics.run(1.0);
  EXPECT_GT(dynamics.count("reconnections"), 0);
  const Tensors sigma = dynamics.cauchy_stress();
  for (Index p = 0; p < dynamics.num_points(); ++p) EXPECT_NEAR(sigma(3, p), viscosity * rate, 1e-3 * viscosity * rate);
}

TEST(Dynamics, MaterialsForSmallStrainsEndARunWithLargeOnes) {
  DeformableBody<2> body = deformable_body(block<2>(1.0, 0.3), LinearElastic(ElasticModuli{.E = 1.0, .nu = 0.3}), 1.0);
  body.velocity = -0.3 * body.nodes;
  Dynamics<2> dynamics({body}, otm<2>());
  dynamics.add_wall({.normal = Vec<2>::Unit(1)});
  EXPECT_THAT([&] { dynamics.run(3.0); }, ThrowsMessage<NumericalError>(HasSubstr("for small strains")));
}

TEST(DynamicsRecord, FramesAndHistoryAreThoseOfTheRun) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "dynamics_record";
  std::filesystem::remove_all(folder);
  DeformableBody<2> body = deformable_body(block<2>(1.0, 0.3), soft(), 1.0);
  body.velocity = -0.1 * body.nodes;
  Dynamics<2> dynamics({body}, otm<2>());
  dynamics.add_wall({.normal = Vec<2>::Unit(1)});
  for (int run = 0; run < 2; ++run) {  // the second takes the first one's place
    DynamicsRecord<2> record(folder);
    for (int k = 0; k < 3 - run; ++k) {
      dynamics.run(dynamics.time() + 0.3);
      record.add(dynamics);
    }
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "points_0001.vtu"));
  EXPECT_FALSE(std::filesystem::exists(folder / "points_0002.vtu"));
  std::ifstream file(folder / "history.csv");
  std::string header, line, last;
  std::getline(file, header);
  int lines = 0;
  for (; std::getline(file, line); ++lines) last = line;
  EXPECT_EQ(lines, 2);
  EXPECT_THAT(header, testing::AllOf(testing::StartsWith("t,steps,dt,"), HasSubstr(",kinetic,")));
  EXPECT_EQ(std::count(header.begin(), header.end(), ','), std::count(last.begin(), last.end(), ','));
  EXPECT_EQ(std::stod(last), dynamics.time());
  std::ifstream series(folder / "points.pvd");
  const std::string text(std::istreambuf_iterator<char>(series), {});
  EXPECT_THAT(text, testing::HasSubstr("points_0001.vtu"));
  EXPECT_THROW(DynamicsRecord<2>("/proc/nothing/here"), InputError);
}

/// Parts of a run may begin to count something late; and a record goes on from its state.
TEST(DynamicsRecord, NewColumnsOfTheHistoryAreZeroInEarlierLines) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "dynamics_columns";
  const Dynamics<2> dynamics({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  DynamicsRecord<2> first(folder);
  first.add_line(dynamics);
  first.add_line(dynamics, {{"late", 2.0}});
  const std::string state = first.state();
  first.add_line(dynamics, {{"later", 3.0}});
  DynamicsRecord<2> second(folder, state);
  second.add_line(dynamics, {{"late", 4.0}});
  std::ifstream file(folder / "history.csv");
  std::vector<std::string> ends;
  for (std::string line; std::getline(file, line);) ends.push_back(line.substr(line.rfind(',') + 1));
  EXPECT_THAT(ends, testing::ElementsAre("late", "0", "2", "4"));
}

TEST(Dynamics, RefusesInvalidBodiesAndOptions) {
  const DeformableBody<2> good = deformable_body(block<2>(1.0, 0.5), soft(), 1.0);
  const auto with = [&](const auto& change) {
    return [&good, change] {
      DeformableBody<2> body = good;
      change(body);
      Dynamics<2> dynamics({body}, otm<2>());
    };
  };
  EXPECT_THAT(with([](auto& b) { b.density = 0.0; }), ThrowsMessage<InputError>(HasSubstr("density 0")));
  EXPECT_THAT(with([](auto& b) { b.volumes[0] = -1.0; }), ThrowsMessage<InputError>(HasSubstr("positive volume")));
  EXPECT_THAT(with([](auto& b) { b.nodes(0, 0) = NAN; }), ThrowsMessage<InputError>(HasSubstr("no numbers")));
  EXPECT_THAT(with([](auto& b) { b.material = {}; }), ThrowsMessage<InputError>(HasSubstr("no material")));
  EXPECT_THAT(with([](auto& b) { b.points.col(0) << 9.0, 9.0; }), ThrowsMessage<NumericalError>(HasSubstr("outside")));
  EXPECT_THAT(with([](auto& b) { b.patches.resize(1); }),
              ThrowsMessage<InputError>(HasSubstr("patch for every point")));
  EXPECT_THROW(Dynamics<2>({}, otm<2>()), InputError);
  EXPECT_THROW(Dynamics<2>({good}, otm<2>({.reconnection_strain = -1.0})), InputError);
  EXPECT_THROW(Dynamics<2>({good}, otm<2>(), {.plane = Plane::stress}), InputError);
  Dynamics<2> dynamics({good}, otm<2>());
  EXPECT_THROW(dynamics.prescribe(100000, 0, 1.0), InputError);
  EXPECT_THROW(dynamics.add_wall({.normal = {1.0, 1.0}}), InputError);
}

/// The nodes near a point in a cell as good as without volume may lie on one side of it: its gradients were without
/// bounds, and the step of the first of these meshes 5e-8.
TEST(Otm, FlatCellsDoNotDecideTheStableStep) {
  for (const double size : {0.25, 0.2, 0.15}) {
    const FineMesh<3> mesh(solids::thick_sphere(0.75, 1.0, size).mesh);
    const Dynamics<3> dynamics({deformable_body(mesh, soft(), 1.0)}, otm<3>());
    const double speed = std::sqrt(dynamics.world().bodies[0].modulus);  // of waves, with a density of one
    EXPECT_GT(dynamics.stable_step() * speed, 0.1 * size) << size;
    EXPECT_LT(dynamics.stable_step() * speed, 0.5 * size) << size;
  }
}

/// Shape functions that stay cannot follow.
TEST(TotalLagrangian, RunsThatInvertAPointStopAndReportWhere) {
  DeformableBody<2> body =
      deformable_body(approximate(block<2>(1.0, 0.1), {.spacing = 0.3, .support = dynamics_support}), soft(), 1.0);
  Dynamics<2> dynamics({body}, total_lagrangian<2>());
  for (Index a = 0; a < dynamics.num_nodes(); ++a)
    if (body.nodes(0, a) > 0.7) dynamics.prescribe(a, 0, -50.0);
  EXPECT_THAT([&] { dynamics.run(1.0); }, ThrowsMessage<NumericalError>(HasSubstr("at time")));
}

}  // namespace
}  // namespace efree
