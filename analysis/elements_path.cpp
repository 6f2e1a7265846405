// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/corrected.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/told_errors.hpp"

#include <cmath>
#include <optional>

namespace efree::internal {

template <int Dim> bool may_do_without_cloud(const Settings<Dim>& settings) {
  const ApproximationOptions& basis = settings.common.approximation;
  const bool says_nothing_of_points = basis.secondary == SecondaryKind::cells && basis.ratio == 0.0 &&
                                      settings.common.model.stabilisation == 0.0,
             says_nothing_of_nodes = basis.spacing == 0.0 && !basis.grading.features && !basis.grading.has_places(),
             says_nothing_of_functions = basis.order == 1 && basis.interpolation != 1 && basis.support == 0.0 &&
                                         basis.weight == Weight::automatic && basis.vanish_on.empty();
  return Dim == 2 && settings.cells == OnCells::automatic && basis.kind == BasisKind::mls && says_nothing_of_nodes &&
         says_nothing_of_functions && says_nothing_of_points && basis.dilatation != Dilatation::averaged &&
         settings.estimated && settings.corrected && settings.correction.iterations < 0;
}

template <int Dim> void answer_by_elements(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  std::optional<Stage> stage;
  stage.emplace("correction", monitor);
  Approximation<Dim> quadratic;
  quadratic.space = FineSpace<Dim>(result.mesh, 2, settings.common.approximation.axisymmetric);
  const Points<Dim> nothing = Points<Dim>::Zero(Dim, quadratic.space.size());
  const double tolerance = tolerance_of(settings);
  Corrected<Dim> best = corrected(settings, result, quadratic, {nothing}, {.tolerance = tolerance}, stage->within());
  CorrectedAnswer<Dim>& answer = best.answers.front();
  double squares = 0.0;  // what linear elements left
  const Correction<Dim>& correction = answer.correction;
  for (std::size_t k = 1; k < correction.taken.size(); ++k) squares += correction.taken[k];
  result.estimates = {.cloud = correction.error,
                      .uncorrected = std::sqrt(squares),
                      .mesh = answer.mesh_error.relative,
                      .corrections = correction.iterations};
  result.approximation = std::move(best.elements);
  result.solution = std::move(answer.solution);
  result.fields = std::move(answer.fields);
  result.error_density = error_density(result, answer.mesh_error.squares);
  stage.reset();
  tell_dual_errors(settings, best, result.approximation, {&result.fields}, tolerance, result, monitor);
}

template bool may_do_without_cloud<2>(const Settings<2>&);
template bool may_do_without_cloud<3>(const Settings<3>&);
template void answer_by_elements<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void answer_by_elements<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
