// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/study.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

namespace efree {
namespace {

Method method_of(BasisKind kind, SecondaryKind secondary, double ratio) {
  if (kind == BasisKind::p1) return {"p1", "P1 finite elements", kind, SecondaryKind::full, 0.0};
  if (kind == BasisKind::p2) return {"p2", "P2 (straight sides)", kind, SecondaryKind::full, 0.0};
  if (secondary == SecondaryKind::full) return {"full", "efree, full integration", kind, secondary, 0.0};
  Method method = secondary == SecondaryKind::cells    ? Method{"cells", "efree, cells", kind, secondary, ratio}
                  : secondary == SecondaryKind::linear ? Method{"linear", "efree, linear", kind, secondary, ratio}
                                                       : Method{"mls", "efree, MLS", kind, secondary, ratio};
  if (ratio > 0.0) {
    method.name += fmt::format("-{}", ratio);
    method.label += fmt::format(", M/N = {}", ratio);
  }
  return method;
}

template <int Dim> std::vector<Method> methods_for(const Settings<Dim>& settings, bool compare) {
  if (!compare)
    return {method_of(settings.common.approximation.kind, settings.common.approximation.secondary,
                      settings.common.approximation.ratio)};
  std::vector<Method> methods;
  for (const double ratio : {1.0, 2.0, 4.0}) methods.push_back(method_of(BasisKind::mls, SecondaryKind::cells, ratio));
  for (const double ratio : {1.5, 2.5}) methods.push_back(method_of(BasisKind::mls, SecondaryKind::linear, ratio));
  const double most = with_defaults<Dim>({.secondary = SecondaryKind::mls}, 0.0).ratio;
  for (const double ratio : {1.0, 2.0, 4.0, most})
    methods.push_back(method_of(BasisKind::mls, SecondaryKind::mls, ratio));
  methods.push_back(method_of(BasisKind::mls, SecondaryKind::full, 0.0));
  methods.push_back(method_of(BasisKind::p1, SecondaryKind::full, 0.0));
  methods.push_back(method_of(BasisKind::p2, SecondaryKind::full, 0.0));
  return methods;
}

/// What a study starts from, and what each of its runs is.
template <int Dim> struct Variant {
  MeshSource<Dim> source;
  Settings<Dim> settings;

  /// H/h; 0 if the source's own mesh holds.
  double mesh_ratio() const {
    if (source.ratio > 0.0) return source.ratio;
    return source.size > 0.0 ? settings.common.approximation.spacing / source.size : 0.0;
  }
};

/// Spacings (element sizes) to run a method on, coarse to fine.
template <int Dim> std::vector<double> sizes_for(double mesh_ratio, const Method& method, const StudyOptions& options) {
  std::vector<double> sizes = options.spacings;
  std::ranges::sort(sizes, std::greater{});
  if (!options.compare || method.kind == BasisKind::mls) return sizes;
  const double finest = mesh_ratio > 0.0 ? sizes.back() / mesh_ratio : sizes.back();
  for (double& size : sizes) size *= internal::element_size<Dim>;
  const double last = method.kind == BasisKind::p1 ? finest : 2.0 * finest;
  while (sizes.back() / 2.0 > 0.9 * last) sizes.push_back(sizes.back() / 2.0);
  return sizes;
}

template <int Dim> Variant<Dim> configured(Variant<Dim> variant, const Method& method, double size) {
  auto& [source, settings] = variant;
  ApproximationOptions& options = settings.common.approximation;
  if (method.kind != BasisKind::mls) {
    source.ratio = 0.0;
    source.size = size;
    options.dilatation = Dilatation::pointwise;
  } else {
    source.ratio = variant.mesh_ratio();
    if (options.spacing > 0.0) options.grading = internal::scaled(std::move(options.grading), size / options.spacing);
  }
  settings.estimated = settings.corrected = false;  // a study is of the methods themselves
  settings.accuracy = 0.0;
  settings.goals.clear();
  settings.cells = OnCells::never;
  const bool same_kind = options.kind == method.kind;
  options.kind = method.kind;
  options.secondary = method.secondary;
  options.ratio = method.ratio;
  options.spacing = size;
  if (!same_kind) settings.common.model.essential.reset();
  return variant;
}

template <int Dim> StudyRow row_of(std::size_t method, double size, std::uint64_t seed, const Result<Dim>& result) {
  StudyRow row{.method = method,
               .spacing = size,
               .seed = seed,
               .nodes = static_cast<Index>(result.approximation.nodes.cols()),
               .fine_vertices = result.mesh->num_vertices(),
               .fine_cells = result.mesh->num_cells(),
               .quadrature_points = result.approximation.quadrature.size(),
               .errors = result.errors.value_or(Errors{}),
               .strain_energy = result.solution.strain_energy,
               .times = result.times,
               .cpu_seconds = result.cpu_seconds};
  for (const char* stage : Study::stages) row.seconds += result.times[stage];
  return row;
}

StudyPoint::Spread spread(const std::vector<double>& values) {
  const auto [low, high] = std::ranges::minmax(values);
  return {low, internal::median(values), high};
}

template <class Value> StudyPoint::Spread spread_of(const std::vector<const StudyRow*>& rows, const Value& value) {
  std::vector<double> values;
  for (const StudyRow* row : rows) values.push_back(value(*row));
  return spread(values);
}

StudyPoint summary(const std::vector<const StudyRow*>& rows) {
  StudyPoint point;
  point.spacing = rows.front()->spacing;
  point.nodes = spread_of(rows, [](const StudyRow& row) { return static_cast<double>(row.nodes); }).median;
  point.seconds = spread_of(rows, [](const StudyRow& row) { return row.seconds; });
  for (std::size_t k = 0; k < std::size(error_kinds); ++k)
    if (const auto value = error_kinds[k].value; rows.front()->errors.*value)
      point.errors[k] = spread_of(rows, [&](const StudyRow& row) { return *(row.errors.*value); });
  for (const char* stage : Study::stages)
    point.stages.emplace_back(stage, spread_of(rows, [&](const StudyRow& row) { return row.times[stage]; }).median);
  return point;
}

double slope(const std::vector<std::pair<double, double>>& points) {
  double mean_x = 0.0, mean_y = 0.0, xx = 0.0, xy = 0.0;
  for (const auto& [x, y] : points) {
    mean_x += x / static_cast<double>(points.size());
    mean_y += y / static_cast<double>(points.size());
  }
  for (const auto& [x, y] : points) {
    xx += (x - mean_x) * (x - mean_x);
    xy += (x - mean_x) * (y - mean_y);
  }
  return xy / xx;
}

}  // namespace

std::vector<StudyPoint> Study::points(std::size_t method) const {
  std::map<double, std::vector<const StudyRow*>, std::greater<>> by_spacing;
  for (const StudyRow& row : rows)
    if (row.method == method) by_spacing[row.spacing].push_back(&row);
  std::vector<StudyPoint> result;
  for (const auto& entry : by_spacing) result.push_back(summary(entry.second));
  return result;
}

std::optional<double> Study::order(std::size_t method, std::size_t error_kind) const {
  const bool cloud = methods[method].kind == BasisKind::mls;
  std::vector<std::pair<double, double>> logs;
  for (const StudyPoint& point : points(method))
    if (const auto& error = point.errors[error_kind])
      logs.emplace_back(cloud ? std::log(point.spacing) : -std::log(point.nodes) / dimension, std::log(error->median));
  if (logs.size() < 2) return {};
  return slope(logs);
}

template <int Dim> Study run_study(const MeshSource<Dim>& source, const Settings<Dim>& settings,
                                   const StudyOptions& options, const Monitor& monitor) {
  const std::set<double> different(options.spacings.begin(), options.spacings.end());
  if (different.size() < 2 || different.size() < options.spacings.size() || *different.begin() <= 0.0)
    throw InputError(fmt::format("spacings {}, expected at least two different positive numbers",
                                 fmt::join(options.spacings, ", ")));
  if (settings.cells == OnCells::always)
    throw InputError(internal::said_at(
        internal::where_said(settings.common, "basis.kind"),
        "a convergence study is of clouds and finite elements; on cells (basis.kind = \"cells\") every answer has its "
        "study, the grids in result.json"));
  const Variant<Dim> given{source, settings};
  Study study{.dimension = Dim, .methods = methods_for<Dim>(settings, options.compare)};
  struct Run {
    std::size_t method;
    double size;
  };
  std::vector<Run> runs;
  double work = 0.0, done = 0.0;  // the number of fine cells, in the main
  for (std::size_t m = 0; m < study.methods.size(); ++m)
    for (const double size : sizes_for<Dim>(given.mesh_ratio(), study.methods[m], options)) {
      runs.push_back({m, size});
      work += options.seeds / std::pow(size, Dim);
    }
  for (const auto& [m, size] : runs) {
    const Method& method = study.methods[m];
    Variant<Dim> variant = configured(given, method, size);
    for (int repetition = 0; repetition < options.seeds; ++repetition) {
      const std::uint64_t seed = settings.common.approximation.seed + static_cast<std::uint64_t>(repetition);
      const std::string run = fmt::format("{}, spacing {:.4g}, seed {}", method.name, size, seed);
      Monitor::Progress still;  // the run goes on: its stages are none of the study
      if (monitor.progress) {
        still = [&](const std::string&, double) { monitor.progress(run, done / work); };
        monitor.progress(run, done / work);
      }
      variant.settings.common.approximation.seed = seed;
      try {
        study.rows.push_back(
            row_of(m, size, seed,
                   analyse(variant.source, variant.settings, {.progress = still, .cancelled = monitor.cancelled})));
      } catch (const NumericalError& error) {
        throw NumericalError(fmt::format("{}: {}", run, error.what()));
      }
      done += 1.0 / std::pow(size, Dim);
    }
  }
  return study;
}

template Study run_study<2>(const MeshSource<2>&, const Settings<2>&, const StudyOptions&, const Monitor&);
template Study run_study<3>(const MeshSource<3>&, const Settings<3>&, const StudyOptions&, const Monitor&);

}  // namespace efree
