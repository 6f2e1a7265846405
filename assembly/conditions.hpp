// SPDX-License-Identifier: GPL-3.0-or-later
/// What is prescribed on the boundary and in the body, as it is given and as single restraints.
#pragma once

#include "efree/assembly/resultants.hpp"
#include "efree/core/types.hpp"
#include "efree/materials/material.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace efree {

/// Prescribed displacement on a named part of the boundary: any components (an empty field leaves one free), or the
/// component along the outward normal (a plane that slides).
template <int Dim> struct DisplacementCondition {
  std::string on;
  std::array<ScalarField<Dim>, Dim> components;  ///< of the displacement [length]
  ScalarField<Dim> normal;                       ///< along the outward normal [length]; goes without components
  /// Of springs between the body and what is prescribed, per area [force / length^3]; empty: it is held rigidly.
  ScalarField<Dim> stiffness{};
};

/// Force per area on a named part of the boundary, from position and outward normal.
template <int Dim> struct TractionCondition {
  std::string on;
  std::function<Vec<Dim>(const Vec<Dim>& x, const Vec<Dim>& n)> traction;
  std::string kind = "traction";  ///< what people call it
};

/// Pressure on a named part of the boundary as it moves: on its area and against its normal as they are at any time
/// (NonlinearEquilibrium); of the place at rest [stress].
template <int Dim> struct FollowerPressure {
  std::string on;
  ScalarField<Dim> pressure;
};

/// Force and moment on a named part of the boundary, spread over it as a traction a + w x (x - c) with its centroid c,
/// which has exactly this resultant whatever the mesh. Axisymmetric: a force along the axis, of the whole turn.
template <int Dim> struct ResultantLoad {
  std::string on;
  Vec<Dim> force = Vec<Dim>::Zero();         ///< [force; in the plane per thickness]
  Moment<Dim> moment = Moment<Dim>::Zero();  ///< besides that of the force [force * length]
  std::optional<Vec<Dim>> at{};              ///< where the force acts, on the part or not; empty: at its centroid
};

/// Force per mass in the whole body.
template <int Dim> struct MassForce {
  VectorField<Dim> per_mass;  ///< [length / time^2]
  std::string kind = "acceleration";
};
/// Gravity, say.
template <int Dim> MassForce<Dim> acceleration(const Vec<Dim>& a) {
  return {[a](const Vec<Dim>&) { return a; }};
}
/// Of a body that turns about an axis, seen by who turns with it: speed^2 r, away from the axis. In 2D (0, 0, 1) is
/// across the plane; axisymmetric ones turn about (0, 1, 0).
template <int Dim> MassForce<Dim> rotation(double speed, const Vec<3>& axis, const Vec<Dim>& through) {
  const Vec<3> along = axis.normalized();
  return {[along, through, speed](const Vec<Dim>& x) -> Vec<Dim> {
            Vec<3> arm = Vec<3>::Zero();
            arm.template head<Dim>() = x - through;
            return speed * speed * (arm - along.dot(arm) * along).template head<Dim>();
          },
          "rotation"};
}

/// What acts on a body.
template <int Dim> struct Loads {
  std::vector<TractionCondition<Dim>> tractions;  ///< several on one part add up
  VectorField<Dim> body_force{};                  ///< force per volume; may be empty
  std::vector<ResultantLoad<Dim>> resultants{};
  std::vector<MassForce<Dim>> mass_forces{};
  std::vector<Parameter> density{};                ///< by region of the mesh, for mass_forces [mass / volume]
  std::vector<FollowerPressure<Dim>> followers{};  ///< of bodies that move, besides tractions

  /// Whether something acts on the whole body.
  bool inside() const { return body_force || !mass_forces.empty(); }
  /// Whether something acts on the body at all, followers aside.
  bool any() const { return !tractions.empty() || !resultants.empty() || inside(); }
};

/// Pressure p on a named part: traction -p n.
template <int Dim> TractionCondition<Dim> pressure(std::string on, ScalarField<Dim> p) {
  return {std::move(on), [p = std::move(p)](const Vec<Dim>& x, const Vec<Dim>& n) -> Vec<Dim> { return -p(x) * n; },
          "pressure"};
}
/// Pull along the normal: traction p n, p > 0 outward.
template <int Dim> TractionCondition<Dim> tension(std::string on, double p) {
  return pressure<Dim>(std::move(on), [p](const Vec<Dim>&) { return -p; });
}
/// Springs along all directions, of this stiffness per area [force / length^3].
template <int Dim> DisplacementCondition<Dim> elastic_support(std::string on, double stiffness) {
  DisplacementCondition<Dim> condition{std::move(on), {}, {}, [stiffness](const Vec<Dim>&) { return stiffness; }};
  condition.components.fill([](const Vec<Dim>&) { return 0.0; });
  return condition;
}
/// No displacement.
template <int Dim> DisplacementCondition<Dim> clamp(std::string on) {
  DisplacementCondition<Dim> condition{std::move(on), {}, {}};
  condition.components.fill([](const Vec<Dim>&) { return 0.0; });
  return condition;
}
/// No displacement along the normal, free to slide.
template <int Dim> DisplacementCondition<Dim> symmetry_plane(std::string on) {
  return {std::move(on), {}, [](const Vec<Dim>&) { return 0.0; }};
}

/// One scalar condition d . u = g on a named part: d is a coordinate direction, or the outward normal (component = -1).
template <int Dim> struct Restraint {
  std::string on;
  int component = -1;
  ScalarField<Dim> value;
  ScalarField<Dim> stiffness{};  ///< of springs; empty: rigid

  bool is_elastic() const { return static_cast<bool>(stiffness); }
  Vec<Dim> direction(const Vec<Dim>& normal) const { return component < 0 ? normal : Vec<Dim>::Unit(component); }
};
/// The conditions one by one. Throws InputError for a condition that prescribes nothing, or both components and normal.
template <int Dim> std::vector<Restraint<Dim>> restraints(const std::vector<DisplacementCondition<Dim>>& conditions);

}  // namespace efree
