// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/piecewise_linear.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/require_number.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree {

PiecewiseLinear::PiecewiseLinear(std::vector<double> x, std::vector<double> y, const char* x_name, const char* y_name)
    : x_(std::move(x)), y_(std::move(y)) {
  if (x_.size() != y_.size() || x_.empty())
    throw InputError(fmt::format("a table with {} values of {} and {} of {}, expected as many of each, at least one",
                                 x_.size(), x_name, y_.size(), y_name));
  for (std::size_t k = 0; k < x_.size(); ++k) {
    internal::require_number(x_name, x_[k], true, "a number");
    internal::require_number(y_name, y_[k], true, "a number");
    if (k > 0 && !(x_[k] > x_[k - 1]))
      throw InputError(fmt::format("{} {} of a table after {}, expected ascending values", x_name, x_[k], x_[k - 1]));
  }
}

PiecewiseLinear::Value PiecewiseLinear::at(double x) const {
  const auto after = std::upper_bound(x_.begin(), x_.end(), x);
  if (after == x_.end()) return {y_.back(), 0.0};
  if (after == x_.begin()) return {y_.front(), 0.0};
  const auto k = after - x_.begin();
  const double slope = (y_[k] - y_[k - 1]) / (x_[k] - x_[k - 1]);
  return {y_[k - 1] + slope * (x - x_[k - 1]), slope};
}

}  // namespace efree
