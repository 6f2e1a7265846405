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

using internal::CellMultigrid, internal::CellProblem, internal::CellProblems;
using internal::Field, internal::SingleField, internal::for_all, internal::summed, internal::zeros, internal::dot;

/// Energy of a displacement that is none but for rounding, as part of that of its unknowns one by one.
constexpr double energy_rounding = 1e-18;

/// Conjugate gradients on grid l in single precision; what they add up to is in double precision. In scaled units.
class Iterations {
 public:
  /// From u, which has the prescribed displacements.
  Iterations(const CellProblem& problem, const Field& load, std::size_t l, CellMultigrid& precondition, Field& u)
      : problem_(problem), load_(load), level_(l), precondition_(precondition), u_(u) {}

  CellLevel run(const CellOptions& options, const Stage& stage) {
    CellLevel found{.edges = problem_.edges, .cells = problem_.num_cells()};
    const std::size_t dofs = u_.size();
    const float* inverse = problem_.inverse_diagonal.data();
    SingleField p = zeros<float>(dofs);
    find_residual();
    double before = 0.0, replaced = 0.0;  // r . z one iteration ago, and when the residual was last found anew
    for (;; ++found.iterations) {
      stage.check();
      if (size_ == 0.0) break;
      SingleField& r = residual();
      const SingleField& z = precondition_.cycle(level_);
      double next = dot(r, z);
      if (!(next >= 0.0) || !std::isfinite(next)) throw NumericalError("the iterations on cells break down");
      const double scale = std::max(energy_, size_ * size_ * next);
      found.iteration_error = size_ * size_ * next > negligible() ? size_ * std::sqrt(next / scale) : 0.0;
      if (found.iteration_error <= options.tolerance) break;
      if (found.iterations == options.most)
        throw NumericalError(fmt::format(
            "{} iterations on cells leave a relative error of {:.2g}: materials of very "
            "different stiffness, nearly incompressible or strongly anisotropic ones, or a body that hardly hangs "
            "together",
            options.most, found.iteration_error));
      if (next < least_fall * replaced) {
        // Rounding has added up: the residual anew, in directions that go on.
        const double size = size_;
        find_residual();
        for_all(dofs, [&](std::size_t i) { p[i] *= static_cast<float>(size / size_); });
        before *= (size / size_) * (size / size_);
        replaced = 0.0;
        --found.iterations;
        continue;
      }
      if (replaced == 0.0) replaced = next;
      const auto beta = static_cast<float>(before > 0.0 ? next / before : 0.0);
      before = next;
      for_all(dofs, [&](std::size_t i) { p[i] = z[i] + beta * p[i]; });
      SingleField& Kp = precondition_.spare(level_);
      problem_.apply(p.data(), Kp.data());
      const double alpha =
          next / summed(dofs, [&](std::size_t i) { return inverse[i] > 0.0F ? double(p[i]) * double(Kp[i]) : 0.0; });
      const double forward = size_ * alpha;
      const auto back = static_cast<float>(alpha);
      const double work = load_.empty() ? 0.0 : dot(load_, p);
      for_all(dofs, [&](std::size_t i) {
        u_[i] += forward * static_cast<double>(p[i]);
        r[i] = inverse[i] > 0.0F ? r[i] - back * Kp[i] : 0.0F;
      });
      problem_.project(r);
      energy_ += forward * (2.0 * work - size_ * next);
    }
    return finish(std::move(found));
  }

 private:
  /// Fall of r . z after which the residual is found anew.
  static constexpr double least_fall = 1e-7;

