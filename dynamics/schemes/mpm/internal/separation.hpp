// SPDX-License-Identifier: GPL-3.0-or-later
/// Points that the grid no longer holds together.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/particles.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"

namespace efree::internal {

/// Steps between looks for points that are too far from their neighbours.
inline constexpr Index separation_interval = 8;

/// Marks separated points, which are too far from their neighbours for the grid to hold them together (numerical
/// fracture): a strip that is pulled apart, with 2 to 5 points along a cell, breaks where these are 0.63 to 0.94 of a
/// cell apart, with splines of degree 3 0.93 to 0.99. stress: the chunk's columns of Kirchhoff stresses.
template <int Dim> void find_separated(const MpmOptions& options, const Chunk<Dim>& chunk, const double* stress,
                                       Particles<Dim>& particles);

}  // namespace efree::internal
