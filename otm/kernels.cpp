// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/internal/vectors.hpp"
#include "efree/otm/internal/chunk.hpp"

namespace efree::internal {
namespace {

/// Columns of a 3 x 3 matrix, with a zero below.
EFREE_INLINE void columns_of(const Mat<3>& M, Four* column) {
  for (int j = 0; j < 3; ++j) column[j] = Four{M.data()[3 * j], M.data()[3 * j + 1], M.data()[3 * j + 2], 0.0};
}
EFREE_INLINE void cross(const Four& a, const Four& b, Four& result) {
  result = Four{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0], 0.0};
}
/// Of the matrix with these columns: those of its cofactors, M^-T times the determinant, which is returned.
EFREE_INLINE double cofactors_of(const Four* M, Four* cofactor) {
  cross(M[1], M[2], cofactor[0]);
  cross(M[2], M[0], cofactor[1]);
  cross(M[0], M[1], cofactor[2]);
  return M[0][0] * cofactor[0][0] + M[0][1] * cofactor[0][1] + M[0][2] * cofactor[0][2];
}

template <int Dim> EFREE_INLINE void tractions(Index points, const double* volume, const Mat<3>* since,
                                               const Mat<3>* moved, const Mat<Dim>* moment, const Vec<Dim>* at,
                                               const double* penalty, double* columns) {
  for (Index p = 0; p < points; ++p) {
    Four tau[3], S[3], cofactor[3], result[4] = {};
    for (int j = 0; j < 3; ++j) load(tau[j], columns + 16 * p + 4 * j);
    columns_of(since[p], S);
    const double factor = -volume[p] / cofactors_of(S, cofactor);
    for (int j = 0; j < 3; ++j)
      result[j] = factor * (tau[0] * cofactor[j][0] + tau[1] * cofactor[j][1] + tau[2] * cofactor[j][2]);
    columns_of(moved[p], S);
    for (int j = 0; j < Dim; ++j)
      for (int k = 0; k < Dim; ++k) result[j] += penalty[p] * moment[p].data()[k + Dim * j] * S[k];
    for (int i = 0; i < Dim; ++i) result[3][i] = penalty[p] * at[p].data()[i];
    if constexpr (Dim == 2) {
      for (int j = 0; j < 2; ++j) result[j][2] = 0.0;
      result[2] = Four{result[2][2], 0.0, 0.0, 0.0};  // along the hoop
    }
    for (int j = 0; j < 4; ++j) store(columns + 16 * p + 4 * j, result[j]);
  }
}

}  // namespace

EFREE_FOR_EACH_MACHINE void otm_kinematics(Index points, const Mat<3>* since, const double* made, double* columns) {
  for (Index p = 0; p < points; ++p) {
    const double *S = since[p].data(), *m = made + 9 * p;
    double *F = columns + 16 * p, square = 0.0;  // of S^T S - I
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) F[i + 4 * j] = S[i] * m[3 * j] + S[i + 3] * m[3 * j + 1] + S[i + 6] * m[3 * j + 2];
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k <= j; ++k) {
        const double product = S[3 * j] * S[3 * k] + S[3 * j + 1] * S[3 * k + 1] + S[3 * j + 2] * S[3 * k + 2];
        const double entry = j == k ? product - 1.0 : product;
        square += (j == k ? 1.0 : 2.0) * entry * entry;
      }
    F[3] =
        F[0] * (F[5] * F[10] - F[9] * F[6]) + F[4] * (F[9] * F[2] - F[1] * F[10]) + F[8] * (F[1] * F[6] - F[5] * F[2]);
    F[7] = 0.5 * __builtin_sqrt(square);
  }
}

EFREE_FOR_EACH_MACHINE void otm_kirchhoff(Index points, const double* P, const double* F, const double* shock,
                                          double* columns) {
  for (Index p = 0; p < points; ++p) {
    const double *f = F + 9 * p, *stress = P + 9 * p;
    Four column[3], tau[3];
    for (int k = 0; k < 3; ++k) column[k] = Four{stress[3 * k], stress[3 * k + 1], stress[3 * k + 2], 0.0};
    for (int j = 0; j < 3; ++j) {
      tau[j] = column[0] * f[j] + column[1] * f[j + 3] + column[2] * f[j + 6];
      tau[j][j] -= shock[p];
      store(columns + 16 * p + 4 * j, tau[j]);
    }
  }
}

