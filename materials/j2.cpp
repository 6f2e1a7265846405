// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/j2.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/near_identity.hpp"
#include "efree/materials/internal/return_mapping.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <cmath>

namespace efree {

using namespace internal;

std::vector<HistoryPart> Plastic::history_parts() const {
  return {{finite_strain() ? "inverse_plastic_metric" : "plastic_strain", 0, 6}, {"equivalent_plastic_strain", 6, 1}};
}

J2::J2(J2Parameters parameters)
    : Plastic(parameters.moduli, parameters.strain),
      yield_(std::move(parameters.yield)),
      kinematic_(parameters.kinematic),
      rate_(parameters.rate),
      heating_(parameters.heating) {
  if (heating_) heating_->checked();
  if (!(kinematic_ >= 0.0) || !std::isfinite(kinematic_))
    throw InputError(fmt::format("kinematic hardening modulus {}, expected a number that is not negative", kinematic_));
  if (kinematic_ > 0.0 && strain_ == Strain::finite)
    throw InputError("kinematic hardening is for small strains: strain = finite was asked for");
}

std::vector<HistoryPart> J2::history_parts() const {
  std::vector<HistoryPart> parts = Plastic::history_parts();
  if (heating_) parts.push_back({"temperature_rise", 7, 1});
  return parts;
}

/// How the deviator of a point flows in a step.
struct J2::Flow {
  double length = 0.0;  ///< of the plastic strain
  double slope = 0.0;   ///< of the length, by the deviator's
  double work = 0.0;    ///< against the yield stress
  double rise = 0.0;    ///< of the temperature, so far
};

/// Of a deviator of length e.
J2::Flow J2::flow_of(Index p, const Deformation& given, double e, const ElasticConstants& elastic) const {
  const double ratio = std::sqrt(2.0 / 3.0), a = given.history(6, p), dt = given.dt;
  const double stiff = 2.0 * elastic.mu + 2.0 / 3.0 * kinematic_;
  const double before = heating_ ? given.history(7, p) : 0.0;
  const double rise = heating_ ? before + given.heat_at(p) / heating_->capacity : 0.0;
  const double warmth = heating_ ? heating_->fraction / heating_->capacity : 0.0;  // of plastic work
  const double first = heating_ ? yield_.at(a).stress * heating_->softening(before).value : 0.0;
  struct Outside {
    double value, slope, by_e, work, rise;
  };
  // By the length of the flow: how far the stress is outside. Work that heats is by the trapezoidal rule of stress.
  const auto outside = [&](double length) {
    const double more = ratio * length, excess = 2.0 * elastic.mu * e - stiff * length;
    const auto [yield, hardening] = yield_.at(a + more);
    const auto [fast, by_rate] = rate_.constant() ? Factor{1.0, 0.0} : rate_.at(more / dt);
    const double hot = yield * fast, by_more = hardening * fast + (rate_.constant() ? 0.0 : yield * by_rate / dt);
    if (!heating_) return Outside{excess - ratio * hot, -stiff - 2.0 / 3.0 * by_more, 2.0 * elastic.mu, 0.0, 0.0};
    const double mean = 0.5 * (first * fast + excess / ratio);
    const double of_mean = 0.5 * ((rate_.constant() ? 0.0 : first * by_rate * ratio / dt) - stiff / ratio);
    const double warmer = rise + warmth * mean * more;
    const auto [cold, by_heat] = heating_->softening(warmer);
    const double softer = hot * by_heat * warmth;
    return Outside{
        excess - ratio * hot * cold,
        -stiff - (cold > 0.0 ? 2.0 / 3.0 * by_more * cold : 0.0) - ratio * softer * (mean * ratio + of_mean * more),
        2.0 * elastic.mu * (1.0 - 0.5 * softer * more), mean * more, warmer};
  };
  const double start = yield_.at(a).stress * (heating_ ? heating_->softening(rise).value : 1.0);
  if (!(2.0 * elastic.mu * e - ratio * start > 0.0)) return {0.0, 0.0, 0.0, rise};
  if (!rate_.constant() && !(dt > 0.0))
    throw NumericalError("plastic flow in no time, with a yield stress that depends on the rate of strain");
  if (!heating_) resistance(outside(0.0).slope);
  Outside there{};
  const auto value_and_slope = [&](double length) {
    there = outside(length);
    return std::pair(there.value, there.slope);
  };
  // Hardening and the rate take little of what flows without them.
  const double most = 2.0 * elastic.mu * e, still = (most - ratio * start) / stiff;
  const double length = root(value_and_slope, 0.0, most / stiff, most, still);
  const double slope = there.by_e / resistance(there.slope);
  if (heating_) return {length, slope, there.work, there.rise};
  const double fast = rate_.constant() ? 1.0 : rate_.at(ratio * length / dt).value;
  return {length, slope, fast * yield_.work(a, a + ratio * length), 0.0};
}

void J2::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    if (respond_near_identity(p, given, response)) continue;
    double rise = 0.0;
    const auto returned = [&](const Vec<3>& trial, double a, const ElasticConstants& elastic, const Vec<3>&) {
      const Meridian at(trial);
      const Flow flow = flow_of(p, given, at.e, elastic);
      rise = flow.rise;
      if (flow.length == 0.0) return still_elastic(trial, a, elastic);
      const double s = 2.0 * elastic.mu * (at.e - flow.length);
      Mat<2> slope;
      slope << elastic.kappa, 0.0, 0.0, 2.0 * elastic.mu * (1.0 - flow.slope);
      return Returned{at.stress(elastic.kappa * at.theta, s, slope), trial - flow.length * at.n,
                      a + std::sqrt(2.0 / 3.0) * flow.length, flow.work, true};
    };
    respond_by_return(p, moduli_, strain_, kinematic_, given, response, returned);
    if (heating_) response.history(7, p) = rise;
  }
}

