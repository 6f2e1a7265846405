// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/sph.hpp"

#include "efree/core/aligned.hpp"
#include "efree/core/internal/random.hpp"
#include "efree/dynamics/internal/power_iteration.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/sph/internal/increment.hpp"
#include "efree/dynamics/schemes/sph/internal/lattice_waves.hpp"
#include "efree/dynamics/schemes/sph/internal/mirrored_sums.hpp"
#include "efree/dynamics/schemes/sph/internal/particle_tensors.hpp"
#include "efree/dynamics/schemes/sph/internal/splitting.hpp"
#include "efree/dynamics/schemes/sph/internal/wall_contacts.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <type_traits>
#include <utility>

namespace efree {
namespace {

using internal::LocalParticles, internal::ParticlePairs, internal::put_tensor, internal::tensor_at,
    internal::tensor_size;

/// Steps between estimates of the highest frequency, a margin for what comes until the next, and what is left of the
/// last estimate where the next one is lower.
constexpr Index estimate_interval = 16;
constexpr double margin = 1.25, forgotten = 0.9;
/// How much further than the support, over the smoothing length, pairs are listed.
constexpr double list_skin = 0.25;
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

/// The tensor of a particle among those of all.
template <class Tensors> auto of_particle(Tensors& tensors, Index particle) {
  constexpr int Dim = std::remove_cvref_t<Tensors>::RowsAtCompileTime == 4 ? 2 : 3;
  using Tensor = std::conditional_t<std::is_const_v<Tensors>, const Mat<Dim>, Mat<Dim>>;
  return Eigen::Map<Tensor>(tensors.col(particle).data());
}

/// Arrays by local number, of this thread.
struct LocalArrays {
  AlignedVector<double> x, v, stress, artificial, density, sums, moments;
};
LocalArrays& local_arrays() {
  thread_local LocalArrays arrays;
  return arrays;
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
    archive(sizes_.smoothing, sizes_.splits, x_listed_, viscous_power_, artificial_power_, wave_rate_, approach_rate_);
    archive(frequency_, mode_, estimates_, correction_, contacts_, wall_forces_);
  }
  void resume(World<Dim>& world) override { list_pairs(world, x_listed_); }
  const WallForces<Dim>* wall_forces() const override { return &wall_forces_; }

 private:
  void list_pairs(const World<Dim>& world, const Points<Dim>& x);
  bool lists_are_due(const World<Dim>& world) const;
  void estimate_frequency(const World<Dim>& world, int products);
  LocalParticles local_particles(const World<Dim>& world, const Points<Dim>& v, const ParticlePairs& pairs,
                                 double ago) const;
  void sum_rates(const World<Dim>& world, const Points<Dim>& v, const ParticlePairs& pairs, double ago, double* rates,
                 double* moments) const;
  void sum_moments(const World<Dim>& world, const ParticlePairs& pairs, double* moments) const;
  internal::MirroredParticles<Dim> mirrored(const World<Dim>& world, const Points<Dim>& v, double ago) const {
    return {images_, options_.kernel, world.nodes.x, v, ago, world.nodes.mass, sizes_.smoothing, sizes_.pressed};
  }
  std::vector<internal::LostPower> sum_forces(const World<Dim>& world, const Points<Dim>& v, internal::PairForces by,
                                              Points<Dim>& forces, WallForces<Dim>* wall_forces) const;

