// SPDX-License-Identifier: GPL-3.0-or-later
/// Clouds of several spacings that are alike.
#pragma once

#include "efree/analysis/settings.hpp"

namespace efree::internal {

/// The grading of a case for clouds `factor` times as wide: spacings asked for at places, and how fast they grow from
/// there, so that the clouds of a study are similar.
inline Grading scaled(Grading grading, double factor) {
  if (!grading.has_places()) return grading;
  for (auto& part : grading.boxes) part.spacing *= factor;
  for (auto& part : grading.regions) part.spacing *= factor;
  for (auto& part : grading.boundaries) part.spacing *= factor;
  grading.growth *= factor;
  return grading;
}

}  // namespace efree::internal
