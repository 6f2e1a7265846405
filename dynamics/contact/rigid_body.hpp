// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls, and rigid bodies of any shape that move with prescribed velocities or by their mass.
#pragma once

#include "efree/dynamics/ledger.hpp"
#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"

#include <Eigen/Geometry>
#include <array>
#include <functional>

namespace efree {

/// Distance of a position from a rigid body, and the direction away from it.
template <int Dim> struct Gap {
  double gap;       ///< to the nearest point of its surface [length], negative inside
  Vec<Dim> normal;  ///< unit vector, outwards there
};
/// Shape of a rigid body: the gap at any position. Further away than a spacing of nodes a smaller gap is allowed.
template <int Dim> using RigidShape = std::function<Gap<Dim>(const Vec<Dim>&)>;

/// Shapes. All throw InputError for numbers that define none.
namespace rigid_shapes {

/// All that is behind a plane: x . normal <= level.
template <int Dim> RigidShape<Dim> half_space(const Vec<Dim>& normal, double level);
/// A ball; a disk in the plane, and in an axisymmetric section a ball if its centre is on the axis, else a ring.
template <int Dim> RigidShape<Dim> ball(const Vec<Dim>& centre, double radius);
/// A cylinder without ends about the line through that point.
RigidShape<3> cylinder(const Vec<3>& point, const Vec<3>& axis, double radius);
/// The inside of closed facets, all oriented outwards or all inwards; polygons in the plane. Of facets that share the
/// nearest point the one that faces the position most gives the sign.
template <int Dim> RigidShape<Dim> solid(const Points<Dim>& vertices, const Facets<Dim>& facets);
/// Likewise of a surface that is closed.
RigidShape<3> solid(const SurfaceSoup& surface);
/// The facets of a polygon, whose last point is joined to the first.
Facets<2> polygon(Index corners);

}  // namespace rigid_shapes

/// A fixed plane that nodes do not pass: x . normal >= level. Where bodies have points of a surface, these do not, by
/// more than about a hundredth of the spacing.
template <int Dim> struct Wall {
  Vec<Dim> normal;        ///< a unit vector, to the side where bodies are
  double level = 0.0;     ///< [length]
  double friction = 0.0;  ///< Coulomb's coefficient; infinity: nodes in contact stick
};

/// A rigid body that nodes do not enter, except by prescribed velocities, nor corners of other rigid bodies. Parts
/// finer than the spacing of nodes, such as corners, pass between them.
template <int Dim> struct RigidBody {
  RigidShape<Dim> shape;  ///< at the start
  /// Coulomb's coefficient; infinity: nodes in contact stick. Of two rigid bodies the root of the product counts.
  double friction = 0.0;
  /// By time, of `centre`, about which it rotates. Empty: none. Axisymmetric: along the axis only, without spin.
  std::function<Vec<Dim>(double)> velocity{};
  std::function<Spin<Dim>(double)> spin{};
  Vec<Dim> centre = Vec<Dim>::Zero();  ///< at the start
  /// More than 0: it starts with its velocity at time 0 and then moves by the contact forces. In the plane per unit
  /// thickness, axisymmetric of the full revolution.
  double mass = 0.0;
  /// About `centre`, the same about all axes; more than 0: likewise it rotates by the contact forces [mass length^2].
  double inertia = 0.0;
  std::array<bool, Dim> held{};  ///< axes along which one with a mass does not move: the others guide it
  /// Of its surface at the start, for contact with other rigid bodies: places that are `round` away from it, as the
  /// centre of a ball, or corners with 0. None: it is not in contact with those that have none either.
  Points<Dim> corners{};
  double round = 0.0;  ///< [length]
  /// On one with a mass, by time, at its centre [force]. Empty: none.
  std::function<Vec<Dim>(double)> force{};

  /// Whether contact forces move it.
  bool is_free() const { return mass > 0.0 || inertia > 0.0; }
  /// 1 along axes that it is not held along, else 0.
  Vec<Dim> free_axes() const {
    Vec<Dim> free;
    for (int i = 0; i < Dim; ++i) free[i] = held[static_cast<std::size_t>(i)] ? 0.0 : 1.0;
    return free;
  }
};

/// Position and motion of a rigid body, and the contact forces on it.
template <int Dim> struct RigidState {
  Vec<Dim> centre, velocity;  ///< the latter half a step ago
  Mat<Dim> rotation;          ///< since the start
  Spin<Dim> spin;             ///< half a step ago
  Vec<Dim> force;             ///< of the bodies on it in the last step
  Vec<Dim> impulse;           ///< of the bodies on it so far
  double work;                ///< that it has done on the bodies so far

  friend auto fields(RigidState& state) {
    auto& [centre, velocity, rotation, spin, force, impulse, work] = state;
    return std::tie(centre, velocity, rotation, spin, force, impulse, work);
  }
};

/// Velocity of a rotation at the end of an arm.
template <int Dim> Vec<Dim> rotation_velocity(const Spin<Dim>& spin, const Vec<Dim>& arm) {
  if constexpr (Dim == 2)
    return spin[0] * Vec<2>(-arm[1], arm[0]);
  else
    return spin.cross(arm);
}

/// Velocity of a rigid body at a position.
template <int Dim> Vec<Dim> velocity_of(const RigidState<Dim>& state, const Vec<Dim>& at) {
  return state.velocity + rotation_velocity<Dim>(state.spin, at - state.centre);
}

/// Gap between a rigid body in that state and a position.
template <int Dim> Gap<Dim> gap_to(const RigidBody<Dim>& body, const RigidState<Dim>& state, const Vec<Dim>& at) {
  const Gap<Dim> gap = body.shape(body.centre + state.rotation.transpose() * (at - state.centre));
  return {gap.gap, state.rotation * gap.normal};
}

}  // namespace efree
