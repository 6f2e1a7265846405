// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/corrected.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/basis/internal/lifted.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree::internal {
namespace {

/// The answers to the load cases after the first, corrected as that one was: from those of the cloud, or where they
/// have been corrected before, from there.
template <int Dim> void correct_more(const Settings<Dim>& settings, const Corrected<Dim>& best,
                                     const CorrectionOptions& options, bool corrected_before, Result<Dim>& result,
                                     const Monitor& monitor) {
  const Approximation<Dim>& elements = result.basis();
  const auto materials = materials_of(result.model, *result.mesh);
  constexpr std::size_t together = 8;  // as many as share a product; more only take memory
  for (std::size_t first = 0; first < result.more.size(); first += together) {
    const std::size_t count = std::min(together, result.more.size() - first);
    std::vector<Points<Dim>> starts, displacements;
    std::vector<Loads<Dim>> cases;
    for (std::size_t k = first; k < first + count; ++k) {
      starts.push_back(corrected_before ? result.more[k].fields.displacement
                                        : Points<Dim>(interpolate(result.approximation.shape,
                                                                  result.more[k].solution.coefficients)));
      cases.push_back(settings.cases[k + 1].loads);
    }
    auto corrections = best.corrector->correct_all(starts, cases, options, monitor);
    for (auto& one : corrections) displacements.push_back(std::move(one.displacement));
    auto solutions = evaluate_all(elements, result.model, std::move(displacements));
    std::vector<const Fields<Dim>*> fields;
    for (std::size_t k = 0; k < count; ++k) {
      Answer<Dim>& answer = result.more[first + k];
      answer.solution = std::move(solutions[k]);
      answer.fields = recover_fields(elements, answer.solution, *best.fits);
      fields.push_back(&answer.fields);
    }
    const auto mesh = recovery_errors(elements, fields, materials);
    for (std::size_t k = 0; k < count; ++k) {
      auto& estimates = result.more[first + k].estimates;
      const Estimates before = corrected_before ? *estimates : Estimates{0.0, corrections[k].start_error, 0.0, 0};
      estimates = {.cloud = corrections[k].error,
                   .uncorrected = before.uncorrected,
                   .mesh = mesh[k].relative,
                   .corrections = before.corrections + corrections[k].iterations};
    }
  }
}

/// The answer of the finite elements of the fine mesh, as near as it is wanted, and how far that of the cloud is
/// from it. Where linear cells are too coarse, and their degree is left open, quadratic ones take over; where
/// dilatations are averaged quadratic ones do not lock (takes_mean_dilatation). None, and a warning, if
/// there is no memory for these, or if, very near to nu = 1/2, their iterations do not end.
template <int Dim>
std::optional<Estimates> correct(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  std::optional<Stage> stage;
  stage.emplace("correction", monitor);
  const Approximation<Dim>& cloud = result.approximation;
  const bool memory = has_memory_for_quadratic_elements(*result.mesh);
  const auto none = [&](const std::string& why) {
    result.warnings.push_back(fmt::format("{}: the answer is that of the cloud, and its error is not known", why));
    return std::nullopt;
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
  const Points<Dim> start = interpolate(cloud.shape, result.solution.coefficients);
  Corrected<Dim> best;
  try {
    best = corrected(settings, result, functions, start, options, stage->within());
  } catch (const NumericalError& error) {
    if (!cloud.averaged) throw;
    return none(error.what());
  }
  double uncorrected = best.correction.start_error;
  if (cloud.averaged) {
    result.fields = recover_fields(cloud, result.solution);
    Fields<Dim> fields = result.fields;
    if (lifted) fields.stress = internal::lifted<Dim>(functions.space, fields.stress);
    fields.displacement = lifted ? Points<Dim>(internal::lifted<Dim>(functions.space, start)) : start;
    uncorrected =
        mixed_distance(best.elements, best.correction.displacement, fields, materials_of(result.model, *result.mesh));
  }
  Estimates estimates{.cloud = settings.corrected ? best.correction.error : uncorrected,
                      .uncorrected = uncorrected,
                      .mesh = best.mesh_error.relative,
                      .corrections = settings.corrected ? best.correction.iterations : 0};
  const auto tell = [&](double tolerance) {
    stage.reset();
    tell_dual_errors(settings, best, settings.corrected ? *result.elements : best.elements,
                     settings.corrected ? result.fields : best.fields, tolerance, result, monitor);
  };
  if (!settings.corrected) {
    if (result.fields.displacement.size() == 0) result.fields = recover_fields(cloud, result.solution);
    tell(options.tolerance);
    return estimates;
  }
  const auto hand_out = [&] {
    result.elements = std::move(best.elements);
    result.solution = std::move(best.solution);
    result.fields = std::move(best.fields);
    result.error_density = error_density(result, best.mesh_error.squares);
  };
  hand_out();
  const bool free = settings.approximation.interpolation == 0 && options.iterations < 0;
  const bool may_be_finer = free && functions.space.degree() == 1 && memory;
  bool finer = may_be_finer;
  if (finer && estimates.total() <= bearable) {
    if (!settings.goals.empty()) tell(options.tolerance);
    finer = missed_goals(settings, result) > 1.0;
    if (!finer && !settings.goals.empty()) return estimates;  // no cases where there are goals
  }
  // One case that needs them is enough.
  bool corrected_before = false;
  if (!finer && may_be_finer && !result.more.empty()) {
    if (!stage) stage.emplace("correction", monitor);
    correct_more(settings, best, options, false, result, stage->within());
    corrected_before = true;
    finer = std::ranges::any_of(result.more, [&](const auto& answer) { return answer.estimates->total() > bearable; });
  }
  std::optional<Approximation<Dim>> quadratic;
  if (finer) {
    if (!stage) stage.emplace("correction", monitor);
    quadratic.emplace(in_quadratic_space(cloud));
    const Points<Dim> from = std::move(best.correction.displacement);
    best = {};  // what is replaced makes room
    result.elements.reset();
    result.solution = {};
    result.fields = {};
    best = corrected(settings, result, *quadratic, from, options, stage->within());
    estimates.cloud = best.correction.error;
    estimates.mesh = best.mesh_error.relative;
    estimates.corrections += best.correction.iterations;
    hand_out();
  }
  if (!result.more.empty() && (finer || !corrected_before)) {
    if (!stage) stage.emplace("correction", monitor);
    correct_more(settings, best, options, corrected_before, result, stage->within());
  }
  tell(options.tolerance);
  return estimates;
}

/// The errors of finite elements in all load cases, by recovery.
template <int Dim> void estimate_elements(Result<Dim>& result) {
  std::vector<Answer<Dim>*> answers{&result};
  for (Answer<Dim>& answer : result.more) answers.push_back(&answer);
  std::vector<const Fields<Dim>*> fields;
  for (const Answer<Dim>* answer : answers) fields.push_back(&answer->fields);
  const auto errors = recovery_errors(result.approximation, fields, materials_of(result.model, *result.mesh));
  for (std::size_t k = 0; k < answers.size(); ++k) answers[k]->estimates = Estimates{0.0, 0.0, errors[k].relative, 0};
  result.error_density = error_density(result, errors.front().squares);
}

}  // namespace

template <int Dim> void approximate_once(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  if (result.approximation.nodes.cols() > 0) return;
  ApproximationOptions options = settings.approximation;
  if (options.kind == BasisKind::mls && options.spacing == 0.0) options.spacing = default_spacing(*result.mesh);
  require_memory(least_memory(options, *result.mesh),
                 fmt::format("the analysis on {} fine cells", result.mesh->num_cells()),
                 "use a wider cloud spacing or a coarser mesh");
  result.approximation = approximate(result.mesh, options, monitor);
}

template <int Dim> void answer_by_cloud(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  const ApproximationOptions& options = settings.approximation;
  approximate_once(settings, result, monitor);
  std::optional<ElasticSolver<Dim>> solver(std::in_place, result.approximation, result.model, settings.supports,
                                           monitor);
  {
    const Stage stage("solve", monitor);
    std::vector<Loads<Dim>> all{settings.loads};
    for (std::size_t k = 1; k < settings.cases.size(); ++k) all.push_back(settings.cases[k].loads);
    auto solutions = solver->solve_all(all);
    result.more.resize(all.size() - 1);
    for (std::size_t k = 0; k < all.size(); ++k) {
      Answer<Dim>& answer = k == 0 ? static_cast<Answer<Dim>&>(result) : result.more[k - 1];
      answer.solution = std::move(solutions[k]);
      answer.balance.reactions = solver->reactions(answer.solution, all[k]);
    }
  }
  if (options.kind != BasisKind::mls) {
    const auto fits = recovery_fits(result.approximation);
    result.fields = recover_fields(result.approximation, result.solution, fits);
    for (Answer<Dim>& answer : result.more) answer.fields = recover_fields(result.approximation, answer.solution, fits);
    if (settings.estimated) estimate_elements(result);
    const Reference<Dim> reference{result.approximation, result.fields, result.model.essential == Essential::nitsche,
                                   [&](const Functional<Dim>& functional, const Monitor&) {
                                     return solver->respond(functional, result.solution, settings.loads);
                                   }};
    tell_errors(settings, reference, result, monitor);
  } else if (settings.estimated) {
    solver.reset();  // its factor is of no use any more
    result.estimates = correct(settings, result, monitor);
  }
  if (options.kind == BasisKind::p1 &&
      incompressibility(result.model, *result.mesh) > bearable_incompressibility(options.kind))
    result.warnings.push_back(
        "linear elements lock under nearly incompressible materials (nu > 0.4): the body is far stiffer than it should "
        "be; take moving least squares, or quadratic elements");
  const auto doubtful = doubts(settings.approximation, result.approximation);
  result.warnings.insert(result.warnings.end(), doubtful.begin(), doubtful.end());
}

template void approximate_once<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void approximate_once<3>(const Settings<3>&, Result<3>&, const Monitor&);
template void answer_by_cloud<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void answer_by_cloud<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
