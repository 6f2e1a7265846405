// SPDX-License-Identifier: GPL-3.0-or-later
/// From where nodes are to the forces on them; and the longest stable step.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <utility>

namespace efree::internal {
namespace {

/// |F - I| beyond which what is linear in it is wrong by more than a few per cent.
constexpr double small_strains = 0.05;

/// How much of other shapes is mixed into that of the fastest vibration, over the whole, each time it is looked at: any
/// of them may be the fastest next, and is to be found before steps have grown beyond it.
constexpr double mixed_in = 0.05;
/// By how much steps grow at the most, each time.
constexpr double growth_of_steps = 1.05;
/// Steps change when longer ones than this many times are stable.
constexpr double worth_it = 1.25, worth_it_in_calm = 1.03;
/// Steps from one look to the next, at the most, and by how much the longest stable step changes in them where the next
/// may be twice as far.
constexpr Index most_apart = 32;
constexpr double calm = 0.005;

/// What steps know of damping from one to the next: where points get smaller is known when they have, and as these come
/// and go energy would feel steps that jump. They grow no faster by it than otherwise.
constexpr double kept_damping = 0.98;

/// Volume of a point, over that by the dilatation it shares, below which it shares no more.
constexpr double least_growth = 0.5;

/// A coin, the same whenever it is asked for this (Steele, Lea & Flood 2014).
bool is_heads(Index node, int axis, Index step) {
  std::uint64_t z = (static_cast<std::uint64_t>(step) << 34 ^ static_cast<std::uint64_t>(4 * node + axis)) + 1;
  z *= 0x9e3779b97f4a7c15u;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
  z = (z ^ z >> 27) * 0x94d049bb133111ebu;
  return ((z ^ z >> 31) & 1) != 0;
}

}  // namespace

/// What values at the nodes come to at the points: gradients, and the values there, a row for each component.
template <int Dim> void Motion<Dim>::deform(OtmChunk<Dim>& chunk, const Points<Dim>& of) const {
  if (chunk.nodes.empty()) return;
  chunk.origin = of.col(chunk.nodes[chunk.nodes.size() / 2]);
  if (axisymmetric()) chunk.origin[0] = 0.0;  // hoops are as long as radii
  for (std::size_t l = 0; l < chunk.nodes.size(); ++l)
    for (int i = 0; i < Dim; ++i) chunk.x[4 * l + i] = of(i, chunk.nodes[l]) - chunk.origin[i];
  otm_deform(chunk.size(), chunk.offsets.data(), chunk.local.data(), chunk.entries.data(), chunk.x.data(),
             chunk.columns());
}

/// Where a point is and how it is deformed, right after `deform` by where the nodes are.
template <int Dim> void Motion<Dim>::place(OtmChunk<Dim>& chunk, Index p) const {
  place(chunk, p, chunk.columns() + 16 * p);
}

/// Likewise, and the thread may have worked on other chunks since.
template <int Dim> void Motion<Dim>::place_anew(OtmChunk<Dim>& chunk, Index p) const {
  double rows[16];
  otm_deform(1, chunk.offsets.data() + p, chunk.local.data(), chunk.entries.data(), chunk.x.data(), rows);
  place(chunk, p, rows);
}

template <int Dim> void Motion<Dim>::place(OtmChunk<Dim>& chunk, Index p, const double* rows) const {
  chunk.at.col(p) = chunk.origin + Eigen::Map<const Vec<Dim>>(rows + 12);
  if (!chunk.is_eroded(p) && !chunk.is_crushed(p)) chunk.since[p] = gradient(rows, 1.0);
}

/// The step is none for a point that it would turn inside out or nearly so: until it joins another it stays as it is,
/// by its F `before`, and pushes nothing, since the moments of forces are right only where F is that of the nodes. What
/// its stress has done by half of the step, and what its nodes did unseen, is lost.
template <int Dim> void Motion<Dim>::hold(OtmChunk<Dim>& chunk, Index p, const Mat<3>& before) const {
  const Mat<3> rate = (chunk.since[p] - before) * before.inverse();
  const Mat<3> tau = chunk.response.stress(p) * chunk.now.gradient(p).transpose();
  chunk.lost += 0.5 * chunk.volume[p] * (tau.cwiseProduct(rate).sum() - chunk.shock[p] * rate.trace());
  chunk.lost += unseen(chunk, p, 0.5 * last_step);
  chunk.penalty[p] = chunk.shock[p] = 0.0;
  if (chunk.now.heat.size() > 0) chunk.now.heat[p] = 0.0;
  chunk.since[p] = before;
  chunk.crushed.insert(std::ranges::lower_bound(chunk.crushed, p), p);
}

/// Holds a point that has been placed and that the step would turn inside out before its functions are renewed; whether
/// it would.
template <int Dim> bool Motion<Dim>::hold_crushed(OtmChunk<Dim>& chunk, Index p) const {
  if (!joins(bodies[chunk.body]) || chunk.is_eroded(p) || chunk.is_crushed(p)) return false;
  const Mat<3> then = chunk.now.gradient(p) * Eigen::Map<const Mat<3>>(chunk.made.col(p).data()).inverse();
  if (!would_crush(chunk.since[p].determinant() / then.determinant())) return false;
  hold(chunk, p, then);
  return true;
}

/// Deformations, stresses and forces where the nodes are now.
template <int Dim> void Motion<Dim>::sweep(double dt) {
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) { sweep(c, dt); });
  for (auto& chunk : chunks) renewal_loss += std::exchange(chunk.lost, 0.0);
  collect(force);
  counts.updates += static_cast<std::int64_t>(place_of_point.size());
}

