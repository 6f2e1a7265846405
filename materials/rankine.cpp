// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/rankine.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/hardening.hpp"
#include "efree/materials/internal/return_mapping.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <algorithm>

namespace efree {

using namespace internal;

namespace {

/// Yield stress of one place.
Hardening law_at(const Parameter& strength, const Parameter& softening, double kappa, const Vec<3>& X) {
  const double tau = strength.at(X), alpha = softening.at(X);
  const auto refuse = [&](const char* what, double value, const std::string& expected) {
    const bool known = strength.is_constant() && softening.is_constant();
    throw InputError(fmt::format("{} = {}{}, expected {}", what, value, known ? "" : " " + place(X), expected));
  };
  if (!(tau >= 0.0) || !std::isfinite(tau)) refuse("strength", tau, "a number that is not negative");
  if (!(alpha >= 0.0 && alpha < kappa))
    refuse("softening", alpha,
           fmt::format("one from 0 to less than the bulk modulus {:.6g}: stresses cannot follow faster ones", kappa));
  return Hardening::linear(tau, -alpha);
}

/// `trial` ascends.
Returned torn(const Vec<3>& trial, double a, const ElasticConstants& elastic, const Hardening& strength) {
  const double lambda = elastic.lambda, mu = elastic.mu;
  const PrincipalStress before = PrincipalStress::linear(trial, elastic.kappa, mu);
  if (!(before.stress[2] > strength.at(a).stress)) return still_elastic(trial, a, elastic);
  // Torn along the n last axes: by plastic stretches of the sum `opening` their stresses come down to one.
  int n = 0;
  double opening = 0.0, sum = 0.0, stiff = 0.0;
  do {
    ++n;
    sum += before.stress[3 - n];
    stiff = n * lambda + 2.0 * mu;
    const auto outside = [&](double x) {
      const auto [stress, slope] = strength.at(a + x);
      return std::pair(sum - stiff * x - n * stress, -stiff - n * slope);
    };
    opening = root(outside, opening, sum / stiff, n * before.stress.cwiseAbs().maxCoeff());
  } while (n < 3 && before.stress[2 - n] - lambda * opening > strength.at(a + opening).stress);
  const auto [limit, slope] = strength.at(a + opening);
  const double resistance = stiff + n * slope;
  Returned result{{before.stress.array() - lambda * opening, before.slope, before.secant},
                  trial,
                  a + opening,
                  strength.work(a, a + opening),
                  true};
  Vec<3> by = Vec<3>::Constant(n * lambda / resistance);  // of `opening`, by strains
  by.tail(n).array() += 2.0 * mu / resistance;
  for (int i = 0; i < 3; ++i)
    if (i < 3 - n) {
      result.law.slope.row(i) -= lambda * by.transpose();
    } else {
      result.elastic[i] -= (result.law.stress[i] - limit) / (2.0 * mu);
      result.law.stress[i] = limit;
      result.law.slope.row(i) = slope * by.transpose();
    }
  for (int i = 3 - n; i < 3; ++i) {
    for (int j = 3 - n; j < 3; ++j) result.law.secant(i, j) = 0.0;
    for (int j = 0; j < 3 - n; ++j) {
      const double apart = trial[i] - trial[j], drop = limit - result.law.stress[j];
      result.law.secant(i, j) = result.law.secant(j, i) = apart > 0.0 ? std::clamp(drop / apart, 0.0, 2.0 * mu) : 0.0;
    }
  }
  return result;
}

/// The answer where matter fails in this step: the strains that are left have the stresses of other constants.
Returned with_failure(Returned answer, const ElasticConstants& before, const ElasticConstants& after) {
  const PrincipalStress old = PrincipalStress::linear(answer.elastic, before.kappa, before.mu),
                        now = PrincipalStress::linear(answer.elastic, after.kappa, after.mu);
  answer.dissipated += elastic_energy(answer.elastic, before) - elastic_energy(answer.elastic, after);
  answer.law = {now.stress, now.slope * old.slope.inverse() * answer.law.slope,
                after.mu / before.mu * answer.law.secant};
  answer.constants = after;
  return answer;
}

}  // namespace

Rankine::Rankine(RankineParameters parameters)
    : Plastic(parameters.moduli, parameters.strain),
      strength_(std::move(parameters.strength)),
      softening_(std::move(parameters.softening)),
      damage_threshold_(parameters.damage_threshold),
      failed_shear_(parameters.failed_shear) {
  for (const auto& [what, value] : {std::pair{"damage_threshold", damage_threshold_}, {"failed_shear", failed_shear_}})
    if (!(value > 0.0 && value <= 1.0))
      throw InputError(fmt::format("{} = {}, expected more than 0, at most 1", what, value));
  if (failed_shear_ < 1.0 && !softens())
    throw InputError(
        fmt::format("failed_shear = {}: the strength never falls, expected softening, or fracture_energy and length",
                    failed_shear_));
  const Vec<3> nowhere = Vec<3>::Zero();
  if (homogeneous()) law_at(strength_, softening_, moduli_.at(nowhere).kappa, nowhere);
}

bool Rankine::homogeneous() const {
  return Plastic::homogeneous() && strength_.is_constant() && softening_.is_constant();
}

ElasticConstants Rankine::failed(const ElasticConstants& elastic) const {
  const double mu = failed_shear_ * elastic.mu;
  return {elastic.kappa - 2.0 / 3.0 * mu, mu, elastic.kappa};
}

/// In principal axes: any strain, and tangents.
void Rankine::respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const {
  respond_by_return(p, moduli_, strain_, 0.0, given, response,
                    [&](const Vec<3>& trial, double a, const ElasticConstants& elastic, const Vec<3>& X) {
                      const Hardening strength = law_at(strength_, softening_, elastic.kappa, X);
                      if (failed_shear_ == 1.0) return torn(trial, a, elastic, strength);
                      if (!has_failed(strength, a)) {
                        const Returned answer = torn(trial, a, elastic, strength);
                        return has_failed(strength, answer.equivalent) ? with_failure(answer, elastic, failed(elastic))
                                                                       : answer;
                      }
                      Returned answer = torn(trial, a, failed(elastic), strength);
                      answer.constants = failed(elastic);
                      return answer;
                    });
}

/// The same law for points begin .. begin + count, eight at the most, without principal axes where elastic strains are
/// small and nothing tears: no principal stress is more than the mean by sqrt(2/3) of the deviator's length.
void Rankine::respond_near_identity(Index begin, int count, const Deformation& given,
                                    MaterialResponse& response) const {
  EightMetals points;
  take_points(given, begin, count, points);
  try_elastic(points);
  points.pressure = points.shear = points.length = Eight{};
  points.contraction = Eight{} + 1.0;
  for (int l = 0; l < count; ++l) {
    if (points.near[l] != 1.0) continue;
    const Index p = begin + l;
    const Vec<3> X = given.X.col(p);
    const ElasticConstants elastic = moduli_.at(X);
    const Hardening strength = law_at(strength_, softening_, elastic.kappa, X);
    const double a = given.history(6, p), mu = has_failed(strength, a) ? failed(elastic).mu : elastic.mu;
    const double mean = elastic.kappa * points.theta[l], e = points.e[l];
    points.near[l] = mean + std::sqrt(2.0 / 3.0) * 2.0 * mu * e <= strength.at(a).stress ? 1.0 : 0.0;
    points.pressure[l] = mean;
    points.shear[l] = 2.0 * mu;
    response.energy[p] = 0.5 * mean * points.theta[l] + mu * e * e;
  }
  flow_back(points, false);
  for (int l = 0; l < count; ++l) {
    const Index p = begin + l;
    if (points.near[l] != 1.0) {
      respond_in_axes(p, given, response);
      continue;
    }
    for (int k = 0; k < 9; ++k) response.P(k, p) = points.P[k][l];
    response.dissipated[p] = 0.0;
  }
}

void Rankine::respond(const Deformation& given, MaterialResponse& response) const {
  respond_in_eights(
      moduli_, strain_, given, response, [&](Index p) { respond_in_axes(p, given, response); },
      [&](Index begin, int count, const auto&) { respond_near_identity(begin, count, given, response); });
}

double softening_modulus(double strength, double fracture_energy, double length) {
  for (const auto& [what, value] :
       {std::pair{"strength", strength}, {"fracture energy", fracture_energy}, {"length", length}})
    if (!(value > 0.0) || !std::isfinite(value))
      throw InputError(fmt::format("{} = {}, expected a positive number", what, value));
  return 0.5 * strength * strength * length / fracture_energy;
}

}  // namespace efree
