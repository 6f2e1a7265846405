// SPDX-License-Identifier: GPL-3.0-or-later
/// Logarithmic elastic strains of eight points at a time, and flow back along them, without principal axes: series of
/// tensors near the identity.
#pragma once

#include "efree/core/internal/vectors.hpp"

namespace efree::internal {

/// Eight points. Tensors are by columns, symmetric ones in Voigt order xx, yy, zz, yz, xz, xy. Numbers of points where
/// `near` is not 1 mean nothing.
struct alignas(64) EightMetals {
  // What `try_elastic` takes.
  Eight F[9];       ///< deformation gradients
  Eight metric[6];  ///< C_p^-1 - I, of the plastic deformation so far
  // What it finds were nothing to flow.
  Eight near;   ///< 1: J > 0, the mean of b_e - I within a fifth, and its deviator (over what is left) within a tenth
  Eight theta;  ///< trace of the elastic strains
  Eight e;      ///< length of their deviator
  Eight inverse[9];  ///< of F
  Eight left[6];     ///< b_e
  Eight deviator[6];
  // What `flow_back` takes.
  Eight length;           ///< of the flow, along the deviator
  Eight contraction;      ///< exp(-2/3 of its volumetric strain)
  Eight pressure, shear;  ///< stress: pressure I + shear times the deviator of trial strains
  // What it finds.
  Eight P[9];
};

/// b_e = F C_p^-1 F^T and half of its logarithm (Simo 1992).
void try_elastic(EightMetals& points);
/// Stresses and, if anything flows, the metric afterwards: C_p^-1 = F^-1 b_e exp(-2 flow) F^-T.
void flow_back(EightMetals& points, bool flows);

}  // namespace efree::internal
