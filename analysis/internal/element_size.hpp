// SPDX-License-Identifier: GPL-3.0-or-later
/// How fine meshes are that are compared with clouds and grids.
#pragma once

namespace efree::internal {

/// Elements of this size have about as many vertices as a cloud of spacing 1 has nodes.
template <int Dim> inline constexpr double element_size = Dim == 2 ? 0.85 : 1.5;

}  // namespace efree::internal
