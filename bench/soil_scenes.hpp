// SPDX-License-Identifier: GPL-3.0-or-later
/// Scenes of soil by smoothed particles, for tests and benchmarks.
#pragma once

#include "efree/basis/internal/neighbours.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/drucker_prager.hpp"

#include "clock.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace efree::bench {

constexpr double earth_gravity = 9.81;

/// Soil, or rods that stand for it.
struct Soil {
  double density, bulk, nu, cohesion, friction, dilatancy;  ///< bulk modulus [stress]; angles in degrees
  double young() const { return 3.0 * bulk * (1.0 - 2.0 * nu); }
  ConeFit fit = ConeFit::plane_strain;
  SharedMaterial material() const {
    constexpr double degree = std::numbers::pi / 180.0;
    return DruckerPrager({.moduli = {.nu = nu, .kappa = bulk},
                          .cohesion = cohesion,
                          .friction = friction * degree,
                          .dilatancy = dilatancy * degree,
                          .fit = fit,
                          .strain = Strain::finite});
  }
};
/// Aluminium rods (Bui, Fukagawa, Sako & Ohno 2008).
constexpr Soil rods{.density = 2650.0, .bulk = 0.7e6, .nu = 0.3, .cohesion = 0.0, .friction = 19.8, .dilatancy = 0.0};
/// Those of a like test with other rods (Nguyen, Nguyen, Bui, Nguyen & Fukagawa 2017).
constexpr Soil rods_2{
    .density = 2040.0, .bulk = 4.867e6, .nu = 0.3, .cohesion = 0.0, .friction = 21.9, .dilatancy = 0.0};
/// Soft clay whose columns collapse in clumps.
template <int Dim> constexpr Soil soft_clay{.density = 1850.0,
                                            .bulk = 1.5e6,
                                            .nu = 0.3,
                                            .cohesion = 5e3,
                                            .friction = 25.0,
                                            .dilatancy = 0.0,
                                            .fit = Dim == 2 ? ConeFit::plane_strain : ConeFit::compression};

/// Particles of a rectangle from the origin on.
inline DeformableBody<2> soil_block(double length, double height, const SphOptions& options, const Soil& soil,
                                    SphFrame frame = SphFrame::updated) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, length, height), {.size = 0.5 * height});
  return particles_on_lattice<2>(mesh, frame, options, soil.material(), soil.density);
}

/// Speed that 99 % of the points stay below.
template <int Dim> double speed_of_most(const Dynamics<Dim>& dynamics) {
  std::vector<double> speeds;
  const Points<Dim> v = dynamics.point_velocities();
  for (Index a = 0; a < v.cols(); ++a) speeds.push_back(v.col(a).norm());
  std::ranges::sort(speeds);
  return speeds[(99 * speeds.size()) / 100];
}

/// By particle, whether it is of the heap: the most particles that hang together by distances of less than 1.5 spacings
/// (the larger of the two).
template <int Dim> std::vector<char> find_heap(const Points<Dim>& x, const Vector& spacing) {
  internal::Neighbours<Dim> tree;
  tree.build(x);
  const auto n = static_cast<Index>(x.cols());
  std::vector<Index> part(static_cast<std::size_t>(n), -1), sizes;
  for (Index first = 0; first < n; ++first) {
    if (part[first] >= 0) continue;
    const Index number = std::ssize(sizes);
    std::vector<Index> open{first};
    part[first] = number;
    sizes.push_back(0);
    while (!open.empty()) {
      const Index a = open.back();
      open.pop_back();
      ++sizes.back();
      std::vector<Index> near;
      tree.within(x.col(a), 1.5 * spacing.maxCoeff(), near);
      for (const Index b : near)
        if (part[b] < 0 && (x.col(b) - x.col(a)).norm() < 1.5 * std::max(spacing[a], spacing[b])) {
          part[b] = number;
          open.push_back(b);
        }
    }
  }
  const Index largest = std::ranges::max_element(sizes) - sizes.begin();
  std::vector<char> result;
  for (const Index number : part) result.push_back(number == largest ? 1 : 0);
  return result;
}

