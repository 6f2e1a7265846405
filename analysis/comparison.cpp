// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/comparison.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <new>
#include <optional>
#include <utility>

namespace efree {
namespace {

using internal::said_at;

/// Cloud spacing over the edges of the mesh where the case has no cloud.
constexpr double default_mesh_ratio = 3.0;

/// Edges of cells that are material points, over those of the grid's cells, where the case has no mesh for them.
constexpr double mesh_frame_edge = 0.5;

/// Options of smoothed particles that are compared with none.
constexpr double compared_artificial_stress = 0.5, compared_splitting = 0.1;

/// Distance of the nodes of a case.
template <int Dim> double spacing_of(const MeshSource<Dim>& source, const DynamicsSettings<Dim>& settings) {
  const double spacing = settings.method == DynamicsMethod::mpm   ? settings.mpm.options.cell
                         : settings.method == DynamicsMethod::sph ? settings.sph.options.spacing
                         : settings.method == DynamicsMethod::total_lagrangian
                             ? settings.common.approximation.spacing
                             : source.size / internal::element_size<Dim>;
  if (!(spacing > 0.0))
    throw InputError(said_at(source.where,
                             "methods are compared with nodes as far apart as those of the case: add "
                             "mesh_size to [geometry]"));
  return spacing;
}

template <int Dim> struct Scene {
  MeshSource<Dim> source;
  DynamicsSettings<Dim> settings;
};

/// The case with another method and node spacing.
template <int Dim> Scene<Dim> vary(Scene<Dim> scene, const ComparedMethod& method, double spacing) {
  auto& [source, settings] = scene;
  const bool own =
      settings.method == method.method && (settings.method != DynamicsMethod::mpm ||
                                           (settings.mpm.frame == MpmFrame::mesh) == (method.frame == MpmFrame::mesh));
  const double factor = spacing / spacing_of(source, settings);
  settings.method = method.method;
  settings.frames = settings.history_lines = 0;
  if (method.method == DynamicsMethod::total_lagrangian) {
    if (source.ratio == 0.0)
      source.ratio =
          own && source.size > 0.0 ? settings.common.approximation.spacing / source.size : default_mesh_ratio;
    ApproximationOptions& options = settings.common.approximation;
    if (own) options.grading = internal::scaled(std::move(options.grading), factor);
    options.spacing = spacing;
    return scene;
  }
  source.ratio = 0.0;
  // For particles and the material point method the mesh is the geometry and no more, but in the frame of a mesh: its
  // edges are those of OTM unless it has its own.
  const double edge = method.method == DynamicsMethod::mpm && method.frame == MpmFrame::mesh
                          ? mesh_frame_edge
                          : internal::element_size<Dim>;
  source.size = own && source.size > 0.0 ? source.size * factor : edge * spacing;
  if (method.method == DynamicsMethod::mpm) {
    settings.mpm.options.cell = spacing;
    settings.mpm.frame = method.frame;
    if (method.frame != MpmFrame::updated) settings.mpm.options.remap = false;
  }
  if (method.method == DynamicsMethod::sph) {
    settings.sph.options.spacing = spacing;
    settings.sph.options.artificial_stress.strength = method.artificial_stress;
    settings.sph.options.splitting.strain = method.splitting;
    settings.sph.frame = method.sph_frame;
  }
  return scene;
}

/// Fills the row with the results of a run, complete or not.
template <int Dim>
void measure(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model, ComparisonRow& row) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  row.has_numbers = true;
  row.nodes = dynamics.num_nodes();
  row.points = dynamics.num_points();
  row.steps = dynamics.steps();
  row.time = dynamics.time();
  row.energy_error = std::abs(dynamics.energy().largest_error());
  row.warnings = collect_warnings(settings, model);
  for (auto& [name, values] : measure_probes(settings, model)) {
    if (values.size() > 1) values.resize(Dim);
    const bool has_value = std::ranges::all_of(values, [](double value) { return std::isfinite(value); });
    row.probes.push_back(has_value ? values : std::vector<double>{});
  }
}

/// Returns whether the input is to blame if it failed.
template <int Dim> bool run_scene(const Scene<Dim>& scene, const Monitor& monitor, ComparisonRow& row) {
  const auto& [source, settings] = scene;
  const double start = internal::process_cpu_seconds();
  std::optional<DynamicsModel<Dim>> model;
  bool bad_input = false;
  try {
    const PreparedMesh<Dim> mesh = prepare(source, settings, monitor);
    if (mesh.mesh->num_regions() > 1 && lacks_contact(settings))
      throw InputError(
          said_at(source.where, "the geometry has several bodies, which pass through each other with this method"));
    model.emplace(build_dynamics_model(mesh, settings, monitor));
    row.failure = run_dynamics(*model, settings, {}, monitor).stop_reason;
  } catch (const InputError& error) {
    row.failure = error.what();
    bad_input = true;
  } catch (const NumericalError& error) {
    row.failure = error.what();
  } catch (const std::bad_alloc&) {
    row.failure = "there is not enough memory";
  }
  row.cpu_seconds = internal::process_cpu_seconds() - start;
  if (model) measure(settings, *model, row);
  return bad_input;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum);
}
double norm(const std::vector<double>& a) {
  return distance(a, std::vector<double>(a.size(), 0.0));
}