/// What the chunks say of each node, or of each of these, summed in their order; nothing of others.
template <int Dim> void Motion<Dim>::collect(Points<Dim>& forces, const std::vector<char>& of) const {
  forces.resize(Dim, x.cols());
  parallel_for(static_cast<Index>(x.cols()), [&](Index a) {
    Vec<Dim> sum = Vec<Dim>::Zero();
    if (of.empty() || of[a] != 0)
      for (Index k = node_offsets[a]; k < node_offsets[a + 1]; ++k) sum += Eigen::Map<const Vec<Dim>>(node_forces[k]);
    forces.col(a) = sum;
  });
}

template <int Dim> Points<Dim> Motion<Dim>::collected() const {
  Points<Dim> forces;
  collect(forces);
  return forces;
}

/// Points of which some are held, break, or are turned inside out, right after otm_kinematics.
template <int Dim> OtmStrains Motion<Dim>::examine(OtmChunk<Dim>& chunk, bool holds) const {
  const BodyOf& body = bodies[chunk.body];
  double* columns = chunk.columns();
  OtmStrains most;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (chunk.is_eroded(p)) continue;
    double* column = columns + 16 * p;
    double& wear = column[9];
    const double left = column[10];
    const bool was_crushed = chunk.is_crushed(p);
    if (was_crushed || (holds && would_crush(left))) {
      const Mat<3> then = Eigen::Map<const Mat<3>>(column);
      if (was_crushed)
        chunk.since[p] = then;
      else
        hold(chunk, p, then);
      const Mat<3> now = then * Eigen::Map<const Mat<3>>(chunk.made.col(p).data());
      Eigen::Map<Mat<3>>(chunk.now.F.col(p).data()) = now;
      chunk.growth[p] = now.determinant();
      wear = 0.5 * (then.transpose() * then - Mat<3>::Identity()).norm();
    } else if (left > 0.0) {
      most.shrunk = std::max(most.shrunk, 1.0 / left);
    }
    const double J = chunk.growth[p];
    if (J <= 0.0 && body.fracture.on()) {
      // It breaks at the end of the step, and until then is as it was.
      chunk.damage[p] = 1.0;
      chunk.growth[p] = chunk.now.gradient(p).determinant();
      wear = 0.0;
      continue;
    }
    if (!(J > 0.0))
      throw NumericalError(fmt::format(
          "at time {:.6g} the material point at ({:.6g}) is turned inside out (J = {:.3g}): try a smaller step", time,
          fmt::join(chunk.at.col(p), ", "), J));
    most.wear = std::max(most.wear, wear);
  }
  return most;
}

