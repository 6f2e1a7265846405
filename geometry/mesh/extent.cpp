// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/internal/extent.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace efree::internal {

template <int Dim> void require_extent(const Vec<Dim>& low, const Vec<Dim>& high, std::string_view subject) {
  constexpr double least = 1e-30, largest = 1e30, farthest = 1e8;
  if (!low.allFinite() || !high.allFinite())
    throw InputError(fmt::format("{}: a coordinate is not a finite number", subject));
  const double side = (high - low).maxCoeff();
  if (!(side >= least && side <= largest))
    throw InputError(fmt::format("{}: it is {:.4g} large, expected {:g} to {:g}: choose another unit", subject, side,
                                 least, largest));
  const double away = low.cwiseMax(-high).maxCoeff();
  if (away > farthest * side)
    throw InputError(fmt::format(
        "{}: it is {:.4g} large and lies {:.4g} from the origin, where numbers cannot tell its points apart: move it "
        "to the origin",
        subject, side, away));
}

template <int Dim> void require_thickness(const Vec<Dim>& low, const Vec<Dim>& high, std::string_view subject) {
  constexpr double thinnest = 2e4;
  const Vec<Dim> sides = high - low;
  if (sides.maxCoeff() > thinnest * sides.minCoeff())
    throw InputError(fmt::format(
        "{}: it is {:.4g} long and {:.4g} thick, more than 1 to {:g}: a body for the theory of beams and plates",
        subject, sides.maxCoeff(), sides.minCoeff(), thinnest));
}

template void require_extent<2>(const Vec<2>&, const Vec<2>&, std::string_view);
template void require_extent<3>(const Vec<3>&, const Vec<3>&, std::string_view);
template void require_thickness<2>(const Vec<2>&, const Vec<2>&, std::string_view);
template void require_thickness<3>(const Vec<3>&, const Vec<3>&, std::string_view);

}  // namespace efree::internal
