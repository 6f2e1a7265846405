// SPDX-License-Identifier: GPL-3.0-or-later
/// Scenes of the material point method with closed forms, for tests and benchmarks.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/particles.hpp"
#include "efree/dynamics/schemes/mpm/internal/spline.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/materials/rankine.hpp"

#include "clock.hpp"
#include "elastic_block.hpp"
#include "taylor_bar.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <numbers>
#include <vector>

namespace efree::bench {

/// The scheme of a body_on_lattice.
template <int Dim> std::unique_ptr<Scheme<Dim>> scheme_of(const MpmOptions& options, MpmFrame frame) {
  return frame == MpmFrame::total ? total_lagrangian<Dim>() : mpm<Dim>(options);
}

/// What moves with a velocity that a body begins with.
template <int Dim> const Points<Dim>& moving_of(const DeformableBody<Dim>& body) {
  return body.nodes.cols() > 0 ? body.nodes : body.points;
}

/// Velocities that a body begins with, by place.
template <int Dim, class Velocity> Points<Dim> velocity_by_place(const DeformableBody<Dim>& body, const Velocity& at) {
  const Points<Dim>& moving = moving_of(body);
  Points<Dim> result(Dim, moving.cols());
  for (Index a = 0; a < moving.cols(); ++a) result.col(a) = at(Vec<Dim>(moving.col(a)));
  return result;
}

/// A soft cube, or square, of edge 1 with two points along a cell of the grid, or of a mesh with edges half as long in
/// the plane, as long in space.
template <int Dim> DeformableBody<Dim> soft_block(const MpmOptions& options, MpmFrame frame = MpmFrame::updated) {
  const double size = frame == MpmFrame::mesh ? (Dim == 2 ? 0.5 : 1.0) * options.cell : 0.25;
  return body_on_lattice<Dim>(block<Dim>(1.0, size), frame, options, 2, soft(), 1.0);
}

/// What a block that vibrates and spins loses of its momenta, over these, in so many steps.
template <int Dim> std::pair<double, double> lost_momenta(const MpmOptions& options, Index steps,
                                                          MpmFrame frame = MpmFrame::updated, bool verbose = false) {
  DeformableBody<Dim> body = soft_block<Dim>(options, frame);
  body.velocity = velocity_by_place<Dim>(body, [](const Vec<Dim>& x) {
    Vec<Dim> v = Vec<Dim>::Constant(0.01);
    v[0] += 0.02 * std::cos(std::numbers::pi * x[0]) - 0.02 * x[1];
    v[1] += 0.02 * x[0];
    return v;
  });
  Dynamics<Dim> dynamics({body}, mpm<Dim>(options), {.imbalance = 10.0});
  const auto start = dynamics.balance();
  double linear = 0.0, angular = 0.0;
  for (Index k = 1; k <= steps; ++k) {
    dynamics.step();
    if (k % std::max<Index>(1, steps / 20) != 0) continue;
    const auto now = dynamics.balance();
    if (verbose)
      for (auto& e : now.energies.energies())
        if (e.value != 0) printf("%s %.4g  ", e.name.c_str(), e.value);
    if (verbose) printf(" total %.4g\n", now.total());
    linear = std::max(linear, (now.momentum - start.momentum).norm() / start.momentum.norm());
    angular = std::max(angular, (now.angular_momentum - start.angular_momentum).norm() / start.angular_momentum.norm());
  }
  return {linear, angular};
}

/// A bar of length 1 with free ends in its first mode.
struct Vibration {
  double frequency_error;  ///< over pi c / L, less one
  double lost;             ///< of its energy in four periods
  double gained;           ///< the most that it ever had more than at the start
  double stress;           ///< largest of the points in the middle half, over all steps
};

/// For four periods, while the bar flies so many cells along itself.
inline Vibration vibrate(const MpmOptions& options, double cells = 0.0) {
  constexpr double speed = 1e-4, periods = 4.0;
  const double height = 4.0 * options.cell;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, height), {.size = 0.25});
  DeformableBody<2> body = points_on_lattice<2>(mesh, options, 2, soft(0.0), 1.0);
  const auto mode = [](double x) { return std::cos(std::numbers::pi * x); };
  const double period = 2.0, drift = cells * options.cell / (periods * period);
  body.velocity = velocity_by_place<2>(body, [&](const Vec<2>& x) { return Vec<2>(speed * mode(x[0]) + drift, 0.0); });
  Vector shape(body.points.cols());
  for (Index p = 0; p < shape.size(); ++p) shape[p] = body.volumes[p] * mode(body.points(0, p));
  const Points<2> X = body.points;
  Dynamics<2> dynamics({body}, mpm<2>(options));
  const double mass = body.volumes.sum(), start = dynamics.balance()["kinetic"] - 0.5 * mass * drift * drift;
  Vibration result{0.0, 0.0, 0.0, 0.0};
  double last = 0.0, last_time = 0.0, crossed = 0.0;
  int crossings = 0;
  while (dynamics.time() < periods * period) {
    dynamics.step();
    // The displacement in the mode passes zero at halves of a period.
    const Points<2> x = dynamics.points();
    double now = 0.0;
    for (Index p = 0; p < shape.size(); ++p) now += shape[p] * (x(0, p) - X(0, p) - drift * dynamics.time());
    const double time = dynamics.time();
    if (now * last < 0.0) {
      ++crossings;
      crossed = last_time + (time - last_time) * last / (last - now);
    }
    last = now;
    last_time = time;
    const Tensors stress = dynamics.cauchy_stress();
    for (Index p = 0; p < X.cols(); ++p)
      if (X(0, p) > 0.25 && X(0, p) < 0.75) result.stress = std::max(result.stress, std::abs(stress(0, p)));
    const auto balance = dynamics.balance();
    const double energy = balance["kinetic"] + balance["stored"] - 0.5 * mass * drift * drift;
    result.gained = std::max(result.gained, energy / start - 1.0);
    result.lost = 1.0 - energy / start;
  }
  result.frequency_error = 0.5 * crossings * period / crossed - 1.0;
  return result;
}