/// A heap at the end of its run.
struct Heap {
  double toe = 0.0;                ///< largest x of the far sides of its particles
  double furthest = 0.0;           ///< of all particles
  double crest = 0.0;              ///< height
  double failure = 0.0;            ///< x where the surface begins to fall
  double speed = 0.0;              ///< that 99 % stay below
  double energy_error = 0.0;       ///< of the balance, over the largest energy
  Index particles = 0, steps = 0;  ///< at the end
  double seconds = 0.0;
  std::vector<double> surface;  ///< heights by 64 equal parts of 0 <= x < 2.5 lengths
};

/// Collapse of a rectangle of soil between the wall x = 0 and nothing, on a floor that it sticks to.
inline Heap collapse(double length, double height, const SphOptions& options, const Soil& soil, double end) {
  Dynamics<2> dynamics({soil_block(length, height, options, soil)}, sph<2>(options), {.imbalance = 0.1});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = std::numeric_limits<double>::infinity()});
  dynamics.add_wall({.normal = {1.0, 0.0}, .level = 0.0, .friction = 0.0});
  dynamics.set_gravity({0.0, -earth_gravity});
  const double start = seconds();
  dynamics.run(end);
  Heap heap;
  heap.seconds = seconds() - start;
  const Points<2> x = dynamics.points();
  const Vector& radius = dynamics.world().nodes.radius;
  const std::vector<char> is_of_heap = find_heap<2>(x, 2.0 * radius);
  heap.surface.assign(64, 0.0);
  for (Index a = 0; a < x.cols(); ++a) {
    heap.furthest = std::max(heap.furthest, x(0, a) + radius[a]);
    if (is_of_heap[a] == 0) continue;
    heap.toe = std::max(heap.toe, x(0, a) + radius[a]);
    const auto part = static_cast<std::size_t>(std::clamp(x(0, a) / (2.5 * length) * 64.0, 0.0, 63.0));
    heap.surface[part] = std::max(heap.surface[part], x(1, a) + radius[a]);
  }
  heap.crest = heap.surface.front();
  std::size_t part = 0;
  while (part < 64 && heap.surface[part] > 0.98 * heap.crest) ++part;
  heap.failure = static_cast<double>(part) / 64.0 * 2.5 * length;
  heap.speed = speed_of_most(dynamics);
  heap.energy_error = dynamics.energy().largest_error();
  heap.particles = dynamics.num_points();
  heap.steps = dynamics.steps();
  return heap;
}

/// A bed of soil between smooth walls whose weight grows for half of the time.
struct Bed {
  double slope = 0.0;    ///< of the vertical stress with the depth at the start over rho g, by least squares of all but
                         ///< the outer three rows and columns
  double largest = 0.0;  ///< deviation from that line of a particle three columns inside, over the stress at the floor
  double speed = 0.0;
};
inline Bed bed_at_rest(const SphOptions& options, const Soil& soil, double size, double end) {
  const DeformableBody<2> body = soil_block(size, size, options, soil);
  Dynamics<2> dynamics({body}, sph<2>(options), {.imbalance = 10.0});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  dynamics.add_wall({.normal = {1.0, 0.0}, .level = 0.0});
  dynamics.add_wall({.normal = {-1.0, 0.0}, .level = -size});
  constexpr int stages = 100;
  for (int k = 1; k <= stages; ++k) {
    const double part = 0.5 * (1.0 - std::cos(std::numbers::pi * k / stages));
    dynamics.set_gravity({0.0, -part * earth_gravity});
    dynamics.run(0.5 * end * k / stages);
  }
  dynamics.run(end);
  const Tensors stress = dynamics.cauchy_stress();
  const double margin = 3.0 * options.spacing;
  Eigen::Matrix<double, Eigen::Dynamic, 2> lines(stress.cols(), 2);
  Vector values(stress.cols());
  std::vector<char> is_inside;
  Index count = 0;
  for (Index a = 0; a < stress.cols(); ++a) {
    const auto x = body.points.col(a);
    if (x[1] < margin || x[1] > size - margin) continue;
    is_inside.push_back(x[0] > margin && x[0] < size - margin ? 1 : 0);
    lines.row(count) << 1.0, body.points(1, a);
    values[count++] = stress(4, a);
  }
  const Eigen::Vector2d line = (lines.topRows(count).transpose() * lines.topRows(count))
                                   .ldlt()
                                   .solve(lines.topRows(count).transpose() * values.head(count));
  const double weight = soil.density * earth_gravity;
  double largest = 0.0;
  for (Index k = 0; k < count; ++k)
    if (is_inside[k] != 0) largest = std::max(largest, std::abs(lines.row(k).dot(line) - values[k]));
  return {.slope = line[1] / weight, .largest = largest / (weight * size), .speed = speed_of_most(dynamics)};
}