/// Throws NumericalError where a material for small strains is strained or turned by much.
template <int Dim> void Motion<Dim>::require_small_strains(const OtmChunk<Dim>& chunk) const {
  for (Index p = 0; p < chunk.size(); ++p) {
    const double strain = chunk.is_eroded(p) ? 0.0 : (chunk.now.gradient(p) - Mat<3>::Identity()).norm();
    if (strain > small_strains)
      throw NumericalError(fmt::format(
          "at time {:.6g} the material point at ({:.6g}) is strained or turned by {:.2g}, and its material is for "
          "small strains: take one for finite strains",
          time, fmt::join(chunk.at.col(p), ", "), strain));
  }
}

/// Points of a union share its dilatation, and their own is their growth over that. Nothing keeps one from being
/// squeezed to nothing while the others grow: where that begins they part, each with what it has felt.
template <int Dim> void Motion<Dim>::share_dilatation(OtmChunk<Dim>& chunk) const {
  std::vector<Index> parted;
  for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
    const Index begin = chunk.unions[u], end = chunk.unions[u + 1];
    double volume = 0.0, grown = 0.0;
    for (Index p = begin; p < end; ++p) {
      volume += chunk.volume[p];
      if (!chunk.is_eroded(p)) grown += chunk.volume[p] * chunk.growth[p];
    }
    if (!(volume > 0.0)) continue;
    const double shared = grown / volume;
    bool parts = false;
    for (Index p = begin; p < end; ++p) {
      if (chunk.is_eroded(p)) continue;
      const double own = chunk.growth[p] /= shared;
      parts = parts || own < least_growth || chunk.is_crushed(p);
    }
    for (Index p = begin; p < end && parts; ++p) parted.push_back(p);
  }
  otm_share(chunk.size(), chunk.growth.data(), chunk.volume.data(), chunk.now.F.data());
  if (parted.empty()) return;
  for (const Index p : parted)
    if (!chunk.is_eroded(p)) chunk.made.col(p) /= std::cbrt(std::exchange(chunk.growth[p], 1.0));
  std::vector<Index> unions;
  std::ranges::set_union(chunk.unions, parted, std::back_inserter(unions));
  chunk.unions = std::move(unions);
}

template <int Dim> void Motion<Dim>::sweep(Index number, double dt) {
  OtmChunk<Dim>& chunk = chunks[number];
  const BodyOf& body = bodies[chunk.body];
  const Index n = chunk.size();
  auto start = Clock::now();
  deform(chunk, x);
  double* columns = chunk.columns();
  Tensors& F = chunk.now.F;
  chunk.now.dt = dt;
  const bool viscous_shocks = options.shock.on() && dt > 0.0;
  const bool holds = joins(body) && dt > 0.0;
  const OtmPlane plane = Dim == 3 ? OtmPlane::none : axisymmetric() ? OtmPlane::axisymmetric : OtmPlane::strain;
  for (Index p = 0; p < n; ++p) chunk.at.col(p) = chunk.origin + Eigen::Map<const Vec<Dim>>(columns + 16 * p + 12);
  OtmStrains most = otm_kinematics(n, plane, holds ? least_left : 0.0, chunk.volume.data(), chunk.made.data(),
                                   chunk.since.data(), F.data(), chunk.growth.data(), columns);
  if (!most.regular || !chunk.crushed.empty()) most = examine(chunk, holds);
  if (!body.finite) require_small_strains(chunk);
  // What wears soon is renewed with what is worn, as a chunk's tables are written anew at once.
  chunk.worn.clear();
  if (body.renewed && most.wear > options.renewal)
    for (Index p = 0; p < n; ++p)
      if (!chunk.is_eroded(p) && columns[16 * p + 9] > 0.7 * options.renewal) chunk.worn.push_back(p);
  for (const Index p : chunk.crushed) chunk.wear(p);
  if (dt == 0.0) {
    // In no time nothing moves, not even by rounding: what flows asks how fast.
    F = chunk.made;
    for (Index p = 0; p < n; ++p) chunk.growth[p] = chunk.now.gradient(p).determinant();
  } else {
    chunk.squeeze = std::max(chunk.squeeze, std::log(most.shrunk) / dt);
    if (chunk.shares_dilatation()) share_dilatation(chunk);
  }
  chunk.damping *= kept_damping;
  if (viscous_shocks) {
    for (Index p = 0; p < n; ++p)
      if (!chunk.is_eroded(p) && !chunk.is_crushed(p)) shock(chunk, p, Eigen::Map<const Mat<3>>(columns + 16 * p), dt);
    viscous[number] += chunk.now.heat.dot(chunk.volume);
  }
  chunk.seconds.kinematics += lap(start);
  try {
    body.material->respond(chunk.now, chunk.response);
  } catch (const NumericalError& error) {
    throw NumericalError(fmt::format("at time {:.6g}: {}", time, error.what()));
  }
  if (body.fracture.on() || counts.eroded > 0) wear_down(chunk);
  stored[number] = chunk.response.energy.dot(chunk.volume);
  dissipated[number] += chunk.response.dissipated.dot(chunk.volume);
  chunk.now.history.swap(chunk.response.history);
  chunk.seconds.materials += lap(start);
  press(chunk);
  chunk.seconds.forces += lap(start);
}

