// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/corrected.hpp"

#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree::internal {

namespace {

template <int Dim>
std::vector<CorrectedAnswer<Dim>> answers_of(const Result<Dim>& result, const Approximation<Dim>& elements,
                                             const RecoveryFits<Dim>& fits, std::vector<Correction<Dim>> corrections) {
  std::vector<Points<Dim>> displacements;
  for (auto& one : corrections) displacements.push_back(std::move(one.displacement));
  auto solutions = evaluate_all(elements, result.model, std::move(displacements));
  std::vector<CorrectedAnswer<Dim>> answers(corrections.size());
  std::vector<const Fields<Dim>*> fields;
  for (std::size_t k = 0; k < answers.size(); ++k) {
    answers[k].correction = std::move(corrections[k]);
    answers[k].solution = std::move(solutions[k]);
    answers[k].fields = recover_fields(elements, answers[k].solution, fits);
    // u . K u is rounding where supports move the body much further than they strain it.
    Correction<Dim>& correction = answers[k].correction;
    if (const double twice = 2.0 * answers[k].solution.strain_energy; correction.whole > 0.0 && twice > 0.0) {
      correction.error *= std::sqrt(correction.whole / twice);
      correction.start_error *= std::sqrt(correction.whole / twice);
    }
    fields.push_back(&answers[k].fields);
  }
  auto errors = recovery_errors(elements, fields, materials_of(result.model, *result.mesh));
  for (std::size_t k = 0; k < answers.size(); ++k) answers[k].mesh_error = std::move(errors[k]);
  return answers;
}

}  // namespace

template <int Dim>
std::vector<Loads<Dim>> loads_of(const Settings<Dim>& settings, std::size_t first, std::size_t count) {
  if (first == 0 && count == 1) return {settings.loads};
  std::vector<Loads<Dim>> loads;
  for (std::size_t k = first; k < first + count; ++k) loads.push_back(settings.cases[k].loads);
  return loads;
}

template <int Dim> Corrected<Dim> corrected(const Settings<Dim>& settings, const Result<Dim>& result,
                                            const Approximation<Dim>& functions, const std::vector<Points<Dim>>& starts,
                                            const CorrectionOptions& options, const Monitor& monitor) {
  Corrected<Dim> all;
  all.corrector = std::make_shared<const Corrector<Dim>>(functions, result.model, settings.supports, monitor);
  auto corrections = all.corrector->correct_all(starts, loads_of(settings, 0, starts.size()), options, monitor);
  if (!asks_for_errors(settings) && settings.cases.size() < 2) all.corrector.reset();
  const auto elements = functions.space.degree() == 1 ? BasisKind::p1 : BasisKind::p2;
  all.elements =
      approximate<Dim>(*result.mesh, {.kind = elements,
                                      .axisymmetric = functions.space.axisymmetric(),
                                      .dilatation = averaged_if(takes_mean_dilatation(functions, result.model))});
  auto fits = std::make_shared<const RecoveryFits<Dim>>(recovery_fits(all.elements));
  all.answers = answers_of(result, all.elements, *fits, std::move(corrections));
  if (settings.cases.size() > 1) all.fits = std::move(fits);
  return all;
}

template <int Dim>
std::vector<CorrectedAnswer<Dim>> correct_more(const Settings<Dim>& settings, const Result<Dim>& result,
                                               const Corrected<Dim>& towards, std::size_t first,
                                               const std::vector<Points<Dim>>& starts, const CorrectionOptions& options,
                                               const Monitor& monitor) {
  return answers_of(result, result.basis(), *towards.fits,
                    towards.corrector->correct_all(starts, loads_of(settings, first, starts.size()), options, monitor));
}

template <int Dim> void tell_dual_errors(const Settings<Dim>& settings, const Corrected<Dim>& best,
                                         const Approximation<Dim>& elements,
                                         const std::vector<const Fields<Dim>*>& fields, double tolerance,
                                         Result<Dim>& result, const Monitor& monitor) {
  const auto duals = [&](const std::vector<Functional<Dim>>& functionals, const Monitor& within) {
    std::vector<Points<Dim>> displacements;
    for (auto& z : best.corrector->duals(functionals, {.tolerance = std::min(tolerance, 0.01)}, within))
      displacements.push_back(std::move(z.displacement));
    return displacements;
  };
  const auto value = [&](const Functional<Dim>& functional, const Points<Dim>& z, std::size_t k) {
    return best.corrector->value(functional, z, fields[k]->displacement, loads_of(settings, k, 1).front());
  };
  try {
    tell_errors(settings, {elements, fields, false, duals, value}, result, monitor);
  } catch (const NumericalError& error) {
    for (Answer<Dim>* answer : answers_in(result)) answer->probe_errors.clear(), answer->reactions.clear();
    result.warnings.push_back(fmt::format("errors of probes and reactions are not known: {}", error.what()));
  }
}

template std::vector<Loads<2>> loads_of<2>(const Settings<2>&, std::size_t, std::size_t);
template std::vector<Loads<3>> loads_of<3>(const Settings<3>&, std::size_t, std::size_t);
template Corrected<2> corrected<2>(const Settings<2>&, const Result<2>&, const Approximation<2>&,
                                   const std::vector<Points<2>>&, const CorrectionOptions&, const Monitor&);
template std::vector<CorrectedAnswer<2>> correct_more<2>(const Settings<2>&, const Result<2>&, const Corrected<2>&,
                                                         std::size_t, const std::vector<Points<2>>&,
                                                         const CorrectionOptions&, const Monitor&);
template void tell_dual_errors<2>(const Settings<2>&, const Corrected<2>&, const Approximation<2>&,
                                  const std::vector<const Fields<2>*>&, double, Result<2>&, const Monitor&);
template Corrected<3> corrected<3>(const Settings<3>&, const Result<3>&, const Approximation<3>&,
                                   const std::vector<Points<3>>&, const CorrectionOptions&, const Monitor&);
template std::vector<CorrectedAnswer<3>> correct_more<3>(const Settings<3>&, const Result<3>&, const Corrected<3>&,
                                                         std::size_t, const std::vector<Points<3>>&,
                                                         const CorrectionOptions&, const Monitor&);
template void tell_dual_errors<3>(const Settings<3>&, const Corrected<3>&, const Approximation<3>&,
                                  const std::vector<const Fields<3>*>&, double, Result<3>&, const Monitor&);

}  // namespace efree::internal