  SphOptions options_;
  double damping_ = 0.0;    ///< fastest damping by a viscosity of one, times the smoothing length over the wave speed
  double wave_rate_ = 0.0;  ///< largest speed of pressure waves over the smoothing length [1/time]
  double approach_rate_ = 0.0;  ///< largest q of pairs, as of ParticleViscosity, over the smoothing length [1/time]
  double frequency_ = 0.0;      ///< highest angular one, an estimate from below [1/time]
  Points<Dim> mode_;            ///< Dim x N, with that frequency
  std::int64_t estimates_ = 0;
  internal::ParticleSizes sizes_;
  double smallest_size_ = 0.0;        ///< smallest smoothing length
  std::vector<ParticlePairs> pairs_;  ///< by chunk
  std::vector<double> wave_rates_;    ///< likewise
  Points<Dim> x_listed_;              ///< positions where pairs were listed
  std::vector<internal::WallImage<Dim>> images_;
  std::size_t num_walls_ = 0;  ///< that these are of
  internal::WallContacts<Dim> contacts_;
  WallForces<Dim> wall_forces_;
  // By particle, as sum_forces takes them, tensors by their columns. Empty: none.
  Points<Dim * Dim> stress_, artificial_, correction_;
  AlignedVector<double> density_;
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
  if (!x.allFinite()) throw NumericalError(fmt::format("at time {:.6g} particles are nowhere", world.time));
  std::vector<std::vector<Index>> particles(world.chunks.size());
  std::vector<std::span<const Index>> chunks;
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    const Chunk<Dim>& chunk = world.chunks[c];
    for (Index p = 0; p < chunk.size(); ++p) particles[c].push_back(world.point_number(chunk, p));
    chunks.emplace_back(particles[c]);
  }
  images_ = internal::images_by(world.walls);
  num_walls_ = world.walls.size();
  internal::find_pairs<Dim>(x, sizes_.smoothing, kernel_support + list_skin, chunks, images_, pairs_);
  x_listed_ = x;
  smallest_size_ = sizes_.smoothing.minCoeff();
  const Index n = world.nodes.size();
  wave_rates_.resize(world.chunks.size());
  stress_.resize(Eigen::NoChange, n);
  correction_.conservativeResize(Eigen::NoChange, options_.corrected ? n : 0);
  artificial_.resize(Eigen::NoChange, options_.artificial_stress.strength > 0.0 ? n : 0);
  density_.resize(static_cast<std::size_t>(2 * n));
  contacts_.resize(static_cast<std::size_t>(n));
  wall_forces_.nodes.clear();
  for (const ParticlePairs& pairs : pairs_)
    for (Index last = -1; const internal::MirroredPair& pair : pairs.mirrored)
      if (const Index own = static_cast<Index>(pair.own); std::exchange(last, own) != own)
        wall_forces_.nodes.push_back(pairs.particles[own]);
  std::ranges::sort(wall_forces_.nodes);
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
      const ParticlePairs& pairs = pairs_[c];
      AlignedVector<double>& rates = local_arrays().sums;
      rates.resize(std::max(rates.size(), static_cast<std::size_t>(size * pairs.all())));
      sum_rates(world, mode, pairs, 0.0, rates.data(), nullptr);
      for (Index p = 0; p < chunk.size(); ++p) {
        const Matter<Dim>& matter = chunk.matter;
        const Index a = pairs.particles[p];
        const double before = matter.volume[p] * volume_ratio(matter, p) / matter.mass[p];
        const Mat<Dim> correction =
            options_.corrected ? Mat<Dim>(of_particle(correction_, a)) : Mat<Dim>(Mat<Dim>::Identity());
        // Stresses over the square of the density, by the mass of the particle as it is at rest.
        const double stiffness = before * before * matter.modulus[p] * matter.volume[p] / matter.mass[p];
        of_particle(stress_, a) = stiffness * tensor_at<Dim>(rates.data() + size * p) * correction * correction;
      }
    });
    sum_forces(world, mode, {}, forces, nullptr);
    forces = -forces;
  };
  const double squared = internal::power_iteration<Dim>(world.nodes.mass, products, multiply, mode_);
  frequency_ = std::max(std::sqrt(squared), forgotten * frequency_);
}

