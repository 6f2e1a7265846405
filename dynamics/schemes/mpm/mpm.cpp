// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/mpm.hpp"

#include "efree/dynamics/internal/kernels.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/schemes/mpm/internal/fastest_mode.hpp"
#include "efree/dynamics/schemes/mpm/internal/grid_contact.hpp"
#include "efree/dynamics/schemes/mpm/internal/grid_functions.hpp"
#include "efree/dynamics/schemes/mpm/internal/prescribed_points.hpp"
#include "efree/dynamics/schemes/mpm/internal/separation.hpp"
#include "efree/dynamics/schemes/mpm/internal/transfer_balance.hpp"

#include <fmt/ranges.h>
#include <Eigen/LU>
#include <utility>

namespace efree {
namespace {

using internal::gathered_columns, internal::Particles;

void require_options(const MpmOptions& options) {
  const auto fail = [](const std::string& what) { throw InputError("the material point method: " + what); };
  if (!(options.cell > 0.0) || !std::isfinite(options.cell))
    fail(fmt::format("cell {}, expected a positive length", options.cell));
  if (options.degree < 1 || options.degree > 3) fail(fmt::format("degree {}, expected 1, 2 or 3", options.degree));
  if (!(options.flip >= 0.0) || options.flip > 1.0) fail(fmt::format("flip {}, expected 0 to 1", options.flip));
  if (options.order < 1 || options.order > 16) fail(fmt::format("order {}, expected 1 to 16", options.order));
  if (options.remap && options.transfer == Transfer::polypic)
    fail("remap is not for polypic, whose modes the grid of remapped velocities does not get");
  for (const double x : options.origin)
    if (!std::isfinite(x)) fail("expected an origin");
}

/// Velocities by which the points of a chunk move in a step, and their gradients, by columns: of this thread, for
/// whatever chunk it works on.
template <int Dim> struct PointMotion {
  Points<Dim> moved;
  Points<Dim * Dim> gradient;
};
template <int Dim> PointMotion<Dim>& point_motion() {
  thread_local PointMotion<Dim> room;
  return room;
}

/// The gradient of a point's velocity, from what was gathered for it.
template <int Dim> void take_gradient(const double* column, Points<Dim * Dim>& gradients, Index p) {
  for (int j = 0; j < Dim; ++j)
    gradients.col(p).template segment<Dim>(Dim * j) = Eigen::Map<const Vec<Dim>>(column + 4 * (1 + j));
}

template <int Dim> class Mpm final : public Scheme<Dim> {
 public:
  explicit Mpm(const MpmOptions& options) : options_(options), grid_(options) { require_options(options); }
  std::string name() const override { return "mpm"; }
  std::vector<double> identity() const override {
    std::vector<double> numbers{options_.cell, 1.0 * options_.degree, static_cast<double>(options_.transfer),
                                1.0 * options_.order, options_.remap ? 1.0 : 0.0};
    for (const auto& [a, b] : options_.ties) numbers.insert(numbers.end(), {1.0 * a, 1.0 * b});
    return numbers;
  }
  bool nodes_persist() const override { return false; }

  PointStorage point_storage(const DeformableBody<Dim>& body) const override {
    return {.supports = body.nodes.cols() != 0};
  }
  void begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) override;
  void refresh(World<Dim>& world, internal::StableStep<Dim>&) override;
  StrainBounds update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least) override;
  void scatter_forces(const World<Dim>& world, Chunk<Dim>& chunk) override;
  void collect_forces(World<Dim>& world) override;
  void find_prescribed(World<Dim>& world) override { internal::find_prescribed_nodes(world, grid_); }
  double largest_speed(const World<Dim>&) const override {
    double speed = 0.0;
    for (const Particles<Dim>& of : grid_.particles) speed = std::max(speed, of.speed);
    return speed;
  }
  ContactPoints<Dim> find_contact_points(const World<Dim>& world, const RigidShape<Dim>& gap_at,
                                         double reach) const override {
    return internal::find_contact_points(world, grid_, gap_at, reach);
  }
  Points<Dim> point_velocities(const World<Dim>& world) const override {
    Points<Dim> result(Dim, world.num_points());
    for (std::size_t c = 0; c < world.chunks.size(); ++c)
      for (Index p = 0; p < world.chunks[c].size(); ++p)
        result.col(world.point_number(world.chunks[c], p)) = grid_.particles[c].velocity_of(p);
    return result;
  }
  std::optional<double> stable_step(const World<Dim>& world) const override;
  void pack(Archive& archive) override { archive(grid_.particles, balance_, frequency_); }
  void stop(World<Dim>& world) override {
    for (Particles<Dim>& of : grid_.particles) {
      of.v.setZero();
      of.motion.setZero();
      of.moved.setZero();
      of.speed = of.power = 0.0;
    }
    grid_.rebuild(world, false);
  }
  void resume(World<Dim>& world) override {
    for (std::size_t c = 0; c < grid_.particles.size(); ++c) grid_.particles[c].complete(world.chunks[c]);
    grid_.rebuild(world, false);
  }

