// SPDX-License-Identifier: GPL-3.0-or-later
/// Analyses through time as charts.
#pragma once

#include "efree/analysis/result.hpp"

#include <filesystem>
#include <vector>

namespace efree {

/// history.png: reactions, and displacements of probes, over time; of each the eight components that become largest.
/// Throws InputError if the file cannot be written.
template <int Dim> void draw_history(const std::filesystem::path& file, const Settings<Dim>& settings,
                                     const std::vector<HistoryStep<Dim>>& history);

}  // namespace efree
