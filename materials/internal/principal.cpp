// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/internal/principal.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <cmath>

namespace efree::internal {
namespace {

/// (ln a - ln b) / (a - b).
double log_secant(double a, double b) {
  const double x = (a - b) / b;
  return (x == 0.0 ? 1.0 : std::log1p(x) / x) / b;
}

}  // namespace

PrincipalStress PrincipalStress::linear(const Vec<3>& strain, double kappa, double mu) {
  const double lambda = kappa - 2.0 / 3.0 * mu;
  PrincipalStress result{2.0 * mu * strain, Mat<3>::Constant(lambda), Mat<3>::Constant(2.0 * mu)};
  result.stress.array() += lambda * strain.sum();
  result.slope.diagonal().array() += 2.0 * mu;
  return result;
}

PrincipalFrame::PrincipalFrame(const Mat<3>& small_strain) : stretch_(Vec<3>::Ones()), finite_(false) {
  const auto [values, axes] = internal::spectrum<3>(small_strain);
  strain_ = values;
  current_ = reference_ = axes;
}

PrincipalFrame::PrincipalFrame(const Mat<3>& F, const Mat<3>& G) : finite_(true) {
  // By Green's strain, so that small strains keep their digits.
  const Mat<3> elastic = F * G, H = elastic - Mat<3>::Identity();
  const Mat<3> green = 0.5 * (H + H.transpose() + H.transpose() * H);
  const auto [values, axes] = internal::spectrum<3>(green);
  for (int a = 0; a < 3; ++a) strain_[a] = 0.5 * std::log1p(2.0 * values[a]);
  stretch_ = (1.0 + 2.0 * values.array()).sqrt();
  current_ = elastic * axes * stretch_.cwiseInverse().asDiagonal();
  reference_ = G * axes;
}

Mat<3> PrincipalFrame::stress(const Vec<3>& principal) const {
  return current_ * principal.cwiseQuotient(stretch_).asDiagonal() * reference_.transpose();
}

Mat<3> PrincipalFrame::tensor(const Vec<3>& values) const {
  return reference_ * values.asDiagonal() * reference_.transpose();
}

MaterialResponse::Tangent PrincipalFrame::tangent(const PrincipalStress& law) const {
  // By components current a, reference b: dP_aa of dF_bb, and of each pair a != b the matrix (direct, swapped;
  // swapped, direct) between (dP_ab, dP_ba) and (dF_ab, dF_ba).
  Mat<3> normal = law.slope;
  if (finite_) {
    normal.diagonal() -= law.stress;
    normal = stretch_.cwiseInverse().asDiagonal() * normal * stretch_.cwiseInverse().asDiagonal();
  }
  MaterialResponse::Tangent axes, along;
  for (int b = 0; b < 3; ++b)
    for (int a = 0; a < 3; ++a)
      for (int J = 0; J < 3; ++J) axes.block<3, 1>(3 * J, a + 3 * b) = reference_(J, b) * current_.col(a);
  for (int a = 0; a < 3; ++a) {
    along.col(4 * a) = axes.col(0) * normal(0, a) + axes.col(4) * normal(1, a) + axes.col(8) * normal(2, a);
    for (int b = 0; b < a; ++b) {
      double direct = 0.5 * law.secant(a, b), swapped = direct;
      if (finite_) {
        const double la = stretch_[a], lb = stretch_[b], ta = law.stress[a], tb = law.stress[b];
        const double of_difference = 0.5 * (law.secant(a, b) * log_secant(la, lb) * (la + lb) - ta - tb) / (la * lb);
        const double of_sum = (ta / la + tb / lb) / (la + lb);
        direct = 0.5 * (of_difference + of_sum);
        swapped = 0.5 * (of_difference - of_sum);
      }
      along.col(a + 3 * b) = direct * axes.col(a + 3 * b) + swapped * axes.col(b + 3 * a);
      along.col(b + 3 * a) = direct * axes.col(b + 3 * a) + swapped * axes.col(a + 3 * b);
    }
  }
  return along * axes.transpose();
}

Mat<3> symmetric(const Eigen::Ref<const Vec<6>>& c) {
  Mat<3> result;
  result << c[0], c[5], c[4], c[5], c[1], c[3], c[4], c[3], c[2];
  return result;
}

Vec<6> components(const Mat<3>& s) {
  return {s(0, 0), s(1, 1), s(2, 2), s(1, 2), s(0, 2), s(0, 1)};
}

}  // namespace efree::internal