/// Velocities of points whose sums on the grid are nothing: how much of them is left after a step.
inline double noise_left(Transfer transfer) {
  const MpmOptions options{.cell = 0.125, .transfer = transfer, .flip = 1.0};
  DeformableBody<2> body = splines_on_lattice<2>(block<2>(1.0, 0.25), options, 4, soft(), 1.0);
  const Matrix to_nodes = Matrix(body.shape->matrix().transpose()) * body.volumes.asDiagonal();
  body.nodes.resize(2, 0);
  const Matrix basis = Eigen::HouseholderQR<Matrix>(to_nodes.transpose()).householderQ() *
                       Matrix::Identity(to_nodes.cols(), to_nodes.rows());
  body.velocity.setZero(2, body.points.cols());
  for (Index p = 0; p < body.points.cols(); ++p)
    body.velocity.col(p) << std::sin(12.9898 * p + 1.0), std::sin(78.233 * p + 2.0);
  body.velocity *= 1e-3;
  body.velocity -= body.velocity * basis * basis.transpose();
  const double before = body.velocity.norm();
  Dynamics<2> dynamics({body}, mpm<2>(options));
  dynamics.step();
  return dynamics.point_velocities().norm() / before;
}

/// A force per mass on the points, by point and time. Of points without a
/// table the nodes are those of the grid.
class PointForce final : public Interaction<2> {
 public:
  using Force = std::function<Vec<2>(Index, double)>;
  PointForce(Force force, const MpmOptions& options) : force_(std::move(force)), options_(options) {}
  void add_forces(World<2>& world) override {
    const bool has_tables = !world.chunks.front().table.entries.empty();
    const Vec<2> low = world.nodes.x.rowwise().minCoeff();
    const auto site_of = [&](const Vec<2>& x) {
      return std::pair(std::lround((x[0] - low[0]) / options_.cell), std::lround((x[1] - low[1]) / options_.cell));
    };
    std::vector<Index> node_at;
    const auto [last, width] = site_of(world.nodes.x.rowwise().maxCoeff());
    if (!has_tables) node_at.assign(static_cast<std::size_t>((last + 1) * (width + 1)), -1);
    for (Index a = 0; a < world.nodes.size() && !has_tables; ++a) {
      const auto [i, j] = site_of(world.nodes.x.col(a));
      node_at[static_cast<std::size_t>(i * (width + 1) + j)] = a;
    }
    for (const auto& chunk : world.chunks)
      for (Index p = 0; p < chunk.size(); ++p) {
        const Vec<2> x = chunk.matter.x.col(p);
        const Vec<2> f = chunk.matter.mass[p] * force_(world.point_number(chunk, p), world.time);
        for (const auto& [a, entry] : chunk.table.row(p)) world.nodes.force.col(a) += entry.N * f;
        if (has_tables) continue;
        internal::SplineRow<2> along[2];
        for (int i = 0; i < 2; ++i) internal::evaluate_spline<2>((x[i] - low[i]) / options_.cell, along[i]);
        // Around the middle of a cell there may be nodes, of next to no weight, that none of its vertices has.
        std::array<std::pair<Index, double>, 9> around;
        double sum = 0.0;
        for (std::size_t k = 0; k < 9; ++k) {
          const std::ptrdiff_t i = along[0].first + static_cast<std::ptrdiff_t>(k / 3),
                               j = along[1].first + static_cast<std::ptrdiff_t>(k % 3);
          const bool inside = i >= 0 && j >= 0 && i <= last && j <= width;
          around[k] = {inside ? node_at[static_cast<std::size_t>(i * (width + 1) + j)] : -1,
                       along[0].N[k / 3] * along[1].N[k % 3]};
          if (around[k].first >= 0) sum += around[k].second;
        }
        for (const auto& [node, N] : around)
          if (node >= 0) world.nodes.force.col(node) += N / sum * f;
      }
  }