EFREE_FOR_EACH_MACHINE void otm_rates(Index points, const Mat<3>* moved, const Mat<3>* since, double* columns) {
  for (Index p = 0; p < points; ++p) {
    Four S[3], M[3], cofactor[3];
    columns_of(since[p], S);
    columns_of(moved[p], M);
    const double over = 1.0 / cofactors_of(S, cofactor);
    for (int j = 0; j < 3; ++j) {
      const Four rate = over * (M[0] * cofactor[0][j] + M[1] * cofactor[1][j] + M[2] * cofactor[2][j]);
      store(columns + 16 * p + 4 * j, rate);
    }
  }
}

EFREE_FOR_EACH_MACHINE void otm_stiffness(Index points, const double* tangent, const double* factor, double* columns) {
  for (Index p = 0; p < points; ++p) {
    double* H = columns + 16 * p;
    Four stress[3] = {};
    for (int J = 0; J < 3; ++J)
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) {
          Four of;
          load(of, tangent + 12 * (i + 3 * J) + 4 * k);
          stress[k] += H[i + 4 * J] * of;
        }
    for (int k = 0; k < 3; ++k) store(H + 4 * k, factor[p] * stress[k]);
  }
}

EFREE_FOR_EACH_MACHINE void otm_tractions(Index points, const double* volume, const Mat<3>* since, const Mat<3>* moved,
                                          const Mat<2>* moment, const Vec<2>* at, const double* penalty,
                                          double* columns) {
  tractions<2>(points, volume, since, moved, moment, at, penalty, columns);
}
EFREE_FOR_EACH_MACHINE void otm_tractions(Index points, const double* volume, const Mat<3>* since, const Mat<3>* moved,
                                          const Mat<3>* moment, const Vec<3>* at, const double* penalty,
                                          double* columns) {
  tractions<3>(points, volume, since, moved, moment, at, penalty, columns);
}

EFREE_FOR_EACH_MACHINE void otm_deform(Index points, const Index* offsets, const std::uint16_t* local,
                                       const OtmEntry* entries, const double* x, double* rows) {
  static_assert(sizeof(OtmEntry) == sizeof(Four));
  for (Index p = 0; p < points; ++p) {
    Four sums[6] = {};
    const Index end = offsets[p + 1];
    Index e = offsets[p];
    // Two nodes at a time: sums that wait for each other are slow.
    for (; e + 1 < end; e += 2) {
      Four a, b;
      load(a, entries[e].dN);
      load(b, entries[e + 1].dN);
      const double *xa = x + 4 * local[e], *xb = x + 4 * local[e + 1];
      for (int i = 0; i < 3; ++i) {
        sums[i] += xa[i] * a;
        sums[3 + i] += xb[i] * b;
      }
    }
    if (e < end) {
      Four a;
      load(a, entries[e].dN);
      const double* xa = x + 4 * local[e];
      for (int i = 0; i < 3; ++i) sums[i] += xa[i] * a;
    }
    for (int i = 0; i < 3; ++i) store(rows + 16 * p + 4 * i, sums[i] + sums[3 + i]);
  }
}

EFREE_FOR_EACH_MACHINE void otm_push(Index points, const Index* offsets, const std::uint16_t* local,
                                     const OtmEntry* entries, const double* x, const double* columns,
                                     const double* penalty, bool around_axis, double* force) {
  for (Index p = 0; p < points; ++p) {
    Four column[4];
    for (int J = 0; J < 4; ++J) load(column[J], columns + 16 * p + 4 * J);
    if (offsets[p] == offsets[p + 1]) continue;
    Four sum = {}, f;
    for (Index e = offsets[p]; e < offsets[p + 1]; ++e) {
      const OtmEntry& a = entries[e];
      Four xa;
      load(f, force + 4 * local[e]);
      load(xa, x + 4 * local[e]);
      const Four more =
          a.dN[0] * column[0] + a.dN[1] * column[1] + a.dN[2] * column[2] + a.N * (column[3] - penalty[p] * xa);
      sum += more;
      f += more;
      store(force + 4 * local[e], f);
    }
    // But for rounding the sum is nothing, and to momentum all of it is drift.
    if (around_axis) sum[0] = 0.0;
    double* first = force + 4 * local[offsets[p]];
    load(f, first);
    f -= sum;
    store(first, f);
  }
}

}  // namespace efree::internal
