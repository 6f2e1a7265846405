// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_loads.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/box_averages.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <string_view>

namespace efree {
namespace {

constexpr std::array<std::string_view, 6> sides{"left", "right", "front", "back", "bottom", "top"};

}  // namespace

bool is_side(const std::string& name) {
  return std::ranges::find(sides, name) != sides.end();
}

namespace internal {

Side side_named(const std::string& given, const SideNames& names) {
  const auto other = names.find(given);
  const std::string& name = other == names.end() ? given : other->second;
  const auto found = std::ranges::find(sides, name);
  if (found == sides.end())
    throw InputError(
        fmt::format("on cells conditions and loads are on sides of the image (left, right, front, back, bottom, top), "
                    "not on \"{}\"",
                    name));
  const auto s = static_cast<int>(found - sides.begin());
  return {s / 2, s % 2 == 1};
}

std::string text_of(const Vec<3>& x) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", x[0], x[1], x[2]);
}

namespace {

using Triple = std::array<Index, 3>;

/// Calls f(i, j, centre, area of material) for the rectangles of a side that have some.
template <class F>
void for_parts(const CellProblem& problem, const Side& side, const std::vector<float>& parts, const F& f) {
  const int first = side.first(), second = side.second();
  const Triple& n = problem.grid.cells;
  Triple node{};
  node[side.axis] = side.upper ? n[side.axis] : 0;
  for (Index b = 0; b < 2 * n[second]; ++b)
    for (Index a = 0; a < 2 * n[first]; ++a) {
      const double share = parts[a + static_cast<std::size_t>(2 * n[first]) * b];
      if (share == 0.0) continue;
      Vec<3> at = problem.local(node);
      at[first] = 0.5 * (a + 0.5) * problem.edges[first];
      at[second] = 0.5 * (b + 0.5) * problem.edges[second];
      f(a, b, Vec<3>(problem.origin + problem.axes * at), 0.25 * problem.edges[first] * problem.edges[second] * share);
    }
}

/// Adds the work-equivalent forces of a traction, unscaled. Returns what they are together.
Resultant<3> add_traction(const CellProblem& problem, const Side& side, const TractionCondition<3>& traction,
                          const std::vector<float>& parts, Field& load) {
  Resultant<3> sum;
  const Vec<3> normal = (side.upper ? 1.0 : -1.0) * problem.axes.col(side.axis);
  Triple node{};
  node[side.axis] = side.upper ? problem.grid.cells[side.axis] : 0;
  for_parts(problem, side, parts, [&](Index a, Index b, const Vec<3>& at, double area) {
    const Vec<3> t = traction.traction(at, normal);
    if (!t.allFinite())
      throw InputError(fmt::format("{} on \"{}\" is {} at {}, expected finite numbers", traction.kind, traction.on,
                                   text_of(t), text_of(at)));
    for (int corner = 0; corner < 4; ++corner) {
      Triple to = node;
      to[side.first()] = a / 2 + (corner & 1);
      to[side.second()] = b / 2 + (corner >> 1);
      const double weight = ((corner & 1) == (a & 1) ? 0.75 : 0.25) * ((corner >> 1) == (b & 1) ? 0.75 : 0.25);
      const Vec<3> force = weight * area * t, along = problem.axes.transpose() * force;
      for (int c = 0; c < 3; ++c) load[problem.dof(c, to)] += along[c];
      sum.add(problem.place(to), force);
    }
  });
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
    std::vector<float> one(count.label + 1, 0.0F);
    one[count.label] = 1.0F;
    shares.push_back({count.label, box_averages(image, one, {2 * cells[0], 2 * cells[1], 2 * cells[2]})});
  }
  return shares;
}

bool acts(const Loads<3>& loads) {
  return !loads.tractions.empty() || !loads.resultants.empty() || loads.inside();
}

std::vector<AppliedLoad<3>> add_loads(const CellProblem& problem, const Loads<3>& loads, const SideNames& names,
                                      const std::function<const std::vector<float>&(const Side&)>& on_side,
                                      const std::vector<LabelShare>& shares, Field& to) {
  std::vector<AppliedLoad<3>> applied;
  const auto apply = [&](const TractionCondition<3>& traction) {
    const Side side = side_named(traction.on, names);
    applied.push_back({traction.on, traction.kind, add_traction(problem, side, traction, on_side(side), to)});
  };
  for (const auto& traction : loads.tractions) apply(traction);
  for (const auto& load : loads.resultants) {
    const Side side = side_named(load.on, names);
    AreaMoments<3> part;
    for_parts(problem, side, on_side(side), [&](Index, Index, const Vec<3>& at, double area) { part.add(at, area); });
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