/// Mean of tau / sigma_n of a point of soil that flows in simple shear with constant normal stress, at the end.
inline double shear_ratio(const Soil& soil, double normal_stress) {
  const SharedMaterial material = soil.material();
  Deformation point = Deformation::none(Points<3>::Zero(3, 1), material->history_size());
  point.dt = 1.0;
  MaterialResponse response = respond(*material, point, false);
  const auto stress = [&](double shear, double dilation) {
    Mat<3> F = Mat<3>::Identity();
    F(0, 1) = shear;
    F(1, 1) = std::exp(dilation);
    point.F.col(0) = F.reshaped();
    material->respond(point, response);
    return Mat<3>(response.stress(0) * F.transpose() / F.determinant());
  };
  // Compressed without lateral strain, then sheared; the height follows by secants.
  double dilation = -normal_stress / (soil.bulk * 1.5), shear = 0.0;
  Mat<3> now;
  for (int step = 0; step < 4000; ++step) {
    shear = 0.05 * std::max(0, step - 100) / 3900.0;
    double a = dilation, b = dilation + 1e-6;
    double at_a = stress(shear, a)(1, 1) + normal_stress;
    for (int k = 0; k < 50 && std::abs(at_a) > 1e-12 * normal_stress; ++k) {
      const double at_b = stress(shear, b)(1, 1) + normal_stress;
      const double next = b - at_b * (b - a) / (at_b - at_a);
      a = std::exchange(b, next);
      at_a = at_b;
      if (a == b) break;
    }
    dilation = b;
    now = stress(shear, dilation);
    point.history.swap(response.history);
  }
  return now(0, 1) / -now(1, 1);
}

/// Mean of tau / sigma_n in the middle of a layer of sand on a rough floor that is pressed and then sheared at constant
/// volume: three rows at its top and columns at its ends move as a layer without end would.
inline double shear_ratio_of_layer(const Soil& soil, double spacing) {
  constexpr double length = 1.0, height = 0.2, pressure = 1e3;
  const SphOptions options{.spacing = spacing};
  Dynamics<2> dynamics({soil_block(length, height, options, soil)}, sph<2>(options), {.imbalance = 10.0});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = std::numeric_limits<double>::infinity()});
  const Points<2> X = dynamics.points();
  const double edge = 3.0 * spacing;
  const auto move_edges = [&](double along, double down) {
    for (Index a = 0; a < X.cols(); ++a) {
      if (X(1, a) < height - edge && X(0, a) > edge && X(0, a) < length - edge) continue;
      dynamics.prescribe(a, 0, along * X(1, a) / height);
      dynamics.prescribe(a, 1, -down * X(1, a) / height);
    }
  };
  const double strain = pressure / (soil.bulk * 3.0 * (1.0 - soil.nu) / (1.0 + soil.nu));
  move_edges(0.0, strain * height / 0.1);
  dynamics.run(0.1);
  move_edges(0.2 * height, 0.0);
  dynamics.run(1.1);
  const Tensors stress = dynamics.cauchy_stress();
  double shear = 0.0, normal = 0.0;
  for (Index a = 0; a < X.cols(); ++a) {
    if (std::abs(X(0, a) - 0.5 * length) > 0.2 * length || X(1, a) > height - 5.0 * spacing) continue;
    shear += stress(1, a);
    normal -= stress(4, a);
  }
  return shear / normal;
}

