// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_grid.hpp"

#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <cstring>

namespace efree::internal {
namespace {

constexpr int W = CellGrid::lanes;
typedef float Floats __attribute__((vector_size(W * sizeof(float))));
typedef double Doubles __attribute__((vector_size(W * sizeof(double))));

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

/// f += K u for the layers [begin, end) of cells.
template <class T, class V>
[[gnu::always_inline]] inline void add_layers(const CellGrid& grid, const T* u, T* f, Index begin, Index end) {
  const T inverse_edges[3] = {T(grid.inverse_edges[0]), T(grid.inverse_edges[1]), T(grid.inverse_edges[2])};
  const std::size_t nodes = grid.nodes();
  for (Index k = begin; k < end; ++k)
    for (Index j = 0; j < grid.cells[1]; ++j)
      for (Index i = 0; i < grid.row; i += W) {
        const std::size_t block = grid.block(i, j, k);
        if (grid.empty[block]) continue;
        const float* weights = grid.stiffness.data() + block * 16 * W;
        std::size_t at[8];
        for (int a = 0; a < 8; ++a) at[a] = grid.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
        Slopes<V> g[3], s[3];
        for (int c = 0; c < 3; ++c) {
          V corner[8];
          for (int a = 0; a < 8; ++a) load(u + c * nodes + at[a], corner[a]);
          slopes_of(corner, inverse_edges, g[c]);
        }
#pragma GCC unroll 8
        for (int q = 0; q < 8; ++q) {
          const int yz = q >> 1, xz = (q & 1) + (q >> 2 << 1), xy = q & 3;
          V shear, across;
          load_weights(weights + q * W, shear);
          load_weights(weights + (q + 8) * W, across);
          const V twice = shear + shear, pressure = across * (g[0].x[yz] + g[1].y[xz] + g[2].z[xy]);
          const V xx = twice * g[0].x[yz] + pressure, yy = twice * g[1].y[xz] + pressure,
                  zz = twice * g[2].z[xy] + pressure;
          const V shear_xy = shear * (g[0].y[xz] + g[1].x[yz]), shear_xz = shear * (g[0].z[xy] + g[2].x[yz]),
                  shear_yz = shear * (g[1].z[xy] + g[2].y[xz]);
          const bool first_x = (q & 1) == 0, first_y = (q & 2) == 0, first_z = (q & 4) == 0;
          s[0].x[yz] = first_x ? xx : s[0].x[yz] + xx;
          s[1].x[yz] = first_x ? shear_xy : s[1].x[yz] + shear_xy;
          s[2].x[yz] = first_x ? shear_xz : s[2].x[yz] + shear_xz;
          s[0].y[xz] = first_y ? shear_xy : s[0].y[xz] + shear_xy;
          s[1].y[xz] = first_y ? yy : s[1].y[xz] + yy;
          s[2].y[xz] = first_y ? shear_yz : s[2].y[xz] + shear_yz;
          s[0].z[xy] = first_z ? shear_xz : s[0].z[xy] + shear_xz;
          s[1].z[xy] = first_z ? shear_yz : s[1].z[xy] + shear_yz;
          s[2].z[xy] = first_z ? zz : s[2].z[xy] + zz;
        }
        for (int c = 0; c < 3; ++c) {
          V corner[8];
          from_slopes(s[c], inverse_edges, corner);
          for (int a = 0; a < 8; ++a) add_to(f + c * nodes + at[a], corner[a]);
        }
      }
}

template <class T> using Layers = void (*)(const CellGrid&, const T*, T*, Index, Index);
template <class T, class V> void plain(const CellGrid& grid, const T* u, T* f, Index begin, Index end) {
  add_layers<T, V>(grid, u, f, begin, end);
}
#if defined(__x86_64__) && !defined(EFREE_SSE2_KERNELS)
template <class T, class V>
[[gnu::target("avx2,fma")]] void wide(const CellGrid& grid, const T* u, T* f, Index begin, Index end) {
  add_layers<T, V>(grid, u, f, begin, end);
}
#if !defined(EFREE_AVX2_KERNELS)
template <class T, class V> [[gnu::target("avx512f,avx512vl,avx512dq,fma")]] void wider(const CellGrid& grid,
                                                                                        const T* u, T* f, Index begin,
                                                                                        Index end) {
  add_layers<T, V>(grid, u, f, begin, end);  // twice the registers
}
#endif
template <class T, class V> Layers<T> kernel() {
#if !defined(EFREE_AVX2_KERNELS)
  if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq")) return wider<T, V>;
#endif
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return wide<T, V>;
  return plain<T, V>;
}
#else
template <class T, class V> Layers<T> kernel() {
  return plain<T, V>;
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

template <class T, class V> void product(const CellGrid& grid, const T* u, T* f) {
  static const Layers<T> add = kernel<T, V>();
  const std::size_t plane = grid.node(0, 0, 1), nodes = grid.nodes();
  for_layers(grid.cells, [&](Index begin, Index end, bool first) {
    // Planes of nodes that no chunk before has set to zero.
    const Index low = first ? begin : begin + 1, high = first || end == grid.cells[2] ? end + 1 : end;
    for (int c = 0; c < 3; ++c) std::fill(f + c * nodes + plane * low, f + c * nodes + plane * high, T(0));
    add(grid, u, f, begin, end);
  });
}

}  // namespace

CellGrid::CellGrid(const std::array<Index, 3>& cells_, const Vec<3>& edges_, const std::vector<float>& shear,
                   const std::vector<float>& across)
    : cells(cells_), edges(edges_), row((cells_[0] + lanes - 1) / lanes * lanes), pitch(row + lanes) {
  for (int d = 0; d < 3; ++d) inverse_edges[d] = 1.0 / edges[d];
  const std::size_t blocks = static_cast<std::size_t>(row / lanes) * cells[1] * cells[2];
  stiffness.assign(blocks * 16 * lanes, 0.0F);
  empty.assign(blocks, 1);
  const auto volume = static_cast<float>(edges.prod() / 8.0);
  const std::size_t along = 2 * static_cast<std::size_t>(cells[0]), plane = along * 2 * cells[1];
  parallel_chunks(cells[2], 1, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < cells[1]; ++j)
        for (Index i = 0; i < cells[0]; ++i) {
          float* to = stiffness.data() + block(i, j, k) * 16 * lanes + i % lanes;
          for (int q = 0; q < 8; ++q) {
            const std::size_t part =
                2 * static_cast<std::size_t>(i) + (q & 1) + along * (2 * j + (q >> 1 & 1)) + plane * (2 * k + (q >> 2));
            if (shear[part] == 0.0F) continue;
            to[q * lanes] = volume * shear[part];
            to[(q + 8) * lanes] = volume * across[part];
            empty[block(i, j, k)] = 0;
          }
        }
  });
}

