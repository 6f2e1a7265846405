// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/analyse.hpp"

#include "efree/analysis/internal/corrected.hpp"
#include "efree/analysis/internal/facet_errors.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/linear_check.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/assembly/follower_pressure.hpp"
#include "efree/assembly/internal/no_follower.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/internal/finite.hpp"
#include "efree/solvers/algorithms/element_reactions.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace efree {

using namespace internal;

namespace {

template <int Dim> void check_finite(const Answer<Dim>& answer) {
  if (!(all_finite(answer.fields.displacement) && all_finite(answer.fields.stress) &&
        std::isfinite(answer.solution.strain_energy)))
    throw NumericalError("the answer is not finite: moduli, loads or lengths leave the range of double precision");
}

/// A force that is rounding: a millionth of what displacements like those of the answer could ask for, so that a body
/// that moves as a whole is in balance.
template <int Dim> double rounding_force(const Materials<Dim>& materials, const Result<Dim>& result,
                                         const Answer<Dim>& answer, double length) {
  const Index middle = result.mesh->num_cells() / 2;
  const double modulus = materials.stiffness(result.mesh->region(middle), result.mesh->centroid(middle)).C(0, 0);
  return 1e-6 * modulus * answer.fields.displacement.cwiseAbs().maxCoeff() * std::pow(length, Dim - 2);
}

/// What of an answer holds the body and loads it. One of a cloud has the reactions of its solver already, one in steps
/// both.
template <int Dim> Balance<Dim> balance_of(const Materials<Dim>& materials, const Result<Dim>& result,
                                           const Answer<Dim>& answer, const Loads<Dim>& loads,
                                           const typename ElementReactions<Dim>::Held* of_elements) {
  const FineSpace<Dim>& space = result.basis().space;
  Balance<Dim> balance{answer.balance.reactions, {}};
  double free_work = 0.0, load_work = 0.0;
  if (!result.history.empty()) {
    balance.loads = answer.balance.loads;
  } else {
    if (of_elements) {
      balance.reactions = of_elements->reactions;
      free_work = of_elements->free_work;
      load_work = std::abs(of_elements->load_work);
    }
    balance.loads = applied_loads(space, loads);
  }
  std::vector<Resultant<Dim>> all;
  for (const auto& [part, of] : balance.reactions) all.push_back(of);
  for (const auto& load : balance.loads) all.push_back(load.of);
  const auto& vertices = result.mesh->vertices();
  const double length = (vertices.rowwise().maxCoeff() - vertices.rowwise().minCoeff()).norm();
  double least = rounding_force(materials, result, answer, length);
  const double rounding_work = 1e-4 * least * answer.fields.displacement.cwiseAbs().maxCoeff();
  if (free_work != 0.0)
    balance.free_work = free_work / std::max({2.0 * answer.solution.strain_energy, load_work, rounding_work});
  for (const auto& step : result.history) {  // what has come and gone leaves rounding
    double forces = 0.0;
    for (const auto& [part, of] : step.reactions) forces += of.force.norm();
    least = std::max(least, forces);
  }
  balance.error = imbalance(all, length, space.axisymmetric(), least);
  return balance;
}

/// Says so if reactions and loads do not balance to rounding; far from it the answer is none.
template <int Dim> void check_balance(const Balance<Dim>& balance, const std::string& of, Result<Dim>& result) {
  constexpr double rounding = 1e-8, bearable = 0.01, least_strain = 1e-8;
  if (balance.error <= rounding) return;
  std::string what = fmt::format(
      "{}reactions and loads are out of balance by {:.2g}, relative: the equations are not solved to rounding", of,
      balance.error);
  if (const double most = result.fields.strain.cwiseAbs().maxCoeff(); !result.history.empty() && most < least_strain)
    what +=
        fmt::format(" (strains of {:.2g}, of which steps through time see no more than what 1 + strain keeps)", most);
  if (balance.error <= bearable || !result.refusal.empty())
    result.warnings.push_back(what);
  else
    result.refusal = what;
}

/// What cells would have of energy if one of their nodes moved alone by the roots of furthest(cell).
template <int Dim, class Furthest>
double energy_alone(const Materials<Dim>& materials, const FineSpace<Dim>& space, const Furthest& furthest) {
  const FineMesh<Dim>& mesh = space.mesh();
  double sum = 0.0;
  Stiffness<Dim> room;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Vec<Dim> x = mesh.centroid(c);
    sum += mesh.volume(c) * space.measure(x) * materials.stiffness(mesh.region(c), x, room).C(0, 0) *
           mesh.hat_gradients(c).squaredNorm() * furthest(c);
  }
  return sum;
}

