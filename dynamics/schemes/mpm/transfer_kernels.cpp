// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/transfer_kernels.hpp"

#include "efree/dynamics/schemes/mpm/internal/spline.hpp"

namespace efree::internal {
namespace {

/// Splines around a point and the slot of the first node.
template <int Dim, int Degree> struct Stencil {
  SplineRow<Degree> axis[Dim];
  std::ptrdiff_t slot;
};

template <int Dim, int Degree>
EFREE_INLINE void find_stencil(const GridBox& box, const double* x, Stencil<Dim, Degree>& stencil) {
  stencil.slot = 0;
  for (int i = 0; i < Dim; ++i) {
    evaluate_spline<Degree>((x[i] - box.low[i]) / box.cell, stencil.axis[i]);
    stencil.slot += stencil.axis[i].first * (i + 1 < Dim ? box.stride[i] : 1);
  }
}

/// Calls visit(slot of the first node, weight, derivatives along the first axes) for every row of nodes along the last
/// axis; i and j are their numbers along the others.
template <int Dim, int Degree, class Visit>
EFREE_INLINE void for_each_row(const GridBox& box, const Stencil<Dim, Degree>& stencil, const Visit& visit) {
  if constexpr (Dim == 2) {
    for (int i = 0; i <= Degree; ++i) visit(stencil.slot + i * box.stride[0], i, 0);
  } else {
    for (int i = 0; i <= Degree; ++i)
      for (int j = 0; j <= Degree; ++j) visit(stencil.slot + i * box.stride[0] + j * box.stride[1], i, j);
  }
}

/// The slot of a node in the middle of those around the point.
template <int Dim, int Degree>
EFREE_INLINE std::ptrdiff_t middle_slot(const GridBox& box, const Stencil<Dim, Degree>& stencil) {
  return stencil.slot + (Degree + 1) / 2 * (Dim == 3 ? box.stride[0] + box.stride[1] + 1 : box.stride[0] + 1);
}

template <int Dim, int Degree> EFREE_INLINE void gather_of(Index points, const GridBox& box, const double* x,
                                                           const double* velocity, double* columns) {
  const double over_cell = 1.0 / box.cell;
  const double over_moment = over_cell / spline_moment(Degree);
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, x + Dim * p, at);
    const SplineRow<Degree>& last = at.axis[Dim - 1];
    Four value = {}, gradient[3] = {}, affine[3] = {};
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int i, int j) {
      Four sum = {}, slope = {}, moment = {};
      for (int k = 0; k <= Degree; ++k) {
        Four v;
        load(v, velocity + 4 * (slot + k));
        const Four part = last.N[k] * v;
        sum += part;
        slope += last.dN[k] * v;
        moment += last.d[k] * part;
      }
      const SplineRow<Degree>&X = at.axis[0], &Y = at.axis[Dim == 3 ? 1 : 0];
      const double Ny = Dim == 3 ? Y.N[j] : 1.0, N = X.N[i] * Ny;
      value += N * sum;
      gradient[0] += X.dN[i] * Ny * sum;
      gradient[Dim - 1] += N * slope;
      affine[0] += N * X.d[i] * sum;
      affine[Dim - 1] += N * moment;
      if constexpr (Dim == 3) {
        gradient[1] += X.N[i] * Y.dN[j] * sum;
        affine[1] += N * Y.d[j] * sum;
      }
    });
    double* column = columns + 4 * gathered_columns * p;
    store(column, value);
    for (int i = 0; i < 3; ++i) {
      gradient[i] *= over_cell;
      store(column + 4 * (1 + i), gradient[i]);
      if constexpr (Degree == 1)
        store(column + 4 * (4 + i), gradient[i]);
      else
        store(column + 4 * (4 + i), over_moment * affine[i]);
    }
  }
}

template <int Dim, int Degree> EFREE_INLINE void gather_values_of(Index points, const GridBox& box, const double* x,
                                                                  const double* velocity, double* values) {
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, x + Dim * p, at);
    Four value = {};
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int i, int j) {
      Four sum = {};
      for (int k = 0; k <= Degree; ++k) {
        Four v;
        load(v, velocity + 4 * (slot + k));
        sum += at.axis[Dim - 1].N[k] * v;
      }
      value += at.axis[0].N[i] * (Dim == 3 ? at.axis[Dim == 3 ? 1 : 0].N[j] : 1.0) * sum;
    });
    store(values + 4 * p, value);
  }
}