void CellGrid::apply(const float* u, float* f) const {
  product<float, Floats>(*this, u, f);
}
void CellGrid::apply(const double* u, double* f) const {
  product<double, Doubles>(*this, u, f);
}

namespace {

/// Of parts of one material.
CellEigenvalues of_one_ratio(const Vec<3>& edges, float across_over_shear) {
  CellEigenvalues result{};
  for (int set = 1; set < 256; ++set) {
    std::vector<float> shear(8);
    for (int q = 0; q < 8; ++q) shear[q] = set >> q & 1 ? 1.0F : 0.0F;
    std::vector<float> across = shear;
    for (float& value : across) value *= across_over_shear;
    const CellGrid cell({1, 1, 1}, edges, shear, across);
    std::vector<double> u(cell.size(), 0.0), f(cell.size());
    const auto dof = [&](int a) {
      const int corner = a % 8;
      return a / 8 * cell.nodes() + cell.node(corner & 1, corner >> 1 & 1, corner >> 2);
    };
    Eigen::Matrix<double, 24, 24> K;
    for (int a = 0; a < 24; ++a) {
      u[dof(a)] = 1.0;
      cell.apply(u.data(), f.data());
      u[dof(a)] = 0.0;
      for (int b = 0; b < 24; ++b) K(b, a) = f[dof(b)];
    }
    const Eigen::Matrix<double, 24, 1> scale = K.diagonal().cwiseSqrt().cwiseInverse();
    const Matrix scaled = scale.asDiagonal() * K * scale.asDiagonal();
    result[set] = static_cast<float>(eigenvalues<Eigen::Dynamic>(scaled)[23]);
  }
  return result;
}

}  // namespace

CellEigenvalues largest_eigenvalues(const Vec<3>& edges, float least, float most) {
  CellEigenvalues eigenvalues = of_one_ratio(edges, least);
  if (most > 1.001F * least || most < 0.999F * least) {
    const CellEigenvalues other = of_one_ratio(edges, most);
    for (int set = 0; set < 256; ++set) eigenvalues[set] = std::max(eigenvalues[set], other[set]);
  }
  return eigenvalues;
}