/// Whether particles or images of them that are not listed may have come within the support of each other.
template <int Dim> bool Sph<Dim>::lists_are_due(const World<Dim>& world) const {
  if (num_walls_ != world.walls.size()) return true;
  const Points<Dim> moved = world.nodes.x - x_listed_;
  // What all have moved together brings no particles closer to each other, but images of them.
  double furthest = (moved.colwise() - Vec<Dim>(moved.rowwise().mean())).colwise().squaredNorm().maxCoeff();
  for (const Wall<Dim>& wall : world.walls) {
    const double nearest = (wall.normal.transpose() * world.nodes.x).minCoeff() - wall.level;
    if (nearest > kernel_support * sizes_.smoothing.maxCoeff()) continue;
    const double approach = std::max(0.0, -(wall.normal.transpose() * moved).minCoeff());
    furthest += approach * approach;
  }
  const double most = 0.5 * list_skin * smallest_size_;
  return !(furthest < most * most);
}

template <int Dim> void Sph<Dim>::refresh(World<Dim>& world, internal::StableStep<Dim>&) {
  auto start = std::chrono::steady_clock::now();
  counts_power_ = true;
  contacts_.find_pressed(pairs_, images_, sizes_.pressed);
  const Points<Dim>& x = world.nodes.x;
  const bool due = options_.splitting.strain > 0.0 && world.steps % splitting_interval == 0;
  if (const Index split = due ? internal::split_particles(world, options_.splitting, sizes_) : 0; split > 0) {
    world.ledger.add_count("split particles", split);
    const double smallest_before = smallest_size_;
    list_pairs(world, x);
    frequency_ *= smallest_before / smallest_size_;
  }
  if (lists_are_due(world)) list_pairs(world, x);
  world.ledger.add_time("pairs", seconds_since(start));
}

/// Particles with these velocities, where they were that time ago by them.
template <int Dim> LocalParticles Sph<Dim>::local_particles(const World<Dim>& world, const Points<Dim>& velocities,
                                                            const ParticlePairs& pairs, double ago) const {
  LocalArrays& arrays = local_arrays();
  const auto n = static_cast<std::size_t>(pairs.all());
  arrays.x.resize(std::max(arrays.x.size(), 4 * n));
  arrays.v.resize(arrays.x.size());
  const Nodes<Dim>& nodes = world.nodes;
  bool one_size = true;
  for (std::size_t l = 0; l < n; ++l) {
    const Index a = pairs.particles[l];
    double *x = arrays.x.data() + 4 * l, *v = arrays.v.data() + 4 * l;
    x[2] = v[2] = 0.0;
    for (int i = 0; i < Dim; ++i) {
      v[i] = velocities(i, a);
      x[i] = nodes.x(i, a) - ago * v[i];
    }
    x[3] = 1.0 / sizes_.smoothing[a];
    v[3] = nodes.mass[a];
    one_size = one_size && x[3] == arrays.x[3];
  }
  return {.dim = Dim, .kernel = options_.kernel, .one_size = one_size, .x = arrays.x.data(), .v = arrays.v.data()};
}

template <int Dim> void Sph<Dim>::sum_rates(const World<Dim>& world, const Points<Dim>& v, const ParticlePairs& pairs,
                                            double ago, double* rates, double* moments) const {
  internal::sum_rates(pairs, local_particles(world, v, pairs, ago), rates, moments);
  internal::add_mirrored_rates(pairs, mirrored(world, v, ago), rates, moments);
}

/// The moments of sum_rates where particles are now, which are the gradients of their positions.
template <int Dim>
void Sph<Dim>::sum_moments(const World<Dim>& world, const ParticlePairs& pairs, double* moments) const {
  internal::sum_rates(pairs, local_particles(world, world.nodes.x, pairs, 0.0), moments);
  internal::add_mirrored_rates(pairs, mirrored(world, world.nodes.v, 0.0), nullptr, moments);
}

