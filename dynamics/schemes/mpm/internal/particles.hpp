// SPDX-License-Identifier: GPL-3.0-or-later
/// What carries mass and velocities in the material point method.
#pragma once

#include "efree/core/packer.hpp"
#include "efree/dynamics/schemes/mpm/internal/cell_vertices.hpp"
#include "efree/dynamics/schemes/mpm/internal/sparse_grid.hpp"
#include "efree/dynamics/schemes/mpm/internal/transfer_kernels.hpp"
#include "efree/dynamics/state.hpp"

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

}  // namespace efree::internal
