// SPDX-License-Identifier: GPL-3.0-or-later
/// Scenes of smoothed particles, for tests and benchmarks.
#pragma once

#include "efree/basis/internal/neighbours.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/sph/internal/mirrored_sums.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"

#include "elastic_block.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

namespace efree::bench {

/// Particles in disorder, with unequal smoothing lengths, velocities and symmetric stresses.
template <int Dim> struct RandomParticles {
  Points<Dim> x, v;
  Vector smoothing, mass;
  std::vector<double> stress;  ///< over the square of the density, as sum_forces takes it

  explicit RandomParticles(Index along, double largest_ratio, unsigned seed = 1) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> number(-1.0, 1.0);
    Index n = 1;
    for (int i = 0; i < Dim; ++i) n *= along;
    x.resize(Dim, n);
    v.resize(Dim, n);
    smoothing.resize(n);
    mass.resize(n);
    constexpr int size = internal::tensor_size(Dim);
    stress.assign(static_cast<std::size_t>(size * n), 0.0);
    for (Index a = 0; a < n; ++a) {
      Index rest = a;
      for (int i = 0; i < Dim; ++i, rest /= along) {
        x(i, a) = static_cast<double>(rest % along) + 0.3 * number(generator);
        v(i, a) = number(generator);
      }
      smoothing[a] = 1.2 * (1.0 + (largest_ratio - 1.0) * 0.5 * (1.0 + number(generator)));
      mass[a] = 1.0 + 0.5 * number(generator);
      for (int j = 0; j < Dim; ++j)
        for (int i = 0; i <= j; ++i)
          stress[size * a + internal::tensor_index(Dim, i, j)] = stress[size * a + internal::tensor_index(Dim, j, i)] =
              number(generator);
    }
  }
};

