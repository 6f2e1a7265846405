// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/corrected.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/basis/internal/lifted.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree::internal {
namespace {

/// Hands out a corrected answer, to one that may have been corrected before.
template <int Dim> void hand_out(CorrectedAnswer<Dim>& from, Answer<Dim>& to) {
  const Correction<Dim>& correction = from.correction;
  const std::optional<Estimates> before = to.estimates;
  to.solution = std::move(from.solution);
  to.fields = std::move(from.fields);
  to.estimates = {.cloud = correction.error,
                  .uncorrected = before ? before->uncorrected : correction.start_error,
                  .mesh = from.mesh_error.relative,
                  .corrections = correction.iterations + (before ? before->corrections : 0)};
}

/// What the correction of a load case starts from: the answer of the cloud, or where that has been corrected before,
/// this one.
template <int Dim> Points<Dim> start_of(const Result<Dim>& result, const Answer<Dim>& answer) {
  return answer.estimates ? answer.fields.displacement
                          : Points<Dim>(interpolate(result.approximation.shape, answer.solution.coefficients));
}

/// How far the answer of a cloud with averaged dilatations, as its fields are recovered, is from that of finite
/// elements.
template <int Dim> double distance_of_averaged(const Result<Dim>& result, const Approximation<Dim>& elements,
                                               const Points<Dim>& start, Fields<Dim> fields,
                                               const Points<Dim>& displacement) {
  const bool lift = result.approximation.space.degree() < elements.space.degree();
  if (lift) fields.stress = lifted<Dim>(elements.space, fields.stress);
  fields.displacement = lift ? Points<Dim>(lifted<Dim>(elements.space, start)) : start;
  return mixed_distance(elements, displacement, fields, materials_of(result.model, *result.mesh));
}

/// The answers to the load cases from that of this number on, corrected as the ones before.
template <int Dim> void correct_rest(const Settings<Dim>& settings, const Corrected<Dim>& best, std::size_t first,
                                     const CorrectionOptions& options, Result<Dim>& result, const Monitor& monitor) {
  const auto answers = answers_in(result);
  while (first < answers.size()) {
    std::vector<Points<Dim>> starts;
    for (std::size_t k = first; k < std::min(first + cases_together, answers.size()); ++k)
      starts.push_back(start_of(result, *answers[k]));
    auto start = starts.begin();
    for (auto& one : correct_more(settings, result, best, first, starts, options, monitor)) {
      Answer<Dim>& answer = *answers[first++];
      if (result.approximation.averaged && !answer.estimates)
        one.correction.start_error =
            distance_of_averaged(result, *result.elements, *start,
                                 recover_fields(result.approximation, answer.solution), one.fields.displacement);
      hand_out(one, answer);
      ++start;
    }
  }
}

/// The fields of the answers to all load cases.
template <int Dim> std::vector<const Fields<Dim>*> fields_in(Result<Dim>& result) {
  std::vector<const Fields<Dim>*> fields;
  for (const Answer<Dim>* answer : answers_in(result)) fields.push_back(&answer->fields);
  return fields;
}

/// The answer of the finite elements of the fine mesh, as near as it is wanted, and how far that of the cloud is
/// from it, of all load cases. Where linear cells are too coarse, and their degree is left open, quadratic ones take
/// over; where dilatations are averaged quadratic ones do not lock (takes_mean_dilatation). A warning instead if there
/// is no memory for these, or if, very near to nu = 1/2, their iterations do not end.
template <int Dim> void correct(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  std::optional<Stage> stage;
  stage.emplace("correction", monitor);
  const Approximation<Dim>& cloud = result.approximation;
  const bool memory = has_memory_for_quadratic_elements(*result.mesh);
  const auto none = [&](const std::string& why) {
    result.warnings.push_back(fmt::format("{}: the answer is that of the cloud, and its error is not known", why));
  };
  if (cloud.averaged && !memory)
    return none("there is no memory for the quadratic elements that nearly incompressible materials need");
  CorrectionOptions options = settings.correction;
  const double bearable = aim(settings);
  options.tolerance = std::min(options.tolerance, tolerance_of(settings));
  // The energy norm sees next to nothing of pressures that the bulk modulus bears: they are to be as good as shears.
  if (cloud.averaged) options.tolerance /= std::sqrt(std::max(1.0, incompressibility(result.model, *result.mesh)));
  // As many as the estimate takes. What a cloud with averaged dilatations is off is seen at the end only.
  if (!settings.corrected) options.iterations = cloud.averaged ? -1 : 2;
  std::optional<Approximation<Dim>> lifted;
  if (cloud.averaged && cloud.space.degree() == 1) lifted.emplace(in_quadratic_space(cloud));
  const Approximation<Dim>& functions = lifted ? *lifted : cloud;
  const Points<Dim> start = start_of(result, result);
  Corrected<Dim> best;
  try {
    best = corrected(settings, result, functions, {start}, options, stage->within());
  } catch (const NumericalError& error) {
    if (!cloud.averaged) throw;
    return none(error.what());
  }
  double uncorrected = best.first().correction.start_error;
  if (cloud.averaged) {
    result.fields = recover_fields(cloud, result.solution);
    uncorrected = distance_of_averaged(result, best.elements, start, result.fields, best.first().fields.displacement);
  }
  if (!settings.corrected) {
    if (result.fields.displacement.size() == 0) result.fields = recover_fields(cloud, result.solution);
    const double mesh = best.first().mesh_error.relative;
    stage.reset();
    tell_dual_errors(settings, best, best.elements, {&best.first().fields}, options.tolerance, result, monitor);
    result.estimates = {uncorrected, uncorrected, mesh, 0};
    return;
  }
  const auto tell = [&] {
    stage.reset();
    tell_dual_errors(settings, best, *result.elements, fields_in(result), options.tolerance, result, monitor);
  };
  // Takes the answers to the first load cases, with the elements that they are of.
  const auto take = [&] {
    const auto answers = answers_in(result);
    for (std::size_t k = 0; k < best.answers.size(); ++k) hand_out(best.answers[k], *answers[k]);
    result.elements = std::move(best.elements);
    result.error_density = error_density(result, best.first().mesh_error.squares);
  };
  take();
  result.estimates->uncorrected = uncorrected;
  std::size_t done = 1;  // load cases
  const auto correct_others = [&] {
    if (done == 1 + result.more.size()) return;
    if (!stage) stage.emplace("correction", monitor);
    correct_rest(settings, best, done, options, result, stage->within());
    done = 1 + result.more.size();
  };
  const bool free = settings.common.approximation.interpolation == 0 && options.iterations < 0;
  const bool may_be_finer = free && functions.space.degree() == 1 && memory;
  bool finer = may_be_finer;
  if (finer && result.estimates->total() <= bearable) {
    if (!settings.goals.empty()) tell();
    finer = missed_goals<Dim>(settings, result) > 1.0;
    if (!finer && !settings.goals.empty()) return;  // no cases where there are goals
  }
  // One case that needs them is enough.
  if (!finer && may_be_finer) {
    correct_others();
    finer = std::ranges::any_of(result.more, [&](const auto& answer) { return answer.estimates->total() > bearable; });
  }
  std::optional<Approximation<Dim>> quadratic;
  if (finer) {
    if (!stage) stage.emplace("correction", monitor);
    quadratic.emplace(in_quadratic_space(cloud));
    std::vector<Points<Dim>> starts;
    for (const Answer<Dim>* answer : answers_in(result))
      if (starts.size() < cases_together) starts.push_back(start_of(result, *answer));
    best = {};  // what is replaced makes room
    result.elements.reset();
    result.solution = {};
    result.fields = {};
    best = corrected(settings, result, *quadratic, starts, options, stage->within());
    take();
    done = starts.size();
  }
  correct_others();
  tell();
}

/// The errors of finite elements in all load cases, by recovery.
template <int Dim> void estimate_elements(Result<Dim>& result) {
  const auto answers = answers_in(result);
  const auto errors =
      recovery_errors(result.approximation, fields_in(result), materials_of(result.model, *result.mesh));
  for (std::size_t k = 0; k < answers.size(); ++k) answers[k]->estimates = Estimates{0.0, 0.0, errors[k].relative, 0};
  result.error_density = error_density(result, errors.front().squares);
}

}  // namespace

