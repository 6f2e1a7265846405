// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_solver.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/cells/internal/cell_multigrid.hpp"
#include "efree/solvers/cells/internal/interface_energy.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

using internal::CellGrid, internal::CellMultigrid, internal::CellProblem, internal::CellProblems;
using internal::Field, internal::HeldSide, internal::SingleField, internal::for_all, internal::summed, internal::zeros,
    internal::dot;

/// Energy of a displacement that is none but for rounding, as part of that of its unknowns one by one.
constexpr double energy_rounding = 1e-18;

/// Solves the problem of grid l from u, which has the prescribed displacements. In scaled units.
CellLevel iterate(const CellProblem& problem, const Field& load, std::size_t l, CellMultigrid& precondition,
                  const CellOptions& options, const Stage& stage, Field& u) {
  const CellGrid& grid = problem.grid;
  const std::size_t dofs = grid.size();
  const float* inverse = problem.inverse_diagonal.data();
  const bool loaded = !load.empty();
  Field r(dofs), p = zeros<double>(dofs), Ap(dofs);
  const auto energy_of = [&] {
    grid.apply(u.data(), Ap.data());
    return dot(u, Ap);
  };
  const auto nothing = [&] {
    return energy_rounding *
           summed(dofs, [&](std::size_t i) { return inverse[i] > 0.0F ? u[i] * u[i] / inverse[i] : 0.0; });
  };
  CellLevel found{.edges = problem.edges, .cells = problem.num_cells()};
  double energy = energy_of(), rz = 0.0;
  for_all(dofs, [&](std::size_t i) { r[i] = inverse[i] > 0.0F ? (loaded ? load[i] : 0.0) - Ap[i] : 0.0; });
  problem.project(r);
  for (;; ++found.iterations) {
    stage.check();
    // In single precision small numbers keep their digits only if scaled.
    const double size_of_r = std::sqrt(dot(r, r));
    if (size_of_r == 0.0) break;
    SingleField& b = precondition.right(l);
    for_all(dofs, [&](std::size_t i) { b[i] = static_cast<float>(r[i] / size_of_r); });
    const SingleField& z = precondition.cycle(l);
    const double next = size_of_r * dot(r, z);
    if (!(next >= 0.0) || !std::isfinite(next)) throw NumericalError("the iterations on cells break down");
    const double scale = std::max(energy, next);
    found.iteration_error = next > nothing() ? std::sqrt(next / scale) : 0.0;
    if (found.iteration_error <= options.tolerance) break;
    if (found.iterations == options.most)
      throw NumericalError(
          fmt::format("{} iterations on cells leave a relative error of {:.2g}: materials of very "
                      "different stiffness, or a body that hardly hangs together",
                      options.most, found.iteration_error));
    const double beta = found.iterations == 0 ? 0.0 : next / rz;
    rz = next;
    for_all(dofs, [&](std::size_t i) { p[i] = size_of_r * z[i] + beta * p[i]; });
    grid.apply(p.data(), Ap.data());
    const double alpha = rz / summed(dofs, [&](std::size_t i) { return inverse[i] > 0.0F ? p[i] * Ap[i] : 0.0; });
    for_all(dofs, [&](std::size_t i) {
      if (inverse[i] == 0.0F) return;
      u[i] += alpha * p[i];
      r[i] -= alpha * Ap[i];
    });
    problem.project(r);
    if (loaded) energy = energy_of();  // loads make it grow on the way
  }
  energy = energy_of();
  if (loaded) for_all(dofs, [&](std::size_t i) { Ap[i] -= load[i]; });
  found.reactions = problem.reactions(Ap);
  if (!std::isfinite(energy)) throw NumericalError("the strain energy on cells is not finite");
  found.strain_energy = energy > nothing() ? 0.5 * energy : 0.0;
  found.potential = found.strain_energy - (loaded ? dot(u, load) : 0.0);
  return found;
}

