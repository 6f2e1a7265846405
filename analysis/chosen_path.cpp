// SPDX-License-Identifier: GPL-3.0-or-later
/// Load paths that leave their functions open: finer and finer ones until the errors are small.
#include "efree/analysis/analyse.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/geometry/mesh/refine.hpp"
#include "efree/geometry/mesh/walls.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

namespace efree {

using namespace internal;

namespace {

/// Spacing of a path over that of the next.
constexpr double refinement_of_paths = 1.5;
/// Least spacing of a coarser path over that of the natural mesh.
constexpr double least_coarsening_of_paths = 1.15;
/// Nodes of a cloud across walls but the thinnest twentieth of them, and edges of quadratic elements.
constexpr double nodes_across_walls = 4.0, edges_across_walls = 2.0, share_of_thinnest = 0.05;
/// Fine edges to a spacing of the cloud.
template <int Dim> constexpr double edges_to_spacing = Dim == 2 ? 4.0 : 3.0;
/// Nodes of a cloud, and of quadratic elements, beyond which no finer path is solved; the first has room for a finer
/// one.
template <int Dim> constexpr double most_nodes_of_path = Dim == 2 ? 20000.0 : 4000.0;
constexpr double most_nodes_of_elements = 100000.0;
template <int Dim> constexpr double nodes_to_next = Dim == 2 ? 2.25 : 3.375;  // refinement_of_paths^Dim

/// Edges that the cells of a mesh have in the mean.
template <int Dim> double edge_of_cells(const FineMesh<Dim>& mesh) {
  const double regular = Dim == 2 ? 0.433 : 0.118;  // volume of a cell with edges of 1
  return std::pow(mesh.volumes().sum() / (regular * mesh.num_cells()), 1.0 / Dim);
}

/// Whether paths take quadratic elements: in the plane, where the settings specify no cloud. They bend, and find limit
/// loads, at less cost than a cloud (docs/evidence.md, "Load paths with known answers"); nearly incompressible rubber
/// takes ever smaller steps with them.
template <int Dim>
bool takes_elements(const Settings<Dim>& settings, const ElasticModel& model, const FineMesh<Dim>& mesh) {
  const bool bears = incompressibility(model, mesh) <= bearable_incompressibility(BasisKind::p2);
  return may_do_without_cloud(settings) && !softens(model) && (bears || !is_elastic(model));
}

/// The levels of refinement of a path.
template <int Dim> class Levels {
 public:
  /// `fixed`: the mesh of the last level is the natural one.
  Levels(const MeshSource<Dim>& source, const PreparedMesh<Dim>& natural, bool elements, bool fixed)
      : source_(source),
        natural_(natural),
        fixed_(fixed || source.says_its_size() || source.grey),
        elements_(elements),
        edge_(std::min(natural.size, longest_to_mean * edge_of_cells(*natural.mesh))) {
    const FineMesh<Dim>& mesh = *natural.mesh;
    if (!elements) {
      spacing_ = spacing_of_path(mesh, fixed_);
      return;
    }
    // Walls are spanned as far as the finer path then has room; features make meshes denser than their size says.
    const double nodes = 2.0 * mesh.num_cells(), room = most_nodes_of_elements / nodes_to_next<Dim>;
    fixed_ = fixed_ || nodes > room;
    const double least = edge_ * std::min(1.0, std::sqrt(2.0 * nodes / room));
    spacing_ = fixed_ ? natural.size
                      : std::min(edge_, std::max(least, thin_wall(mesh, share_of_thinnest) / edges_across_walls));
  }

  /// Whether a path of so many nodes may be followed by a finer one.
  bool has_room(Index nodes) const {
    return elements_ && fixed_
               ? true
               : nodes * nodes_to_next<Dim> <= (elements_ ? most_nodes_of_elements : most_nodes_of_path<Dim>);
  }

  /// Elements begin with a level that only serves to see how fast errors fall: a cloud has errors by a coarser one.
  int first() const { return elements_ ? -1 : 0; }
  /// The first level that may be the result: those before it are to compare with.
  int first_of_mesh() const { return elements_ && fixed_ ? 1 : 0; }
  /// Whether a level is of use: one to compare with has to be coarser, and a file of cells has no coarser mesh.
  bool is_useful(int level, const FineMesh<Dim>& mesh) const {
    return level >= first_of_mesh() ||
           std::pow(least_coarsening_of_paths, Dim) * mesh.num_cells() <= natural_.mesh->num_cells();
  }
  /// Spacing of the cloud, or edges of the elements.
  double spacing(int level) const {
    // Of elements on a mesh that may not be refined, the first level is coarser.
    return (elements_ && fixed_ ? refinement_of_paths : 1.0) * spacing_ / std::pow(refinement_of_paths, level);
  }
  /// Whether the mesh may be as fine as a level asks for.
  bool has(int level) const {
    if (!fixed_ || level <= 0) return true;
    return elements_ ? level == 1 : spacing(level) >= least_edges_to_spacing * edge_;
  }
  PreparedMesh<Dim> mesh(int level, const Settings<Dim>& settings, const Monitor& monitor) const {
    const bool is_natural = elements_ && fixed_ ? level == 1
                            : level < 0         ? std::abs(mesh_size(level) / edge_ - 1.0) < 0.01
                                                : fixed_ || mesh_size(level) >= 0.99 * edge_;
    if (is_natural) return natural_;
    if (elements_ && has_own_sizes()) {  // which keep their proportions: where they are small they become smaller too
      const double factor = mesh_size(level) / (fixed_ ? natural_.size : edge_);
      MeshSource<Dim> scaled = with_sagittas_for(factor);
      scaled.coarsening = factor;
      PreparedMesh<Dim> mesh = prepare(scaled, settings, monitor);
      if (mesh.mesh->num_cells() != natural_.mesh->num_cells()) return mesh;  // else a file of cells
    }
    // Sagittas are those of the source on the first mesh that may be the result.
    const double factor = mesh_size(level) / (fixed_ ? natural_.size : std::min(edge_, mesh_size(0)));
    MeshSource<Dim> finer = with_sagittas_for(factor);
    finer.size = mesh_size(level);
    finer.ratio = 0.0;
    if (source_.says_its_size())
      finer.coarsening = factor;  // of the sizes that a file has of its own where it is dense
    try {
      return prepare(finer, settings, monitor);
    } catch (const InputError&) {  // a file of cells
      finer.size = 0.0;
      finer.mesh = [&](const MeshSize& size, const Stage& stage) {
        MadeMesh<Dim> made = source_.mesh(size, stage);
        made.mesh = split_long_edges(std::move(made.mesh), 1.2 * mesh_size(level));
        return made;
      };
      return prepare(finer, settings, monitor);
    }
  }

 private:
  /// Whether the mesh has the sizes of its file: then its size is that of its longest edge.
  bool has_own_sizes() const { return !source_.says_its_size() && natural_.size == natural_.mesh->size(); }
  /// The source, for edges longer by a factor: its sagittas, by default those of walls, follow the squares of edges.
  MeshSource<Dim> with_sagittas_for(double factor) const {
    MeshSource<Dim> source = source_;
    if (source.sagitta == 0.0 && !source.says_its_size()) source.sagitta = default_sagitta;
    source.sagitta *= factor * factor;
    return source;
  }
  double mesh_size(int level) const { return spacing(level) / (elements_ ? 1.0 : edges_to_spacing<Dim>); }

  static constexpr double least_edges_to_spacing = 1.5, longest_to_mean = 1.3;  // edges of meshes made here
  const MeshSource<Dim>& source_;
  const PreparedMesh<Dim>& natural_;
  bool fixed_, elements_;
  double edge_, spacing_;
};

/// The settings of a level, compared with the one before.
template <int Dim> Settings<Dim> settings_of(Settings<Dim> settings, bool elements, const PreparedMesh<Dim>& mesh,
                                             double spacing, std::shared_ptr<const Result<Dim>> coarser) {
  if (settings.common.approximation.kind != BasisKind::mls) {  // the basis is given
  } else if (elements) {
    const ElasticModel model = with_defaults(settings, mesh).common.model;
    settings.common.approximation.kind = BasisKind::p2;
    // They do not lock where material flows: of plane strain they have enough freedom (Sloan & Randolph 1982).
    if (settings.common.approximation.dilatation == Dilatation::automatic)
      settings.common.approximation.dilatation =
          averaged_if(incompressibility(model, *mesh.mesh) > bearable_incompressibility(BasisKind::p2));
    if (is_elastic(model)) {  // a cloud follows where they take ever smaller steps
      if (!settings.time) settings.time.emplace();
      PathOptions& path = settings.time->path;
      path.max_steps =
          std::min(path.max_steps, 200 + static_cast<int>(std::min(1e6, 3.0 * path.end / path.first_step())));
    }
  } else {
    settings.common.approximation.spacing = spacing;
  }
  settings.steps.coarser = std::move(coarser);
  settings.steps.from_another = true;
  return settings;
}

/// The largest error of a path that a finer one would not have over what is bearable; nothing where it is unknown.
template <int Dim> std::optional<double> excess_of_path(const Settings<Dim>& settings, const Result<Dim>& result) {
  if (result.estimates) {
    double history = 0.0;
    if (result.cloud_alone)
      for (const auto* errors : {&result.cloud_alone->reactions, &result.cloud_alone->probes})
        for (const auto& [name, error] : *errors) history = std::max(history, error);
    return std::max(result.estimates->total() / bearable_error(settings), history / bearable_error_of_path);
  }
  if (!result.path_errors) return {};
  const PathErrors& errors = *result.path_errors;
  const bool by_arc = settings.time && settings.time->path.control == Control::arc_length;
  const bool complete = errors.until == result.history.back().time || (errors.limit && !by_arc);
  if (!complete) return {};
  // A finer mesh has no smaller steps.
  const double by_steps = std::max(0.0, errors.steps - bearable_error_of_steps);
  return std::max(errors.space, errors.largest().first - by_steps) / bearable_error_of_path;
}

/// Solves level after level.
template <int Dim> class Search {
 public:
  /// Refers to all.
  Search(const MeshSource<Dim>& source, const PreparedMesh<Dim>& natural, const Settings<Dim>& settings,
         const Monitor& monitor)
      : source_(source),
        natural_(natural),
        settings_(with_steps_of_checkpoint(settings)),
        monitor_(monitor),
        is_resumed_(!settings.steps.from),
        resumed_body_(settings.steps.from ? settings.steps.from->body : 0) {}

  /// The path of the first level whose errors are small, or of the last one. Its warnings say if a finer one failed.
  /// Throws NumericalError if the first level has no path.
  std::shared_ptr<Result<Dim>> refine(bool elements) {
    excess_.reset();
    const Levels<Dim> levels(source_, natural_, elements, settings_.common.approximation.kind != BasisKind::mls);
    std::shared_ptr<Result<Dim>> best;
    std::shared_ptr<const Result<Dim>> coarser;  // than the best
    std::shared_ptr<Result<Dim>> of_larger_steps;
    int beyond = 0;  // levels beyond a good one, to look for the one that is to be gone on with
    for (int level = levels.first(); levels.has(level); ++level) {
      if (level > 0 && best && !levels.has_room(best->approximation.nodes.cols())) break;
      try {
        const PreparedMesh<Dim> mesh = levels.mesh(level, settings_, monitor_);
        if (!levels.is_useful(level, *mesh.mesh)) continue;
        auto next = solve(mesh, elements, levels.spacing(level), best, coarser.get());
        coarser = std::exchange(best, std::move(next));
      } catch (const InputError&) {
        if (level < levels.first_of_mesh()) continue;  // too coarse for a probe, or a part
        throw;
      } catch (const NumericalError& error) {
        if (level < levels.first_of_mesh()) continue;
        if (level == levels.first_of_mesh()) {
          if (!of_larger_steps) throw;
          best = of_larger_steps;
          best->warnings.push_back(fmt::format("the path fails with smaller steps: {}", error.what()));
          break;
        }
        best->warnings.push_back(fmt::format("a finer path fails, this is the finest before: {}", error.what()));
        break;
      }
      if (const auto smaller = smaller_steps_for(with_defaults(settings_, natural_), *best)) {
        settings_ = with_smaller_steps(std::move(settings_), *best, *smaller, monitor_);
        of_larger_steps = std::exchange(best, nullptr);
        coarser.reset();
        excess_.reset();
        beyond = 0;
        level = levels.first() - 1;
        continue;
      }
      const bool is_enough = !elements || level > 0;
      if (is_enough && (is_good() || !falls()) && (is_resumed_ || ++beyond > 1)) break;
    }
    if (!is_good() && !falls())
      best->warnings.push_back(
          "displacements, forces and stresses may be further off than their errors say: these do not fall "
          "as meshes get finer, as where strains localise");
    return best;
  }

  /// The result, with all levels.
  Result<Dim> take(const std::shared_ptr<Result<Dim>>& best) {
    if (!is_resumed_)
      throw InputError(
          "these steps cannot be gone on with: they are of another mesh, other nodes or other quadrature points");
    Result<Dim> result = std::move(*best);
    result.attempts = std::move(attempts_);
    result.times = times_;
    result.cpu_seconds = cpu_seconds_;
    return result;
  }

 private:
  /// Whether the errors of the last path are small.
  bool is_good() const { return excess_ && *excess_ <= 1.0; }
  /// Whether they are smaller than those of the path before, or may be.
  bool falls() const { return !excess_ || !excess_before_ || *excess_ < *excess_before_; }

  std::shared_ptr<Result<Dim>> solve(const PreparedMesh<Dim>& mesh, bool elements, double spacing,
                                     const std::shared_ptr<Result<Dim>>& coarser, const Result<Dim>* coarsest) {
    const Stopwatch seconds;
    Settings<Dim> settings = settings_of<Dim>(settings_, elements, mesh, spacing, coarser);
    if (is_resumed_) settings.steps.from.reset();  // that of a level before
    auto result = std::make_shared<Result<Dim>>(analyse_level(mesh, settings, coarsest, monitor_));
    times_.add(result->times);
    cpu_seconds_ += result->cpu_seconds;
    is_resumed_ = is_resumed_ || resumed_body_ == fingerprint(result->approximation);
    excess_before_ = std::exchange(excess_, excess_of_path(settings_, *result));
    const double error = result->path_errors ? result->path_errors->largest().first
                         : result->estimates ? result->estimates->total()
                                             : 0.0;
    attempts_.push_back({.size = elements ? spacing : result->mesh->size(),
                         .cells = result->mesh->num_cells(),
                         .degree = result->approximation.space.degree(),
                         .error = error,
                         .seconds = seconds(),
                         .excess = excess_.value_or(0.0),
                         .spacing = elements ? 0.0 : spacing});
    if (monitor_.say)
      monitor_.say(fmt::format("{} of {} nodes, {} steps to time {:.6g}: error of the path {}, {:.2g} s",
                               elements ? "quadratic elements" : "cloud", result->approximation.nodes.cols(),
                               result->history.size(), result->history.back().time,
                               excess_ ? fmt::format("about {:.2g} %", 100.0 * error) : "unknown",
                               attempts_.back().seconds));
    return result;
  }

  const MeshSource<Dim>& source_;
  const PreparedMesh<Dim>& natural_;
  Settings<Dim> settings_;
  const Monitor& monitor_;
  bool is_resumed_;
  std::uint64_t resumed_body_;                    ///< of the checkpoint that is gone on from
  std::optional<double> excess_, excess_before_;  ///< of the last path and the one before
  std::vector<Attempt> attempts_;
  StageTimes times_;
  double cpu_seconds_ = 0.0;
};

}  // namespace

template <int Dim> double internal::spacing_of_path(const FineMesh<Dim>& mesh, bool mesh_is_fixed) {
  const double wall = thin_wall(mesh, share_of_thinnest) / nodes_across_walls;
  const double least = std::pow(mesh.volumes().sum() / (1.4 * most_nodes_of_path<Dim> / nodes_to_next<Dim>), 1.0 / Dim);
  return std::min(default_spacing(mesh), std::max({wall, least, mesh_is_fixed ? 1.5 * edge_of_cells(mesh) : 0.0}));
}

template <int Dim> bool internal::chooses_path(const MeshSource<Dim>& source, const Settings<Dim>& settings) {
  const ApproximationOptions& basis = settings.common.approximation;
  if (!settings.estimated || !settings.cases.empty()) return false;
  return basis.kind != BasisKind::mls || (basis.spacing == 0.0 && source.ratio == 0.0 && !basis.grading.has_places());
}

template <int Dim> Result<Dim> internal::analyse_chosen_path(const MeshSource<Dim>& source,
                                                             const PreparedMesh<Dim>& natural,
                                                             const Settings<Dim>& given, const Monitor& monitor) {
  bool is_path = false;
  Result<Dim> first = analyse_unless_path(natural, given, monitor, is_path);
  if (!is_path) return first;
  Settings<Dim> settings = given;
  if (!given.time) settings.regime = with_defaults(given, natural).regime;
  if (!given.time && *settings.regime == Regime::automatic) settings.regime = Regime::finite;  // as has been checked
  const Settings<Dim> full = with_defaults(settings, natural);
  Search<Dim> search(source, natural, settings, monitor);
  const auto end = [&](const std::shared_ptr<Result<Dim>>& best) {
    Result<Dim> result = search.take(best);
    if (!first.linear_checks.empty()) result.linear_checks = std::move(first.linear_checks);
    return result;
  };
  if (settings.common.approximation.kind != BasisKind::mls) return end(search.refine(true));
  if (!takes_elements(settings, full.common.model, *natural.mesh)) return end(search.refine(false));
  std::shared_ptr<Result<Dim>> elements;
  try {
    elements = search.refine(true);
  } catch (const NumericalError&) {
    if (!is_elastic(full.common.model)) throw;
  }
  // Rubber may be deformed farther than its elements bear; where material flows, a path that stops has met its limit.
  if (elements && (elements->stopped.empty() || !is_elastic(full.common.model))) return end(elements);
  std::shared_ptr<Result<Dim>> cloud;
  try {
    cloud = search.refine(false);
  } catch (const NumericalError&) {
    if (!elements) throw;
  }
  const bool farther =
      cloud && (!elements || cloud->stopped.empty() || cloud->history.back().time > elements->history.back().time);
  return end(farther ? cloud : elements);
}

template double internal::spacing_of_path<2>(const FineMesh<2>&, bool);
template bool internal::chooses_path<2>(const MeshSource<2>&, const Settings<2>&);
template Result<2> internal::analyse_chosen_path<2>(const MeshSource<2>&, const PreparedMesh<2>&, const Settings<2>&,
                                                    const Monitor&);
template double internal::spacing_of_path<3>(const FineMesh<3>&, bool);
template bool internal::chooses_path<3>(const MeshSource<3>&, const Settings<3>&);
template Result<3> internal::analyse_chosen_path<3>(const MeshSource<3>&, const PreparedMesh<3>&, const Settings<3>&,
                                                    const Monitor&);

}  // namespace efree
