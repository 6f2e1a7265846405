// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/kernels.hpp"
#include "efree/core/internal/vectors.hpp"

namespace efree::internal {
namespace {

/// Columns of a 3 x 3 matrix, with a zero below.
EFREE_INLINE void columns_of(const double* M, Four* column) {
  for (int j = 0; j < 3; ++j) column[j] = Four{M[3 * j], M[3 * j + 1], M[3 * j + 2], 0.0};
}
EFREE_INLINE void columns_of(const Mat<3>& M, Four* column) {
  columns_of(M.data(), column);
}
/// A 3 x 3 matrix of the first three rows of these columns.
EFREE_INLINE void put_columns(const Four* column, double* to) {
  store(to, column[0]);
  store(to + 3, column[1]);
  for (int i = 0; i < 3; ++i) to[6 + i] = column[2][i];
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

/// A tangent, by the three columns of each of its nine, times what has these columns.
EFREE_INLINE void apply(const Four* tangent, const Four* to, Four* result) {
  for (int k = 0; k < 3; ++k) result[k] = Four{};
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) result[k] += to[j][i] * tangent[3 * (i + 3 * j) + k];
}
/// Of a matrix by its columns, with zeros below.
EFREE_INLINE double norm(const Four* column) {
  const Four square = column[0] * column[0] + column[1] * column[1] + column[2] * column[2];
  return __builtin_sqrt(square[0] + square[1] + square[2]);
}

template <int Dim> EFREE_INLINE void tractions(Index points, const double* volume, const Mat<3>* F_since,
                                               const Mat<3>* moved, const Mat<Dim>* moment, const double* stabilisation,
                                               double* columns) {
  for (Index p = 0; p < points; ++p) {
    Four tau[3], at, S[3], cofactor[3], result[4] = {};
    for (int j = 0; j < 3; ++j) load(tau[j], columns + 16 * p + 4 * j);
    load(at, columns + 16 * p + 12);
    columns_of(F_since[p], S);
    const double factor = -volume[p] / cofactors_of(S, cofactor);
    for (int j = 0; j < 3; ++j)
      result[j] = factor * (tau[0] * cofactor[j][0] + tau[1] * cofactor[j][1] + tau[2] * cofactor[j][2]);
    columns_of(moved[p], S);
    for (int j = 0; j < Dim; ++j)
      for (int k = 0; k < Dim; ++k) result[j] += stabilisation[p] * moment[p].data()[k + Dim * j] * S[k];
    result[3] = stabilisation[p] * at;
    if constexpr (Dim == 2) {
      for (int j = 0; j < 2; ++j) result[j][2] = 0.0;
      result[2] = Four{result[2][2], 0.0, 0.0, 0.0};  // along the hoop
    }
    for (int j = 0; j < 4; ++j) store(columns + 16 * p + 4 * j, result[j]);
  }
}

}  // namespace

EFREE_FOR_EACH_MACHINE StrainBounds update_deformation(Index points, PlaneKind plane, double least,
                                                       const double* volume, const double* F_table, Mat<3>* F_since,
                                                       double* F, double* J, double* columns) {
  StrainBounds most;
  double smallest = 1.0;
  for (Index p = 0; p < points; ++p) {
    if (volume[p] == 0.0) continue;
    double* column = columns + 16 * p;
    Four row[3], then[3], S[3], now[3], B[3], cofactor[3], square = {};
    for (int i = 0; i < 3; ++i) load(row[i], column + 4 * i);
    if (plane == PlaneKind::none) {
      for (int j = 0; j < 3; ++j) S[j] = Four{row[0][j], row[1][j], row[2][j], 0.0};
    } else {
      for (int j = 0; j < 2; ++j) S[j] = Four{row[0][j], row[1][j], 0.0, 0.0};
      S[2] = Four{0.0, 0.0, plane == PlaneKind::axisymmetric ? row[0][2] : 1.0, 0.0};
    }
    columns_of(F_since[p], then);
    const double det_then = cofactors_of(then, cofactor), det_now = cofactors_of(S, cofactor);
    const double* m = F_table + 9 * p;
    for (int j = 0; j < 3; ++j) now[j] = S[0] * m[3 * j] + S[1] * m[3 * j + 1] + S[2] * m[3 * j + 2];
    // S S^T - I, which is as large as S^T S - I.
    for (int j = 0; j < 3; ++j) {
      B[j] = S[0] * S[0][j] + S[1] * S[1][j] + S[2] * S[2][j];
      B[j][j] -= 1.0;
      square += B[j] * B[j];
    }
    const double det = cofactors_of(now, cofactor);
    put_columns(S, F_since[p].data());
    J[p] = det;
    put_columns(then, column);
    const double strain = column[9] = 0.5 * __builtin_sqrt(square[0] + square[1] + square[2]);
    const double left = column[10] = det_now / det_then;
    if (det > 0.0 && left > least)
      put_columns(now, F + 9 * p);
    else
      most.regular = false;
    most.since_table = strain > most.since_table ? strain : most.since_table;
    smallest = left < smallest ? left : smallest;
  }
  most.shrinkage = 1.0 / smallest;
  return most;
}

EFREE_FOR_EACH_MACHINE void apply_patch_dilatation(Index points, const double* J, const double* volume, double* F) {
  for (Index begin = 0; begin < points; begin += 8) {
    const Index count = points - begin < 8 ? points - begin : 8;
    Eight of, root;
    for (int k = 0; k < 8; ++k) of[k] = k < count && volume[begin + k] > 0.0 ? J[begin + k] : 1.0;
    // A third of the logarithm, nearly, is a third of the bits; then Newton's method, four digits for two.
    EightIntegers bits;
    std::memcpy(&bits, &of, sizeof bits);
    bits = 0x553ef0ff289dd796 - __builtin_convertvector(__builtin_convertvector(bits, Eight) / 3.0, EightIntegers);
    std::memcpy(&root, &bits, sizeof root);
    for (int k = 0; k < 5; ++k) root *= 4.0 / 3.0 - of * (root * root * root) / 3.0;
    for (Index k = 0; k < count; ++k)
      for (int i = 0; i < 9; ++i) F[9 * (begin + k) + i] *= root[k];
  }
}

EFREE_FOR_EACH_MACHINE void kirchhoff_stresses(Index points, const double* P, const double* F, const double* shock,
                                               double* columns) {
  for (Index p = 0; p < points; ++p) {
    const double* f = F + 9 * p;
    Four column[3], tau[3];
    columns_of(P + 9 * p, column);
    for (int j = 0; j < 3; ++j) {
      tau[j] = column[0] * f[j] + column[1] * f[j + 3] + column[2] * f[j + 6];
      tau[j][j] -= shock[p];
      store(columns + 16 * p + 4 * j, tau[j]);
    }
  }
}

EFREE_FOR_EACH_MACHINE void spatial_gradients(Index points, const Mat<3>* moved, const Mat<3>* F_since,
                                              double* columns) {
  for (Index p = 0; p < points; ++p) {
    Four S[3], M[3], cofactor[3];
    columns_of(F_since[p], S);
    columns_of(moved[p], M);
    const double over = 1.0 / cofactors_of(S, cofactor);
    for (int j = 0; j < 3; ++j) {
      const Four rate = over * (M[0] * cofactor[0][j] + M[1] * cofactor[1][j] + M[2] * cofactor[2][j]);
      store(columns + 16 * p + 4 * j, rate);
    }
  }
}

EFREE_FOR_EACH_MACHINE double work_of_last_motion(Index points, const double* volume, const Mat<3>* F_since,
                                                  const double* columns) {
  double sum = 0.0;
  for (Index p = 0; p < points; ++p) {
    Four S[3], cofactor[3];
    columns_of(F_since[p], S);
    const double over = 1.0 / cofactors_of(S, cofactor);
    double work = 0.0;
    for (int j = 0; j < 3; ++j) {
      Four tau;
      load(tau, columns + 16 * p + 4 * j);
      for (int i = 0; i < 3; ++i) work += tau[i] * ((i == j ? 1.0 : 0.0) - over * cofactor[j][i]);
    }
    sum += volume[p] > 0.0 ? volume[p] * work : 0.0;
  }
  return sum;
}

EFREE_FOR_EACH_MACHINE void apply_tangent(Index points, const double* tangent, const double* factor, double* columns) {
  Four stiff[27], H[3], stress[3];
  for (int k = 0; k < 27; ++k) load(stiff[k], tangent + 4 * k);
  for (Index p = 0; p < points; ++p) {
    for (int k = 0; k < 3; ++k) load(H[k], columns + 16 * p + 4 * k);
    apply(stiff, H, stress);
    for (int k = 0; k < 3; ++k) store(columns + 16 * p + 4 * k, factor[p] * stress[k]);
  }
}

EFREE_FOR_EACH_MACHINE void stiffness_ratios(Index points, const double* tangents, const double* F,
                                             const double* compliance, double* ratio, double* modulus) {
  Four soft[27], stiff[27];
  for (int k = 0; k < 27; ++k) load(soft[k], compliance + 4 * k);
  for (Index p = 0; p < points; ++p) {
    const double* f = F + 9 * p;
    for (int k = 0; k < 9; ++k) columns_of(tangents + 81 * p + 9 * k, stiff + 3 * k);
    Four H[3] = {{1.0, 0.3, -0.2, 0.0}, {0.25, 0.9, 0.15, 0.0}, {-0.1, 0.2, 1.1, 0.0}};
    double most = 1.0, size = norm(H);
    for (int k = 0; k < 6; ++k) {
      // A change of F by H F does the work of P : H F.
      Four change[3], stress[3], pushed[3];
      for (int j = 0; j < 3; ++j) change[j] = H[0] * f[3 * j] + H[1] * f[3 * j + 1] + H[2] * f[3 * j + 2];
      apply(stiff, change, stress);
      for (int j = 0; j < 3; ++j) pushed[j] = stress[0] * f[j] + stress[1] * f[j + 3] + stress[2] * f[j + 6];
      apply(soft, pushed, H);
      const double next = norm(H);
      most = next / size;
      for (Four& column : H) column /= next;
      size = 1.0;
    }
    ratio[p] = most > 1.0 && __builtin_isfinite(most) ? most : 1.0;
    double highest = 0.0;
    for (int i = 0; i < 3; ++i) {
      double along = 0.0;
      for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k) along += f[i + 3 * j] * stiff[3 * (i + 3 * j) + k][i] * f[i + 3 * k];
      highest = along > highest ? along : highest;
    }
    if (highest > 0.0 && __builtin_isfinite(highest)) modulus[p] = highest;
  }
}

