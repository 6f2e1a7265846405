// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/internal/cell_loads.hpp"
#include "efree/solvers/cells/internal/cell_stiffness.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <numeric>
#include <string_view>

namespace efree {
namespace internal {
namespace {

using Triple = std::array<Index, 3>;

std::vector<HeldSide> held_sides(const std::vector<DisplacementCondition<3>>& conditions, const Mat<3>& axes,
                                 const SideNames& names) {
  std::vector<HeldSide> held;
  for (const auto& condition : conditions) {
    if (condition.stiffness) throw InputError("on cells there are no elastic supports");
    const Side side = side_named(condition.on, names);
    for (int c = 0; c < 3; ++c)
      if (condition.components[c]) {
        const Vec<3> direction = axes.row(c).transpose();
        held.push_back({condition.on, side, direction, direction == Vec<3>::Unit(c) ? c : -1, condition.components[c]});
      }
    if (condition.normal)
      held.push_back(
          {condition.on, side, Vec<3>::Unit(side.axis), side.axis,
           [value = condition.normal, sign = side.upper ? 1.0 : -1.0](const Vec<3>& x) { return sign * value(x); }});
  }
  return held;
}

/// Cells of the grids, from fine to coarse: edges of at most `size` on the finest, 6 to 12 cells along each axis on the
/// last, or as many as keep it small; each axis is halved at least twice, as three grids tell the error.
std::vector<Triple> grid_cells(const Vec<3>& lengths, double size) {
  constexpr double few = 2500.0;  // points, which are solved directly
  Triple n;
  std::array<int, 3> halvings;
  double points = 1.0;
  for (int d = 0; d < 3; ++d) {
    const double wanted = std::ceil(lengths[d] / size * (1.0 - 1e-7));
    halvings[d] = std::max(2, static_cast<int>(std::floor(std::log2(std::max(wanted, 1.0) / 6.0))));
    const double whole = std::ceil(wanted / std::pow(2.0, halvings[d])) * std::pow(2.0, halvings[d]);
    points *= whole + 1.0 + (d == 0 ? 1.5 * CellGrid::lanes : 0.0);
    n[d] = static_cast<Index>(std::min(whole, 1e9));
  }
  require_memory(cell_memory * points, fmt::format("a grid of {} x {} x {} cells", n[0], n[1], n[2]),
                 "use larger cells (mesh_size)");
  std::vector<Triple> cells{n};
  const auto size_of = [](const Triple& c) { return (c[0] + 1.0) * (c[1] + 1.0) * (c[2] + 1.0); };
  while (cells.size() < 3 || size_of(cells.back()) > few) {
    bool any = false;
    for (int d = 0; d < 3; ++d)
      if (halvings[d]-- > 0) {
        n[d] /= 2;
        any = true;
      }
    if (!any) break;
    cells.push_back(n);
  }
  return cells;
}

/// Nodes of a side that material reaches, from its parts in the side's rectangles.
std::vector<char> reached_nodes(const CellProblem& problem, const Side& side, const std::vector<float>& parts) {
  const Index a = problem.grid.cells[side.first()], b = problem.grid.cells[side.second()];
  std::vector<char> reached(static_cast<std::size_t>(a + 1) * (b + 1), 0);
  for (Index j = 0; j < 2 * b; ++j)
    for (Index i = 0; i < 2 * a; ++i)
      if (parts[i + static_cast<std::size_t>(2 * a) * j] > 0.0F)
        for (int c = 0; c < 4; ++c) reached[i / 2 + (c & 1) + static_cast<std::size_t>(a + 1) * (j / 2 + (c >> 1))] = 1;
  return reached;
}

[[noreturn]] void throw_contradiction(const std::string& one, const std::string& other, const Vec<3>& at) {
  throw InputError(fmt::format("displacements prescribed on \"{}\" and \"{}\" contradict each other at {}", one, other,
                               text_of(at)));
}

double value_at(const HeldSide& held, const Vec<3>& x) {
  const double value = held.value(x);
  if (!std::isfinite(value))
    throw InputError(fmt::format("the displacement prescribed on \"{}\" is {} at {}, expected a finite number", held.on,
                                 value, text_of(x)));
  return value;
}

/// Finds the nodes that some condition holds in a direction that is no axis of the image, and what all conditions
/// together ask of them. Throws InputError if these contradict each other.
void hold_obliquely(CellProblem& problem) {
  const std::vector<HeldSide>& held = *problem.held;
  std::map<std::size_t, std::pair<Triple, std::vector<const HeldSide*>>> conditions;
  for (std::size_t h = 0; h < held.size(); ++h)
    if (held[h].component < 0)
      problem.for_held(h, [&](const Triple& node) {
        conditions[problem.grid.node(node[0], node[1], node[2])] = {node, {}};
      });
  if (conditions.empty()) return;
  for (std::size_t h = 0; h < held.size(); ++h)
    problem.for_held(h, [&](const Triple& node) {
      const auto found = conditions.find(problem.grid.node(node[0], node[1], node[2]));
      if (found != conditions.end()) found->second.second.push_back(&held[h]);
    });
  for (const auto& [node, of] : conditions) {
    const auto& [place, all] = of;
    const Vec<3> x = problem.place(place);
    ObliqueNode at{node, Mat<3>::Identity(), Vec<3>::Zero()};
    for (const HeldSide* condition : all) {
      const double value = value_at(*condition, x);
      const Vec<3> rest = at.free * condition->direction;
      const double missing = value - at.value.dot(condition->direction), size = rest.norm();
      if (size < 1e-6) {
        if (std::abs(missing) > 1e-9 * std::max(std::abs(value), at.value.norm()))
          throw_contradiction(all.front()->on, condition->on, x);
        continue;
      }
      at.value += missing / (size * size) * rest;
      at.free -= rest * rest.transpose() / (size * size);
    }
    problem.oblique.push_back(at);
    std::array<float, 3> inverse;
    for (int c = 0; c < 3; ++c) inverse[c] = problem.inverse_diagonal[c * problem.grid.nodes() + node];
    for (int c = 0; c < 3; ++c)
      problem.inverse_diagonal[c * problem.grid.nodes() + node] = *std::ranges::min_element(inverse);
  }
}

/// Throws InputError if two sides ask for different displacements of a node they share, along an axis of the image.
void require_agreement(const CellProblem& problem) {
  const std::vector<HeldSide>& held = *problem.held;
  for (std::size_t a = 0; a < held.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) {
      if (held[a].component != held[b].component || held[a].component < 0) continue;
      const Side& side = held[b].side;
      if (side.axis == held[a].side.axis && side.upper != held[a].side.upper) continue;
      const Index there = side.upper ? problem.grid.cells[side.axis] : 0;
      problem.for_held(a, [&](const Triple& node) {
        if (node[side.axis] != there) return;
        const Vec<3> x = problem.place(node);
        const double one = held[a].value(x), other = held[b].value(x);
        if (std::abs(one - other) > 1e-9 * std::max(std::abs(one), std::abs(other)))
          throw_contradiction(held[b].on, held[a].on, x);
      });
    }
}

/// Throws InputError naming the place of a body that is loaded, but not held against the motion its loads ask for, and
/// of the largest one if it has to be `held` but may move. Bodies are cells with a point in common.
void require_held(const CellProblem& problem, bool largest_is_held) {
  Index most_cells = 0;
  std::optional<Vec<3>> free;  // place of the largest body, if that may move
  const CellGrid& grid = problem.grid;
  const auto& n = grid.cells;
  const auto index = [&](Index i, Index j, Index k) {
    return i + static_cast<std::size_t>(n[0]) * (j + static_cast<std::size_t>(n[1]) * k);
  };
  const auto for_cells = [&](const std::array<Index, 3>& low, const std::array<Index, 3>& high, const auto& f) {
    for (Index k = std::max(low[2], 0); k <= std::min(high[2], n[2] - 1); ++k)
      for (Index j = std::max(low[1], 0); j <= std::min(high[1], n[1] - 1); ++j)
        for (Index i = std::max(low[0], 0); i <= std::min(high[0], n[0] - 1); ++i) f(i, j, k);
  };
  std::vector<char> waiting(static_cast<std::size_t>(n[0]) * n[1] * n[2]), seen(grid.nodes(), 0);
  for_cells({0, 0, 0}, n, [&](Index i, Index j, Index k) {
    for (int q = 0; q < 8; ++q) waiting[index(i, j, k)] |= grid.weight(i, j, k, q) > 0.0F;
  });
  using Motion = Eigen::Matrix<double, 6, 1>;  // translations and rotations
  const std::size_t cases = problem.loads.size();
  const Vec<3> middle = problem.local({n[0] / 2, n[1] / 2, n[2] / 2});
  const double length = problem.edges.cwiseProduct(Vec<3>(n[0], n[1], n[2])).norm();
  std::vector<std::array<Index, 3>> front;
  const auto add_load = [&](std::vector<Motion>& to, std::size_t dof, const Motion& motion) {
    for (std::size_t k = 0; k < cases; ++k)
      if (!problem.loads[k].empty()) to[k] += problem.loads[k][dof] * motion;
  };
  for_cells({0, 0, 0}, n, [&](Index i0, Index j0, Index k0) {
    if (!waiting[index(i0, j0, k0)]) return;
    Eigen::Matrix<double, 6, 6> held = Eigen::Matrix<double, 6, 6>::Zero();
    std::vector<Motion> load(cases, Motion::Zero());
    std::vector<double> forces(cases, 0.0);
    Index cells = 0;
    front.assign(1, {i0, j0, k0});
    waiting[index(i0, j0, k0)] = 0;
    while (!front.empty()) {
      const auto [i, j, k] = front.back();
      front.pop_back();
      ++cells;
      for (int a = 0; a < 8; ++a) {
        const Index x = i + (a & 1), y = j + (a >> 1 & 1), z = k + (a >> 2);
        const std::size_t node = grid.node(x, y, z);
        if (seen[node]) continue;
        seen[node] = 1;
        const Vec<3> arm = (problem.local({x, y, z}) - middle) / length;
        const auto motion_in = [&](const Vec<3>& direction) {
          Motion motion;
          motion << direction, arm.cross(direction);
          return motion;
        };
        const ObliqueNode* at = problem.find_oblique(node);
        for (int c = 0; c < 3; ++c) {
          const std::size_t dof = c * grid.nodes() + node;
          const Vec<3> axis = Vec<3>::Unit(c);
          if (at != nullptr) {
            const Motion of_held = motion_in(axis - at->free * axis);
            held += of_held * of_held.transpose();
            add_load(load, dof, motion_in(at->free * axis));
          } else if (problem.inverse_diagonal[dof] == 0.0F) {
            held += motion_in(axis) * motion_in(axis).transpose();
          } else {
            add_load(load, dof, motion_in(axis));
          }
          for (std::size_t of = 0; of < cases; ++of)
            if (!problem.loads[of].empty()) forces[of] += std::abs(problem.loads[of][dof]);
        }
      }
      for_cells({i - 1, j - 1, k - 1}, {i + 1, j + 1, k + 1}, [&](Index a, Index b, Index c) {
        if (!waiting[index(a, b, c)]) return;
        waiting[index(a, b, c)] = 0;
        front.push_back({a, b, c});
      });
    }
    const auto [stiffness, motions] = internal::spectrum<6>(held);
    const double rounding = 1e-9 * std::max(1.0, held.trace());
    if (cells > most_cells) {
      most_cells = cells;
      free.reset();
      if (stiffness[0] < rounding) free = problem.place({i0, j0, k0});
    }
    for (int m = 0; m < 6; ++m)
      for (std::size_t of = 0; of < cases; ++of)
        if (stiffness[m] < rounding && std::abs(motions.col(m).dot(load[of])) > 1e-6 * forces[of])
          throw InputError(
              fmt::format("the body at {} is loaded, but free to move: prescribe displacements that hold it",
                          text_of(problem.place({i0, j0, k0}))));
  });
  if (largest_is_held && free)
    throw InputError(fmt::format(
        "underconstrained: the body at {} is free to move; prescribe displacements that hold it", text_of(*free)));
}

}  // namespace

void CellProblem::set_held(Field& u) const {
  for (std::size_t condition = 0; condition < held->size(); ++condition) {
    const HeldSide& h = (*held)[condition];
    if (h.component < 0) continue;
    for_held(condition, [&](const Triple& node) { u[dof(h.component, node)] = value_at(h, place(node)); });
  }
  project(u);
  for (const ObliqueNode& at : oblique)
    for (int c = 0; c < 3; ++c) u[c * grid.nodes() + at.node] += at.value[c];
}

Index CellProblem::num_cells() const {
  std::vector<Index> of_layer(grid.cells[2], 0);
  parallel_chunks(grid.cells[2], 4, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j < grid.cells[1]; ++j)
        for (Index i = 0; i < grid.cells[0]; ++i) {
          bool some = false;
          for (int q = 0; q < 8; ++q) some = some || grid.weight(i, j, k, q) > 0.0F;
          of_layer[k] += some;
        }
  });
  return std::accumulate(of_layer.begin(), of_layer.end(), Index(0));
}

