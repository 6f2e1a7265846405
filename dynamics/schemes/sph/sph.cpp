// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/sph.hpp"

#include "efree/core/internal/random.hpp"
#include "efree/dynamics/internal/power_iteration.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/sph/internal/increment.hpp"
#include "efree/dynamics/schemes/sph/internal/lattice_waves.hpp"
#include "efree/dynamics/schemes/sph/internal/particle_sums.hpp"
#include "efree/dynamics/schemes/sph/internal/particle_tensors.hpp"
#include "efree/dynamics/schemes/sph/internal/wall_contacts.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <utility>

namespace efree {
namespace {

using internal::of_particle, internal::tensor_at, internal::tensor_size;

/// Steps between estimates of the highest frequency, a margin for what comes until the next, and what is left of the
/// last estimate where the next one is lower.
constexpr Index estimate_interval = 16;
constexpr double margin = 1.25, forgotten = 0.9;
/// What a volume counts for at most, over that at rest. Rates are by the volume of a particle: that of one which flies
/// off would grow by itself.
constexpr double largest_volume = 1.5;
/// Particles this close, over their spacing, have clumped: as in tension, where sums over neighbours are unstable
/// (Swegle, Hicks & Attaway 1995), or where daughters pair up.
constexpr double clumped_distance = 0.5;
/// Steps between looks for particles to split.
constexpr Index splitting_interval = 8;

void require_options(const SphOptions& options) {
  const auto fail = [](const std::string& what) { throw InputError("smoothed particles: " + what); };
  const auto is_positive = [](double number) { return number > 0.0 && std::isfinite(number); };
  const auto is_number = [](double number) { return number >= 0.0 && std::isfinite(number); };
  if (!is_positive(options.spacing)) fail(fmt::format("spacing {}, expected a positive length", options.spacing));
  if (!(options.smoothing >= 0.8) || options.smoothing > 3.0)
    fail(fmt::format("smoothing {}, expected 0.8 to 3 times the spacing", options.smoothing));
  if (!is_number(options.viscosity.linear) || !is_number(options.viscosity.quadratic))
    fail(fmt::format("viscosity {} and {}, expected 0 or more", options.viscosity.linear, options.viscosity.quadratic));
  const ArtificialStress& artificial = options.artificial_stress;
  if (!is_number(artificial.strength) || !is_number(artificial.compression) || !is_number(artificial.exponent))
    fail(fmt::format("artificial stress {}, in compression {}, with the exponent {}, expected 0 or more",
                     artificial.strength, artificial.compression, artificial.exponent));
  const ParticleSplitting& splitting = options.splitting;
  if (!is_number(splitting.strain))
    fail(fmt::format("splitting from a strain of {}, expected 0 or more", splitting.strain));
  if (!(splitting.separation >= 0.2) || splitting.separation > 0.8 || !(splitting.smoothing >= 0.4) ||
      splitting.smoothing > 0.9 || splitting.levels < 1 || splitting.levels > 3)
    fail(fmt::format("splitting with separation {}, smoothing {}, {} levels; expected 0.2 to 0.8, 0.4 to 0.9, 1 to 3",
                     splitting.separation, splitting.smoothing, splitting.levels));
}

/// Volume of a point over that at rest, as sums take it.
template <int Dim> double volume_ratio(const Matter<Dim>& matter, Index p) {
  return std::min(matter.J_ratio[p], largest_volume);
}

template <int Dim> class Sph final : public Scheme<Dim> {
 public:
  explicit Sph(const SphOptions& options) : options_(options) { require_options(options); }
  std::string name() const override { return "sph"; }
  std::vector<double> identity() const override {
    return {options_.spacing, options_.smoothing, static_cast<double>(options_.kernel), options_.corrected ? 1.0 : 0.0,
            options_.splitting.strain};
  }

  PointStorage point_storage(const DeformableBody<Dim>& body) const override {
    return {.table_gradients = !body.patches.empty(), .supports = false};
  }
  void begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) override;
  void refresh(World<Dim>& world, internal::StableStep<Dim>&) override;
  StrainBounds update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least) override;
  void scatter_forces(const World<Dim>& world, Chunk<Dim>& chunk) override;
  void collect_forces(World<Dim>& world) override;
  Points<Dim> point_velocities(const World<Dim>& world) const override { return world.nodes.v; }
  std::optional<double> stable_step(const World<Dim>& world) const override {
    const ParticleViscosity& viscosity = options_.viscosity;
    const double rate = damping_ * (viscosity.linear * wave_rate_ + viscosity.quadratic * approach_rate_);
    return world.options.courant * internal::damped_step(margin * frequency_, rate);
  }
  void pack(Archive& archive) override {
    archive(sizes_.smoothing, sizes_.splits, lists_, viscous_power_, artificial_power_, wave_rate_, approach_rate_);
    archive(frequency_, mode_, estimates_, correction_, contacts_, wall_forces_);
  }
  void resume(World<Dim>& world) override { list_pairs(world, lists_.positions()); }
  const WallForces<Dim>* wall_forces() const override { return &wall_forces_; }

