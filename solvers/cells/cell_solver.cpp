// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_solver.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/cells/internal/cell_errors.hpp"
#include "efree/solvers/cells/internal/cell_problem.hpp"
#include "efree/solvers/cells/internal/grid_iterations.hpp"
#include "efree/solvers/cells/internal/interface_energy.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

using internal::CellProblem, internal::CellProblems, internal::Field, internal::GridLevel, internal::Iterated,
    internal::Multigrid;
using internal::dot, internal::for_all, internal::zeros;

/// Energies and reactions of what the iterations found, in scaled units.
CellLevel level_of(const CellProblem& problem, const Field& load, const Iterated& iterated, const Field& u) {
  CellLevel found{.edges = problem.edges,
                  .cells = problem.num_cells(),
                  .iterations = iterated.iterations,
                  .iteration_error = iterated.error};
  Field Ku(u.size());
  problem.grid.apply(u.data(), Ku.data(), problem.dilatation());
  const double of_body = dot(u, Ku);
  problem.springs.add_to(u.data(), Ku.data());
  const double energy = dot(u, Ku);
  if (!std::isfinite(energy)) throw NumericalError("the strain energy on cells is not finite");
  if (energy > internal::rounding_energy(problem, u)) {
    found.strain_energy = 0.5 * of_body;
    found.support_energy = problem.springs.energy(u.data());
    found.potential = 0.5 * energy;
  }
  if (!load.empty()) {
    found.potential -= dot(u, load);
    for_all(u.size(), [&](std::size_t i) { Ku[i] -= load[i]; });
  }
  found.reactions = problem.reactions(u, Ku);
  return found;
}

/// The displacement at the points of the grid, the first axis fastest.
Points<3> at_points(const CellProblem& problem, const Field& u) {
  const auto& n = problem.grid.cells;
  Points<3> displacement(3, static_cast<Eigen::Index>(n[0] + 1) * (n[1] + 1) * (n[2] + 1));
  const bool turned = !problem.axes.isIdentity(0.0);
  parallel_chunks(n[2] + 1, 4, [&](Index begin, Index end) {
    Eigen::Index point = static_cast<Eigen::Index>(begin) * (n[0] + 1) * (n[1] + 1);
    for (Index k = begin; k < end; ++k)
      for (Index j = 0; j <= n[1]; ++j)
        for (Index i = 0; i <= n[0]; ++i, ++point) {
          Vec<3> at;
          for (int c = 0; c < 3; ++c) at[c] = u[problem.dof(c, {i, j, k})];
          displacement.col(point) = turned ? Vec<3>(problem.axes * at) : at;
        }
  });
  return displacement;
}

}  // namespace

std::vector<CellSolution> solve_cases_on_cells(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                               const std::vector<DisplacementCondition<3>>& conditions,
                                               const std::vector<Loads<3>>& cases, const CellOptions& options,
                                               const Monitor& monitor) {
  const CellProblems problems = [&] {
    const Stage stage("assembly", monitor);
    return internal::make_cell_problems(image, materials, conditions, cases, options);
  }();
  const Stage stage("solve", monitor);
  std::vector<const GridLevel*> grids;
  for (const auto& problem : problems.grids) grids.push_back(problem.get());
  Multigrid precondition(grids, inverse_of(*problems.grids.back()));
  std::vector<CellSolution> solutions(cases.size());
  for (std::size_t c = 0; c < cases.size(); ++c) {
    CellSolution& solution = solutions[c];
    solution.axes = image.axes;
    solution.mean_dilatation = problems.grids[0]->dilatation() == internal::Dilatation::mean;
    Field u;
    for (std::size_t l = problems.grids.size(); l-- > 0;) {
      const CellProblem& problem = *problems.grids[l];
      if (!problem.holds && u.empty()) continue;
      u = u.empty() ? zeros<double>(problem.size()) : precondition.prolonged(l, u);
      if (!problem.holds) continue;
      problem.set_held(u);
      const Iterated iterated = iterate(problem, l, problem.loads[c], precondition, {},
                                        {.tolerance = options.tolerance, .most = options.most}, stage, u);
      CellLevel found = level_of(problem, problem.loads[c], iterated, u);
      if (problems.shrunk && problem.grid.cells == problems.shrunk->cells && found.strain_energy > 0.0) {
        Field f(u.size());
        problems.shrunk->apply(u.data(), f.data(), problem.dilatation());
        solution.half_voxel = std::abs(0.5 * dot(u, f) / found.strain_energy - 1.0);
      }
      found.strain_energy *= problems.unit;
      found.support_energy *= problems.unit;
      found.potential *= problems.unit;
      for (auto& [side, reaction] : found.reactions) reaction = reaction * problems.unit;
      if (l <= 2) {
        solution.grid = {image.origin, problem.edges, problem.grid.cells};
        solution.displacement = at_points(problem, u);
        found.interface_energy = internal::interface_energy(solution, image, materials);
        if (l > 0) found.displacement = std::move(solution.displacement);
      }
      solution.levels.insert(solution.levels.begin(), found);
      stage.tick((static_cast<double>(c) + std::pow(8.0, -static_cast<double>(l))) / static_cast<double>(cases.size()));
    }
    internal::estimate_errors(solution);
    solution.applied = problems.applied[c];
    solution.bodies = problems.bodies;
  }
  return solutions;
}

CellSolution solve_on_cells(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                            const std::vector<DisplacementCondition<3>>& conditions, const Loads<3>& loads,
                            const CellOptions& options, const Monitor& monitor) {
  return solve_cases_on_cells(image, materials, conditions, {loads}, options, monitor).front();
}

}  // namespace efree
