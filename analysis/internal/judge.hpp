// SPDX-License-Identifier: GPL-3.0-or-later
/// Whether an answer is good enough.
#pragma once

#include "efree/analysis/result.hpp"

#include <string>
#include <vector>

namespace efree::internal {

/// Why there is no better answer, where no other mesh may be taken.
inline constexpr const char* mesh_is_said =
    "the case says the size of its mesh: leave mesh_size out, so that it can be chosen";

/// The warning for a body that nothing moves.
inline constexpr const char* nothing_acts =
    "nothing moves or loads the body: all displacements and stresses are zero; give a boundary a displacement or a "
    "load";

/// Doubts about a quadrature with too few points, asked for or reached.
template <int Dim>
std::vector<std::string> doubts(const ApproximationOptions& options, const Approximation<Dim>& approximation);
/// Error from which on an answer is doubtful, or no longer what was asked for.
template <int Dim> double bearable_error(const Settings<Dim>& settings);
/// Relative error of a value of a load path (PathErrors::largest) from which on it is doubtful.
inline constexpr double bearable_error_of_path = 0.05;
/// Part of it that the size of its steps may have.
inline constexpr double bearable_error_of_steps = 0.025;
/// The warnings that errors which were asked for are not reached, because of `why`.
template <int Dim>
std::vector<std::string> misses(const Settings<Dim>& settings, const std::string& why, const Answer<Dim>& answer);
/// Adds them to those of the result.
template <int Dim> void warn_of_misses(const Settings<Dim>& settings, const std::string& why, Result<Dim>& result);
/// Estimated error from which on nothing more is done: recovery overlooks up to a quarter of the error at corners.
template <int Dim> double aim(const Settings<Dim>& settings);
/// What iterations may leave: a twentieth of the square of the error that is aimed at.
template <int Dim> double tolerance_of(const Settings<Dim>& settings);
/// Error over what is aimed at, the largest of all that was asked for (see Attempt).
template <int Dim> double excess(const Settings<Dim>& settings, const Result<Dim>& result);
/// Relative error in the energy norm of a grid of cells that is bearable where no accuracy is asked for: 2 % of the
/// energy. Cells of two voxels leave 10 to 13 % where there are pores, and energies that are extrapolated within half a
/// per cent.
inline constexpr double bearable_error_of_grid = 0.14;
/// The same of one answer on cells, `of` a case: adds to the warnings, or is the refusal.
void judge_grid(const Settings<3>& settings, const Estimates& errors, const std::string& of,
                std::vector<std::string>& warnings, std::string& refusal);
/// Doubts about an answer that is far from the truth, or, beyond what the settings bear, a refusal.
template <int Dim> void judge(const Settings<Dim>& settings, Result<Dim>& result);

}  // namespace efree::internal
