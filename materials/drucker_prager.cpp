// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/drucker_prager.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/return_mapping.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace efree {

using namespace internal;

namespace {

constexpr Index opening = 7;  ///< row of the history

struct Cone {
  double eta, xi;
};
Cone cone(double angle, ConeFit fit) {
  const double sine = std::sin(angle), cosine = std::cos(angle), tangent = std::tan(angle);
  if (fit == ConeFit::plane_strain) {
    const double root = std::sqrt(9.0 + 12.0 * tangent * tangent);
    return {3.0 * tangent / root, 3.0 / root};
  }
  const double root = std::sqrt(3.0) * (fit == ConeFit::compression ? 3.0 - sine : 3.0 + sine);
  return {6.0 * sine / root, 6.0 * cosine / root};
}

}  // namespace

DruckerPrager::DruckerPrager(DruckerPragerParameters parameters)
    : Plastic(parameters.moduli, parameters.strain), cohesion_(std::move(parameters.cohesion)) {
  const double friction = parameters.friction, dilatancy = parameters.dilatancy.value_or(friction);
  if (!(friction >= 0.0 && friction < 0.5 * std::numbers::pi))
    throw InputError(fmt::format("friction angle {} rad, expected one in [0, pi / 2)", friction));
  if (!(dilatancy >= 0.0 && dilatancy <= friction))
    throw InputError(
        fmt::format("dilatancy angle {} rad, expected one between 0 and the friction angle {}", dilatancy, friction));
  eta_ = cone(friction, parameters.fit).eta;
  xi_ = cone(friction, parameters.fit).xi;
  eta_flow_ = cone(dilatancy, parameters.fit).eta;
}

std::vector<HistoryPart> DruckerPrager::history_parts() const {
  std::vector<HistoryPart> parts = Plastic::history_parts();
  parts.push_back({"opening_strain", Plastic::history_size(), 1});
  return parts;
}

/// The stress p + s n that trial strains theta / 3 + e n come to.
struct DruckerPrager::Return {
  double p, s;
  double flow = 0.0;              ///< of the equivalent plastic strain
  double dissipated = 0.0;        ///< [stress]
  bool plastic = false;           ///< the elastic strain is another one than on trial
  double open = 0.0;              ///< volume strain
  Mat<2> slope = Mat<2>::Zero();  ///< of (p, s) by (theta, e), if it is plastic
};

/// open: volume strain so far.
DruckerPrager::Return DruckerPrager::return_to_cone(double trial, double e, double a, double open,
                                                    const ElasticConstants& elastic) const {
  const double theta = trial + open;
  const double mu = elastic.mu, kappa = elastic.kappa;
  const double root2 = std::sqrt(2.0), most = root2 * e;  // the multiplier that takes all shear away
  // Of the multiplier, and of more volume at the apex: how far the stress is outside.
  const auto outside_cone = [&](double dg) {
    const auto [c, slope] = cohesion_.at(a + xi_ * dg);
    return std::pair(root2 * mu * e - mu * dg + eta_ * kappa * (theta - eta_flow_ * dg) - xi_ * c,
                     -mu - eta_ * eta_flow_ * kappa - xi_ * xi_ * slope);
  };
  const auto outside_apex = [&](double dv) {
    const auto [c, slope] = cohesion_.at(a + xi_ * most + xi_ / eta_ * dv);
    return std::pair(eta_ * kappa * (theta - eta_flow_ * most - dv) - xi_ * c,
                     -eta_ * kappa - xi_ * xi_ / eta_ * slope);
  };
  const auto [beyond, slope_there] = outside_cone(0.0);
  if (!(beyond > 0.0))
    return {.p = kappa * theta,
            .s = 2.0 * mu * e,
            .plastic = open > 0.0,
            .slope = Vec<2>(kappa, 2.0 * mu).asDiagonal().toDenseMatrix()};
  resistance(slope_there);
  const double scale = root2 * mu * e + eta_ * kappa * std::abs(theta);
  const bool apex = outside_cone(most).first > 0.0;
  double dg = most, dv = 0.0, da = xi_ * most, s = 0.0;
  Mat<2> slope;
  if (apex) {
    dv = root(outside_apex, 0.0, theta - eta_flow_ * most, scale);
    da += xi_ / eta_ * std::max(dv - open, 0.0);
    const double D = resistance(outside_apex(dv).second), soft = xi_ * xi_ * cohesion_.at(a + da).slope;
    const double dv_theta = eta_ * kappa / D, dv_e = -root2 * (eta_ * eta_flow_ * kappa + soft) / D;
    slope << kappa * (1.0 - dv_theta), -kappa * (root2 * eta_flow_ + dv_e), 0.0, 0.0;
  } else {
    dg = root(outside_cone, 0.0, most, scale);
    da = xi_ * dg;
    s = 2.0 * mu * e - root2 * mu * dg;
    const double D = resistance(outside_cone(dg).second);
    const double dg_theta = eta_ * kappa / D, dg_e = root2 * mu / D;
    slope << kappa * (1.0 - eta_flow_ * dg_theta), -kappa * eta_flow_ * dg_e, -root2 * mu * dg_theta,
        2.0 * mu - root2 * mu * dg_e;
  }
  const double p = kappa * (theta - eta_flow_ * dg - dv);
  return {p,    s,
          da,   cohesion_.work(a, a + da) - (eta_ - eta_flow_) * p * dg,
          true, apex && !(cohesion_.at(a + da).stress > 0.0) ? theta : 0.0,
          slope};
}

