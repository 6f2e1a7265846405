// SPDX-License-Identifier: GPL-3.0-or-later
/// Whether what an image shows is held.
#include "efree/assembly/internal/rigid_motions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/solvers/cells/internal/cell_loads.hpp"
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>

namespace efree::internal {
namespace {

/// The bodies on a grid: cells with material that have a point in common, as runs along its rows, which are joined
/// where those of neighbouring rows touch (Rosenfeld & Pfaltz 1966).
class CellBodies {
 public:
  struct Run {
    Index begin, end;  ///< cells
    Index body;        ///< the number of its first run
  };

  explicit CellBodies(const CellGrid& grid) : cells_(grid.cells) {
    const Index rows = cells_[1] * cells_[2];
    std::vector<std::vector<Run>> of_row(rows);
    parallel_chunks(rows, cells_[1], [&](Index first, Index last) {
      for (Index row = first; row < last; ++row)
        for (Index i = 0; i < cells_[0]; ++i) {
          if (!grid.has_material(i, row % cells_[1], row / cells_[1])) continue;
          std::vector<Run>& runs = of_row[row];
          if (runs.empty() || runs.back().end < i) runs.push_back({i, i, 0});
          runs.back().end = i + 1;
        }
    });
    for (const auto& runs : of_row) {
      first_.push_back(runs_.size());
      runs_.insert(runs_.end(), runs.begin(), runs.end());
    }
    first_.push_back(runs_.size());
    join();
  }

  /// Cells by body; 0 for what is not the first run of one.
  std::vector<std::int64_t> sizes() const {
    std::vector<std::int64_t> cells(runs_.size(), 0);
    for (const Run& run : runs_) cells[run.body] += run.end - run.begin;
    return cells;
  }
  /// Of a cell; -1 if that is void.
  Index body_of(const std::array<Index, 3>& cell) const {
    const std::size_t row = cell[1] + static_cast<std::size_t>(cells_[1]) * cell[2];
    for (std::size_t r = first_[row]; r < first_[row + 1]; ++r)
      if (cell[0] >= runs_[r].begin && cell[0] < runs_[r].end) return runs_[r].body;
    return -1;
  }
  /// A cell of a body.
  std::array<Index, 3> cell_of(Index body) const {
    const auto row =
        static_cast<Index>(std::ranges::upper_bound(first_, static_cast<std::size_t>(body)) - first_.begin() - 1);
    return {runs_[body].begin, row % cells_[1], row / cells_[1]};
  }

  /// Calls f(i, body) for all points of a row that have material around them.
  template <class F> void for_points(Index j, Index k, const F& f) const {
    std::array<const Run*, 4> at, end;
    int rows = 0;
    for (Index z = std::max(k - 1, 0); z <= std::min(k, cells_[2] - 1); ++z)
      for (Index y = std::max(j - 1, 0); y <= std::min(j, cells_[1] - 1); ++y, ++rows) {
        const std::size_t row = y + static_cast<std::size_t>(cells_[1]) * z;
        at[rows] = runs_.data() + first_[row];
        end[rows] = runs_.data() + first_[row + 1];
      }
    for (Index i = 0; i <= cells_[0]; ++i)
      for (int r = 0; r < rows; ++r) {
        while (at[r] != end[r] && at[r]->end < i) ++at[r];
        if (at[r] == end[r] || at[r]->begin > i) continue;
        f(i, at[r]->body);
        break;
      }
  }

 private:
  void join() {
    DisjointSets sets(static_cast<Index>(runs_.size()));
    for (Index k = 0; k < cells_[2]; ++k)
      for (Index j = 0; j < cells_[1]; ++j)
        for (const auto& [dj, dk] : {std::pair(-1, 0), std::pair(-1, -1), std::pair(0, -1), std::pair(1, -1)}) {
          if (j + dj < 0 || j + dj >= cells_[1] || k + dk < 0) continue;
          const std::size_t row = j + static_cast<std::size_t>(cells_[1]) * k,
                            other = j + dj + static_cast<std::size_t>(cells_[1]) * (k + dk);
          for (std::size_t a = first_[other], b = first_[row]; a < first_[other + 1] && b < first_[row + 1];) {
            if (runs_[a].begin <= runs_[b].end && runs_[b].begin <= runs_[a].end)
              sets.join(static_cast<Index>(a), static_cast<Index>(b));
            runs_[a].end < runs_[b].end ? ++a : ++b;
          }
        }
    const std::vector<Index> firsts = std::move(sets).firsts();
    for (std::size_t r = 0; r < runs_.size(); ++r) runs_[r].body = firsts[r];
  }

