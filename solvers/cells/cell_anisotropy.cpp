// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_anisotropy.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/solvers/cells/internal/cell_kernels.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

namespace efree::internal {
namespace {

using namespace kernels;

/// f += K u of the anisotropic parts, for the cells from (i, j, k) on.
struct Anisotropic {
  template <class T, class V>
  [[gnu::always_inline]] static inline void cells(const CellGrid& grid, const T* u, T* f, Index i, Index j, Index k) {
    using Lanes = std::conditional_t<std::is_same_v<T, float>, Floats, Doubles>;
    for (Index first = i; first < i + static_cast<Index>(sizeof(V) / sizeof(T)); first += W) {
      const auto shares = grid.anisotropy.in_block(grid.block(first, j, k));
      if (!shares.empty()) add_block<T, Lanes>(grid, shares, u, f, first, j, k);
    }
  }

 private:
  template <class T, class V>
  [[gnu::always_inline]] static inline void add_block(const CellGrid& grid,
                                                      std::span<const CellAnisotropy::Share> shares, const T* u, T* f,
                                                      Index i, Index j, Index k) {
    const T inverse_edges[3] = {T(grid.inverse_edges[0]), T(grid.inverse_edges[1]), T(grid.inverse_edges[2])};
    const std::size_t nodes = grid.nodes();
    std::size_t at[8];
    for (int a = 0; a < 8; ++a) at[a] = grid.node(i + (a & 1), j + (a >> 1 & 1), k + (a >> 2));
    Slopes<V> g[3], s[3]{};
    for (int c = 0; c < 3; ++c) {
      V corner[8];
      for (int a = 0; a < 8; ++a) load(u + c * nodes + at[a], corner[a]);
      slopes_of(corner, inverse_edges, g[c]);
    }
    for (const CellAnisotropy::Share& share : shares) {
      const T* C = grid.anisotropy.weight<T>(share.material);
#pragma GCC unroll 8
      for (int q = 0; q < 8; ++q) {
        const int yz = q >> 1, xz = (q & 1) + (q >> 2 << 1), xy = q & 3;
        V strain[6] = {g[0].x[yz],
                       g[1].y[xz],
                       g[2].z[xy],
                       g[1].z[xy] + g[2].y[xz],
                       g[0].z[xy] + g[2].x[yz],
                       g[0].y[xz] + g[1].x[yz]};
        if (share.begin != CellAnisotropy::whole) {
          V part;
          load_weights(grid.anisotropy.of_part(share, q), part);
          for (V& e : strain) e *= part;
        }
        V stress[6];
        for (int r = 0; r < 6; ++r) {
          stress[r] = C[6 * r] * strain[0];
          for (int c = 1; c < 6; ++c) stress[r] += C[6 * r + c] * strain[c];
        }
        s[0].x[yz] += stress[0];
        s[1].x[yz] += stress[5];
        s[2].x[yz] += stress[4];
        s[0].y[xz] += stress[5];
        s[1].y[xz] += stress[1];
        s[2].y[xz] += stress[3];
        s[0].z[xy] += stress[4];
        s[1].z[xy] += stress[3];
        s[2].z[xy] += stress[2];
      }
    }
    for (int c = 0; c < 3; ++c) {
      V corner[8];
      from_slopes(s[c], inverse_edges, corner);
      for (int a = 0; a < 8; ++a) add_to(f + c * nodes + at[a], corner[a]);
    }
  }
};

/// The smallest and largest quotient of e . C e and e . C_iso e, for C_xyxy = 1.
std::array<double, 2> quotients(const VoigtMatrix<3>& C, double ratio) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<VoigtMatrix<3>> solver(C, IsotropicStiffness{1.0, ratio}.matrix(),
                                                                        Eigen::EigenvaluesOnly | Eigen::Ax_lBx);
  return {solver.eigenvalues()[0], solver.eigenvalues()[5]};
}

}  // namespace

