// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/mass_scaling.hpp"

#include "efree/dynamics/internal/mass_scaling.hpp"
#include "efree/dynamics/masses.hpp"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

/// Samples kept of a run.
constexpr std::size_t most_samples = 2048;
/// Internal energy over the largest, below which a ratio to it has no meaning.
constexpr double least_internal_energy = 0.1;
/// By what accelerations of mean velocities are too small: a jump of a velocity, anywhere in the time of a mean,
/// changes this by half of it in the mean.
constexpr double jump_correction = 2.0;
/// Products with the stiffness of an estimate of the stable step.
constexpr Index products_of_estimate = 40;

/// The bound of a point on the squared angular frequency, times its mass: that of its stiffness on the nodes of its
/// row, with equal parts of the mass on as many nodes as its shape functions count.
template <int Dim> double stiffness_bound(const Chunk<Dim>& chunk, Index p) {
  const Matter<Dim>& matter = chunk.matter;
  Mat<Dim> gradients = Mat<Dim>::Zero();
  double squares = 0.0;
  for (const auto& [a, entry] : chunk.table.row(p)) {
    const Vec<Dim> dN = Eigen::Map<const Vec<Dim>>(entry.dN);
    gradients += dN * dN.transpose();
    squares += entry.N * entry.N;
  }
  if (!(squares > 0.0)) return 0.0;
  Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
  axes.computeDirect(gradients, Eigen::EigenvaluesOnly);
  const double strained = matter.volume[p] * matter.modulus[p] * axes.eigenvalues()[Dim - 1] / squares;
  return strained + chunk.support.stabilisation[p];
}

template <int Dim> void set_added_masses(World<Dim>& world, const std::vector<Vector>& bounds, double wanted) {
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Matter<Dim>& matter = world.chunks[c].matter;
    for (Index p = 0; p < matter.size(); ++p) {
      const double own = matter.own_mass(p), more = std::max(0.0, bounds[c][p] / wanted - own);
      matter.added_mass[p] = more;
      matter.mass[p] = own + more;
    }
  }
}

template <int Dim> void estimate_again(World<Dim>& world, internal::StableStep<Dim>& stable) {
  world.stable_step = std::numeric_limits<double>::infinity();  // nothing is known
  stable.estimate(world, products_of_estimate);
}

}  // namespace

void AddedInertia::add(const InertiaSample& sample) {
  for (double InertiaSample::*value :
       {&InertiaSample::kinetic, &InertiaSample::internal, &InertiaSample::stored, &InertiaSample::inertia,
        &InertiaSample::stress, &InertiaSample::force, &InertiaSample::displacement})
    largest_.*value = std::max(largest_.*value, sample.*value);
  work_ = std::max(work_, sample.internal + sample.stored);
  if (count_++ % interval_ != 0) return;
  if (samples_.size() == most_samples) {
    for (std::size_t k = 0; 2 * k < most_samples; ++k) samples_[k] = samples_[2 * k];
    samples_.resize(most_samples / 2);
    interval_ *= 2;
  }
  samples_.push_back(sample);
}

double AddedInertia::error() const {
  const auto over = [](double part, double whole) {
    if (!(part > 0.0)) return 0.0;
    return whole > 0.0 ? part / whole : std::numeric_limits<double>::infinity();
  };
  return std::max(over(largest_.inertia, largest_.stress),
                  over(std::sqrt(largest_.force * largest_.displacement), work_));
}

double AddedInertia::ratio(double share) const {
  const double largest = largest_.internal;
  std::vector<double> ratios;
  for (const InertiaSample& sample : samples_)
    if (sample.internal > 0.0 && sample.internal >= least_internal_energy * largest)
      ratios.push_back(sample.kinetic / sample.internal);
  if (ratios.empty()) return largest_.kinetic > 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
  std::ranges::sort(ratios);
  return ratios[static_cast<std::size_t>(std::ceil(share * static_cast<double>(ratios.size()))) - 1];
}

