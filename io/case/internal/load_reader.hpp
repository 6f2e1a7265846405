// SPDX-License-Identifier: GPL-3.0-or-later
/// Gravity and [[boundary]] entries of explicit dynamics. All that throws, throws InputError that begins with
/// "file:line: ".
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/io/case/internal/place_reader.hpp"
#include "efree/io/case/internal/section.hpp"

#include <vector>

namespace efree::internal {

/// Keys of a [[boundary]].
Section::Keys dynamics_boundary_keys();

/// Gravity of [analysis] and the velocities, loads and supports on parts of the boundary, which may depend on the time.
/// root, grey: of expressions, as read_definitions takes them.
template <int Dim> void read_loads(const Section& analysis, const std::vector<Section>& boundaries, const Section& root,
                                   const ScalarField<Dim>& grey, PlaceReader<Dim>& places,
                                   DynamicsSettings<Dim>& dynamics);

}  // namespace efree::internal
