// SPDX-License-Identifier: GPL-3.0-or-later
/// The material point method: splines, transfers, contact, walls, and the same splines in the reference configuration.
#include "efree/bench/mpm_scenes.hpp"
#include "efree/bench/taylor_bar.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/quadrature/lattice.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <array>
#include <cmath>
#include <limits>

namespace efree {
namespace {

using bench::block;
using bench::soft;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr std::array all_transfers{Transfer::pic,   Transfer::flip,    Transfer::apic, Transfer::rpic,
                                   Transfer::aflip, Transfer::polypic, Transfer::xpic};

constexpr std::array new_grids{MpmFrame::updated, MpmFrame::mesh};

template <class T> class MaterialPointMethod : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(MaterialPointMethod, Dimensions);

template <int Degree> double largest_spline_error() {
  double worst = 0.0;
  for (int k = 0; k <= 1000; ++k) {
    const double position = -2.0 + 4e-3 * k;
    internal::SplineRow<Degree> row;
    internal::evaluate_spline<Degree>(position, row);
    double sum = -1.0, first = -position, slope = 0.0, linear = -1.0, second = 0.0;
    for (int i = 0; i <= Degree; ++i) {
      EXPECT_GE(row.N[i], 0.0);
      const double at = static_cast<double>(row.first) + i;
      sum += row.N[i];
      first += row.N[i] * at;
      slope += row.dN[i];
      linear += row.dN[i] * at;
      second += row.N[i] * row.d[i] * row.d[i];
    }
    if (Degree > 1) worst = std::max(worst, std::abs(second - internal::spline_moment(Degree)));
    for (const double error : {sum, first, slope, linear}) worst = std::max(worst, std::abs(error));
  }
  return worst;
}

TEST(Splines, ReproduceLinearFunctionsEverywhere) {
  EXPECT_LT(largest_spline_error<1>(), 1e-14);
  EXPECT_LT(largest_spline_error<2>(), 1e-14);
  EXPECT_LT(largest_spline_error<3>(), 1e-14);
}

TYPED_TEST(MaterialPointMethod, ALatticeCutsABodyIntoPiecesOfItsVolumeAndCentroid) {
  constexpr int Dim = TypeParam::value;
  const FineMesh<Dim> mesh = bench::TaylorBar::mesh<Dim>(1e-3);
  const auto pieces = cut_by_lattice<Dim>(mesh, Vec<Dim>::Constant(1e-4), 0.45e-3);
  double volume = 0.0;
  Vec<Dim> moment = Vec<Dim>::Zero();
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    Mat<Dim> edges;
    Vec<Dim> centroid = mesh.vertices().col(mesh.cells()(0, c)) / (Dim + 1);
    for (int i = 0; i < Dim; ++i) {
      edges.col(i) = mesh.vertices().col(mesh.cells()(i + 1, c)) - mesh.vertices().col(mesh.cells()(0, c));
      centroid += mesh.vertices().col(mesh.cells()(i + 1, c)) / (Dim + 1);
    }
    const double of_cell = std::abs(edges.determinant()) / (Dim == 2 ? 2.0 : 6.0);
    volume += of_cell;
    moment += of_cell * centroid;
  }
  EXPECT_NEAR(pieces.volumes.sum(), volume, 1e-12 * volume);
  EXPECT_LT((pieces.centroids * pieces.volumes - moment).norm(), 1e-12 * moment.norm());
  EXPECT_LE(pieces.volumes.maxCoeff(), 2.0 * std::pow(0.45e-3, Dim));
  EXPECT_GT(pieces.volumes.minCoeff(), 0.05 * std::pow(0.45e-3, Dim));
}

TYPED_TEST(MaterialPointMethod, EveryTransferKeepsMomentumToRoundingAndAffineOnesAngularMomentum) {
  constexpr int Dim = TypeParam::value;
  for (const Transfer transfer : all_transfers)
    for (const int degree : {2, 3})
      for (const MpmFrame frame : new_grids) {
        const auto [linear, angular] = bench::lost_momenta<Dim>({.cell = 0.25, .degree = degree, .transfer = transfer},
                                                                Dim == 2 ? 2000 : 300, frame);
        const auto which = testing::Message() << static_cast<int>(transfer) << degree << static_cast<int>(frame);
        EXPECT_LT(linear, 1e-14) << which;
        if (transfer == Transfer::apic || transfer == Transfer::rpic || transfer == Transfer::polypic) {
          EXPECT_LT(angular, 1e-13) << which;
        }
      }
}

TYPED_TEST(MaterialPointMethod, EnergyThatTransfersLoseIsCounted) {
  constexpr int Dim = TypeParam::value;
  using enum MpmFrame;
  for (const Transfer transfer : all_transfers)
    for (const auto& [frame, remap] : {std::pair(updated, false), std::pair(updated, true), std::pair(mesh, false)}) {
      if (remap && transfer == Transfer::polypic) continue;  // refused
      const MpmOptions options{.cell = 0.25, .transfer = transfer, .remap = remap};
      DeformableBody<Dim> body = bench::soft_block<Dim>(options, frame);
      body.velocity = bench::velocity_by_place<Dim>(
          body, [](const Vec<Dim>& x) { return Vec<Dim>(0.05 * std::cos(3.0 * x[0]) * Vec<Dim>::Unit(0)); });
      // Short steps: what is left is what the integration in time makes.
      Dynamics<Dim> dynamics({body}, mpm<Dim>(options), {.courant = 0.2});
      const double start = dynamics.balance().total();
      dynamics.run(10.0);
      EXPECT_NEAR(dynamics.balance().total(), start, 0.01 * start) << static_cast<int>(transfer) << remap;
      // FLIP gives back what points have kept, and remapped strains are not those of the nodes' motion: both may gain.
      const bool may_gain = remap || transfer == Transfer::flip || transfer == Transfer::aflip;
      EXPECT_GE(dynamics.balance()["transfer"], may_gain ? -start : -0.01 * start)
          << static_cast<int>(transfer) << remap;
    }
}

TEST(MaterialPointMethod2, ABarVibratesAtItsFrequencyWithErrorsOfSecondOrder) {
  const auto vibrate = [](double cell) { return bench::vibrate({.cell = cell, .transfer = Transfer::apic}); };
  const bench::Vibration coarse = vibrate(1.0 / 16), fine = vibrate(1.0 / 32);
  EXPECT_LT(std::abs(fine.frequency_error), 0.002);
  EXPECT_THAT(std::log2(coarse.frequency_error / fine.frequency_error),
              testing::AllOf(testing::Gt(1.8), testing::Lt(2.3)));
  EXPECT_LE(fine.gained, 1e-4);
  EXPECT_GT(coarse.lost, 3.0 * fine.lost);
}

TEST(MaterialPointMethod2, CellsThatPointsCrossLeaveNoTraceButWithLinearSplines) {
  const auto stress_ratio = [](int degree) {
    const MpmOptions options{.cell = 1.0 / 16, .degree = degree, .transfer = Transfer::flip, .flip = 1.0};
    return bench::vibrate(options, 40.0).stress / bench::vibrate(options).stress;
  };
  EXPECT_NEAR(stress_ratio(2), 1.0, 0.005);
  EXPECT_NEAR(stress_ratio(3), 1.0, 0.005);
  EXPECT_GT(std::abs(stress_ratio(1) - 1.0), 0.01);
}

TEST(MaterialPointMethod2, VelocitiesThatTheGridDoesNotSeeAreGoneAfterAStepButWithFlip) {
  for (const Transfer transfer : all_transfers) {
    const bool keeps = transfer == Transfer::flip || transfer == Transfer::aflip;
    EXPECT_NEAR(bench::noise_left(transfer), keeps ? 1.0 : 0.0, keeps ? 1e-3 : 1e-12) << static_cast<int>(transfer);
  }
}

TEST(MaterialPointMethod2, ABlockSlidesDownASlopeAsCoulombSays) {
  const double friction = std::tan(15.0 * std::numbers::pi / 180.0);
  EXPECT_NEAR(bench::sliding_travel(24.0, friction, {.cell = 0.125}), 1.0, 0.01);
}

TEST(MaterialPointMethod2, DiscsFeelEachOtherWhenTheirPointsMeetAndNoMoreOnceTheyAreApart) {
  const bench::Bounce bounce = bench::bounce_discs({.cell = 0.05});
  EXPECT_LT(std::abs(bounce.gap_at_first_force), 0.5);
  EXPECT_LT(bounce.force_after, 1e-12);
  EXPECT_LT(bounce.momentum_error, 1e-13);
  EXPECT_GT(bounce.restitution, 0.5);
  EXPECT_LT(bounce.restitution, 1.0);
}

/// Order of the error in a vortex until then, by 6 and 12 cells across.
double vortex_order(MpmFrame frame, double until) {
  return std::log2(bench::vortex_error({.cell = 0.5 / 6}, frame, until) /
                   bench::vortex_error({.cell = 0.5 / 12}, frame, until));
}

TEST(MaterialPointMethod2, SplinesOfTheReferenceConfigurationFollowAVortexWithErrorsOfSecondOrderAndMeshesNearly) {
  const double total = vortex_order(MpmFrame::total, 0.2), mesh = vortex_order(MpmFrame::mesh, 0.1);
  EXPECT_GT(total, 1.8);
  EXPECT_LT(total, 2.6);
  EXPECT_GT(mesh, 1.5);
  EXPECT_LT(mesh, 2.0);
}

template <int Dim> void expect_no_point_passes_a_wall_or_a_rigid_body(MpmFrame frame) {
  const MpmOptions options{.cell = 0.25};
  DeformableBody<Dim> body = bench::soft_block<Dim>(options, frame);
  body.velocity =
      bench::velocity_by_place<Dim>(body, [](const Vec<Dim>&) { return Vec<Dim>(-0.1 * Vec<Dim>::Unit(0)); });
  Dynamics<Dim> dynamics({body}, mpm<Dim>(options));
  dynamics.add_wall({.normal = Vec<Dim>::Unit(0), .level = -0.2});
  Vec<Dim> centre = Vec<Dim>::Constant(0.5);
  centre[0] = 2.5;
  dynamics.add_rigid_body({.shape = rigid_shapes::ball<Dim>(centre, 0.5),
                           .velocity = [](double) { return Vec<Dim>(-0.3 * Vec<Dim>::Unit(0)); },
                           .centre = centre,
                           .mass = 0.5});
  const auto start = dynamics.balance();
  Vec<Dim> of_wall = Vec<Dim>::Zero();
  double lowest = 1.0;
  while (dynamics.time() < 8.0) {
    const double before = dynamics.world().last_step, dt = dynamics.step();
    of_wall -= 0.5 * (before + dt) * dynamics.wall_forces().col(0);
    lowest = std::min(lowest, dynamics.points().row(0).minCoeff());
  }
  const auto now = dynamics.balance();
  EXPECT_GT(of_wall[0], 0.1);
  EXPECT_LT((now.momentum - start.momentum - of_wall).norm(), 1e-12);
  EXPECT_GT(lowest, -0.2);
  EXPECT_NEAR(now.total(), start.total(), 0.01 * start.total());
  EXPECT_GT(dynamics.rigid_bodies()[0].velocity[0], -0.3);
}

TYPED_TEST(MaterialPointMethod, NoPointPassesAWallOrARigidBodyWhoseMomentumIsThatOfTheBody) {
  for (const MpmFrame frame : new_grids) expect_no_point_passes_a_wall_or_a_rigid_body<TypeParam::value>(frame);
}

TEST(MaterialPointMethod2, ABlockThatFallsFlatStaysAsSymmetricAsItWas) {
  for (const Index points : {1, 2, 3}) {
    const MpmOptions options{.cell = 0.125};
    DeformableBody<2> body = points_on_lattice<2>(block<2>(2.0, 0.25), options, points, soft(), 1.0);
    body.velocity = bench::velocity_by_place<2>(body, [](const Vec<2>&) { return Vec<2>(0.0, -0.1); });
    Dynamics<2> dynamics({body}, mpm<2>(options));
    dynamics.add_wall({.normal = Vec<2>::UnitY(), .level = -0.07});
    dynamics.run(3.0);
    const Points<2> x = dynamics.points();
    // The mirror image of every point is one, and where that has gone.
    for (Index p = 0; p < x.cols(); ++p) {
      const Vec<2> image(2.0 - body.points(0, p), body.points(1, p));
      Index q = 0;
      (body.points.colwise() - image).colwise().norm().minCoeff(&q);
      EXPECT_NEAR(x(0, p) + x(0, q), 2.0, 1e-3) << points;
      EXPECT_NEAR(x(1, p), x(1, q), 1e-3) << points;
    }
    EXPECT_GT(dynamics.balance()["contact"], 0.0);
  }
}

TEST(MaterialPointMethod2, AHeavyBodyIsStoppedByPointsThatAreHeld) {
  const MpmOptions options{.cell = 0.125};
  DeformableBody<2> body = points_on_lattice<2>(block<2>(2.0, 0.25), options, 2, soft(), 1.0);
  Dynamics<2> dynamics({body}, mpm<2>(options));
  std::vector<Index> all(body.points.cols());
  for (Index p = 0; p < body.points.cols(); ++p) all[p] = p;
  for (const int axis : {0, 1}) dynamics.prescribe_points(all, axis, Vector::Zero(std::ssize(all)));
  const Vec<2> centre(1.0, 1.6);
  dynamics.add_rigid_body({.shape = rigid_shapes::ball<2>(centre, 0.5),
                           .velocity = [](double) { return Vec<2>(0.0, -0.2); },
                           .centre = centre,
                           .mass = 50.0});
  dynamics.run(2.0);
  EXPECT_NEAR(dynamics.rigid_bodies()[0].velocity[1], 0.0, 1e-3);
  EXPECT_NEAR(dynamics.balance()["contact"], 1.0, 0.01);
  EXPECT_NEAR(dynamics.energy().error(), 0.0, 1e-6);
}

template <int Dim> void expect_pieces_fly_on_however_far_apart(MpmFrame frame) {
  const MpmOptions options{.cell = 0.25};
  DeformableBody<Dim> body = bench::soft_block<Dim>(options, frame);
  body.velocity = bench::velocity_by_place<Dim>(
      body, [](const Vec<Dim>& x) { return Vec<Dim>(4.0 * (x - Vec<Dim>::Constant(0.4))); });
  body.fracture.stretch = 1.5;
  const int threads = num_threads();
  const auto run = [&](int count, double restart) {
    set_num_threads(count);
    Dynamics<Dim> dynamics({body}, mpm<Dim>(options));
    const Vec<Dim> momentum = dynamics.balance().momentum;
    if (restart > 0.0) {
      Dynamics<Dim> first({body}, mpm<Dim>(options));
      first.run(restart);
      dynamics.restore(first.state());
    }
    dynamics.run(2.0);
    dynamics.run(20.0);
    EXPECT_LT((dynamics.balance().momentum - momentum).norm(), 1e-12 * momentum.norm());
    set_num_threads(threads);
    return dynamics;
  };
  Dynamics<Dim> one = run(1, 0.0);
  const Dynamics<Dim> two = run(2, 2.0);
  EXPECT_GT(one.world().chunks.size(), 2U);
  EXPECT_EQ(one.num_points(), body.points.cols());
  // About 150 cells wide along every axis.
  EXPECT_GT((one.points().rowwise().maxCoeff() - one.points().rowwise().minCoeff()).minCoeff(), 35.0);
  EXPECT_EQ(one.points(), two.points());
  EXPECT_EQ(one.point_velocities(), two.point_velocities());
  // Back to a state with fewer chunks.
  Dynamics<Dim> first({body}, mpm<Dim>(options));
  first.run(0.5);
  one.restore(first.state());
  one.run(1.0);
  first.run(1.0);
  EXPECT_EQ(one.points(), first.points());
}

TYPED_TEST(MaterialPointMethod, PiecesOfABodyFlyOnHoweverFarApart) {
  for (const MpmFrame frame : new_grids) expect_pieces_fly_on_however_far_apart<TypeParam::value>(frame);
}

TYPED_TEST(MaterialPointMethod, StepsNearlyAsLongAsTheEstimateSaysAreStableWhereverTheGridIs) {
  constexpr int Dim = TypeParam::value;
  for (const auto& [degree, frame] : {std::pair(2, MpmFrame::updated), std::pair(3, MpmFrame::updated),
                                      std::pair(1, MpmFrame::mesh), std::pair(2, MpmFrame::mesh)}) {
    const MpmOptions options{.cell = 0.25, .degree = degree};
    DeformableBody<Dim> body = bench::soft_block<Dim>(options, frame);
    body.velocity = bench::velocity_by_place<Dim>(body, [](const Vec<Dim>& x) {
      return Vec<Dim>(0.2 * Vec<Dim>::Unit(1) + 0.05 * std::cos(3.0 * x[0]) * Vec<Dim>::Unit(0));
    });
    Dynamics<Dim> dynamics({body}, mpm<Dim>(options), {.courant = 0.9, .imbalance = 10.0});
    dynamics.run(30.0);  // across 24 cells
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.02) << degree;
    EXPECT_GT(dynamics.steps(), 60) << degree;
  }
}

