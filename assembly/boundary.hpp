// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads, and displacement conditions by symmetric Nitsche or on nodal values.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/materials/linear_elastic.hpp"

namespace efree {

/// One scalar condition d . u = g on a named part: d is a coordinate direction, or the outward normal (component = -1).
template <int Dim> struct Restraint {
  std::string on;
  int component = -1;
  ScalarField<Dim> value;

  Vec<Dim> direction(const Vec<Dim>& normal) const { return component < 0 ? normal : Vec<Dim>::Unit(component); }
};
/// The conditions one by one. Throws InputError for a condition that prescribes nothing, or both components and normal.
template <int Dim> std::vector<Restraint<Dim>> restraints(const std::vector<DisplacementCondition<Dim>>& conditions);

/// Bodies, regions tied to each other being one, and the rigid motions that restraints leave them.
template <int Dim> struct Bodies {
  std::vector<Index> of_component;                     ///< body of each component of the mesh, counted from 0
  Vector volumes;                                      ///< by body, of the mesh
  Points<Dim> centres;                                 ///< of mass
  std::vector<std::vector<std::string>> free_motions;  ///< names of translations and rotations; empty: the body is held

  Index size() const { return static_cast<Index>(volumes.size()); }
  bool is_free(Index body) const { return !free_motions[body].empty(); }
};
template <int Dim> Bodies<Dim> find_bodies(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties = {});

/// Throws InputError that names every rigid motion the restraints leave free, for each body (of many, the largest).
template <int Dim> void require_restrained(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties = {});

/// f = int phi_I t + int phi_I b, integrated on the fine mesh: Dim x N. Throws InputError for an unknown boundary or a
/// traction or force that is not finite (naming the point).
template <int Dim>
Points<Dim> load_vector(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const Loads<Dim>& loads);

/// One part of the stiffness: its own quadrature with its own elasticity (B-bar and stabilisation are sums of such
/// terms).
template <int Dim> struct StiffnessTerm {
  const Discretization<Dim>* discretization;
  std::vector<Lame> lame;  ///< by region
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
/// The penalty follows from the trace inequality of the piecewise field: beta_K = 4 c |Gamma_K| / w_K, c the normal
/// stiffness, which keeps half of the coercivity whatever the shape of the cells; nothing to choose. For terms that are
/// pressure only (mu = 0, the volumetric part of a split stiffness) 4 lambda / w_K acts on the square of the volume
/// int Phi_K u.n that crosses the boundary, not on u: that does not lock towards nu = 1/2. Where parts
/// overlap a direction that several restraints prescribe counts once; throws InputError naming them if they contradict
/// each other.
template <int Dim> NitscheSystem<Dim> nitsche(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                              const std::vector<StiffnessTerm<Dim>>& terms,
                                              const std::vector<Restraint<Dim>>& restraints,
                                              const std::vector<TiedFacets>& ties = {});

/// Nodal values set strongly: in the frame of each node (columns of its matrix) some components are fixed.
template <int Dim> struct NodalConditions {
  std::vector<Index> nodes;      ///< ascending
  std::vector<Mat<Dim>> frames;  ///< orthonormal; the first fixed[k] columns are restrained
  std::vector<int> fixed;        ///< 1 .. Dim
  std::vector<Vec<Dim>> values;  ///< prescribed components in the frame
};
/// For finite elements: `node_at` has the node at each fine degree of freedom (space.size(), -1 where there is none;
/// several may share one). Throws InputError if a restraint cannot be nodal, or if conditions on one node contradict
/// each other (naming the parts).
template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                                         const std::vector<Restraint<Dim>>& restraints);
/// Whether values at nodes can hold the restraint: all but normal displacements on a part that is curved.
template <int Dim> bool can_be_nodal(const FineSpace<Dim>& space, const Restraint<Dim>& restraint);
/// Throws InputError if functions of nodes off a restrained part do not vanish on it, if normal conditions are asked
/// for on a part that is not flat around a node, or if conditions on one node contradict each other (naming the parts).
template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                         const std::vector<Index>& node_dofs,
                                                         const std::vector<Restraint<Dim>>& restraints);

}  // namespace efree
