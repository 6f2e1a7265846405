// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacement conditions and ties by symmetric Nitsche.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/assembly/resultants.hpp"

#include <memory>
#include <vector>

namespace efree {

/// One part of the stiffness: its own quadrature with its own tangents (B-bar and stabilisation are sums of such
/// terms).
template <int Dim> struct StiffnessTerm {
  const Quadrature<Dim>* discretization;
  PointTangents<Dim> tangents;  ///< symmetric
  bool pressure = false;        ///< whether it is the volumetric part of a split stiffness, kappa m m^T
};

/// Matrix and right-hand side of symmetric Nitsche: what holds the restrained displacements and ties regions to each
/// other. With sigma = sum_K Phi_K sigma_K linear fields are exact.
template <int Dim> struct NitscheSystem {
  SymmetricMatrix matrix;
  Vector rhs;
};
/// Restraints (Nitsche 1971): -int (sigma(u) n).v - int u.(sigma(v) n) + int beta u.v, each along the restrained
/// directions. Ties: the same with the jump [u] = u_1 - u_2 for u, the flux gamma_1 sigma_1 n + gamma_2 sigma_2 n and
/// beta = beta_1 beta_2 / (beta_1 + beta_2); gamma_1 = beta_2 / (beta_1 + beta_2) leaves the flux to the softer side,
/// so that no ratio of moduli harms (Annavarapu, Hautefeuille & Dolbow 2012).
/// The penalty follows from the trace inequality of the piecewise field: beta_K = 4 c |Gamma_K| / w_K, c the tangent's
/// largest stiffness along the normal, which keeps half of the coercivity whatever the shape of the cells; nothing to
/// choose. For terms that are pressure 4 kappa / w_K acts on the square of the volume int Phi_K u.n that crosses the
/// boundary, not on u: that does not lock as materials become incompressible. Where parts overlap a direction that
/// several restraints prescribe counts once; throws InputError naming them if they contradict each other. Elastic
/// restraints are int k (d.u - g) d.v and no more (Winkler 1867); they add up, and must not be negative.
template <int Dim> NitscheSystem<Dim> nitsche(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const std::vector<StiffnessTerm<Dim>>& terms,
                                              const std::vector<Restraint<Dim>>& restraints,
                                              const std::vector<TiedFacets>& ties = {});

/// What a system's terms hold a body with, for any number of fields.
template <int Dim> class NitscheReactions {
 public:
  /// Keeps references to all but the restraints.
  NitscheReactions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                   const std::vector<StiffnessTerm<Dim>>& terms, const std::vector<Restraint<Dim>>& restraints,
                   const std::vector<TiedFacets>& ties);
  ~NitscheReactions();
  /// By part: what the system's terms of that part hold a body with whose coefficients are U (Dim x N), under `factor`
  /// times what is prescribed. The tractions are those that the terms do work with on rigid motions: sigma n as the
  /// terms see it, less what the penalties push back. So the sum over all parts balances the loads as far as U solves
  /// the equations. What several parts hold on a facet they share.
  Resultants<Dim> operator()(const Points<Dim>& U, double factor = 1.0) const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace efree
