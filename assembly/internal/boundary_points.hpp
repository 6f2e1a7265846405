// SPDX-License-Identifier: GPL-3.0-or-later
/// Points of the facet rule, and what restraints prescribe there.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace efree::internal {

/// One point of the facet rule on one boundary facet.
template <int Dim> struct BoundaryPoint {
  Index facet;
  Index row;      ///< of SecondaryBasis::on_facets
  Vec<Dim> x, n;  ///< position, outward normal
  double weight;  ///< area of the body's surface that the point stands for
  std::span<const Index> dofs;
  typename FineSpace<Dim>::CellValues N;  ///< of dofs
};

template <int Dim, class Visit>
void for_each_point(const FineSpace<Dim>& space, std::span<const Index> facets, const Visit& visit) {
  const auto& rule = space.facet_rule();
  const Index per_facet = static_cast<Index>(rule.weights.size());
  for (Index f : facets) {
    const Vec<Dim> normal = space.mesh().facet_normal(f);
    const double measure = space.mesh().facet_measure(f);
    const Index c = space.mesh().facet_cell(f);
    for (Index g = 0; g < per_facet; ++g) {
      const auto at = space.facet_point(f, rule.points.col(g));
      const Vec<Dim> x = space.position(c, at);
      visit(BoundaryPoint<Dim>{f, f * per_facet + g, x, normal, measure * rule.weights[g] * space.measure(x),
                               space.cell(c), space.values(at)});
    }
  }
}

template <int Dim> std::string place_text(const Vec<Dim>& x) {
  return fmt::format("({:.6g})", fmt::join(x, ", "));
}

/// Value of a restraint, checked.
template <int Dim> double prescribed(const Restraint<Dim>& restraint, const Vec<Dim>& x) {
  const double value = restraint.value(x);
  if (!std::isfinite(value))
    throw InputError(fmt::format("displacement on \"{}\" is {} at {}, expected a finite number", restraint.on, value,
                                 place_text<Dim>(x)));
  return value;
}

/// Adds sum_v phi_I(v) fine_v to the nodes.
template <int Dim> Points<Dim> to_nodes(const ShapeTable<Dim>& shape, const Points<Dim>& fine);

/// The displacement that conditions d_k . u = g_k prescribe: a frame whose first `rank` columns span the directions,
/// and u in that span.
template <int Dim> struct Held {
  Mat<Dim> frame;
  int rank;
  Vec<Dim> value;
};
/// Nothing if the conditions contradict each other.
template <int Dim>
std::optional<Held<Dim>> held_by(const std::vector<Vec<Dim>>& directions, const std::vector<double>& values);

[[noreturn]] void contradict(const std::vector<std::string>& parts, const std::string& place);

}  // namespace efree::internal
