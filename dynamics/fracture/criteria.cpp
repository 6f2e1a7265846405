// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/fracture/criteria.hpp"

#include "efree/materials/internal/require_number.hpp"

#include <algorithm>

namespace efree {

using internal::require_number;

FailureStrain::FailureStrain(const JohnsonCookFailure& law) : law_(law) {
  require_number("reference rate of the plastic strain at failure", law.reference, law.reference > 0.0,
                 "a positive number");
  require_number("rise to melting of the plastic strain at failure", law.melting, law.melting >= 0.0,
                 "a number that is not negative");
}

FailureStrain FailureStrain::table(std::vector<double> triaxiality, std::vector<double> strain) {
  PiecewiseLinear table(std::move(triaxiality), std::move(strain), "triaxiality", "plastic strain at failure");
  for (const double one : table.y()) require_number("plastic strain at failure", one, one > 0.0, "a positive number");
  return FailureStrain(Law(std::move(table)));
}

double FailureStrain::at(double triaxiality, double rate, double temperature_rise) const {
  if (const auto* table = std::get_if<PiecewiseLinear>(&law_)) return table->at(triaxiality).value;
  const auto& [D, reference, melting] = std::get<JohnsonCookFailure>(law_);
  const double fast = std::max(0.0, std::log(rate / reference));
  const double warm = melting > 0.0 ? temperature_rise / melting : 0.0;
  return (D[0] + D[1] * std::exp(D[2] * triaxiality)) * (1.0 + D[3] * fast) * (1.0 + D[4] * warm);
}

}  // namespace efree
