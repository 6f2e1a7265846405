// SPDX-License-Identifier: GPL-3.0-or-later
/// Answers that are led to the finite elements of the fine mesh.
#pragma once

#include "efree/analysis/internal/told_errors.hpp"
#include "efree/solvers/algorithms/correction.hpp"

#include <memory>
#include <vector>

namespace efree::internal {

/// A corrected displacement as a solution of the finite elements of its space.
template <int Dim> struct CorrectedAnswer {
  Correction<Dim> correction;  ///< its displacement is that of the fields
  Solution<Dim> solution;
  Fields<Dim> fields;
  RecoveryError mesh_error;
};

/// Finite elements that answers are led to, and the answers.
template <int Dim> struct Corrected {
  Approximation<Dim> elements;
  std::vector<CorrectedAnswer<Dim>> answers;        ///< to the first load cases
  std::shared_ptr<const RecoveryFits<Dim>> fits;    ///< for further load cases; none if there is one
  std::shared_ptr<const Corrector<Dim>> corrector;  ///< likewise, and for dual solutions; none if none are asked for

  const CorrectedAnswer<Dim>& first() const { return answers.front(); }
};

/// What acts in so many load cases from one on, where all that does is in each; without cases there is one.
template <int Dim>
std::vector<Loads<Dim>> loads_of(const Settings<Dim>& settings, std::size_t first, std::size_t count);

/// Corrects displacements of the functions, those of the first load cases, towards the finite elements of their space.
template <int Dim> Corrected<Dim> corrected(const Settings<Dim>& settings, const Result<Dim>& result,
                                            const Approximation<Dim>& functions, const std::vector<Points<Dim>>& starts,
                                            const CorrectionOptions& options, const Monitor& monitor);
/// The same for further load cases, from that of this number on, of the elements that the result has by now.
template <int Dim>
std::vector<CorrectedAnswer<Dim>> correct_more(const Settings<Dim>& settings, const Result<Dim>& result,
                                               const Corrected<Dim>& towards, std::size_t first,
                                               const std::vector<Points<Dim>>& starts, const CorrectionOptions& options,
                                               const Monitor& monitor);

/// Errors of the numbers that the settings ask for, of the answers in the result that `fields` are given for, those of
/// the elements of `best`, by dual solutions of these. A warning instead if their iterations do not end.
template <int Dim> void tell_dual_errors(const Settings<Dim>& settings, const Corrected<Dim>& best,
                                         const Approximation<Dim>& elements,
                                         const std::vector<const Fields<Dim>*>& fields, double tolerance,
                                         Result<Dim>& result, const Monitor& monitor);

}  // namespace efree::internal