/// Polynomials 1, d and one of degree 2 along an axis, orthogonal by the values of the splines N. The norm of the last
/// depends on the position, down to zero where a node gets no value: it is of norm one, so that points keep the energy
/// while they move. spread: N times the value of mode m at node i; weight: of node i in the coefficient of mode m.
template <int Degree> struct AxisModes {
  static constexpr int count = Degree == 1 ? 2 : 3;
  double spread[count][Degree + 1], weight[count][Degree + 1];
};

template <int Degree> EFREE_INLINE void find_modes(const SplineRow<Degree>& row, AxisModes<Degree>& modes) {
  for (int i = 0; i <= Degree; ++i) {
    modes.spread[0][i] = modes.weight[0][i] = row.N[i];
    modes.spread[1][i] = row.N[i] * row.d[i];
    modes.weight[1][i] = Degree == 1 ? row.dN[i] : row.N[i] * row.d[i] / spline_moment(Degree);
  }
  if constexpr (Degree == 2) {
    // What is orthogonal to linear functions at three nodes is their second difference.
    const double norm = __builtin_sqrt(1.0 / row.N[0] + 4.0 / row.N[1] + 1.0 / row.N[2]);
    const double over_norm = norm < 1e150 ? 1.0 / norm : 0.0;
    for (int i = 0; i < 3; ++i) modes.spread[2][i] = modes.weight[2][i] = (i == 1 ? -2.0 : 1.0) * over_norm;
  } else if constexpr (Degree == 3) {
    const double second = spline_moment(Degree);
    double third = 0.0, square = 0.0, value[Degree + 1];
    for (int i = 0; i <= Degree; ++i) third += row.N[i] * row.d[i] * row.d[i] * row.d[i];
    for (int i = 0; i <= Degree; ++i) {
      value[i] = row.d[i] * row.d[i] - third / second * row.d[i] - second;
      square += row.N[i] * value[i] * value[i];
    }
    for (int i = 0; i <= Degree; ++i)
      modes.spread[2][i] = modes.weight[2][i] = row.N[i] * value[i] / __builtin_sqrt(square);
  }
}

template <int Dim, int Degree> EFREE_INLINE void gather_modes_of(Index points, const GridBox& box, const double* x,
                                                                 const double* velocity, double* modes) {
  constexpr int along = AxisModes<Degree>::count, count = num_modes(Dim, Degree);
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, x + Dim * p, at);
    AxisModes<Degree> of[Dim];
    for (int i = 0; i < Dim; ++i) find_modes(at.axis[i], of[i]);
    Four sums[count] = {};
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int i, int j) {
      for (int c = 0; c < along; ++c) {
        Four sum = {};
        for (int k = 0; k <= Degree; ++k) {
          Four v;
          load(v, velocity + 4 * (slot + k));
          sum += of[Dim - 1].weight[c][k] * v;
        }
        for (int a = 0; a < along; ++a) {
          if constexpr (Dim == 2) {
            sums[along * a + c] += of[0].weight[a][i] * sum;
          } else {
            for (int b = 0; b < along; ++b)
              sums[along * (along * a + b) + c] += of[0].weight[a][i] * of[1].weight[b][j] * sum;
          }
        }
      }
    });
    for (int m = 0; m < count; ++m) store(modes + 4 * (count * p + m), sums[m]);
  }
}