 private:
  void list_pairs(const World<Dim>& world, const Points<Dim>& x);
  void estimate_frequency(const World<Dim>& world, int products);
  internal::ParticleSums<Dim> sums(const World<Dim>& world) const { return {world, lists_, sizes_, options_.kernel}; }

  SphOptions options_;
  double damping_ = 0.0;    ///< fastest damping by a viscosity of one, times the smoothing length over the wave speed
  double wave_rate_ = 0.0;  ///< largest speed of pressure waves over the smoothing length [1/time]
  double approach_rate_ = 0.0;  ///< largest q of pairs, as of ParticleViscosity, over the smoothing length [1/time]
  double frequency_ = 0.0;      ///< highest angular one, an estimate from below [1/time]
  Points<Dim> mode_;            ///< Dim x N, with that frequency
  std::int64_t estimates_ = 0;
  internal::ParticleSizes sizes_;
  internal::PairLists<Dim> lists_;
  std::vector<double> wave_rates_;  ///< largest speed of pressure waves over the smoothing length, by chunk
  internal::WallContacts<Dim> contacts_;
  WallForces<Dim> wall_forces_;
  internal::ParticleStresses<Dim> stresses_;
  Points<Dim * Dim> correction_;                         ///< of gradients, by particle, by columns; empty: none
  double viscous_power_ = 0.0, artificial_power_ = 0.0;  ///< lost at the last step
  bool counts_power_ = false;
};

template <int Dim> void Sph<Dim>::begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) {
  if (world.axisymmetric())
    throw InputError("smoothed particles are of plane strain or in space, not of an axisymmetric section");
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (bodies[b].shape)
      throw InputError(fmt::format("body {}: it has shape functions of its own: take total_lagrangian()", b));
    if (bodies[b].points.cols() == 0 || bodies[b].nodes != bodies[b].points)
      throw InputError(
          fmt::format("body {}: smoothed particles are nodes and points at once: expected as many of both "
                      "at the same places (particles_on_lattice)",
                      b));
  }
  damping_ = internal::damping_on_lattice<Dim>(options_);
  const Index n = world.nodes.size();
  for (const Chunk<Dim>& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p) world.nodes.mass[world.point_number(chunk, p)] = chunk.matter.mass[p];
  world.nodes.spacing.setConstant(n, options_.spacing);
  world.options.contact.enabled = false;  // sums over all particles act between bodies, too
  if (world.nodes.radius.size() == 0) world.nodes.radius.setZero(n);
  sizes_.smoothing.setConstant(n, options_.smoothing * options_.spacing);
  sizes_.splits.assign(static_cast<std::size_t>(n), 0);
  sizes_.pressed.assign(static_cast<std::size_t>(n), 0);
  list_pairs(world, world.nodes.x);
}

template <int Dim> void Sph<Dim>::list_pairs(const World<Dim>& world, const Points<Dim>& x) {
  lists_.update(world, x, sizes_.smoothing);
  const Index n = world.nodes.size();
  wave_rates_.resize(world.chunks.size());
  stresses_.stress.resize(Eigen::NoChange, n);
  stresses_.artificial.resize(Eigen::NoChange, options_.artificial_stress.strength > 0.0 ? n : 0);
  stresses_.density.resize(static_cast<std::size_t>(2 * n));
  correction_.conservativeResize(Eigen::NoChange, options_.corrected ? n : 0);
  contacts_.resize(static_cast<std::size_t>(n));
  wall_forces_.nodes = lists_.particles_at_walls();
}