/// Forces of the stresses that points have.
template <int Dim> void Motion<Dim>::press(OtmChunk<Dim>& chunk) const {
  otm_kirchhoff(chunk.size(), chunk.response.P.data(), chunk.now.F.data(), chunk.shock.data(), chunk.columns());
  for (const Index p : chunk.crushed) std::fill_n(chunk.columns() + 16 * p, 12, 0.0);
  push(chunk, chunk.since);
}

/// Adds weights to the forces.
template <int Dim> void Motion<Dim>::weigh() {
  if (!acceleration.isZero(0.0)) force += acceleration * mass.transpose();
}

/// By the compression since F was `before`, since the functions were made.
template <int Dim> typename Motion<Dim>::Viscosity Motion<Dim>::viscosity_of(const OtmChunk<Dim>& chunk, Index p,
                                                                             const Mat<3>& before) const {
  const Mat<Dim> now = chunk.since[p].template topLeftCorner<Dim, Dim>();
  const Mat<Dim> rate = now * before.template topLeftCorner<Dim, Dim>().inverse();
  Eigen::SelfAdjointEigenSolver<Mat<Dim>> axes;
  axes.computeDirect(rate + rate.transpose());
  const Vec<Dim> then = now.inverse() * axes.eigenvectors().col(0);
  // Pressure acts along all axes: where functions are much narrower along another it would damp too much for steps that
  // are stable without it.
  const bool is_known = bodies[chunk.body].renewed && options.functions == OtmFunctions::lme;
  const double width = is_known ? smallest_width<Dim>(now * chunk.moment[p] * now.transpose()) : 0.0;
  double l = std::sqrt(options.lme.gamma / then.dot(chunk.metric[p] * then));
  if (is_known) l = std::min(l, 2.0 * std::sqrt(2.0 * options.lme.gamma) * width);
  const double c = std::sqrt(chunk.modulus[p] / (chunk.mass[p] / chunk.volume[p]));
  const double highest = 2.0 * options.courant / stable;
  return {.length = l, .sound = c, .highest = is_known ? std::min(highest, c / width) : highest};
}

/// For the first step, in which whatever has met something is squeezed: at most as fast as any two things approach each
/// other, so that what flies alone is not damped.
template <int Dim> void Motion<Dim>::foresee_damping() {
  if (!options.shock.on()) return;
  Vec<Dim> least = v.rowwise().minCoeff(), most = v.rowwise().maxCoeff();
  const auto add = [&](const Vec<Dim>& velocity) {
    least = least.cwiseMin(velocity);
    most = most.cwiseMax(velocity);
  };
  for (const Tool& tool : tools) add(tool.now.velocity);
  if (!prescribed.empty()) add(Vec<Dim>::Zero());
  const double fastest = (most - least).norm();
  for (auto& chunk : chunks)
    for (Index p = 0; p < chunk.size(); ++p) {
      const Viscosity by = viscosity_of(chunk, p, chunk.since[p]);
      const double speed = options.shock.linear * by.sound + options.shock.quadratic * fastest;
      chunk.damping = std::max(chunk.damping, by.damping(speed));
    }
}