 private:
  Force force_;
  MpmOptions options_;
};

/// A force of that much times the mass against the velocity of every node [1/time].
class Damping final : public Interaction<2> {
 public:
  explicit Damping(double rate) : rate_(rate) {}
  void add_forces(World<2>& world) override {
    world.nodes.force -= rate_ * world.nodes.v * world.nodes.mass.asDiagonal();
  }

 private:
  double rate_;
};

/// A ring that turns about itself by g(t) k(r), by a body force that makes this the exact motion (de Vaucorbeil, Nguyen
/// & Hutchinson 2020): root mean square of the error of the points' positions, the largest at quarters
/// of the time until then.
inline double vortex_error(const MpmOptions& options, MpmFrame frame, double until = 1.0, Index points_along = 2) {
  constexpr double E = 1e6, nu = 0.3, rho = 1050.0, m = E / (2.0 * (1.0 + nu)) / rho, pi = std::numbers::pi;
  const auto k = [](double r) { return 1.0 - 32.0 * std::pow(r - 1.0, 2) + 256.0 * std::pow(r - 1.0, 4); };
  const auto k1 = [](double r) { return -64.0 * (r - 1.0) + 1024.0 * std::pow(r - 1.0, 3); };
  const auto k2 = [](double r) { return -64.0 + 3072.0 * std::pow(r - 1.0, 2); };
  const double size = frame == MpmFrame::mesh ? options.cell / static_cast<double>(points_along) : 0.02;
  const FineMesh<2> mesh = triangulate(shapes::annulus(0.75, 1.25, size, 1e-5), {.size = size});
  const SharedMaterial material = NeoHookean({.E = E, .nu = nu});
  DeformableBody<2> body = body_on_lattice<2>(mesh, frame, options, points_along, material, rho);
  body.patches.clear();
  const auto start = [&](const Vec<2>& x) { return Vec<2>(pi * k(x.norm()) * Vec<2>(-x[1], x[0])); };
  // The parts of the force at a point are means over a square of its area: taken at its middle they would turn the
  // ring.
  Matrix parts = Matrix::Zero(4, body.points.cols());
  constexpr int n = 8;
  for (Index p = 0; p < body.points.cols(); ++p) {
    const double r0 = body.points.col(p).norm(), edge = std::sqrt(body.volumes[p]);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        const double r = (body.points.col(p) + edge / n * (Vec<2>(i, j) - Vec<2>::Constant(0.5 * (n - 1)))).norm();
        parts.col(p) += r / r0 / (n * n) *
                        Vec<4>(m * r * k1(r) * k1(r), -r * k(r) * k(r), r * k(r), -m * (3.0 * k1(r) + r * k2(r)));
      }
  }
  const Points<2> places = body.points;
  const auto force = [=](Index p, double t) {
    const double g = std::sin(pi * t), g1 = pi * std::cos(pi * t), g2 = -pi * pi * g, r = places.col(p).norm();
    const Vec<2> radial = Eigen::Rotation2Dd(g * k(r)) * places.col(p) / r, around(-radial[1], radial[0]);
    return Vec<2>((parts(0, p) * g * g + parts(1, p) * g1 * g1) * radial +
                  (parts(2, p) * g2 + parts(3, p) * g) * around);
  };
  const Points<2> X = body.points, &moving = moving_of(body);
  body.velocity.resize(2, moving.cols());
  for (Index a = 0; a < moving.cols(); ++a) body.velocity.col(a) = start(moving.col(a));
  Dynamics<2> dynamics({body}, scheme_of<2>(options, frame), {.imbalance = 1e30});
  dynamics.add_interaction(std::make_unique<PointForce>(force, options));
  dynamics.step(1e-9);  // with the forces of the start
  double worst = 0.0;
  for (int quarter = 1; quarter <= 4; ++quarter) {
    dynamics.run(0.25 * quarter * until);
    const Points<2> x = dynamics.points();
    double sum = 0.0;
    for (Index p = 0; p < X.cols(); ++p) {
      const double angle = std::sin(pi * dynamics.time()) * k(X.col(p).norm());
      sum += (x.col(p) - Eigen::Rotation2Dd(angle) * X.col(p)).squaredNorm();
    }
    worst = std::max(worst, std::sqrt(sum / static_cast<double>(X.cols())));
  }
  return worst;
}

