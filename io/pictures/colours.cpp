// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/colours.hpp"

#include <vtkColorTransferFunction.h>
#include <vtkMath.h>
#include <vtkNew.h>
#include <cmath>
#include <vector>

namespace efree::internal::drawing {

ColourScale::ColourScale(const std::array<double, 2>& range) : range_(range) {
  vtkNew<vtkColorTransferFunction> stops;
  stops->AddRGBPoint(0, 0.267, 0.005, 0.329);
  stops->AddRGBPoint(1, 0.254, 0.265, 0.530);
  stops->AddRGBPoint(2, 0.164, 0.471, 0.558);
  stops->AddRGBPoint(3, 0.135, 0.659, 0.518);
  stops->AddRGBPoint(4, 0.478, 0.821, 0.318);
  stops->AddRGBPoint(5, 0.993, 0.906, 0.144);
  stops->GetTable(0.0, 5.0, size, table_[0].data());
  std::ranges::transform(table_, pixels_.begin(), Canvas::pixel);
}

std::array<double, 2> colour_range(const Vector& values) {
  std::vector<double> finite(values.begin(), values.end());
  std::erase_if(finite, [](double v) { return !std::isfinite(v); });
  if (finite.empty()) return {0.0, 1.0};
  const auto [least, most] = std::minmax_element(finite.begin(), finite.end());
  std::array<double, 2> range{*least, *most};
  const auto quantile = [&](double share) {
    const auto place = finite.begin() + static_cast<long>(share * static_cast<double>(finite.size() - 1));
    std::nth_element(finite.begin(), place, finite.end());
    return *place;
  };
  if (const double usual = quantile(0.995); range[1] > 1.5 * usual && usual > 0.0) range[1] = usual;
  if (const double usual = quantile(0.005); range[0] < 1.5 * usual && usual < 0.0) range[0] = usual;
  // A uniform field would have a scale of round-off.
  if (range[1] - range[0] <= 1e-6 * std::abs(range[1])) {
    if (range[1] < 0.0) return {1.25 * range[1], 0.0};
    return {0.0, range[1] > 0.0 ? 1.25 * range[1] : 1.0};
  }
  return range;
}

Colour distinct(Index i) {
  const double hue = std::fmod(0.58 + 0.618034 * i, 1.0);
  const double saturation = i % 3 == 1 ? 0.40 : 0.62, value = i % 3 == 2 ? 0.72 : 0.92;
  Vec<3> rgb;
  vtkMath::HSVToRGB(hue, saturation, value, &rgb[0], &rgb[1], &rgb[2]);
  return rgb.cast<float>();
}

Colour pale(Index i) {
  return 1.0F - 0.4F * (1.0F - distinct(i));
}

Colour uncoloured(Index) {
  return {0.87F, 0.89F, 0.92F};
}

}  // namespace efree::internal::drawing
