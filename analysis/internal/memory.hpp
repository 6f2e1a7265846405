// SPDX-License-Identifier: GPL-3.0-or-later
/// Memory that analyses take.
#pragma once

#include "efree/core/memory.hpp"
#include "efree/quadrature/approximation.hpp"

namespace efree::internal {

/// Bytes that an analysis takes at least: shape functions at the fine vertices, the stiffness and what is gathered for
/// them, for nodes as far apart as they may be.
template <int Dim> double least_memory(const ApproximationOptions& asked, const FineMesh<Dim>& mesh);

/// Bytes that an answer by quadratic elements takes at its peak for each cell of the mesh, which is included: measured
/// (docs/evidence.md, "Memory of quadratic elements").
template <int Dim> constexpr double quadratic_bytes_per_cell = Dim == 2 ? 2.5e3 : 5.2e3;
/// Share of the memory there is that may be planned for.
constexpr double usable_memory = 0.8;

/// Whether there is memory for quadratic elements on a mesh.
template <int Dim> bool has_memory_for_quadratic_elements(const FineMesh<Dim>& mesh) {
  return quadratic_bytes_per_cell<Dim> * mesh.num_cells() < usable_memory * available_memory();
}

/// Whether there is memory for a factor of their matrix, in the plane: measured (docs/evidence.md, "Load cases").
template <int Dim> bool has_memory_for_factor_of_quadratic_elements(const FineMesh<Dim>& mesh) {
  constexpr double bytes_per_cell = 10e3;
  return Dim == 2 && bytes_per_cell * mesh.num_cells() < usable_memory * available_memory();
}

}  // namespace efree::internal