/// Values of a probe in the finest runs that came to their end, by method.
std::vector<std::vector<double>> finest_values(const Comparison& comparison, std::size_t probe) {
  std::vector<std::vector<double>> values;
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    const ComparisonRow* finest = nullptr;
    for (const ComparisonRow& row : comparison.rows)
      if (row.method == m && row.failure.empty() && !row.probes[probe].empty()) finest = &row;
    if (finest != nullptr) values.push_back(finest->probes[probe]);
  }
  return values;
}

template <int Dim>
ProbeReference find_reference(const DynamicsProbe<Dim>& probe, std::size_t k, const Comparison& comparison) {
  ProbeReference reference{.name = probe.name};
  const auto finest = finest_values(comparison, k);
  if (probe.truth) {
    reference.value = {*probe.truth};
    reference.given = true;
  } else if (!finest.empty()) {
    for (std::size_t i = 0; i < finest.front().size(); ++i) {
      std::vector<double> along;
      for (const auto& value : finest) along.push_back(value[i]);
      reference.value.push_back(internal::median(along));
    }
  }
  double largest = 0.0;
  for (const ComparisonRow& row : comparison.rows)
    if (row.failure.empty()) largest = std::max(largest, norm(row.probes[k]));
  reference.scale = norm(reference.value);
  if (!(reference.scale > 1e-9 * largest)) reference.scale = largest > 0.0 ? largest : 1.0;
  reference.runs = reference.given ? 0 : static_cast<int>(finest.size());
  if (!reference.given)
    for (const auto& value : finest)
      reference.uncertainty = std::max(reference.uncertainty, distance(value, reference.value) / reference.scale);
  return reference;
}

std::vector<ComparedMethod> choose_methods(const std::vector<std::string>& names) {
  if (names.empty()) return compared_methods();
  std::vector<ComparedMethod> chosen;
  std::vector<std::string> known;
  for (const ComparedMethod& method : compared_methods()) known.push_back(method.name);
  for (const std::string& name : names) {
    const auto found = std::ranges::find(compared_methods(), name, &ComparedMethod::name);
    if (found == compared_methods().end())
      throw InputError(fmt::format("there is no method \"{}\" to compare; there are {}", name, fmt::join(known, ", ")));
    if (std::ranges::find(chosen, name, &ComparedMethod::name) != chosen.end())
      throw InputError(fmt::format("method \"{}\" is given twice", name));
    chosen.push_back(*found);
  }
  return chosen;
}

}  // namespace