/// Says so if strains are so small beside the displacements that they may be rounding: of a body that is moved as a
/// whole, far beyond what it is strained. `most`: energy_alone of moves by 1.
template <int Dim> void check_strains(const Materials<Dim>& materials, const FineSpace<Dim>& space, double most,
                                      const Answer<Dim>& answer, const std::string& of, Result<Dim>& result) {
  constexpr double rounding = 4e-24;  // of squares, times that of what differences of displacements keep
  const Points<Dim>& u = answer.fields.displacement;
  const double twice = 2.0 * answer.solution.strain_energy, furthest = u.colwise().squaredNorm().maxCoeff();
  const auto in_cell = [&](Index c) {
    double there = 0.0;
    for (const Index dof : space.cell(c)) there = std::max(there, u.col(dof).squaredNorm());
    return there;
  };
  if (furthest == 0.0 || twice >= rounding * most * furthest ||
      twice >= rounding * energy_alone(materials, space, in_cell))
    return;
  result.warnings.push_back(fmt::format(
      "{}the body moves as a whole, by up to {:.3g}: strains and stresses are so small beside that they may "
      "be rounding; leave what moves all of it out of what is prescribed, or stiffen what holds it",
      of, std::sqrt(furthest)));
}

/// Refuses answers whose corrections rounding has ended: what these leave beyond their tolerance.
template <int Dim> void check_free_work(const Answer<Dim>& answer, const std::string& of, Result<Dim>& result) {
  constexpr double rounding = 0.01;
  const double error = answer.estimates ? answer.estimates->cloud : 0.0, bearable = rounding + error * error;
  const double work = std::abs(answer.balance.free_work);
  if (work <= bearable || !result.refusal.empty()) return;
  result.refusal = fmt::format(
      "{}forces that nothing holds do {:.2g} % of the work: the equations are too ill-conditioned for corrections, the "
      "body is too slender for its mesh, or moduli and springs are too far apart",
      of, 100.0 * work);
}

/// The settings with the loads of the first case in `loads`, and all that acts in each in `cases`.
template <int Dim> Settings<Dim> with_cases(Settings<Dim> settings) {
  auto loads = loads_by_case(settings);
  settings.loads = loads.front();
  for (std::size_t k = 0; k < settings.cases.size(); ++k) settings.cases[k].loads = std::move(loads[k]);
  return settings;
}

/// Whether the settings for linear elasticity do where these are for all that the materials say. Leaves an
/// approximation for whichever is taken, or none.
template <int Dim> bool linear_is_enough(const Settings<Dim>& linear, const Settings<Dim>& full, Result<Dim>& result,
                                         const Monitor& monitor) {
  approximate_once(linear, result, monitor);
  const LinearCheck check = check_linear(full, result, monitor);
  result.linear_checks.push_back(check);
  if (monitor.say)
    monitor.say(check.enough ? fmt::format("model: linear elasticity is enough, {}", text_of(check))
                             : fmt::format("model: linear elasticity is not enough, {}; the full model is taken",
                                           text_of(check)));
  const bool same_cloud =
      full.common.approximation.spacing > 0.0 || spacing_of_path(*result.mesh, true) == default_spacing(*result.mesh);
  if (!check.enough && !(same_cloud && linear.common.approximation.dilatation == full.common.approximation.dilatation))
    result.approximation = {};
  return check.enough;
}

