// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/analyse.hpp"
#include "efree/analysis/internal/clock.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/refinement.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree {

using namespace internal;

double internal::refinement(const std::vector<Attempt>& attempts, int dim) {
  const Attempt& last = attempts.back();
  const double degree = last.degree;
  double order = degree;
  if (attempts.size() > 1) {
    const Attempt& before = attempts[attempts.size() - 2];
    // The slope of excess over edges, both logarithms, with that of the degree as a measurement of weight one. Chosen
    // by a chart over meshes of the cases in bench_accuracy; halved edges count for six.
    constexpr double weight = 12.0, slowest = 0.35;
    const double finer = std::log(static_cast<double>(last.cells) / before.cells) / dim;
    const double lower = std::log(before.excess / last.excess);
    if (before.degree == last.degree)
      order = std::clamp((degree + weight * finer * lower) / (1.0 + weight * finer * finer), slowest, degree);
  }
  return std::pow(std::min(2.25 * std::pow(last.excess, dim / order), 24.0), -1.0 / dim);
}

namespace {

/// Errors of probes and reactions that were asked for, as text.
template <int Dim> std::string goals_text(const Settings<Dim>& settings, const Result<Dim>& result) {
  std::string text;
  for (const auto& goal : settings.goals)
    text += fmt::format(", {:.2g} % of \"{}\"", 100.0 * relative_error_of(goal, result), goal.name);
  return text;
}

/// Edges that the cells of a mesh have in the mean, of boxes cut into two triangles or six tetrahedra.
template <int Dim> double mean_edge(const FineMesh<Dim>& mesh) {
  return std::pow((Dim == 2 ? 2.0 : 6.0) * mesh.volumes().sum() / mesh.num_cells(), 1.0 / Dim);
}

}  // namespace

template <int Dim>
Result<Dim> analyse_to_accuracy(const MeshSource<Dim>& source, const Settings<Dim>& settings, const Monitor& monitor) {
  require_estimates(settings);
  const Stopwatch seconds;
  const auto tell = [&](const std::string& message) {
    if (monitor.say) monitor.say(message);
  };
  const bool fixed = source.says_its_size();
  MeshSource<Dim> trial = source;
  trial.coarsening = Dim == 2 ? 8.0 : 4.0;  // next to nothing, and quadratic cells may do there
  std::optional<Result<Dim>> best;
  double least = 0.0;  // excess, of the best
  std::vector<Attempt> attempts;
  std::string why;
  for (;;) {
    const double begin = seconds();
    const PreparedMesh<Dim> mesh = prepare(trial, settings, monitor);
    if (is_on_cells(settings, mesh)) return analyse(prepare(source, settings, monitor), settings, monitor);
    if (attempts.empty())
      for (const std::string& remark : mesh.remarks) tell(remark);
    Result<Dim> result;
    try {
      result = analyse(mesh, settings, monitor);
    } catch (const NumericalError& failure) {
      if (!best) throw;
      why = fmt::format("a finer mesh fails: {}", failure.what());
      break;
    }
    if (!result.estimates) {
      why = result.warnings.front();
      if (!best) throw InputError(said_at(where_said(settings, "accuracy"), why));
      break;
    }
    const double error = result.estimates->total();
    const double beyond = excess(settings, result);
    attempts.push_back(
        {mesh.size, mesh.mesh->num_cells(), result.basis().space.degree(), error, seconds() - begin, beyond});
    tell(fmt::format("{} cells of degree {}: error {:.2g} % in the energy norm{}, {:.2g} s", attempts.back().cells,
                     attempts.back().degree, 100.0 * error, goals_text(settings, result), attempts.back().seconds));
    if (!best || beyond < least) best = std::move(result), least = beyond;
    if (beyond <= 1.0) break;
    if (fixed) {
      why = mesh_is_said;
      break;
    }
    double finer = refinement(attempts, Dim);
    // As fine as memory allows, where that is less. Meshes turn out with two and a half times the cells meant at most.
    const double room =
        0.4 * usable_memory * available_memory() / (quadratic_bytes_per_cell<Dim> * attempts.back().cells);
    if (room < 1.5) {
      why = "a finer mesh would take more memory than there is";
      break;
    }
    finer = std::max(finer, std::pow(room, -1.0 / Dim));
    const double growth = std::pow(finer, -Dim);
    if (seconds() + growth * attempts.back().seconds > settings.time_limit) {
      why = fmt::format("a finer mesh would take about {:.3g} s, and the time limit is {:.3g} s",
                        growth * attempts.back().seconds, settings.time_limit);
      break;
    }
    // A boundary of many details has cells smaller than asked for: then only meshes below their size differ.
    trial.size = finer * std::min(mesh.size, 1.5 * mean_edge(*mesh.mesh));
  }
  best->attempts = std::move(attempts);
  if (!why.empty()) warn_of_misses(settings, why, *best);
  return std::move(*best);
}

template Result<2> analyse_to_accuracy<2>(const MeshSource<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse_to_accuracy<3>(const MeshSource<3>&, const Settings<3>&, const Monitor&);

}  // namespace efree