EFREE_FOR_EACH_MACHINE void force_columns(Index points, const double* volume, const Mat<3>* F_since,
                                          const Mat<3>* moved, const Mat<2>* moment, const double* stabilisation,
                                          double* columns) {
  tractions<2>(points, volume, F_since, moved, moment, stabilisation, columns);
}
EFREE_FOR_EACH_MACHINE void force_columns(Index points, const double* volume, const Mat<3>* F_since,
                                          const Mat<3>* moved, const Mat<3>* moment, const double* stabilisation,
                                          double* columns) {
  tractions<3>(points, volume, F_since, moved, moment, stabilisation, columns);
}

EFREE_FOR_EACH_MACHINE void interpolate_gradients(Index points, const Index* offsets, const std::uint16_t* local,
                                                  const TableEntry* entries, const double* x, double* columns) {
  static_assert(sizeof(TableEntry) == sizeof(Four));
  constexpr Index ahead = 192;  // entries: machines fetch ahead by themselves, but to the end of a page
  for (Index p = 0; p < points; ++p) {
    Four sums[6] = {};
    const Index end = offsets[p + 1];
    Index e = offsets[p];
    // Two nodes at a time: sums that wait for each other are slow.
    for (; e + 1 < end; e += 2) {
      __builtin_prefetch(entries + e + ahead);
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
    double* rows = columns + 16 * p;
    for (int i = 0; i < 3; ++i) store(rows + 4 * i, sums[i] + sums[3 + i]);
    store(rows + 12, Four{rows[3], rows[7], rows[11], 0.0});
  }
}

EFREE_FOR_EACH_MACHINE void scatter_forces(Index points, const Index* offsets, const std::uint16_t* local,
                                           const TableEntry* entries, const double* x, const double* columns,
                                           const double* stabilisation, bool axisymmetric, double* force) {
  for (Index p = 0; p < points; ++p) {
    Four column[4];
    for (int J = 0; J < 4; ++J) load(column[J], columns + 16 * p + 4 * J);
    if (offsets[p] == offsets[p + 1]) continue;
    const double spring = stabilisation[p];
    Four sums[2] = {}, f;
    const auto add = [&](Index e, Four& sum) {
      const TableEntry& a = entries[e];
      double* of = force + 4 * local[e];
      Four xa;
      load(f, of);
      load(xa, x + 4 * local[e]);
      const Four more =
          (a.dN[0] * column[0] + a.dN[1] * column[1]) + (a.dN[2] * column[2] + a.N * (column[3] - spring * xa));
      sum += more;
      f += more;
      store(of, f);
    };
    // Sums that wait for each other are slow.
    const Index end = offsets[p + 1];
    Index e = offsets[p];
    for (; e + 1 < end; e += 2) {
      add(e, sums[0]);
      add(e + 1, sums[1]);
    }
    if (e < end) add(e, sums[0]);
    Four sum = sums[0] + sums[1];
    // But for rounding the sum is nothing, and to momentum all of it is drift.
    if (axisymmetric) sum[0] = 0.0;
    double* first = force + 4 * local[offsets[p]];
    load(f, first);
    f -= sum;
    store(first, f);
  }
}

EFREE_FOR_EACH_MACHINE void weight_changes(Index points, const Index* offsets, const std::uint16_t* local,
                                           const TableEntry* entries, const double* x, const double* at,
                                           const Mat<3>* inverse, const double* volume, bool axisymmetric,
                                           const double* multipliers, double* changes, Mat<3>* moment) {
  for (Index p = 0; p < points; ++p) {
    Four place, column[3], gradient[3] = {}, first = {}, second[3] = {};
    load(place, at + 4 * p);
    columns_of(inverse[p], column);
    const Index begin = offsets[p], end = offsets[p + 1];
    for (Index e = begin; e < end; ++e) {
      Four of;
      load(of, multipliers + 4 * local[e]);
      for (int j = 0; j < 3; ++j) gradient[j] += entries[e].dN[j] * of;
    }
    if (axisymmetric)
      for (Four& by : gradient) by[2] = 0.0;
    double zeroth = 0.0;
    for (Index e = begin; e < end; ++e) {
      Four of, d;
      load(of, multipliers + 4 * local[e]);
      load(d, x + 4 * local[e]);
      d -= place;
      of -= d[0] * gradient[0] + d[1] * gradient[1] + d[2] * gradient[2];
      const double* dN = entries[e].dN;
      changes[e] = volume[p] * (dN[0] * of[0] + dN[1] * of[1] + dN[2] * of[2]);
      zeroth += changes[e];
      first += changes[e] * d;
    }
    const Four tilt = first[0] * column[0] + first[1] * column[1] + first[2] * column[2];
    for (Index e = begin; e < end; ++e) {
      Four d;
      load(d, x + 4 * local[e]);
      d -= place;
      changes[e] -= entries[e].N * (zeroth + d[0] * tilt[0] + d[1] * tilt[1] + d[2] * tilt[2]);
      const Four more = changes[e] * d;
      for (int j = 0; j < 3; ++j) second[j] += d[j] * more;
    }
    put_columns(second, moment[p].data());
  }
}

EFREE_FOR_EACH_MACHINE void gradient_changes(Index points, const Index* offsets, const std::uint16_t* local,
                                             const TableEntry* entries, const double* x, const double* at,
                                             const Mat<3>* inverse, const double* volume, bool axisymmetric,
                                             const double* changes, const Mat<3>* moment, double* sums) {
  for (Index p = 0; p < points; ++p) {
    Four place, column[3], of[3], turn[3];
    load(place, at + 4 * p);
    columns_of(inverse[p], column);
    columns_of(moment[p], of);
    for (int j = 0; j < 3; ++j)
      turn[j] = volume[p] * (of[j][0] * column[0] + of[j][1] * column[1] + of[j][2] * column[2]);
    for (Four& by : column) by *= volume[p];
    for (Index e = offsets[p]; e < offsets[p + 1]; ++e) {
      Four d, sum;
      load(d, x + 4 * local[e]);
      d = changes[e] * (d - place);
      const double* dN = entries[e].dN;
      load(sum, sums + 4 * local[e]);
      sum += (d[0] * column[0] + d[1] * column[1] + d[2] * column[2]) -
             (dN[0] * turn[0] + dN[1] * turn[1] + dN[2] * turn[2]);
      if (axisymmetric) sum[0] += volume[p] * changes[e] / place[0];
      store(sums + 4 * local[e], sum);
    }
  }
}

}  // namespace efree::internal
