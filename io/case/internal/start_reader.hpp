// SPDX-License-Identifier: GPL-3.0-or-later
/// [time], [output] and [start] of explicit dynamics. All that throws, throws InputError that begins with "file:line:
/// ".
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/io/case/expression.hpp"
#include "efree/io/case/internal/section.hpp"

#include <filesystem>

namespace efree::internal {

/// [time] but for mass_scaling, and [output].
template <int Dim> void read_times(const Section& time, const Section& output, DynamicsSettings<Dim>& dynamics);
/// mass_scaling of [time]; after the method.
template <int Dim> void read_mass_scaling(const Section& time, DynamicsSettings<Dim>& dynamics);
/// [start]; after initial velocities, materials and mass scaling. The state is not read, but there is one in `folder`.
template <int Dim> void read_start(const Section& root, const std::filesystem::path& folder,
                                   const Expressions<Dim>& expressions, DynamicsSettings<Dim>& dynamics);

}  // namespace efree::internal
