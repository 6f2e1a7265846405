// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/analyse.hpp"
#include "efree/analysis/internal/facet_errors.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/refinement.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
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
  constexpr double more = 1.25, most = 12.0;
  return std::pow(std::min(more * std::pow(last.excess, dim / order), most), -1.0 / dim);
}

double internal::forecast_seconds(const std::vector<Attempt>& attempts, Index cells) {
  const Attempt& last = attempts.back();
  double power = 1.2;
  if (attempts.size() > 1) {
    const Attempt& before = attempts[attempts.size() - 2];
    const double more = std::log(static_cast<double>(last.cells) / before.cells);
    if (before.degree == last.degree && more > 0.5 && before.seconds > 0.0)
      power = std::clamp(std::log(last.seconds / before.seconds) / more, 1.0, 1.6);
  }
  return last.seconds * std::pow(static_cast<double>(cells) / last.cells, power);
}

namespace {

/// Errors of probes and reactions that were asked for, as text.
template <int Dim> std::string goals_text(const Settings<Dim>& settings, const Result<Dim>& result) {
  std::string text;
  for (const auto& goal : settings.goals)
    text += fmt::format(", {:.2g} % of \"{}\"", 100.0 * relative_error_of<Dim>(goal, result), goal.name);
  return text;
}

/// Of the error that is aimed at, what facets may leave at least, where finer ones can be had for themselves: a fifth
/// of the energy, as they cost less than cells. More where cells leave less than the rest, and cells more where facets
/// do.
constexpr double share_of_facets = 0.45;

/// Largest share of the target error for one part of it, given the other part, which counts by at most `most`.
double besides(double aimed, double other, double most) {
  return std::sqrt(aimed * aimed - std::pow(std::min(other, most), 2.0));
}

/// By cells, relative.
double error_of_cells(const Estimates& errors) {
  return std::hypot(errors.cloud, errors.mesh);
}

/// Error over what is aimed at, as excess, of all but facets that can be made finer for themselves.
template <int Dim> double excess_of_cells(const Settings<Dim>& settings, const Result<Dim>& result, bool own_facets) {
  if (!own_facets) return excess(settings, result);
  const Estimates& errors = *result.estimates;
  const double aimed = aim(settings), allowed = besides(aimed, errors.geometry, share_of_facets * aimed);
  const double energy = settings.accuracy > 0.0 ? error_of_cells(errors) / allowed : 0.0;
  return std::max(energy, missed_goals<Dim>(settings, result));
}

/// Whether finer facets alone may lead to what is aimed at, as they bring finer cells with them.
template <int Dim> bool facets_may_do(const Settings<Dim>& settings, const Result<Dim>& result) {
  return error_of_cells(*result.estimates) <= aim(settings) && missed_goals<Dim>(settings, result) <= 1.0;
}

/// Factor on the length of facets with which the error is what is aimed at: their part of it falls like their length,
/// that of the cells, which are finer beside finer facets, like its power of 0.4 (measured on 160 holes and an annulus:
/// 0.43 to 0.5 of it with facets of a quarter).
double facet_factor(const Estimates& errors, double aimed) {
  constexpr double along = 0.4;
  const double cells = error_of_cells(errors);
  double low = 0.0, high = 1.0;
  for (int k = 0; k < 40; ++k) {
    const double factor = 0.5 * (low + high);
    const bool enough = std::hypot(factor * errors.geometry, std::pow(factor, along) * cells) <= aimed;
    (enough ? low : high) = factor;
  }
  return low;
}

/// Share of their sagittas that facets should have: their part of the energy falls like these, and so do their parts of
/// the errors of probes and reactions. At least a sixteenth, in space a fifth; 1: they are fine enough.
template <int Dim> double flatter(const Settings<Dim>& settings, const Result<Dim>& result) {
  const double geometry = result.estimates->geometry;
  if (geometry == 0.0) return 1.0;
  double share = 1.0;
  if (settings.accuracy > 0.0) {
    const double aimed = aim(settings), most = std::sqrt(1.0 - share_of_facets * share_of_facets) * aimed;
    const double allowed = besides(aimed, error_of_cells(*result.estimates), most);
    if (geometry > allowed)
      share = std::pow(
          facets_may_do(settings, result) ? facet_factor(*result.estimates, 0.95 * aimed) : 0.9 * allowed / geometry,
          2.0);
  }
  if (const double missed = missed_goals<Dim>(settings, result); missed > 1.0)
    share = std::min(share, 1.0 / (missed * missed));
  return std::clamp(share, Dim == 2 ? 1.0 / 16.0 : 1.0 / 5.0, 1.0);
}

/// A mesh of about so many cells, made once or twice more if the first is far from that; 0 cells: as it comes.
template <int Dim> PreparedMesh<Dim> prepare_about(MeshSource<Dim>& source, double cells, const Settings<Dim>& settings,
                                                   const Monitor& monitor) {
  constexpr double near = 1.3;
  PreparedMesh<Dim> mesh = prepare(source, settings, monitor);
  for (int again = 0; again < 2 && cells > 0.0 && source.size > 0.0; ++again) {
    const double ratio = mesh.mesh->num_cells() / cells;
    if (ratio < near && ratio > 1.0 / near) break;
    MeshSource<Dim> other = source;
    other.size *= std::pow(ratio, 1.0 / Dim);
    PreparedMesh<Dim> next = prepare(other, settings, monitor);
    const double then = next.mesh->num_cells() / cells;
    const double was = std::abs(std::log(ratio)), is = std::abs(std::log(then));
    if (is >= was) break;
    source = std::move(other);
    mesh = std::move(next);
    if (is > 0.5 * was) break;  // outlines dictate their cells
  }
  return mesh;
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
  if (trial.sagitta == 0.0 && !fixed) trial.sagitta = default_sagitta;
  std::optional<Result<Dim>> best;
  double least = 0.0;   // excess, of the best
  double cells = 0.0;   // wanted of the next mesh; 0: as it comes
  double before = 0.0;  // error by facets of the mesh before, if these were made finer since
  double left_by_surface = std::numeric_limits<double>::infinity();  // the same, where the surface is guessed
  std::vector<Attempt> attempts;
  std::string why;
  for (;;) {
    const double begin = seconds();
    const PreparedMesh<Dim> mesh = prepare_about(trial, cells, settings, monitor);
    if (attempts.empty())
      for (const std::string& remark : mesh.remarks) tell(remark);
    if (!attempts.empty()) {
      const double forecast = forecast_seconds(attempts, mesh.mesh->num_cells());
      if (seconds() + forecast > settings.time_limit) {
        why = fmt::format("a mesh of {} cells would take about {:.3g} s, and the time limit is {:.3g} s",
                          mesh.mesh->num_cells(), forecast, settings.time_limit);
        break;
      }
      tell(fmt::format("next: {} cells, about {:.2g} s", mesh.mesh->num_cells(), forecast));
    }
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
      if (!best) throw InputError(said_at(where_said(settings.common, "accuracy"), why));
      break;
    }
    const Estimates errors = *result.estimates;
    const double beyond = excess(settings, result);
    // Sources that know nothing of facets have to make all cells finer.
    const bool own_facets = mesh.surface_is_known && !(before > 0.0 && errors.geometry > 0.9 * before);
    attempts.push_back({mesh.size, mesh.mesh->num_cells(), result.basis().space.degree(), errors.total(),
                        seconds() - begin, excess_of_cells(settings, result, own_facets)});
    tell(fmt::format("{} cells of degree {}: error {:.2g} % in the energy norm{}{}, {:.2g} s", attempts.back().cells,
                     attempts.back().degree, 100.0 * errors.total(),
                     errors.geometry > 0.0 ? fmt::format(" ({:.2g} % of facets)", 100.0 * errors.geometry) : "",
                     goals_text(settings, result), attempts.back().seconds));
    const double flattened = own_facets ? flatter(settings, result) : 1.0;
    const bool same_cells = flattened < 1.0 && facets_may_do(settings, result);
    if (!best || beyond < least) best = std::move(result), least = beyond;
    if (beyond <= 1.0) break;
    if (fixed) {
      why = mesh_is_said;
      break;
    }
    if (!mesh.surface_is_known && errors.geometry > aim(settings) && errors.geometry > 0.8 * left_by_surface) {
      why = fmt::format("the triangles of the surface leave {:.2g} % on any mesh; a finer surface is needed",
                        100.0 * errors.geometry);
      break;
    }
    left_by_surface = mesh.surface_is_known ? 0.0 : errors.geometry;
    double finer = same_cells ? 1.0 : refinement(attempts, Dim);
    const double room = usable_memory * available_memory() / (quadratic_bytes_per_cell<Dim> * attempts.back().cells);
    // As fine as memory allows, where that is less. Meshes with finer facets turn out with more cells than meant.
    const double allowed = flattened < 1.0 ? 0.4 * room : room / 1.3;
    if (allowed < 1.25) {
      why = "a finer mesh would take more memory than there is";
      break;
    }
    finer = std::max(finer, std::pow(allowed, -1.0 / Dim));
    const auto wanted = static_cast<Index>(std::min(2e9, attempts.back().cells * std::pow(finer, -Dim)));
    if (const double forecast = forecast_seconds(attempts, wanted); seconds() + forecast > settings.time_limit) {
      why = fmt::format("a finer mesh would take about {:.3g} s, and the time limit is {:.3g} s", forecast,
                        settings.time_limit);
      break;
    }
    before = flattened < 1.0 ? errors.geometry : 0.0;
    if (flattened < 1.0)
      trial.sagitta = flattened * std::min(trial.sagitta, largest_relative_sagitta(*mesh.mesh, mesh.offsets));
    // A boundary of many details has cells smaller than asked for: then only meshes below their size differ.
    trial.size = same_cells ? mesh.size : finer * std::min(mesh.size, 1.5 * internal::mean_edge(*mesh.mesh));
    cells = flattened < 1.0 ? 0.0 : wanted;
  }
  best->attempts = std::move(attempts);
  if (!why.empty()) warn_of_misses(settings, why, *best);
  return std::move(*best);
}

template Result<2> analyse_to_accuracy<2>(const MeshSource<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse_to_accuracy<3>(const MeshSource<3>&, const Settings<3>&, const Monitor&);

}  // namespace efree
