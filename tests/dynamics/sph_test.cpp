// SPDX-License-Identifier: GPL-3.0-or-later
/// Smoothed particles: sums over pairs and their adjoint, conservation, walls, splitting, soil.
#include "efree/bench/soil_scenes.hpp"
#include "efree/bench/sph_scenes.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/internal/world.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/sph/internal/increment.hpp"
#include "efree/dynamics/schemes/sph/internal/splitting.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numeric>
#include <set>

namespace efree {
namespace {

using bench::block;
using bench::soft;
using testing::HasSubstr;
using testing::ThrowsMessage;

template <class T> class SmoothedParticles : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(SmoothedParticles, Dimensions);

constexpr SmoothingKernel all_kernels[] = {SmoothingKernel::cubic_spline, SmoothingKernel::wendland_c2};

template <int Dim> DeformableBody<Dim> soft_particles(const SphOptions& options, SphFrame frame = SphFrame::updated) {
  return particles_on_lattice<Dim>(block<Dim>(1.0, Dim == 2 ? 0.25 : 0.5), frame, options, soft(), 1.0);
}

/// Motion of a body that vibrates and turns.
template <int Dim> Points<Dim> motion_of(const DeformableBody<Dim>& body) {
  Points<Dim> v = Points<Dim>::Constant(Dim, body.nodes.cols(), 0.01);
  v.row(0) += 0.02 * (body.nodes.row(0).array() * std::numbers::pi).cos().matrix() - 0.02 * body.nodes.row(1);
  v.row(1) += 0.02 * body.nodes.row(0);
  return v;
}

TYPED_TEST(SmoothedParticles, TheKernelIntegratesToOneAndItsSlopeIsItsDerivative) {
  constexpr int Dim = TypeParam::value;
  for (const SmoothingKernel kernel : all_kernels) {
    constexpr int n = 4000;
    constexpr double h = 0.7;
    double integral = 0.0;
    for (int k = 0; k < n; ++k) {
      const double r = (k + 0.5) * kernel_support * h / n;
      const double shell = Dim == 2 ? 2.0 * std::numbers::pi * r : 4.0 * std::numbers::pi * r * r;
      integral += kernel_value(kernel, Dim, r, h) * shell * kernel_support * h / n;
      const double slope = (kernel_value(kernel, Dim, r + 1e-6, h) - kernel_value(kernel, Dim, r - 1e-6, h)) / 2e-6;
      EXPECT_NEAR(kernel_slope_over_distance(kernel, Dim, r, h) * r, slope, 1e-7 * (1.0 + std::abs(slope))) << r;
    }
    EXPECT_NEAR(integral, 1.0, 1e-6);
    EXPECT_EQ(kernel_value(kernel, Dim, 2.0 * h, h), 0.0);
  }
}

TYPED_TEST(SmoothedParticles, ForcesAreTheAdjointOfRatesAndSumUpToNothing) {
  for (const SmoothingKernel kernel : all_kernels)
    for (const double ratio : {1.0, 1.8})
      for (const bool has_walls : {false, true}) {
        const auto [products, sum] = bench::adjoint_errors<TypeParam::value>(kernel, ratio, has_walls);
        EXPECT_LT(products, 1e-13) << has_walls;
        EXPECT_LT(sum, 1e-13) << has_walls;
      }
}

TYPED_TEST(SmoothedParticles, ImagesContinueMotionsBehindWallsAndInTheirCorners) {
  // A lattice falls on a floor that holds it and slides along, or falls into a corner of it with smooth walls: at
  // walls its gradient is what it is far inside.
  constexpr int Dim = TypeParam::value, along = 8, middle = 4, size = internal::tensor_size(Dim);
  bench::RandomParticles<Dim> of(along, 1.0);
  const auto n = static_cast<Index>(of.x.cols());
  std::vector<Index> all(static_cast<std::size_t>(n));
  std::iota(all.begin(), all.end(), 0);
  for (Index a = 0; a < n; ++a)
    for (Index i = 0, rest = a; i < Dim; ++i, rest /= along) of.x(i, a) = static_cast<double>(rest % along);
  of.mass.setOnes();
  for (const bool in_corner : {false, true}) {
    std::vector<Wall<Dim>> walls{
        {.normal = Vec<Dim>::Unit(1), .level = -0.5, .friction = std::numeric_limits<double>::infinity()}};
    for (int i = 0; i < Dim && in_corner; ++i)
      if (i != 1) walls.push_back({.normal = Vec<Dim>::Unit(i), .level = -0.5});
    of.v.setZero();
    const auto height = (of.x.row(1).array() + 0.5).matrix();
    of.v.row(1) = -0.3 * height;
    if (!in_corner) of.v.row(0) = 0.5 * height;
    const auto images = internal::images_by(walls);
    EXPECT_EQ(images.size(), in_corner ? (1u << Dim) - 1 : 1u);
    std::vector<internal::ParticlePairs> pairs;
    internal::find_pairs<Dim>(of.x, of.smoothing, kernel_support, {all}, images, pairs);
    const std::vector<internal::WallBits> pressed(static_cast<std::size_t>(n), 7);
    std::vector<double> x, v, rates(size * n), moments(size * n);
    for (Index a = 0; a < n; ++a)
      for (int i = 0; i < 4; ++i) {
        x.push_back(i < Dim ? of.x(i, a) : i == 3 ? 1.0 / of.smoothing[a] : 0.0);
        v.push_back(i < Dim ? of.v(i, a) : i == 3 ? 1.0 : 0.0);
      }
    internal::sum_rates(pairs[0], {.dim = Dim, .kernel = {}, .one_size = true, .x = x.data(), .v = v.data()},
                        rates.data(), moments.data());
    internal::add_mirrored_rates<Dim>(pairs[0], {images, {}, of.x, of.v, 0.0, of.mass, of.smoothing, pressed},
                                      rates.data(), moments.data());
    Index inside = 0, step = 1;
    for (int i = 0; i < Dim; ++i, step *= along) inside += step * middle;
    EXPECT_NEAR(rates[size * inside + internal::tensor_index(Dim, 1, 1)], -0.3, 0.02);
    for (Index a = 0; a < n; ++a) {
      bool near_walls_at_most = true;
      for (int i = 0; i < Dim; ++i)
        near_walls_at_most &= of.x(i, a) < middle + 0.5 && (i == 1 || in_corner || of.x(i, a) > 2.5);
      for (int k = 0; near_walls_at_most && k < size; ++k) {
        EXPECT_NEAR(rates[size * a + k], rates[size * inside + k], 1e-14) << of.x.col(a).transpose();
        EXPECT_NEAR(moments[size * a + k], moments[size * inside + k], 1e-14) << of.x.col(a).transpose();
      }
    }
  }
}

TYPED_TEST(SmoothedParticles, FindsAllPairsThatAreCloseOnceInEveryChunk) {
  constexpr int Dim = TypeParam::value;
  const bench::RandomParticles<Dim> of(Dim == 2 ? 16 : 7, 1.7);
  const auto n = static_cast<Index>(of.x.cols());
  std::vector<std::vector<Index>> chunks(3);
  for (Index a = 0; a < n; ++a) chunks[(7 * a) % 3].push_back(a);
  std::vector<internal::ParticlePairs> pairs;
  internal::find_pairs<Dim>(of.x, of.smoothing, 2.0, {chunks[0], chunks[1], chunks[2]}, {}, pairs);
  for (std::size_t c = 0; c < 3; ++c) {
    std::set<std::pair<Index, Index>> found, expected;
    for (Index i = 0; i < pairs[c].own; ++i)
      for (Index k = pairs[c].begin[i]; k < pairs[c].begin[i + 1]; ++k) {
        if (pairs[c].other[k] == i) continue;
        const Index a = pairs[c].particles[i], b = pairs[c].particles[pairs[c].other[k]];
        EXPECT_TRUE(found.insert({std::min(a, b), std::max(a, b)}).second);
      }
    for (const Index a : chunks[c])
      for (Index b = 0; b < n; ++b)
        if (b != a && (of.x.col(a) - of.x.col(b)).norm() < 2.0 * std::max(of.smoothing[a], of.smoothing[b]))
          expected.insert({std::min(a, b), std::max(a, b)});
    EXPECT_EQ(found, expected);
  }
}

TYPED_TEST(SmoothedParticles, ABodyThatVibratesAndTurnsKeepsMomentaAndEnergy) {
  constexpr int Dim = TypeParam::value;
  SphOptions options{.spacing = 0.1};
  options.viscosity = {0.0, 0.0};
  for (const bool corrected : {true, false}) {
    options.corrected = corrected;
    DeformableBody<Dim> body = soft_particles<Dim>(options);
    body.velocity = motion_of(body);
    Dynamics<Dim> dynamics({body}, sph<Dim>(options));
    const auto start = dynamics.balance();
    for (int k = 0; k < 400; ++k) dynamics.step();
    const auto end = dynamics.balance();
    EXPECT_LT((end.momentum - start.momentum).norm(), 1e-13 * start.momentum.norm());
    EXPECT_NEAR(end.total(), start.total(), 0.005 * start.total());
    EXPECT_GT(end["stored"], 0.01 * start.total());
    // Rates that are not corrected see strains at surfaces that turn.
    const double lost = (end.angular_momentum - start.angular_momentum).norm() / start.angular_momentum.norm();
    if (corrected)
      EXPECT_LT(lost, 0.02);
    else
      EXPECT_GT(lost, 0.02);
  }
}

TYPED_TEST(SmoothedParticles, ALinearMotionHasItsGradientUpToTheSurface) {
  constexpr int Dim = TypeParam::value;
  SphOptions options{.spacing = 0.1, .corrected = true};
  options.viscosity = {0.0, 0.0};
  DeformableBody<Dim> body = soft_particles<Dim>(options);
  Mat<Dim> gradient = Mat<Dim>::Zero();
  gradient(0, 0) = 0.3;
  gradient(0, 1) = -0.5;
  gradient(1, 0) = 0.2;
  body.velocity = gradient * body.nodes;
  Dynamics<Dim> dynamics({body}, sph<Dim>(options), {.courant = 0.01});
  const double dt = dynamics.step();
  const Tensors F = dynamics.deformation();
  for (Index p = 0; p < F.cols(); ++p) {
    const Mat<3> at = Eigen::Map<const Mat<3>>(F.col(p).data());
    const Mat<Dim> expected = Mat<Dim>::Identity() + dt * gradient;
    EXPECT_LT((at.template topLeftCorner<Dim, Dim>() - expected).norm(), 1e-12) << p;
  }
}

TYPED_TEST(SmoothedParticles, APointThatTurnsAHundredTimesKeepsItsStress) {
  constexpr int Dim = TypeParam::value;
  const SharedMaterial material = NeoHookean({.E = 1.0, .nu = 0.3});
  constexpr int steps = 2000;  // 18 degrees each
  Mat<Dim> half = Mat<Dim>::Zero(), F = Mat<Dim>::Identity();
  half(0, 1) = -std::tan(0.05 * std::numbers::pi);
  half(1, 0) = -half(0, 1);
  F(0, 0) = 1.2;
  const auto energy = [&] {
    Deformation point = Deformation::none(Points<3>::Zero(3, 1));
    Mat<3> full = Mat<3>::Identity();
    full.topLeftCorner<Dim, Dim>() = F;
    point.F.col(0) = full.reshaped();
    return std::pair(respond(*material, point, false).energy[0],
                     Mat<3>(respond(*material, point, false).stress(0) * full.transpose()));
  };
  const auto [energy_before, stress_before] = energy();
  for (int k = 0; k < steps; ++k) F = Mat<Dim>(internal::increment<Dim>(half) * F);
  const auto [energy_after, stress_after] = energy();
  EXPECT_NEAR(energy_after, energy_before, 1e-10 * energy_before);
  EXPECT_LT((stress_after - stress_before).norm(), 1e-10 * stress_before.norm());  // after whole turns
}

TEST(SmoothedParticles, AFreeSquareSpinsAsARigidBody) {
  const SphOptions options{.spacing = 0.1, .corrected = true};
  DeformableBody<2> body = particles_on_lattice<2>(block<2>(1.0, 0.25), SphFrame::updated, options,
                                                   SharedMaterial(NeoHookean({.E = 1e6, .nu = 0.3})), 1.0);
  body.velocity.resize(2, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const Vec<2> arm = body.nodes.col(a) - Vec<2>(0.5, 0.5);
    body.velocity.col(a) << -arm[1], arm[0];
  }
  Dynamics<2> dynamics({body}, sph<2>(options), {.imbalance = 10.0});
  const auto start = dynamics.balance();
  dynamics.run(0.5);
  const auto end = dynamics.balance();
  EXPECT_NEAR(end.angular_momentum[0], start.angular_momentum[0], 1e-4 * start.angular_momentum[0]);
  EXPECT_LT(end["stored"], 1e-3 * start["kinetic"]);
}

TYPED_TEST(SmoothedParticles, SplittingConservesMassMomentaAndEnergies) {
  constexpr int Dim = TypeParam::value;
  const SphOptions options{.spacing = 0.1};
  DeformableBody<Dim> body = soft_particles<Dim>(options);
  body.velocity = motion_of(body);
  World<Dim> world;
  internal::construct(world, std::vector<DeformableBody<Dim>>{body, body}, {{}, {}}, DynamicsOptions{});
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p) world.nodes.mass[world.point_number(chunk, p)] = chunk.matter.mass[p];
  // Of the second body every third particle is strained.
  const Index n = world.first_point[1];
  Index strained = 0;
  for (auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      if (chunk.body == 1 && chunk.number[p] % 3 == 0) {
        chunk.matter.now.F(0, p) = 1.5;
        ++strained;
      }
  world.prescribed.push_back({n + 3, 0, 0.25});
  // In more digits, so that sums of many numbers say what each of them does.
  constexpr int turns = Dim == 2 ? 1 : 3;
  using Sums = Eigen::Vector<long double, 3 + Dim + turns>;
  const auto sums = [&] {
    const Nodes<Dim>& nodes = world.nodes;
    Sums result = Sums::Zero();
    for (Index a = 0; a < nodes.size(); ++a) {
      const Vec<Dim> momentum = nodes.mass[a] * nodes.v.col(a);
      result[0] += nodes.mass[a];
      result[1] += 0.5 * momentum.dot(nodes.v.col(a));
      result.template segment<Dim>(3) += momentum.template cast<long double>();
      result.template tail<turns>() += moment_about_origin<Dim>(nodes.x.col(a), momentum).template cast<long double>();
    }
    for (const auto& chunk : world.chunks)
      for (const double volume : chunk.matter.volume) result[2] += volume;
    return result;
  };
  const Sums before = sums();
  internal::ParticleSizes sizes{.smoothing = Vector::Constant(2 * n, 0.12),
                                .splits = std::vector<std::uint8_t>(2 * n, 0),
                                .pressed = std::vector<internal::WallBits>(2 * n, 0)};
  EXPECT_EQ(internal::split_particles(world, {.strain = 0.1}, sizes), strained);
  constexpr Index more = (1 << Dim) - 1;
  EXPECT_EQ(world.nodes.size(), 2 * n + more * strained);
  EXPECT_EQ(world.num_points(), world.nodes.size());
  EXPECT_EQ(sizes.smoothing.size(), world.nodes.size());
  EXPECT_LT(static_cast<double>((sums() - before).cwiseAbs().maxCoeff()), 1e-14);
  // Nodes are where their points are, with the same mass; daughters of prescribed particles are prescribed.
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p) {
      const Index a = world.point_number(chunk, p);
      EXPECT_EQ(world.nodes.mass[a], chunk.matter.mass[p]);
      EXPECT_EQ(world.nodes.body[a], chunk.body);
      EXPECT_LT((world.nodes.x.col(a) - chunk.matter.x.col(p)).norm(), 0.06);
    }
  EXPECT_EQ(std::ssize(world.prescribed), 1 + more);
  EXPECT_EQ(internal::split_particles(world, {.strain = 0.1}, sizes), 0);
}

TEST(SmoothedSoil, SplittingHasTheKernelGradientErrorsOfTheSlides) {
  EXPECT_NEAR(bench::splitting_error(1.2, 0.5, 0.5, 1.0), 0.106, 0.01 * 0.106);
  EXPECT_NEAR(bench::splitting_error(1.2, 0.5, 0.6, 1.0), 0.0500, 0.01 * 0.0500);
  EXPECT_NEAR(bench::splitting_error(1.2, 0.5, 0.75, 1.0), 0.00874, 0.01 * 0.00874);
}

TEST(SmoothedSoil, APointShearsAtTheRatioOfItsAngles) {
  bench::Soil soil = bench::rods;
  EXPECT_NEAR(bench::shear_ratio(soil, 1e3), 0.332, 0.001);
  soil.friction = soil.dilatancy = 25.0;
  EXPECT_NEAR(bench::shear_ratio(soil, 1e3), std::tan(25.0 * std::numbers::pi / 180.0), 5e-4);
}

TEST(SmoothedSoil, ABedAtRestBearsItsWeight) {
  bench::Soil soil = bench::rods;
  soil.cohesion = 5e3;
  SphOptions options{.spacing = 0.05};
  options.viscosity.linear = 1.0;
  const bench::Bed bed = bench::bed_at_rest(options, soil, 1.0, 4.0);
  EXPECT_NEAR(bed.slope, 1.0, 0.01);
  EXPECT_LT(bed.largest, 0.02);
}

TEST(SmoothedSoil, ABlockSlidesWithCoulombFriction) {
  EXPECT_NEAR(bench::sliding_error(30.0, 0.3), 0.0, 0.02);
}

TEST(SmoothedSoil, ParticlesOfClayInSpaceDoNotPairUpWithArtificialStressInCompressionToo) {
  SphOptions options{.spacing = 1.0 / 6.0};
  options.artificial_stress.strength = 0.5;
  EXPECT_EQ(bench::cohesive_collapse<3>(options, 2.0).close_pairs, 0);
  options.artificial_stress.compression = 0.0;
  EXPECT_GT(bench::cohesive_collapse<3>(options, 2.0).close_pairs, 0);
}

TEST(SmoothedSoil, AHeapIsTheSameOnAnyNumberOfThreads) {
  SphOptions options{.spacing = 0.01};
  options.splitting.strain = 0.05;
  options.artificial_stress.strength = 0.5;
  const auto positions = [&](int threads) {
    set_num_threads(threads);
    Dynamics<2> dynamics({bench::soil_block(0.2, 0.1, options, bench::rods)}, sph<2>(options));
    dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = 0.5});
    dynamics.set_gravity({0.0, -bench::earth_gravity});
    dynamics.run(0.15);
    EXPECT_GT(dynamics.count("split particles"), 10);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.02);
    return dynamics.points();
  };
  const int before = num_threads();
  const Points<2> one = positions(1), three = positions(3);
  set_num_threads(before);
  EXPECT_EQ(one, three);
}

