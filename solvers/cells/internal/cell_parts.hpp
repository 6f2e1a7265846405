// SPDX-License-Identifier: GPL-3.0-or-later
/// What is in the parts of a grid's cells, as numbers in a palette.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace efree::internal {

/// A grid of boxes and its nodes, x fastest. Rows of nodes are padded so that `lanes` cells can be taken at once.
struct CellLayout {
  static constexpr int lanes = 8;

  std::array<Index, 3> cells{};
  Vec<3> edges = Vec<3>::Ones();  ///< of a cell [length]
  std::array<double, 3> inverse_edges{};
  Index row = 0, pitch = 0;  ///< cells in a padded row, nodes in one

  CellLayout(const std::array<Index, 3>& cells, const Vec<3>& edges);

  std::size_t node(Index i, Index j, Index k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(pitch) * (j + static_cast<std::size_t>(cells[1] + 1) * k);
  }
  std::size_t nodes() const { return node(0, 0, cells[2] + 1); }
  std::size_t block(Index i, Index j, Index k) const {
    return (static_cast<std::size_t>(i) +
            static_cast<std::size_t>(row) * (j + static_cast<std::size_t>(cells[1]) * k)) /
           lanes;
  }
  std::size_t blocks() const { return block(0, 0, cells[2]); }
};

/// C_xyxy (`shear`) and C_xxyy (`across`) of a part; of a conductor its conductivity and 0.
struct PartStiffness {
  float shear = 0.0F, across = 0.0F;
  friend bool operator==(const PartStiffness&, const PartStiffness&) = default;
};

/// The order of the parts in layers of cells: two to a cell along each axis, x fastest.
struct PartOrder {
  std::size_t along, plane;  ///< parts in a row, and in a layer of them
  explicit PartOrder(const std::array<Index, 3>& cells)
      : along(2 * static_cast<std::size_t>(cells[0])), plane(along * 2 * cells[1]) {}
  /// Of part q = x + 2 y + 4 z of a cell.
  std::size_t operator()(Index i, Index j, Index k, int q) const {
    return 2 * static_cast<std::size_t>(i) + (q & 1) + along * (2 * j + (q >> 1 & 1)) + plane * (2 * k + (q >> 2));
  }
};

/// Stiffness by part of a grid's cells (PartOrder). `across` may be empty: all 0.
struct Parts {
  std::vector<float> shear, across;
  std::vector<std::vector<float>> shares{};  ///< by anisotropic material: how much of a part is of it; empty: nothing
};
/// Those of the layers [begin, end) of cells.
using PartLayers = std::function<Parts(Index begin, Index end)>;

/// Cells of a grid along each axis over those of a coarser one, if these are 1 or 2.
std::optional<std::array<int, 3>> halvings(const std::array<Index, 3>& fine, const std::array<Index, 3>& coarse);
/// Means by part of a coarser grid, from the values by part of a grid of so many cells: `ratio`, 1 or 2 along each
/// axis.
std::vector<float> halved(const std::vector<float>& parts, const std::array<Index, 3>& cells,
                          const std::array<int, 3>& ratio);
/// The same of moduli and shares, layer by layer.
PartLayers halved(PartLayers finer, const std::array<Index, 3>& cells, const std::array<int, 3>& ratio);
/// Layers of parts that are held whole, which have to outlive them.
PartLayers layers_of(const Parts& parts, const std::array<Index, 3>& cells);

/// The moduli of all parts: 16 bytes a cell, and each different pair once. So many different ones as partly filled
/// parts of a large image have are rounded, by 0.2 % at most, either way; those of whole materials never are.
class CellParts {
 public:
  static constexpr int lanes = CellLayout::lanes;

  /// `exact`: moduli of whole materials. Parts that differ from them by rounding only have theirs.
  CellParts(const CellLayout& layout, const PartLayers& layers, const std::vector<PartStiffness>& exact);

  /// Whether nothing is in `lanes` cells.
  bool is_empty(std::size_t block) const { return kinds_[block] == Kind::empty; }
  /// Of part q = x + 2 y + 4 z of a cell of a block.
  const PartStiffness& moduli(std::size_t block, int lane, int q) const { return moduli_[number(block, lane, q)]; }
  /// The same times the part's volume, as set_weights left it.
  const PartStiffness& weight(std::size_t block, int lane, int q) const { return weights_[number(block, lane, q)]; }
  /// The smallest and largest `across` over `shear`.
  std::array<float, 2> ratios() const;
  /// By pair, what replaces it times the volume.
  void set_weights(std::vector<PartStiffness> weights) { weights_ = std::move(weights); }
  const std::vector<PartStiffness>& weights() const { return weights_; }

  /// Weights of consecutive blocks, first by part, then by cell.
  template <int Blocks> struct Weights { alignas(64) float shear[8 * Blocks * lanes], across[8 * Blocks * lanes]; };
  template <int Blocks> [[gnu::always_inline]] void read(std::size_t block, Weights<Blocks>& to) const {
    for (int b = 0; b < Blocks; ++b) {
      const std::uint16_t* numbers = numbers_.data() + (block + b) * 8 * lanes;
      const bool uniform = kinds_[block + b] != Kind::mixed;
      const PartStiffness all = weights_[*numbers];
      for (int q = 0; q < 8; ++q)
        for (int lane = 0; lane < lanes; ++lane) {
          const PartStiffness& one = uniform ? all : weights_[numbers[q * lanes + lane]];
          const int at = (q * Blocks + b) * lanes + lane;
          to.shear[at] = one.shear;
          to.across[at] = one.across;
        }
    }
  }

 private:
  enum class Kind : char { empty, uniform, mixed };
  std::uint16_t number(std::size_t block, int lane, int q) const {
    return numbers_[block * 8 * lanes + static_cast<std::size_t>(q) * lanes + lane];
  }
  void find_kinds();

  std::vector<std::uint16_t> numbers_;  ///< by block: by part, by cell
  std::vector<Kind> kinds_;             ///< by block
  std::vector<PartStiffness> moduli_, weights_;
};

}  // namespace efree::internal
