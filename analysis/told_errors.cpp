// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/told_errors.hpp"

#include "efree/analysis/internal/corrected.hpp"
#include "efree/analysis/internal/facet_errors.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/cells/cell_errors.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <span>

namespace efree::internal {
namespace {

/// What recovery changes in the cells around a place: the most in each, and the mean of these.
template <int Dim> double stress_error(const Approximation<Dim>& basis, const Fields<Dim>& fields,
                                       const Materials<Dim>& materials, Index place) {
  double sum = 0.0;
  const auto cells = stress_differences(basis, fields, materials, place);
  for (const auto& differences : cells) {
    double most = 0.0;
    for (Index k = 0; k < differences.cols(); ++k)
      most = std::max(most, von_mises<Dim>(Voigt<Dim>(differences.col(k))));
    sum += most;
  }
  return sum / static_cast<double>(cells.size());
}

}  // namespace

template <int Dim> bool asks_for_errors(const Settings<Dim>& settings) {
  return !settings.probes.empty() || !settings.reactions.empty() || settings.largest_displacement ||
         settings.largest_stress;
}

template <int Dim> void read_off(const Settings<Dim>& settings, const FineSpace<Dim>& space, Answer<Dim>& answer) {
  answer.probes.clear();
  answer.extremes.clear();
  const Locator<Dim> locate_probe(space.mesh(), settings.probes.size());
  for (const auto& p : settings.probes)
    answer.probes.emplace_back(p.name, probe(space, answer.fields, locate_probe(p.at)));
  const auto add = [&](const char* of, const Vector& values) {
    Index place = 0;
    const double value = values.maxCoeff(&place);
    answer.extremes.push_back({of, value, space.points().col(space.dof_at(place)), place, std::nullopt});
  };
  add("displacement", answer.fields.displacement.colwise().norm().transpose());
  add("von_mises", von_mises_at_places(answer.fields));
}

template <int Dim> void tell_errors(const Settings<Dim>& settings, const Reference<Dim>& reference, Result<Dim>& result,
                                    const Monitor& monitor) {
  const std::vector<Answer<Dim>*> all = answers_in(result);
  const std::span answers(all.data(), reference.fields.size());
  for (Answer<Dim>* answer : answers) {
    read_off<Dim>(settings, result.basis().space, *answer);
    answer->probe_errors.clear();
    answer->reactions.clear();
    answer->on_surface.reset();
  }
  if (!asks_for_errors(settings)) return;
  const Stage stage("duals", monitor);
  const FineSpace<Dim>& space = reference.elements.space;
  const auto materials = materials_of(result.model, *result.mesh);
  // The value of a functional for the reference's solution, how far that is off the one of its facets, and by how much
  // it changes from them to the true surface.
  struct Value {
    double value, left_by_cells;
    ShapeChange change;

    // Two errors of any sign, as in Estimates::total.
    double left() const { return std::hypot(left_by_cells, change.size()); }
    void put_on_surface(Answer<Dim>& answer, std::map<std::string, WithError<Vec<Dim>>> OnSurface<Dim>::*kind,
                        const std::string& name, int d) const {
      if (!answer.on_surface) return;
      auto& [on_surface, error] =
          ((*answer.on_surface).*kind).try_emplace(name, Vec<Dim>::Zero(), Vec<Dim>::Zero()).first->second;
      on_surface[d] = value + change.sum;
      error[d] = std::hypot(left_by_cells, left_by_first_order * change.size());
    }
  };
  // A functional, and who is told its value, for some of the load cases.
  struct Wanted {
    Functional<Dim> functional;
    std::size_t first, end;  // load cases
    std::function<void(std::size_t, const Value& of)> tell;
  };
  std::vector<Wanted> wanted;
  for (std::size_t p = 0; p < settings.probes.size(); ++p)
    for (int d = 0; d < Dim; ++d)
      wanted.push_back({displacement_at<Dim>(space, settings.probes[p].at, Vec<Dim>::Unit(d)), 0, answers.size(),
                        [&, p, d](std::size_t k, const Value& of) {
                          const auto& [name, told] = answers[k]->probes[p];
                          of.put_on_surface(*answers[k], &OnSurface<Dim>::probes, name, d);
                          answers[k]->probe_errors.try_emplace(name, Vec<Dim>::Zero()).first->second[d] =
                              std::abs(of.value - told.displacement[d]) + of.left();
                        }});
  const auto ties = tied_facets(*result.mesh, result.model.open_interface);
  for (std::size_t r = 0; r < settings.reactions.size(); ++r) {
    const auto& [name, on, where] = settings.reactions[r];
    for (Answer<Dim>* answer : answers) answer->reactions.push_back({name, Vec<Dim>::Zero(), Vec<Dim>::Zero()});
    for (int d = 0; d < Dim; ++d) {
      auto functional = reaction_of<Dim>(space, settings.supports, ties, on, Vec<Dim>::Unit(d), reference.weakly);
      if (!functional.moves()) continue;
      std::vector<double> shared;
      for (const Fields<Dim>* fields : reference.fields)
        shared.push_back(std::abs(shared_work<Dim>(space, settings.supports, on, Vec<Dim>::Unit(d), functional,
                                                   fields->stress, reference.weakly)));
      wanted.push_back({std::move(functional), 0, answers.size(), [&, r, d, shared](std::size_t k, const Value& of) {
                          ReactionResult<Dim>& reaction = answers[k]->reactions[r];
                          of.put_on_surface(*answers[k], &OnSurface<Dim>::reactions, reaction.name, d);
                          reaction.force[d] = of.value;
                          reaction.error[d] = of.left() + shared[k];
                        }});
    }
  }
  for (std::size_t k = 0; k < answers.size(); ++k)
    for (auto& extreme : answers[k]->extremes) {
      if (!(extreme.of == "displacement" ? settings.largest_displacement : settings.largest_stress)) continue;
      if (extreme.of != "displacement") {
        extreme.error = stress_error(result.basis(), answers[k]->fields, materials, extreme.place);
        continue;
      }
      extreme.error = 0.0;
      if (extreme.value == 0.0) continue;
      Functional<Dim> functional{Points<Dim>::Zero(Dim, space.size()), {}, {}};
      functional.forces.col(extreme.place) = answers[k]->fields.displacement.col(extreme.place) / extreme.value;
      wanted.push_back({std::move(functional), k, k + 1, [&extreme](std::size_t, const Value& of) {
                          extreme.error = std::abs(of.value - extreme.value) + of.left();
                        }});
    }
  const RecoveryFits<Dim> fits = recovery_fits(reference.elements);
  const auto shape = shape_derivative(settings, result, space, materials);
  const auto loads = loads_of(settings, 0, answers.size());
  if (shape)
    for (Answer<Dim>* answer : answers) answer->on_surface.emplace();
  for (std::size_t first = 0; first < wanted.size(); first += cases_together) {
    stage.check();
    const std::span batch = std::span(wanted).subspan(first, std::min(cases_together, wanted.size() - first));
    std::vector<Functional<Dim>> functionals;
    for (Wanted& one : batch) functionals.push_back(std::move(one.functional));
    const std::vector<Points<Dim>> duals = reference.duals(functionals, stage.within());
    for (std::size_t w = 0; w < batch.size(); ++w) {
      const auto fields =
          recover_fields(reference.elements, evaluate(reference.elements, result.model, duals[w]), fits);
      for (std::size_t k = batch[w].first; k < batch[w].end; ++k) {
        batch[w].tell(
            k, {reference.value(functionals[w], duals[w], k),
                functional_error(reference.elements, *reference.fields[k], fields, materials),
                shape ? shape->functional(reference.fields[k]->displacement, duals[w], loads[k]) : ShapeChange{}});
      }
    }
  }
}

void tell_errors_on_cells(const Settings<3>& settings, const CellSolution& cells, Answer<3>& answer) {
  answer.probe_errors.clear();
  answer.reactions.clear();
  for (std::size_t k = 0; k < settings.probes.size(); ++k) {
    auto& [name, values] = answer.probes[k];
    values.displacement = displacement_at(cells, 0, settings.probes[k].at);
    answer.probe_errors[name] = displacement_error_at(cells, settings.probes[k].at);
  }
  for (const auto& reaction : settings.reactions)
    answer.reactions.push_back(
        {reaction.name, cells.finest().reactions.at(reaction.on).force, reaction_error(cells, reaction.on)});
  for (auto& extreme : answer.extremes)
    if (extreme.of == "displacement") {
      const Vec<3> along = displacement_at(cells, 0, extreme.at) / std::max(extreme.value, 1e-300);
      extreme.error = along.cwiseAbs().dot(displacement_error_at(cells, extreme.at));
    }
}

template <int Dim> Vector error_density(const Result<Dim>& result, const Vector& squares) {
  const auto& space = result.basis().space;
  Vector volumes(squares.size()), density(squares.size());
  for (Index c = 0; c < volumes.size(); ++c) volumes[c] = space.volume(c);
  const double mean = 2.0 * result.solution.strain_energy / volumes.sum();
  for (Index c = 0; c < density.size(); ++c)
    density[c] = mean > 0.0 ? std::sqrt(std::max(0.0, squares[c]) / (volumes[c] * mean)) : 0.0;
  return density;
}

template <int Dim> double relative_error_of(const Goal& goal, const Answer<Dim>& answer) {
  if (goal.of == Goal::Of::reaction) {
    for (const auto& reaction : answer.reactions)
      if (reaction.name == goal.name) return relative_error<Dim>(reaction.force, reaction.error);
  } else if (const auto error = answer.probe_errors.find(goal.name); error != answer.probe_errors.end()) {
    for (const auto& [name, values] : answer.probes)
      if (name == goal.name) return relative_error<Dim>(values.displacement, error->second);
  }
  return 1.0;
}

template <int Dim> double missed_goals(const Settings<Dim>& settings, const Answer<Dim>& answer) {
  double worst = 0.0;
  for (const auto& goal : settings.goals) worst = std::max(worst, relative_error_of(goal, answer) / goal.error);
  return std::sqrt(worst);
}

template bool asks_for_errors<2>(const Settings<2>&);
template bool asks_for_errors<3>(const Settings<3>&);
template double relative_error_of<2>(const Goal&, const Answer<2>&);
template void read_off<2>(const Settings<2>&, const FineSpace<2>&, Answer<2>&);
template double relative_error_of<3>(const Goal&, const Answer<3>&);
template void read_off<3>(const Settings<3>&, const FineSpace<3>&, Answer<3>&);
template void tell_errors<2>(const Settings<2>&, const Reference<2>&, Result<2>&, const Monitor&);
template void tell_errors<3>(const Settings<3>&, const Reference<3>&, Result<3>&, const Monitor&);
template Vector error_density<2>(const Result<2>&, const Vector&);
template Vector error_density<3>(const Result<3>&, const Vector&);
template double missed_goals<2>(const Settings<2>&, const Answer<2>&);
template double missed_goals<3>(const Settings<3>&, const Answer<3>&);

}  // namespace efree::internal