 private:
  bool is_affine() const {
    return options_.transfer == Transfer::apic || options_.transfer == Transfer::rpic ||
           options_.transfer == Transfer::aflip;
  }
  bool is_polynomial() const { return options_.transfer == Transfer::polypic; }
  Particles<Dim>& particles_of(const World<Dim>& world, const Chunk<Dim>& chunk) {
    return grid_.particles[world.number_of(chunk)];
  }
  void transfer_to_particles(World<Dim>& world, Chunk<Dim>& chunk, Particles<Dim>& particles);
  void filter_velocities(World<Dim>& world);
  void remap_motion(World<Dim>& world);
  void move_points(Chunk<Dim>& chunk, Particles<Dim>& particles, const Points<Dim>& moved, double dt);
  void move_vertices(Chunk<Dim>& chunk, Particles<Dim>& particles, double dt);
  void find_power(const World<Dim>& world, const Chunk<Dim>& chunk, const double* stress,
                  Particles<Dim>& particles) const;

  MpmOptions options_;
  internal::PointGrid<Dim> grid_;
  internal::HighestFrequency<Dim> frequency_;
  internal::TransferBalance<Dim> balance_;
};

template <int Dim> void Mpm<Dim>::begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) {
  if (world.axisymmetric())
    throw InputError("the material point method is of plane strain or in space, not of an axisymmetric section");
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto fail = [&](const std::string& what) { throw InputError(fmt::format("body {}: {}", b, what)); };
    if (bodies[b].points.cols() == 0) fail("expected material points");
    const bool is_mesh = bodies[b].nodes.cols() != 0;
    if (is_mesh && bodies[b].cells.cols() == 0)
      fail("the material point method makes its own nodes: expected points only, or a mesh with vertices and cells");
    if (is_mesh && options_.remap) fail("remap is for points: strains of a mesh are those between its vertices");
  }
  for (Chunk<Dim>& chunk : world.chunks) {
    const DeformableBody<Dim>& body = bodies[chunk.body];
    Particles<Dim>& of = grid_.particles.emplace_back();
    if (body.nodes.cols() != 0) of.mesh.emplace(chunk, body.cells, body.nodes);
    const std::vector<Index>& number = of.mesh ? of.mesh->number : chunk.number;
    const auto n = static_cast<Index>(number.size());
    of.v.setZero(Dim, n);
    if (!of.mesh) of.separated.assign(number.size(), 0);
    if (body.velocity.size() != 0) of.v = body.velocity(Eigen::all, number);
    if (is_affine()) of.motion.setZero(Dim * Dim, n);
    if (is_polynomial()) of.motion.setZero(Dim * (internal::num_modes(Dim, options_.degree) - 1), n);
  }
  std::vector<char> is_mesh(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) is_mesh[b] = bodies[b].nodes.cols() != 0 ? 1 : 0;
  world.functions_at = [this, is_mesh](const auto& now, const auto& at, const auto& of) {
    return internal::functions_on_grid(now, grid_, is_mesh, at, of);
  };
  grid_.tie(options_.ties, world.num_bodies());
  balance_.begin(world.num_bodies());
  grid_.rebuild(world, true);
  // After prescribed velocities, before walls and rigid bodies.
  if (world.num_bodies() > 1 && world.options.contact.enabled)
    world.interactions.insert(world.interactions.begin() + 3,
                              internal::grid_contact<Dim>(grid_, world.options.contact.friction));
  world.options.contact.enabled = false;  // there are no facets
}

