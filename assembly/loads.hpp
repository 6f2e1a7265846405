// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads as forces on nodes.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"

namespace efree {

/// f = int phi_I t + int phi_I b, integrated on the fine mesh: Dim x N. Throws InputError for an unknown boundary or a
/// traction or force that is not finite (naming the point).
template <int Dim>
Points<Dim> load_vector(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const Loads<Dim>& loads);

}  // namespace efree