template <int Dim> StrainBounds Sph<Dim>::update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least) {
  constexpr int size = tensor_size(Dim);
  const ParticlePairs& pairs = pairs_[world.number_of(chunk)];
  const double half = 0.5 * world.last_step;
  AlignedVector<double>&rates = local_arrays().sums, &moments = local_arrays().moments;
  for (auto* sums : {&rates, &moments})
    sums->resize(std::max(sums->size(), static_cast<std::size_t>(size * pairs.all())));
  sum_rates(world, world.nodes.v, pairs, half, rates.data(), options_.corrected ? moments.data() : nullptr);
  Matter<Dim>& matter = chunk.matter;
  const auto volume_over_mass = [&](Index p) { return matter.volume[p] * volume_ratio(matter, p) / matter.mass[p]; };
  for (Index p = 0; p < chunk.size(); ++p) {
    matter.x.col(p) = world.nodes.x.col(pairs.particles[p]);
    Mat<Dim> change = Mat<Dim>::Identity();
    if (!chunk.is_eroded(p)) {
      Mat<Dim> rate = half * volume_over_mass(p) * tensor_at<Dim>(rates.data() + size * p);
      if (options_.corrected)
        rate *= internal::gradient_correction<Dim>(volume_over_mass(p) * tensor_at<Dim>(moments.data() + size * p));
      else
        rate *= 1.0 + rate.trace();  // by the volume in the middle of the step
      change = internal::increment<Dim>(rate);
    }
    take_increment(chunk, p, change);
  }
  const StrainBounds bounds = deform_by_increments(world, chunk, least);
  if (!options_.corrected) return bounds;
  // Forces take the correction where particles are now.
  sum_moments(world, pairs, moments.data());
  for (Index p = 0; p < chunk.size(); ++p)
    if (!chunk.is_eroded(p))
      of_particle(correction_, pairs.particles[p]) =
          internal::gradient_correction<Dim>(volume_over_mass(p) * tensor_at<Dim>(moments.data() + size * p));
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
    double* density = density_.data() + 2 * a;
    const double J = volume_ratio(matter, p), rest = chunk.is_eroded(p) ? 0.0 : matter.mass[p] / matter.volume[p];
    Mat<Dim> over_squares = Mat<Dim>::Zero();
    if (rest > 0.0)
      for (int j = 0; j < Dim; ++j)
        for (int i = 0; i < Dim; ++i) over_squares(i, j) = J / (rest * rest) * columns[16 * p + 4 * j + i];
    of_particle(stress_, a) =
        correction_.cols() == 0 ? over_squares : Mat<Dim>(over_squares * of_particle(correction_, a));
    density[0] = rest > 0.0 ? rest / J : matter.mass[p] / std::pow(world.nodes.spacing[a], Dim);
    density[1] = rest > 0.0 ? std::sqrt(matter.modulus[p] / rest) : 0.0;
    wave_rate = std::max(wave_rate, density[1] / sizes_.smoothing[a]);
    if (artificial_.cols() != 0)
      of_particle(artificial_, a) = internal::artificial_stress<Dim>(options_.artificial_stress, over_squares);
  }
}

