// SPDX-License-Identifier: GPL-3.0-or-later
/// What result.json says of regions and bodies: measure, mass, extremes of stress, and how stresses are spread.
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/analysis/image_analysis.hpp"
#include "efree/analysis/result.hpp"

#include <array>
#include <nlohmann/json.hpp>
#include <vector>

namespace efree::internal {

/// How von Mises stresses are spread over a volume, in equal bins up to the largest.
class StressSpread {
 public:
  explicit StressSpread(double largest) : largest_(largest) {}
  void add(double von_mises, double volume);
  /// The stress that a share of the volume does not exceed, to a 4096th of the largest; 0 of no volume.
  double quantile(double share) const;
  /// "50", "90", "99" and "99.9": quantiles of these percentages.
  nlohmann::ordered_json json() const;

 private:
  static constexpr std::size_t bins = 4096;

  double largest_, all_ = 0.0;
  std::array<double, bins> volume_{};
};

/// by_region.NAME: area (in the plane) or volume, mass where a density is given, the largest von Mises stress and its
/// place, the smallest and largest principal stress, and quantiles of the von Mises stress, at the places of the
/// fields.
template <int Dim>
void add_regions(const CommonSettings<Dim>& settings, const Result<Dim>& result, nlohmann::ordered_json& json);
/// Likewise of an image on cells, quantiles of the means in cells.
void add_regions(const CommonSettings<3>& settings, const ImageResult& result, nlohmann::ordered_json& json);
/// Likewise of the bodies of explicit dynamics at their material points; measures and shares are those of the reference
/// configuration.
template <int Dim> void add_regions(const DynamicsModel<Dim>& model, nlohmann::ordered_json& json);

}  // namespace efree::internal