/// What is left of <L v, V sigma> + <v, f> over the sum of the absolute values, of particles in two chunks; f are
/// forces by the stresses alone. And the sum of the forces less those by walls, over that of their sizes. has_walls:
/// two at right angles, one of them smooth, and an oblique one, on which all particles are pressed.
template <int Dim>
std::pair<double, double> adjoint_errors(SmoothingKernel kernel, double largest_ratio, bool has_walls = false) {
  RandomParticles<Dim> of(Dim == 2 ? 24 : 10, largest_ratio);
  const auto n = static_cast<Index>(of.x.cols());
  constexpr double pressure = 10.0;  // walls do not pull
  for (Index a = 0; has_walls && a < n; ++a)
    for (int i = 0; i < Dim; ++i)
      of.stress[internal::tensor_size(Dim) * a + internal::tensor_index(Dim, i, i)] -= pressure;
  std::vector<std::vector<Index>> chunks(2);
  for (Index a = 0; a < n; ++a) chunks[of.x(0, a) + 0.7 * of.x(1, a) < 0.8 * std::cbrt(n) ? 0 : 1].push_back(a);
  std::vector<Wall<Dim>> walls;
  if (has_walls) {
    Vec<Dim> oblique = -0.6 * Vec<Dim>::Unit(0) - 0.8 * Vec<Dim>::Unit(1);
    walls = {{.normal = Vec<Dim>::Unit(0), .level = -0.5, .friction = std::numeric_limits<double>::infinity()},
             {.normal = Vec<Dim>::Unit(1), .level = -0.4},
             {.normal = oblique, .level = oblique.dot(of.x.col(n - 1)) - 0.5}};
  }
  const auto images = internal::images_by(walls);
  std::vector<internal::ParticlePairs> pairs;
  internal::find_pairs<Dim>(of.x, of.smoothing, kernel_support + 0.1, {chunks[0], chunks[1]}, images, pairs);
  const std::vector<internal::WallBits> pressed(static_cast<std::size_t>(n), 7);
  const internal::MirroredParticles<Dim> mirrored{images, kernel, of.x, of.v, 0.0, of.mass, of.smoothing, pressed};
  WallForces<Dim> wall_forces{.nodes = std::vector<Index>(static_cast<std::size_t>(n)),
                              .forces = std::vector<Points<Dim>>(walls.size(), Points<Dim>::Zero(Dim, n))};
  std::iota(wall_forces.nodes.begin(), wall_forces.nodes.end(), 0);
  constexpr int size = internal::tensor_size(Dim);
  Points<Dim * Dim> stress_of_all(Dim * Dim, n);
  for (Index a = 0; a < n; ++a) stress_of_all.col(a) = internal::tensor_at<Dim>(of.stress.data() + size * a).reshaped();
  double products = 0.0, scale = 0.0, forces_scale = 0.0;
  Vec<Dim> total = Vec<Dim>::Zero();
  for (const internal::ParticlePairs& chunk : pairs) {
    std::vector<double> x(4 * chunk.all()), v(x), stress(size * chunk.all()), density(2 * chunk.all(), 1.0),
        rates(size * chunk.all()), forces(4 * chunk.all());
    for (Index l = 0; l < chunk.all(); ++l) {
      const Index a = chunk.particles[l];
      for (int i = 0; i < Dim; ++i) {
        x[4 * l + i] = of.x(i, a);
        v[4 * l + i] = of.v(i, a);
      }
      x[4 * l + 3] = 1.0 / of.smoothing[a];
      v[4 * l + 3] = of.mass[a];
      std::copy_n(of.stress.data() + size * a, size, stress.data() + size * l);
    }
    const internal::LocalParticles local{
        .dim = Dim, .kernel = kernel, .one_size = largest_ratio == 1.0, .x = x.data(), .v = v.data()};
    internal::sum_rates(chunk, local, rates.data());
    internal::add_mirrored_rates(chunk, mirrored, rates.data(), nullptr);
    internal::sum_forces(chunk, local, {.stress = stress.data(), .density = density.data()}, forces.data());
    internal::add_mirrored_forces(chunk, mirrored, {.stress = stress_of_all.data()}, walls, forces.data(),
                                  &wall_forces);
    // V L with L = 1 / rho sum ..., and sigma = rho^2 times these: rho cancels.
    for (Index l = 0; l < chunk.own; ++l) {
      for (int k = 0; k < size; ++k) {
        const double product = v[4 * l + 3] * rates[size * l + k] * stress[size * l + k];
        products += product;
        scale += std::abs(product);
      }
      for (int i = 0; i < Dim; ++i) {
        const double force = forces[4 * l + i];
        products += force * v[4 * l + i];
        scale += std::abs(force * v[4 * l + i]);
        forces_scale += std::abs(force);
        total[i] += force;
      }
    }
  }
  for (const auto& of_wall : wall_forces.forces) total -= of_wall.rowwise().sum();
  return {std::abs(products) / scale, total.norm() / forces_scale};
}

/// A block that vibrates and spins without viscosity, in so many steps: what it loses of its momentum, over that, and
/// of its energy.
inline std::pair<double, double> vibrating_block(Index steps, const SphOptions& given = {.spacing = 0.05},
                                                 double courant = 0.5) {
  SphOptions options = given;
  options.viscosity = {0.0, 0.0};
  DeformableBody<2> body = particles_on_lattice<2>(block<2>(1.0, 0.25), SphFrame::updated, options, soft(), 1.0);
  body.velocity.resize(2, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const auto x = body.nodes.col(a);
    body.velocity.col(a) << 0.01 + 0.02 * std::cos(std::numbers::pi * x[0]), 0.01;
  }
  Dynamics<2> dynamics({body}, sph<2>(options), {.courant = courant, .imbalance = 10.0});
  const auto start = dynamics.balance();
  for (Index k = 0; k < steps; ++k) dynamics.step();
  const auto end = dynamics.balance();
  return {(end.momentum - start.momentum).norm() / start.momentum.norm(), end.total() / start.total() - 1.0};
}