/// What `analyse` returns; of a load path nothing but the checks of linear elasticity if `is_path` is given, which then
/// becomes true. `coarsest`: see answer_by_steps.
template <int Dim> Result<Dim> analyse_or_tell(const PreparedMesh<Dim>& mesh, const Settings<Dim>& given,
                                               const Monitor& watching, bool* is_path,
                                               const Result<Dim>* coarsest = nullptr) {
  if (given.cells == OnCells::always)
    throw InputError(said_at(where_said(given.common, "basis.kind"),
                             "cells (basis.kind = \"cells\") are for analyse_image: analyse has functions on a mesh"));
  Settings<Dim> settings = with_cases(with_defaults(given, mesh));
  StageTimes times;
  const Monitor monitor = watching.timing(times);
  Result<Dim> result;
  result.mesh = mesh.mesh;
  result.offsets = mesh.offsets;
  result.parts = mesh.parts;
  result.reports = mesh.reports;
  const double cpu_start = process_cpu_seconds();
  std::optional<ElasticModel> replaced;  // by a linear one
  if (settings.regime == Regime::automatic && !settings.time && !settings.asks_for_accuracy() &&
      settings.cases.empty()) {
    Settings<Dim> linear = given;
    linear.regime = Regime::linear;
    linear.loads = at_rest(std::move(linear.loads));
    linear.cells = OnCells::never;
    linear = with_defaults(linear, mesh);
    if (located(settings.common, settings.common.where,
                [&] { return linear_is_enough(linear, settings, result, monitor); })) {
      replaced = std::exchange(settings, linear).common.model;
    } else {
      settings.regime = Regime::finite;
    }
  }
  result.model = settings.common.model;
  result.regime = *settings.regime == Regime::automatic ? Regime::finite : *settings.regime;
  const bool in_steps = needs_steps(settings, *mesh.mesh);
  if (in_steps && is_path) {
    *is_path = true;
    return result;
  }
  if (!in_steps)
    located(settings.common, settings.common.where, [&] {
      for (const auto& loads : loads_by_case(settings))
        for (const auto& load : loads.followers) refuse_follower(load.on);
    });
  const bool without_cloud = !in_steps && settings.asks_for_accuracy() && may_do_without_cloud(settings) &&
                             has_memory_for_quadratic_elements(*mesh.mesh);
  located(settings.common, settings.common.where, [&] {
    if (in_steps) return answer_by_steps(settings, coarsest, result, monitor);
    if (without_cloud) return answer_by_elements(settings, result, monitor);
    answer_by_cloud(settings, result, monitor);
  });
  if (replaced) warn_of_overload(settings, *replaced, result);
  add_facet_errors(settings, result);
  judge(settings, result);
  result.cpu_seconds = mesh.cpu_seconds + process_cpu_seconds() - cpu_start;

  std::optional<Stage> stage(std::in_place, "output", monitor);
  const Approximation<Dim>& basis = result.basis();
  const auto materials = materials_of(result.model, *mesh.mesh);
  std::optional<RecoveryFits<Dim>> fits;
  const auto answers = answers_in(result);
  const auto loads = loads_of(settings, 0, answers.size());
  std::vector<typename ElementReactions<Dim>::Held> of_elements;
  if (result.history.empty() && (without_cloud || result.elements)) {
    std::vector<const Solution<Dim>*> solutions;
    for (const Answer<Dim>* answer : answers) solutions.push_back(&answer->solution);
    of_elements = ElementReactions<Dim>(basis, result.model, settings.supports)(loads, solutions);
  }
  const bool by_strains = result.history.empty();
  const double most = by_strains ? energy_alone(materials, basis.space, [](Index) { return 1.0; }) : 0.0;
  for (std::size_t k = 0; k < answers.size(); ++k) {
    Answer<Dim>& answer = *answers[k];
    const std::string of = k == 0 ? "" : fmt::format("case \"{}\": ", settings.cases[k].name);
    if (answer.fields.displacement.size() == 0) {
      if (!fits) fits.emplace(recovery_fits(basis));
      answer.fields = recover_fields(basis, answer.solution, *fits);
    }
    check_finite(answer);
    if (answer.probes.empty() && answer.extremes.empty()) read_off(settings, basis.space, answer);
    answer.balance = balance_of(materials, result, answer, loads[k], of_elements.empty() ? nullptr : &of_elements[k]);
    check_balance(answer.balance, of, result);
    check_free_work(answer, of, result);
    if (result.history.empty() && answer.fields.displacement.isZero(0.0)) result.warnings.push_back(of + nothing_acts);
    if (by_strains) check_strains(materials, basis.space, most, answer, of, result);
  }
  if (settings.has_exact())
    located(settings.common, settings.common.where,
            [&] { result.errors = errors_against(basis, result.fields, materials, settings.exact); });
  if (in_steps && result.errors) result.errors->energy_norm.reset();  // that of linear materials
  if (result.error_density.size() == 0 && !in_steps)
    result.error_density = error_density(result, recovery_error(basis, result.fields, materials).squares);
  result.warnings.insert(result.warnings.end(), mesh.warnings.begin(), mesh.warnings.end());
  stage.reset();
  result.times.add("mesh", mesh.seconds);
  result.times.add(times);
  if (watching.times) watching.times->add(times);
  return result;
}

}  // namespace

