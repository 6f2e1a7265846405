// SPDX-License-Identifier: GPL-3.0-or-later
/// Answers that are led to the finite elements of the fine mesh.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/correction.hpp"

#include <memory>

namespace efree::internal {

/// A corrected displacement as a solution of the finite elements of its space.
template <int Dim> struct Corrected {
  Correction<Dim> correction;
  Approximation<Dim> elements;
  Solution<Dim> solution;
  Fields<Dim> fields;
  RecoveryError mesh_error;
  std::shared_ptr<const RecoveryFits<Dim>> fits;    ///< for further load cases; none if there is one
  std::shared_ptr<const Corrector<Dim>> corrector;  ///< for dual solutions; none if none are asked for
};
/// Corrects the displacement `start` of the functions towards the finite elements of their space.
template <int Dim> Corrected<Dim> corrected(const Settings<Dim>& settings, const Result<Dim>& result,
                                            const Approximation<Dim>& functions, const Points<Dim>& start,
                                            const CorrectionOptions& options, const Monitor& monitor);

/// Errors of the numbers that the settings ask for, of the answer in the result, by dual solutions of the elements of
/// `best`, which has these fields. A warning instead if their iterations do not end.
template <int Dim> void tell_dual_errors(const Settings<Dim>& settings, const Corrected<Dim>& best,
                                         const Approximation<Dim>& elements, const Fields<Dim>& fields,
                                         double tolerance, Result<Dim>& result, const Monitor& monitor);

}  // namespace efree::internal
