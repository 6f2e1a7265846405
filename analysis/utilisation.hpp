// SPDX-License-Identifier: GPL-3.0-or-later
/// Utilisation: stress over strength. At 1 a limit is reached.
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/analysis/result.hpp"
#include "efree/solvers/cells/cell_fields.hpp"

#include <string>
#include <vector>

namespace efree {

/// The larger of von Mises' stress over `yield` and of the largest principal stress over `ultimate`, of the limits that
/// are given; 0 without any.
template <int Dim> double utilisation(const Strength& strength, const Voigt<Dim>& stress);

/// The largest utilisation in a region by one of the limits of its material.
template <int Dim> struct Utilisation {
  std::string region;  ///< empty: without a name
  std::string limit;   ///< "yield" or "ultimate"
  double value = 0.0;
  Vec<Dim> at = Vec<Dim>::Zero();  ///< the place

  /// Infinite without stress.
  double safety_factor() const { return 1.0 / value; }
};

/// At the places of the space (FineSpace::num_places), by the strength of their regions; empty: none has one.
template <int Dim> Vector utilisation_at_places(const CommonSettings<Dim>& settings, const FineSpace<Dim>& space,
                                                const Fields<Dim>& fields);

/// By cell of an image with these regions: of the mean stress; 0 in void. Empty: none has one.
std::vector<float> utilisation_of_cells(const CommonSettings<3>& settings, const std::vector<std::string>& regions,
                                        const CellFields& fields);

/// Of the regions whose material has a strength, in the order of the mesh.
template <int Dim> std::vector<Utilisation<Dim>> largest_utilisations(const CommonSettings<Dim>& settings,
                                                                      const FineSpace<Dim>& space,
                                                                      const Fields<Dim>& fields);
/// Likewise of the regions of an image, by these names.
std::vector<Utilisation<3>> largest_utilisations(const CommonSettings<3>& settings,
                                                 const std::vector<std::string>& regions, const CellFields& fields);
/// Likewise of the bodies, now.
template <int Dim> std::vector<Utilisation<Dim>> largest_utilisations(const DynamicsModel<Dim>& model);

}  // namespace efree
