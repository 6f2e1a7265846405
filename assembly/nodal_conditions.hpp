// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacement conditions on nodal values.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"

#include <vector>

namespace efree {

/// Nodal values set strongly: in the frame of each node (columns of its matrix) some components are fixed.
template <int Dim> struct NodalConditions {
  std::vector<Index> nodes;      ///< ascending
  std::vector<Mat<Dim>> frames;  ///< orthonormal; the first fixed[k] columns are restrained
  std::vector<int> fixed;        ///< 1 .. Dim
  std::vector<Vec<Dim>> values;  ///< prescribed components in the frame
};
/// For finite elements: `node_at` has the node at each fine degree of freedom (space.size(), -1 where there is none;
/// several may share one). Throws InputError if a restraint cannot be nodal, or if conditions on one node contradict
/// each other (naming the parts).
template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const std::vector<Index>& node_at,
                                                         const std::vector<Restraint<Dim>>& restraints);
/// Whether values at nodes can hold the restraint: all but normal displacements on a part that is curved, and springs.
template <int Dim> bool can_be_nodal(const FineSpace<Dim>& space, const Restraint<Dim>& restraint);
/// Throws InputError if functions of nodes off a restrained part do not vanish on it, if normal conditions are asked
/// for on a part that is not flat around a node, or if conditions on one node contradict each other (naming the parts).
template <int Dim> NodalConditions<Dim> nodal_conditions(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                         const std::vector<Index>& node_dofs,
                                                         const std::vector<Restraint<Dim>>& restraints);

}  // namespace efree
