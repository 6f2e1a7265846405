// SPDX-License-Identifier: GPL-3.0-or-later
/// From trial strains back to a yield surface: what plastic materials share.
#pragma once

#include "efree/core/error.hpp"
#include "efree/materials/internal/eight_metals.hpp"
#include "efree/materials/internal/finite_deformation.hpp"
#include "efree/materials/internal/principal.hpp"
#include "efree/materials/moduli.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace efree::internal {

/// What a return mapping makes of principal trial strains.
struct Returned {
  PrincipalStress law;      ///< stress, and its derivatives by trial strains
  Vec<3> elastic;           ///< strains that are left
  double equivalent = 0.0;  ///< plastic strain afterwards
  double dissipated = 0.0;
  bool plastic = false;
  std::optional<ElasticConstants> constants{};  ///< from now on, where they have changed
};

/// Nothing happens.
inline Returned still_elastic(const Vec<3>& trial, double equivalent, const ElasticConstants& elastic) {
  return {PrincipalStress::linear(trial, elastic.kappa, elastic.mu), trial, equivalent};
}

/// x in [low, high] where f(x) = (value, derivative) passes from positive to not positive, to rounding of the numbers
/// of size `scale` that the value is the difference of: Newton's method from `x`, halving where it leaves the bracket
/// or two steps do not halve one, as with derivatives that are differences over too much. The last f asked for is that
/// of what is returned. Throws NumericalError for a NaN.
template <class F> double root(const F& f, double low, double high, double scale, double x) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  double last = std::numeric_limits<double>::infinity(), one_before = last;  // steps
  for (int k = 0; k < 200; ++k) {
    const auto [value, slope] = f(x);
    if (std::isnan(value)) break;
    (value > 0.0 ? low : high) = x;
    const double newton = x - value / slope;
    if (std::abs(value) <= 4.0 * epsilon * scale || high - low <= epsilon * std::abs(high)) return x;
    // At a slope without bounds, as of Ludwik's law where nothing has flown, Newton's method stands still.
    const bool is_good = newton > low && newton <= high && std::abs(newton - x) < 0.5 * one_before;
    const double next = is_good ? newton : 0.5 * (low + high);
    one_before = std::exchange(last, std::abs(next - x));
    x = next;
  }
  throw NumericalError("no stress on the yield surface is found");
}

/// From `low`.
template <class F> double root(const F& f, double low, double high, double scale) {
  return root(f, low, high, scale, low);
}

/// Minus the slope of such a function. Throws NumericalError unless positive: the surface runs away from the stress.
inline double resistance(double slope) {
  if (!(slope < 0.0)) throw NumericalError("the material softens faster than its stress can follow");
  return -slope;
}

/// A direction of strain on which isotropic laws of tr(eps) and |dev(eps)| are written: eps = theta / 3 + e n.
struct Meridian {
  explicit Meridian(const Vec<3>& strain) : theta(strain.sum()), n(strain.array() - theta / 3.0), e(n.norm()) {
    if (e > 0.0) n /= e;
  }
  double theta;
  Vec<3> n;  ///< a unit deviator, or zero
  double e;

  /// The stress p + s n, with the derivatives of (p, s) by (theta, e).
  PrincipalStress stress(double p, double s, const Mat<2>& slope) const {
    const double secant = e > 0.0 ? s / e : 0.0;
    const Vec<3> one = Vec<3>::Ones();
    return {p * one + s * n,
            (slope(0, 0) - secant / 3.0) * one * one.transpose() + slope(0, 1) * one * n.transpose() +
                slope(1, 0) * n * one.transpose() + (slope(1, 1) - secant) * n * n.transpose() +
                secant * Mat<3>::Identity(),
            Mat<3>::Constant(secant)};
  }
};

/// kappa / 2 tr(eps)^2 + mu |dev(eps)|^2 of principal strains.
inline double elastic_energy(const Vec<3>& strain, const ElasticConstants& elastic) {
  return 0.5 * PrincipalStress::linear(strain, elastic.kappa, elastic.mu).stress.dot(strain);
}

