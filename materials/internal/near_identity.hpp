// SPDX-License-Identifier: GPL-3.0-or-later
/// Logarithms of symmetric tensors by their series, where these are short: no axes are needed.
#pragma once

#include "efree/core/types.hpp"

#include <cmath>

namespace efree::internal {

/// c0 I + c1 D + c2 D^2 of a symmetric D without trace: what every series of D comes to, by D^3 = tr(D^2)/2 D + det(D)
/// I (Cayley & Hamilton).
class DeviatorSeries {
 public:
  explicit DeviatorSeries(const Mat<3>& D) : D_(D), D2_(D * D), half_(0.5 * D2_.trace()), det_(D.determinant()) {}
  double norm() const { return std::sqrt(2.0 * half_); }

  /// The sum of c(k) D^k from k = 0 on, until |c(k)| |D|^k is below rounding of |D|; c(k + 1) = c(k) next(k).
  template <class Next> Mat<3> sum(double c, const Next& next) const {
    Vec<3> power(1.0, 0.0, 0.0), total = Vec<3>::Zero();
    double size = 1.0;
    for (int k = 0; k < 40; ++k) {
      total += c * power;
      if (k > 1 && std::abs(c) * size < 1e-17 * norm()) break;
      c *= next(k);
      size *= norm();
      power = Vec<3>(det_ * power[2], power[0] + half_ * power[2], power[1]);
    }
    return total[0] * Mat<3>::Identity() + total[1] * D_ + total[2] * D2_;
  }

 private:
  Mat<3> D_, D2_;
  double half_, det_;
};

/// ln(I + A) of a symmetric A; false, and nothing is done, if the series is long: |dev A| beyond a tenth.
inline bool log_near_identity(const Mat<3>& A, Mat<3>& log) {
  const double mean = A.trace() / 3.0;
  if (!(mean > -0.9)) return false;
  const DeviatorSeries D((A - mean * Mat<3>::Identity()) / (1.0 + mean));
  if (!(D.norm() < 0.1)) return false;
  // D - D^2 / 2 + D^3 / 3 - ...: c(0) = 0 is taken for 1 and taken off again.
  log = D.sum(1.0, [](int k) { return k == 0 ? 1.0 : -k / (k + 1.0); });
  log.diagonal().array() += std::log1p(mean) - 1.0;
  return true;
}

}  // namespace efree::internal
