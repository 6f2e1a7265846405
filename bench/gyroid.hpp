// SPDX-License-Identifier: GPL-3.0-or-later
/// A sheet around Schoen's gyroid, with a period of 32 voxels and walls of about four.
#pragma once

#include "efree/geometry/input/label_image.hpp"

#include <cmath>
#include <numbers>

namespace efree::bench {

/// n^3 voxels; grey values are 0.4 - abs(sin X cos Y + sin Y cos Z + sin Z cos X), X = 2 pi x / 32, at their middles.
inline LabelImage<3> gyroid_sheet(Index n) {
  LabelImage<3> image{.size = {n, n, n}};
  const auto at = [](Index i) { return 2.0 * std::numbers::pi * (i + 0.5) / 32.0; };
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) {
        const double X = at(i), Y = at(j), Z = at(k);
        const double value =
            0.4 - std::abs(std::sin(X) * std::cos(Y) + std::sin(Y) * std::cos(Z) + std::sin(Z) * std::cos(X));
        image.labels.push_back(value > 0.0);
        image.grey.push_back(static_cast<float>(value));
      }
  return image;
}
/// The same without grey values.
inline LabelImage<3> gyroid_labels(Index n) {
  LabelImage<3> image = gyroid_sheet(n);
  image.grey.clear();
  return image;
}

}  // namespace efree::bench