template <int Dim> void expect_the_same_results_on_any_number_of_threads_and_resumed(MpmFrame frame) {
  const MpmOptions options{.cell = 0.125};
  DeformableBody<Dim> body = bench::soft_block<Dim>(options), other = bench::soft_block<Dim>(options, frame);
  body.velocity =
      bench::velocity_by_place<Dim>(body, [](const Vec<Dim>&) { return Vec<Dim>(0.2 * Vec<Dim>::Unit(0)); });
  other.points.row(0).array() += 1.05;
  other.nodes.row(0).array() += 1.05;
  const auto make = [&] {
    Dynamics<Dim> dynamics({body, other}, mpm<Dim>(options));
    dynamics.add_wall({.normal = -Vec<Dim>::Unit(0), .level = -2.1, .friction = 0.1});
    return dynamics;
  };
  const int threads = num_threads();
  const auto run = [&](int count) {
    set_num_threads(count);
    Dynamics<Dim> dynamics = make();
    for (int k = 0; k < 40; ++k) dynamics.step();
    set_num_threads(threads);
    return dynamics;
  };
  const Dynamics<Dim> one = run(1), two = run(2);
  EXPECT_EQ(one.points(), two.points());
  EXPECT_EQ(one.deformation(), two.deformation());
  EXPECT_GT(one.balance()["contact"], 0.0);
  Dynamics<Dim> first = make();
  for (int k = 0; k < 20; ++k) first.step();
  Dynamics<Dim> resumed = make();
  resumed.restore(first.state());
  for (int k = 0; k < 20; ++k) resumed.step();
  EXPECT_EQ(resumed.points(), one.points());
  EXPECT_EQ(resumed.point_velocities(), one.point_velocities());
}

