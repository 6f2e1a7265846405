// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/equation_of_state.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/materials/internal/finite_deformation.hpp"
#include "efree/materials/internal/near_identity.hpp"
#include "efree/materials/internal/principal.hpp"
#include "efree/materials/internal/require_number.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <cmath>

namespace efree {

using namespace internal;

namespace {

using State = EquationOfState::State;

template <class Column> State remembered(const Column& rows) {
  return {rows[0], rows[1], rows[2]};
}
Vec<3> rows_of(const State& state) {
  return {state.dilatation, state.energy, state.heat};
}
std::vector<HistoryPart> parts_of_volume(Index first) {
  return {{"dilatation", first, 1}, {"internal_energy", first + 1, 1}, {"heat", first + 2, 1}};
}

/// As `state.step`, with the place in what goes wrong.
EquationOfState::Step step_at(const Vec<3>& X, const EquationOfState& state, const State& before, double J, double heat,
                              double at_rest) {
  try {
    return state.step(before, J, heat, at_rest);
  } catch (const NumericalError& error) {
    throw NumericalError(error.what() + (" " + place(X)));
  }
}

/// ln(V) of f = V R.
Mat<3> log_stretch(const Mat<3>& f) {
  const Mat<3> H = f - identity, growth = H + H.transpose() + H * H.transpose();
  Mat<3> log;
  if (!log_near_identity(growth, log)) {
    const auto [values, axes] = internal::spectrum<3>(growth);
    log = axes * values.array().log1p().matrix().asDiagonal() * axes.transpose();
  }
  return 0.5 * log;
}

}  // namespace

EquationOfState EquationOfState::ideal_gas(double gamma) {
  return stiffened_gas(gamma, 0.0);
}

EquationOfState EquationOfState::stiffened_gas(double gamma, double stiffening) {
  require_number("ratio gamma of specific heats", gamma, gamma > 1.0, "more than 1");
  require_number("stiffening pressure", stiffening, stiffening >= 0.0, "a number that is not negative");
  return EquationOfState(Law(Gas{gamma, stiffening}));
}

EquationOfState EquationOfState::tait(double bulk, double exponent) {
  require_number("bulk modulus", bulk, bulk > 0.0, "a positive number");
  require_number("Tait's exponent", exponent, exponent > 0.0, "a positive number");
  return EquationOfState(Law(Tait{bulk, exponent}));
}

EquationOfState EquationOfState::mie_grueneisen(const MieGrueneisen& of) {
  require_number("density", of.density, of.density > 0.0, "a positive number");
  require_number("sound speed", of.sound_speed, of.sound_speed > 0.0, "a positive number");
  require_number("slope s of the shock velocity", of.slope, of.slope >= 0.0, "a number that is not negative");
  require_number("Grueneisen's gamma", of.gamma, of.gamma >= 0.0, "a number that is not negative");
  return EquationOfState(Law(of));
}

EquationOfState::Value EquationOfState::at(double J, double energy) const {
  if (!(J > 0.0) || !std::isfinite(J))
    throw NumericalError(fmt::format("an equation of state is asked for J = {:.6g}", J));
  if (const auto* gas = std::get_if<Gas>(&law_)) {
    const double thermal = (gas->gamma - 1.0) / J;
    return {thermal * energy - gas->gamma * gas->stiffening, -thermal * energy / J, thermal};
  }
  if (const auto* water = std::get_if<Tait>(&law_)) {
    const double log = -water->exponent * std::log(J);
    return {water->bulk / water->exponent * std::expm1(log), -water->bulk * std::exp(log) / J, 0.0};
  }
  const auto& [density, sound_speed, slope, gamma] = std::get<MieGrueneisen>(law_);
  const double bulk = density * sound_speed * sound_speed, eta = 1.0 - J, thermal = gamma * energy;
  if (eta <= 0.0) return {bulk * eta / J + thermal, -bulk / (J * J), gamma};
  const double left = 1.0 - slope * eta;
  if (!(left > 0.0))
    throw NumericalError(
        fmt::format("compressed to J = {:.6g}: no shock leads beyond 1 - 1 / s = {:.6g}", J, 1.0 - 1.0 / slope));
  const double hugoniot = bulk * eta / (left * left), of_hugoniot = bulk * (1.0 + slope * eta) / (left * left * left);
  return {hugoniot * (1.0 - 0.5 * gamma * eta) + thermal,
          0.5 * gamma * hugoniot - of_hugoniot * (1.0 - 0.5 * gamma * eta), gamma};
}

double EquationOfState::stiffness(double J, double energy) const {
  const auto [pressure, by_J, by_energy] = at(J, energy);
  return -J * (by_J - pressure * by_energy);
}

double EquationOfState::sound_speed(double J, double energy, double density) const {
  require_number("density", density, density > 0.0, "a positive number");
  const double stiff = stiffness(J, energy);
  if (!(stiff >= 0.0))
    throw NumericalError(
        fmt::format("no sound travels where the bulk modulus is {:.6g} (J = {:.6g}, E = {:.6g})", stiff, J, energy));
  return std::sqrt(stiff * J / density);
}

double EquationOfState::energy_at_rest(double pressure) const {
  const auto [cold, by_J, thermal] = at(1.0, 0.0);
  return thermal > 0.0 ? (pressure - cold) / thermal : 0.0;
}

EquationOfState::Step EquationOfState::step(const State& before, double J, double heat, double at_rest) const {
  const double rest = energy_at_rest(at_rest), offset = at_rest - at(1.0, rest).pressure;
  const double dJ = J - 1.0 - before.dilatation,
               old = at(1.0 + before.dilatation, rest + before.energy).pressure + offset;
  // The pressure is linear in the energy, so the new one is found at once.
  const auto [least, by_J, thermal] = at(J, rest + before.energy + heat);
  const double divisor = 1.0 + 0.5 * thermal * dJ;
  if (!(divisor > 0.0))
    throw NumericalError(fmt::format("compressed from J = {:.6g} to {:.6g} in one step, further than any shock does",
                                     1.0 + before.dilatation, J));
  const double pressure = (least + offset - 0.5 * thermal * old * dJ) / divisor;
  const double mean = 0.5 * (old + pressure);
  if (const auto* gas = std::get_if<Gas>(&law_); gas != nullptr && !(pressure + gas->stiffening >= 0.0))
    throw NumericalError(fmt::format("expanded from J = {:.6g} to {:.6g} in one step, further than its pressure does",
                                     1.0 + before.dilatation, J));
  Step result{{J - 1.0, before.energy + heat - mean * dJ, before.heat + heat}, pressure, 0.0};
  result.by_J = (at(J, rest + result.after.energy).by_J - thermal * mean) / divisor;
  return result;
}

Fluid::Fluid(FluidParameters parameters) : parameters_(std::move(parameters)) {
  require_number("viscosity", parameters_.viscosity, parameters_.viscosity >= 0.0, "a number that is not negative");
  require_number("bulk viscosity", parameters_.bulk_viscosity, parameters_.bulk_viscosity >= 0.0,
                 "a number that is not negative");
  if (homogeneous()) require_number("pressure", parameters_.pressure.at(Vec<3>::Zero()), true, "a number");
}

std::vector<HistoryPart> Fluid::history_parts() const {
  return parts_of_volume(0);
}

void Fluid::respond(const Deformation& given, MaterialResponse& response) const {
  const double dt = given.dt, shear = 2.0 * parameters_.viscosity;
  for (Index p = 0; p < given.size(); ++p) {
    const FiniteDeformation at(given, p);
    const Vec<3> X = given.X.col(p);
    const Mat<3> T = at.F_invT();
    Mat<3> viscous_stress = Mat<3>::Zero();
    double heat = 0.0;
    if (viscous()) {
      const Mat<3> old = identity + Mat<3>(given.history.col(p).segment<9>(3).reshaped(3, 3));
      const Mat<3> strain = log_stretch(at.F * old.inverse());
      const double trace = strain.trace();
      if (!strain.isZero(0.0)) {
        if (!(dt > 0.0)) throw NumericalError("a viscous fluid flows in no time " + place(X));
        viscous_stress =
            (shear * (strain - trace / 3.0 * identity) + parameters_.bulk_viscosity * trace * identity) / dt;
        heat = at.J * viscous_stress.cwiseProduct(strain).sum();
      }
      response.history.col(p).segment<9>(3) = at.H.reshaped();
    }
    const auto [after, pressure, by_J] = step_at(X, parameters_.state, remembered(given.history.col(p).head<3>()), at.J,
                                                 given.heat_at(p) + heat, parameters_.pressure.at(X));
    response.history.col(p).head<3>() = rows_of(after);
    response.stress(p) = at.J * (viscous_stress - pressure * identity) * T;
    response.energy[p] = after.energy - after.heat;
    response.dissipated[p] = heat;
    if (!response.tangent) continue;
    const Vec<9> t = T.reshaped();
    auto A = response.tangent_at(p);
    A = -at.J * (pressure + at.J * by_J) * t * t.transpose() + at.J * pressure * crossed(T, T);
    if (!viscous() || !(dt > 0.0)) continue;
    // d(J sigma F^-T) with dD = sym(dF F^-1) / dt.
    A += at.J * Mat<3>(viscous_stress * T).reshaped() * t.transpose() - at.J * crossed(viscous_stress * T, T) +
         at.J / dt *
             (0.5 * shear * (paired(identity, T.transpose() * T) + crossed(T, T)) +
              (parameters_.bulk_viscosity - shear / 3.0) * t * t.transpose());
  }
}

WithPressure::WithPressure(SharedMaterial shape, EquationOfState state) : shape_(std::move(shape)), state_(state) {
  require(shape_->finite_strain(), "WithPressure: a material for finite strains expected");
}

std::vector<HistoryPart> WithPressure::history_parts() const {
  std::vector<HistoryPart> parts = shape_->history_parts();
  for (auto& part : parts_of_volume(shape_->history_size())) parts.push_back(std::move(part));
  return parts;
}

void WithPressure::respond(const Deformation& given, MaterialResponse& response) const {
  const Index rows = shape_->history_size(), n = given.size();
  Deformation shape{given.X, given.F, given.history.topRows(rows), given.dt, given.heat};
  for (Index p = 0; p < n; ++p) shape.F.col(p) /= std::cbrt(FiniteDeformation(given, p).J);
  MaterialResponse inner = efree::respond(*shape_, shape, response.tangent);
  for (Index p = 0; p < n; ++p) {
    const FiniteDeformation at(given, p);
    const Mat<3> T = at.F_invT();
    const auto [after, pressure, by_J] = step_at(given.X.col(p), state_, remembered(given.history.col(p).tail<3>()),
                                                 at.J, given.heat_at(p) + inner.dissipated[p], 0.0);
    const double scale = 1.0 / std::cbrt(at.J);
    const Mat<3> P = scale * inner.stress(p);
    const double mean = P.cwiseProduct(at.F).sum() / 3.0;
    response.stress(p) = P - (mean + at.J * pressure) * T;
    response.history.col(p) << inner.history.col(p), rows_of(after);
    response.energy[p] = inner.energy[p] + after.energy - after.heat;
    response.dissipated[p] = inner.dissipated[p];
    if (!response.tangent) continue;
    // P = scale P'(scale F), of which the part along F^-T is taken off.
    const Vec<9> t = T.reshaped(), f = at.F.reshaped(), s = P.reshaped();
    MaterialResponse::Tangent isochoric = MaterialResponse::Tangent::Identity() - f * t.transpose() / 3.0;
    MaterialResponse::Tangent by_F = scale * scale * inner.tangent_at(p) * isochoric - s * t.transpose() / 3.0;
    response.tangent_at(p) = by_F - t * (f.transpose() * by_F + s.transpose()) / 3.0 -
                             at.J * (pressure + at.J * by_J) * t * t.transpose() +
                             (mean + at.J * pressure) * crossed(T, T);
  }
}

}  // namespace efree
