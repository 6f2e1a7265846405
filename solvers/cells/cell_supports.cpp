// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacements and elastic supports on grids of cells.
#include "efree/core/error.hpp"
#include "efree/solvers/cells/internal/cell_loads.hpp"
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <fmt/format.h>
#include <cmath>
#include <span>
#include <utility>

namespace efree::internal {
namespace {

constexpr int off_frame = 6;  // patches on none of the six sides of the frame

/// A node near a part of the boundary, on a side of the frame or `off_frame`.
struct NearNode {
  std::size_t node;
  int side;
  Vec<3> normal;  ///< sum over the part's patches, weighted with their areas
};

/// By node: bit s, whether material ends on side s of the frame within half a cell.
std::vector<std::uint8_t> nodes_near_sides(const CellProblem& problem, const PartPatches& patches) {
  std::vector<std::uint8_t> near(problem.grid.nodes(), 0);
  for (const std::string& name : side_names())
    for (const BoundaryPatch& patch : patches.at(name)) {
      const auto [i, j, k] = patch.node();
      near[problem.grid.node(i, j, k)] |= static_cast<std::uint8_t>(1 << patch.side);
    }
  return near;
}

/// The nodes that a part holds: those within half a cell of it, and on sides of the frame those of the cells where its
/// material ends, if no other is nearer. Ascending by node and side.
std::vector<NearNode> nodes_on(const CellProblem& problem, const std::vector<BoundaryPatch>& patches,
                               const std::vector<std::uint8_t>& near_sides) {
  std::vector<NearNode> nodes;
  const auto add = [&](const std::array<Index, 3>& node, const BoundaryPatch& patch) {
    nodes.push_back({problem.grid.node(node[0], node[1], node[2]), patch.on_frame ? patch.side : off_frame,
                     patch.area * patch.normal});
  };
  for (const BoundaryPatch& patch : patches) {
    add(patch.node(), patch);
    if (!patch.on_frame) continue;
    const int axis = patch.side / 2, first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
    for (int corner = 0; corner < 4; ++corner) {
      std::array<Index, 3> node = patch.cell();
      node[axis] = patch.node()[axis];
      node[first] += corner & 1;
      node[second] += corner >> 1;
      if ((near_sides[problem.grid.node(node[0], node[1], node[2])] >> patch.side & 1) == 0) add(node, patch);
    }
  }
  const auto key = [](const NearNode& at) { return std::pair(at.node, at.side); };
  std::ranges::stable_sort(nodes, {}, key);
  std::size_t last = 0;
  for (std::size_t n = 1; n < nodes.size(); ++n)
    if (key(nodes[last]) == key(nodes[n]))
      nodes[last].normal += nodes[n].normal;
    else
      nodes[++last] = nodes[n];
  if (!nodes.empty()) nodes.resize(last + 1);
  return nodes;
}

double value_at(const Restraint<3>& restraint, const Vec<3>& x) {
  const double value = restraint.value(x);
  if (!std::isfinite(value))
    throw InputError(fmt::format("the displacement prescribed on \"{}\" is {} at {}, expected a finite number",
                                 restraint.on, value, text_of(x)));
  return value;
}

/// The axis of the image that a direction is along; -1: none.
int axis_along(const Vec<3>& direction) {
  for (int c = 0; c < 3; ++c)
    if (std::abs(direction[c]) == 1.0) return c;
  return -1;
}

/// Calls f(nodes) for the entries of each held node.
template <class F> void for_held_nodes(const CellProblem& problem, const F& f) {
  const std::vector<HeldNode>& held = problem.held;
  for (std::size_t begin = 0, end = 0; begin < held.size(); begin = end) {
    while (end < held.size() && held[end].node == held[begin].node) ++end;
    f(std::span(held).subspan(begin, end - begin));
  }
}

/// What all conditions on a node ask of it together: one after the other, each along what the earlier ones leave free.
/// Throws InputError on the `finest` grid if they contradict each other.
ObliqueNode constrain(const CellProblem& problem, std::span<const HeldNode> conditions, bool finest) {
  const Vec<3> x = problem.place(problem.point(conditions.front().node));
  ObliqueNode at{conditions.front().node, Mat<3>::Identity(), Vec<3>::Zero()};
  for (std::size_t n = 0; n < conditions.size(); ++n) {
    const Restraint<3>& restraint = (*problem.restraints)[conditions[n].restraint];
    const Vec<3> direction = problem.direction(conditions[n]);
    const double value = value_at(restraint, x);
    const Vec<3> rest = at.free * direction;
    const double missing = value - at.value.dot(direction), size = rest.norm();
    if (size >= 1e-6) {
      at.value += missing / (size * size) * rest;
      at.free -= rest * rest.transpose() / (size * size);
    } else if (finest && std::abs(missing) > 1e-9 * std::max(std::abs(value), at.value.norm())) {
      const HeldNode& other = *std::ranges::max_element(conditions.first(n), {}, [&](const HeldNode& earlier) {
        return std::abs(problem.direction(earlier).dot(direction));
      });
      throw InputError(fmt::format("displacements prescribed on \"{}\" and \"{}\" contradict each other at {}",
                                   (*problem.restraints)[other.restraint].on, restraint.on, text_of(x)));
    }
  }
  return at;
}

}  // namespace

void hold_nodes(CellProblem& problem, const PartPatches& patches, bool finest) {
  const auto& restraints = *problem.restraints;
  const auto is_rigid = [](const Restraint<3>& restraint) { return !restraint.is_elastic(); };
  if (std::ranges::none_of(restraints, is_rigid)) return;
  const std::vector<std::uint8_t> near_sides = nodes_near_sides(problem, patches);
  for (std::size_t r = 0; r < restraints.size(); ++r) {
    if (!is_rigid(restraints[r])) continue;
    std::size_t last = problem.grid.nodes();
    for (const NearNode& near : nodes_on(problem, patches.at(restraints[r].on), near_sides)) {
      // A component is held once, a plane that slides on each side of the frame.
      if (restraints[r].component >= 0 && near.node == last) continue;
      problem.held.push_back({last = near.node, static_cast<std::uint32_t>(r), near.normal.normalized().cast<float>()});
    }
  }
  std::ranges::stable_sort(problem.held, {}, [](const HeldNode& at) { return std::pair(at.node, at.restraint); });
  const std::size_t nodes = problem.grid.nodes();
  for_held_nodes(problem, [&](std::span<const HeldNode> conditions) {
    const ObliqueNode at = constrain(problem, conditions, finest);
    const auto is_oblique = [&](const HeldNode& of) { return axis_along(problem.direction(of)) < 0; };
    if (at.free.norm() < 1e-9) {  // in all directions, whatever these are
      for (int c = 0; c < 3; ++c) problem.inverse_diagonal.set(c * nodes + at.node, 0.0F);
    } else if (std::ranges::any_of(conditions, is_oblique)) {
      float least = problem.inverse_diagonal[at.node];
      for (int c = 1; c < 3; ++c) least = std::min(least, problem.inverse_diagonal[c * nodes + at.node]);
      for (int c = 0; c < 3; ++c) problem.inverse_diagonal.set(c * nodes + at.node, least);
      problem.oblique.push_back(at);
    } else {
      for (const HeldNode& of : conditions)
        problem.inverse_diagonal.set(axis_along(problem.direction(of)) * nodes + at.node, 0.0F);
    }
  });
}

void CellProblem::set_held(Field& u) const {
  const std::size_t nodes = grid.nodes();
  for_held_nodes(*this, [&](std::span<const HeldNode> conditions) {
    const ObliqueNode at = constrain(*this, conditions, false);
    Vec<3> free;
    for (int c = 0; c < 3; ++c) free[c] = u[c * nodes + at.node];
    free = at.free * free + at.value;
    for (int c = 0; c < 3; ++c) u[c * nodes + at.node] = free[c];
  });
}

Springs make_springs(const CellProblem& problem, const PartPatches& patches, double unit) {
  const auto& restraints = *problem.restraints;
  Springs springs{problem.grid.nodes()};
  for (std::size_t r = 0; r < restraints.size(); ++r) {
    const Restraint<3>& restraint = restraints[r];
    if (!restraint.is_elastic()) continue;
    SupportSprings& support = springs.supports.emplace_back(SupportSprings{r, {}});
    std::vector<Index> place(problem.grid.nodes(), -1);
    for (const BoundaryPatch& patch : patches.at(restraint.on)) {
      const Vec<3> x = problem.centroid(patch);
      const double k = restraint.stiffness(x), value = value_at(restraint, x);
      if (!(k >= 0.0) || !std::isfinite(k))
        throw InputError(fmt::format("the stiffness on \"{}\" is {} at {}, expected a finite number >= 0", restraint.on,
                                     k, text_of(x)));
      const Vec<3> direction = restraint.component < 0 ? Vec<3>(patch.normal.normalized())
                                                       : Vec<3>(problem.axes.row(restraint.component).transpose());
      const double stiffness = k * patch.area / unit;
      problem.for_corners(patch, [&](const std::array<Index, 3>& node, double weight) {
        const std::size_t n = problem.grid.node(node[0], node[1], node[2]);
        if (weight == 0.0) return;
        if (place[n] < 0) {
          place[n] = static_cast<Index>(support.nodes.size());
          support.nodes.push_back({n, Mat<3>::Zero(), Vec<3>::Zero(), 0.0});
        }
        NodeSpring& at = support.nodes[place[n]];
        at.stiffness += weight * stiffness * direction * direction.transpose();
        at.pull += weight * stiffness * value * direction;
        at.stored += 0.5 * weight * stiffness * value * value;
      });
    }
    std::ranges::sort(support.nodes, {}, &NodeSpring::node);
  }
  return springs;
}

}  // namespace efree::internal
