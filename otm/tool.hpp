// SPDX-License-Identifier: GPL-3.0-or-later
/// Rigid things that bodies in motion meet: walls, and tools of any shape that move as they are told or by their mass.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <Eigen/Geometry>
#include <functional>

namespace efree {

/// How far a place is from a tool, and which way out is.
template <int Dim> struct ToolGap {
  double gap;       ///< to the nearest point of its surface [length], negative inside
  Vec<Dim> normal;  ///< a unit vector, out of the tool there
};
/// A tool's shape: the gap at any place. Far away, more than a spacing of nodes, something smaller does.
template <int Dim> using ToolShape = std::function<ToolGap<Dim>(const Vec<Dim>&)>;

/// Shapes. All throw InputError for numbers that make none.
namespace tools {

/// All that is behind a plane: x . normal <= level.
template <int Dim> ToolShape<Dim> half_space(const Vec<Dim>& normal, double level);
/// A ball; a disk in the plane, and in an axisymmetric section a ball if its centre is on the axis, else a ring.
template <int Dim> ToolShape<Dim> ball(const Vec<Dim>& centre, double radius);
/// An endless round bar about that line.
ToolShape<3> cylinder(const Vec<3>& point, const Vec<3>& axis, double radius);
/// What closed facets enclose, whichever way they are oriented, as long as it is alike; polygons in the plane. The sign
/// is by the facet of the nearest point that the place faces most.
template <int Dim> ToolShape<Dim> solid(const Points<Dim>& vertices, const Facets<Dim>& facets);
/// The facets of a polygon, whose last point is joined to the first.
Facets<2> polygon(Index corners);

}  // namespace tools

/// Angular velocity, counterclockwise: a number in the plane, a vector in space.
template <int Dim> using Spin = Vec<Dim == 2 ? 1 : 3>;

/// A plane at rest that no node goes through: x . normal >= level. Of bodies with points of a surface it is these that
/// do not, by more than a hundredth of the spacing or so.
template <int Dim> struct OtmWall {
  Vec<Dim> normal;        ///< a unit vector, to the side where bodies are
  double level = 0.0;     ///< [length]
  double friction = 0.0;  ///< Coulomb's coefficient; infinity: nodes that touch stick
};

/// Something rigid that no node gets into, but for nodes whose prescribed velocities bring them there. What is finer
/// than the spacing of nodes, such as a corner, gets between them.
template <int Dim> struct OtmTool {
  ToolShape<Dim> shape;   ///< where it is at the start
  double friction = 0.0;  ///< Coulomb's coefficient; infinity: nodes that touch stick
  /// By the time; of `centre`, about which it turns. Empty: none. Axisymmetric: along the axis only, without spin.
  std::function<Vec<Dim>(double)> velocity{};
  std::function<Spin<Dim>(double)> spin{};
  Vec<Dim> centre = Vec<Dim>::Zero();  ///< at the start
  /// More than 0: from its velocity at time 0 on it moves as bodies push it. In the plane per unit thickness,
  /// axisymmetric all of it.
  double mass = 0.0;
  /// About `centre`, the same about all axes; more than 0: likewise it turns as bodies turn it [mass length^2].
  double inertia = 0.0;
};

/// Where a tool is and what it did.
template <int Dim> struct ToolState {
  Vec<Dim> centre, velocity;  ///< the latter half a step ago
  Mat<Dim> turned;            ///< from the start to now
  Spin<Dim> spin;
  Vec<Dim> force;    ///< of the bodies on it in the last step
  Vec<Dim> impulse;  ///< of the bodies on it so far
  double work;       ///< that it did on the bodies so far
};

/// Velocity of what moves with a tool, at a place.
template <int Dim> Vec<Dim> velocity_of(const ToolState<Dim>& tool, const Vec<Dim>& at) {
  const Vec<Dim> arm = at - tool.centre;
  if constexpr (Dim == 2)
    return tool.velocity + tool.spin[0] * Vec<2>(-arm[1], arm[0]);
  else
    return tool.velocity + tool.spin.cross(arm);
}

/// The gap of a tool that has moved, at a place.
template <int Dim> ToolGap<Dim> gap_to(const OtmTool<Dim>& tool, const ToolState<Dim>& now, const Vec<Dim>& at) {
  const ToolGap<Dim> gap = tool.shape(tool.centre + now.turned.transpose() * (at - now.centre));
  return {gap.gap, now.turned * gap.normal};
}

}  // namespace efree
