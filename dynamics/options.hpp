// SPDX-License-Identifier: GPL-3.0-or-later
/// Options of explicit dynamics that every scheme shares.
#pragma once

#include "efree/materials/material.hpp"

#include <limits>

namespace efree {

/// Artificial viscosity against compression, without which shocks ring and invert points: a pressure rho l d (linear c
/// + quadratic l d) where volume shrinks at the rate d, with l the spacing of nodes along the fastest compression and c
/// the speed of pressure waves (von Neumann & Richtmyer 1950; Landshoff 1955). Its work heats the point
/// (Deformation::heat).
struct ShockViscosity {
  double linear = 0.0, quadratic = 0.0;
  bool on() const { return linear > 0.0 || quadratic > 0.0; }
};

/// Contact between bodies: nodes of a surface do not enter other bodies, by impulses on them and opposite ones on the
/// nodes of the nearest facet, inelastic as at walls. Momenta are conserved to rounding.
struct ContactOptions {
  bool enabled = true;  ///< else bodies pass through each other
  /// Whether a body that folds is in contact with itself, likewise. Fluids are not: they run together.
  bool self = true;
  double friction = 0.0;  ///< Coulomb's coefficient
};

/// Mass added to deformable bodies so that steps are longer, for quasi-static processes. Inertia has the added mass;
/// gravity and centrifugal forces of a static start act on the real one. Free motion is wrong: under gravity g a body
/// falls by g over `factor`.
struct MassScaling {
  double factor = 1.0;  ///< of all masses, at least 1: steps are longer by its root
  /// Stable step that is wanted: in addition, mass is added to the points whose bound on the stable step is below it at
  /// the start. 0: none. Schemes whose nodes persist.
  double step = 0.0;
  bool on() const { return factor != 1.0 || step > 0.0; }
  bool operator==(const MassScaling&) const = default;
};

struct DynamicsOptions {
  Plane plane = Plane::strain;  ///< strain or axisymmetric; of no meaning in space
  /// Whether nodes of bodies at exactly the same place are one node, as where regions of a mesh share facets. Not with
  /// consistent masses, nor where nodes do not stay with the material.
  bool tied = false;
  double damping = 0.0;  ///< rate at which velocities of nodes fall, rigid motions too [1/time]
  /// From this time on velocities of nodes become zero where their kinetic energy has passed a maximum, by which bodies
  /// come to rest (kinetic damping: Cundall 1976; Barnes 1999).
  double rest_from = std::numeric_limits<double>::infinity();
  double courant = 0.5;  ///< time step over that stable by the highest frequency that is found
  /// Error of the energy balance, over the largest energy so far, at which a run ends with an error. It is checked
  /// every 64 steps, eight times in a row: while there is little energy it may swing.
  double imbalance = 0.1;
  ShockViscosity shock{};
  MassScaling mass_scaling{};
  ContactOptions contact{};
};

}  // namespace efree
