// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cells/cell_errors.hpp"

#include "efree/solvers/cells/internal/cell_errors.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace efree {
namespace {

/// Of three grids the finest is taken to leave at least this part of the difference between the other two, as at the
/// rate log2(3): that of the finest two is small now and then where boundaries and interfaces fall on cells by chance
/// (docs/evidence.md).
constexpr double least_left = 1.0 / 6.0;

/// A strain energy or potential with the compliance that interfaces lack: it falls where displacements are prescribed
/// (layers in series), and changes by the work of the loads where these are.
double softened(double value, const CellLevel& level) {
  const double energy = level.strain_energy + level.support_energy;
  if (level.interface_energy == 0.0 || energy == 0.0) return value;
  const double lacking = level.interface_energy / energy, sign = std::clamp(level.potential / energy, -1.0, 1.0);
  return sign >= 0.0 ? value / (1.0 + sign * lacking) : value * (1.0 - sign * lacking);
}

/// The smaller one: of differences between grids with and without what interfaces lack. On coarse grids that is a
/// guess, and grids that agree without it do not differ by it.
double least_of(double a, double b) {
  return std::abs(a) < std::abs(b) ? a : b;
}

/// What the finest of three values leaves, component by component: from the last two at the rate of the three, between
/// one and two, but no less than least_left.
Vec<3> left_by_grids(const std::vector<Vec<3>>& values) {
  if (values.size() < 2) return Vec<3>::Zero();
  const Vec<3> last = (values[0] - values[1]).cwiseAbs();
  if (values.size() == 2) return last;
  const Vec<3> before = (values[1] - values[2]).cwiseAbs();
  const double rate = last.norm() > 0.0 ? std::clamp(std::log2(before.norm() / last.norm()), 1.0, 2.0) : 1.0;
  return (last / (std::pow(2.0, rate) - 1.0)).cwiseMax(least_left * before);
}

/// Relative, of every displacement and force: what iterations leave, and what cells with several materials lack of
/// compliance.
double left_everywhere(const CellSolution& cells) {
  return cells.finest().iteration_error + cells.interface_error * cells.interface_error;
}

std::size_t num_compared(const CellSolution& cells) {
  return std::min<std::size_t>(3, cells.levels.size());
}

}  // namespace

void internal::estimate_errors(CellSolution& solution) {
  const auto& levels = solution.levels;
  const double energy = levels[0].strain_energy + levels[0].support_energy;
  solution.extrapolated_energy = levels[0].strain_energy;
  if (energy == 0.0) return;
  solution.interface_error = std::sqrt(levels[0].interface_energy / energy);
  solution.extrapolated_energy = softened(levels[0].strain_energy, levels[0]);
  if (levels.size() < 2) {
    solution.grid_error = 1.0;
    return;
  }
  const auto difference = [&](std::size_t l) {
    return least_of(softened(levels[l + 1].potential, levels[l + 1]) - softened(levels[l].potential, levels[l]),
                    levels[l + 1].potential - levels[l].potential);
  };
  const double last = difference(0);
  const auto coarsening = [&](std::size_t l) {  // a little less than two for odd numbers of cells
    return std::cbrt(levels[l + 1].edges.prod() / levels[l].edges.prod());
  };
  double rate = 1.0, before = 0.0;
  if (levels.size() > 2) {
    before = difference(1);
    if (before > 0.0 && last > 0.0) rate = std::clamp(std::log(before / last) / std::log(coarsening(1)), 1.0, 2.0);
  }
  const double share = 1.0 / (std::pow(coarsening(0), rate) - 1.0);
  // Grids that are not parts of each other see boundaries at other places, which looks like a low rate.
  const double towards = coarsening(0) > 1.999 ? share : 1.0 / (std::pow(coarsening(0), 2) - 1.0);
  const double further = towards * least_of(solution.extrapolated_energy - softened(levels[1].strain_energy, levels[1]),
                                            levels[0].strain_energy - levels[1].strain_energy);
  constexpr double most = 0.5;  // beyond that grids are not on their way to anything
  if (std::abs(further) <= most * solution.extrapolated_energy) solution.extrapolated_energy += further;
  // What interfaces lack on the coarser grids is known to about its own size, and differences by that say nothing.
  const double noise = levels.size() > 2 ? levels[1].interface_energy + levels[2].interface_energy : 0.0;
  const double least = least_left * std::max(0.0, std::abs(before) - noise);
  solution.grid_error = std::sqrt(std::max(share * std::abs(last), least) / energy);
}

Vec<3> displacement_error_at(const CellSolution& cells, const Vec<3>& x) {
  std::vector<Vec<3>> values;
  for (std::size_t l = 0; l < num_compared(cells); ++l) values.push_back(displacement_at(cells, l, x));
  // Displacements under loads are off by as much as the energy, unless errors cancel at the place by chance.
  constexpr double least_of_energy = 0.25;
  const double of_energy = least_of_energy * cells.grid_error * cells.grid_error;
  return left_by_grids(values).cwiseMax(of_energy * values[0].cwiseAbs()).array() +
         left_everywhere(cells) * values[0].norm();
}

Vec<3> reaction_error(const CellSolution& cells, const std::string& on) {
  std::vector<Vec<3>> forces;
  for (std::size_t l = 0; l < num_compared(cells); ++l) forces.push_back(cells.levels[l].reactions.at(on).force);
  return left_by_grids(forces).array() + left_everywhere(cells) * forces[0].norm();
}

}  // namespace efree
