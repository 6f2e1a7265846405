// SPDX-License-Identifier: GPL-3.0-or-later
/// [[fracture]] of a case file.
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/io/case/internal/section.hpp"

#include <vector>

namespace efree::internal {

/// Throws InputError that begins with "file:line: ".
std::vector<RegionFracture> read_fractures(const std::vector<Section>& entries);

}  // namespace efree::internal
