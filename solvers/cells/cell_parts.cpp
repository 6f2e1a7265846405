// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_parts.hpp"

#include "efree/core/parallel.hpp"
#include "efree/solvers/cells/internal/grid_fields.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace efree::internal {
namespace {

/// Numbers by key, in a table with room for all of them.
class NumberTable {
 public:
  static constexpr std::uint16_t none = 0xffff;

  void clear(std::size_t most) {
    bits_ = std::bit_width(4 * most);
    slots_.assign(std::size_t{1} << bits_, {0, none});
  }
  std::uint16_t find(std::uint64_t key) const { return slots_[slot(key)].number; }
  /// Keeps the number that a key has.
  void add(std::uint64_t key, std::uint16_t number) {
    Slot& at = slots_[slot(key)];
    if (at.number == none) at = {key, number};
  }

 private:
  struct Slot {
    std::uint64_t key;
    std::uint16_t number;
  };
  /// That of the key, or the free one where it would be.
  std::size_t slot(std::uint64_t key) const {
    std::size_t at = key * 0x9e3779b97f4a7c15U >> (64 - bits_);
    while (slots_[at].number != none && slots_[at].key != key) at = (at + 1) & (slots_.size() - 1);
    return at;
  }

  int bits_ = 0;
  std::vector<Slot> slots_;
};

/// Numbers of pairs of moduli. Where there are too many, shear moduli and the ratios of both are rounded, ever more.
class Palette {
 public:
  static constexpr std::uint16_t unknown = NumberTable::none;

  explicit Palette(const std::vector<PartStiffness>& exact) : exact_{PartStiffness{}} {
    for (const PartStiffness& one : exact)
      if (std::ranges::find(exact_, one) == exact_.end()) exact_.push_back(one);
    start();
  }
  std::vector<PartStiffness> pairs;

  std::uint16_t find(const PartStiffness& of) const {
    if (of.shear == 0.0F) return 0;
    const std::uint16_t exact = numbers_.find(key_of(rounded(of, exact_bits)));
    return exact != unknown || bits_ == exact_bits ? exact : numbers_.find(key_of(rounded(of, bits_)));
  }
  /// A number for what is not found; `unknown` if there is no room for it.
  std::uint16_t add(const PartStiffness& of) {
    if (pairs.size() >= room()) return unknown;
    const auto number = static_cast<std::uint16_t>(pairs.size());
    const Rounded stands = rounded(of, bits_);
    pairs.push_back(bits_ == exact_bits ? of : PartStiffness{stands.shear, stands.shear * stands.ratio});
    numbers_.add(key_of(stands), number);
    return number;
  }
  /// Rounds more. Returns the new number by the old one.
  std::vector<std::uint16_t> coarsen() {
    bits_ = bits_ == exact_bits ? 12 : std::min(bits_ - 1, fewest_bits_in_cache);
    const std::vector<PartStiffness> before = std::exchange(pairs, {});
    const std::size_t kept = exact_.size();
    start();
    std::vector<std::uint16_t> renumbered(before.size());
    for (std::size_t n = 0; n < before.size(); ++n) {
      renumbered[n] = n < kept ? static_cast<std::uint16_t>(n) : find(before[n]);
      if (renumbered[n] == unknown) renumbered[n] = add(before[n]);
    }
    return renumbered;
  }

 private:
  struct Rounded {
    float shear, ratio;
  };
  static constexpr int exact_bits = 17;  ///< mantissa of what is told apart: less than the rounding of averages
  static constexpr int fewest_bits_in_cache = 8;
  static constexpr std::size_t in_cache = 4096, most = unknown;

  std::size_t room() const { return bits_ > fewest_bits_in_cache ? in_cache : most; }
  void start() {
    pairs = exact_;
    numbers_.clear(std::max(room(), 9 * exact_.size()));
    // Where rounding goes either way, both have the number.
    constexpr float little = 1e-6F;
    for (std::size_t n = 1; n < exact_.size(); ++n)
      for (const float a : {0.0F, -little, little})
        for (const float b : {0.0F, -little, little}) {
          const float shear = exact_[n].shear * (1.0F + a);
          numbers_.add(key_of(rounded({shear, (1.0F + a) * (1.0F + b) * exact_[n].across}, exact_bits)),
                       static_cast<std::uint16_t>(n));
        }
  }
  static float rounded(float value, int bits) {
    const int dropped = 23 - bits;
    const auto digits = std::bit_cast<std::uint32_t>(value);
    const std::uint32_t half = (1U << (dropped - 1)) - 1U + (digits >> dropped & 1U);  // ties to even
    return std::bit_cast<float>((digits + half) & ~((1U << dropped) - 1U));
  }
  /// An error of the ratio is the same everywhere: it keeps more digits.
  static Rounded rounded(const PartStiffness& of, int bits) {
    return {rounded(of.shear, bits), rounded(of.across / of.shear, std::min(bits + 4, exact_bits))};
  }
  static std::uint64_t key_of(const Rounded& of) {
    return static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(of.shear)) << 32 |
           std::bit_cast<std::uint32_t>(of.ratio);
  }

  std::vector<PartStiffness> exact_;  ///< void first
  int bits_ = exact_bits;
  NumberTable numbers_;
};