/// A block that slides down a wall of that slope [degrees], from rest: its travel over that of Coulomb's friction.
inline double sliding_travel(double slope, double friction, const MpmOptions& options) {
  const double tilt = slope * std::numbers::pi / 180.0, gravity = 10.0, until = 1.0;
  const Eigen::Rotation2Dd turn(-tilt);
  MeshData<2> data;
  const FineMesh<2> flat = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.1});
  data.vertices = turn.toRotationMatrix() * flat.vertices();
  data.cells = flat.cells();
  DeformableBody<2> body =
      points_on_lattice<2>(FineMesh<2>(data), options, 2, NeoHookean({.E = 1e7, .nu = 0.3}), 1000.0);
  Dynamics<2> dynamics({body}, mpm<2>(options));
  dynamics.add_wall({.normal = turn * Vec<2>::UnitY(), .friction = friction});
  dynamics.set_gravity({0.0, -gravity});
  const Vec<2> start = dynamics.points().rowwise().mean();
  dynamics.run(until);
  const Vec<2> travel = dynamics.points().rowwise().mean() - start;
  const double expected = 0.5 * gravity * (std::sin(tilt) - friction * std::cos(tilt)) * until * until;
  return travel.dot(turn * Vec<2>::UnitX()) / expected;
}

/// Two discs that bounce off each other.
struct Bounce {
  double gap_at_first_force;  ///< between them, over the cell
  double force_after;         ///< largest change of momentum a step once they are two cells apart again, over the whole
  double restitution;         ///< speed after over that before, of the centres
  double momentum_error;      ///< over the momentum of one
};
inline Bounce bounce_discs(const MpmOptions& options) {
  constexpr double radius = 0.2, apart = 0.1, speed = 0.1;
  const auto disc = [&](double x, double v) {
    Polyline circle{.name = "", .points = {}};
    for (int k = 0; k <= 64; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k % 64) / 64.0;
      circle.points.emplace_back(x + radius * std::cos(angle), 0.013 + radius * std::sin(angle));
    }
    DeformableBody<2> body =
        points_on_lattice<2>(triangulate({.boundary = {circle}}, {.size = 0.02}), options, 2, soft(), 1.0);
    body.velocity = velocity_by_place<2>(body, [&](const Vec<2>&) { return Vec<2>(v, 0.0); });
    return body;
  };
  const double centre = radius + 0.5 * apart;
  Dynamics<2> dynamics({disc(-centre, speed), disc(centre, -speed)}, mpm<2>(options));
  const Index n = dynamics.first_point(1);
  Vector m(dynamics.num_points());
  for (Index p = 0; p < m.size(); ++p) {
    const auto [chunk, k] = dynamics.world().locate(p);
    m[p] = chunk.matter.mass[k];
  }
  const auto state = [&] {
    const Points<2> x = dynamics.points(), v = dynamics.point_velocities();
    return std::pair(Vec<2>(v.leftCols(n) * m.head(n)),
                     x.row(0).tail(x.cols() - n).minCoeff() - x.row(0).head(n).maxCoeff() - 0.5 * options.cell);
  };
  const Vec<2> start = state().first;
  Bounce result{0.0, 0.0, 0.0, 0.0};
  Vec<2> before = start;
  bool touched = false, apart_again = false;
  while (dynamics.time() < 4.0 * apart / speed) {
    dynamics.step();
    const auto [momentum, gap] = state();
    const double change = (momentum - before).norm() / start.norm();
    if (!touched && change > 1e-9) {
      touched = true;
      result.gap_at_first_force = gap / options.cell;
    }
    if (touched && momentum[0] < 0.0 && gap > 2.0 * options.cell) apart_again = true;
    if (apart_again) result.force_after = std::max(result.force_after, change);
    before = momentum;
    result.momentum_error = std::max(result.momentum_error, dynamics.balance().momentum.norm() / start.norm());
  }
  result.restitution = -before[0] / start[0];
  return result;
}

