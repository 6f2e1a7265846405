// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/grey_image.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <memory>
#include <utility>

namespace efree {

template <int Dim> ScalarField<Dim> grey_value(GreyImage<Dim> image) {
  std::size_t pixels = 1;
  for (const Index n : image.size) pixels *= static_cast<std::size_t>(std::max(n, Index(0)));
  if (pixels == 0 || image.values.size() != pixels || !(image.spacing.minCoeff() > 0.0))
    throw InputError(fmt::format("{} grey values for {} pixels of spacing ({:.6g}), expected one to each",
                                 image.values.size(), fmt::join(image.size, " x "), fmt::join(image.spacing, ", ")));
  return [shared = std::make_shared<const GreyImage<Dim>>(std::move(image))](const Vec<Dim>& x) {
    const GreyImage<Dim>& grey = *shared;
    const Vec<Dim> along = grey.axes.transpose() * (x - grey.origin);
    std::array<std::size_t, Dim> lower, step;  // to the pixel before, and from it to the next, in the order of values
    std::array<double, Dim> share;             // of the next
    std::size_t stride = 1;
    for (int d = 0; d < Dim; stride *= grey.size[d++]) {
      const double last = grey.size[d] - 1;
      const double at = std::clamp(along[d] / grey.spacing[d] - 0.5, 0.0, last);
      const auto before = static_cast<Index>(at);
      lower[d] = before * stride;
      step[d] = before < grey.size[d] - 1 ? stride : 0;
      share[d] = at - before;
    }
    double value = 0.0;
    for (int corner = 0; corner < 1 << Dim; ++corner) {
      double weight = 1.0;
      std::size_t pixel = 0;
      for (int d = 0; d < Dim; ++d) {
        const bool next = (corner >> d & 1) != 0;
        weight *= next ? share[d] : 1.0 - share[d];
        pixel += lower[d] + (next ? step[d] : 0);
      }
      value += weight * grey.values[pixel];
    }
    return value;
  };
}

template ScalarField<2> grey_value<2>(GreyImage<2>);
template ScalarField<3> grey_value<3>(GreyImage<3>);

}  // namespace efree