/// Power iteration with the stiffness of the particles against any strain as against that of a pressure wave, which is
/// no less, from the mode of the last estimate.
template <int Dim> void Sph<Dim>::estimate_frequency(const World<Dim>& world, int products) {
  constexpr double mixed_in = 0.05;  // random part over the root mean square: another mode may become the fastest
  constexpr int size = tensor_size(Dim);
  mode_.conservativeResizeLike(
      Points<Dim>::Zero(Dim, world.nodes.size()));  // daughters are after their body: any start will do
  const double mean = std::sqrt(mode_.squaredNorm() / static_cast<double>(mode_.size()));
  const double amount = mean > 0.0 && std::isfinite(mean) ? mixed_in * mean : 1.0;
  if (amount == 1.0) mode_.setZero();
  for (Index k = 0; k < mode_.size(); ++k)
    mode_(k) += amount * internal::random_number(static_cast<std::uint64_t>(mode_.size() * estimates_ + k));
  ++estimates_;
  // Stresses of the next step overwrite those of the mode.
  const auto multiply = [&](const Points<Dim>& mode, Points<Dim>& forces) {
    parallel_chunks(static_cast<Index>(world.chunks.size()), 1, [&](Index c, Index) {
      const Chunk<Dim>& chunk = world.chunks[c];
      const double* rates = sums(world).rates(c, mode, 0.0, false).first;
      for (Index p = 0; p < chunk.size(); ++p) {
        const Matter<Dim>& matter = chunk.matter;
        const Index a = world.point_number(chunk, p);
        const double before = matter.volume[p] * volume_ratio(matter, p) / matter.mass[p];
        const Mat<Dim> correction =
            options_.corrected ? Mat<Dim>(of_particle(correction_, a)) : Mat<Dim>(Mat<Dim>::Identity());
        // Stresses over the square of the density, by the mass of the particle as it is at rest.
        const double stiffness = before * before * matter.modulus[p] * matter.volume[p] / matter.mass[p];
        of_particle(stresses_.stress, a) = stiffness * tensor_at<Dim>(rates + size * p) * correction * correction;
      }
    });
    sums(world).forces(mode, stresses_, {}, forces, nullptr);
    forces = -forces;
  };
  const double squared = internal::power_iteration<Dim>(world.nodes.mass, products, multiply, mode_);
  frequency_ = std::max(std::sqrt(squared), forgotten * frequency_);
}

template <int Dim> void Sph<Dim>::refresh(World<Dim>& world, internal::StableStep<Dim>&) {
  auto start = std::chrono::steady_clock::now();
  counts_power_ = true;
  contacts_.find_pressed(lists_.pairs(), lists_.images(), sizes_.pressed);
  const Points<Dim>& x = world.nodes.x;
  const bool due = options_.splitting.strain > 0.0 && world.steps % splitting_interval == 0;
  if (const Index split = due ? internal::split_particles(world, options_.splitting, sizes_) : 0; split > 0) {
    world.ledger.add_count("split particles", split);
    const double smallest_before = lists_.smallest_smoothing();
    list_pairs(world, x);
    frequency_ *= smallest_before / lists_.smallest_smoothing();
  }
  if (lists_.is_due(world, sizes_.smoothing)) list_pairs(world, x);
  world.ledger.add_time("pairs", seconds_since(start));
}

template <int Dim> StrainBounds Sph<Dim>::update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least) {
  constexpr int size = tensor_size(Dim);
  const auto c = static_cast<Index>(world.number_of(chunk));
  const double half = 0.5 * world.last_step;
  const auto [rates, moments] = sums(world).rates(c, world.nodes.v, half, options_.corrected);
  Matter<Dim>& matter = chunk.matter;
  const auto volume_over_mass = [&](Index p) { return matter.volume[p] * volume_ratio(matter, p) / matter.mass[p]; };
  for (Index p = 0; p < chunk.size(); ++p) {
    matter.x.col(p) = world.nodes.x.col(world.point_number(chunk, p));
    Mat<Dim> change = Mat<Dim>::Identity();
    if (!chunk.is_eroded(p)) {
      Mat<Dim> rate = half * volume_over_mass(p) * tensor_at<Dim>(rates + size * p);
      if (options_.corrected)
        rate *= internal::gradient_correction<Dim>(volume_over_mass(p) * tensor_at<Dim>(moments + size * p));
      else
        rate *= 1.0 + rate.trace();  // by the volume in the middle of the step
      change = internal::increment<Dim>(rate);
    }
    take_increment(chunk, p, change);
  }
  const StrainBounds bounds = deform_by_increments(world, chunk, least);
  if (!options_.corrected) return bounds;
  // Forces take the correction where particles are now.
  const double* moments_now = sums(world).moments(c);
  for (Index p = 0; p < chunk.size(); ++p)
    if (!chunk.is_eroded(p))
      of_particle(correction_, world.point_number(chunk, p)) =
          internal::gradient_correction<Dim>(volume_over_mass(p) * tensor_at<Dim>(moments_now + size * p));
  return bounds;
}

