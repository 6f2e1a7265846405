// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/corrected.hpp"

#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree::internal {

template <int Dim> Corrected<Dim> corrected(const Settings<Dim>& settings, const Result<Dim>& result,
                                            const Approximation<Dim>& functions, const Points<Dim>& start,
                                            const CorrectionOptions& options, const Monitor& monitor) {
  Corrected<Dim> result_of;
  result_of.corrector = std::make_shared<const Corrector<Dim>>(functions, result.model, settings.supports, monitor);
  result_of.correction = result_of.corrector->correct(start, settings.loads, options, monitor);
  if (!asks_for_errors(settings) && settings.cases.size() < 2) result_of.corrector.reset();
  return_freed_memory();
  const auto elements = functions.space.degree() == 1 ? BasisKind::p1 : BasisKind::p2;
  result_of.elements =
      approximate<Dim>(*result.mesh, {.kind = elements,
                                      .axisymmetric = functions.space.axisymmetric(),
                                      .dilatation = averaged_if(takes_mean_dilatation(functions, result.model))});
  result_of.solution = evaluate(result_of.elements, result.model, result_of.correction.displacement);
  auto fits = recovery_fits(result_of.elements);
  result_of.fields = recover_fields(result_of.elements, result_of.solution, fits);
  if (settings.cases.size() > 1) result_of.fits = std::make_shared<const RecoveryFits<Dim>>(std::move(fits));
  result_of.mesh_error = recovery_error(result_of.elements, result_of.fields, materials_of(result.model, *result.mesh));
  return result_of;
}

template <int Dim> void tell_dual_errors(const Settings<Dim>& settings, const Corrected<Dim>& best,
                                         const Approximation<Dim>& elements, const Fields<Dim>& fields,
                                         double tolerance, Result<Dim>& result, const Monitor& monitor) {
  const auto respond = [&](const Functional<Dim>& functional, const Monitor& within) {
    return best.corrector->respond(functional, best.correction.displacement, settings.loads,
                                   {.tolerance = std::min(tolerance, 0.01)}, within);
  };
  try {
    tell_errors(settings, {elements, fields, false, respond}, result, monitor);
  } catch (const NumericalError& error) {
    result.probe_errors.clear();
    result.reactions.clear();
    result.warnings.push_back(fmt::format("errors of probes and reactions are not known: {}", error.what()));
  }
}

template Corrected<2> corrected<2>(const Settings<2>&, const Result<2>&, const Approximation<2>&, const Points<2>&,
                                   const CorrectionOptions&, const Monitor&);
template Corrected<3> corrected<3>(const Settings<3>&, const Result<3>&, const Approximation<3>&, const Points<3>&,
                                   const CorrectionOptions&, const Monitor&);
template void tell_dual_errors<2>(const Settings<2>&, const Corrected<2>&, const Approximation<2>&, const Fields<2>&,
                                  double, Result<2>&, const Monitor&);
template void tell_dual_errors<3>(const Settings<3>&, const Corrected<3>&, const Approximation<3>&, const Fields<3>&,
                                  double, Result<3>&, const Monitor&);

}  // namespace efree::internal
