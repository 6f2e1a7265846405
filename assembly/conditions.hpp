// SPDX-License-Identifier: GPL-3.0-or-later
/// What is prescribed on the boundary and in the body, as it is given and as single restraints.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <string>
#include <vector>

namespace efree {

/// Prescribed displacement on a named part of the boundary: any components (an empty field leaves one free), or the
/// component along the outward normal (a plane that slides).
template <int Dim> struct DisplacementCondition {
  std::string on;
  std::array<ScalarField<Dim>, Dim> components;  ///< of the displacement [length]
  ScalarField<Dim> normal;                       ///< along the outward normal [length]; goes without components
};

/// Force per area on a named part of the boundary, from position and outward normal.
template <int Dim> struct TractionCondition {
  std::string on;
  std::function<Vec<Dim>(const Vec<Dim>& x, const Vec<Dim>& n)> traction;
};

/// What acts on a body.
template <int Dim> struct Loads {
  std::vector<TractionCondition<Dim>> tractions;  ///< several on one part add up
  VectorField<Dim> body_force;                    ///< force per volume; may be empty
};

/// Pressure p on a named part: traction -p n.
template <int Dim> TractionCondition<Dim> pressure(std::string on, ScalarField<Dim> p) {
  return {std::move(on), [p = std::move(p)](const Vec<Dim>& x, const Vec<Dim>& n) -> Vec<Dim> { return -p(x) * n; }};
}
/// Pull along the normal: traction p n, p > 0 outward.
template <int Dim> TractionCondition<Dim> tension(std::string on, double p) {
  return pressure<Dim>(std::move(on), [p](const Vec<Dim>&) { return -p; });
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

  Vec<Dim> direction(const Vec<Dim>& normal) const { return component < 0 ? normal : Vec<Dim>::Unit(component); }
};
/// The conditions one by one. Throws InputError for a condition that prescribes nothing, or both components and normal.
template <int Dim> std::vector<Restraint<Dim>> restraints(const std::vector<DisplacementCondition<Dim>>& conditions);

}  // namespace efree