/// Velocities of the particles and around them, by those of the nodes.
template <int Dim>
void Mpm<Dim>::transfer_to_particles(World<Dim>& world, Chunk<Dim>& chunk, Particles<Dim>& particles) {
  const Index n = particles.count();
  const double* columns = grid_.gather(chunk, particles, world.nodes.v);
  const bool is_flip = options_.transfer == Transfer::flip || options_.transfer == Transfer::aflip;
  Points<Dim>& moved = particles.mesh || options_.remap ? particles.moved : point_motion<Dim>().moved;
  Points<Dim* Dim>& gradients = options_.remap ? particles.not_strained : point_motion<Dim>().gradient;
  moved.resize(Dim, n);
  if (!particles.mesh) gradients.resize(Dim * Dim, n);
  const double* before = nullptr;
  if (is_flip || options_.transfer == Transfer::xpic)
    before = grid_.gather_values(chunk, particles, world.nodes.v_before);
  for (Index p = 0; p < n; ++p) {
    const double* column = columns + 4 * gathered_columns * p;
    const Eigen::Map<const Vec<Dim>> now(column);
    moved.col(p) = now;
    if (!particles.mesh) take_gradient<Dim>(column, gradients, p);
    auto v = particles.v.col(p);
    if (is_flip)
      v = options_.flip * (v + now - Eigen::Map<const Vec<Dim>>(before + 4 * p)) + (1.0 - options_.flip) * now;
    else if (options_.transfer == Transfer::xpic)
      v = particles.filtered.col(p) + now - Eigen::Map<const Vec<Dim>>(before + 4 * p);
    else
      v = now;
    if (!is_affine()) continue;
    Eigen::Map<Mat<Dim>> C(particles.motion.col(p).data());
    for (int j = 0; j < Dim; ++j) C.col(j) = Eigen::Map<const Vec<Dim>>(column + 4 * (4 + j));
    if (options_.transfer == Transfer::rpic) C = Mat<Dim>(0.5 * (C - C.transpose()));
  }
  if (is_polynomial()) {
    const int count = internal::num_modes(Dim, options_.degree);
    const double* modes = grid_.gather_modes(chunk, particles, world.nodes.v);
    for (Index p = 0; p < n; ++p)
      for (int m = 1; m < count; ++m)
        particles.motion.col(p).template segment<Dim>(Dim * (m - 1)) =
            Eigen::Map<const Vec<Dim>>(modes + 4 * (count * p + m));
  }
}

/// particles.filtered = (I - (I - S S+)^m) v.
template <int Dim> void Mpm<Dim>::filter_velocities(World<Dim>& world) {
  Points<Dim> on_nodes = world.nodes.v_before;  // S+ v
  for (Particles<Dim>& of : grid_.particles) of.filtered = of.v;
  for (int k = 1; k <= options_.order; ++k) {
    if (k > 1)
      on_nodes = grid_.velocities_of(world, [](const Particles<Dim>& of) -> const Points<Dim>& { return of.filtered; });
    grid_.for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
      const double* values = grid_.gather_values(chunk, of, on_nodes);
      for (Index p = 0; p < of.count(); ++p) of.filtered.col(p) -= Eigen::Map<const Vec<Dim>>(values + 4 * p);
    });
  }
  for (Particles<Dim>& of : grid_.particles) of.filtered = of.v - of.filtered;
}

