// SPDX-License-Identifier: GPL-3.0-or-later
/// Equations of equilibrium of a solid on any basis.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/materials.hpp"
#include "efree/assembly/nitsche.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/equations/equations.hpp"

#include <memory>
#include <optional>

namespace efree {

/// How displacements are prescribed.
enum class Essential {
  nitsche,  ///< symmetric Nitsche, penalty from the local stiffness; any basis
  strong,   ///< nodal values on the boundary; needs functions of other nodes that vanish there (vanish_on, or finite
            ///< elements)
};

/// What a body is made of and how it is held.
struct ElasticModel {
  SharedMaterial material{};
  std::optional<Plane> plane{};          ///< needed in 2D; axisymmetric exactly if the approximation is
  std::optional<Essential> essential{};  ///< nothing said: Nitsche; of finite elements `analyse` takes strong ones
  double stabilisation =
      0.0;  ///< in [0, 1]: share of the deviatoric stiffness taken from full integration (Approximation::fine)
  std::vector<SharedMaterial> regions{};  ///< by region of the mesh; empty: `material` everywhere
  std::string open_interface{};           ///< boundary part along which regions are not tied to each other (a crack)
};

/// The same, of what its materials are at infinitesimal strains (Linearised).
ElasticModel linearised(ElasticModel model);

/// The materials by region. Throws InputError for moduli out of range, regions without a material, a model in 2D that
/// does not say its plane.
template <int Dim> Materials<Dim> materials_of(const ElasticModel& model, const FineMesh<Dim>& mesh);

/// Internal forces are the adjoint of the gradient on the stresses of the materials at the quadrature points. With
/// averaged dilatations (B-bar) materials see H + s (theta - tr H), theta the best approximation of tr H on the
/// pressure patch by Approximation::pressures and s the strain that pressure makes where nothing has happened yet, per
/// dilatation (Stiffness::swelling; Simo, Taylor & Pister 1985 have s = I / 3): of linear materials that is the split
/// of the stiffness into kappa m m^T on the patches and the rest on the points. A stabilisation adds a share of the
/// work of strains without dilatation by full integration, and takes the same off at the quadrature points.
/// Displacements that Nitsche holds, and regions that it ties, bring the stresses of small strains on the boundary.
template <int Dim> class Equilibrium final : public Equations {
 public:
  /// Refers to the approximation. Throws InputError for materials under which it would lock while nobody said whether
  /// dilatations are averaged (require_decided), naming the free rigid motions if the conditions do not hold every
  /// body, for a boundary that does not exist, for an approximation in another plane than the model.
  Equilibrium(const Approximation<Dim>& approximation, const ElasticModel& model,
              const std::vector<DisplacementCondition<Dim>>& conditions);

  /// The same under these loads at factor 1; without it there are none. What is costly is shared.
  Equilibrium with(const Loads<Dim>& loads) const;
  /// The same under given forces on the coefficients (Dim x N), with nothing else than zero prescribed: what dual
  /// solutions solve.
  Equilibrium homogeneous(Points<Dim> forces) const;

  State rest() const override;
  State under(double factor, State state) const override;
  State moved(State state, const Vector& change) const override;
  Vector residual(const State& state) const override;
  Vector force_scale(const State& state) const override;
  void tangent(const State& state, SymmetricMatrix& K) const override;
  /// The tangent's pattern, values not set: to be analysed while `tangent` sets them.
  SymmetricMatrix tangent_pattern() const;
  State commit(State state) const override;
  bool linear() const override;
  const std::vector<Index>& node_of_unknowns() const override;

  /// Free energy of the materials [force * length], in the plane per thickness.
  double energy(const State& state) const;

  /// By part with displacement conditions: the force and moment by which it holds the body in a state, so that with the
  /// loads they balance as far as the state solves the equations.
  Resultants<Dim> reactions(const State& state) const;
  /// The same of several loads at factor 1, and coefficients and stresses at the quadrature points that solve linear
  /// equations under them, in less time than one by one.
  std::vector<Resultants<Dim>> reactions(const std::vector<Loads<Dim>>& loads,
                                         const std::vector<const Points<Dim>*>& coefficients,
                                         const std::vector<const VoigtPoints<Dim>*>& stresses) const;

  const Approximation<Dim>& approximation() const;
  const Materials<Dim>& materials() const;
  /// Stresses, by part of the stiffness, where nothing has happened yet.
  const std::vector<StiffnessTerm<Dim>>& stiffness_terms() const;
  /// The tangent where nothing has happened yet, of all coefficients and with what holds the boundary weakly, times
  /// coefficients U: forces, both Dim x N.
  Points<Dim> initial_tangent_times(const Points<Dim>& U) const;
  /// The part of it that holds the boundary weakly and ties regions, and the forces by which it prescribes
  /// displacements.
  Points<Dim> weak_forces(const Points<Dim>& U) const;
  const Points<Dim>& weak_prescribed() const;
  /// The part of coefficients that nodal values hold; the rest is zero.
  Points<Dim> held_part(const Points<Dim>& U) const;

 private:
  struct Data;
  std::shared_ptr<const Data> data_;
  Points<Dim> forces_;      ///< of the loads
  bool prescribes_ = true;  ///< displacements other than zero
};

}  // namespace efree