  SingleField& residual() { return precondition_.right(level_); }
  /// Energy of a displacement that is none but for rounding.
  double negligible() const {
    const float* inverse = problem_.inverse_diagonal.data();
    return energy_rounding * summed(u_.size(), [&](std::size_t i) {
             return inverse[i] > 0.0F ? u_[i] * u_[i] / static_cast<double>(inverse[i]) : 0.0;
           });
  }
  /// The residual, of size 1, its size, and the energy u . K u.
  void find_residual() {
    precondition_.release(level_);
    Field Ku(u_.size());
    problem_.apply(u_.data(), Ku.data());
    energy_ = dot(u_, Ku);
    for_all(u_.size(), [&](std::size_t i) {
      Ku[i] = problem_.inverse_diagonal[i] > 0.0F ? (load_.empty() ? 0.0 : load_[i]) - Ku[i] : 0.0;
    });
    problem_.project(Ku);
    size_ = std::sqrt(dot(Ku, Ku));
    SingleField& r = residual();
    if (r.empty()) r = zeros<float>(u_.size());
    const double scale = size_ > 0.0 ? 1.0 / size_ : 0.0;
    for_all(u_.size(), [&](std::size_t i) { r[i] = static_cast<float>(scale * Ku[i]); });
  }
  /// Energies and reactions.
  CellLevel finish(CellLevel found) {
    precondition_.release(level_);
    Field Ku(u_.size());
    problem_.grid.apply(u_.data(), Ku.data(), problem_.dilatation);
    const double of_body = dot(u_, Ku);
    problem_.springs.add_to(u_.data(), Ku.data());
    energy_ = dot(u_, Ku);
    if (!std::isfinite(energy_)) throw NumericalError("the strain energy on cells is not finite");
    if (energy_ > negligible()) {
      found.strain_energy = 0.5 * of_body;
      found.support_energy = problem_.springs.energy(u_.data());
      found.potential = 0.5 * energy_;
    }
    if (!load_.empty()) {
      found.potential -= dot(u_, load_);
      for_all(u_.size(), [&](std::size_t i) { Ku[i] -= load_[i]; });
    }
    found.reactions = problem_.reactions(u_, Ku);
    return found;
  }

  const CellProblem& problem_;
  const Field& load_;
  std::size_t level_;
  CellMultigrid& precondition_;
  Field& u_;
  double size_ = 0.0, energy_ = 0.0;
};

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

/// A strain energy or potential with the compliance that interfaces lack: it falls where displacements are prescribed
/// (layers in series), and changes by the work of the loads where these are.
double softened(double value, const CellLevel& level) {
  const double energy = level.strain_energy + level.support_energy;
  if (level.interface_energy == 0.0 || energy == 0.0) return value;
  const double lacking = level.interface_energy / energy, sign = std::clamp(level.potential / energy, -1.0, 1.0);
  return sign >= 0.0 ? value / (1.0 + sign * lacking) : value * (1.0 - sign * lacking);
}

/// What the finest grid leaves: from the last two grids at the rate of the last three.
void tell_error(CellSolution& solution) {
  const auto& levels = solution.levels;
  const double energy = levels[0].strain_energy + levels[0].support_energy;
  solution.extrapolated_energy = levels[0].strain_energy;
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
  const double further = share * (solution.extrapolated_energy - softened(levels[1].strain_energy, levels[1]));
  constexpr double most = 0.5;  // beyond that grids are not on their way to anything
  if (std::abs(further) <= most * solution.extrapolated_energy) solution.extrapolated_energy += further;
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
    solution.mean_dilatation = problems.grids[0]->dilatation == internal::Dilatation::mean;
    Field u;
    for (std::size_t l = problems.grids.size(); l-- > 0;) {
      const CellProblem& problem = *problems.grids[l];
      Field start = zeros<double>(problem.grid.size());
      if (!u.empty()) prolong(*problems.grids[l + 1], problem, u, start);
      u = std::move(start);
      // What coarser grids, where more hangs together, say of points without unknowns.
      for_all(u.size(), [&](std::size_t i) {
        if (problem.inverse_diagonal[i] == 0.0F) u[i] = 0.0;
      });
      problem.set_held(u);
      CellLevel found = Iterations(problem, problem.loads[c], l, precondition, u).run(options, stage);
      if (problems.shrunk && problem.grid.cells == problems.shrunk->cells && found.strain_energy > 0.0) {
        Field f(u.size());
        problems.shrunk->apply(u.data(), f.data(), problem.dilatation);
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
    tell_error(solution);
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
