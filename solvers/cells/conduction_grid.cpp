// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/conduction_grid.hpp"

#include "efree/core/internal/spectrum.hpp"
#include "efree/solvers/cells/internal/cell_kernels.hpp"

#include <algorithm>

namespace efree::internal {
namespace {

using namespace kernels;

/// f += K u for the cells from (i, j, k) on.
struct Conductive {
  template <class T, class V> [[gnu::always_inline]] static inline void cells(const ConductionGrid& grid, const T* u,
                                                                              T* f, Index i, Index j, Index k) {
    constexpr int at_once = sizeof(V) / sizeof(T);
    const T inverse_edges[3] = {T(grid.inverse_edges[0]), T(grid.inverse_edges[1]), T(grid.inverse_edges[2])};
    CellParts::Weights<at_once / W> weights;
    grid.parts.read(grid.block(i, j, k), weights);
    V weight[8], by_x[4], by_y[4], by_z[4];
    for (int q = 0; q < 8; ++q) load_weights(weights.shear + q * at_once, weight[q]);
    for (int p = 0; p < 4; ++p) {  // slopes along an axis are the same at two points
      by_x[p] = weight[2 * p] + weight[2 * p + 1];
      const int y = (p & 1) + (p >> 1 << 2);
      by_y[p] = weight[y] + weight[y + 2];
      by_z[p] = weight[p] + weight[p + 4];
    }
    std::size_t at[8];
    for (int a = 0; a < 8; ++a) at[a] = grid.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
    V corner[8];
    for (int a = 0; a < 8; ++a) load(u + at[a], corner[a]);
    Slopes<V> g;
    slopes_of(corner, inverse_edges, g);
    for (int p = 0; p < 4; ++p) {
      g.x[p] *= by_x[p];
      g.y[p] *= by_y[p];
      g.z[p] *= by_z[p];
    }
    from_slopes(g, inverse_edges, corner);
    for (int a = 0; a < 8; ++a) add_to(f + at[a], corner[a]);
  }
};

}  // namespace

ConductionGrid::ConductionGrid(const std::array<Index, 3>& cells_, const Vec<3>& edges_, const PartLayers& layers,
                               const std::vector<PartStiffness>& exact)
    : CellLayout(cells_, edges_), parts(*this, layers, exact) {}

void ConductionGrid::apply(const float* u, float* f) const {
  product<Conductive, float, Floats>(*this, 1, u, f);
}
void ConductionGrid::apply(const double* u, double* f) const {
  product<Conductive, double, Doubles>(*this, 1, u, f);
}

CellEigenvalues largest_conduction_eigenvalues(const Vec<3>& edges) {
  CellEigenvalues result{};
  for (int set = 1; set < 256; ++set) {
    if (const int like = mirrored(set); like < set) {
      result[set] = result[like];
      continue;
    }
    Parts parts{std::vector<float>(8), {}};
    for (int q = 0; q < 8; ++q) parts.shear[q] = set >> q & 1 ? 1.0F : 0.0F;
    const ConductionGrid cell({1, 1, 1}, edges, layers_of(parts, {1, 1, 1}));
    std::vector<double> u(cell.nodes(), 0.0), f(cell.nodes());
    const auto node = [&](int a) { return cell.node(a & 1, a >> 1 & 1, a >> 2); };
    Matrix K(8, 8);
    for (int a = 0; a < 8; ++a) {
      u[node(a)] = 1.0;
      cell.apply(u.data(), f.data());
      u[node(a)] = 0.0;
      for (int b = 0; b < 8; ++b) K(b, a) = f[node(b)];
    }
    const Vector scale = K.diagonal().cwiseSqrt().cwiseInverse();
    result[set] =
        static_cast<float>(eigenvalues<Eigen::Dynamic>(Matrix(scale.asDiagonal() * K * scale.asDiagonal()))[7]);
  }
  return result;
}

std::vector<float> ConductionGrid::bound(const CellEigenvalues& eigenvalue) const {
  std::vector<float> result(nodes(), 0.0F);
  std::array<std::array<float, 8>, 8> squares{};  // squared gradient of a corner's function at each point
  for (int a = 0; a < 8; ++a)
    for (int q = 0; q < 8; ++q)
      for (int d = 0; d < 3; ++d) {
        float slope = static_cast<float>(inverse_edges[d]);
        for (int e = 0; e < 3; ++e)
          if (e != d) slope *= (a >> e & 1) == (q >> e & 1) ? 0.75F : 0.25F;
        squares[a][q] += slope * slope;
      }
  constexpr float margin = 1.0001F;  // for rounding
  for_layers(cells, [&](Index begin, Index end, bool) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < cells[1]; ++j)
        for (Index i = 0; i < cells[0]; ++i) {
          if (parts.is_empty(block(i, j, k))) continue;
          std::array<float, 8> own, factor{};
          std::array<int, 8> order{0, 1, 2, 3, 4, 5, 6, 7};
          for (int q = 0; q < 8; ++q) own[q] = parts.weight(block(i, j, k), i % lanes, q).shear;
          if (std::ranges::all_of(own, [&](float w) { return w == own[0]; })) {
            factor.fill(margin * eigenvalue[255]);
          } else {
            // Weights fall from part to part: layers of sets of equal weight, one within the other.
            std::ranges::sort(order, [&](int a, int b) { return own[a] > own[b]; });
            int set = 0;
            for (int r = 0; r < 8 && own[order[r]] > 0.0F; ++r) {
              set |= 1 << order[r];
              const float layer = own[order[r]] - (r < 7 ? own[order[r + 1]] : 0.0F);
              for (int s = 0; s <= r; ++s) factor[order[s]] += margin * eigenvalue[set] * layer / own[order[s]];
            }
          }
          for (int a = 0; a < 8; ++a) {
            float& at = result[node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2))];
            for (int q = 0; q < 8; ++q) at += factor[q] * own[q] * squares[a][q];
          }
        }
  });
  return result;
}

}  // namespace efree::internal