TEST(SmoothedSoil, ARunGoesOnFromItsState) {
  SphOptions options{.spacing = 0.01};
  options.splitting.strain = 0.05;
  const auto begin = [&] {
    Dynamics<2> dynamics({bench::soil_block(0.2, 0.1, options, bench::rods)}, sph<2>(options));
    dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = 0.5});
    dynamics.set_gravity({0.0, -bench::earth_gravity});
    return dynamics;
  };
  Dynamics<2> whole = begin(), resumed = begin();
  whole.run(0.1);
  ASSERT_GT(whole.count("split particles"), 0);
  resumed.restore(whole.state());
  for (int k = 0; k < 100; ++k) {
    whole.step();
    resumed.step();
  }
  EXPECT_EQ(whole.points(), resumed.points());
  EXPECT_EQ(whole.energy().residual, resumed.energy().residual);
}

TEST(SmoothedParticles, ABlockThatHitsAWallKeepsItsEnergyFromNearAndFar) {
  for (const double gap : {0.01, 0.3})
    for (const bool corrected : {true, false}) {
      SphOptions options{.spacing = 0.05};
      options.corrected = corrected;
      DeformableBody<2> body = soft_particles<2>(options);
      body.velocity = Points<2>::Zero(2, body.nodes.cols());
      body.velocity.row(1).setConstant(-0.1);  // a tenth of the speed of sound, nearly
      Dynamics<2> dynamics({body}, sph<2>(options));
      dynamics.add_wall({.normal = {0.0, 1.0}, .level = -gap});
      while (dynamics.time() < 4.0 + gap / 0.1) {
        dynamics.step();
        ASSERT_LT(dynamics.wall_forces()(1, 0), 1e-3) << "a wall pulls, " << gap << ", " << corrected;
      }
      EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.02) << gap << ", " << corrected;
      EXPECT_GT(dynamics.point_velocities().row(1).mean(), 0.02);  // it has come back
    }
}