TYPED_TEST(MaterialPointMethod, ResultsAreTheSameOnAnyNumberOfThreadsAndWhenResumed) {
  for (const MpmFrame frame : new_grids)
    expect_the_same_results_on_any_number_of_threads_and_resumed<TypeParam::value>(frame);
}

void expect_points_with_prescribed_velocities_take_the_nodes_along(MpmFrame frame) {
  const MpmOptions options{.cell = 0.125};
  DeformableBody<2> body = body_on_lattice<2>(block<2>(2.0, 0.0625), frame, options, 2, soft(), 1.0);
  body.velocity = bench::velocity_by_place<2>(body, [](const Vec<2>& x) { return Vec<2>(0.02 * (x[0] - 1.0), 0.0); });
  Dynamics<2> dynamics({body}, mpm<2>(options));
  const double kinetic = dynamics.balance()["kinetic"];
  std::vector<Index> left, right;
  for (Index p = 0; p < body.points.cols(); ++p) {
    if (body.points(0, p) < 0.125) left.push_back(p);
    if (body.points(0, p) > 1.875) right.push_back(p);
  }
  dynamics.prescribe_points(left, 0, Vector::Constant(std::ssize(left), -0.02));
  dynamics.prescribe_points(right, 0, Vector::Constant(std::ssize(right), 0.02));
  EXPECT_NEAR(dynamics.balance()["kinetic"] / kinetic, 1.0, 0.02);
  dynamics.run(10.0);
  const Tensors F = dynamics.deformation();
  // Ends that are 2 apart are 2.4 apart; the grips are a little less than a cell.
  for (Index p = 0; p < body.points.cols(); ++p) {
    if (body.points(0, p) < 0.5 || body.points(0, p) > 1.5) continue;
    EXPECT_NEAR(F(0, p), 1.2, 0.06);
  }
  EXPECT_NEAR(dynamics.energy().error(), 0.0, 0.01);
}