/// A smooth rigid footing is pushed into cohesive soil without weight: its mean pressure over (2 + pi) c (Prandtl 1920)
/// when it has sunk in by a tenth to a fifth of half its width. One half of it, of that width: `spacings`.
inline double footing_ratio(double spacings) {
  constexpr double half = 1.0, length = 5.0, height = 2.5, cohesion = 1e3, speed = 0.05;
  constexpr Soil clay{
      .density = 2000.0, .bulk = 1e6, .nu = 0.45, .cohesion = cohesion, .friction = 0.0, .dilatancy = 0.0};
  const SphOptions options{.spacing = half / spacings};
  Dynamics<2> dynamics({soil_block(length, height, options, clay)}, sph<2>(options), {.imbalance = 10.0});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = std::numeric_limits<double>::infinity()});
  dynamics.add_wall({.normal = {1.0, 0.0}, .level = 0.0});
  dynamics.add_wall({.normal = {-1.0, 0.0}, .level = -length});
  Points<2> corners(2, 4);
  corners << -half, half, half, -half, height, height, height + half, height + half;
  dynamics.add_rigid_body({.shape = rigid_shapes::solid<2>(corners, rigid_shapes::polygon(4)),
                           .velocity = [](double) { return Vec<2>(0.0, -speed); }});
  dynamics.run(0.1 * half / speed);
  const Vec<2> before = dynamics.rigid_bodies()[0].impulse;
  const double start = dynamics.time();
  dynamics.run(0.2 * half / speed);
  const double impulse = dynamics.rigid_bodies()[0].impulse[1] - before[1];
  return impulse / (dynamics.time() - start) / (half * (2.0 + std::numbers::pi) * cohesion);
}

/// A stiff block that slides down a plane with friction: its acceleration over the closed form, less one.
inline double sliding_error(double slope_degrees, double friction) {
  SphOptions options{.spacing = 0.05};
  options.viscosity.linear = 1.0;  // it does not rock
  const Soil stiff{.density = 2000.0, .bulk = 2e6, .nu = 0.2, .cohesion = 1e6, .friction = 30.0, .dilatancy = 0.0};
  Dynamics<2> dynamics({soil_block(1.0, 0.5, options, stiff)}, sph<2>(options), {.imbalance = 10.0});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = friction});
  const double angle = slope_degrees * std::numbers::pi / 180.0;
  // It is pressed on the plane slowly, so that it does not bounce; the plane tilts when it is at rest.
  const double normal = earth_gravity * std::cos(angle), along = earth_gravity * std::sin(angle);
  constexpr int stages = 50;
  for (int k = 1; k <= stages; ++k) {
    dynamics.set_gravity({0.0, -0.5 * normal * (1.0 - std::cos(std::numbers::pi * k / stages))});
    dynamics.run(1.0 * k / stages);
  }
  dynamics.set_gravity({along, -normal});
  // The closed form is that of a rigid block; this one begins to slide when a shear wave has gone through it.
  const auto run = [&](double until) {
    dynamics.run(until);
    return dynamics.point_velocities().row(0).mean();
  };
  const double before = run(1.3), start = dynamics.time(), after = run(3.0);
  return (after - before) / (dynamics.time() - start) / (along - friction * normal) - 1.0;
}

/// How a column of cohesive soil lies after its collapse.
struct Clumps {
  double closest = 0.0;      ///< smallest distance of two particles over the spacing
  double void_radius = 0.0;  ///< largest distance of a particle from its fourth neighbour (in space the sixth), over
                             ///< the spacing, outside bands where equivalent plastic strains are more than a half
  Index close_pairs = 0;     ///< closer than half the spacing
  double energy_error = 0.0, speed = 0.0;
};
/// Clay 2 m high, 4 m long in the plane and a quarter of 4 m by 4 m in space, falls down the free sides.
template <int Dim> Clumps cohesive_collapse(const SphOptions& options, double end) {
  constexpr Soil clay = soft_clay<Dim>;
  const auto body = [&] {
    if constexpr (Dim == 2)
      return soil_block(4.0, 2.0, options, clay);
    else
      return particles_on_lattice<3>(FineMesh<3>(solids::box({2.0, 2.0, 2.0}, 1.0)), SphFrame::updated, options,
                                     clay.material(), clay.density);
  }();
  Dynamics<Dim> dynamics({body}, sph<Dim>(options), {.imbalance = 10.0});
  const Vec<Dim> up = Vec<Dim>::Unit(Dim - 1);
  dynamics.add_wall({.normal = up, .level = 0.0, .friction = std::numeric_limits<double>::infinity()});
  for (int i = 0; i < Dim - 1; ++i) dynamics.add_wall({.normal = Vec<Dim>::Unit(i), .level = 0.0, .friction = 0.0});
  dynamics.set_gravity(-earth_gravity * up);
  dynamics.run(end);
  constexpr double in_band = 0.5;
  constexpr std::size_t around = 2 * Dim;
  const Points<Dim> x = dynamics.points();
  const Matrix flow = dynamics.history(0);
  internal::Neighbours<Dim> tree;
  tree.build(x);
  Clumps clumps{.closest = std::numeric_limits<double>::infinity()};
  for (Index a = 0; a < x.cols(); ++a) {
    std::vector<Index> near;
    tree.within(x.col(a), 3.0 * options.spacing, near);
    std::vector<double> distances;
    for (const Index b : near)
      if (b != a) distances.push_back((x.col(b) - x.col(a)).norm() / options.spacing);
    std::ranges::sort(distances);
    if (distances.empty()) continue;
    clumps.closest = std::min(clumps.closest, distances.front());
    clumps.close_pairs += std::ranges::count_if(distances, [](double d) { return d < 0.5; });
    if (distances.size() >= around && flow(6, a) < in_band)
      clumps.void_radius = std::max(clumps.void_radius, distances[around - 1]);
  }
  clumps.close_pairs /= 2;
  clumps.energy_error = dynamics.energy().largest_error();
  clumps.speed = speed_of_most(dynamics);
  return clumps;
}