TEST(SmoothedSoil, ParticlesThatBreakAndSplitGoOnFromAState) {
  // One body breaks where it is pulled, and one before it splits.
  SphOptions options{.spacing = 0.1};
  options.splitting.strain = 0.02;
  const auto begin = [&] {
    std::vector<DeformableBody<2>> bodies(2, soft_particles<2>(options));
    bodies[1].nodes.row(1).array() += 3.0;
    bodies[1].points = bodies[1].nodes;
    bodies[1].fracture.stretch = 1.1;
    for (auto& body : bodies) {
      body.velocity = Points<2>::Zero(2, body.nodes.cols());
      body.velocity.row(0) = 0.6 * (body.nodes.row(0).array() - 0.5).matrix();
    }
    return Dynamics<2>(bodies, sph<2>(options), {.imbalance = 10.0});
  };
  Dynamics<2> whole = begin(), resumed = begin();
  while (whole.count("split particles") == 0 || whole.count("eroded points") == 0) {
    ASSERT_LT(whole.time(), 5.0);
    whole.step();
  }
  resumed.restore(whole.state());
  for (int k = 0; k < 40; ++k) {
    whole.step();
    resumed.step();
  }
  EXPECT_TRUE(whole.points().allFinite());
  EXPECT_EQ(whole.points(), resumed.points());
}