/// A strip 20 by 40 points whose ends move apart at a fiftieth of the speed of sound.
struct StretchedStrip {
  double scatter;      ///< standard deviation over mean of the axial stress in the middle half at a stretch of 1.3
  double reported_at;  ///< stretch at the first report of points that lose each other; 0: none until a stretch of `to`
  double gap_at;       ///< stretch at which a distance of neighbours along the axis is twice the mean; 0: none
};
inline StretchedStrip stretch_strip(const MpmOptions& options, MpmFrame frame, double to, Index points_along = 2) {
  constexpr double rate = 1e-3;
  const double size = frame == MpmFrame::mesh ? options.cell / static_cast<double>(points_along) : 2.0;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 20.0, 40.0), {.size = size});
  const SharedMaterial material = NeoHookean({.E = 1.0, .nu = 0.3});
  DeformableBody<2> body = body_on_lattice<2>(mesh, frame, options, points_along, material, 1.0);
  body.patches.clear();  // it does not lock
  const Points<2> X = body.points, &moving = moving_of(body);
  body.velocity.setZero(2, moving.cols());
  for (Index a = 0; a < moving.cols(); ++a) body.velocity(1, a) = rate * (moving(1, a) - 20.0);
  std::vector<Index> ends;
  for (Index p = 0; p < X.cols(); ++p)
    if (std::abs(X(1, p) - 20.0) > 18.0) ends.push_back(p);
  Dynamics<2> dynamics({body}, scheme_of<2>(options, frame));
  if (frame == MpmFrame::total) {
    for (const Index a : nodes_of_points(body, ends)) dynamics.prescribe(a, 1, body.velocity(1, a));
  } else {
    Vector speeds(static_cast<Index>(ends.size()));
    for (std::size_t k = 0; k < ends.size(); ++k) speeds[static_cast<Index>(k)] = rate * (X(1, ends[k]) - 20.0);
    dynamics.prescribe_points(ends, 1, speeds);
  }
  StretchedStrip result{0.0, 0.0, 0.0};
  const auto stretch = [&] { return 1.0 + rate * dynamics.time(); };
  for (double next = 1.02; next < to + 1e-9; next += 0.02) {
    dynamics.run((next - 1.0) / rate);
    if (result.reported_at == 0.0 && dynamics.count("separated points") > 0) result.reported_at = stretch();
    std::vector<double> along;
    const Points<2> x = dynamics.points();
    for (Index p = 0; p < X.cols(); ++p)
      if (std::abs(X(0, p) - X(0, X.cols() / 2)) < 0.1) along.push_back(x(1, p));
    std::ranges::sort(along);
    for (std::size_t k = 1; k < along.size(); ++k)
      if (result.gap_at == 0.0 &&
          along[k] - along[k - 1] > 2.0 * stretch() * options.cell / static_cast<double>(points_along))
        result.gap_at = stretch();
    if (std::abs(next - 1.3) > 1e-9) continue;
    const Tensors sigma = dynamics.cauchy_stress();
    double count = 0.0, sum = 0.0, squares = 0.0;
    for (Index p = 0; p < X.cols(); ++p) {
      if (std::abs(X(1, p) - 20.0) > 10.0) continue;
      ++count;
      sum += sigma(4, p);
      squares += sigma(4, p) * sigma(4, p);
    }
    result.scatter = std::sqrt(std::max(squares / count - sum * sum / (count * count), 0.0)) / (sum / count);
  }
  return result;
}