template <int Dim>
void internal::add_masses(World<Dim>& world, Scheme<Dim>& scheme, internal::StableStep<Dim>& stable) {
  const double wanted_step = world.options.mass_scaling.step;
  if (!(wanted_step > 0.0)) return;
  std::vector<Vector> bounds(world.chunks.size());
  double fastest = 0.0;
  for (std::size_t c = 0; c < bounds.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    chunk.matter.added_mass.setZero(chunk.size());
    bounds[c].setZero(chunk.size());
    for (Index p = 0; p < chunk.size(); ++p) {
      if (chunk.is_eroded(p)) continue;
      bounds[c][p] = stiffness_bound(chunk, p);
      fastest = std::max(fastest, bounds[c][p] / chunk.matter.mass[p]);
    }
  }
  const Vector real = world.nodes.mass;
  scheme.find_masses(world);  // or it cannot
  world.nodes.added_mass.setZero(world.nodes.size());
  if (!(fastest > 0.0) || !(world.stable_step > 0.0)) return;
  // Squared frequencies in units of the fastest bound, which is the one that the stable step has.
  double calibration = 1.0;
  constexpr int most_rounds = 20;
  constexpr double reached = 0.995;
  const double step_before = world.stable_step;
  for (int round = 0; world.stable_step < reached * wanted_step; ++round) {
    if (round == most_rounds)
      throw NumericalError(
          fmt::format("mass scaling: the stable step is {:.3g} with the masses added so far, and {:.3g} "
                      "is wanted: expected a smaller step",
                      world.stable_step, wanted_step));
    if (round > 0) calibration *= std::pow(wanted_step / world.stable_step, 2);
    set_added_masses(world, bounds, fastest * std::pow(step_before / wanted_step, 2) / calibration);
    scheme.find_masses(world);
    world.nodes.added_mass = world.nodes.mass - real;
    world.find_free_axes();
    estimate_again(world, stable);
  }
  find_momenta(world);
}

template <int Dim> void internal::change_mass_scaling(World<Dim>& world, Scheme<Dim>& scheme,
                                                      internal::StableStep<Dim>& stable, const MassScaling& before) {
  if (before == world.options.mass_scaling) return;
  for (Chunk<Dim>& chunk : world.chunks) {
    Matter<Dim>& matter = chunk.matter;
    for (Index p = 0; p < matter.size(); ++p)
      matter.mass[p] = matter.own_mass(p) / before.factor * world.options.mass_scaling.factor;
    matter.added_mass.resize(0);
  }
  world.nodes.added_mass.resize(0);
  scheme.find_masses(world);
  world.find_free_axes();
  find_momenta(world);
  estimate_again(world, stable);
  add_masses(world, scheme, stable);
}

template <int Dim> std::vector<BodyMass> internal::body_masses(const World<Dim>& world) {
  std::vector<BodyMass> result(static_cast<std::size_t>(world.num_bodies()));
  for (const Chunk<Dim>& chunk : world.chunks) {
    BodyMass& body = result[static_cast<std::size_t>(chunk.body)];
    for (Index p = 0; p < chunk.size(); ++p) {
      const double real = chunk.matter.own_mass(p) / world.options.mass_scaling.factor;
      body.real += real;
      body.added += chunk.matter.mass[p] - real;
      body.points += chunk.matter.own_mass(p) < chunk.matter.mass[p] ? 1 : 0;
    }
  }
  return result;
}

template <int Dim> void internal::InertiaSampling<Dim>::begin(const World<Dim>& world) {
  time_ = world.time;
  step_ = world.steps;
  start_ = x_ = positions(world);
  v_.resize(Dim, 0);
  interval_ = std::numeric_limits<double>::infinity();
  for (Index b = 0; b < world.num_bodies(); ++b) {
    Eigen::AlignedBox<double, Dim> box;
    double slowness = 0.0;  // squared, the largest
    for (const Chunk<Dim>& chunk : world.chunks) {
      if (chunk.body != b) continue;
      const Matter<Dim>& matter = chunk.matter;
      for (Index p = 0; p < chunk.size(); ++p) {
        box.extend(Vec<Dim>(matter.x.col(p)));
        if (!chunk.is_eroded(p)) slowness = std::max(slowness, matter.mass[p] / matter.volume[p] / matter.modulus[p]);
      }
    }
    if (slowness > 0.0) interval_ = std::min(interval_, box.sizes().maxCoeff() * std::sqrt(slowness));
  }
}

