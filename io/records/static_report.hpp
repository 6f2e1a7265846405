// SPDX-License-Identifier: GPL-3.0-or-later
/// A static analysis in words.
#pragma once

#include "efree/analysis/result.hpp"

#include <string>
#include <vector>

namespace efree {

/// Errors in the energy norm and of the path, probes, loads, reactions and extremes, with their errors where they are
/// known, a line each.
template <int Dim> std::vector<std::string> describe_result(const Settings<Dim>& settings, const Result<Dim>& result);

}  // namespace efree
