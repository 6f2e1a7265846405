// SPDX-License-Identifier: GPL-3.0-or-later
/// The next mesh on the way to an accuracy.
#pragma once

#include "efree/analysis/result.hpp"

#include <vector>

namespace efree::internal {

/// Share of its edges by which the mesh after the last attempt, which missed (excess over one), should be finer: for
/// 1.25 times the cells that bring the excess down to one if it falls like a power of the edges, at most 12 times those
/// of the last. A mesh that misses by little costs as much as one that does not, and at corners
/// errors scatter by a tenth. The power is that of the degree until a slower one is seen: a mesh too many is a coarse
/// one. Seen it is over the cells of the last two attempts of one degree, not over the edges that were asked for, as
/// outlines of many details dictate theirs; and the less is believed the less they differ. Attempts must not be empty.
double refinement(const std::vector<Attempt>& attempts, int dim);

/// Wall-clock seconds that a mesh of so many cells will take, of the last attempt's degree: by the power of the cells
/// that the last two attempts show, between 1 and 1.6, or 1.2. Attempts must not be empty.
double forecast_seconds(const std::vector<Attempt>& attempts, Index cells);

}  // namespace efree::internal