/// Deformations and histories of points begin .. begin + count, eight at the most; the last again where there are
/// fewer.
inline void take_points(const Deformation& given, Index begin, int count, EightMetals& points) {
  for (int l = 0; l < 8; ++l) {
    const Index p = begin + std::min(l, count - 1);
    const double *F = given.F.col(p).data(), *history = given.history.col(p).data();
    for (int k = 0; k < 9; ++k) points.F[k][l] = F[k];
    for (int k = 0; k < 6; ++k) points.metric[k][l] = history[k];
  }
}

/// Answers for a point by `returned(principal trial strains, ascending; equivalent plastic strain; constants; X)`. At
/// small strains with a back stress of 2/3 `kinematic` eps_p (Prager 1956).
template <class Return> void respond_by_return(Index p, const ElasticModuli& moduli, Strain strain, double kinematic,
                                               const Deformation& given, MaterialResponse& response,
                                               const Return& returned) {
  const Vec<3> X = given.X.col(p);
  const ElasticConstants elastic = moduli.at(X);
  const Mat<3> before = symmetric(given.history.col(p).template head<6>());
  const bool finite = strain == Strain::finite;
  Mat<3> back = Mat<3>::Zero();
  const PrincipalFrame frame = [&] {
    if (finite) {
      const FiniteDeformation at(given, p);
      return PrincipalFrame(
          at.F, before.isZero(0.0) ? Mat<3>::Identity() : Mat<3>((Mat<3>::Identity() + before).llt().matrixL()));
    }
    const Mat<3> H = given.gradient(p) - Mat<3>::Identity();
    back = 2.0 / 3.0 * kinematic * before;
    // The back stress only shifts the elastic strain from which the return starts.
    return PrincipalFrame(Mat<3>(0.5 * (H + H.transpose()) - before - back / (2.0 * elastic.mu)));
  }();
  if (!frame.strain().allFinite()) throw NumericalError("strains that are no numbers " + place(X));
  Returned answer;
  try {
    answer = returned(frame.strain(), given.history(6, p), elastic, X);
  } catch (const NumericalError& error) {
    throw NumericalError(error.what() + (" " + place(X)));
  }
  response.stress(p) = frame.stress(answer.law.stress) + back;
  response.dissipated[p] = answer.dissipated;
  response.history.col(p) = given.history.col(p);
  Mat<3> after = before;
  if (answer.plastic) {
    const Vec<3> flow = frame.strain() - answer.elastic;
    after = finite ? Mat<3>(frame.tensor((-2.0 * flow).array().exp().matrix()) - Mat<3>::Identity())
                   : Mat<3>(before + frame.tensor(flow));
    response.history.col(p).template head<7>() << components(after), answer.equivalent;
  }
  response.energy[p] = elastic_energy(answer.elastic, answer.constants.value_or(elastic));
  if (kinematic != 0.0) {
    // The elastic strain is what the return left, and the shift.
    const Mat<3> H = given.gradient(p) - Mat<3>::Identity();
    const Mat<3> left = 0.5 * (H + H.transpose()) - after;
    response.energy[p] = 0.5 * elastic.lambda * left.trace() * left.trace() + elastic.mu * left.squaredNorm() +
                         kinematic / 3.0 * after.squaredNorm();
  }
  if (response.tangent) response.tangent_at(p) = frame.tangent(answer.law);
}

/// For all of them.
template <class Return> void respond_by_return(const ElasticModuli& moduli, Strain strain, double kinematic,
                                               const Deformation& given, MaterialResponse& response,
                                               const Return& returned) {
  for (Index p = 0; p < given.size(); ++p) respond_by_return(p, moduli, strain, kinematic, given, response, returned);
}

/// Answers for all points eight at a time, near_identity(begin, count, moduli of all or none), at finite strains
/// without tangents; else one by one, in_axes(p). Histories of the response are those given, to start with.
template <class InAxes, class NearIdentity>
void respond_in_eights(const ElasticModuli& moduli, Strain strain, const Deformation& given, MaterialResponse& response,
                       const InAxes& in_axes, const NearIdentity& near_identity) {
  const Index n = given.size();
  if (strain == Strain::small || response.tangent) {
    for (Index p = 0; p < n; ++p) in_axes(p);
    return;
  }
  std::optional<ElasticConstants> alike;
  if (n > 0 && moduli.is_constant()) alike = moduli.at(given.X.col(0));
  response.history = given.history;
  for (Index p = 0; p < n; p += 8) near_identity(p, static_cast<int>(std::min<Index>(8, n - p)), alike);
}

}  // namespace efree::internal