/// Cells whose parts are held at once, as layers of them.
constexpr Index slab = 32;

}  // namespace

CellLayout::CellLayout(const std::array<Index, 3>& cells_, const Vec<3>& edges_)
    : cells(cells_), edges(edges_), row((cells_[0] + lanes - 1) / lanes * lanes), pitch(row + lanes) {
  for (int d = 0; d < 3; ++d) inverse_edges[d] = 1.0 / edges[d];
}

CellParts::CellParts(const CellLayout& layout, const PartLayers& layers, const std::vector<PartStiffness>& exact)
    : numbers_(layout.blocks() * 8 * lanes, 0), kinds_(layout.blocks(), Kind::empty) {
  const auto& n = layout.cells;
  Palette palette(exact);
  const PartOrder order(n);
  for (Index first = 0; first < n[2]; first += slab) {
    const Index last = std::min(first + slab, n[2]);
    const Parts parts = layers(first, last);
    const auto of_part = [&](std::size_t part) {
      return PartStiffness{parts.shear[part], parts.across.empty() ? 0.0F : parts.across[part]};
    };
    struct Unknown {
      PartStiffness moduli;
      std::uint16_t* number;
    };
    std::vector<std::vector<Unknown>> unknown(last - first);  // by layer
    parallel_chunks(last - first, 1, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        PartStiffness before;
        std::uint16_t number = 0;
        for (Index j = 0; j < n[1]; ++j)
          for (Index i = 0; i < n[0]; ++i) {
            std::uint16_t* to = &numbers_[layout.block(i, j, first + k) * 8 * lanes + i % lanes];
            for (int q = 0; q < 8; ++q, to += lanes) {
              const PartStiffness here = of_part(order(i, j, k, q));
              if (!(here == before)) number = palette.find(before = here);
              *to = number;
              if (number == Palette::unknown) unknown[k].push_back({here, to});
            }
          }
      }
    });
    for (const auto& of_layer : unknown)
      for (const auto& [moduli, number] : of_layer) {
        const auto find_or_add = [&] {
          *number = palette.find(moduli);
          if (*number == Palette::unknown) *number = palette.add(moduli);
        };
        find_or_add();
        while (*number == Palette::unknown) {
          const std::vector<std::uint16_t> renumbered = palette.coarsen();
          for_all(numbers_.size(), [&](std::size_t p) {
            if (numbers_[p] != Palette::unknown) numbers_[p] = renumbered[numbers_[p]];
          });
          find_or_add();
        }
      }
  }
  moduli_ = std::move(palette.pairs);
  const auto volume = static_cast<float>(layout.edges.prod() / 8.0);
  for (const PartStiffness& one : moduli_) weights_.push_back({volume * one.shear, volume * one.across});
  find_kinds();
}

std::array<float, 2> CellParts::ratios() const {
  std::array<float, 2> ends{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
  for (std::size_t n = 1; n < moduli_.size(); ++n) {
    const float ratio = moduli_[n].across / moduli_[n].shear;
    ends = {std::min(ends[0], ratio), std::max(ends[1], ratio)};
  }
  return ends;
}

void CellParts::find_kinds() {
  for_all(kinds_.size(), [&](std::size_t block) {
    const std::uint16_t* of = numbers_.data() + block * 8 * lanes;
    const bool uniform = std::all_of(of, of + 8 * lanes, [&](std::uint16_t number) { return number == *of; });
    kinds_[block] = !uniform ? Kind::mixed : *of == 0 ? Kind::empty : Kind::uniform;
  });
}

std::optional<std::array<int, 3>> halvings(const std::array<Index, 3>& fine, const std::array<Index, 3>& coarse) {
  std::array<int, 3> ratio;
  for (int d = 0; d < 3; ++d) {
    if (fine[d] != coarse[d] && fine[d] != 2 * coarse[d]) return {};
    ratio[d] = fine[d] == coarse[d] ? 1 : 2;
  }
  return ratio;
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

PartLayers halved(PartLayers finer, const std::array<Index, 3>& cells, const std::array<int, 3>& ratio) {
  return [finer = std::move(finer), cells, ratio](Index begin, Index end) {
    const std::array<Index, 3> of{cells[0], cells[1], ratio[2] * (end - begin)};
    Parts parts = finer(ratio[2] * begin, ratio[2] * end);
    parts.shear = halved(parts.shear, of, ratio);
    if (!parts.across.empty()) parts.across = halved(parts.across, of, ratio);
    for (std::vector<float>& share : parts.shares)
      if (!share.empty()) share = halved(share, of, ratio);
    return parts;
  };
}

PartLayers layers_of(const Parts& parts, const std::array<Index, 3>& cells) {
  return [&parts, layer = 8 * static_cast<std::ptrdiff_t>(cells[0]) * cells[1]](Index begin, Index end) {
    const auto cut = [&](const std::vector<float>& from) {
      if (from.empty()) return from;
      return std::vector<float>(from.begin() + layer * begin, from.begin() + layer * end);
    };
    Parts result{cut(parts.shear), cut(parts.across)};
    for (const std::vector<float>& share : parts.shares) result.shares.push_back(cut(share));
    return result;
  };
}

}  // namespace efree::internal
