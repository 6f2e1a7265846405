// SPDX-License-Identifier: GPL-3.0-or-later
/// Pressure by density and internal energy: fluids, and what shocks make of solids.
#pragma once

#include "efree/materials/material.hpp"

#include <variant>

namespace efree {

/// Shock and particle velocities on a line, U_s = sound_speed + slope u_p, and Gamma rho = constant.
struct MieGrueneisen {
  double density = 0.0;      ///< rho_0, positive
  double sound_speed = 0.0;  ///< c_0, positive
  double slope = 0.0;        ///< s, not negative
  double gamma = 0.0;        ///< Grueneisen's Gamma_0, not negative
};

/// p = cold(J) + thermal(J) E, by J = rho_0 / rho and the internal energy E per volume of the reference configuration.
/// All throw InputError for parameters out of range.
class EquationOfState {
 public:
  /// p = (gamma - 1) E / J, gamma > 1.
  static EquationOfState ideal_gas(double gamma);
  /// p = (gamma - 1) E / J - gamma stiffening (Harlow & Amsden 1971; Menikoff & Plohr 1989), stiffening [stress] >= 0.
  static EquationOfState stiffened_gas(double gamma, double stiffening);
  /// p = bulk / exponent (J^-exponent - 1) (Tait; Cole 1948): heat does not press. Bulk modulus [stress], exponent > 0.
  static EquationOfState tait(double bulk, double exponent);
  /// p = rho_0 c_0^2 eta (1 - Gamma_0 eta / 2) / (1 - s eta)^2 + Gamma_0 E, eta = 1 - J > 0; where it is expanded
  /// rho_0 c_0^2 (1 / J - 1) + Gamma_0 E.
  static EquationOfState mie_grueneisen(const MieGrueneisen& parameters);

  /// Of a pressure [stress].
  struct Value {
    double pressure, by_J, by_energy;  ///< and its derivatives
  };
  /// Throws NumericalError where J is not positive, or is so small that no shock leads there (Mie & Grueneisen).
  Value at(double J, double energy) const;
  /// Isentropic bulk modulus rho c^2 = -J (dp/dJ - p dp/dE) [stress].
  double stiffness(double J, double energy) const;
  /// c, by the density at J = 1. Throws NumericalError where the stiffness is negative: waves do not travel there.
  double sound_speed(double J, double energy, double density) const;
  /// E at which the pressure is that at J = 1; 0 if heat does not press.
  double energy_at_rest(double pressure) const;

  /// What a point remembers of its volume; zero where nothing has happened yet.
  struct State {
    double dilatation = 0.0;  ///< J - 1
    double energy = 0.0;      ///< E, less that at rest
    double heat = 0.0;        ///< of that what came as heat
  };
  /// The end of a step to J: E rises by heat and by -(p_old + p_new) / 2 dJ, which is second order in the step, and
  /// over one step as long as a shock Rankine and Hugoniot's condition. `pressure` is that at rest. `by_J`: of the
  /// pressure along steps to other J. Throws NumericalError for compression beyond what any shock makes.
  struct Step {
    State after;
    double pressure, by_J;
  };
  Step step(const State& before, double J, double heat, double pressure_at_rest) const;

 private:
  struct Gas {
    double gamma, stiffening;
  };
  struct Tait {
    double bulk, exponent;
  };
  using Law = std::variant<Gas, Tait, MieGrueneisen>;
  explicit EquationOfState(Law law) : law_(law) {}

  Law law_;
};

/// `Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = 1e5})`.
struct FluidParameters {
  EquationOfState state;
  Parameter pressure = 0.0;     ///< in the reference configuration [stress]
  double viscosity = 0.0;       ///< against shear [stress time], not negative
  double bulk_viscosity = 0.0;  ///< against changes of volume [stress time], not negative
};

/// sigma = -p 1 + 2 viscosity dev(D) + bulk_viscosity tr(D) 1, D = ln(V) / dt, V the left stretch of the step: whatever
/// turns, nothing is heated. Remembers "dilatation" (J - 1), "internal_energy" (less that at rest), "heat" (of that
/// what came from elsewhere and by viscosity), and, if it is viscous, F - 1. `energy` is internal energy less heat, the
/// work against the pressure; `dissipated` is the work of viscosity. The tangent is exact but for viscosity (first
/// order in the step's strain). Throws NumericalError, with the place, where J <= 0 or matter is compressed too far.
class Fluid final : public Material {
 public:
  /// Throws InputError for parameters out of range.
  explicit Fluid(FluidParameters parameters);
  Index history_size() const override { return viscous() ? 12 : 3; }
  bool homogeneous() const override { return parameters_.pressure.is_constant(); }
  bool symmetric() const override { return false; }
  std::vector<HistoryPart> history_parts() const override;
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  bool viscous() const { return parameters_.viscosity > 0.0 || parameters_.bulk_viscosity > 0.0; }

  FluidParameters parameters_;
};

/// Shape and volume apart: another material answers to F / J^(1/3), and the mean of its Kirchhoff stress gives way to
/// the pressure of an equation of state, which what the other dissipates heats. Remembers, after the other's history,
/// "dilatation", "internal_energy" and "heat" as Fluid does. Of the other's elastic constants the shear modulus counts.
/// The tangent is exact but for the heat of what is dissipated in the step itself.
class WithPressure final : public Material {
 public:
  /// Throws InputError for a material of small strains.
  WithPressure(SharedMaterial shape, EquationOfState state);
  Index history_size() const override { return shape_->history_size() + 3; }
  bool homogeneous() const override { return shape_->homogeneous(); }
  bool symmetric() const override { return false; }
  std::vector<HistoryPart> history_parts() const override;
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  SharedMaterial shape_;
  EquationOfState state_;
};

}  // namespace efree