template <int Dim> void Sph<Dim>::scatter_forces(const World<Dim>& world, Chunk<Dim>& chunk) {
  const Matter<Dim>& matter = chunk.matter;
  const double* columns = chunk.columns();
  contacts_.find(world, chunk);
  double& wave_rate = wave_rates_[world.number_of(chunk)];
  wave_rate = 0.0;
  for (Index p = 0; p < chunk.size(); ++p) {
    const Index a = world.point_number(chunk, p);
    double* density = stresses_.density.data() + 2 * a;
    const double J = volume_ratio(matter, p), rest = chunk.is_eroded(p) ? 0.0 : matter.mass[p] / matter.volume[p];
    Mat<Dim> over_squares = Mat<Dim>::Zero();
    if (rest > 0.0)
      for (int j = 0; j < Dim; ++j)
        for (int i = 0; i < Dim; ++i) over_squares(i, j) = J / (rest * rest) * columns[16 * p + 4 * j + i];
    of_particle(stresses_.stress, a) =
        correction_.cols() == 0 ? over_squares : Mat<Dim>(over_squares * of_particle(correction_, a));
    density[0] = rest > 0.0 ? rest / J : matter.mass[p] / std::pow(world.nodes.spacing[a], Dim);
    density[1] = rest > 0.0 ? std::sqrt(matter.modulus[p] / rest) : 0.0;
    wave_rate = std::max(wave_rate, density[1] / sizes_.smoothing[a]);
    if (stresses_.artificial.cols() != 0)
      of_particle(stresses_.artificial, a) = internal::artificial_stress<Dim>(options_.artificial_stress, over_squares);
  }
}

template <int Dim> void Sph<Dim>::collect_forces(World<Dim>& world) {
  auto start = std::chrono::steady_clock::now();
  contacts_.detach(sizes_.pressed);
  const ArtificialStress& artificial = options_.artificial_stress;
  const double exponent = artificial.exponent > 0.0
                              ? artificial.exponent
                              : 1.0 / internal::kernel_shape(options_.kernel, 1.0 / options_.smoothing);
  const auto lost =
      sums(world).forces(world.nodes.v, stresses_,
                         {.linear = options_.viscosity.linear,
                          .quadratic = options_.viscosity.quadratic,
                          .artificial = stresses_.artificial.cols() == 0 ? nullptr : stresses_.artificial.data(),
                          .reference = 1.0 / options_.smoothing,
                          .exponent = exponent},
                         world.nodes.force, &wall_forces_);
  approach_rate_ = 0.0;
  for (const auto& of : lost) approach_rate_ = std::max(approach_rate_, of.approach / lists_.smallest_smoothing());
  if (std::exchange(counts_power_, false)) {
    const double viscous_before = std::exchange(viscous_power_, 0.0),
                 artificial_before = std::exchange(artificial_power_, 0.0);
    for (const auto& of : lost) viscous_power_ += of.viscous, artificial_power_ += of.artificial;
    // The step's velocities with the mean of the forces before and after it. Powers are by forces with velocities half
    // a step earlier; those of the forces before lie between two of them.
    const double dt = world.last_step;
    world.ledger.add_energy("viscous", EnergyKind::loss, dt * (0.25 * viscous_before + 0.75 * viscous_power_));
    if (stresses_.artificial.cols() != 0)
      world.ledger.add_energy("artificial stress", EnergyKind::loss,
                              dt * (0.25 * artificial_before + 0.75 * artificial_power_));
  }
  world.ledger.add_time("pair forces", seconds_since(start));
  const double rate_before = std::exchange(wave_rate_, std::ranges::max(wave_rates_));
  if (rate_before > 0.0 && wave_rate_ > rate_before) frequency_ *= wave_rate_ / rate_before;
  if (frequency_ == 0.0 || world.steps % estimate_interval == 0) {
    estimate_frequency(world, frequency_ == 0.0 ? 16 : 2);
    const double closer = clumped_distance / options_.smoothing;
    world.ledger.set_count("clumped particles",
                           internal::count_close(lists_.pairs(), world.nodes.x, sizes_.smoothing, closer));
  }
  world.ledger.add_time("stability", seconds_since(start));
}

}  // namespace

template <int Dim> std::unique_ptr<Scheme<Dim>> sph(const SphOptions& options) {
  return std::make_unique<Sph<Dim>>(options);
}

template std::unique_ptr<Scheme<2>> sph<2>(const SphOptions&);
template std::unique_ptr<Scheme<3>> sph<3>(const SphOptions&);

}  // namespace efree
