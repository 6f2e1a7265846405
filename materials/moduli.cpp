// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/moduli.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <array>
#include <cmath>
#include <string_view>
#include <vector>

namespace efree {
namespace {

struct Constant {
  const char* name;
  const std::optional<Parameter> ElasticModuli::*value;
  void check(double x) const {
    const std::string_view which = name;
    if (which == "nu" && !(x > -1.0 && x < 0.5))
      throw InputError(fmt::format("Poisson's ratio nu = {}, expected a number in (-1, 0.5)", x));
    if (which == "E" && !(x > 0.0 && std::isfinite(x)))
      throw InputError(fmt::format("Young's modulus E = {}, expected a positive number", x));
    if ((which == "mu" || which == "kappa") && !(x > 0.0 && std::isfinite(x)))
      throw InputError(
          fmt::format("{} modulus {} = {}, expected a positive number", which == "mu" ? "shear" : "bulk", which, x));
    if (!std::isfinite(x)) throw InputError(fmt::format("elastic constant {} = {}, expected a number", which, x));
  }
};
constexpr std::array<Constant, 5> constants{{{"E", &ElasticModuli::E},
                                             {"nu", &ElasticModuli::nu},
                                             {"mu", &ElasticModuli::mu},
                                             {"kappa", &ElasticModuli::kappa},
                                             {"lambda", &ElasticModuli::lambda}}};

/// lambda, mu, kappa by the constants `first` < `second` of the list above.
ElasticConstants converted(int first, int second, double a, double b) {
  const auto by_shear_and_bulk = [](double mu, double kappa) {
    return ElasticConstants{kappa - 2.0 / 3.0 * mu, mu, kappa};
  };
  const auto by_lame = [](double lambda, double mu) { return ElasticConstants{lambda, mu, lambda + 2.0 / 3.0 * mu}; };
  switch (10 * first + second) {
    case 1:
      return by_lame(a * b / ((1.0 + b) * (1.0 - 2.0 * b)), a / (2.0 * (1.0 + b)));
    case 2:
      return by_shear_and_bulk(b, a * b / (3.0 * (3.0 * b - a)));
    case 3:
      return by_shear_and_bulk(3.0 * b * a / (9.0 * b - a), b);
    case 4: {
      // mu = (E - 3 lambda + R) / 4, without the difference of large numbers for large lambda.
      const double R = std::sqrt(a * a + 9.0 * b * b + 2.0 * a * b);
      return by_lame(b, b > 0.0 ? 2.0 * a * b / (R + 3.0 * b - a) : 0.25 * (a - 3.0 * b + R));
    }
    case 12:
      return by_lame(2.0 * b * a / (1.0 - 2.0 * a), b);
    case 13:
      return by_shear_and_bulk(3.0 * b * (1.0 - 2.0 * a) / (2.0 * (1.0 + a)), b);
    case 14:
      return by_lame(b, b * (1.0 - 2.0 * a) / (2.0 * a));
    case 23:
      return by_shear_and_bulk(a, b);
    case 24:
      return by_lame(b, a);
    default:
      return by_shear_and_bulk(1.5 * (a - b), a);
  }
}

}  // namespace

const ElasticModuli& ElasticModuli::checked() const {
  std::vector<const char*> given;
  for (const Constant& constant : constants)
    if (const auto& value = this->*constant.value) {
      given.push_back(constant.name);
      if (value->is_constant()) constant.check(value->at(Vec<3>::Zero()));
    }
  if (given.size() != 2)
    throw InputError(fmt::format("elastic constants: {} given, expected two of E, nu, mu, kappa, lambda",
                                 given.empty() ? "none" : fmt::format("{}", fmt::join(given, ", "))));
  if (is_constant()) at(Vec<3>::Zero());
  return *this;
}

bool ElasticModuli::is_constant() const {
  for (const Constant& constant : constants)
    if (const auto& value = this->*constant.value; value && !value->is_constant()) return false;
  return true;
}

ElasticConstants ElasticModuli::at(const Vec<3>& X) const {
  std::array<int, 2> which{};
  std::array<double, 2> values{};
  for (int k = 0, found = 0; k < 5 && found < 2; ++k)
    if (const auto& value = this->*constants[k].value) {
      which[found] = k;
      values[found++] = value->at(X);
    }
  try {
    for (const int k : {0, 1}) constants[which[k]].check(values[k]);
    const ElasticConstants result = converted(which[0], which[1], values[0], values[1]);
    if (!(result.mu > 0.0 && result.kappa > 0.0 && std::isfinite(result.mu) && std::isfinite(result.kappa)))
      throw InputError(fmt::format(
          "elastic constants {} = {}, {} = {} make a shear modulus of {:.6g} and a bulk modulus of {:.6g}, expected "
          "positive numbers",
          constants[which[0]].name, values[0], constants[which[1]].name, values[1], result.mu, result.kappa));
    return result;
  } catch (const InputError& error) {
    if (is_constant()) throw;
    throw InputError(fmt::format("at ({:.6g}): {}", fmt::join(X, ", "), error.what()));
  }
}

}  // namespace efree
