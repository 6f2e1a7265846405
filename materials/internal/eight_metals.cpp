// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/internal/eight_metals.hpp"

#include <array>

namespace efree::internal {
namespace {

/// Component (i, j) of a symmetric tensor.
constexpr int place[3][3] = {{0, 5, 4}, {5, 1, 3}, {4, 3, 2}};
constexpr int row[6] = {0, 1, 2, 1, 0, 0}, column[6] = {0, 1, 2, 2, 2, 1};

/// S T of symmetric tensors with the same axes.
EFREE_INLINE void times(const Eight* S, const Eight* T, Eight* product) {
  for (int k = 0; k < 6; ++k) {
    const int i = row[k], j = column[k];
    product[k] = S[place[i][0]] * T[place[0][j]] + S[place[i][1]] * T[place[1][j]] + S[place[i][2]] * T[place[2][j]];
  }
}

/// A S A^T of a symmetric S.
EFREE_INLINE void congruent(const Eight* A, const Eight* S, Eight* result) {
  Eight AS[9];
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i)
      AS[i + 3 * j] = A[i] * S[place[0][j]] + A[i + 3] * S[place[1][j]] + A[i + 6] * S[place[2][j]];
  for (int k = 0; k < 6; ++k) {
    const int i = row[k], j = column[k];
    result[k] = AS[i] * A[j] + AS[i + 3] * A[j + 3] + AS[i + 6] * A[j + 6];
  }
}

EFREE_INLINE void determinant(const Eight* S, Eight& result) {
  result = S[0] * (S[1] * S[2] - S[3] * S[3]) - S[5] * (S[5] * S[2] - S[3] * S[4]) + S[4] * (S[5] * S[3] - S[1] * S[4]);
}

/// The sum of c[k] D^k, of a symmetric D without trace, is c[0] I + c[1] D + c[2] D^2, as D^3 = |D|^2 / 2 D + det(D) I
/// (Cayley & Hamilton): the sum from its highest power down.
template <std::size_t N>
EFREE_INLINE void series(const std::array<double, N>& c, const Eight& half, const Eight& det, Eight* sum) {
  sum[0] = sum[1] = sum[2] = half - half;
  for (std::size_t k = N; k-- > 0;) {
    // D (s0 + s1 D + s2 D^2) + c
    const Eight s2 = sum[2];
    sum[2] = sum[1];
    sum[1] = sum[0] + half * s2;
    sum[0] = det * s2 + c[k];
  }
}

/// As far as it takes where |D| < 0.1: ln(I + D).
constexpr auto logarithm = [] {
  std::array<double, 17> c{};
  for (int k = 1; k < 17; ++k) c[k] = (k % 2 == 1 ? 1.0 : -1.0) / k;
  return c;
}();
/// exp(D), |D| < 0.2.
constexpr auto exponential = [] {
  std::array<double, 13> c{1.0};
  for (int k = 1; k < 13; ++k) c[k] = c[k - 1] / k;
  return c;
}();

/// ln(1 + m), |m| < 0.2: 2 artanh(m / (2 + m)).
EFREE_INLINE void logarithm_of_one_plus(const Eight& m, Eight& result) {
  const Eight z = m / (2.0 + m), z2 = z * z;
  Eight sum = z2 / 21.0 + 1.0 / 19.0;
  for (int k = 17; k > 0; k -= 2) sum = sum * z2 + 1.0 / k;
  result = 2.0 * z * sum;
}

}  // namespace

