// SPDX-License-Identifier: GPL-3.0-or-later
/// Analyses through time as tables.
#pragma once

#include "efree/analysis/result.hpp"

#include <filesystem>

namespace efree {

/// history.csv: a line for every step of Result::history with `t`, `iterations`, `residual` (largest force out of
/// balance, relative), `stored`, `dissipated` (energies), `smallest_J`, `plastic_share` (of the volume),
/// `negative_pivots`, `reaction.PART.x` ... for every part with displacement conditions, `probe.NAME.ux` ... Throws
/// InputError if the file cannot be written.
template <int Dim>
void write_history(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result);

}  // namespace efree