template <int Dim> void approximate_once(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  if (result.approximation.nodes.cols() > 0) return;
  ApproximationOptions options = settings.common.approximation;
  if (options.kind == BasisKind::mls && options.spacing == 0.0)
    options.spacing =
        needs_steps(settings, *result.mesh) ? spacing_of_path(*result.mesh, true) : default_spacing(*result.mesh);
  require_memory(least_memory(options, *result.mesh),
                 fmt::format("the analysis on {} fine cells", result.mesh->num_cells()),
                 "use a wider cloud spacing or a coarser mesh");
  result.approximation = approximate(result.mesh, options, monitor);
}

template <int Dim> void answer_by_cloud(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  const ApproximationOptions& options = settings.common.approximation;
  approximate_once(settings, result, monitor);
  std::optional<ElasticSolver<Dim>> solver(std::in_place, result.approximation, result.model, settings.supports,
                                           monitor);
  const auto all = loads_of(settings, 0, std::max<std::size_t>(1, settings.cases.size()));
  {
    const Stage stage("solve", monitor);
    auto solutions = solver->solve_all(all);
    result.more.resize(all.size() - 1);
    const auto answers = answers_in(result);
    std::vector<const Solution<Dim>*> solved;
    for (std::size_t k = 0; k < all.size(); ++k) {
      answers[k]->solution = std::move(solutions[k]);
      solved.push_back(&answers[k]->solution);
    }
    auto reactions = solver->reactions(solved, all);
    for (std::size_t k = 0; k < all.size(); ++k) answers[k]->balance.reactions = std::move(reactions[k]);
  }
  if (options.kind != BasisKind::mls) {
    const auto fits = recovery_fits(result.approximation);
    for (Answer<Dim>* answer : answers_in(result))
      answer->fields = recover_fields(result.approximation, answer->solution, fits);
    if (settings.estimated) estimate_elements(result);
    const Reference<Dim> reference{
        result.approximation, fields_in(result), result.model.essential == Essential::nitsche,
        [&](const std::vector<Functional<Dim>>& functionals, const Monitor&) { return solver->duals(functionals); },
        [&](const Functional<Dim>& functional, const Points<Dim>&, std::size_t k) {
          return solver->value(functional, answers_in(result)[k]->solution.coefficients, all[k]);
        }};
    tell_errors(settings, reference, result, monitor);
  } else if (settings.estimated) {
    solver.reset();  // its factor is of no use any more
    correct(settings, result, monitor);
  }
  if (options.kind == BasisKind::p1 &&
      incompressibility(result.model, *result.mesh) > bearable_incompressibility(options.kind))
    result.warnings.push_back(
        "linear elements lock under nearly incompressible materials (nu > 0.4): the body is far stiffer than it should "
        "be; take moving least squares, or quadratic elements");
  const auto doubtful = doubts(settings.common.approximation, result.approximation);
  result.warnings.insert(result.warnings.end(), doubtful.begin(), doubtful.end());
}

template void approximate_once<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void approximate_once<3>(const Settings<3>&, Result<3>&, const Monitor&);
template void answer_by_cloud<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void answer_by_cloud<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
