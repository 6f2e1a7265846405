// SPDX-License-Identifier: GPL-3.0-or-later
/// Optimal-transportation meshfree method (Li, Habbal & Ortiz 2010; Mota et al. 2020, SAND2020-9716).
#pragma once

#include "efree/basis/lme.hpp"
#include "efree/dynamics/scheme.hpp"

#include <memory>

namespace efree {

/// How nodes get a material point's momentum when its shape functions change.
enum class MomentumTransfer {
  /// Velocities of the nodes stand, corrected by the least affine velocity that keeps the point's momentum and angular
  /// momentum: both are conserved to rounding, and next to no energy is lost.
  affine,
  /// Velocities of the nodes stand, whatever their masses become (SAND2020-9716, eq. 2.14): momentum is not conserved.
  nodes,
  /// N_a times the point's momentum (Li 2009): momentum is conserved, angular momentum is not, and energy is lost.
  points,
};

struct OtmOptions {
  LmeOptions lme{.gamma = 2.5, .cutoff = 1e-4};
  /// A point's shape functions are computed again when its strain since they were computed (Green's, its norm) exceeds
  /// this (dynamic reconnection). In between they stand still, as in a total Lagrangian method: exact in affine
  /// motions, and energy is conserved. 0: every step.
  double reconnection_strain = 0.2;
  /// Whether the first shape functions of bodies with cells are changed, as little as it takes, so that gradients
  /// integrate exactly (Chen, Hillman & Rueter 2013). Without, bodies on careless meshes are too soft, and waves
  /// converge with order one at best. Not with reconnection_strain = 0.
  bool exact_integration = true;
  /// Largest ratio of the axes of a shape function's support, which the motion stretches; 1: balls.
  double anisotropy = 3.0;
  /// When the stable step gets shorter than this, over the first one, nodes that make shape functions narrower than
  /// this, over their first width, are merged with the next. 0: never.
  double merging = 0.4;
  /// Where bodies with cells stretch, edges between nodes get a node in their middle when they are longer than this,
  /// over the spacing at the start, with no other node near; cells and points around them become two. 0: never.
  double insertion = 0.0;
  MomentumTransfer momentum = MomentumTransfer::affine;
  /// Stiffness against zero-energy modes of the nodes, by the shear modulus over the square of the shape functions'
  /// width (Weissenfels & Wriggers 2018). Under pressure it is larger (docs/theory.md).
  double stabilisation = 0.1;
  /// Rate at which pressures of a fluid even out that differ between neighbouring material points, over the speed of
  /// sound by the size of a point (docs/theory.md). 0: never.
  double pressure_diffusion = 1.0;
  /// In place of contact between bodies: where bodies come within three tenths of a spacing of each other,
  /// points next to both get shape functions of the nodes of both, and the bodies move as one from there on (Li, Habbal
  /// & Ortiz 2010). Momenta are conserved to rounding; the energy that a sudden common velocity takes is counted as
  /// lost by reconnection. Without ContactOptions::enabled.
  bool seizing = false;
};

/// Throws InputError for options out of range. The bodies of the run must have no `shape` of their own.
template <int Dim> std::unique_ptr<Scheme<Dim>> otm(const OtmOptions& options = {});

}  // namespace efree