/// Integral of |grad W_p - sum over daughters of grad W_d / 2^Dim|^2 in the plane for a particle with spacing 1 [1/d^4]
/// (Lopez, Roose & Recarey Morfa 2013): what a neighbour anywhere sees of splitting. Kernels are at the mean of the
/// smoothing lengths of the two, that of the neighbour being `neighbour` times the parent's.
inline double splitting_error(double smoothing, double separation, double ratio, double neighbour) {
  const auto gradient = [](const Vec<2>& x, double h) {
    const double r = x.norm();
    return Vec<2>(kernel_slope_over_distance(SmoothingKernel::cubic_spline, 2, r, h) * x);
  };
  const double h = smoothing, h_parent = 0.5 * h * (1.0 + neighbour), h_daughter = 0.5 * h * (ratio + neighbour);
  const double reach = kernel_support * std::max(h_parent, h_daughter) + separation;
  constexpr int cells = 400;  // midpoint rule
  const double edge = 2.0 * reach / cells;
  double sum = 0.0;
  for (int i = 0; i < cells; ++i)
    for (int j = 0; j < cells; ++j) {
      const Vec<2> x(-reach + (i + 0.5) * edge, -reach + (j + 0.5) * edge);
      Vec<2> difference = gradient(x, h_parent);
      for (const double a : {-0.5, 0.5})
        for (const double b : {-0.5, 0.5}) difference -= 0.25 * gradient(x - separation * Vec<2>(a, b), h_daughter);
      sum += difference.squaredNorm() * edge * edge;
    }
  return sum;
}

/// A strip of rubber 20 by 40 particles whose ends move apart at a fiftieth of the speed of sound.
struct StretchedParticles {
  double scatter = 0.0;  ///< standard deviation over mean of the axial stress in the middle half at a stretch of 1.3
  double gap_at =
      0.0;  ///< stretch at which a distance of neighbours along the axis is twice the mean, or the run ends; 0: none
};
inline StretchedParticles stretch_particles(const SphOptions& options, SphFrame frame, double to) {
  constexpr double rate = 1e-3;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 20.0, 40.0), {.size = 5.0});
  DeformableBody<2> body = particles_on_lattice<2>(mesh, frame, options, soft(), 1.0);
  const Points<2> X = body.points;
  body.velocity.setZero(2, X.cols());
  body.velocity.row(1) = rate * (X.row(1).array() - 20.0).matrix();
  Dynamics<2> dynamics({body}, frame == SphFrame::total ? total_lagrangian<2>() : sph<2>(options), {.imbalance = 10.0});
  for (Index a = 0; a < X.cols(); ++a)
    if (std::abs(X(1, a) - 20.0) > 18.0) dynamics.prescribe(a, 1, body.velocity(1, a));
  StretchedParticles result;
  const auto stretch = [&] { return 1.0 + rate * dynamics.time(); };
  for (double next = 1.01; next < to + 1e-9; next += 0.01) {
    try {
      dynamics.run((next - 1.0) / rate);
    } catch (const NumericalError&) {
      if (result.gap_at == 0.0) result.gap_at = stretch();
      return result;
    }
    const Points<2> x = dynamics.points();
    std::vector<double> along;
    for (Index p = 0; p < X.cols(); ++p)
      if (std::abs(X(0, p) - 10.5) < 0.1) along.push_back(x(1, p));
    std::ranges::sort(along);
    for (std::size_t k = 1; k < along.size(); ++k)
      if (result.gap_at == 0.0 && along[k] - along[k - 1] > 2.0 * stretch() * options.spacing)
        result.gap_at = stretch();
    if (std::abs(next - 1.3) > 1e-9) continue;
    const Tensors sigma = dynamics.cauchy_stress();
    std::vector<double> axial;
    for (Index p = 0; p < X.cols(); ++p)
      if (std::abs(X(1, p) - 20.0) < 10.0) axial.push_back(sigma(4, p));
    const Eigen::Map<const Vector> values(axial.data(), std::ssize(axial));
    result.scatter = std::sqrt((values.array() - values.mean()).square().mean()) / values.mean();
  }
  return result;
}

}  // namespace efree::bench
