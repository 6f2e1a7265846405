// SPDX-License-Identifier: GPL-3.0-or-later
/// Products with matrices of cells, `lanes` cells at once: what kernels of elasticity and of conduction share.
#pragma once

#include "efree/core/parallel.hpp"
#include "efree/solvers/cells/internal/cell_grid.hpp"

#include <algorithm>
#include <cstring>
#include <type_traits>

namespace efree::internal::kernels {

inline constexpr int W = CellLayout::lanes;
typedef float Floats __attribute__((vector_size(W * sizeof(float))));
typedef float ManyFloats __attribute__((vector_size(2 * W * sizeof(float))));
typedef double Doubles __attribute__((vector_size(W * sizeof(double))));
/// What takes more cells at once where there are registers for it.
template <class V> struct Wider { using type = V; };
template <> struct Wider<Floats> { using type = ManyFloats; };

template <class T, class V> [[gnu::always_inline]] inline void load(const T* from, V& to) {
  std::memcpy(&to, from, sizeof to);
}
template <class T, class V> [[gnu::always_inline]] inline void add_to(T* at, const V& what) {
  V sum;
  load(at, sum);
  sum += what;
  std::memcpy(at, &sum, sizeof sum);
}
[[gnu::always_inline]] inline void load_weights(const float* from, Floats& to) {
  load(from, to);
}
[[gnu::always_inline]] inline void load_weights(const float* from, ManyFloats& to) {
  load(from, to);
}
[[gnu::always_inline]] inline void load_weights(const float* from, Doubles& to) {
  Floats single;
  load(from, single);
  to = __builtin_convertvector(single, Doubles);
}

/// Values a and b at the ends of an edge, at its quarters: a + (b - a) / 4 and b - (b - a) / 4. Its own transpose.
template <class V> [[gnu::always_inline]] inline void quarters(const V& a, const V& b, V& low, V& high) {
  const V step = (b - a) * 0.25F;
  low = a + step;
  high = b - step;
}
/// Derivatives along x do not depend on x in a cell, and so on: four values of each at its eight points.
template <class V> struct Slopes {
  V x[4], y[4], z[4];  // by y + 2 z, by x + 2 z, by x + 2 y
};

template <class V, class S>
[[gnu::always_inline]] inline void slopes_of(const V (&u)[8], const S* inverse_edges, Slopes<V>& out) {
  V low[4], high[4], d[4], a, b, c, e;
  for (int r = 0; r < 4; ++r) {
    d[r] = (u[2 * r + 1] - u[2 * r]) * inverse_edges[0];
    quarters(u[2 * r], u[2 * r + 1], low[r], high[r]);
  }
  quarters(d[0], d[1], a, b);
  quarters(d[2], d[3], c, e);
  quarters(a, c, out.x[0], out.x[2]);
  quarters(b, e, out.x[1], out.x[3]);
  quarters<V>((low[1] - low[0]) * inverse_edges[1], (low[3] - low[2]) * inverse_edges[1], out.y[0], out.y[2]);
  quarters<V>((high[1] - high[0]) * inverse_edges[1], (high[3] - high[2]) * inverse_edges[1], out.y[1], out.y[3]);
  quarters<V>((low[2] - low[0]) * inverse_edges[2], (low[3] - low[1]) * inverse_edges[2], out.z[0], out.z[2]);
  quarters<V>((high[2] - high[0]) * inverse_edges[2], (high[3] - high[1]) * inverse_edges[2], out.z[1], out.z[3]);
}

/// Transpose of slopes_of.
template <class V, class S>
[[gnu::always_inline]] inline void from_slopes(const Slopes<V>& in, const S* inverse_edges, V (&f)[8]) {
  V low[4], high[4], d[4], a, b, c, e;
  quarters(in.x[0], in.x[2], a, c);
  quarters(in.x[1], in.x[3], b, e);
  quarters(a, b, d[0], d[1]);
  quarters(c, e, d[2], d[3]);
  for (int r = 0; r < 4; ++r) d[r] *= inverse_edges[0];
  V p, q, s, t;
  quarters(in.y[0], in.y[2], p, q);
  quarters(in.z[0], in.z[2], s, t);
  p *= inverse_edges[1], q *= inverse_edges[1], s *= inverse_edges[2], t *= inverse_edges[2];
  low[0] = -p - s;
  low[1] = p - t;
  low[2] = s - q;
  low[3] = q + t;
  quarters(in.y[1], in.y[3], p, q);
  quarters(in.z[1], in.z[3], s, t);
  p *= inverse_edges[1], q *= inverse_edges[1], s *= inverse_edges[2], t *= inverse_edges[2];
  high[0] = -p - s;
  high[1] = p - t;
  high[2] = s - q;
  high[3] = q + t;
  for (int r = 0; r < 4; ++r) {
    quarters(low[r], high[r], f[2 * r], f[2 * r + 1]);
    f[2 * r] -= d[r];
    f[2 * r + 1] += d[r];
  }
}

/// Calls Add::cells<T, V>(grid, u, f, i, j, k) for the cells of the layers [begin, end) that are not empty, as many at
/// once as V holds, and for fewer at the end of a row.
template <class Add, class Grid, class T, class V>
[[gnu::always_inline]] inline void add_layers(const Grid& grid, const T* u, T* f, Index begin, Index end) {
  constexpr int at_once = sizeof(V) / sizeof(T), blocks = at_once / W;
  using Fewer = std::conditional_t<std::is_same_v<T, float>, Floats, Doubles>;
  for (Index k = begin; k < end; ++k)
    for (Index j = 0; j < grid.cells[1]; ++j) {
      Index i = 0;
      for (; i + at_once <= grid.row; i += at_once) {
        const std::size_t block = grid.block(i, j, k);
        if (grid.parts.is_empty(block) && grid.parts.is_empty(block + blocks - 1)) continue;
        Add::template cells<T, V>(grid, u, f, i, j, k);
      }
      if (i < grid.row && !grid.parts.is_empty(grid.block(i, j, k))) Add::template cells<T, Fewer>(grid, u, f, i, j, k);
    }
}

/// Adds the product to `f` for the layers [begin, end) of cells.
template <class Grid, class T> using Layers = void (*)(const Grid&, const T* u, T* f, Index begin, Index end);
template <class Add, class Grid, class T, class V>
void plain(const Grid& grid, const T* u, T* f, Index begin, Index end) {
  add_layers<Add, Grid, T, V>(grid, u, f, begin, end);
}
#if defined(__x86_64__) && !defined(EFREE_SSE2_KERNELS)
template <class Add, class Grid, class T, class V>
[[gnu::target("avx2,fma")]] void wide(const Grid& grid, const T* u, T* f, Index begin, Index end) {
  add_layers<Add, Grid, T, V>(grid, u, f, begin, end);
}
#if !defined(EFREE_AVX2_KERNELS)
template <class Add, class Grid, class T, class V>
[[gnu::target("avx512f,avx512vl,avx512dq,fma")]] void wider(const Grid& grid, const T* u, T* f, Index begin,
                                                            Index end) {
  add_layers<Add, Grid, T, typename Wider<V>::type>(grid, u, f, begin, end);
}
#endif
template <class Add, class Grid, class T, class V> Layers<Grid, T> kernel() {
#if !defined(EFREE_AVX2_KERNELS)
  if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq")) return wider<Add, Grid, T, V>;
#endif
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return wide<Add, Grid, T, V>;
  return plain<Add, Grid, T, V>;
}
#else
template <class Add, class Grid, class T, class V> Layers<Grid, T> kernel() {
  return plain<Add, Grid, T, V>;
}
#endif

/// Calls body(begin, end, first) for chunks of layers of cells: `first` concurrently for every other one, then for the
/// rest, as neighbours share nodes.
/// Small grids are one chunk.
template <class Body> void for_layers(const std::array<Index, 3>& cells, const Body& body) {
  const Index chunk = std::max(4, 16384 / (cells[0] * cells[1])), chunks = (cells[2] + chunk - 1) / chunk;
  for (Index parity = 0; parity < 2; ++parity)
    parallel_chunks((chunks + 1 - parity) / 2, 1, [&](Index begin, Index end) {
      for (Index c = begin; c < end; ++c) {
        const Index first = (2 * c + parity) * chunk;
        body(first, std::min(first + chunk, cells[2]), parity == 0);
      }
    });
}

/// f = K u for fields of so many components, by what `Add` adds for layers of cells, and then `more`, unless it is
/// null.
template <class Add, class T, class V, class Grid>
void product(const Grid& grid, int components, const T* u, T* f, Layers<Grid, T> more = nullptr) {
  static const Layers<Grid, T> add = kernel<Add, Grid, T, V>();
  const std::size_t plane = grid.node(0, 0, 1), nodes = grid.nodes();
  for_layers(grid.cells, [&](Index begin, Index end, bool first) {
    // Planes of nodes that no chunk before has set to zero.
    const Index low = first ? begin : begin + 1, high = first || end == grid.cells[2] ? end + 1 : end;
    for (int c = 0; c < components; ++c) std::fill(f + c * nodes + plane * low, f + c * nodes + plane * high, T(0));
    add(grid, u, f, begin, end);
    if (more) more(grid, u, f, begin, end);
  });
}

}  // namespace efree::internal::kernels