/// Points move, strained by gradients of the velocities that they have now, on the grid. What the stresses would have
/// done beyond in the motion of the nodes is lost.
template <int Dim> void Mpm<Dim>::remap_motion(World<Dim>& world) {
  Points<Dim> on_nodes =
      grid_.velocities_of(world, [](const Particles<Dim>& of) -> const Points<Dim>& { return of.v; });
  on_nodes = world.nodes.free.cwiseProduct(on_nodes) + world.nodes.v - world.nodes.free.cwiseProduct(world.nodes.v);
  grid_.for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
    const double* columns = grid_.gather(chunk, of, on_nodes);
    Points<Dim* Dim>& gradients = point_motion<Dim>().gradient;
    gradients.resize(Dim * Dim, chunk.size());
    of.lost_power = 0.0;
    for (Index p = 0; p < chunk.size(); ++p) {
      take_gradient<Dim>(columns + 4 * gathered_columns * p, gradients, p);
      of.not_strained.col(p) -= gradients.col(p);
      const Mat<3> tau =
          Eigen::Map<const Mat<3>>(chunk.matter.P.col(p).data()) * chunk.matter.now.gradient(p).transpose();
      of.lost_power +=
          chunk.matter.volume[p] * tau.template topLeftCorner<Dim, Dim>()
                                       .cwiseProduct(Eigen::Map<const Mat<Dim>>(of.not_strained.col(p).data()))
                                       .sum();
    }
    move_points(chunk, of, of.moved, world.last_step);
  });
}

/// Positions and deformation gradients, by velocities and point_motion().gradient.
template <int Dim>
void Mpm<Dim>::move_points(Chunk<Dim>& chunk, Particles<Dim>& particles, const Points<Dim>& moved, double dt) {
  Matter<Dim>& matter = chunk.matter;
  const Points<Dim* Dim>& gradients = point_motion<Dim>().gradient;
  matter.x += dt * moved;
  particles.strain = dt * std::sqrt(gradients.colwise().squaredNorm().maxCoeff());
  for (Index p = 0; p < chunk.size(); ++p)
    take_increment<Dim>(chunk, p, Mat<Dim>::Identity() + dt * Eigen::Map<const Mat<Dim>>(gradients.col(p).data()));
}

/// Positions of vertices, by which update_points finds deformation gradients.
template <int Dim> void Mpm<Dim>::move_vertices(Chunk<Dim>& chunk, Particles<Dim>& particles, double dt) {
  const Points<Dim* Dim> gradient = particles.mesh->spatial_gradients(chunk, particles.moved);
  particles.strain = dt * std::sqrt(gradient.colwise().squaredNorm().maxCoeff());
  particles.mesh->x += dt * particles.moved;
  particles.release_eroded_cells(chunk);
}

template <int Dim> void Mpm<Dim>::refresh(World<Dim>& world, internal::StableStep<Dim>&) {
  auto start = std::chrono::steady_clock::now();
  const double dt = world.last_step;
  balance_.leave_grid(world);
  if (options_.transfer == Transfer::xpic) filter_velocities(world);
  grid_.for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
    transfer_to_particles(world, chunk, of);
    if (of.mesh)
      move_vertices(chunk, of, dt);
    else if (!options_.remap)
      move_points(chunk, of, point_motion<Dim>().moved, dt);
  });
  if (options_.remap) remap_motion(world);
  world.ledger.add_time("transfers", seconds_since(start));
  grid_.rebuild(world, true);
  world.ledger.add_time("grid", seconds_since(start));
  frequency_.add_strains(grid_);
}

template <int Dim> StrainBounds Mpm<Dim>::update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least) {
  Particles<Dim>& particles = particles_of(world, chunk);
  if (particles.mesh) return deform_by_table(world, chunk, particles.mesh->table, particles.mesh->x, least);
  return deform_by_increments(world, chunk, least);
}

