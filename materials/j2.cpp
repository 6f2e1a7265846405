// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/j2.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/return_mapping.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
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
  const double at_rest = rate_.constant() ? 1.0 : rate_.at(0.0).value;
  const double start = yield_.at(a).stress * at_rest * (heating_ ? heating_->softening(rise).value : 1.0);
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

/// In principal axes: any strain, and tangents.
void J2::respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const {
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

/// The same law for points begin .. begin + count, eight at the most, without principal axes, where elastic strains are
/// small. `alike`: their moduli, unless these depend on the place. The histories of the response are those given, to
/// start with.
void J2::respond_near_identity(Index begin, int count, const std::optional<ElasticConstants>& alike,
                               const Deformation& given, MaterialResponse& response) const {
  EightMetals points;
  take_points(given, begin, count, points);
  try_elastic(points);
  std::array<Flow, 8> flows;
  std::array<ElasticConstants, 8> elastic;
  points.length = points.pressure = points.shear = Eight{};
  points.contraction = Eight{} + 1.0;
  bool plastic = false;
  for (int l = 0; l < count; ++l) {
    if (points.near[l] != 1.0) continue;
    const Index p = begin + l;
    elastic[l] = alike ? *alike : moduli_.at(given.X.col(p));
    const double e = points.e[l];
    try {
      flows[l] = flow_of(p, given, e, elastic[l]);
    } catch (const NumericalError& error) {
      throw NumericalError(error.what() + (" " + place(given.X.col(p))));
    }
    points.length[l] = flows[l].length;
    points.pressure[l] = elastic[l].kappa * points.theta[l];
    points.shear[l] = 2.0 * elastic[l].mu * (flows[l].length == 0.0 ? 1.0 : 1.0 - flows[l].length / e);
    plastic = plastic || flows[l].length > 0.0;
  }
  flow_back(points, plastic);
  for (int l = 0; l < count; ++l) {
    const Index p = begin + l;
    if (points.near[l] != 1.0) {
      respond_in_axes(p, given, response);
      continue;
    }
    const Flow& flow = flows[l];
    const double theta = points.theta[l], kept = points.e[l] - flow.length;
    double *P = response.P.col(p).data(), *history = response.history.col(p).data();
    for (int k = 0; k < 9; ++k) P[k] = points.P[k][l];
    response.energy[p] = 0.5 * elastic[l].kappa * theta * theta + elastic[l].mu * kept * kept;
    response.dissipated[p] = flow.work;
    if (heating_) history[7] = flow.rise;
    if (flow.length == 0.0) continue;
    for (int k = 0; k < 6; ++k) history[k] = points.metric[k][l];
    history[6] += std::sqrt(2.0 / 3.0) * flow.length;
  }
}

void J2::respond(const Deformation& given, MaterialResponse& response) const {
  respond_in_eights(
      moduli_, strain_, given, response, [&](Index p) { respond_in_axes(p, given, response); },
      [&](Index begin, int count, const auto& alike) { respond_near_identity(begin, count, alike, given, response); });
}

}  // namespace efree
