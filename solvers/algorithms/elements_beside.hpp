// SPDX-License-Identifier: GPL-3.0-or-later
/// How far a cloud's state, of materials that answer as they like, is from that of the finite elements of its mesh.
#pragma once

#include "efree/solvers/algorithms/newton.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"

#include <memory>

namespace efree {

/// A state of the finite elements beside one of a cloud.
template <int Dim> struct BesideCloud {
  State state;         ///< in balance, not committed
  int iterations = 0;  ///< of Newton's method that led there
  /// How far the cloud's motion u is from theirs, v, as linear answers are in the energy norm: the root of the work of
  /// P(v) - P(u) on grad (v - u), over twice the energy that is stored.
  /// Where dilatations are averaged the deviators of true stress and logarithmic strain, and the energy of the
  /// difference between the recovered pressure and theirs (as mixed_distance).
  double distance = 0.0;
};

/// The nonlinear problem of the finite elements on a cloud's fine mesh, of bodies that remember nothing, solved from
/// the cloud's answer: Newton's method starts where the cloud is, and ends where the mesh is. They are held at
/// their nodes, for weakly they part from their supports as strains grow; as the cloud is where parts held alike meet,
/// whose reactions nodes cannot tell apart. In single cells a cloud's motion changes volumes by more than nearly
/// incompressible materials bear: bulk moduli begin low and rise to what they are. Not for plastic bodies: the past of
/// their elements is not that of the cloud, and they have to go all the way by themselves.
template <int Dim> class ElementsBeside {
 public:
  /// Refers to the cloud. Throws like `approximate` and NonlinearEquilibrium, and InputError for materials that it is
  /// not for.
  ElementsBeside(const Approximation<Dim>& cloud, const ElasticModel& model, Program<Dim> program,
                 const Monitor& monitor = {});

  /// Degree of the elements: that of the cloud's space; 2 where the cloud averages dilatations.
  static int degree(const Approximation<Dim>& cloud) { return cloud.averaged ? 2 : cloud.space.degree(); }
  const NonlinearEquilibrium<Dim>& equations() const { return *equations_; }
  const Approximation<Dim>& elements() const { return *elements_; }
  /// Balance under what acts in the cloud's state. `stress`: recovered from the cloud's (Fields). Throws NumericalError
  /// where there is none near the cloud's.
  BesideCloud<Dim> balance(const State& cloud, const VoigtPoints<Dim>& stress) const;

 private:
  using SharedEquations = std::shared_ptr<const NonlinearEquilibrium<Dim>>;
  SharedEquations equations_of(const ElasticModel& model) const;
  /// Balance from a motion on, of its own equations by `linear`; bulk moduli rise on the way.
  BesideCloud<Dim> balance_from(const State& start, LinearSolver& linear) const;

  const Approximation<Dim>& cloud_;
  ElasticModel model_;
  Program<Dim> program_;
  std::shared_ptr<const Approximation<Dim>> elements_;
  std::shared_ptr<const NonlinearEquilibrium<Dim>> equations_;
};

}  // namespace efree
