// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_grid.hpp"

#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/cells/internal/cell_kernels.hpp"

#include <algorithm>
#include <limits>

namespace efree::internal {
namespace {

using namespace kernels;

/// f += K u for the cells from (i, j, k) on.
template <Dilatation Of> struct Elastic {
  template <class T, class V>
  [[gnu::always_inline]] static inline void cells(const CellGrid& grid, const T* u, T* f, Index i, Index j, Index k) {
    constexpr int at_once = sizeof(V) / sizeof(T);
    const T inverse_edges[3] = {T(grid.inverse_edges[0]), T(grid.inverse_edges[1]), T(grid.inverse_edges[2])};
    const std::size_t nodes = grid.nodes();
    CellParts::Weights<at_once / W> weights;
    grid.parts.read(grid.block(i, j, k), weights);
    std::size_t at[8];
    for (int a = 0; a < 8; ++a) at[a] = grid.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
    Slopes<V> g[3], s[3];
    for (int c = 0; c < 3; ++c) {
      V corner[8];
      for (int a = 0; a < 8; ++a) load(u + c * nodes + at[a], corner[a]);
      slopes_of(corner, inverse_edges, g[c]);
    }
    V mean{};
    if constexpr (Of == Dilatation::mean) {
      V sum{}, all{};
      for (int q = 0; q < 8; ++q) {
        V across;
        load_weights(weights.across + q * at_once, across);
        sum += across * (g[0].x[q >> 1] + g[1].y[(q & 1) + (q >> 2 << 1)] + g[2].z[q & 3]);
        all += across;
      }
      mean = sum / (all + std::numeric_limits<T>::min());
    }
#pragma GCC unroll 8
    for (int q = 0; q < 8; ++q) {
      const int yz = q >> 1, xz = (q & 1) + (q >> 2 << 1), xy = q & 3;
      V shear, across;
      load_weights(weights.shear + q * at_once, shear);
      load_weights(weights.across + q * at_once, across);
      const V twice = shear + shear,
              pressure = across * (Of == Dilatation::mean ? mean : g[0].x[yz] + g[1].y[xz] + g[2].z[xy]);
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
};

}  // namespace

CellGrid::CellGrid(const std::array<Index, 3>& cells_, const Vec<3>& edges_, const PartLayers& layers,
                   const std::vector<PartStiffness>& exact, const std::vector<VoigtMatrix<3>>& anisotropic)
    : CellLayout(cells_, edges_),
      anisotropy(*this, anisotropic),
      parts(
          *this, [&](Index begin, Index end) { return anisotropy.take_shares(*this, layers, begin, end); }, exact) {}

Parts CellGrid::layers(Index begin, Index end) const {
  const PartOrder order(cells);
  Parts result;
  result.shear.resize(order(0, 0, end - begin, 0));
  result.across.resize(result.shear.size());
  parallel_chunks(end - begin, 1, [&](Index first, Index last) {
    for (Index k = first; k < last; ++k)
      for (Index j = 0; j < cells[1]; ++j)
        for (Index i = 0; i < cells[0]; ++i)
          for (int q = 0; q < 8; ++q) {
            const PartStiffness& of = moduli(i, j, begin + k, q);
            result.shear[order(i, j, k, q)] = of.shear;
            result.across[order(i, j, k, q)] = of.across;
          }
  });
  result.shares = anisotropy.shares(*this, begin, end);
  return result;
}

namespace {

template <class T, class V>
void multiply_elastic(const CellGrid& grid, const T* u, T* f, Dilatation dilatation, AddAnisotropy<T> anisotropic) {
  if (dilatation == Dilatation::mean)
    product<Elastic<Dilatation::mean>, T, V>(grid, 3, u, f, anisotropic);
  else
    product<Elastic<Dilatation::local>, T, V>(grid, 3, u, f, anisotropic);
}

}  // namespace

void CellGrid::apply(const float* u, float* f, Dilatation dilatation) const {
  multiply_elastic<float, Floats>(*this, u, f, dilatation, anisotropy.empty() ? nullptr : add_anisotropy<float>());
}
void CellGrid::apply(const double* u, double* f, Dilatation dilatation) const {
  multiply_elastic<double, Doubles>(*this, u, f, dilatation, anisotropy.empty() ? nullptr : add_anisotropy<double>());
}
void CellGrid::apply_isotropic(const float* u, float* f, Dilatation dilatation) const {
  multiply_elastic<float, Floats>(*this, u, f, dilatation, nullptr);
}
void CellGrid::apply_isotropic(const double* u, double* f, Dilatation dilatation) const {
  multiply_elastic<double, Doubles>(*this, u, f, dilatation, nullptr);
}

namespace {

/// Of parts of one material.
CellEigenvalues of_one_ratio(const Vec<3>& edges, float across_over_shear) {
  CellEigenvalues result{};
  for (int set = 1; set < 256; ++set) {
    if (const int like = mirrored(set); like < set) {
      result[set] = result[like];
      continue;
    }
    Parts parts{std::vector<float>(8), std::vector<float>(8)};
    for (int q = 0; q < 8; ++q) {
      parts.shear[q] = set >> q & 1 ? 1.0F : 0.0F;
      parts.across[q] = across_over_shear * parts.shear[q];
    }
    const CellGrid cell({1, 1, 1}, edges, layers_of(parts, {1, 1, 1}));
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

int mirrored(int set) {
  int least = set;
  for (int mirror = 1; mirror < 8; ++mirror) {  // bit d: along axis d
    int image = 0;
    for (int q = 0; q < 8; ++q) image |= (set >> q & 1) << (q ^ mirror);
    least = std::min(least, image);
  }
  return least;
}

CellEigenvalues largest_eigenvalues(const Vec<3>& edges, const std::array<float, 2>& ratios) {
  const auto [least, most] = ratios;
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
          if (parts.is_empty(block(i, j, k))) continue;
          std::array<float, 8> shear, across, factor{};
          std::array<int, 8> order{0, 1, 2, 3, 4, 5, 6, 7};
          bool uniform = true;
          for (int q = 0; q < 8; ++q) {
            const PartStiffness& of = weight(i, j, k, q);
            shear[q] = of.shear;
            across[q] = of.across;
            uniform = uniform && shear[q] == shear[0] && across[q] == across[0];
          }
          if (uniform) {
            const float factor_of_all = margin * eigenvalue[255],
                        by_shear = shear[0] * (whole[0] + whole[1] + whole[2]);
            for (int a = 0; a < 8; ++a) {
              float* at = result.data() + node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
              for (int d = 0; d < 3; ++d)
                at[d * nodes()] += factor_of_all * ((across[0] + shear[0]) * whole[d] + by_shear);
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
              const float by_shear = shear[q] * (s[0] + s[1] + s[2]);
              for (int d = 0; d < 3; ++d) at[d * nodes()] += factor[q] * ((across[q] + shear[q]) * s[d] + by_shear);
            }
          }
        }
  });
  return result;
}

}  // namespace efree::internal
