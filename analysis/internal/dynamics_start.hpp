// SPDX-License-Identifier: GPL-3.0-or-later
/// How a run of explicit dynamics starts: from a state, with stresses, at rest, with added masses.
#pragma once

#include "efree/analysis/internal/region_body.hpp"

#include <vector>

namespace efree::internal {

/// DynamicsSettings::state_start, right after construction: surfaces of the regions move with the nodes. Throws
/// InputError with the place in the case file for a state of other bodies, and for boundary conditions whose nodes are
/// not known in it.
template <int Dim> void begin_from_state(const DynamicsSettings<Dim>& settings, std::vector<RegionBody<Dim>>& regions,
                                         DynamicsModel<Dim>& model);
/// DynamicsSettings::initial_stresses. Throws InputError with the place in the case file.
template <int Dim> void set_initial_stresses(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model);
/// Depth up to which bodies may be inside walls and rigid bodies at the start [length].
template <int Dim> double allowed_gap(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model);
/// Remarks and warnings of added masses and of given stresses, after loads were added.
template <int Dim> void report_start(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model);
/// DynamicsSettings::static_start. Initial velocities then begin on top of it. Warns of bodies that contact alone
/// holds, and that moved there as a whole.
template <int Dim> void come_to_rest(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                     const Monitor& monitor, DynamicsModel<Dim>& model);

}  // namespace efree::internal