template <int Dim, int Degree, bool Moves, bool Affine, bool Stressed>
EFREE_INLINE void scatter_of(Index points, const GridBox& box, const ScatteredPoints& of, double* slots) {
  const double over_cell = 1.0 / box.cell;
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, of.x + Dim * p, at);
    const SplineRow<Degree>& last = at.axis[Dim - 1];
    Four momentum = {}, affine[Dim] = {}, stress[Dim] = {}, total = {}, forces = {};
    if constexpr (Moves) {
      const double m = of.mass[p];
      for (int i = 0; i < Dim; ++i) momentum[i] = m * of.v[Dim * p + i];
      momentum[3] = m;
      if constexpr (Affine)
        for (int j = 0; j < Dim; ++j)
          for (int i = 0; i < Dim; ++i) affine[j][i] = m * of.motion[Dim * (Dim * p + j) + i] * box.cell;
    }
    if constexpr (Stressed)
      for (int j = 0; j < Dim; ++j) {
        load(stress[j], of.stress + 16 * p + 4 * j);
        stress[j] = -of.volume[p] * stress[j] * over_cell;
      }
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int i, int j) {
      const SplineRow<Degree>&X = at.axis[0], &Y = at.axis[Dim == 3 ? 1 : 0];
      const double Ny = Dim == 3 ? Y.N[j] : 1.0, N = X.N[i] * Ny;
      Four mean = momentum, across = X.dN[i] * Ny * stress[0];
      if constexpr (Affine) mean += X.d[i] * affine[0];
      if constexpr (Dim == 3) {
        if constexpr (Affine) mean += Y.d[j] * affine[1];
        across += X.N[i] * Y.dN[j] * stress[1];
      }
      const Four along = N * stress[Dim - 1];
      for (int k = 0; k <= Degree; ++k) {
        double* to = slots + 8 * (slot + k);
        if constexpr (Moves) {
          Four l, part = mean;
          load(l, to);
          if constexpr (Affine) part += last.d[k] * affine[Dim - 1];
          part *= N * last.N[k];
          const Four now = l + part;
          total += now - l;
          store(to, now);
        }
        if constexpr (Stressed) {
          Four f;
          load(f, to + 4);
          const Four now = f + (last.N[k] * across + last.dN[k] * along);
          forces += now - f;
          store(to + 4, now);
        }
      }
    });
    // What the nodes did not get by rounding: over many steps all of it would be drift.
    double* middle = slots + 8 * middle_slot(box, at);
    Four l, f;
    load(l, middle);
    load(f, middle + 4);
    l += momentum - total;
    f -= forces;
    store(middle, l);
    store(middle + 4, f);
  }
}

template <int Dim, int Degree> EFREE_INLINE void scatter_modes_of(Index points, const GridBox& box, const double* x,
                                                                  const double* mass, const double* modes,
                                                                  double* slots) {
  constexpr int along = AxisModes<Degree>::count, count = num_modes(Dim, Degree);
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, x + Dim * p, at);
    AxisModes<Degree> of[Dim];
    for (int i = 0; i < Dim; ++i) find_modes(at.axis[i], of[i]);
    Four coefficient[count], total = {};
    for (int m = 0; m < count; ++m) load(coefficient[m], modes + 4 * (count * p + m));
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int i, int j) {
      Four along_last[along] = {};
      for (int a = 0; a < along; ++a)
        for (int b = 0; b < (Dim == 3 ? along : 1); ++b)
          for (int c = 0; c < along; ++c) {
            if constexpr (Dim == 2)
              along_last[c] += of[0].spread[a][i] * coefficient[along * a + c];
            else
              along_last[c] += of[0].spread[a][i] * of[1].spread[b][j] * coefficient[along * (along * a + b) + c];
          }
      for (int k = 0; k <= Degree; ++k) {
        Four v = {}, l;
        for (int c = 0; c < along; ++c) v += of[Dim - 1].spread[c][k] * along_last[c];
        double* to = slots + 8 * (slot + k);
        load(l, to);
        const Four now = l + mass[p] * v;
        total += now - l;
        store(to, now);
      }
    });
    double* middle = slots + 8 * middle_slot(box, at);
    Four l;
    load(l, middle);
    l -= total;
    store(middle, l);
  }
}

