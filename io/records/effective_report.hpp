// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective properties as text and as result.json.
#pragma once

#include "efree/analysis/effective.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// The tensor with its error, volume fractions, constants, symmetry, bounds and subvolumes, a line each.
template <int Dim>
std::vector<std::string> describe_effective(const EffectiveSettings<Dim>& settings, const EffectiveResult& result);

/// The same as JSON; docs/case-file.md has the format. Throws InputError if the file cannot be written.
template <int Dim> void write_effective_result(const std::filesystem::path& file,
                                               const EffectiveSettings<Dim>& settings, const EffectiveResult& result);

}  // namespace efree