TEST(SmoothedParticles, TheTotalFrameStretchesAStripToTwiceItsLength) {
  const SphOptions options{.spacing = 0.1};
  const DeformableBody<2> body = particles_on_lattice<2>(
      triangulate(shapes::rectangle(0.0, 0.0, 4.0, 1.0), {.size = 0.5}), SphFrame::total, options, soft(), 1.0);
  Dynamics<2> dynamics({body}, total_lagrangian<2>());
  for (Index a = 0; a < dynamics.num_nodes(); ++a) {
    const double x = dynamics.nodes()(0, a);
    if (x < 0.15 || x > 3.85) {
      dynamics.prescribe(a, 0, x < 2.0 ? -0.1 : 0.1);
      dynamics.prescribe(a, 1, 0.0);
    }
  }
  dynamics.run(20.0);
  const Tensors F = dynamics.deformation();
  double largest = 0.0, smallest = 10.0;
  for (Index p = 0; p < F.cols(); ++p) {
    if (std::abs(body.points(0, p) - 2.0) > 0.8) continue;
    largest = std::max(largest, F(0, p));
    smallest = std::min(smallest, F(0, p));
  }
  EXPECT_LT(largest / smallest, 1.1);
  EXPECT_NEAR(smallest, 2.0, 0.15);
}