/// The same law without principal axes, three times as fast, where no tangent is asked for and elastic strains are
/// small: ln V_e and what flow makes of V_e are short series. False, and nothing is done, elsewhere.
bool J2::respond_near_identity(Index p, const Deformation& given, MaterialResponse& response) const {
  if (strain_ == Strain::small || response.tangent) return false;
  const Mat<3> F = given.gradient(p), H = F - Mat<3>::Identity();
  const double J = F.determinant();
  if (!(J > 0.0) || !std::isfinite(J)) return false;
  // b_e = F C_p^-1 F^T, less one so that small strains keep their digits.
  const Mat<3> before = internal::symmetric(given.history.col(p).head<6>());
  const Mat<3> growth = H + H.transpose() + H * H.transpose() + F * before * F.transpose();
  Mat<3> strain;
  if (!log_near_identity(growth, strain)) return false;
  strain *= 0.5;
  const Vec<3> X = given.X.col(p);
  const ElasticConstants elastic = moduli_.at(X);
  const double theta = strain.trace(), a = given.history(6, p);
  const Mat<3> deviator = strain - theta / 3.0 * Mat<3>::Identity();
  const double e = deviator.norm();
  Flow flow;
  try {
    flow = flow_of(p, given, e, elastic);
  } catch (const NumericalError& error) {
    throw NumericalError(error.what() + (" " + place(X)));
  }
  const Mat<3> inverse = F.inverse();
  const double kept = flow.length == 0.0 ? 1.0 : 1.0 - flow.length / e;
  const Mat<3> tau = elastic.kappa * theta * Mat<3>::Identity() + 2.0 * elastic.mu * kept * deviator;
  response.stress(p) = tau * inverse.transpose();
  response.energy[p] = 0.5 * elastic.kappa * theta * theta + elastic.mu * (kept * e) * (kept * e);
  response.dissipated[p] = 0.0;
  response.history.col(p) = given.history.col(p);
  if (heating_) response.history(7, p) = flow.rise;
  if (flow.length == 0.0) return true;
  const double after = a + std::sqrt(2.0 / 3.0) * flow.length;
  response.dissipated[p] = flow.work;
  const Mat<3> left = exp_of_deviator(-2.0 * flow.length / e * deviator);  // b_e loses this factor
  const Mat<3> plastic = inverse * (left + growth * left) * inverse.transpose();
  response.history.col(p).head<7>() << components(0.5 * (plastic + plastic.transpose()) - Mat<3>::Identity()), after;
  return true;
}

}  // namespace efree
