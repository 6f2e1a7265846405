// SPDX-License-Identifier: GPL-3.0-or-later
/// The longest stable time step, 2 over the highest frequency of the bodies.
#pragma once

#include "efree/dynamics/scheme.hpp"

namespace efree::internal {

/// Estimates the highest frequency from below, by Lanczos's method (Lanczos 1950) from the fastest mode known so far.
/// Sets world.stable_step.
template <int Dim> class StableStep {
 public:
  /// A first mode that is nothing special, the same every time.
  void begin(const World<Dim>& world);
  /// How much stiffer than at rest the points are now.
  void update_stiffness_ratios(World<Dim>& world);
  /// Estimates from the fastest mode known, with at most so many products with the stiffness.
  void estimate(World<Dim>& world, Index most_products);
  /// Looks, from this mode on, whether something near the marked nodes has become as fast as what is the fastest, where
  /// later estimates begin then.
  void estimate_near(World<Dim>& world, const std::vector<char>& nodes, Points<Dim> mode, Index most_products);
  /// Whether the next estimate is due.
  bool is_due(const World<Dim>& world) const;
  /// Dim x N, the fastest mode known.
  const Points<Dim>& mode() const { return mode_; }
  /// The mode has these nodes, too, at rest.
  void nodes_inserted(Index first, Index count);
  void pack(Archive& archive) { archive(mode_, next_, interval_, longest_, reconnections_); }

 private:
  /// Chunks that are stiff.
  struct Region {
    std::vector<Index> chunks;
    std::vector<char> moving{};  ///< by node, 1: it is one of theirs; empty: all are
  };
  /// impulse_: elastic forces against this displacement, were the bodies elastic as they are now and nothing but the
  /// region stiff; none along what is prescribed.
  void multiply_stiffness(World<Dim>& world, const Region& region, const Points<Dim>& displacement);
  double estimate_squared_frequency(World<Dim>& world, const Region& region, Index most_products, Points<Dim>& mode);
  double lanczos(World<Dim>& world, const Region& region, Index most_products, double norm, double omega2,
                 Points<Dim>& mode);

  Points<Dim> mode_;
  Index next_ = 0, interval_ = 0;   ///< steps: when the next estimate is due, and from one to the next
  double longest_ = 0.0;            ///< stable step at the last estimate
  std::int64_t reconnections_ = 0;  ///< of the world until then
  // Room that steps do not have to allocate.
  Points<Dim> impulse_, velocity_;
  std::vector<Points<Dim>> krylov_modes_;
  std::array<Points<Dim>, 2> krylov_impulses_;
};

}  // namespace efree::internal
