// SPDX-License-Identifier: GPL-3.0-or-later
/// Equations of equilibrium of a solid whose materials answer as they like: any strains, with memory.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/equations/equilibrium.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace efree {

/// What acts on a body over time. The parts of the boundary and the components that conditions name are the same at all
/// times.
template <int Dim> struct Program {
  std::function<std::vector<DisplacementCondition<Dim>>(double time)> conditions;
  std::function<Loads<Dim>(double time)> loads;
  /// If not 0, everything is in proportion to the time, and at this time what conditions and loads say.
  double full_at = 0.0;

  /// In proportion to the time, and as said at the time `full_at`.
  static Program grows(std::vector<DisplacementCondition<Dim>> conditions, Loads<Dim> loads = {},
                       double full_at = 1.0) {
    return {[conditions = std::move(conditions)](double) { return conditions; },
            [loads = std::move(loads)](double) { return loads; }, full_at};
  }
};

/// Stresses and strains at quadrature points, as they are now.
template <int Dim> struct PointFields {
  Gradients<Dim> F;         ///< deformation gradients that the materials see, the stretch across a thin plate included
  Gradients<Dim> P;         ///< first Piola-Kirchhoff stress that works on the gradients of the points [stress]
  VoigtPoints<Dim> stress;  ///< of small strains; of finite ones the true stress (Cauchy) [stress]
  VoigtPoints<Dim> strain;  ///< small, or the logarithm of the stretch, ln(F F^T) / 2; engineering shear
  Vector energy;            ///< stored [stress]
  Vector dissipated;        ///< since the last commit [stress]
  Vector history;           ///< as Materials::history_size says
};

/// Total Lagrangian: residual = sum_K w_K G_K^T P(F_K) - forces, F = 1 + H. Displacements are held, and regions tied,
/// by the gradients themselves (HeldGradient), or on nodal values. With averages materials see the best approximation
/// of dilatations on their patch by Approximation::pressures: at small strains H + s (theta - tr H) as in Equilibrium;
/// at finite ones (J_a / J)^(1/3) F, ln J_a the approximation of ln J (constant ones by the mean: Simo, Taylor & Pister
/// 1985 take that of J, de Souza Neto et al. 1996 J at a centroid), which is the derivative of one energy; with what
/// points bear by themselves: elastic ones by an energy, materials that flow (but in space) as a shear out of the plane
/// that flow limits (docs/theory.md). Pressures that follow the body (Loads::followers) have a stiffness of their own.
/// What is not symmetric of that, and of tangents of materials, is not_in_tangent.
template <int Dim> class NonlinearEquilibrium final : public Equations {
 public:
  /// Refers to the approximation. Throws InputError like Equilibrium; for a stabilisation, which is of linear
  /// materials; for averaged dilatations of finite strains in plane stress.
  NonlinearEquilibrium(const Approximation<Dim>& approximation, const ElasticModel& model, Program<Dim> program);

  /// What is left of these equations at infinitesimal strains: linear ones, of linearised(model), with dilatations
  /// averaged as these have it there, and with pressures that follow the body as they act at rest. Shares what does not
  /// depend on materials.
  NonlinearEquilibrium at_rest() const;

  State rest() const override;
  State under(double time, State state) const override;
  State moved(State state, const Vector& change) const override;
  Vector residual(const State& state) const override;
  Vector first_residual(const State& from, const State& to) const override;
  bool loads_change(double from, double to) const override;
  Vector force_scale(const State& state) const override;
  void tangent(const State& state, SymmetricMatrix& K) const override;
  Vector not_in_tangent(const State& state, const Vector& change) const override;
  State commit(State state) const override;
  /// Refuses bodies that are turned inside out somewhere: J <= 0 at a point of finite strains.
  void check(const State& balanced) const override;
  bool linear() const override;
  const std::vector<Index>& node_of_unknowns() const override;

  /// Stored energy [force * length], in the plane per thickness.
  double energy(const State& state) const;
  /// What the materials say at the quadrature points.
  PointFields<Dim> fields(const State& state) const;
  /// By part with displacement conditions: the force and moment (about the origin, of forces where they are now at
  /// finite strains) by which it holds the body.
  Resultants<Dim> reactions(const State& state) const;
  /// The largest distance of held boundaries from what is prescribed there [length]; 0 where nodal values hold it.
  double largest_gap(const State& state) const;
  /// Each load that acts, and what it amounts to; moments as those of reactions.
  std::vector<AppliedLoad<Dim>> applied(const State& state) const;
  /// The smallest J at a quadrature point.
  double smallest_jacobian(const State& state) const;
  /// Whether some material is one of finite strains.
  bool finite_strain() const;
  const Approximation<Dim>& approximation() const;
  const ElasticModel& model() const;
  const Materials<Dim>& materials() const;

 private:
  struct Data;
  std::shared_ptr<const Data> data_;
};

}  // namespace efree
