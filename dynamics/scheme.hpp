// SPDX-License-Identifier: GPL-3.0-or-later
/// A method of explicit dynamics: which nodes there are, and what fills the tables of the material points and when.
#pragma once

#include "efree/core/packer.hpp"
#include "efree/dynamics/contact/contact_points.hpp"
#include "efree/dynamics/state.hpp"

#include <optional>
#include <span>
#include <string>

namespace efree {

namespace internal {
template <int Dim> class StableStep;
}

/// Largest strains of the points of a chunk in a step.
struct StrainBounds {
  double since_table = 0.0;  ///< norm of Green's strain since the tables were computed
  double shrinkage = 1.0;    ///< volume a step ago over that now; of no meaning unless regular
  bool regular = true;       ///< whether every J is positive, and more than the least is left of every volume
};

/// Facets that belong to one cell only, outwards, none on an axis: of cells whose points are not eroded.
template <int Dim> Facets<Dim> outer_facets(const World<Dim>& world, Index body);

/// Forces by which a scheme itself holds nodes off walls, part of World::nodes.force. Nodes that are not among these
/// are far from all walls.
template <int Dim> struct WallForces {
  std::vector<Index> nodes;         ///< ascending
  std::vector<Points<Dim>> forces;  ///< by wall: Dim x nodes; there may be fewer than walls at the start

  friend auto fields(WallForces& of) { return std::tie(of.nodes, of.forces); }
};

/// Virtual per step or per chunk, never per point.
template <int Dim> class Scheme {
 public:
  virtual ~Scheme() = default;
  /// Its name in results, such as "otm".
  virtual std::string name() const = 0;
  /// Numbers of its options that a run has to share with one whose state it starts from.
  virtual std::vector<double> identity() const { return {}; }

  /// What the points of a body store. Asked before `begin`.
  virtual PointStorage point_storage(const DeformableBody<Dim>&) const { return {}; }
  /// First tables, node masses and what else it keeps. The world has the nodes, points and velocities of the bodies.
  virtual void begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) = 0;
  /// World::nodes.mass, and what else depends on the masses of the points, after these have changed. Throws InputError
  /// by schemes whose nodes do not persist.
  virtual void find_masses(World<Dim>& world);
  /// Velocities become zero, where others than the nodes have them.
  virtual void stop(World<Dim>&) {}
  /// After the nodes have moved and before forces: tables that are due, and nodes that come or go.
  virtual void refresh(World<Dim>&, internal::StableStep<Dim>&) {}
  /// Positions and deformation gradients of the points of a chunk where the nodes are now, as
  /// internal::update_deformation leaves them; by default from its table.
  virtual StrainBounds update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least);
  /// From the Kirchhoff stresses of a chunk's points, in its columns, to its part of the nodes' forces (table.force).
  virtual void scatter_forces(const World<Dim>& world, Chunk<Dim>& chunk);
  /// nodes.force, by the parts of all chunks.
  virtual void collect_forces(World<Dim>& world);
  /// World::prescribed by World::prescribed_points, whose velocities have changed, where nodes do not persist.
  virtual void find_prescribed(World<Dim>&) {}
  /// Whether nodes are of the material and stay with it. Else velocities are prescribed at places or at points, not at
  /// nodes.
  virtual bool nodes_persist() const { return true; }
  /// The largest speed of a point, where nodes do not persist.
  virtual double largest_speed(const World<Dim>&) const { return 0.0; }
  /// Of a scheme whose nodes do not persist: the surface of bodies that is less than `reach` from a rigid one.
  virtual ContactPoints<Dim> find_contact_points(const World<Dim>&, const RigidShape<Dim>& /*gap_at*/,
                                                 double /*reach*/) const {
    return {};
  }
  /// None: the scheme leaves walls to contact.
  virtual const WallForces<Dim>* wall_forces() const { return nullptr; }
  /// Points of a chunk after their deformation was updated (columns: as internal::update_deformation leaves them).
  /// Throws NumericalError for points that are inverted, unless they break; returns the strains of the others.
  virtual StrainBounds examine(const World<Dim>& world, Chunk<Dim>& chunk, double dt, StrainBounds bounds);
  /// A point bears no stress from now on.
  virtual void point_eroded(World<Dim>&, Chunk<Dim>&, Index /*point*/) {}
  /// Dim x M, velocities of the points half a step ago; by default those of the nodes by the tables.
  virtual Points<Dim> point_velocities(const World<Dim>& world) const;
  /// Facets of nodes that are the surface of a body for contact, outwards, none on an axis.
  virtual Facets<Dim> surface(const World<Dim>& world, Index body) const { return outer_facets(world, body); }
  /// The stable time step where the scheme knows it; else it is estimated from the highest frequency.
  virtual std::optional<double> stable_step(const World<Dim>&) const { return {}; }
  /// Adds energies that it has now.
  virtual void tally(const World<Dim>&, EnergyBalance<Dim>&) const {}
  /// Its state in a checkpoint.
  virtual void pack(Archive&) {}
  /// Finds what is not in the checkpoint.
  virtual void resume(World<Dim>&) {}
};

}  // namespace efree
