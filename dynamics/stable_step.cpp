// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/stable_step.hpp"

#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/internal/kernels.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <numeric>

namespace efree::internal {
namespace {

/// How much of other modes is mixed into the fastest one, over the whole, at each estimate: any of them may be the
/// fastest next, and is to be found before steps have grown beyond it.
constexpr double mixed_in = 0.05;
/// By how much steps grow at most, each time.
constexpr double growth_of_steps = 1.05;
/// Steps change when longer ones than this many times are stable.
constexpr double worth_it = 1.25, worth_it_in_calm = 1.03;
/// Steps from one estimate to the next, at least and at most, and the relative change of the longest stable step below
/// which the interval may double.
constexpr Index least_interval = 4, most_interval = 32;
constexpr double calm = 0.005;
/// The step that is taken over the longest stable one.
constexpr double margin = 0.98;

/// A random sign, the same whenever it is asked for (Steele, Lea & Flood 2014).
bool is_positive(Index node, int axis, Index step) {
  std::uint64_t z = (static_cast<std::uint64_t>(step) << 34 ^ static_cast<std::uint64_t>(4 * node + axis)) + 1;
  z *= 0x9e3779b97f4a7c15u;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
  z = (z ^ z >> 27) * 0x94d049bb133111ebu;
  return ((z ^ z >> 31) & 1) != 0;
}

template <int Dim> std::vector<Index> all_chunks(const World<Dim>& world) {
  std::vector<Index> result(world.chunks.size());
  std::iota(result.begin(), result.end(), 0);
  return result;
}

/// Spatial gradients of a pressure patch, in the columns of its points, with its mean dilatation.
template <int Dim> void average_dilatation(const Chunk<Dim>& chunk, double* columns) {
  const auto trace = [&](Index p) { return columns[16 * p] + columns[16 * p + 5] + columns[16 * p + 10]; };
  chunk.for_each_patch([&](Index begin, Index end) {
    double volume = 0.0, dilatation = 0.0;
    for (Index p = begin; p < end; ++p) {
      volume += chunk.matter.volume[p];
      dilatation += chunk.matter.volume[p] * chunk.matter.J_ratio[p] * trace(p);
    }
    for (Index p = begin; p < end && volume > 0.0; ++p) {
      const double shift = (dilatation / volume - trace(p)) / 3.0;
      for (const int d : {0, 5, 10}) columns[16 * p + d] += shift;
    }
  });
}

}  // namespace

template <int Dim> void StableStep<Dim>::begin(const World<Dim>& world) {
  mode_.resize(Dim, world.nodes.size());
  std::uint64_t random = 88172645463325252u;
  for (Index a = 0; a < world.nodes.size(); ++a)
    for (int i = 0; i < Dim; ++i) {
      random ^= random << 13, random ^= random >> 7, random ^= random << 17;
      mode_(i, a) = static_cast<double>(random >> 11) * 0x1p-53 - 0.5;
    }
}

template <int Dim> bool StableStep<Dim>::is_due(const World<Dim>& world) const {
  return world.steps % least_interval == 0 && (world.steps >= next_ || world.reconnections != reconnections_);
}

template <int Dim> void StableStep<Dim>::nodes_inserted(Index first, Index count) {
  insert_columns<Dim>(mode_, first, Points<Dim>::Zero(Dim, count));
}

template <int Dim> void StableStep<Dim>::update_stiffness_ratios(World<Dim>& world) {
  auto start = std::chrono::steady_clock::now();
  for_each_chunk(world, [&](Chunk<Dim>& chunk) {
    const BodyState<Dim>& body = world.bodies[chunk.body];
    if (body.material->linear()) return;
    const MaterialResponse response = respond(*body.material, chunk.matter.now, true);
    Matter<Dim>& matter = chunk.matter;
    Vector unused;
    Vector& ratio = matter.stiffness_ratio.size() == 0 ? unused : matter.stiffness_ratio;
    ratio.resize(chunk.size());
    stiffness_ratios(chunk.size(), response.A.data(), matter.now.F.data(), body.compliance.data(), ratio.data(),
                     matter.modulus.data());
  });
  next_ = world.steps;
  world.ledger.add_time("stability", seconds_since(start));
}

template <int Dim>
void StableStep<Dim>::multiply_stiffness(World<Dim>& world, const Region& region, const Points<Dim>& displacement) {
  parallel_chunks(static_cast<Index>(region.chunks.size()), 1, [&](Index c, Index) {
    Chunk<Dim>& chunk = world.chunks[region.chunks[c]];
    interpolate(world, chunk, displacement);
    double* columns = chunk.columns();
    thread_local std::vector<Mat<3>> moved;
    moved.resize(chunk.size());
    for (Index p = 0; p < chunk.size(); ++p) moved[p] = gradient_by_rows(world, columns + 16 * p, 0.0);
    spatial_gradients(chunk.size(), moved.data(), chunk.matter.F_since.data(), columns);
    if (chunk.has_patches()) average_dilatation(chunk, columns);
    apply_tangent(chunk.size(), world.bodies[chunk.body].tangent.data(), chunk.matter.stiffness_ratio.data(), columns);
    scatter_stresses(world, chunk, moved);
  });
  collect_forces(world, impulse_, region.moving);
  impulse_ *= -1.0;
  for (const auto& interaction : world.interactions) interaction->add_stiffness(world, displacement, impulse_);
  for (const auto& one : world.prescribed) impulse_(one.axis, one.node) = 0.0;
}

/// The square of the highest frequency of the bodies, were they elastic as they are now and nothing but the region
/// stiff: a lower bound, by a step of power iteration and then Lanczos's method, whose modes are orthogonal by mass,
/// from this mode on, which becomes the fastest known. Products with the stiffness end once the bound has converged.
template <int Dim> double StableStep<Dim>::estimate_squared_frequency(World<Dim>& world, const Region& region,
                                                                      Index most_products, Points<Dim>& mode) {
  if (region.chunks.size() < world.chunks.size())
    for (auto& chunk : world.chunks) std::fill(chunk.table.force.begin(), chunk.table.force.end(), 0.0);
  for (const auto& one : world.prescribed) mode(one.axis, one.node) = 0.0;
  multiply_stiffness(world, region, mode);
  find_velocities(world, impulse_, velocity_);
  const double work = impulse_.cwiseProduct(mode).sum();
  const double norm2 = impulse_.cwiseProduct(velocity_).sum();
  const double omega2 = work > 0.0 ? norm2 / work : 0.0;
  if (!std::isfinite(norm2))
    throw NumericalError(fmt::format("at time {:.6g} the stiffness is not finite", world.time));
  if (most_products > 1 && norm2 > 0.0) return lanczos(world, region, most_products, std::sqrt(norm2), omega2, mode);
  mode = norm2 > 0.0 ? velocity_ / std::sqrt(norm2) : velocity_;
  return omega2;
}

/// Goes on from impulse_ and velocity_, whose norm by mass this is.
template <int Dim> double StableStep<Dim>::lanczos(World<Dim>& world, const Region& region, Index most_products,
                                                   double norm, double omega2, Points<Dim>& mode) {
  constexpr std::size_t most_kept = 8;  // modes, as room for the next time
  constexpr double converged = 1e-3;    // residual of the eigenvalue equation over the eigenvalue
  std::vector<Points<Dim>>& modes = krylov_modes_;
  modes.resize(std::max(modes.size(), static_cast<std::size_t>(most_products)));
  Vector diagonal(most_products - 1), off_diagonal(most_products - 1);
  Eigen::SelfAdjointEigenSolver<Matrix> tridiagonal;
  Points<Dim>&last = krylov_impulses_[0], &before = krylov_impulses_[1];
  for (Index k = 0; k < most_products - 1; ++k) {
    if (k > 0) norm = off_diagonal[k - 1];
    before.swap(last);
    modes[k].resize(Dim, velocity_.cols());
    last.resize(Dim, velocity_.cols());
    parallel_for(last.cols(), [&](Index a) {
      modes[k].col(a) = velocity_.col(a) / norm;
      last.col(a) = impulse_.col(a) / norm;
    });
    multiply_stiffness(world, region, modes[k]);
    diagonal[k] = impulse_.cwiseProduct(modes[k]).sum();
    parallel_for(last.cols(), [&](Index a) {
      impulse_.col(a) -= diagonal[k] * last.col(a);
      if (k > 0) impulse_.col(a) -= off_diagonal[k - 1] * before.col(a);
    });
    find_velocities(world, impulse_, velocity_);
    off_diagonal[k] = std::sqrt(std::max(0.0, impulse_.cwiseProduct(velocity_).sum()));
    const bool is_all = off_diagonal[k] < 1e-10 * diagonal[k];  // no other mode has a part in this one
    if (!is_all && k + 2 < most_products && k % 8 != 7) continue;
    tridiagonal.computeFromTridiagonal(diagonal.head(k + 1), off_diagonal.head(k));
    const double residual = off_diagonal[k] * std::abs(tridiagonal.eigenvectors()(k, k));
    omega2 = std::max(omega2, std::hypot(tridiagonal.eigenvalues()[k], residual));
    if (is_all || residual < converged * omega2) break;
  }
  // As power iteration of three times as many products would leave it: what is nearly as fast stays in it, and is found
  // soon where it becomes faster.
  const Vector& values = tridiagonal.eigenvalues();
  const Matrix& vectors = tridiagonal.eigenvectors();
  const Index found = static_cast<Index>(values.size());
  const Vector damped = (values / values[found - 1]).array().max(0.0).pow(3.0 * most_products);
  const Vector share = (vectors * damped.cwiseProduct(vectors.row(0).transpose())).normalized();
  mode = share[0] * modes[0];
  for (Index k = 1; k < found; ++k) mode += share[k] * modes[k];
  modes.resize(std::min(modes.size(), most_kept));
  return omega2;
}

template <int Dim> void StableStep<Dim>::estimate(World<Dim>& world, Index most_products) {
  auto start = std::chrono::steady_clock::now();
  const double size = mixed_in / std::sqrt(world.nodes.mass.sum());
  parallel_for(world.nodes.size(), [&](Index a) {
    for (int i = 0; i < Dim; ++i) mode_(i, a) += is_positive(a, i, world.steps) ? size : -size;
  });
  const double omega2 = estimate_squared_frequency(world, {all_chunks(world)}, most_products, mode_);
  // Steps change no more than they have to: energy swings with their length. They grow slowly, as a mode that has lost
  // what made it fast takes a while to find what is fastest now.
  bool is_calm = world.reconnections == reconnections_;
  const double needed = interval_ == most_interval && is_calm ? worth_it_in_calm : worth_it;
  double& stable = world.stable_step;
  if (omega2 > 0.0) {  // else all nodes have prescribed velocities
    const double longest = world.options.courant * 2.0 / std::sqrt(omega2);
    const bool changes = longest < stable || longest > needed * stable;
    if (changes) stable = world.steps > 0 ? std::min(margin * longest, growth_of_steps * stable) : margin * longest;
    is_calm = is_calm && !changes && std::abs(longest - longest_) < calm * longest;
    longest_ = longest;
  }
  interval_ = is_calm ? std::min(2 * interval_, most_interval) : least_interval;
  next_ = world.steps + interval_;
  reconnections_ = world.reconnections;
  world.ledger.add_time("stability", seconds_since(start));
}

template <int Dim> void StableStep<Dim>::estimate_near(World<Dim>& world, const std::vector<char>& nodes,
                                                       Points<Dim> mode, Index most_products) {
  auto start = std::chrono::steady_clock::now();
  Region region{.chunks = {}, .moving = std::vector<char>(world.nodes.size(), 0)};
  for (const Index c : all_chunks(world)) {
    const std::vector<Index>& seen = world.chunks[c].table.nodes;
    if (std::ranges::none_of(seen, [&](Index a) { return nodes[a] != 0; })) continue;
    region.chunks.push_back(c);
    for (const Index a : seen) region.moving[a] = 1;
  }
  for (Index a = 0; a < world.nodes.size(); ++a)
    if (region.moving[a] == 0) mode.col(a).setZero();
  if (const double omega2 = estimate_squared_frequency(world, region, most_products, mode); omega2 > 0.0) {
    const double longest = world.options.courant * 2.0 / std::sqrt(omega2);
    if (longest < 1.5 * world.stable_step) mode_ += mode;
    if (longest < world.stable_step) world.stable_step = margin * longest;
  }
  world.ledger.add_time("stability", seconds_since(start));
}

template class StableStep<2>;
template class StableStep<3>;

}  // namespace efree::internal
