// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/drucker_prager.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/return_mapping.hpp"

#include <fmt/format.h>
#include <numbers>

namespace efree {

using namespace internal;

namespace {

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

void DruckerPrager::respond(const Deformation& given, MaterialResponse& response) const {
  const auto returned = [&](const Vec<3>& trial, double a, const ElasticConstants& elastic, const Vec<3>&) {
    const double mu = elastic.mu, kappa = elastic.kappa;
    const Meridian at(trial);
    const double root2 = std::sqrt(2.0), most = root2 * at.e;  // the multiplier that takes all shear away
    // Of the multiplier, and of more volume at the apex: how far the stress is outside.
    const auto outside_cone = [&](double dg) {
      const auto [c, slope] = cohesion_.at(a + xi_ * dg);
      return std::pair(root2 * mu * at.e - mu * dg + eta_ * kappa * (at.theta - eta_flow_ * dg) - xi_ * c,
                       -mu - eta_ * eta_flow_ * kappa - xi_ * xi_ * slope);
    };
    const auto outside_apex = [&](double dv) {
      const auto [c, slope] = cohesion_.at(a + xi_ * most + xi_ / eta_ * dv);
      return std::pair(eta_ * kappa * (at.theta - eta_flow_ * most - dv) - xi_ * c,
                       -eta_ * kappa - xi_ * xi_ / eta_ * slope);
    };
    const auto [beyond, slope_there] = outside_cone(0.0);
    if (!(beyond > 0.0)) return still_elastic(trial, a, elastic);
    resistance(slope_there);
    const double scale = root2 * mu * at.e + eta_ * kappa * std::abs(at.theta);
    const bool apex = outside_cone(most).first > 0.0;
    double dg = most, dv = 0.0, da = xi_ * most, s = 0.0;
    Mat<2> slope;  // of p, s by theta, e
    if (apex) {
      dv = root(outside_apex, 0.0, at.theta - eta_flow_ * most, scale);
      da += xi_ / eta_ * dv;
      const double D = resistance(outside_apex(dv).second), soft = xi_ * xi_ * cohesion_.at(a + da).slope;
      const double dv_theta = eta_ * kappa / D, dv_e = -root2 * (eta_ * eta_flow_ * kappa + soft) / D;
      slope << kappa * (1.0 - dv_theta), -kappa * (root2 * eta_flow_ + dv_e), 0.0, 0.0;
    } else {
      dg = root(outside_cone, 0.0, most, scale);
      da = xi_ * dg;
      s = 2.0 * mu * at.e - root2 * mu * dg;
      const double D = resistance(outside_cone(dg).second);
      const double dg_theta = eta_ * kappa / D, dg_e = root2 * mu / D;
      slope << kappa * (1.0 - eta_flow_ * dg_theta), -kappa * eta_flow_ * dg_e, -root2 * mu * dg_theta,
          2.0 * mu - root2 * mu * dg_e;
    }
    const double theta = at.theta - eta_flow_ * dg - dv, p = kappa * theta;
    const Vec<3> left = Vec<3>::Constant(theta / 3.0) + s / (2.0 * mu) * at.n;
    return Returned{at.stress(p, s, slope), left, a + da, cohesion_.work(a, a + da) - (eta_ - eta_flow_) * p * dg,
                    true};
  };
  respond_by_return(moduli_, strain_, 0.0, given, response, returned);
}

}  // namespace efree
