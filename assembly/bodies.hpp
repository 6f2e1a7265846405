// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies and the rigid motions that restraints leave them.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/basis/fine_space.hpp"

#include <string>
#include <vector>

namespace efree {

/// Bodies, regions tied to each other being one, and the rigid motions that restraints leave them.
template <int Dim> struct Bodies {
  std::vector<Index> of_component;                     ///< body of each component of the mesh, counted from 0
  Vector volumes;                                      ///< by body, of the mesh
  Points<Dim> centres;                                 ///< of mass
  std::vector<std::vector<std::string>> free_motions;  ///< names of translations and rotations; empty: the body is held

  Index size() const { return static_cast<Index>(volumes.size()); }
  bool is_free(Index body) const { return !free_motions[body].empty(); }
};
/// Bodies of the mesh under these restraints.
template <int Dim> Bodies<Dim> find_bodies(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties = {});

/// A body for messages: the centre of mass and, if the mesh has several regions, those that it is made of.
template <int Dim> std::string describe_body(const FineMesh<Dim>& mesh, const Bodies<Dim>& bodies, Index body);
/// For messages: the body whose boundary is nearest to that of this one, and the distance [length].
template <int Dim> std::string describe_neighbour(const FineMesh<Dim>& mesh, const Bodies<Dim>& bodies, Index body);

/// Throws InputError that names every rigid motion the restraints leave free, for each body (of many, the largest) with
/// its nearest neighbour.
template <int Dim> void require_restrained(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties = {});

}  // namespace efree