  std::array<Index, 3> cells_;
  std::vector<Run> runs_;
  std::vector<std::size_t> first_;  ///< run, by row, and the end
};

/// What holds and loads a body as a whole, about the middle of the grid.
struct BodyConditions {
  Eigen::Matrix<double, 6, 6> held = Eigen::Matrix<double, 6, 6>::Zero();
  std::vector<Motion<3>> load;  ///< by case
  std::vector<double> forces;   ///< likewise, the sum of their components' absolute values

  explicit BodyConditions(std::size_t cases) : load(cases, Motion<3>::Zero()), forces(cases, 0.0) {}
  void add(const BodyConditions& other) {
    held += other.held;
    for (std::size_t k = 0; k < load.size(); ++k) load[k] += other.load[k];
    for (std::size_t k = 0; k < load.size(); ++k) forces[k] += other.forces[k];
  }
};
using ConditionsByBody = std::map<Index, BodyConditions>;

/// By body, of those that something holds or loads.
ConditionsByBody conditions_by_body(const CellProblem& problem, const CellBodies& bodies, const Vec<3>& middle,
                                    double length) {
  const CellGrid& grid = problem.grid;
  const std::size_t cases = problem.loads.size();
  std::vector<ConditionsByBody> of_layer(grid.cells[2] + 1);
  parallel_chunks(grid.cells[2] + 1, 1, [&](Index k, Index) {
    const auto add_point = [&](Index i, Index j, std::size_t node, Index body) {
      const Mat<3> spring = problem.springs.stiffness_at(node);
      const bool has_spring = !spring.isZero(0.0);
      bool holds_or_loads = has_spring;
      for (int c = 0; c < 3; ++c) {
        const std::size_t dof = c * grid.nodes() + node;
        holds_or_loads = holds_or_loads || !problem.is_free(dof);
        for (const Field& load : problem.loads) holds_or_loads = holds_or_loads || (!load.empty() && load[dof] != 0.0);
      }
      const ObliqueNode* oblique = problem.find_oblique(node);
      if (!holds_or_loads && oblique == nullptr) return;
      BodyConditions& of_body = of_layer[k].try_emplace(body, cases).first->second;
      const Vec<3> arm = problem.axes * (problem.local({i, j, k}) - middle);
      const auto motion_in = [&](const Vec<3>& direction) {
        return motion_along<3>(problem.axes * direction, arm, length);
      };
      if (has_spring) {
        Eigen::Matrix<double, 6, 3> motions;
        for (int c = 0; c < 3; ++c) motions.col(c) = motion_in(Vec<3>::Unit(c));
        of_body.held += motions * spring / spring.trace() * motions.transpose();
      }
      for (int c = 0; c < 3; ++c) {
        const std::size_t dof = c * grid.nodes() + node;
        Vec<3> free = Vec<3>::Unit(c);
        if (oblique != nullptr) free = oblique->free * free;
        if (!problem.is_free(dof)) free.setZero();
        const Motion<3> held = motion_in(Vec<3>::Unit(c) - free);
        of_body.held += held * held.transpose();
        for (std::size_t of = 0; of < cases; ++of) {
          if (problem.loads[of].empty()) continue;
          of_body.load[of] += problem.loads[of][dof] * motion_in(free);
          of_body.forces[of] += std::abs(problem.loads[of][dof]);
        }
      }
    };
    for (Index j = 0; j <= grid.cells[1]; ++j)
      bodies.for_points(j, k, [&](Index i, Index body) { add_point(i, j, grid.node(i, j, k), body); });
  });
  ConditionsByBody all;
  for (const ConditionsByBody& layer : of_layer)
    for (const auto& [body, of_body] : layer) all.try_emplace(body, cases).first->second.add(of_body);
  return all;
}

/// How many motions as a whole nothing holds, of their spectrum.
int free_motions(const BodyConditions& body, const Eigen::Matrix<double, 6, 1>& stiffness) {
  return static_cast<int>((stiffness.array() < 1e-9 * std::max(1.0, body.held.trace())).count());
}

/// Throws FreeBody for a body that is loaded but may move, and the `largest`, if it is one, that may move.
void require_held(const CellProblem& problem, const CellBodies& bodies, const ConditionsByBody& all, Index largest,
                  const Vec<3>& middle, double length) {
  for (const auto& [body, of_body] : all) {
    const auto [stiffness, motions] = spectrum<6>(of_body.held);
    const int free = free_motions(of_body, stiffness);
    const auto names = [&] {
      return fmt::format(
          "{}",
          fmt::join(motion_names<3>(motions.leftCols(free), problem.origin + problem.axes * middle, length), ", "));
    };
    if (body == largest && free > 0)
      throw FreeBody(
          fmt::format("underconstrained: the body at {} is free to move ({}); prescribe displacements that hold it, "
                      "and on parts that are "
                      "smaller than two cells take a smaller mesh_size",
                      text_of(problem.place(bodies.cell_of(body))), names()));
    for (int m = 0; m < free; ++m)
      for (std::size_t k = 0; k < of_body.load.size(); ++k)
        if (std::abs(motions.col(m).dot(of_body.load[k])) > 1e-6 * of_body.forces[k])
          throw FreeBody(
              fmt::format("the body at {} is loaded, but free to move ({}): prescribe displacements that hold it",
                          text_of(problem.place(bodies.cell_of(body))), names()));
  }
}
/// Takes the bodies without conditions out of the unknowns.
void leave_out(CellProblem& problem, const CellBodies& bodies, const ConditionsByBody& conditions,
               const std::vector<std::int64_t>& sizes, BodiesOnGrid& found) {
  std::int64_t all = 0, out = 0, most = 0;
  for (std::size_t body = 0; body < sizes.size(); ++body) {
    all += sizes[body];
    if (sizes[body] == 0 || conditions.contains(static_cast<Index>(body))) continue;
    ++found.left_out;
    out += sizes[body];
    if (sizes[body] > most) {
      most = sizes[body];
      found.left_out_at = problem.place(bodies.cell_of(static_cast<Index>(body)));
    }
  }
  if (found.left_out == 0) return;
  found.left_out_part = static_cast<double>(out) / static_cast<double>(all);
  const CellGrid& grid = problem.grid;
  parallel_chunks(grid.cells[2] + 1, 1, [&](Index k, Index) {
    for (Index j = 0; j <= grid.cells[1]; ++j)
      bodies.for_points(j, k, [&](Index i, Index body) {
        if (conditions.contains(body)) return;
        for (int c = 0; c < 3; ++c) problem.inverse_diagonal.set(c * grid.nodes() + grid.node(i, j, k), 0.0F);
      });
  });
}

/// Bodies of voxels that are one on the grid.
void find_joined(const CellProblem& problem, const CellBodies& bodies, const LabelImage<3>& image,
                 BodiesOnGrid& found) {
  constexpr double least = 0.01;  // of the largest
  const std::vector<PixelBody> of_voxels = pixel_bodies(image);
  if (of_voxels.size() < 2) return;
  const double largest = static_cast<double>(std::ranges::max_element(of_voxels, {}, &PixelBody::pixels)->pixels);
  std::map<Index, int> on_grid;
  for (const PixelBody& body : of_voxels) {
    if (static_cast<double>(body.pixels) < least * largest) continue;
    std::array<Index, 3> cell;
    Vec<3> middle;
    std::size_t voxel = body.first;
    for (int d = 0; d < 3; voxel /= image.size[d++]) {
      middle[d] = static_cast<double>(voxel % image.size[d]) + 0.5;
      cell[d] = static_cast<Index>(middle[d] * problem.grid.cells[d] / image.size[d]);
    }
    const Index there = bodies.body_of(cell);
    if (there < 0 || ++on_grid[there] == 1) continue;
    ++found.joined;
    found.joined_at = image.in_world(image.origin + middle.cwiseProduct(image.spacing));
  }
}

}  // namespace

BodiesOnGrid examine_bodies(CellProblem& problem, const LabelImage<3>& image, bool finest, bool largest_is_held) {
  const CellBodies bodies(problem.grid);
  const std::vector<std::int64_t> sizes = bodies.sizes();
  BodiesOnGrid found;
  if (sizes.empty()) return found;
  const auto& n = problem.grid.cells;
  const Vec<3> middle = problem.local({n[0] / 2, n[1] / 2, n[2] / 2});
  const double length = problem.local(n).norm();
  ConditionsByBody all = conditions_by_body(problem, bodies, middle, length);
  const auto largest = static_cast<Index>(std::ranges::max_element(sizes) - sizes.begin());
  if (finest) {
    if (largest_is_held) all.try_emplace(largest, problem.loads.size());
    require_held(problem, bodies, all, largest_is_held ? largest : -1, middle, length);
    find_joined(problem, bodies, image, found);
  }
  if (const auto conditions = all.find(largest); conditions != all.end())
    found.free_motions = free_motions(conditions->second, eigenvalues<6>(conditions->second.held));
  leave_out(problem, bodies, all, sizes, found);
  return found;
}

}  // namespace efree::internal
