// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/rate_and_heat.hpp"

#include "efree/materials/internal/require_number.hpp"

#include <cmath>
#include <limits>

namespace efree {

using internal::require_number;

RateFactor RateFactor::johnson_cook(double C, double reference) {
  require_number("sensitivity C to the rate", C, C >= 0.0, "a number that is not negative");
  require_number("reference rate", reference, reference > 0.0, "a positive number");
  return RateFactor(Law(JohnsonCook{C, reference}));
}

RateFactor RateFactor::cowper_symonds(double D, double q) {
  require_number("rate D of Cowper and Symonds", D, D > 0.0, "a positive number");
  require_number("exponent q of Cowper and Symonds", q, q > 0.0, "a positive number");
  return RateFactor(Law(CowperSymonds{D, 1.0 / q}));
}

RateFactor RateFactor::table(std::vector<double> rate, std::vector<double> factor) {
  const PiecewiseLinear given(std::move(rate), std::move(factor), "rate of strain", "factor");
  require_number("first rate of strain of a table", given.x().front(), given.x().front() > 0.0, "a positive number");
  double least = std::numeric_limits<double>::min();
  for (const double one : given.y()) {
    require_number("factor of a rate of strain", one, one >= least, "positive factors that do not fall");
    least = one;
  }
  std::vector<double> log_rate;
  for (const double one : given.x()) log_rate.push_back(std::log(one));
  return RateFactor(Law(PiecewiseLinear(std::move(log_rate), given.y(), "ln of the rate of strain", "factor")));
}

Factor RateFactor::at(double rate) const {
  if (const auto* law = std::get_if<JohnsonCook>(&law_))
    return rate > law->reference ? Factor{1.0 + law->C * std::log(rate / law->reference), law->C / rate}
                                 : Factor{1.0, 0.0};
  if (const auto* law = std::get_if<CowperSymonds>(&law_)) {
    const double x = rate / law->D, more = std::pow(x, law->exponent);
    return {1.0 + more, law->exponent * (x > 0.0 ? more / x : std::pow(0.0, law->exponent - 1.0)) / law->D};
  }
  if (const auto* table = std::get_if<PiecewiseLinear>(&law_)) {
    const auto [factor, slope] = table->at(std::log(rate));
    return {factor, slope == 0.0 ? 0.0 : slope / rate};
  }
  return {1.0, 0.0};
}

const Heating& Heating::checked() const {
  require_number("heat capacity", capacity, capacity > 0.0, "a positive number");
  require_number("reference temperature", reference, true, "a number");
  require_number("melting temperature", melting, melting > reference, "more than the reference temperature");
  require_number("exponent of thermal softening", exponent, exponent > 0.0, "a positive number");
  require_number("fraction of plastic work that heats", fraction, fraction >= 0.0 && fraction <= 1.0,
                 "a number from 0 to 1");
  if (initial) require_number("initial temperature", *initial, true, "a number");
  return *this;
}

Factor Heating::softening(double rise) const {
  const double range = melting - reference, x = (initial.value_or(reference) + rise - reference) / range;
  if (x <= 0.0) return {1.0, 0.0};
  if (x >= 1.0) return {0.0, 0.0};
  const double lost = std::pow(x, exponent);
  return {1.0 - lost, -exponent * lost / x / range};
}

}  // namespace efree
