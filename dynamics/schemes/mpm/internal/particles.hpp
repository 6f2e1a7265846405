// SPDX-License-Identifier: GPL-3.0-or-later
/// What carries mass and velocities in the material point method, and the grid's nodes around it.
#pragma once

#include "efree/core/packer.hpp"
#include "efree/dynamics/contact/contact_points.hpp"
#include "efree/dynamics/schemes/mpm/internal/cell_vertices.hpp"
#include "efree/dynamics/schemes/mpm/internal/sparse_grid.hpp"
#include "efree/dynamics/schemes/mpm/internal/transfer_kernels.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"

#include <numeric>

namespace efree::internal {

/// Half of the size of a point along a unit vector.
template <int Dim> double half_size(const Matter<Dim>& matter, Index p, const Vec<Dim>& normal) {
  const Mat<3> F = matter.F_since[p] * Eigen::Map<const Mat<3>>(matter.F_table.col(p).data());
  const double edge = Dim == 2 ? std::sqrt(matter.volume[p]) : std::cbrt(matter.volume[p]);
  return 0.5 * edge * (F.template topLeftCorner<Dim, Dim>().transpose() * normal).norm();
}

/// The particles of a chunk, which carry mass and velocity: its points, or in a Lagrangian mesh the vertices of its
/// cells. And the box of grid nodes around them.
template <int Dim> struct Particles {
  std::optional<CellVertices<Dim>> mesh;
  Points<Dim> v;      ///< Dim x n, velocities half a step ago
  Matrix motion;      ///< what is known of the velocity around each particle, by Transfer
  Points<Dim> moved;  ///< Dim x n, velocities of the step by which vertices, or points with remap, move
  /// Of points, with MpmOptions::remap: gradients of the nodes' velocities less those that strain the points, by
  /// columns, and the sum of the powers of the stresses in these before and after the step.
  Points<Dim * Dim> not_strained;
  double lost_power = 0.0;
  Points<Dim> filtered;             ///< of Transfer::xpic
  GridBox box;                      ///< its slots are nodes that may be there
  Site<Dim> low, size;              ///< first site of the box, and number of sites along each axis
  std::vector<char> separated;      ///< by point that is a particle, 1: was too far from its neighbours
  Index newly_separated = 0;        ///< points in this step
  std::vector<char> marked;         ///< by slot, 1: there is such a node
  std::vector<Index> slots;         ///< by local number of a node: its slot
  AlignedVector<double> momentum;   ///< by local number: momentum and mass, four numbers
  AlignedVector<double> held;       ///< likewise of points with prescribed velocity
  Points<Dim * Dim> held_gradient;  ///< of the prescribed velocities where they vary, by columns; or none
  double strain = 0.0;              ///< largest norm of the gradient of displacements of the last step
  double power = 0.0;               ///< of the stresses now, in the motion of the last step
  double speed = 0.0;               ///< largest of a point
  double fastest = 0.0;             ///< speed of pressure waves

  Index count() const { return static_cast<Index>(v.cols()); }
  const Points<Dim>& positions(const Chunk<Dim>& chunk) const { return mesh ? mesh->x : chunk.matter.x; }
  const Vector& masses(const Chunk<Dim>& chunk) const { return mesh ? mesh->mass : chunk.matter.mass; }
  /// Velocity of a point: its own, or the mean of the vertices of its cell.
  Vec<Dim> velocity_of(Index point) const {
    return mesh ? Vec<Dim>(v(Eigen::all, mesh->cells.col(point)).rowwise().mean()) : Vec<Dim>(v.col(point));
  }
  /// Masses and these velocities, for the grid.
  ScatteredPoints moving(const Chunk<Dim>& chunk, const Points<Dim>& velocities) const {
    return {.x = positions(chunk).data(),
            .mass = masses(chunk).data(),
            .v = velocities.data(),
            .motion = is_affine() ? motion.data() : nullptr};
  }
  /// How far a body reaches beyond a particle along a unit vector: to its surface, where vertices are.
  double reach(const Chunk<Dim>& chunk, Index particle, const Vec<Dim>& along) const {
    return mesh ? 0.0 : half_size<Dim>(chunk.matter, particle, along);
  }
  /// A number of a particle that no other has, and the same in the next step.
  Index identity(const World<Dim>& world, const Chunk<Dim>& chunk, Index particle) const {
    if (!mesh) return (Dim + 1) * world.point_number(chunk, particle);
    const auto corners = mesh->cells.reshaped();
    const Index corner = static_cast<Index>(std::ranges::find(corners, particle) - corners.begin());
    return (Dim + 1) * world.point_number(chunk, corner / (Dim + 1)) + corner % (Dim + 1);
  }
  /// Calls visit(particle, mass) for those that carry the mass of a point.
  template <class Visit> void for_each_share(const Chunk<Dim>& chunk, Index point, const Visit& visit) const {
    const double m = chunk.matter.mass[point];
    if (!mesh) return visit(point, m);
    for (int i = 0; i <= Dim; ++i) visit(mesh->cells(i, point), m / (Dim + 1));
  }

  /// The particles of these points, without sums over the chunk. Call `complete` afterwards.
  Particles select(const std::vector<Index>& points) const {
    Particles result;
    std::vector<Index> selected = points;
    if (mesh) result.mesh = mesh->select(points, selected);
    result.v = v(Eigen::all, selected);
    if (moved.size() != 0) result.moved = moved(Eigen::all, selected);
    if (motion.size() != 0) result.motion = motion(Eigen::all, selected);
    if (held_gradient.size() != 0) result.held_gradient = held_gradient(Eigen::all, selected);
    if (not_strained.size() != 0) result.not_strained = not_strained(Eigen::all, points);
    if (!mesh)
      for (const Index p : points) result.separated.push_back(separated[p]);
    return result;
  }
  /// Cells that bear no stress any more become one vertex each.
  void release_eroded_cells(const Chunk<Dim>& chunk) {
    bool any = false;
    for (Index p = 0; p < chunk.size(); ++p) {
      if (!chunk.is_eroded(p) || mesh->is_released(p)) continue;
      any = true;
      const auto append_mean = [&](auto& values) {
        if (values.size() == 0) return;
        const auto mean = values(Eigen::all, mesh->cells.col(p)).rowwise().mean().eval();
        values.conservativeResize(Eigen::NoChange, values.cols() + 1);
        values.rightCols(1) = mean;
      };
      append_mean(v), append_mean(motion), append_mean(moved), append_mean(held_gradient);
      mesh->release(p);
    }
    if (!any) return;
    std::vector<Index> all(static_cast<std::size_t>(chunk.size()));
    std::iota(all.begin(), all.end(), 0);
    Particles without_unused = select(all);
    without_unused.lost_power = lost_power;
    without_unused.strain = strain;
    *this = std::move(without_unused);
    complete(chunk);
  }

  /// After `select`, or after a checkpoint was read: finds what neither has.
  void complete(const Chunk<Dim>& chunk) {
    marked.clear();
    if (mesh) mesh->complete(chunk.matter);
  }
  /// Whether `motion` is the gradient of an affine velocity.
  bool is_affine() const { return motion.rows() == Dim * Dim; }
  /// Without what `rebuild` and every step find again.
  friend auto fields(Particles& of) {
    return std::tie(of.mesh, of.v, of.motion, of.separated, of.held_gradient, of.speed, of.fastest);
  }
};

/// The grid around the particles of all bodies. Nodes of the world are its nodes.
template <int Dim> class PointGrid {
 public:
  explicit PointGrid(const MpmOptions& options) : degree_(options.degree), cell_(options.cell) {
    for (int i = 0; i < Dim; ++i) origin_[i] = options.origin[static_cast<std::size_t>(i)];
  }
  /// Bodies that are tied share a grid from now on. Throws InputError for a body that there is not.
  void tie(const std::vector<std::pair<Index, Index>>& pairs, Index num_bodies);
  std::vector<Particles<Dim>> particles;  ///< by chunk

  double cell() const { return cell_; }
  int degree() const { return degree_; }
  const SparseGrid<Dim>& of_body(Index body) const { return grids_[first_tied_[body]]; }
  /// By body; of bodies that share one the first has it.
  const std::vector<SparseGrid<Dim>>& grids() const { return grids_; }

  /// Nodes where the particles are now. replaces: the world gets new nodes, at rest. Chunks whose points have drifted
  /// apart are split. Throws NumericalError for points that are nowhere, or further away than a grid can number.
  void rebuild(World<Dim>& world, bool replaces);
  /// Calls visit(chunk, particles) for all chunks, concurrently.
  template <class Visit> void for_each_chunk(World<Dim>& world, const Visit& visit) {
    parallel_chunks(static_cast<Index>(particles.size()), 1,
                    [&](Index c, Index) { visit(world.chunks[c], particles[c]); });
  }

  // Room of this thread, until its next call of the same.
  /// As internal::gather writes it for the particles, of velocities by node.
  const double* gather(const Chunk<Dim>& chunk, const Particles<Dim>& of, const Points<Dim>& velocity) const;
  /// As internal::gather_values.
  const double* gather_values(const Chunk<Dim>& chunk, const Particles<Dim>& of, const Points<Dim>& velocity) const;
  /// As internal::gather_modes.
  const double* gather_modes(const Chunk<Dim>& chunk, const Particles<Dim>& of, const Points<Dim>& velocity) const;
  /// Four numbers for each of so many modes.
  double* modes(const Particles<Dim>& of, int count) const;
  /// Zeros, eight for every slot.
  double* clear_slots(const Particles<Dim>& of) const;
  /// From these to table.force and to the momenta.
  void take_slots(Chunk<Dim>& chunk, Particles<Dim>& of) const;
  /// To table.force alone.
  void take_forces(Chunk<Dim>& chunk, const Particles<Dim>& of) const;

  /// nodes.mass and nodes.v by the momenta of all chunks.
  void collect_velocities(World<Dim>& world) const;
  /// Dim x N, velocities of the grid by those of the points.
  Points<Dim> velocities_of(World<Dim>& world,
                            const std::function<const Points<Dim>&(const Particles<Dim>&)>& of_points);
  /// World::prescribed by World::prescribed_points: of nodes that have half of their mass and more from these. The
  /// field is affine around each point (as of Transfer::apic): up to the edge of a body, a rotation stays one.
  void find_prescribed(World<Dim>& world);
  Vec<Dim> position(const Site<Dim>& site) const { return origin_ + cell_ * site.template cast<double>(); }

 private:
  /// Particles::held of the prescribed velocities along an axis; varies: with gradients, which the other finds.
  void scatter_held(World<Dim>& world, const std::vector<char>& held, const Vector& speed, int axis, bool varies);
  void gather_held(World<Dim>& world, int axis);

  enum class Box { same, changed, too_large };
  Box find_box(const World<Dim>& world, const Chunk<Dim>& chunk, Particles<Dim>& of) const;
  void split(World<Dim>& world, std::size_t chunk);
  void number_nodes(World<Dim>& world, bool replaces);
  /// Velocities of the box, four numbers for each slot.
  const double* slot_velocities(const Chunk<Dim>& chunk, const Particles<Dim>& of, const Points<Dim>& velocity) const;

  int degree_;
  double cell_;
  Vec<Dim> origin_ = Vec<Dim>::Zero();
  std::vector<Index> first_tied_;       ///< by body, the first one that it shares a grid with, maybe itself
  std::vector<SparseGrid<Dim>> grids_;  ///< by body
  Points<Dim> x_;                       ///< Dim x N, positions of the nodes
};

/// Particles whose surface (Particles::reach) is nearer to the rigid body than that: bodies end where their particles
/// do, not at the last node.
template <int Dim> ContactPoints<Dim> find_contact_points(const World<Dim>& world, const PointGrid<Dim>& grid,
                                                          const RigidShape<Dim>& gap_at, double reach);

}  // namespace efree::internal
