// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_loads.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <string_view>

namespace efree {

namespace internal {

const std::array<std::string, 6>& side_names() {
  static const std::array<std::string, 6> names{"left", "right", "front", "back", "bottom", "top"};
  return names;
}

std::string text_of(const Vec<3>& x) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", x[0], x[1], x[2]);
}

namespace {

/// Adds the work-equivalent forces of a traction, unscaled, which is asked for at the centroids of patches or where
/// their loads act. Returns what they are together.
Resultant<3> add_traction(const CellProblem& problem, const std::vector<BoundaryPatch>& patches,
                          const TractionCondition<3>& traction, bool where_it_acts, Field& load) {
  Resultant<3> sum;
  for (const BoundaryPatch& patch : patches) {
    const Vec<3> x = where_it_acts ? problem.acting_place(patch) : problem.centroid(patch);
    const Vec<3> t = traction.traction(x, patch.facet_area / patch.area * problem.axes * patch.facet_normal());
    if (!t.allFinite())
      throw InputError(fmt::format("{} on \"{}\" is {} at {}, expected finite numbers", traction.kind, traction.on,
                                   text_of(t), text_of(x)));
    const Vec<3> force = patch.area * t, along = problem.axes.transpose() * force;
    problem.for_corners(patch, [&](const std::array<Index, 3>& node, double weight) {
      for (int c = 0; c < 3; ++c) load[problem.dof(c, node)] += weight * along[c];
      sum.add(problem.place(node), weight * force);
    });
  }
  return sum;
}

}  // namespace

std::vector<AppliedLoad<3>> add_loads(const CellProblem& problem, const Loads<3>& loads, const PartPatches& patches,
                                      Field& to) {
  std::vector<AppliedLoad<3>> applied;
  const auto apply = [&](const TractionCondition<3>& traction, bool where_it_acts) {
    applied.push_back(
        {traction.on, traction.kind, add_traction(problem, patches.at(traction.on), traction, where_it_acts, to)});
  };
  for (const auto& traction : loads.tractions) apply(traction, false);
  for (const auto& load : loads.resultants) {  // where they act, so that moments are exact, too
    AreaMoments<3> part;
    for (const BoundaryPatch& patch : patches.at(load.on)) part.add(problem.acting_place(patch), patch.area);
    apply(part.traction(load), true);
  }
  return applied;
}

}  // namespace internal
}  // namespace efree