const std::vector<ComparedMethod>& compared_methods() {
  static const std::vector<ComparedMethod> all{
      {"otm", "OTM", DynamicsMethod::otm},
      {"total_lagrangian", "total Lagrangian (MLS)", DynamicsMethod::total_lagrangian},
      {"mpm", "MPM", DynamicsMethod::mpm},
      {"mpm_total", "MPM, total frame", DynamicsMethod::mpm, MpmFrame::total},
      {"mpm_mesh", "MPM, mesh frame", DynamicsMethod::mpm, MpmFrame::mesh},
      {.name = "sph", .label = "SPH", .method = DynamicsMethod::sph},
      {.name = "sph_stress",
       .label = "SPH, artificial stress",
       .method = DynamicsMethod::sph,
       .artificial_stress = compared_artificial_stress},
      {.name = "sph_split", .label = "SPH, splitting", .method = DynamicsMethod::sph, .splitting = compared_splitting},
      {.name = "sph_total", .label = "SPH, total frame", .method = DynamicsMethod::sph, .sph_frame = SphFrame::total},
  };
  return all;
}

bool Comparison::has_results() const {
  return std::ranges::any_of(rows, [](const ComparisonRow& row) { return row.failure.empty(); });
}

std::optional<double> Comparison::error(const ComparisonRow& row, std::size_t probe) const {
  const ProbeReference& reference = probes[probe];
  if (!row.failure.empty() || row.probes[probe].empty() || reference.value.empty()) return {};
  return distance(row.probes[probe], reference.value) / reference.scale;
}

template <int Dim> Comparison compare_methods(const MeshSource<Dim>& source, const DynamicsSettings<Dim>& settings,
                                              const ComparisonOptions& options, const Monitor& monitor) {
  require(options.resolutions >= 1, "expected at least one resolution");
  if (settings.state_start)
    throw InputError(internal::said_at(settings.state_start->where,
                                       "runs of other methods and resolutions cannot start from the state of one: "
                                       "leave out [start] state to compare"));
  Comparison result{.methods = choose_methods(options.methods)};
  const double finest = spacing_of(source, settings);
  const double runs = static_cast<double>(result.methods.size()) * options.resolutions;
  std::string first_failure;
  bool all_bad = true;
  for (std::size_t m = 0; m < result.methods.size(); ++m)
    for (int k = options.resolutions - 1; k >= 0; --k) {
      ComparisonRow row{.method = m, .spacing = finest * std::pow(2.0, 0.5 * k)};
      const std::string name = fmt::format("{}, nodes {:.4g} apart", result.methods[m].name, row.spacing);
      const double done = static_cast<double>(result.rows.size());
      const auto tell = [&](double fraction) {
        if (monitor.progress) monitor.progress(name, (done + fraction) / runs);
      };
      tell(0.0);
      const Monitor inner{
          .progress = [&](const std::string& stage, double fraction) { tell(stage == "dynamics" ? fraction : 0.0); },
          .cancelled = monitor.cancelled};
      const bool bad_input = run_scene<Dim>(vary<Dim>({source, settings}, result.methods[m], row.spacing), inner, row);
      if (bad_input && first_failure.empty())
        first_failure = fmt::format("{} ({})", row.failure, result.methods[m].name);
      all_bad = all_bad && bad_input;
      result.rows.push_back(std::move(row));
    }
  if (all_bad) throw InputError(first_failure);
  for (std::size_t k = 0; k < settings.probes.size(); ++k)
    result.probes.push_back(find_reference(settings.probes[k], k, result));
  return result;
}

template Comparison compare_methods(const MeshSource<2>&, const DynamicsSettings<2>&, const ComparisonOptions&,
                                    const Monitor&);
template Comparison compare_methods(const MeshSource<3>&, const DynamicsSettings<3>&, const ComparisonOptions&,
                                    const Monitor&);

}  // namespace efree
