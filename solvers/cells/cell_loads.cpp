// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_loads.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

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

using Triple = std::array<Index, 3>;

/// Adds the work-equivalent forces of a traction, unscaled. Returns what they are together.
Resultant<3> add_traction(const CellProblem& problem, const std::vector<BoundaryPatch>& patches,
                          const TractionCondition<3>& traction, Field& load) {
  Resultant<3> sum;
  for (const BoundaryPatch& patch : patches) {
    const Vec<3> x = problem.centroid(patch);
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

/// Calls f(centre, volume of material, corners' lowest node, octant) for the octants that have some of a label.
template <class F> void for_octants(const CellProblem& problem, const LabelShare& share, const F& f) {
  const Triple& n = problem.grid.cells;
  const double octant = problem.edges.prod() / 8.0;
  std::size_t at = 0;
  for (Index k = 0; k < 2 * n[2]; ++k)
    for (Index j = 0; j < 2 * n[1]; ++j)
      for (Index i = 0; i < 2 * n[0]; ++i, ++at)
        if (share.part[at] > 0.0F) {
          const Vec<3> local = 0.5 * problem.edges.cwiseProduct(Vec<3>(i + 0.5, j + 0.5, k + 0.5));
          f(Vec<3>(problem.origin + problem.axes * local), octant * static_cast<double>(share.part[at]),
            Triple{i / 2, j / 2, k / 2}, (i & 1) + 2 * (j & 1) + 4 * (k & 1));
        }
}

/// Adds forces by volume in the body, unscaled. Returns what they are together.
template <class Force> Resultant<3> add_body_load(const CellProblem& problem, const std::vector<LabelShare>& shares,
                                                  const std::string& kind, const Force& force, Field& to) {
  Resultant<3> sum;
  for (const LabelShare& share : shares)
    for_octants(problem, share, [&](const Vec<3>& x, double volume, const Triple& cell, int octant) {
      const Vec<3> density = force(share.label, x);
      if (!density.allFinite())
        throw InputError(fmt::format("{} is {} at {}, expected finite numbers", kind, text_of(density), text_of(x)));
      for (int a = 0; a < 8; ++a) {
        double weight = volume;
        Triple node = cell;
        for (int d = 0; d < 3; ++d) {
          node[d] += a >> d & 1;
          weight *= (a >> d & 1) == (octant >> d & 1) ? 0.75 : 0.25;
        }
        const Vec<3> at_node = weight * density, along = problem.axes.transpose() * at_node;
        for (int c = 0; c < 3; ++c) to[problem.dof(c, node)] += along[c];
        sum.add(problem.place(node), at_node);
      }
    });
  return sum;
}

}  // namespace

std::vector<LabelShare> label_shares(const LabelImage<3>& image, const std::array<Index, 3>& cells) {
  std::vector<LabelShare> shares;
  for (const LabelCount& count : count_labels(image)) {
    if (count.label == 0) continue;
    const std::array<Index, 3> boxes{2 * cells[0], 2 * cells[1], 2 * cells[2]};
    shares.push_back({count.label, part_of_label(image, count.label, boxes).layers(0, boxes[2])});
  }
  return shares;
}

bool acts(const Loads<3>& loads) {
  return !loads.tractions.empty() || !loads.resultants.empty() || loads.inside();
}

std::vector<AppliedLoad<3>> add_loads(const CellProblem& problem, const Loads<3>& loads, const PartPatches& patches,
                                      const std::vector<LabelShare>& shares, Field& to) {
  std::vector<AppliedLoad<3>> applied;
  const auto apply = [&](const TractionCondition<3>& traction) {
    applied.push_back({traction.on, traction.kind, add_traction(problem, patches.at(traction.on), traction, to)});
  };
  for (const auto& traction : loads.tractions) apply(traction);
  for (const auto& load : loads.resultants) {
    AreaMoments<3> part;
    for (const BoundaryPatch& patch : patches.at(load.on)) part.add(problem.centroid(patch), patch.area);
    apply(part.traction(load));
  }
  if (loads.body_force)
    applied.push_back(
        {"", "body_force",
         add_body_load(
             problem, shares, "body_force", [&](Label, const Vec<3>& x) { return loads.body_force(x); }, to)});
  for (const MassForce<3>& load : loads.mass_forces)
    applied.push_back({"", load.kind,
                       add_body_load(
                           problem, shares, load.kind,
                           [&](Label label, const Vec<3>& x) -> Vec<3> {
                             if (label >= loads.density.size())
                               throw InputError(fmt::format("{} needs the density of label {}", load.kind, label));
                             return loads.density[label].at(x) * load.per_mass(x);
                           },
                           to)});
  return applied;
}

}  // namespace internal
}  // namespace efree