/// The displacement at the points of the grid, the first axis fastest.
Points<3> at_points(const CellProblem& problem, const Field& u) {
  const auto& n = problem.grid.cells;
  Points<3> displacement(3, static_cast<Eigen::Index>(n[0] + 1) * (n[1] + 1) * (n[2] + 1));
  Eigen::Index point = 0;
  for (Index k = 0; k <= n[2]; ++k)
    for (Index j = 0; j <= n[1]; ++j)
      for (Index i = 0; i <= n[0]; ++i, ++point)
        for (int c = 0; c < 3; ++c) displacement(c, point) = u[problem.dof(c, {i, j, k})];
  if (!problem.axes.isIdentity(0.0)) displacement = problem.axes * displacement;
  return displacement;
}

/// A strain energy or potential with the compliance that interfaces lack: it falls where displacements are prescribed
/// (layers in series), and changes by the work of the loads where these are.
double softened(double value, const CellLevel& level) {
  if (level.interface_energy == 0.0 || level.strain_energy == 0.0) return value;
  const double lacking = level.interface_energy / level.strain_energy,
               sign = std::clamp(level.potential / level.strain_energy, -1.0, 1.0);
  return sign >= 0.0 ? value / (1.0 + sign * lacking) : value * (1.0 - sign * lacking);
}

/// What the finest grid leaves: from the last two grids at the rate of the last three.
void tell_error(CellSolution& solution) {
  const auto& levels = solution.levels;
  const double energy = levels[0].strain_energy;
  solution.extrapolated_energy = energy;
  if (energy == 0.0) return;
  solution.interface_error = std::sqrt(levels[0].interface_energy / energy);
  solution.extrapolated_energy = softened(levels[0].strain_energy, levels[0]);
  if (levels.size() < 2) return;
  const auto potential = [&](std::size_t l) { return softened(levels[l].potential, levels[l]); };
  const double last = potential(1) - potential(0);
  double rate = 1.0;
  if (levels.size() > 2) {
    const double before = potential(2) - potential(1);
    if (before > 0.0 && last > 0.0) rate = std::clamp(std::log2(before / last), 1.0, 2.0);
  }
  const double share = 1.0 / (std::pow(2.0, rate) - 1.0);
  solution.extrapolated_energy += share * (solution.extrapolated_energy - softened(levels[1].strain_energy, levels[1]));
  solution.grid_error = std::sqrt(share * std::abs(last) / energy);
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
  CellMultigrid precondition(problems.grids);
  std::vector<CellSolution> solutions(cases.size());
  for (std::size_t c = 0; c < cases.size(); ++c) {
    CellSolution& solution = solutions[c];
    solution.axes = image.axes;
    Field u;
    for (std::size_t l = problems.grids.size(); l-- > 0;) {
      const CellProblem& problem = *problems.grids[l];
      Field start = zeros<double>(problem.grid.size());
      if (!u.empty()) prolong(*problems.grids[l + 1], problem, u, start);
      u = std::move(start);
      problem.set_held(u);
      CellLevel found = iterate(problem, problem.loads[c], l, precondition, options, stage, u);
      if (problems.shrunk && problem.grid.cells == problems.shrunk->cells && found.strain_energy > 0.0) {
        Field f(u.size());
        problems.shrunk->apply(u.data(), f.data());
        solution.half_voxel = std::abs(0.5 * dot(u, f) / found.strain_energy - 1.0);
      }
      found.strain_energy *= problems.unit;
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
    tell_error(solution);
    solution.applied = problems.applied[c];
  }
  return solutions;
}

CellSolution solve_on_cells(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                            const std::vector<DisplacementCondition<3>>& conditions, const Loads<3>& loads,
                            const CellOptions& options, const Monitor& monitor) {
  return solve_cases_on_cells(image, materials, conditions, {loads}, options, monitor).front();
}

}  // namespace efree
