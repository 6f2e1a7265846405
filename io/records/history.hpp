// SPDX-License-Identifier: GPL-3.0-or-later
/// Analyses through time as tables.
#pragma once

#include "efree/analysis/result.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// The first line of history.csv: `t`, `iterations`, `residual` (largest force out of balance, relative), `stored`,
/// `dissipated` (energies), `smallest_J`, `plastic_share` (of the volume), `negative_pivots`, `reaction.PART.x` ... for
/// every part with displacement conditions, `probe.NAME.ux` ... Ends with a new line.
template <int Dim> std::string history_header(const Settings<Dim>& settings, const HistoryStep<Dim>& any);
/// The line of one step, to the last digit.
template <int Dim> std::string history_line(const HistoryStep<Dim>& step);

/// history.csv: a line for every step, of which there must be one. Throws InputError if the file cannot be written.
template <int Dim> void write_history(const std::filesystem::path& file, const Settings<Dim>& settings,
                                      const std::vector<HistoryStep<Dim>>& history);

}  // namespace efree