VoigtMatrix<3> IsotropicStiffness::matrix() const {
  VoigtMatrix<3> C = VoigtMatrix<3>::Zero();
  C.topLeftCorner<3, 3>().setConstant(across);
  for (int d = 0; d < 3; ++d) {
    C(d, d) += 2.0 * shear;
    C(3 + d, 3 + d) = shear;
  }
  return C;
}

IsotropicStiffness isotropic_part(const VoigtMatrix<3>& C, bool nearly_incompressible) {
  constexpr double ratio_of_most = 1000.0, ratio_of_others = 4.0;  // nu = 0.4995 and 0.4
  const auto spread = [&](double t) {
    const auto [least, most] = quotients(C, std::expm1(t));
    return most / least;
  };
  // Quotients for two strains are linear-fractional in the ratio, so that the largest is quasi-convex: golden sections.
  constexpr double golden = 0.6180339887498949, rounding = 1e-9;
  double low = 0.0, high = std::log1p(nearly_incompressible ? ratio_of_most : ratio_of_others);
  while (high - low > 1e-13) {
    const double a = high - golden * (high - low), b = low + golden * (high - low), of_a = spread(a), of_b = spread(b);
    if (nearly_incompressible ? of_a < (1.0 - rounding) * of_b : of_a <= (1.0 + rounding) * of_b)
      high = b;
    else
      low = a;
  }
  const double ratio = std::expm1(0.5 * (low + high)), shear = quotients(C, ratio)[0];
  return {shear, ratio * shear};
}

VoigtMatrix<3> rotate_to_axes(const VoigtMatrix<3>& C, const Mat<3>& axes) {
  VoigtMatrix<3> turn;  // strains in the world by strains along the axes
  for (int c = 0; c < 6; ++c) {
    const Mat<3> strain = gradient_of<3>(Voigt<3>::Unit(c)).reshaped(3, 3);
    turn.col(c) = strain_of<3>(Mat<3>(axes * strain * axes.transpose()).reshaped());
  }
  const VoigtMatrix<3> turned = turn.transpose() * C * turn;
  return 0.5 * (turned + turned.transpose());
}

CellAnisotropy::CellAnisotropy(const CellLayout& layout, const std::vector<VoigtMatrix<3>>& stiffness)
    : single_(stiffness.size()), double_(stiffness.size()) {
  if (stiffness.empty()) return;
  const double volume = layout.edges.prod() / 8.0;
  for (std::size_t m = 0; m < stiffness.size(); ++m)
    for (int r = 0; r < 6; ++r)
      for (int c = 0; c < 6; ++c) {
        double_[m][6 * r + c] = volume * stiffness[m](r, c);
        single_[m][6 * r + c] = static_cast<float>(double_[m][6 * r + c]);
      }
  begin_.reserve(layout.blocks() + 1);
  begin_.push_back(0);
}

template <> const float* CellAnisotropy::weight<float>(std::uint32_t material) const {
  return single_[material].data();
}
template <> const double* CellAnisotropy::weight<double>(std::uint32_t material) const {
  return double_[material].data();
}

Parts CellAnisotropy::take_shares(const CellLayout& layout, const PartLayers& layers, Index begin, Index end) {
  if (empty()) return layers(begin, end);
  constexpr Index shares_at_once = 128, fewest = 4;  // layers times materials
  const Index step = std::max(fewest, shares_at_once / static_cast<Index>(single_.size()));
  Parts all;
  for (Index first = begin; first < end; first += step) {
    const Parts some = layers(first, std::min(first + step, end));
    add_layers(layout, some);
    all.shear.insert(all.shear.end(), some.shear.begin(), some.shear.end());
    all.across.insert(all.across.end(), some.across.begin(), some.across.end());
  }
  return all;
}

