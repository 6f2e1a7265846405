// SPDX-License-Identifier: GPL-3.0-or-later
/// The ways to an answer: a cloud, quadratic elements alone, steps through time.
#pragma once

#include "efree/analysis/result.hpp"

#include <cstdint>

namespace efree::internal {

/// Whether an analysis may be answered by quadratic elements and no cloud: in the plane, if nothing of a cloud is said.
/// Where an accuracy is asked for they take over, since linear elements on the same cells are factored in less time
/// than a cloud takes to build, and lead to the quadratic ones in fewer iterations; where there are several load cases,
/// since one factor serves all of them.
template <int Dim> bool may_do_without_cloud(const Settings<Dim>& settings);

/// The functions and points of the settings, unless result.approximation has some already.
template <int Dim> void approximate_once(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

/// The answer of a cloud, or of finite elements where settings.common.approximation says so; that of a cloud corrected
/// and with its error, if the settings want it.
template <int Dim> void answer_by_cloud(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

/// Quadratic elements, from the linear ones on.
template <int Dim> void answer_by_elements(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

/// Steps through time, by Newton's method: materials that are not linear, and loads that change. Errors are estimated
/// by Steps::coarser and, unless it is null, a path that is coarser still.
template <int Dim> void answer_by_steps(const Settings<Dim>& settings, const Result<Dim>* coarsest, Result<Dim>& result,
                                        const Monitor& monitor);
/// Whether an analysis is one.
template <int Dim> bool needs_steps(const Settings<Dim>& settings, const FineMesh<Dim>& mesh);

/// Whether a material weakens as it flows, so that strains localise.
bool softens(const ElasticModel& model);
/// Identifies a body and its functions (Checkpoint::body).
template <int Dim> std::uint64_t fingerprint(const Approximation<Dim>& approximation);

/// The result of an analysis, unless it is a load path: then is_path, and only the checks of linear elasticity.
template <int Dim> Result<Dim> analyse_unless_path(const PreparedMesh<Dim>& mesh, const Settings<Dim>& settings,
                                                   const Monitor& monitor, bool& is_path);
/// The result of one level of a load path that is refined: by settings whose Steps::coarser is the level before, with
/// that before it (null: none).
template <int Dim> Result<Dim> analyse_level(const PreparedMesh<Dim>& mesh, const Settings<Dim>& settings,
                                             const Result<Dim>* coarsest, const Monitor& monitor);
/// Cloud spacing of a load path that says none [length]: default_spacing, but at least four nodes across walls as far
/// as 9000 nodes (1200 in space) do, and a mesh that is fixed.
template <int Dim> double spacing_of_path(const FineMesh<Dim>& mesh, bool mesh_is_fixed);
/// Whether a load path is solved level by level: its functions are left open (no spacing), or they are finite elements,
/// whose errors are those against coarser meshes.
template <int Dim> bool chooses_path(const MeshSource<Dim>& source, const Settings<Dim>& settings);
/// An analysis that, if it is a load path, is solved on finer and finer meshes until its errors are small: the first
/// cloud has at least four nodes across walls. Paths in the plane take quadratic elements; where these stop and no
/// material flows, a cloud.
template <int Dim> Result<Dim> analyse_chosen_path(const MeshSource<Dim>& source, const PreparedMesh<Dim>& natural,
                                                   const Settings<Dim>& settings, const Monitor& monitor);

}  // namespace efree::internal
