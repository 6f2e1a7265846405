// SPDX-License-Identifier: GPL-3.0-or-later
/// Anisotropic materials on grids of cells: what their stiffness has beyond that of an isotropic one.
#pragma once

#include "efree/core/types.hpp"
#include "efree/solvers/cells/internal/cell_parts.hpp"

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace efree::internal {

/// C_xyxy and C_xxyy of an isotropic stiffness.
struct IsotropicStiffness {
  double shear, across;
  VoigtMatrix<3> matrix() const;
};
/// The isotropic stiffness with e . C_iso e <= e . C e for all strains e whose largest quotient of the two is smallest:
/// conjugate gradients preconditioned with C_iso need about the root of that quotient times as many iterations as
/// without anisotropy. Where many do, that with the smallest C_xxyy; of nearly incompressible materials the largest, so
/// that what is left hardly resists dilatations. nu is in [0, 0.4], of nearly incompressible materials up to 0.4995.
IsotropicStiffness isotropic_part(const VoigtMatrix<3>& C, bool nearly_incompressible);

/// A stiffness in the world's axes, along others (columns).
VoigtMatrix<3> rotate_to_axes(const VoigtMatrix<3>& C, const Mat<3>& axes);

/// The anisotropic parts of materials, C - C_iso, none of which is negative, and how much of each material is in the
/// parts of a grid's cells. Blocks of cells without such a material take 4 bytes, whole ones 8 more, others 256 more
/// for each material in them.
class CellAnisotropy {
 public:
  static constexpr int lanes = CellLayout::lanes;

  /// `stiffness` by material, C - C_iso along the grid's axes.
  CellAnisotropy(const CellLayout& layout, const std::vector<VoigtMatrix<3>>& stiffness);

  /// Whether there is no such material.
  bool empty() const { return single_.empty(); }
  /// The moduli of the layers [begin, end), which are asked for one after the other, from the first to the last. Notes
  /// their shares, of many materials few layers at a time.
  Parts take_shares(const CellLayout& layout, const PartLayers& layers, Index begin, Index end);
  /// Parts::shares of the layers [begin, end).
  std::vector<std::vector<float>> shares(const CellLayout& layout, Index begin, Index end) const;

  static constexpr std::uint32_t whole = std::numeric_limits<std::uint32_t>::max();
  /// A material in a block of cells: `whole`, or where its shares begin, in units of those of a block.
  struct Share {
    std::uint32_t material, begin;
  };
  /// By material in a block.
  std::span<const Share> in_block(std::size_t block) const {
    return {shares_.data() + begin_[block], shares_.data() + begin_[block + 1]};
  }
  /// Of a part of `lanes` cells, from shares that are not whole.
  const float* of_part(const Share& share, int q) const {
    return parts_.data() + (static_cast<std::size_t>(share.begin) * 8 + q) * lanes;
  }
  /// C - C_iso times the volume of a part, row by row.
  template <class T> const T* weight(std::uint32_t material) const;

 private:
  void add_layers(const CellLayout& layout, const Parts& parts);

  std::vector<std::array<float, 36>> single_;
  std::vector<std::array<double, 36>> double_;
  std::vector<std::uint32_t> begin_;  ///< by block, and the end
  std::vector<Share> shares_;
  std::vector<float> parts_;  ///< by share that is not whole: by part, by cell
};

struct CellGrid;
/// Adds the forces of the anisotropic parts to fields `f`, for layers of cells (kernels::Layers).
template <class T> using AddAnisotropy = void (*)(const CellGrid&, const T* u, T* f, Index begin, Index end);
template <class T> AddAnisotropy<T> add_anisotropy();

}  // namespace efree::internal
