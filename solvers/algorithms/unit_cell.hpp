// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective tensors of a body that a mesh fills, in the box around it.
#pragma once

#include "efree/assembly/materials.hpp"
#include "efree/quadrature/approximation.hpp"

#include <vector>

namespace efree {

/// How the mean strain E (mean stress S) is applied on the frame that bounds a volume.
enum class FrameCondition {
  periodic,   ///< u - E x is periodic, the volume is a unit cell (Michel, Moulinec & Suquet 1999, eq. 6)
  kinematic,  ///< u = E x on the frame: the tensor is an upper bound (Huet 1990)
  uniform,    ///< traction S n on the frame ("static uniform"): the tensor is a lower bound (Huet 1990)
};

/// Effective tensor of a unit cell.
struct UnitCellTensor {
  Matrix tensor;  ///< between mean stress and mean strain: Voigt order with doubled shears; of a conductivity Dim x Dim
  Matrix mean;    ///< the stiffness (conductivity) averaged over the frame, void included: Voigt's bound
  Index unknowns = 0;
  std::vector<int> coupled_axes{};  ///< periodic: across which opposite sides have other meshes
  /// Largest share of such a pair of sides where one is material and the other void.
  double uncovered = 0.0;
  /// How the tensor changes, to first order, if free facets move by facet_shifts; empty without these.
  Matrix facet_change{};
};

/// Effective stiffness, from energies: <e_i : C e_j>. The frame is the box around the mesh, along the axes; what of it
/// the mesh does not fill is void. Finite elements; one factor for all loads. Bodies that nothing connects are held by
/// springs of 1e-10 of the diagonal.
///
/// Opposite sides of a periodic frame with the same mesh have the same unknowns. Where meshes differ Nitsche's method
/// couples them on the overlap of their facets (symmetric; Becker, Hansbo & Stenberg 2003; internal/
/// periodic_coupling.hpp): linear displacements are exact, the tensor comes from the functional of the coupling, and
/// its errors are of second order. Facets with void opposite are free.
///
/// `facet_shifts`: by boundary facet, how far the true surface is outside of it in the mean [length], or empty. Those
/// of facets on the frame mean nothing. Their work is int shift e_i : C : e_j, free surfaces bearing no traction
/// (Sokolowski & Zolesio 1992).
///
/// Throws InputError for an approximation that is not of finite elements, sides of the frame that no facet is on,
/// uniform tractions on a frame that the mesh does not fill; NumericalError if the matrix cannot be factored.
template <int Dim> UnitCellTensor effective_stiffness(const Approximation<Dim>& elements,
                                                      const Materials<Dim>& materials, FrameCondition condition,
                                                      const Vector& facet_shifts = {});
/// Likewise of a conductor, `conductivities` by region of the mesh; under `uniform` the mean flux is applied.
template <int Dim> UnitCellTensor effective_conductivity(const Approximation<Dim>& elements,
                                                         const std::vector<double>& conductivities,
                                                         FrameCondition condition, const Vector& facet_shifts = {});

}  // namespace efree