/// Viscous pressure of a point, and the heat it makes; `before`: F a step ago, since the functions were made.
template <int Dim> void Motion<Dim>::shock(OtmChunk<Dim>& chunk, Index p, const Mat<3>& before, double dt) const {
  const double J = chunk.now.gradient(p).determinant(), shrunk = -std::log(J / chunk.dilatation[p]);
  chunk.dilatation[p] = J;
  double pressure = 0.0;
  if (shrunk > 0.0) {
    const Viscosity by = viscosity_of(chunk, p, before);
    const double speed = options.shock.linear * by.sound + options.shock.quadratic * by.length * shrunk / dt;
    // No more than is stable in a step such as this.
    const double damping = by.damping(speed), half = 0.5 * by.highest * dt;
    const double most = half < 1.0 ? 0.5 * (1.0 - half * half) / half : 0.0;
    pressure = chunk.mass[p] / chunk.volume[p] * by.length * shrunk / dt * speed * std::min(1.0, most / damping);
    chunk.damping = std::max(chunk.damping, damping);
  }
  chunk.now.heat[p] = 0.5 * (pressure + chunk.shock[p]) * shrunk;
  chunk.shock[p] = pressure;
}

/// Deformation by the rows of otm_deform; across the plane there is none but `across`, or that around the axis.
template <int Dim> Mat<3> Motion<Dim>::gradient(const double* rows, double across) const {
  Mat<3> result = Mat<3>::Zero();
  result(2, 2) = across;
  for (int j = 0; j < Dim; ++j)
    for (int i = 0; i < Dim; ++i) result(i, j) = rows[4 * i + j];
  if (axisymmetric()) result(2, 2) = rows[2];
  return result;
}

/// Forces of Kirchhoff stresses, which are the columns of each point, and of motions that points do not see. Points of
/// a union share the work of its dilatation (growth: each one's J over the union's).
template <int Dim> void Motion<Dim>::push(OtmChunk<Dim>& chunk, const std::vector<Mat<3>>& since) const {
  double* columns = chunk.columns();
  if (chunk.shares_dilatation())
    for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
      const Index begin = chunk.unions[u], end = chunk.unions[u + 1];
      const auto trace = [&](Index p) {
        const double* tau = columns + 16 * p;
        return tau[0] + tau[5] + tau[10];
      };
      double volume = 0.0, pressure = 0.0;
      for (Index p = begin; p < end; ++p) {
        volume += chunk.volume[p];
        pressure += chunk.volume[p] * trace(p) / 3.0;
      }
      if (!(volume > 0.0)) continue;
      for (Index p = begin; p < end; ++p) {
        const double shift = pressure / volume * chunk.growth[p] - trace(p) / 3.0;
        for (const int d : {0, 5, 10}) columns[16 * p + d] += shift;
      }
    }
  otm_tractions(chunk.size(), chunk.volume.data(), chunk.since.data(), since.data(), chunk.moment.data(),
                chunk.penalty.data(), columns);
  if (Dim == 2 && !axisymmetric())
    for (Index p = 0; p < chunk.size(); ++p) columns[16 * p + 8] = 0.0;
  std::fill(chunk.force.begin(), chunk.force.end(), 0.0);
  otm_push(chunk.size(), chunk.offsets.data(), chunk.local.data(), chunk.entries.data(), chunk.x.data(), columns,
           chunk.penalty.data(), axisymmetric(), chunk.force.data());
}

/// How much stiffer than at rest points are now, for those who look for the longest stable step.
template <int Dim> void Motion<Dim>::stiffen() {
  auto begin = Clock::now();
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[c];
    const BodyOf& body = bodies[chunk.body];
    if (body.material->linear()) return;
    const MaterialResponse response = respond(*body.material, chunk.now, true);
    otm_stiffening(chunk.size(), response.A.data(), chunk.now.F.data(), body.compliance.data(), chunk.stiffening.data(),
                   chunk.modulus.data());
  });
  next_look = counts.steps;
  times.stability += lap(begin);
}