void CellAnisotropy::add_layers(const CellLayout& layout, const Parts& parts) {
  const auto& n = layout.cells;
  const PartOrder order(n);
  std::vector<std::uint32_t> present;
  for (std::uint32_t m = 0; m < parts.shares.size(); ++m)
    if (!parts.shares[m].empty()) present.push_back(m);
  const auto layers = static_cast<Index>(parts.shear.size() / order.plane / 2);
  struct Layer {
    std::vector<std::uint32_t> in_block;  ///< shares in it
    std::vector<Share> shares;            ///< begin counts from the layer's first
    std::vector<float> parts;
  };
  std::vector<Layer> found(layers);
  parallel_chunks(layers, 1, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      Layer& layer = found[k];
      std::vector<std::uint32_t> in_row;
      for (Index j = 0; j < n[1]; ++j) {
        in_row.clear();
        for (const std::uint32_t m : present) {
          bool any = false;
          for (const int q : {0, 2, 4, 6}) {  // rows of parts
            const float* row = parts.shares[m].data() + order(0, j, k, q);
            any = any || std::any_of(row, row + order.along, [](float share) { return share != 0.0F; });
          }
          if (any) in_row.push_back(m);
        }
        for (Index i = 0; i < n[0]; i += lanes) {
          std::uint32_t count = 0;
          for (const std::uint32_t m : in_row) {
            const std::vector<float>& of = parts.shares[m];
            std::array<float, static_cast<std::size_t>(8) * lanes> share{};
            bool any = false, all = i + lanes <= n[0];
            for (int q = 0; q < 8; ++q)
              for (int lane = 0; lane < lanes && i + lane < n[0]; ++lane) {
                const float here = share[q * lanes + lane] = of[order(i + lane, j, k, q)];
                any = any || here != 0.0F;
                all = all && here == 1.0F;
              }
            if (!any) continue;
            ++count;
            const auto next = static_cast<std::uint32_t>(layer.parts.size() / share.size());
            layer.shares.push_back({m, all ? whole : next});
            if (!all) layer.parts.insert(layer.parts.end(), share.begin(), share.end());
          }
          layer.in_block.push_back(count);
        }
      }
    }
  });
  for (const Layer& layer : found) {
    const auto first = static_cast<std::uint32_t>(parts_.size() / (8 * lanes));
    for (const std::uint32_t count : layer.in_block) begin_.push_back(begin_.back() + count);
    for (const Share& share : layer.shares)
      shares_.push_back({share.material, share.begin == whole ? whole : first + share.begin});
    parts_.insert(parts_.end(), layer.parts.begin(), layer.parts.end());
  }
}

std::vector<std::vector<float>> CellAnisotropy::shares(const CellLayout& layout, Index begin, Index end) const {
  std::vector<std::vector<float>> result(single_.size());
  if (empty()) return result;
  const auto& n = layout.cells;
  const PartOrder order(n);
  std::vector<char> any(single_.size(), 0);
  for (std::size_t s = begin_[layout.block(0, 0, begin)]; s < begin_[layout.block(0, 0, end)]; ++s)
    any[shares_[s].material] = 1;
  for (std::size_t m = 0; m < any.size(); ++m)
    if (any[m]) result[m].assign(order(0, 0, end - begin, 0), 0.0F);
  parallel_chunks(end - begin, 1, [&](Index first, Index last) {
    for (Index k = first; k < last; ++k)
      for (Index j = 0; j < n[1]; ++j)
        for (Index i = 0; i < n[0]; ++i)
          for (const Share& share : in_block(layout.block(i, j, begin + k)))
            for (int q = 0; q < 8; ++q)
              result[share.material][order(i, j, k, q)] = share.begin == whole ? 1.0F : of_part(share, q)[i % lanes];
  });
  return result;
}

template <> AddAnisotropy<float> add_anisotropy<float>() {
  static const AddAnisotropy<float> add = kernel<Anisotropic, CellGrid, float, Floats>();
  return add;
}
template <> AddAnisotropy<double> add_anisotropy<double>() {
  static const AddAnisotropy<double> add = kernel<Anisotropic, CellGrid, double, Doubles>();
  return add;
}

}  // namespace efree::internal