/// Of points: the power of their stresses in the motion of the last step, and in what remapping took from it.
template <int Dim> void Mpm<Dim>::find_power(const World<Dim>& world, const Chunk<Dim>& chunk, const double* stress,
                                             Particles<Dim>& particles) const {
  const Matter<Dim>& matter = chunk.matter;
  particles.power = 0.0;
  if (world.last_step > 0.0)
    particles.power =
        -internal::work_of_last_motion(chunk.size(), matter.volume.data(), matter.F_since.data(), stress) /
        world.last_step;
  if (!options_.remap || particles.not_strained.size() == 0) return;
  double lost = 0.0;
  for (Index p = 0; p < chunk.size(); ++p) {
    const Mat<Dim> rate = Eigen::Map<const Mat<Dim>>(particles.not_strained.col(p).data()) *
                          matter.F_since[p].template topLeftCorner<Dim, Dim>().inverse();
    for (int j = 0; j < Dim; ++j)
      for (int i = 0; i < Dim; ++i) lost += matter.volume[p] * stress[16 * p + 4 * j + i] * rate(i, j);
  }
  particles.power -= lost;
  particles.lost_power += lost;
}

template <int Dim> void Mpm<Dim>::scatter_forces(const World<Dim>& world, Chunk<Dim>& chunk) {
  share_patch_pressures(chunk);
  Particles<Dim>& particles = particles_of(world, chunk);
  const Matter<Dim>& matter = chunk.matter;
  double fastest = 0.0;
  for (Index p = 0; p < chunk.size(); ++p)
    if (matter.volume[p] > 0.0) fastest = std::max(fastest, matter.modulus[p] * matter.volume[p] / matter.mass[p]);
  particles.fastest = std::sqrt(fastest);
  particles.speed = std::sqrt(particles.v.colwise().squaredNorm().maxCoeff());
  internal::ScatteredPoints scattered = particles.moving(chunk, particles.v);
  double* slots = grid_.clear_slots(particles);
  if (particles.mesh) {
    const double* forces = particles.mesh->forces(world, chunk);
    particles.power = 0.0;
    for (Index k = 0; k < particles.count(); ++k)
      particles.power += particles.moved.col(k).dot(Eigen::Map<const Vec<Dim>>(forces + 4 * k));
    internal::scatter_values(particles.count(), particles.box, scattered.x, forces, slots);
  } else {
    scattered.stress = chunk.columns();
    scattered.volume = matter.volume.data();
    find_power(world, chunk, scattered.stress, particles);
    if (world.steps % internal::separation_interval == 0)
      internal::find_separated(options_, chunk, scattered.stress, particles);
  }
  internal::scatter(particles.count(), particles.box, scattered, slots);
  if (is_polynomial()) {
    const int count = internal::num_modes(Dim, options_.degree);
    double* modes = grid_.modes(particles, count);
    for (Index p = 0; p < particles.count(); ++p) {
      std::fill_n(modes + 4 * count * p, 4, 0.0);
      for (int m = 1; m < count; ++m) {
        double* mode = modes + 4 * (count * p + m);
        mode[3] = 0.0;
        for (int i = 0; i < 3; ++i) mode[i] = i < Dim ? particles.motion(Dim * (m - 1) + i, p) : 0.0;
      }
    }
    internal::scatter_modes(particles.count(), particles.box, scattered.x, scattered.mass, modes, slots);
  }
  grid_.take_slots(chunk, particles);
}

template <int Dim> void Mpm<Dim>::collect_forces(World<Dim>& world) {
  efree::collect_forces(world, world.nodes.force);
  grid_.collect_velocities(world);
  internal::find_prescribed_nodes(world, grid_);
  frequency_.update(world, grid_);
  Index separated = 0;
  for (Particles<Dim>& of : grid_.particles) separated += std::exchange(of.newly_separated, 0);
  world.ledger.add_count("separated points", separated);
  balance_.take_grid(world, grid_);
}

template <int Dim> std::optional<double> Mpm<Dim>::stable_step(const World<Dim>& world) const {
  // No point moves by more than a cell.
  return std::min(world.options.courant * 2.0 / frequency_.value(), options_.cell / largest_speed(world));
}

}  // namespace

template <int Dim> std::unique_ptr<Scheme<Dim>> mpm(const MpmOptions& options) {
  return std::make_unique<Mpm<Dim>>(options);
}

template std::unique_ptr<Scheme<2>> mpm<2>(const MpmOptions&);
template std::unique_ptr<Scheme<3>> mpm<3>(const MpmOptions&);

}  // namespace efree
