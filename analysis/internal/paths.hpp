// SPDX-License-Identifier: GPL-3.0-or-later
/// The ways to an answer: a cloud, quadratic elements alone, a grid of cells, steps through time.
#pragma once

#include "efree/analysis/result.hpp"

namespace efree::internal {

/// Whether an analysis may be answered by quadratic elements and no cloud: in the plane, if nothing of a cloud is said.
/// Where an accuracy is asked for they take over, since linear elements on the same cells are factored in less time
/// than a cloud takes to build, and lead to the quadratic ones in fewer iterations; where there are several load cases,
/// since one factor serves all of them.
template <int Dim> bool may_do_without_cloud(const Settings<Dim>& settings);

/// The functions and points of the settings, unless result.approximation has some already.
template <int Dim> void approximate_once(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

/// The answer of a cloud, or of finite elements where settings.approximation says so; that of a cloud corrected and
/// with its error, if the settings want it.
template <int Dim> void answer_by_cloud(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

/// Quadratic elements, from the linear ones on.
template <int Dim> void answer_by_elements(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

/// Steps through time, by Newton's method: materials that are not linear, and loads that change.
template <int Dim> void answer_by_steps(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);
/// Whether an analysis is one.
template <int Dim> bool needs_steps(const Settings<Dim>& settings, const FineMesh<Dim>& mesh);

/// Linear elasticity on a grid as fine as the lattice of the mesh, which only carries the fields. Where nobody
/// said how fine that is, grids of half the edges follow until the error is bearable: down to the voxels, to half of
/// them if the answer were refused else, or as far as an accuracy that is asked for takes it.
void answer_on_cells(const Settings<3>& settings, const PreparedMesh<3>& mesh, Result<3>& result,
                     const Monitor& monitor);

/// Whether an analysis runs on cells. Throws InputError if it should be, but cannot.
template <int Dim> bool is_on_cells(const Settings<Dim>& settings, const PreparedMesh<Dim>& mesh);

}  // namespace efree::internal
