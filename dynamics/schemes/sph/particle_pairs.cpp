// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/particle_pairs.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

namespace efree::internal {
namespace {

/// Particles sorted into the cubes of a lattice without bounds, by a table of hashes.
template <int Dim> class Cubes {
 public:
  Cubes(const Points<Dim>& x, double edge) : x_(x), edge_(edge) {
    const auto n = static_cast<Index>(x.cols());
    mask_ = std::bit_ceil(static_cast<std::uint64_t>(2 * n + 1)) - 1;
    keys_.resize(static_cast<std::size_t>(n));
    parallel_for(n, [&](Index i) { keys_[i] = key_of(cube_of(x.col(i))); });
    first_.assign(mask_ + 2, 0);
    for (const std::uint64_t key : keys_) ++first_[slot(key)];
    for (std::size_t s = 1; s < first_.size(); ++s) first_[s] += first_[s - 1];
    sorted_.resize(keys_.size());
    // From the ends of all, which become their beginnings.
    for (Index i = n; i-- > 0;) sorted_[--first_[slot(keys_[i])]] = i;
  }

  /// Calls visit(particle) for those in the cubes around that of a position and in it, always in the same order.
  template <class Visit> void for_each_around(const Vec<Dim>& at, const Visit& visit) const {
    const Cube middle = cube_of(at);
    for (std::int64_t i = -1; i <= 1; ++i)
      for (std::int64_t j = -1; j <= 1; ++j)
        for (std::int64_t k = Dim == 3 ? -1 : 0; k <= (Dim == 3 ? 1 : 0); ++k) {
          Cube cube = middle;
          cube.at[0] += i;
          cube.at[1] += j;
          if constexpr (Dim == 3) cube.at[2] += k;
          const std::uint64_t key = key_of(cube);
          for (Index s = first_[slot(key)]; s < first_[slot(key) + 1]; ++s)
            if (keys_[sorted_[s]] == key) visit(sorted_[s]);
        }
  }

 private:
  struct Cube {
    std::int64_t at[Dim];
  };
  Cube cube_of(const Vec<Dim>& x) const {
    constexpr double most = 1 << 20;  // what is further away shares cubes, and is told apart by distances
    Cube cube;
    for (int i = 0; i < Dim; ++i)
      cube.at[i] = static_cast<std::int64_t>(std::floor(std::clamp(x[i] / edge_, -most, most)));
    return cube;
  }
  static std::uint64_t key_of(const Cube& cube) {
    std::uint64_t key = 0;
    for (int i = 0; i < Dim; ++i) key = key << 21 | static_cast<std::uint64_t>(cube.at[i] & 0x1fffff);
    return key;
  }
  std::size_t slot(std::uint64_t key) const {
    key = (key ^ key >> 31) * 0x9e3779b97f4a7c15;
    return static_cast<std::size_t>((key ^ key >> 29) & mask_);
  }

  const Points<Dim>& x_;
  double edge_;
  std::uint64_t mask_;
  std::vector<std::uint64_t> keys_;
  std::vector<Index> first_, sorted_;
};

}  // namespace

template <int Dim> void find_pairs(const Points<Dim>& x, const Vector& size, double reach,
                                   const std::vector<std::span<const Index>>& chunks,
                                   const std::vector<WallImage<Dim>>& images, std::vector<ParticlePairs>& pairs) {
  const double furthest = reach * size.maxCoeff();
  const Cubes<Dim> cubes(x, furthest);
  pairs.resize(chunks.size());
  parallel_chunks(static_cast<Index>(chunks.size()), 1, [&](Index c, Index) {
    thread_local std::vector<Index> local;  // numbers, by particle; -1: none yet
    local.resize(std::max(local.size(), static_cast<std::size_t>(x.cols())), -1);
    thread_local ParticlePairs of;  // room to grow
    of.particles.assign(chunks[c].begin(), chunks[c].end());
    of.own = of.all();
    of.begin.assign(1, 0);
    of.other.clear();
    of.mirrored.clear();
    for (Index i = 0; i < of.own; ++i) local[of.particles[i]] = i;
    bool fits = true;
    for (Index i = 0; i < of.own; ++i) {
      const Index particle = of.particles[i];
      const Vec<Dim> at = x.col(particle);
      cubes.for_each_around(at, [&](Index j) {
        if (local[j] >= 0 && local[j] <= i) return;
        const double most = reach * std::max(size[particle], size[j]);
        if (!((x.col(j) - at).squaredNorm() < most * most)) return;
        if (local[j] < 0) {
          local[j] = of.all();
          of.particles.push_back(j);
        }
        fits = fits && local[j] <= std::numeric_limits<std::uint16_t>::max();
        of.other.push_back(static_cast<std::uint16_t>(local[j]));
      });
      while (of.count() % pairs_at_once != 0) of.other.push_back(static_cast<std::uint16_t>(i));
      of.begin.push_back(of.count());
      for (std::size_t k = 0; k < images.size(); ++k) {
        const Vec<Dim> image = images[k].of(at);
        if ((image - at).squaredNorm() > 4.0 * furthest * furthest) continue;  // that far from the walls
        cubes.for_each_around(image, [&](Index j) {
          const double most = reach * std::max(size[particle], size[j]);
          if ((x.col(j) - image).squaredNorm() < most * most)
            of.mirrored.push_back({static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(k), j});
        });
      }
    }
    for (const Index j : of.particles) local[j] = -1;
    if (!fits)
      throw NumericalError(fmt::format("{} particles are around a chunk of {}: they have collapsed to one place",
                                       of.all() - of.own, of.own));
    pairs[c] = of;
  });
}

template <int Dim> std::int64_t count_close(const std::vector<ParticlePairs>& pairs, const Points<Dim>& x,
                                            const Vector& size, double closer) {
  std::vector<std::int64_t> counts(pairs.size());
  parallel_chunks(static_cast<Index>(pairs.size()), 1, [&](Index c, Index) {
    const ParticlePairs& of = pairs[c];
    std::vector<char> is_close(of.particles.size(), 0);
    for (Index i = 0; i < of.own; ++i)
      for (Index k = of.begin[i]; k < of.begin[i + 1]; ++k) {
        if (of.other[k] == i) continue;
        const Index a = of.particles[i], b = of.particles[of.other[k]];
        const double least = 0.5 * closer * (size[a] + size[b]);
        if ((x.col(a) - x.col(b)).squaredNorm() < least * least)
          is_close[static_cast<std::size_t>(i)] = is_close[of.other[k]] = 1;
      }
    counts[c] = std::count(is_close.begin(), is_close.begin() + of.own, 1);
  });
  return std::reduce(counts.begin(), counts.end());
}

#define EFREE_INSTANTIATE(Dim)                                                                                    \
  template void find_pairs(const Points<Dim>&, const Vector&, double, const std::vector<std::span<const Index>>&, \
                           const std::vector<WallImage<Dim>>&, std::vector<ParticlePairs>&);                      \
  template std::int64_t count_close(const std::vector<ParticlePairs>&, const Points<Dim>&, const Vector&, double);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
