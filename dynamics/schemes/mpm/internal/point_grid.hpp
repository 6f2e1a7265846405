// SPDX-License-Identifier: GPL-3.0-or-later
/// The grid around the material points, and what goes between it and them.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/particles.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"

namespace efree::internal {

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
  /// Their first four numbers, momentum and mass, by local number of a node.
  void take_momenta(const Particles<Dim>& of, AlignedVector<double>& momenta) const;
  /// To table.force alone.
  void take_forces(Chunk<Dim>& chunk, const Particles<Dim>& of) const;

  /// Momentum and mass of a node, by those in the chunks: Particles::momentum or Particles::held.
  Eigen::Vector4d sum_at_node(const World<Dim>& world, AlignedVector<double> Particles<Dim>::*momenta,
                              Index node) const;
  /// nodes.mass and nodes.v by the momenta of all chunks.
  void collect_velocities(World<Dim>& world) const;
  /// Dim x N, velocities of the grid by those of the points.
  Points<Dim> velocities_of(World<Dim>& world,
                            const std::function<const Points<Dim>&(const Particles<Dim>&)>& of_points);
  Vec<Dim> position(const Site<Dim>& site) const { return origin_ + cell_ * site.template cast<double>(); }

 private:
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

}  // namespace efree::internal