template <int Dim> Points<Dim> internal::InertiaSampling<Dim>::positions(const World<Dim>& world) {
  Points<Dim> result(Dim, world.num_points());
  for (const Chunk<Dim>& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p) result.col(world.point_number(chunk, p)) = chunk.matter.x.col(p);
  return result;
}

template <int Dim> void internal::InertiaSampling<Dim>::sample(const World<Dim>& world, AddedInertia& to) {
  constexpr Index least_steps = 16;
  const double elapsed = world.time - time_;
  if (elapsed < 0.0) return begin(world);
  const bool is_first_step = v_.cols() == 0 && world.steps == step_ + 1;
  if (!is_first_step && (world.steps - step_ < least_steps || elapsed < interval_)) return;
  const Points<Dim> x = positions(world);
  if (x.cols() != x_.cols()) return begin(world);  // other points
  const Points<Dim> v = (x - x_) / elapsed;
  if (v_.cols() == v.cols()) to.add(measure(world, v, (v - v_) / elapsed));
  v_ = v;
  if (is_first_step) return;  // loads that act at once change the velocities in the first interval
  x_ = x;
  time_ = world.time;
  step_ = world.steps;
}

template <int Dim> InertiaSample internal::InertiaSampling<Dim>::measure(const World<Dim>& world, const Points<Dim>& v,
                                                                         const Points<Dim>& a) const {
  struct Body {
    Eigen::AlignedBox<double, Dim> box;
    double mass = 0.0, force = 0.0, second_moment = 0.0;  ///< added; of displacements
    Vec<Dim> moment = Vec<Dim>::Zero();
  };
  std::vector<Body> bodies(static_cast<std::size_t>(world.num_bodies()));
  InertiaSample result;
  for (const Chunk<Dim>& chunk : world.chunks) {
    Body& body = bodies[static_cast<std::size_t>(chunk.body)];
    result.internal += chunk.stored + chunk.dissipated;
    result.stored += chunk.stored;
    for (Index p = 0; p < chunk.size(); ++p) {
      const Matter<Dim>& matter = chunk.matter;
      const Index number = world.point_number(chunk, p);
      const double added = matter.mass[p] - matter.own_mass(p) / world.options.mass_scaling.factor;
      const double acceleration = jump_correction * a.col(number).norm() + world.options.damping * v.col(number).norm();
      const Vec<Dim> u = matter.x.col(p) - start_.col(number);
      result.kinetic += 0.5 * added * v.col(number).squaredNorm();
      result.force += added * acceleration * acceleration;
      result.stress += matter.volume[p] * matter.P.col(p).norm();
      body.mass += added;
      body.force += added * acceleration;
      body.moment += added * u;
      body.second_moment += added * u.squaredNorm();
      body.box.extend(Vec<Dim>(matter.x.col(p)));
    }
  }
  for (const Body& body : bodies) {
    if (body.box.isEmpty()) continue;
    result.inertia += body.box.sizes().maxCoeff() * body.force;
    if (body.mass > 0.0)
      result.displacement += std::max(0.0, body.second_moment - body.moment.squaredNorm() / body.mass);
  }
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                                       \
  template void internal::add_masses(World<Dim>&, Scheme<Dim>&, internal::StableStep<Dim>&);         \
  template void internal::change_mass_scaling(World<Dim>&, Scheme<Dim>&, internal::StableStep<Dim>&, \
                                              const MassScaling&);                                   \
  template std::vector<BodyMass> internal::body_masses(const World<Dim>&);                           \
  template class internal::InertiaSampling<Dim>;
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