template <int Dim, int Degree> EFREE_INLINE void scatter_values_of(Index points, const GridBox& box, const double* x,
                                                                   const double* values, double* slots) {
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, x + Dim * p, at);
    Four value, total = {}, of;
    load(value, values + 4 * p);
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int i, int j) {
      const double N = at.axis[0].N[i] * (Dim == 3 ? at.axis[Dim == 3 ? 1 : 0].N[j] : 1.0);
      for (int k = 0; k <= Degree; ++k) {
        double* to = slots + 8 * (slot + k) + 4;
        load(of, to);
        const Four now = of + N * at.axis[Dim - 1].N[k] * value;
        total += now - of;
        store(to, now);
      }
    });
    double* middle = slots + 8 * middle_slot(box, at) + 4;
    load(of, middle);
    of += value - total;
    store(middle, of);
  }
}

template <int Dim, int Degree>
EFREE_INLINE void mark_slots_of(Index points, const GridBox& box, const double* x, char* marked) {
  for (Index p = 0; p < points; ++p) {
    Stencil<Dim, Degree> at;
    find_stencil(box, x + Dim * p, at);
    for_each_row<Dim, Degree>(box, at, [&](std::ptrdiff_t slot, int, int) {
      for (int k = 0; k <= Degree; ++k) marked[slot + k] = 1;
    });
  }
}

/// Calls body<Dim, Degree>() with those of the box.
template <class Body> EFREE_INLINE void with_degree(const GridBox& box, const Body& body) {
  switch (10 * box.dim + box.degree) {
    case 21:
      return body.template operator()<2, 1>();
    case 22:
      return body.template operator()<2, 2>();
    case 23:
      return body.template operator()<2, 3>();
    case 31:
      return body.template operator()<3, 1>();
    case 32:
      return body.template operator()<3, 2>();
    default:
      return body.template operator()<3, 3>();
  }
}

}  // namespace

EFREE_FOR_EACH_MACHINE void gather(Index points, const GridBox& box, const double* x, const double* velocity,
                                   double* columns) {
  with_degree(box, [&]<int Dim, int Degree>() { gather_of<Dim, Degree>(points, box, x, velocity, columns); });
}
EFREE_FOR_EACH_MACHINE void gather_values(Index points, const GridBox& box, const double* x, const double* velocity,
                                          double* values) {
  with_degree(box, [&]<int Dim, int Degree>() { gather_values_of<Dim, Degree>(points, box, x, velocity, values); });
}
EFREE_FOR_EACH_MACHINE void gather_modes(Index points, const GridBox& box, const double* x, const double* velocity,
                                         double* modes) {
  with_degree(box, [&]<int Dim, int Degree>() { gather_modes_of<Dim, Degree>(points, box, x, velocity, modes); });
}
EFREE_FOR_EACH_MACHINE void scatter(Index points, const GridBox& box, const ScatteredPoints& of, double* slots) {
  with_degree(box, [&]<int Dim, int Degree>() {
    if (of.mass == nullptr)
      scatter_of<Dim, Degree, false, false, true>(points, box, of, slots);
    else if (of.stress == nullptr)
      of.motion == nullptr ? scatter_of<Dim, Degree, true, false, false>(points, box, of, slots)
                           : scatter_of<Dim, Degree, true, true, false>(points, box, of, slots);
    else
      of.motion == nullptr ? scatter_of<Dim, Degree, true, false, true>(points, box, of, slots)
                           : scatter_of<Dim, Degree, true, true, true>(points, box, of, slots);
  });
}
EFREE_FOR_EACH_MACHINE void scatter_modes(Index points, const GridBox& box, const double* x, const double* mass,
                                          const double* modes, double* slots) {
  with_degree(box, [&]<int Dim, int Degree>() { scatter_modes_of<Dim, Degree>(points, box, x, mass, modes, slots); });
}
EFREE_FOR_EACH_MACHINE void scatter_values(Index points, const GridBox& box, const double* x, const double* values,
                                           double* slots) {
  with_degree(box, [&]<int Dim, int Degree>() { scatter_values_of<Dim, Degree>(points, box, x, values, slots); });
}
EFREE_FOR_EACH_MACHINE void mark_slots(Index points, const GridBox& box, const double* x, char* marked) {
  with_degree(box, [&]<int Dim, int Degree>() { mark_slots_of<Dim, Degree>(points, box, x, marked); });
}

}  // namespace efree::internal
