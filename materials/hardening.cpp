// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/hardening.hpp"

#include "efree/materials/internal/require_number.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace efree {
namespace {

using internal::require_number;

void require_yield(double yield) {
  require_number("yield stress", yield, yield >= 0.0, "a number that is not negative");
}

}  // namespace

Hardening Hardening::linear(double yield, double modulus) {
  require_yield(yield);
  require_number("hardening modulus", modulus, true, "a number");
  return Hardening(Law(Linear{yield, modulus}));
}

Hardening Hardening::power_law(double yield, double strain, double exponent) {
  require_yield(yield);
  require_number("strain of a power law", strain, strain > 0.0, "a positive number");
  require_number("exponent of a power law", exponent, exponent >= 0.0, "a number that is not negative");
  return Hardening(Law(PowerLaw{yield, strain, exponent}));
}

Hardening Hardening::ludwik(double yield, double modulus, double exponent) {
  require_yield(yield);
  require_number("hardening modulus", modulus, modulus >= 0.0, "a number that is not negative");
  require_number("exponent of Ludwik's law", exponent, exponent > 0.0, "a positive number");
  return Hardening(Law(Ludwik{yield, modulus, exponent}));
}

Hardening Hardening::voce(double yield, double saturation, double rate, double modulus) {
  require_yield(yield);
  require_number("saturation stress", saturation, saturation >= 0.0, "a number that is not negative");
  require_number("rate of saturation", rate, rate > 0.0, "a positive number");
  require_number("hardening modulus", modulus, modulus >= 0.0, "a number that is not negative");
  return Hardening(Law(Voce{yield, saturation, rate, modulus}));
}

Hardening Hardening::table(std::vector<double> strain, std::vector<double> stress) {
  PiecewiseLinear table(std::move(strain), std::move(stress), "plastic strain", "yield stress");
  require_number("first plastic strain of a table", table.x().front(), table.x().front() == 0.0, "0");
  for (const double yield : table.y()) require_yield(yield);
  return Hardening(Law(std::move(table)));
}

Hardening::Value Hardening::at(double a) const {
  if (const auto* law = std::get_if<Linear>(&law_)) {
    const double stress = law->yield + law->modulus * a;
    return stress > 0.0 ? Value{stress, law->modulus} : Value{0.0, 0.0};
  }
  if (const auto* law = std::get_if<PowerLaw>(&law_)) {
    const double x = 1.0 + a / law->strain, stress = law->yield * std::pow(x, law->exponent);
    return {stress, law->exponent * stress / (law->strain * x)};
  }
  if (const auto* law = std::get_if<Ludwik>(&law_)) {
    if (law->modulus == 0.0) return {law->yield, 0.0};
    const double more = law->modulus * std::pow(a, law->exponent);
    return {law->yield + more, a > 0.0 ? law->exponent * more / a : law->modulus * std::pow(0.0, law->exponent - 1.0)};
  }
  if (const auto* law = std::get_if<Voce>(&law_)) {
    const double left = (law->saturation - law->yield) * std::exp(-law->rate * a);
    return {law->saturation - left + law->modulus * a, law->rate * left + law->modulus};
  }
  if (const auto* table = std::get_if<PiecewiseLinear>(&law_)) {
    const auto [stress, slope] = table->at(a);
    return {stress, slope};
  }
  const auto& law = std::get<Function>(law_);
  const double stress = law.stress(a);
  return stress > 0.0 ? Value{stress, law.slope(a)} : Value{std::isnan(stress) ? stress : 0.0, 0.0};
}

bool Hardening::falls() const {
  if (const auto* table = std::get_if<PiecewiseLinear>(&law_)) return !std::ranges::is_sorted(table->y());
  return std::ranges::any_of(std::array{0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0}, [&](double a) { return at(a).slope < 0.0; });
}

double Hardening::work(double a, double b) const {
  if (const auto* law = std::get_if<Linear>(&law_)) {
    if (law->modulus < 0.0) {
      const double end = -law->yield / law->modulus;
      a = std::min(a, end);
      b = std::min(b, end);
    }
    return (b - a) * (law->yield + 0.5 * law->modulus * (a + b));
  }
  if (const auto* law = std::get_if<PowerLaw>(&law_)) {
    const double n = law->exponent + 1.0, x = 1.0 + a / law->strain;
    // (x + d)^n - x^n without a difference of nearly equal numbers.
    return law->yield * law->strain / n * std::pow(x, n) * std::expm1(n * std::log1p((b - a) / law->strain / x));
  }
  if (const auto* law = std::get_if<Ludwik>(&law_)) {
    const double n = law->exponent + 1.0;
    const double grown = a > 0.0 ? std::pow(a, n) * std::expm1(n * std::log1p((b - a) / a)) : std::pow(b, n);
    return (b - a) * law->yield + law->modulus / n * grown;
  }
  if (const auto* law = std::get_if<Voce>(&law_))
    return (b - a) * (law->saturation + 0.5 * law->modulus * (a + b)) +
           (law->saturation - law->yield) / law->rate * std::exp(-law->rate * a) * std::expm1(-law->rate * (b - a));
  if (const auto* table = std::get_if<PiecewiseLinear>(&law_)) {
    const std::vector<double>& strain = table->x();
    double sum = 0.0;
    for (std::size_t k = 1; k < strain.size(); ++k) {
      const double from = std::clamp(a, strain[k - 1], strain[k]), to = std::clamp(b, strain[k - 1], strain[k]);
      if (to > from) sum += (to - from) * table->at(0.5 * (from + to)).value;
    }
    const double last = strain.back();
    return sum + table->y().back() * (std::max(b, last) - std::max(a, last));
  }
  constexpr std::array<std::pair<double, double>, 5> gauss{{{-0.906179845938664, 0.236926885056189},
                                                            {-0.538469310105683, 0.478628670499366},
                                                            {0.0, 0.568888888888889},
                                                            {0.538469310105683, 0.478628670499366},
                                                            {0.906179845938664, 0.236926885056189}}};
  double sum = 0.0;
  for (const auto& [x, weight] : gauss) sum += weight * at(0.5 * (a + b + x * (b - a))).stress;
  return 0.5 * (b - a) * sum;
}

}  // namespace efree
