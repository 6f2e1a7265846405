// SPDX-License-Identifier: GPL-3.0-or-later
/// Meshes of analyses of all kinds.
#pragma once

#include "efree/analysis/prepare.hpp"

namespace efree::internal {

/// The mesh, its named parts and its materials. A static analysis, which gives all its settings besides the common
/// ones, gets no small bodies that nothing holds or loads, and no fluids. Throws InputError as prepare does.
template <int Dim> PreparedMesh<Dim> prepare_mesh(const MeshSource<Dim>& source, const CommonSettings<Dim>& settings,
                                                  const Settings<Dim>* static_settings, const Monitor& monitor);

}  // namespace efree::internal
