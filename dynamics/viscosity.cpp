// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/points.hpp"

#include <Eigen/Eigenvalues>

namespace efree {
namespace {

/// Of a point under compression.
struct Viscosity {
  double length;   ///< spacing of nodes along the fastest compression
  double sound;    ///< speed of pressure waves
  double highest;  ///< highest frequency of the point
  /// Part of the critical damping at that frequency, by a pressure of density times length times this times the rate.
  double damping(double speed) const { return 0.5 * highest * length * speed / (sound * sound); }
};

/// By the compression from one of Chunk::recent_gradients to another.
template <int Dim> Viscosity viscosity_of(const World<Dim>& world, const Chunk<Dim>& chunk, Index p,
                                          const Mat<3>& recent, const Mat<3>& before) {
  const Support<Dim>& support = chunk.support;
  const Matter<Dim>& matter = chunk.matter;
  const Mat<Dim> now = recent.template topLeftCorner<Dim, Dim>();
  const Mat<Dim> rate = now * before.template topLeftCorner<Dim, Dim>().inverse();
  Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
  axes.computeDirect(rate + rate.transpose());
  const Vec<Dim> then = now.inverse() * axes.eigenvectors().col(0);
  // Pressure acts along all axes: where shape functions are much narrower along another it would damp too much for
  // steps that are stable without it.
  const double width = support.has_moments ? smallest_width<Dim>(now * support.moment[p] * now.transpose()) : 0.0;
  double l = std::sqrt(support.gamma / then.dot(support.metric[p] * then));
  if (support.has_moments) l = std::min(l, 2.0 * std::sqrt(2.0 * support.gamma) * width);
  const double c = std::sqrt(matter.modulus[p] / (matter.mass[p] / matter.volume[p]));
  const double highest = 2.0 * world.options.courant / world.stable_step;
  return {.length = l, .sound = c, .highest = support.has_moments ? std::min(highest, c / width) : highest};
}

}  // namespace

template <int Dim> void update_shock_pressure(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const Mat<3>& now,
                                              const Mat<3>& before, double dt) {
  const ShockViscosity& options = world.options.shock;
  Matter<Dim>& matter = chunk.matter;
  const double J = matter.now.gradient(p).determinant(), shrunk = -std::log(J / matter.J[p]);
  matter.J[p] = J;
  double pressure = 0.0;
  if (shrunk > 0.0) {
    const Viscosity by = viscosity_of(world, chunk, p, now, before);
    const double speed = options.linear * by.sound + options.quadratic * by.length * shrunk / dt;
    // No more than is stable in a step such as this.
    const double damping = by.damping(speed), half = 0.5 * by.highest * dt;
    const double most = half < 1.0 ? 0.5 * (1.0 - half * half) / half : 0.0;
    pressure = matter.mass[p] / matter.volume[p] * by.length * shrunk / dt * speed * std::min(1.0, most / damping);
    chunk.damping = std::max(chunk.damping, damping);
  }
  matter.now.heat[p] = 0.5 * (pressure + matter.shock[p]) * shrunk;
  matter.shock[p] = pressure;
}

template <int Dim> void estimate_first_damping(World<Dim>& world) {
  const ShockViscosity& options = world.options.shock;
  if (!options.on() || world.nodes.size() == 0) return;
  Vec<Dim> least = world.nodes.v.rowwise().minCoeff(), most = world.nodes.v.rowwise().maxCoeff();
  std::vector<Vec<Dim>> others;
  for (const auto& interaction : world.interactions) interaction->add_velocities(world, others);
  for (const Vec<Dim>& velocity : others) {
    least = least.cwiseMin(velocity);
    most = most.cwiseMax(velocity);
  }
  const double fastest = (most - least).norm();
  for (auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p) {
      const Mat<3> recent = chunk.matter.F_since.empty() ? Mat<3>(Mat<3>::Identity()) : chunk.matter.F_since[p];
      const Viscosity by = viscosity_of(world, chunk, p, recent, recent);
      const double speed = options.linear * by.sound + options.quadratic * fastest;
      chunk.damping = std::max(chunk.damping, by.damping(speed));
    }
}

template void update_shock_pressure(const World<2>&, Chunk<2>&, Index, const Mat<3>&, const Mat<3>&, double);
template void update_shock_pressure(const World<3>&, Chunk<3>&, Index, const Mat<3>&, const Mat<3>&, double);
template void estimate_first_damping(World<2>&);
template void estimate_first_damping(World<3>&);

}  // namespace efree
