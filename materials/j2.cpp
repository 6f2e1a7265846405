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
      kinematic_(parameters.kinematic) {
  if (!(kinematic_ >= 0.0) || !std::isfinite(kinematic_))
    throw InputError(fmt::format("kinematic hardening modulus {}, expected a number that is not negative", kinematic_));
  if (kinematic_ > 0.0 && strain_ == Strain::finite)
    throw InputError("kinematic hardening is for small strains: strain = finite was asked for");
}

void J2::respond(const Deformation& given, MaterialResponse& response) const {
  const double ratio = std::sqrt(2.0 / 3.0);
  /// How far the deviator of length e flows.
  const auto flow_of = [&](double e, double a, const ElasticConstants& elastic) {
    const double stiff = 2.0 * elastic.mu + 2.0 / 3.0 * kinematic_;
    // Of the plastic strain's norm: how far the stress is outside.
    const auto outside = [&](double flow) {
      const auto [yield, slope] = yield_.at(a + ratio * flow);
      return std::pair(2.0 * elastic.mu * e - stiff * flow - ratio * yield, -stiff - 2.0 / 3.0 * slope);
    };
    const auto [beyond, slope_there] = outside(0.0);
    if (!(beyond > 0.0)) return std::pair(0.0, 0.0);
    resistance(slope_there);
    const double flow = root(outside, 0.0, 2.0 * elastic.mu * e / stiff, 2.0 * elastic.mu * e);
    return std::pair(flow, resistance(outside(flow).second));
  };
  const auto returned = [&](const Vec<3>& trial, double a, const ElasticConstants& elastic, const Vec<3>&) {
    const Meridian at(trial);
    const auto [flow, D] = flow_of(at.e, a, elastic);
    if (flow == 0.0) return still_elastic(trial, a, elastic);
    const double s = 2.0 * elastic.mu * (at.e - flow);
    Mat<2> slope;
    slope << elastic.kappa, 0.0, 0.0, 2.0 * elastic.mu * (1.0 - 2.0 * elastic.mu / D);
    return Returned{at.stress(elastic.kappa * at.theta, s, slope), trial - flow * at.n, a + ratio * flow,
                    yield_.work(a, a + ratio * flow), true};
  };
  for (Index p = 0; p < given.size(); ++p)
    if (!respond_near_identity(p, given, response, flow_of))
      respond_by_return(p, moduli_, strain_, kinematic_, given, response, returned);
}

/// The same law without principal axes, three times as fast, where no tangent is asked for and elastic strains are
/// small: ln V_e and what flow makes of V_e are short series. False, and nothing is done, elsewhere.
template <class Flow> bool J2::respond_near_identity(Index p, const Deformation& given, MaterialResponse& response,
                                                     const Flow& flow_of) const {
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
  double flow = 0.0;
  try {
    flow = flow_of(e, a, elastic).first;
  } catch (const NumericalError& error) {
    throw NumericalError(error.what() + (" " + place(X)));
  }
  const Mat<3> inverse = F.inverse();
  const double kept = flow == 0.0 ? 1.0 : 1.0 - flow / e;
  const Mat<3> tau = elastic.kappa * theta * Mat<3>::Identity() + 2.0 * elastic.mu * kept * deviator;
  response.stress(p) = tau * inverse.transpose();
  response.energy[p] = 0.5 * elastic.kappa * theta * theta + elastic.mu * (kept * e) * (kept * e);
  response.dissipated[p] = 0.0;
  response.history.col(p) = given.history.col(p);
  if (flow == 0.0) return true;
  const double after = a + std::sqrt(2.0 / 3.0) * flow;
  response.dissipated[p] = yield_.work(a, after);
  const Mat<3> left = exp_of_deviator(-2.0 * flow / e * deviator);  // b_e loses this factor
  const Mat<3> plastic = inverse * (left + growth * left) * inverse.transpose();
  response.history.col(p) << components(0.5 * (plastic + plastic.transpose()) - Mat<3>::Identity()), after;
  return true;
}

}  // namespace efree