TEST(MaterialPointMethod2, PointsWithPrescribedVelocitiesTakeTheNodesAlong) {
  for (const MpmFrame frame : new_grids) expect_points_with_prescribed_velocities_take_the_nodes_along(frame);
}

TEST(MaterialPointMethod2, PointsOfAStretchedStripAreReportedBeforeTheyLoseEachOther) {
  for (const int degree : {2, 3}) {
    const bench::StretchedStrip strip = bench::stretch_strip({.cell = 2.0, .degree = degree}, MpmFrame::updated, 2.2);
    EXPECT_GT(strip.reported_at, 1.1) << degree;
    EXPECT_GT(strip.gap_at, 1.2 * strip.reported_at) << degree;
  }
  for (const MpmFrame frame : {MpmFrame::total, MpmFrame::mesh}) {
    const bench::StretchedStrip whole = bench::stretch_strip({.cell = 2.0}, frame, 2.0);
    EXPECT_EQ(whole.gap_at, 0.0);
    EXPECT_LT(whole.scatter, frame == MpmFrame::total ? 0.01 : 0.05);
  }
}

TEST(MaterialPointMethod2, InputThatMakesNoSenseIsRefusedWithARemedy) {
  const auto refused = [](const MpmOptions& options) { return [options] { mpm<2>(options); }; };
  EXPECT_THAT(refused({.cell = 0.0}), ThrowsMessage<InputError>(HasSubstr("cell 0, expected a positive length")));
  EXPECT_THAT(refused({.cell = 1.0, .degree = 4}),
              ThrowsMessage<InputError>(HasSubstr("degree 4, expected 1, 2 or 3")));
  EXPECT_THAT(refused({.cell = 1.0, .transfer = Transfer::xpic, .order = 0}),
              ThrowsMessage<InputError>(HasSubstr("order 0, expected 1 to 16")));
  EXPECT_THAT([] { points_on_lattice<2>(block<2>(1.0, 0.25), {.cell = 3.0}, 2, soft(), 1.0); },
              ThrowsMessage<InputError>(HasSubstr("thicker than the body")));
  DeformableBody<2> meshed = deformable_body(block<2>(1.0, 0.25), soft(), 1.0);
  EXPECT_THAT([&] { Dynamics<2>({meshed}, mpm<2>({.cell = 0.25, .remap = true})); },
              ThrowsMessage<InputError>(HasSubstr("remap is for points")));
  std::swap(meshed.cells(1, 3), meshed.cells(2, 3));
  EXPECT_THAT([&] { Dynamics<2>({meshed}, mpm<2>({.cell = 0.25})); },
              ThrowsMessage<InputError>(HasSubstr("in the wrong order")));
  meshed.cells.resize(3, 0);
  EXPECT_THAT([&] { Dynamics<2>({meshed}, mpm<2>({.cell = 0.25})); },
              ThrowsMessage<InputError>(HasSubstr("expected points only, or a mesh")));
  // Ten cells from where a grid ends.
  const MpmOptions far{.cell = 0.25, .origin = {10.0 * 0.25 - 4e6 * 0.25, 0.0, 0.0}};
  DeformableBody<2> body = points_on_lattice<2>(block<2>(1.0, 0.25), far, 2, soft(), 1.0);
  body.velocity = bench::velocity_by_place<2>(body, [](const Vec<2>&) { return Vec<2>(1.0, 0.0); });
  Dynamics<2> dynamics({body}, mpm<2>(far));
  EXPECT_THAT([&] { dynamics.run(10.0); },
              ThrowsMessage<NumericalError>(testing::AllOf(HasSubstr("fly apart"), HasSubstr("the material point"))));
}

TEST(MaterialPointMethod3, ATaylorBarHasTheLengthAndFootOfOtherMethods) {
  const double size = 0.5e-3;
  const MpmOptions options{.cell = 2.0 * size};
  for (const MpmFrame frame : {MpmFrame::updated, MpmFrame::total, MpmFrame::mesh}) {
    const bench::TaylorRun run = bench::run_taylor(options, frame, 40e-6);
    EXPECT_LT(std::abs(run.energy_error), 0.02);
    EXPECT_NEAR(run.shape.length, 24.9e-3, 0.03 * 24.9e-3) << static_cast<int>(frame);  // that of OTM
  }
}

}  // namespace
}  // namespace efree