std::vector<float> CellGrid::bound(const CellEigenvalues& eigenvalue) const {
  std::vector<float> result(size(), 0.0F);
  // Squared slopes of a corner's function at the eight points: (w_y w_z / h)^2, w = 3/4 on its side, 1/4 on the other.
  std::array<std::array<std::array<float, 3>, 8>, 8> squares;  // by corner, point, axis
  for (int a = 0; a < 8; ++a)
    for (int q = 0; q < 8; ++q)
      for (int d = 0; d < 3; ++d) {
        float slope = static_cast<float>(inverse_edges[d]);
        for (int e = 0; e < 3; ++e)
          if (e != d) slope *= (a >> e & 1) == (q >> e & 1) ? 0.75F : 0.25F;
        squares[a][q][d] = slope * slope;
      }
  std::array<float, 3> whole{};  // the same at every corner
  for (int q = 0; q < 8; ++q)
    for (int d = 0; d < 3; ++d) whole[d] += squares[0][q][d];
  constexpr float margin = 1.06F;  // materials of different nu in one cell need up to 1.04
  for_layers(cells, [&](Index begin, Index end, bool) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < cells[1]; ++j)
        for (Index i = 0; i < cells[0]; ++i) {
          if (empty[block(i, j, k)]) continue;
          std::array<float, 8> shear, factor{};
          std::array<int, 8> order{0, 1, 2, 3, 4, 5, 6, 7};
          for (int q = 0; q < 8; ++q) shear[q] = weight(i, j, k, q);
          const auto uniform = [&](int first) {
            for (int q = 1; q < 8; ++q)
              if (weight(i, j, k, first + q) != weight(i, j, k, first)) return false;
            return true;
          };
          if (uniform(0) && uniform(8)) {
            const float factor_of_all = margin * eigenvalue[255], across = weight(i, j, k, 8),
                        by_shear = shear[0] * (whole[0] + whole[1] + whole[2]);
            for (int a = 0; a < 8; ++a) {
              float* at = result.data() + node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
              for (int d = 0; d < 3; ++d)
                at[d * nodes()] += factor_of_all * ((across + shear[0]) * whole[d] + by_shear);
            }
            continue;
          }
          std::ranges::sort(order, [&](int a, int b) { return shear[a] > shear[b]; });
          // Weights fall from part to part: layers of sets of equal weight, one within the other.
          int set = 0;
          for (int r = 0; r < 8 && shear[order[r]] > 0.0F; ++r) {
            set |= 1 << order[r];
            const float layer = shear[order[r]] - (r < 7 ? shear[order[r + 1]] : 0.0F);
            for (int s = 0; s <= r; ++s) factor[order[s]] += margin * eigenvalue[set] * layer / shear[order[s]];
          }
          for (int a = 0; a < 8; ++a) {
            float* at = result.data() + node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
            for (int q = 0; q < 8; ++q) {
              if (shear[q] == 0.0F) continue;
              const auto& s = squares[a][q];
              const float across = weight(i, j, k, q + 8), by_shear = shear[q] * (s[0] + s[1] + s[2]);
              for (int d = 0; d < 3; ++d) at[d * nodes()] += factor[q] * ((across + shear[q]) * s[d] + by_shear);
            }
          }
        }
  });
  return result;
}

std::vector<float> halved(const std::vector<float>& parts, const std::array<Index, 3>& cells,
                          const std::array<int, 3>& ratio) {
  const std::size_t along = 2 * static_cast<std::size_t>(cells[0]), plane = along * 2 * cells[1];
  const std::array<Index, 3> out{2 * cells[0] / ratio[0], 2 * cells[1] / ratio[1], 2 * cells[2] / ratio[2]};
  const float share = 1.0F / static_cast<float>(ratio[0] * ratio[1] * ratio[2]);
  std::vector<float> means(static_cast<std::size_t>(out[0]) * out[1] * out[2]);
  parallel_chunks(out[2], 2, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < out[1]; ++j)
        for (Index i = 0; i < out[0]; ++i) {
          const float* from = parts.data() + ratio[0] * i + along * ratio[1] * j + plane * ratio[2] * k;
          float sum = 0.0F;
          for (int z = 0; z < ratio[2]; ++z)
            for (int y = 0; y < ratio[1]; ++y)
              for (int x = 0; x < ratio[0]; ++x) sum += from[x + along * y + plane * z];
          means[i + static_cast<std::size_t>(out[0]) * (j + static_cast<std::size_t>(out[1]) * k)] = share * sum;
        }
  });
  return means;
}

}  // namespace efree::internal