/// Dim x N, forces of stress_ and of what `by` has besides; and the power lost to it, by chunk.
template <int Dim> std::vector<internal::LostPower> Sph<Dim>::sum_forces(const World<Dim>& world, const Points<Dim>& v,
                                                                         internal::PairForces by, Points<Dim>& forces,
                                                                         WallForces<Dim>* wall_forces) const {
  constexpr int size = tensor_size(Dim);
  if (wall_forces) {
    wall_forces->forces.resize(world.walls.size());
    for (auto& of : wall_forces->forces) of.setZero(Dim, std::ssize(wall_forces->nodes));
  }
  std::vector<internal::LostPower> lost(world.chunks.size());
  parallel_chunks(static_cast<Index>(world.chunks.size()), 1, [&, by](Index c, Index) {
    const ParticlePairs& pairs = pairs_[c];
    LocalArrays& arrays = local_arrays();
    const auto n = static_cast<std::size_t>(pairs.all());
    const auto gather = [&](const Points<Dim * Dim>& from, AlignedVector<double>& to) {
      to.resize(std::max(to.size(), size * n));
      for (std::size_t l = 0; l < n; ++l) put_tensor<Dim>(of_particle(from, pairs.particles[l]), to.data() + size * l);
      return to.data();
    };
    internal::PairForces local = by;
    local.stress = gather(stress_, arrays.stress);
    arrays.density.resize(std::max(arrays.density.size(), 2 * n));
    for (std::size_t l = 0; l < n; ++l)
      std::copy_n(density_.data() + 2 * pairs.particles[l], 2, arrays.density.data() + 2 * l);
    local.density = arrays.density.data();
    if (by.artificial) local.artificial = gather(artificial_, arrays.artificial);
    arrays.sums.resize(std::max(arrays.sums.size(), 4 * n));
    lost[c] = internal::sum_forces(pairs, local_particles(world, v, pairs, 0.0), local, arrays.sums.data());
    local.stress = stress_.data();
    local.density = density_.data();
    const auto by_walls = internal::add_mirrored_forces(pairs, mirrored(world, v, 0.0), local, world.walls,
                                                        arrays.sums.data(), wall_forces);
    lost[c].viscous += by_walls.viscous;
    lost[c].approach = std::max(lost[c].approach, by_walls.approach);
    for (Index l = 0; l < pairs.own; ++l)
      forces.col(pairs.particles[l]) = Eigen::Map<const Vec<Dim>>(arrays.sums.data() + 4 * l);
  });
  return lost;
}

template <int Dim> void Sph<Dim>::collect_forces(World<Dim>& world) {
  auto start = std::chrono::steady_clock::now();
  contacts_.detach(sizes_.pressed);
  const ArtificialStress& artificial = options_.artificial_stress;
  const double exponent = artificial.exponent > 0.0
                              ? artificial.exponent
                              : 1.0 / internal::kernel_shape(options_.kernel, 1.0 / options_.smoothing);
  const auto lost = sum_forces(world, world.nodes.v,
                               {.linear = options_.viscosity.linear,
                                .quadratic = options_.viscosity.quadratic,
                                .artificial = artificial_.cols() == 0 ? nullptr : artificial_.data(),
                                .reference = 1.0 / options_.smoothing,
                                .exponent = exponent},
                               world.nodes.force, &wall_forces_);
  approach_rate_ = 0.0;
  for (const auto& of : lost) approach_rate_ = std::max(approach_rate_, of.approach / smallest_size_);
  if (std::exchange(counts_power_, false)) {
    const double viscous_before = std::exchange(viscous_power_, 0.0),
                 artificial_before = std::exchange(artificial_power_, 0.0);
    for (const auto& of : lost) viscous_power_ += of.viscous, artificial_power_ += of.artificial;
    // The step's velocities with the mean of the forces before and after it. Powers are by forces with velocities half
    // a step earlier; those of the forces before lie between two of them.
    const double dt = world.last_step;
    world.ledger.add_energy("viscous", EnergyKind::loss, dt * (0.25 * viscous_before + 0.75 * viscous_power_));
    if (artificial_.cols() != 0)
      world.ledger.add_energy("artificial stress", EnergyKind::loss,
                              dt * (0.25 * artificial_before + 0.75 * artificial_power_));
  }
  world.ledger.add_time("pair forces", seconds_since(start));
  const double rate_before = std::exchange(wave_rate_, std::ranges::max(wave_rates_));
  if (rate_before > 0.0 && wave_rate_ > rate_before) frequency_ *= wave_rate_ / rate_before;
  if (frequency_ == 0.0 || world.steps % estimate_interval == 0) {
    estimate_frequency(world, frequency_ == 0.0 ? 16 : 2);
    const double closer = clumped_distance / options_.smoothing;
    world.ledger.set_count("clumped particles", internal::count_close(pairs_, world.nodes.x, sizes_.smoothing, closer));
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
