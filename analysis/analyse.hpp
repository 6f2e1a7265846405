// SPDX-License-Identifier: GPL-3.0-or-later
/// From settings to results on a mesh, by a cloud or by finite elements: the one pipeline that the command line, the
/// studies and C++ users share. Images in space are answered without a mesh by analyse_image.
#pragma once

#include "efree/analysis/result.hpp"

namespace efree {

/// Runs an analysis on a mesh, which it copies; of several regions each gets functions of its own, tied to those of the
/// others. Throws InputError beginning with the place where it was said (names that the mesh does not have, free rigid
/// motion, spacing larger than the body), NumericalError, and Cancelled.
template <int Dim>
Result<Dim> analyse(const FineMesh<Dim>& mesh, const Settings<Dim>& settings, const Monitor& monitor = {});
/// The same on the mesh that a source gives, or on as many as the accuracy that is asked for takes
/// (analyse_to_accuracy). monitor.say hears of what was found on the mesh.
template <int Dim>
Result<Dim> analyse(const MeshSource<Dim>& source, const Settings<Dim>& settings, const Monitor& monitor = {});
/// The same on this very mesh, whatever accuracy is asked for.
template <int Dim>
Result<Dim> analyse(const PreparedMesh<Dim>& mesh, const Settings<Dim>& settings, const Monitor& monitor = {});

/// Runs an analysis until its estimated error is within three quarters of settings.accuracy (at corners recovery
/// overlooks up to a quarter of the error), and those of probes and reactions within their goals: corrections (in the
/// plane of linear elements, no cloud is built if none is said) and, where linear cells do not do, quadratic ones, mesh
/// after mesh, as fine as the errors before ask for. A mesh whose size is said is the only one. Ends with the best
/// answer and a warning if a finer mesh would take more memory than there is or more time than settings.time_limit
/// leaves. monitor.say hears of every mesh. Throws like prepare and analyse, and InputError without estimates
/// (require_estimates).
template <int Dim> Result<Dim> analyse_to_accuracy(const MeshSource<Dim>& source, const Settings<Dim>& settings,
                                                   const Monitor& monitor = {});

}  // namespace efree
