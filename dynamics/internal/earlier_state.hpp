// SPDX-License-Identifier: GPL-3.0-or-later
/// Which runs a state is of.
#pragma once

#include "efree/dynamics/body.hpp"
#include "efree/dynamics/options.hpp"
#include "efree/dynamics/scheme.hpp"

#include <string>
#include <tuple>
#include <vector>

namespace efree::internal {

/// A body at the start, and how its material responds.
struct BodyIdentity {
  Index nodes = 0, points = 0;
  std::vector<double> places;     ///< sums of coordinates, volumes, patches and shape functions with weights
  std::vector<double> response;   ///< stresses of its first point under some deformations; NaN: it bears none
  std::vector<double> densities;  ///< sums likewise
  friend auto fields(BodyIdentity& of) {
    auto& [nodes, points, places, response, densities] = of;
    return std::tie(nodes, points, places, response, densities);
  }
};

/// What a run has to have in common with one whose state it starts from, and the mass scaling, which may differ.
struct StateIdentity {
  std::string scheme;
  std::vector<double> options;  ///< Scheme::identity
  int plane = 0;
  std::vector<BodyIdentity> bodies;
  double mass_factor = 1.0, scaled_step = 0.0;
  friend auto fields(StateIdentity& of) {
    auto& [scheme, options, plane, bodies, mass_factor, scaled_step] = of;
    return std::tie(scheme, options, plane, bodies, mass_factor, scaled_step);
  }
};

template <int Dim> StateIdentity identify(const std::vector<DeformableBody<Dim>>& bodies, const Scheme<Dim>& scheme,
                                          const DynamicsOptions& options);
/// Throws InputError for what differs: another scheme, plane or number of bodies, or a body that is another one or of
/// another material. names: of the bodies; empty: they have numbers.
void require_same(const StateIdentity& here, const StateIdentity& there, const std::vector<std::string>& names);

}  // namespace efree::internal