/// In principal axes: any strain, and tangents.
void DruckerPrager::respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const {
  double open = 0.0;
  const auto returned = [&](const Vec<3>& trial, double a, const ElasticConstants& elastic, const Vec<3>&) {
    const Meridian at(trial);
    const Return answer = return_to_cone(at.theta, at.e, a, given.history(opening, p), elastic);
    open = answer.open;
    if (!answer.plastic) return still_elastic(trial, a, elastic);
    const Vec<3> left = Vec<3>::Constant(answer.p / elastic.kappa / 3.0) + answer.s / (2.0 * elastic.mu) * at.n;
    return Returned{at.stress(answer.p, answer.s, answer.slope), left, a + answer.flow, answer.dissipated, true};
  };
  respond_by_return(p, moduli_, strain_, 0.0, given, response, returned);
  response.history(opening, p) = open;
}

/// The same law for points begin .. begin + count, eight at the most, without principal axes, where elastic strains are
/// small. `alike`: their moduli, unless these depend on the place.
void DruckerPrager::respond_near_identity(Index begin, int count, const std::optional<ElasticConstants>& alike,
                                          const Deformation& given, MaterialResponse& response) const {
  EightMetals points;
  take_points(given, begin, count, points);
  try_elastic(points);
  points.length = points.pressure = points.shear = Eight{};
  points.contraction = Eight{} + 1.0;
  std::array<double, 8> flows{}, open{};
  std::array<bool, 8> changed{};
  bool plastic = false;
  for (int l = 0; l < count; ++l) {
    if (points.near[l] != 1.0) continue;
    const Index p = begin + l;
    const ElasticConstants elastic = alike ? *alike : moduli_.at(given.X.col(p));
    const double theta = points.theta[l], e = points.e[l];
    try {
      const Return answer = return_to_cone(theta, e, given.history(6, p), given.history(opening, p), elastic);
      const double kept = answer.s / (2.0 * elastic.mu);
      points.pressure[l] = answer.p;
      points.shear[l] = e > 0.0 ? answer.s / e : 0.0;
      response.energy[p] = 0.5 * answer.p * answer.p / elastic.kappa + elastic.mu * kept * kept;
      response.dissipated[p] = answer.dissipated;
      if (!answer.plastic) continue;
      points.length[l] = e - kept;
      if (const double volume = theta - answer.p / elastic.kappa; volume != 0.0)
        points.contraction[l] = std::exp(-2.0 / 3.0 * volume);
      flows[l] = answer.flow;
      open[l] = answer.open;
      plastic = changed[l] = true;
    } catch (const NumericalError& error) {
      throw NumericalError(error.what() + (" " + place(given.X.col(p))));
    }
  }
  flow_back(points, plastic);
  for (int l = 0; l < count; ++l) {
    const Index p = begin + l;
    if (points.near[l] != 1.0) {
      respond_in_axes(p, given, response);
      continue;
    }
    double *P = response.P.col(p).data(), *history = response.history.col(p).data();
    for (int k = 0; k < 9; ++k) P[k] = points.P[k][l];
    if (!changed[l]) continue;
    for (int k = 0; k < 6; ++k) history[k] = points.metric[k][l];
    history[6] += flows[l];
    history[opening] = open[l];
  }
}

void DruckerPrager::respond(const Deformation& given, MaterialResponse& response) const {
  respond_in_eights(
      moduli_, strain_, given, response, [&](Index p) { respond_in_axes(p, given, response); },
      [&](Index begin, int count, const auto& alike) { respond_near_identity(begin, count, alike, given, response); });
}

}  // namespace efree
