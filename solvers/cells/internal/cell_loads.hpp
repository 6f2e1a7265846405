// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads on grids of cells.
#pragma once

#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace efree::internal {

/// Other names of sides (CellOptions::sides).
using SideNames = std::map<std::string, std::string>;

/// Throws InputError for what is no side.
Side side_named(const std::string& given, const SideNames& names);

/// A place in messages.
std::string text_of(const Vec<3>& x);

/// How much of a label is in the octants of cells, x fastest.
struct LabelShare {
  Label label;
  std::vector<float> part;
};
/// Of all labels but void.
std::vector<LabelShare> label_shares(const LabelImage<3>& image, const std::array<Index, 3>& cells);

/// Whether there is any load.
bool acts(const Loads<3>& loads);

/// Adds the work-equivalent forces of all loads, unscaled: of tractions and resultants on what a side has of material
/// (`on_side`: part of each rectangle), of forces in the body at the octants' centres, with densities by label. Returns
/// what each load is. Throws InputError for loads that are not finite, and a mass force without a density.
std::vector<AppliedLoad<3>> add_loads(const CellProblem& problem, const Loads<3>& loads, const SideNames& names,
                                      const std::function<const std::vector<float>&(const Side&)>& on_side,
                                      const std::vector<LabelShare>& shares, Field& to);

}  // namespace efree::internal
