// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_solver.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/cells/internal/cell_multigrid.hpp"

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
CellLevel iterate(const CellProblem& problem, std::size_t l, CellMultigrid& precondition, const CellOptions& options,
                  const Stage& stage, Field& u) {
  const CellGrid& grid = problem.grid;
  const std::size_t dofs = grid.size();
  const float* inverse = problem.inverse_diagonal.data();
  const bool loaded = !problem.load.empty();
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
  for_all(dofs, [&](std::size_t i) { r[i] = inverse[i] > 0.0F ? (loaded ? problem.load[i] : 0.0) - Ap[i] : 0.0; });
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
    if (loaded) energy = energy_of();  // loads make it grow on the way
  }
  energy = energy_of();
  if (loaded) for_all(dofs, [&](std::size_t i) { Ap[i] -= problem.load[i]; });
  found.reactions = problem.reactions(Ap);
  if (!std::isfinite(energy)) throw NumericalError("the strain energy on cells is not finite");
  found.strain_energy = energy > nothing() ? 0.5 * energy : 0.0;
  found.potential = found.strain_energy - (loaded ? dot(u, problem.load) : 0.0);
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
  return displacement;
}

/// What the finest grid leaves: from the last two grids at the rate of the last three.
void tell_error(CellSolution& solution) {
  const auto& levels = solution.levels;
  solution.extrapolated_energy = levels[0].strain_energy;
  if (levels.size() < 2 || levels[0].strain_energy == 0.0) return;
  const double last = levels[1].potential - levels[0].potential;
  double rate = 1.0;
  if (levels.size() > 2) {
    const double before = levels[2].potential - levels[1].potential;
    if (before > 0.0 && last > 0.0) rate = std::clamp(std::log2(before / last), 1.0, 2.0);
  }
  const double share = 1.0 / (std::pow(2.0, rate) - 1.0);
  solution.extrapolated_energy += share * (levels[0].strain_energy - levels[1].strain_energy);
  solution.grid_error = std::sqrt(share * std::abs(last) / levels[0].strain_energy);
}

}  // namespace

CellSolution solve_on_cells(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                            const std::vector<DisplacementCondition<3>>& conditions, const Loads<3>& loads,
                            const CellOptions& options, const Monitor& monitor) {
  const CellProblems problems = [&] {
    const Stage stage("assembly", monitor);
    return internal::make_cell_problems(image, materials, conditions, loads, options);
  }();
  const Stage stage("solve", monitor);
  CellMultigrid precondition(problems.grids);
  CellSolution solution;
  Field u;
  for (std::size_t l = problems.grids.size(); l-- > 0;) {
    const CellProblem& problem = *problems.grids[l];
    Field start = zeros<double>(problem.grid.size());
    if (!u.empty()) prolong(*problems.grids[l + 1], problem, u, start);
    u = std::move(start);
    problem.set_held(u);
    CellLevel found = iterate(problem, l, precondition, options, stage, u);
    if (problems.shrunk && problem.grid.cells == problems.shrunk->cells && found.strain_energy > 0.0) {
      Field f(u.size());
      problems.shrunk->apply(u.data(), f.data());
      solution.half_voxel = std::abs(0.5 * dot(u, f) / found.strain_energy - 1.0);
    }
    found.strain_energy *= problems.unit;
    found.potential *= problems.unit;
    for (auto& [side, reaction] : found.reactions) reaction = reaction * problems.unit;
    if (l == 1 || l == 2) found.displacement = at_points(problem, u);
    solution.levels.insert(solution.levels.begin(), found);
    stage.tick(std::pow(8.0, -static_cast<double>(l)));
  }
  tell_error(solution);
  const CellProblem& finest = *problems.grids.front();
  solution.applied = problems.applied;
  solution.grid = {image.origin, finest.edges, finest.grid.cells};
  solution.displacement = at_points(finest, u);
  return solution;
}

}  // namespace efree