/// Taylor's bar at 227 m/s.
struct TaylorRun {
  TaylorBar::Shape shape;  ///< of points, that end half of their size further
  Index points, steps;
  double energy_error, seconds;
};
inline TaylorRun run_taylor(const MpmOptions& options, MpmFrame frame, double until) {
  const FineMesh<3> mesh = TaylorBar::mesh<3>(frame == MpmFrame::mesh ? options.cell : 0.8e-3);
  DeformableBody<3> body = body_on_lattice<3>(mesh, frame, options, 2, TaylorBar::copper(), TaylorBar::density);
  body.velocity.setZero(3, moving_of(body).cols());
  body.velocity.row(2).setConstant(-227.0);
  Dynamics<3> dynamics({body}, scheme_of<3>(options, frame));
  dynamics.add_wall({.normal = Vec<3>::UnitZ()});
  const double start = cpu_seconds();
  dynamics.run(until);
  TaylorRun run{{0.0, 0.0, dynamics.history(0).row(6).maxCoeff()},
                dynamics.num_points(),
                dynamics.steps(),
                dynamics.energy().largest_error(),
                cpu_seconds() - start};
  const Points<3> x = dynamics.points();
  for (Index p = 0; p < x.cols(); ++p) {
    const auto [chunk, k] = dynamics.world().locate(p);
    const auto half = [&](const Vec<3>& normal) { return internal::half_size<3>(chunk.matter, k, normal); };
    run.shape.length = std::max(run.shape.length, x(2, p) + half(Vec<3>::UnitZ()));
    const Vec<3> radial(x(0, p), x(1, p), 0.0);
    if (x(2, p) - half(Vec<3>::UnitZ()) < 0.01 * TaylorBar::length)
      run.shape.foot = std::max(run.shape.foot, radial.norm() + half(radial.normalized()));
  }
  return run;
}