template <int Dim> Result<Dim> internal::analyse_unless_path(const PreparedMesh<Dim>& mesh, const Settings<Dim>& given,
                                                             const Monitor& monitor, bool& is_path) {
  is_path = false;
  return analyse_or_tell(mesh, given, monitor, &is_path);
}

template <int Dim> Result<Dim> internal::analyse_level(const PreparedMesh<Dim>& mesh, const Settings<Dim>& given,
                                                       const Result<Dim>* coarsest, const Monitor& monitor) {
  return analyse_or_tell(mesh, given, monitor, nullptr, coarsest);
}

template <int Dim>
Result<Dim> analyse(const PreparedMesh<Dim>& mesh, const Settings<Dim>& given, const Monitor& monitor) {
  Settings<Dim> settings = with_steps_of_checkpoint(given);
  Result<Dim> result = analyse_or_tell<Dim>(mesh, settings, monitor, nullptr);
  while (true) {
    const auto smaller = smaller_steps_for(with_defaults(settings, mesh), result);
    if (!smaller) return result;
    settings = with_smaller_steps(std::move(settings), result, *smaller, monitor);
    try {
      Result<Dim> next = analyse_or_tell<Dim>(mesh, settings, monitor, nullptr);
      next.times.add(result.times);
      next.cpu_seconds += result.cpu_seconds - mesh.cpu_seconds;
      result = std::move(next);
    } catch (const NumericalError& error) {
      result.warnings.push_back(fmt::format("the path fails with smaller steps: {}", error.what()));
      return result;
    }
  }
}

template <int Dim>
Result<Dim> analyse(const FineMesh<Dim>& mesh, const Settings<Dim>& settings, const Monitor& monitor) {
  const auto copied = [&mesh](const MeshSize&, const Stage&) {
    return MadeMesh<Dim>{extract(mesh, std::vector<char>(mesh.num_cells(), 1))};
  };
  const MeshSource<Dim> source{.mesh = copied, .size = mesh.size()};
  if (settings.asks_for_accuracy()) return analyse_to_accuracy(source, settings, monitor);
  const PreparedMesh<Dim> prepared = prepare(source, settings, monitor);
  if (monitor.say)
    for (const std::string& remark : prepared.remarks) monitor.say(remark);
  return analyse(prepared, settings, monitor);
}

template <int Dim>
Result<Dim> analyse(const MeshSource<Dim>& source, const Settings<Dim>& settings, const Monitor& monitor) {
  if (settings.asks_for_accuracy()) return analyse_to_accuracy(source, settings, monitor);
  const PreparedMesh<Dim> mesh = prepare(source, settings, monitor);
  if (monitor.say)
    for (const std::string& remark : mesh.remarks) monitor.say(remark);
  if (chooses_path(source, settings)) return analyse_chosen_path(source, mesh, settings, monitor);
  return analyse(mesh, settings, monitor);
}

template Result<2> internal::analyse_unless_path<2>(const PreparedMesh<2>&, const Settings<2>&, const Monitor&, bool&);
template Result<2> internal::analyse_level<2>(const PreparedMesh<2>&, const Settings<2>&, const Result<2>*,
                                              const Monitor&);
template Result<3> internal::analyse_unless_path<3>(const PreparedMesh<3>&, const Settings<3>&, const Monitor&, bool&);
template Result<3> internal::analyse_level<3>(const PreparedMesh<3>&, const Settings<3>&, const Result<3>*,
                                              const Monitor&);
template Result<2> analyse<2>(const FineMesh<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse<3>(const FineMesh<3>&, const Settings<3>&, const Monitor&);
template Result<2> analyse<2>(const PreparedMesh<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse<3>(const PreparedMesh<3>&, const Settings<3>&, const Monitor&);
template Result<2> analyse<2>(const MeshSource<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse<3>(const MeshSource<3>&, const Settings<3>&, const Monitor&);

}  // namespace efree
