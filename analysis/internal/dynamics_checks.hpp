// SPDX-License-Identifier: GPL-3.0-or-later
/// What may be wrong with a model of explicit dynamics at its start.
#pragma once

#include "efree/analysis/dynamics.hpp"

#include <string>
#include <vector>

namespace efree::internal {

/// Throws InputError where vertices of bodies are inside walls or rigid bodies by more than that [length], with place
/// and depth.
template <int Dim> void check_gaps(const DynamicsSettings<Dim>& settings, const Points<Dim>& vertices, double allowed);
/// Throws InputError where rigid bodies that contact moves are inside walls or each other, with place and depth.
template <int Dim> void check_rigid_bodies(const DynamicsSettings<Dim>& settings);
/// Throws InputError where bodies in contact are inside each other, with the place: contact does not push them out.
template <int Dim> void check_overlaps(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model);
/// Of bodies that start implausibly fast, or are met by rigid ones that do.
template <int Dim> std::vector<std::string> warnings_of_speeds(const DynamicsModel<Dim>& model);

}  // namespace efree::internal
