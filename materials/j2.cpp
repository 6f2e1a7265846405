// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/j2.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/return_mapping.hpp"

#include <fmt/format.h>

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
  const auto returned = [&](const Vec<3>& trial, double a, const ElasticConstants& elastic, const Vec<3>&) {
    const Meridian at(trial);
    const double ratio = std::sqrt(2.0 / 3.0), stiff = 2.0 * elastic.mu + 2.0 / 3.0 * kinematic_;
    // Of the plastic strain's norm: how far the stress is outside.
    const auto outside = [&](double flow) {
      const auto [yield, slope] = yield_.at(a + ratio * flow);
      return std::pair(2.0 * elastic.mu * at.e - stiff * flow - ratio * yield, -stiff - 2.0 / 3.0 * slope);
    };
    const auto [beyond, slope_there] = outside(0.0);
    if (!(beyond > 0.0)) return still_elastic(trial, a, elastic);
    resistance(slope_there);
    const double flow = root(outside, 0.0, 2.0 * elastic.mu * at.e / stiff, 2.0 * elastic.mu * at.e);
    const double D = resistance(outside(flow).second);
    const double s = 2.0 * elastic.mu * (at.e - flow);
    Mat<2> slope;
    slope << elastic.kappa, 0.0, 0.0, 2.0 * elastic.mu * (1.0 - 2.0 * elastic.mu / D);
    return Returned{at.stress(elastic.kappa * at.theta, s, slope), trial - flow * at.n, a + ratio * flow,
                    yield_.work(a, a + ratio * flow), true};
  };
  respond_by_return(moduli_, strain_, kinematic_, given, response, returned);
}

}  // namespace efree