/// A vertical cut in a soil with associated flow, held by nothing: the speed that 99 % of the particles stay below, 2 s
/// after its weight has grown for 1 s. A block of three heights between a smooth wall and nothing, on a rough floor.
inline double speed_of_cut(double height, double spacings) {
  constexpr Soil clay{
      .density = 1850.0, .bulk = 1.5e6, .nu = 0.3, .cohesion = 5e3, .friction = 25.0, .dilatancy = 25.0};
  SphOptions options{.spacing = height / spacings};
  options.viscosity.linear = 1.0;
  Dynamics<2> dynamics({soil_block(3.0 * height, height, options, clay)}, sph<2>(options), {.imbalance = 10.0});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = std::numeric_limits<double>::infinity()});
  dynamics.add_wall({.normal = {1.0, 0.0}, .level = 0.0, .friction = 0.0});
  constexpr int stages = 50;
  for (int k = 1; k <= stages; ++k) {
    dynamics.set_gravity({0.0, -0.5 * earth_gravity * (1.0 - std::cos(std::numbers::pi * k / stages))});
    dynamics.run(1.0 * k / stages);
  }
  dynamics.run(3.0);
  return speed_of_most(dynamics);
}

/// A cylinder of sand in space, 0.1 m high and wide: how far it runs out beyond its radius, over that; and the angle of
/// its slope.
struct Pile {
  double run_out = 0.0, angle = 0.0, speed = 0.0, energy_error = 0.0, seconds = 0.0;
  Index particles = 0;
};
inline Pile pile(double spacing) {
  constexpr double radius = 0.1, height = 0.1;
  constexpr Soil sand{.density = 2600.0,
                      .bulk = 5e6,
                      .nu = 0.3,
                      .cohesion = 0.0,
                      .friction = 30.0,
                      .dilatancy = 0.0,
                      .fit = ConeFit::compression};
  const SphOptions options{.spacing = spacing, .origin = {-radius, -radius, 0.0}};
  const FineMesh<3> mesh(solids::cylinder(radius, height, 0.02));
  const auto body = particles_on_lattice<3>(mesh, SphFrame::updated, options, sand.material(), sand.density);
  Dynamics<3> dynamics({body}, sph<3>(options), {.imbalance = 10.0});
  dynamics.add_wall({.normal = Vec<3>::UnitZ(), .level = 0.0, .friction = std::numeric_limits<double>::infinity()});
  dynamics.set_gravity({0.0, 0.0, -earth_gravity});
  const double start = seconds();
  dynamics.run(0.6);
  const Points<3> x = dynamics.points();
  const std::vector<char> is_of_pile = find_heap<3>(x, 2.0 * dynamics.world().nodes.radius);
  double furthest = 0.0, top = 0.0;
  for (Index a = 0; a < x.cols(); ++a) {
    if (is_of_pile[a] == 0) continue;
    furthest = std::max(furthest, x.col(a).head<2>().norm() + 0.5 * spacing);
    top = std::max(top, x(2, a) + 0.5 * spacing);
  }
  return {.run_out = (furthest - radius) / radius,
          .angle = std::atan(top / furthest) * 180.0 / std::numbers::pi,
          .speed = speed_of_most(dynamics),
          .energy_error = dynamics.energy().largest_error(),
          .seconds = seconds() - start,
          .particles = dynamics.num_points()};
}

}  // namespace efree::bench