/// Elastic forces against this shape, were the bodies elastic as they are now and nothing but these chunks stiff; none
/// along what is prescribed. moving: nodes that these see; empty: all.
template <int Dim> void Motion<Dim>::stiffness_times(const Points<Dim>& shape, std::span<const Index> in,
                                                     const std::vector<char>& moving, Points<Dim>& result) {
  parallel_chunks(static_cast<Index>(in.size()), 1, [&](Index c, Index) {
    OtmChunk<Dim>& chunk = chunks[in[c]];
    const BodyOf& body = bodies[chunk.body];
    deform(chunk, shape);
    double* columns = chunk.columns();
    const bool shared = chunk.shares_dilatation();
    thread_local std::vector<Mat<3>> since;
    since.resize(chunk.size());
    for (Index p = 0; p < chunk.size(); ++p) since[p] = gradient(columns + 16 * p, 0.0);
    otm_rates(chunk.size(), since.data(), chunk.since.data(), columns);
    if (shared)
      for (std::size_t u = 0; u + 1 < chunk.unions.size(); ++u) {
        double volume = 0.0, dilatation = 0.0;
        const auto trace = [&](Index p) {
          const double* H = columns + 16 * p;
          return H[0] + H[5] + H[10];
        };
        for (Index p = chunk.unions[u]; p < chunk.unions[u + 1]; ++p) {
          volume += chunk.volume[p];
          dilatation += chunk.volume[p] * chunk.growth[p] * trace(p);
        }
        if (!(volume > 0.0)) continue;
        for (Index p = chunk.unions[u]; p < chunk.unions[u + 1]; ++p) {
          const double shift = (dilatation / volume - trace(p)) / 3.0;
          for (const int d : {0, 5, 10}) columns[16 * p + d] += shift;
        }
      }
    otm_stiffness(chunk.size(), body.tangent.data(), chunk.stiffening.data(), columns);
    push(chunk, since);
  });
  collect(result, moving);
  result *= -1.0;
  resist(shape, result);
  for (const auto& [node, axis, velocity] : prescribed) result(axis, node) = 0.0;
}

/// The square of the highest frequency of the bodies, were they elastic as they are now and nothing but these chunks
/// stiff: a lower bound, by a step of power iteration and then Lanczos's method (Lanczos 1950), whose shapes are
/// orthogonal by mass, from this shape on, which is the fastest known then. No more products with the stiffness than
/// `most` are made, and none once the bound has converged.
template <int Dim> double Motion<Dim>::highest_frequency2(Points<Dim>& shape, Index most, std::span<const Index> in,
                                                          const std::vector<char>& moving) {
  constexpr std::size_t most_kept = 8;  // shapes, as room for the next time
  constexpr double converged = 1e-3;    // what is left of the eigenvalue equation; of the eigenvalue about its square
  if (in.size() < chunks.size())
    for (auto& chunk : chunks) std::fill(chunk.force.begin(), chunk.force.end(), 0.0);
  for (const auto& [node, axis, velocity] : prescribed) shape(axis, node) = 0.0;
  Points<Dim>&impulse = nodal_impulses, &next = nodal_changes;
  stiffness_times(shape, in, moving, impulse);
  find_velocities(impulse, next);
  const double work = impulse.cwiseProduct(shape).sum();
  const double norm2 = impulse.cwiseProduct(next).sum();
  double omega2 = work > 0.0 ? norm2 / work : 0.0;
  if (!std::isfinite(norm2))
    throw NumericalError(fmt::format("at time {:.6g} stiffnesses are no numbers any more", time));
  if (most == 1 || !(norm2 > 0.0)) {
    shape = norm2 > 0.0 ? next / std::sqrt(norm2) : next;
    return omega2;
  }
  std::vector<Points<Dim>>& shapes = krylov_shapes;
  shapes.resize(std::max(shapes.size(), static_cast<std::size_t>(most)));
  Vector diagonal(most - 1), beside(most - 1);
  Eigen::SelfAdjointEigenSolver<Matrix> tridiagonal;
  Points<Dim>&last = krylov_impulses[0], &before = krylov_impulses[1];
  for (Index k = 0; k < most - 1; ++k) {
    const double norm = k > 0 ? beside[k - 1] : std::sqrt(norm2);
    shapes[k] = next / norm;
    before.swap(last);
    last = impulse / norm;
    stiffness_times(shapes[k], in, moving, impulse);
    diagonal[k] = impulse.cwiseProduct(shapes[k]).sum();
    impulse -= diagonal[k] * last;
    if (k > 0) impulse -= beside[k - 1] * before;
    find_velocities(impulse, next);
    beside[k] = std::sqrt(std::max(0.0, impulse.cwiseProduct(next).sum()));
    const bool is_all = beside[k] < 1e-10 * diagonal[k];  // no other shape has a part in this one
    if (!is_all && k + 2 < most && k % 8 != 7) continue;
    tridiagonal.computeFromTridiagonal(diagonal.head(k + 1), beside.head(k));
    const double left = beside[k] * std::abs(tridiagonal.eigenvectors()(k, k));
    omega2 = std::max(omega2, std::hypot(tridiagonal.eigenvalues()[k], left));
    if (is_all || left < converged * omega2) break;
  }
  // As power iteration of three times as many products would leave it: what is nearly as fast stays in it, and is found
  // soon where it becomes faster.
  const Vector& values = tridiagonal.eigenvalues();
  const Matrix& vectors = tridiagonal.eigenvectors();
  const Index found = static_cast<Index>(values.size());
  const Vector damped = (values / values[found - 1]).array().max(0.0).pow(3.0 * most);
  const Vector share = (vectors * damped.cwiseProduct(vectors.row(0).transpose())).normalized();
  shape = share[0] * shapes[0];
  for (Index k = 1; k < found; ++k) shape += share[k] * shapes[k];
  shapes.resize(std::min(shapes.size(), most_kept));
  return omega2;
}

