// SPDX-License-Identifier: GPL-3.0-or-later
/// The world at the start of a run, in memory and in a checkpoint.
#pragma once

#include "efree/core/packer.hpp"
#include "efree/dynamics/state.hpp"

namespace efree::internal {

/// The world at the start: nodes, and chunks of the points of all bodies without tables. storage: by body. Throws
/// InputError for bodies and options that make no sense.
template <int Dim> void construct(World<Dim>& world, const std::vector<DeformableBody<Dim>>& bodies,
                                  const std::vector<PointStorage>& storage, const DynamicsOptions& options);
/// Arrays of a chunk that options of this run need, where those of an earlier run did not.
template <int Dim> void complete_storage(const World<Dim>& world, Chunk<Dim>& chunk);
/// Moves the tables of all points to large pages, as every step goes through all of them.
template <int Dim> void use_large_pages(const World<Dim>& world);
/// What of the world changes in a run.
template <int Dim> void pack(World<Dim>& world, EnergyWatch& watch, Archive& archive);
/// Reads that, of a run with any prescribed velocities.
template <int Dim> void unpack_world(World<Dim>& world, EnergyWatch& watch, Archive& archive);

/// Ties bodies (DynamicsOptions::tied): of nodes at exactly the same place those of later bodies follow that of the
/// first, which gets their masses and momenta. Tables have the first in their place. Returns how many follow. Throws
/// InputError where masses are not lumped.
template <int Dim> Index tie_bodies(World<Dim>& world);

}  // namespace efree::internal