TEST(SmoothedParticles, RefuseWrongOptionsAndBodies) {
  const auto refuses = [](SphOptions options, const char* message) {
    EXPECT_THAT([&] { static_cast<void>(sph<2>(options)); }, ThrowsMessage<InputError>(HasSubstr(message)));
  };
  refuses({}, "spacing 0, expected a positive length");
  refuses({.spacing = 0.1, .smoothing = 5.0}, "smoothing 5, expected 0.8 to 3");
  refuses({.spacing = 0.1, .viscosity = {-1.0, 0.0}}, "viscosity -1");
  refuses({.spacing = 0.1, .splitting = {.strain = 0.1, .separation = 1.0}}, "separation 1");
  const SphOptions options{.spacing = 0.1};
  EXPECT_THAT([&] { soft_particles<2>({.spacing = 0.2}); }, ThrowsMessage<InputError>(HasSubstr("Expected a tenth")));
  DeformableBody<2> body = soft_particles<2>(options);
  EXPECT_THAT([&] { Dynamics<2>({body}, sph<2>(options), {.plane = Plane::axisymmetric}); },
              ThrowsMessage<InputError>(HasSubstr("not of an axisymmetric section")));
  body.nodes.col(0) *= 1.1;
  EXPECT_THAT([&] { Dynamics<2>({body}, sph<2>(options)); },
              ThrowsMessage<InputError>(HasSubstr("nodes and points at once")));
  const DeformableBody<2> total =
      particles_on_lattice<2>(triangulate(shapes::rectangle(0.0, 0.0, 4.0, 1.0), {.size = 0.5}), SphFrame::total,
                              {.spacing = 0.1}, soft(), 1.0);
  EXPECT_THAT(([&] { Dynamics<2>({total}, sph<2>({.spacing = 0.1})); }),
              ThrowsMessage<InputError>(HasSubstr("take total_lagrangian()")));
}

}  // namespace
}  // namespace efree