/// Looks for the longest stable step, 2 over the highest frequency, from the shape on that was the fastest; and again
/// soon, unless little has changed since the last time.
template <int Dim> void Motion<Dim>::shake(Index most) {
  auto begin = Clock::now();
  const double size = mixed_in / std::sqrt(mass.sum());
  parallel_for(static_cast<Index>(x.cols()), [&](Index a) {
    for (int i = 0; i < Dim; ++i) shaken(i, a) += is_heads(a, i, counts.steps) ? size : -size;
  });
  const double omega2 = highest_frequency2(shaken, most, all_chunks, {});
  // Steps change no more than they have to: energy swings with their length. They grow slowly, as a shape that has lost
  // what made it fast takes a while to find what is fastest now.
  bool is_calm = touches.empty() && counts.renewals == renewals_seen;
  const double needed = looks_apart == most_apart && is_calm ? worth_it_in_calm : worth_it;
  if (omega2 > 0.0) {  // else all nodes are led
    const double longest = options.courant * 2.0 / std::sqrt(omega2);
    const bool changes = longest < stable || longest > needed * stable;
    if (changes) stable = counts.steps > 0 ? std::min(0.98 * longest, growth_of_steps * stable) : 0.98 * longest;
    is_calm = is_calm && !changes && std::abs(longest - longest_seen) < calm * longest;
    longest_seen = longest;
  }
  looks_apart = is_calm ? std::min(2 * looks_apart, most_apart) : least_apart;
  next_look = counts.steps + looks_apart;
  renewals_seen = counts.renewals;
  times.stability += lap(begin);
}

/// Looks, from this shape on, whether something near these nodes has become as fast as what is the fastest, where it is
/// to be looked for from then on.
template <int Dim> void Motion<Dim>::shake_near(const std::vector<char>& nodes, Points<Dim> shape, Index most) {
  auto begin = Clock::now();
  std::vector<Index> in;
  std::vector<char> moving(x.cols(), 0);
  for (const Index c : all_chunks) {
    const std::vector<Index>& seen = chunks[c].nodes;
    if (std::none_of(seen.begin(), seen.end(), [&](Index a) { return nodes[a] != 0; })) continue;
    in.push_back(c);
    for (const Index a : seen) moving[a] = 1;
  }
  for (Index a = 0; a < x.cols(); ++a)
    if (moving[a] == 0) shape.col(a).setZero();
  if (const double omega2 = highest_frequency2(shape, most, in, moving); omega2 > 0.0) {
    const double longest = options.courant * 2.0 / std::sqrt(omega2);
    if (longest < 1.5 * stable) shaken += shape;
    if (longest < stable) stable = 0.98 * longest;
  }
  times.stability += lap(begin);
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
