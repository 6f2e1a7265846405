// SPDX-License-Identifier: GPL-3.0-or-later
/// Functions given by tables.
#pragma once

#include <vector>

namespace efree {

/// A function through points: linear between them, constant below the first and beyond the last.
class PiecewiseLinear {
 public:
  struct Value {
    double value;
    double slope;  ///< derivative; at a point of the table that of the piece after it
  };
  /// Through (x, y). Throws InputError, in which the columns have these names, unless there are as many x as y, at
  /// least one, all of them finite and x ascending.
  PiecewiseLinear(std::vector<double> x, std::vector<double> y, const char* x_name, const char* y_name);
  Value at(double x) const;

  const std::vector<double>& x() const { return x_; }
  const std::vector<double>& y() const { return y_; }

 private:
  std::vector<double> x_, y_;
};

}  // namespace efree