EFREE_FOR_EACH_MACHINE void try_elastic(EightMetals& points) {
  const Eight* F = points.F;
  Eight* inverse = points.inverse;
  inverse[0] = F[4] * F[8] - F[7] * F[5];
  inverse[1] = F[7] * F[2] - F[1] * F[8];
  inverse[2] = F[1] * F[5] - F[4] * F[2];
  inverse[3] = F[6] * F[5] - F[3] * F[8];
  inverse[4] = F[0] * F[8] - F[6] * F[2];
  inverse[5] = F[3] * F[2] - F[0] * F[5];
  inverse[6] = F[3] * F[7] - F[6] * F[4];
  inverse[7] = F[6] * F[1] - F[0] * F[7];
  inverse[8] = F[0] * F[4] - F[3] * F[1];
  const Eight J = F[0] * inverse[0] + F[3] * inverse[1] + F[6] * inverse[2], over = 1.0 / J;
  for (int k = 0; k < 9; ++k) inverse[k] *= over;

  // b_e less one, so that small strains keep their digits.
  Eight A[6], H[9];
  for (int k = 0; k < 9; ++k) H[k] = F[k];
  for (const int k : {0, 4, 8}) H[k] -= 1.0;
  congruent(F, points.metric, A);
  for (int k = 0; k < 6; ++k) {
    const int i = row[k], j = column[k];
    A[k] += H[i + 3 * j] + H[j + 3 * i] + H[i] * H[j] + H[i + 3] * H[j + 3] + H[i + 6] * H[j + 6];
    points.left[k] = i == j ? A[k] + 1.0 : A[k];
  }
  const Eight mean = (A[0] + A[1] + A[2]) * (1.0 / 3.0), scale = 1.0 / (1.0 + mean);
  Eight D[6], D2[6];
  for (int k = 0; k < 6; ++k) D[k] = (k < 3 ? A[k] - mean : A[k]) * scale;
  times(D, D, D2);
  const Eight half = 0.5 * (D2[0] + D2[1] + D2[2]);
  Eight det;
  determinant(D, det);
  Eight sum[3];
  series(logarithm, half, det, sum);
  Eight growth;
  logarithm_of_one_plus(mean, growth);
  points.theta = 1.5 * (growth + sum[0]) + sum[2] * half;
  Eight square = half - half;
  for (int k = 0; k < 6; ++k) {
    points.deviator[k] = 0.5 * (sum[1] * D[k] + sum[2] * (k < 3 ? D2[k] - half * (2.0 / 3.0) : D2[k]));
    square += (k < 3 ? 1.0 : 2.0) * points.deviator[k] * points.deviator[k];
  }
  for (int l = 0; l < 8; ++l) points.e[l] = __builtin_sqrt(square[l]);
  // What is no number fails every comparison.
  for (int l = 0; l < 8; ++l)
    points.near[l] = J[l] > 0.0 && mean[l] > -0.2 && mean[l] < 0.2 && half[l] < 0.005 ? 1.0 : 0.0;
}

EFREE_FOR_EACH_MACHINE void flow_back(EightMetals& points, bool flows) {
  Eight tau[6];
  for (int k = 0; k < 6; ++k) {
    tau[k] = points.shear * points.deviator[k];
    if (k < 3) tau[k] += points.pressure;
  }
  const Eight* inverse = points.inverse;
  for (int J = 0; J < 3; ++J)
    for (int i = 0; i < 3; ++i)
      points.P[i + 3 * J] =
          tau[place[i][0]] * inverse[J] + tau[place[i][1]] * inverse[J + 3] + tau[place[i][2]] * inverse[J + 6];

  if (!flows) return;
  Eight flow[6], squared[6], lost[6], left[6], sum[3];
  const Eight along = -2.0 * points.length / (points.e + (points.e == 0.0 ? 1.0 : 0.0));
  for (int k = 0; k < 6; ++k) flow[k] = along * points.deviator[k];
  times(flow, flow, squared);
  Eight det;
  determinant(flow, det);
  series(exponential, 0.5 * (squared[0] + squared[1] + squared[2]), det, sum);
  for (int k = 0; k < 6; ++k) {
    lost[k] = sum[1] * flow[k] + sum[2] * squared[k];
    if (k < 3) lost[k] += sum[0];
  }
  times(points.left, lost, left);
  for (int k = 0; k < 6; ++k) left[k] *= points.contraction;
  congruent(inverse, left, points.metric);
  for (int k = 0; k < 3; ++k) points.metric[k] -= 1.0;
}

}  // namespace efree::internal