CellProblems make_cell_problems(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                const std::vector<DisplacementCondition<3>>& conditions,
                                const std::vector<Loads<3>>& cases, const CellOptions& options) {
  check_image(image);
  if (!(options.size >= 0.0)) throw InputError(fmt::format("the size of cells is {}, expected > 0", options.size));
  Vec<3> lengths;
  for (int d = 0; d < 3; ++d) lengths[d] = image.size[d] * image.spacing[d];
  const std::vector<Triple> cells =
      grid_cells(lengths, options.size > 0.0 ? options.size : 2.0 * image.spacing.maxCoeff());
  LabelStiffness stiffness(image, materials);
  const double unit_length = lengths.cwiseQuotient(Vec<3>(cells[0][0], cells[0][1], cells[0][2])).maxCoeff();

  CellProblems problems{held_sides(conditions, image.axes, options.sides),
                        {},
                        stiffness.unit * unit_length,
                        std::vector<std::vector<AppliedLoad<3>>>(cases.size()),
                        {}};
  std::vector<LabelShare> shares;
  if (std::ranges::any_of(cases, &Loads<3>::inside)) shares = label_shares(image, cells[0]);
  Parts parts = parts_of(image, stiffness, cells[0], 0.0);
  if (!stiffness.varying.empty()) stiffness.widen_ratios(parts);
  CellEigenvalues eigenvalues{};
  for (std::size_t l = 0; l < cells.size(); ++l) {
    const Triple& n = cells[l];
    std::array<int, 3> ratio{1, 1, 1};
    if (l > 0) {
      for (int d = 0; d < 3; ++d) ratio[d] = cells[l - 1][d] / n[d];
      parts = {halved(parts.shear, cells[l - 1], ratio), halved(parts.across, cells[l - 1], ratio)};
    }
    const Vec<3> edges = lengths.cwiseQuotient(Vec<3>(n[0], n[1], n[2]));
    if (l == 0 || ratio[0] != ratio[1] || ratio[1] != ratio[2])
      eigenvalues = largest_eigenvalues(edges / unit_length, stiffness.least_ratio, stiffness.most_ratio);
    if (options.half_voxel && l == std::min<std::size_t>(1, cells.size() - 1)) {
      const Parts less = parts_of(image, stiffness, n, -0.5);
      problems.shrunk.emplace(n, edges / unit_length, less.shear, less.across);
    }
    problems.grids.push_back(
        std::make_unique<CellProblem>(CellProblem{CellGrid(n, edges / unit_length, parts.shear, parts.across),
                                                  image.origin,
                                                  edges,
                                                  image.axes,
                                                  ratio,
                                                  &problems.held,
                                                  {},
                                                  {},
                                                  {},
                                                  {}}));
    CellProblem& problem = *problems.grids.back();
    std::array<std::vector<float>, 6> sides;  // material in their rectangles, of those that are asked for
    const auto on_side = [&](const Side& side) -> const std::vector<float>& {
      std::vector<float>& averages = sides[2 * side.axis + side.upper];
      if (averages.empty())
        averages = side_averages(image, stiffness.solid, {2 * n[0], 2 * n[1], 2 * n[2]}, side.axis, side.upper);
      return averages;
    };
    for (const HeldSide& held : problems.held)
      problem.reached.push_back(reached_nodes(problem, held.side, on_side(held.side)));
    problem.inverse_diagonal = problem.grid.bound(eigenvalues);
    for_all(problem.inverse_diagonal.size(), [&](std::size_t i) {
      float& d = problem.inverse_diagonal[i];
      d = d > 0.0F ? 1.0F / d : 0.0F;
    });
    hold_obliquely(problem);
    for (std::size_t condition = 0; condition < problems.held.size(); ++condition)
      if (const int component = problems.held[condition].component; component >= 0)
        problem.for_held(condition, [&](const Triple& node) {
          if (problem.find_oblique(problem.grid.node(node[0], node[1], node[2])) == nullptr)
            problem.inverse_diagonal[problem.dof(component, node)] = 0.0F;
        });
    if (l > 0)
      for (LabelShare& share : shares) share.part = halved(share.part, cells[l - 1], ratio);
    for (std::size_t c = 0; c < cases.size(); ++c) {
      Field& load = problem.loads.emplace_back();
      if (!acts(cases[c])) continue;
      load = zeros<double>(problem.grid.size());
      auto applied = add_loads(problem, cases[c], options.sides, on_side, shares, load);
      if (l == 0) problems.applied[c] = std::move(applied);
      for_all(load.size(), [&](std::size_t i) { load[i] /= problems.unit; });
    }
    if (l > 0) continue;
    require_agreement(problem);
    if (options.held || std::ranges::any_of(cases, acts)) require_held(problem, options.held);
  }
  return problems;
}

}  // namespace internal
}  // namespace efree
