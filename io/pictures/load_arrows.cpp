// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/load_arrows.hpp"

#include "efree/assembly/loads.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace efree::internal::drawing {

template <int Dim> std::vector<LoadArrow> load_arrows(
    const Loads<Dim>& loads, const std::function<std::vector<LoadedFacet<Dim>>(const std::string& part)>& facets_of,
    double gap) {
  // Those of one part add up.
  std::map<std::string, std::vector<TractionCondition<Dim>>> by_part;
  for (const auto& one : loads.tractions) by_part[one.on].push_back(one);
  for (const auto& one : loads.followers) by_part[one.on].push_back(pressure<Dim>(one.on, one.pressure));
  for (const auto& one : loads.resultants) {
    AreaMoments<Dim> moments;
    for (const LoadedFacet<Dim>& facet : facets_of(one.on)) moments.add(facet.at, facet.area);
    if (moments.area > 0.0) by_part[one.on].push_back(moments.traction(one));
  }
  std::vector<LoadArrow> arrows;
  for (const auto& [part, conditions] : by_part) {
    OnePerCube cubes(gap);
    for (const LoadedFacet<Dim>& facet : facets_of(part)) {
      LoadArrow arrow{Vec3::Zero(), Vec3::Zero(), false, facet.point};
      arrow.at.template head<Dim>() = facet.at;
      if (!cubes.take(arrow.at)) continue;
      Vec<Dim> traction = Vec<Dim>::Zero();
      for (const auto& condition : conditions) traction += condition.traction(facet.at, facet.normal);
      arrow.traction.template head<Dim>() = traction;
      arrow.presses = traction.dot(facet.normal) < 0.0;
      if (arrow.traction.allFinite() && !arrow.traction.isZero(0.0)) arrows.push_back(arrow);
    }
  }
  return arrows;
}

void draw_arrows(Canvas& canvas, const Projection& at, const std::vector<LoadArrow>& arrows, const Points<3>& moved,
                 double length, const Colour& colour) {
  double largest = 0.0;
  for (const LoadArrow& arrow : arrows) largest = std::max(largest, arrow.traction.stableNorm());
  for (const LoadArrow& arrow : arrows) {
    // Small ones have to be seen, too.
    const double size = length * std::max(0.3, arrow.traction.stableNorm() / largest);
    const Vec3 along = arrow.traction.stableNormalized(), place = arrow.at + moved.col(arrow.point);
    const Vec3 tip = arrow.presses ? place : Vec3(place + size * along),
               neck = tip - std::min(0.28 * length, 0.6 * size) * along;
    canvas.line(at(tip - size * along), at(neck), 4.0, colour, 2.0);
    const Vec3 right = along.unitOrthogonal(), up = along.cross(right);
    constexpr int around = 12;
    const auto rim = [&](int i) {
      const double turn = 2.0 * std::numbers::pi * i / around;
      return at(neck +
                0.09 * length * std::min(1.0, 2.0 * size / length) * (std::cos(turn) * right + std::sin(turn) * up));
    };
    for (int i = 0; i < around; ++i) {
      canvas.triangle({at(tip), rim(i), rim(i + 1)}, colour);
      canvas.triangle({at(neck), rim(i), rim(i + 1)}, 0.75F * colour);
    }
  }
}

template std::vector<LoadArrow> load_arrows<2>(const Loads<2>&,
                                               const std::function<std::vector<LoadedFacet<2>>(const std::string&)>&,
                                               double);
template std::vector<LoadArrow> load_arrows<3>(const Loads<3>&,
                                               const std::function<std::vector<LoadedFacet<3>>(const std::string&)>&,
                                               double);

}  // namespace efree::internal::drawing