/// A strip 1 by 1, strong at its ends, with a notch, 0.3 deep, that is torn through the ligament of 0.7 left of it:
/// what Rankine's material dissipates over strength^2 / E times the ligament, at a strength of 0.01.
inline double torn_strip_dissipation(const MpmOptions& options, double softening, Index points_along = 2) {
  constexpr double speed = 0.003, ligament = 0.7;
  const Polyline outline{.name = "",
                         .points = {{0.0, 0.0},
                                    {1.0, 0.0},
                                    {1.0, 1.0},
                                    {0.0, 1.0},
                                    {0.0, 0.53},
                                    {0.3, 0.53},
                                    {0.3, 0.47},
                                    {0.0, 0.47},
                                    {0.0, 0.0}}};
  const FineMesh<2> mesh = triangulate({.boundary = {outline}}, {.size = 0.1});
  const SharedMaterial material =
      Rankine({.moduli = {.E = 1.0, .nu = 0.2},
               .strength = Parameter([](const Vec<3>& at) { return std::abs(at[1] - 0.5) > 0.3 ? 1.0 : 0.01; }),
               .softening = softening});
  DeformableBody<2> body = points_on_lattice<2>(mesh, options, points_along, material, 1.0);
  body.patches.clear();
  const Points<2> X = body.points;
  std::vector<Index> ends[2];
  for (Index p = 0; p < X.cols(); ++p)
    if (std::abs(X(1, p) - 0.5) > 0.5 - options.cell) ends[X(1, p) > 0.5 ? 1 : 0].push_back(p);
  body.velocity = velocity_by_place<2>(body, [&](const Vec<2>& x) { return Vec<2>(0.0, speed * (2.0 * x[1] - 1.0)); });
  Dynamics<2> dynamics({body}, mpm<2>(options));
  for (const int side : {0, 1})
    dynamics.prescribe_points(ends[side], 1, Vector::Constant(std::ssize(ends[side]), side == 0 ? -speed : speed));
  dynamics.run(0.045 / speed);
  return dynamics.balance()["dissipated"] / ligament;
}

/// Cook's membrane (cook.hpp) under a thousandth of its load, relaxed by damping: a thousand times the deflection of
/// the middle of the right side. nu: Poisson's ratio; patches: points of a cell share their mean dilatation.
inline double cook_deflection(double cell, double nu, MpmFrame frame, bool patches = true) {
  constexpr double load = 0.1, density = 1.0;
  const MpmOptions options{.cell = cell};
  const FineMesh<2> mesh = triangulate(shapes::cook(), {.size = 1.0});
  const SharedMaterial material = NeoHookean({.E = 240.565, .nu = nu});
  DeformableBody<2> body = body_on_lattice<2>(mesh, frame, options, 2, material, density);
  if (!patches) body.patches.clear();
  const Points<2> X = body.points;
  // On the last layer of points; about 1.3 periods of the slowest motion, damped nearly critically.
  double loaded = 0.0;
  for (Index p = 0; p < X.cols(); ++p)
    if (X(0, p) > 48.0 - 0.5 * cell) loaded += density * body.volumes[p];
  Dynamics<2> dynamics({body}, scheme_of<2>(options, frame), {.imbalance = 1e30});
  dynamics.prescribe([](const Vec<2>& x) { return x[0] < 1e-9; }, 0, 0.0);
  dynamics.prescribe([](const Vec<2>& x) { return x[0] < 1e-9; }, 1, 0.0);
  dynamics.add_interaction(std::make_unique<PointForce>(
      [=](Index p, double) { return X(0, p) > 48.0 - 0.5 * cell ? Vec<2>(0.0, load / loaded) : Vec<2>(0.0, 0.0); },
      options));
  dynamics.add_interaction(std::make_unique<Damping>(0.35));
  dynamics.run(70.0);
  const Vec<2> place(48.0, 52.0);
  Index tip = 0;
  (X.colwise() - place).colwise().norm().minCoeff(&tip);
  const Tensors F = dynamics.deformation();
  const double change = F(1, tip) * (place[0] - X(0, tip)) + (F(4, tip) - 1.0) * (place[1] - X(1, tip));
  return 1e3 * (dynamics.points()(1, tip) - X(1, tip) + change);
}

}  // namespace efree::bench
