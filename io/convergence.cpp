// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/convergence.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

namespace efree {
namespace {

constexpr std::array<const char*, 7> study_stages{"mesh",       "cloud",    "weights", "basis",
                                                  "quadrature", "assembly", "solve"};
/// Elements of this size have about as many vertices as a cloud of spacing 1 has nodes.
template <int Dim> constexpr double element_size_per_spacing = Dim == 2 ? 0.85 : 1.5;

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

template <int Dim> std::vector<Method> methods_for(const CaseSettings& analysis, bool compare) {
  if (!compare)
    return {method_of(analysis.approximation.kind, analysis.approximation.secondary, analysis.approximation.ratio)};
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

/// H/h of the case; 0 if the file's own mesh holds.
template <int Dim> double mesh_ratio(const Case<Dim>& analysis) {
  if (analysis.geometry.ratio > 0.0) return analysis.geometry.ratio;
  return analysis.geometry.size > 0.0 ? analysis.approximation.spacing / analysis.geometry.size : 0.0;
}

/// Spacings (element sizes) to run a method on, coarse to fine.
template <int Dim>
std::vector<double> sizes_for(const Case<Dim>& analysis, const Method& method, const StudyOptions& options) {
  std::vector<double> sizes = options.spacings;
  std::ranges::sort(sizes, std::greater{});
  if (!options.compare || method.kind == BasisKind::mls) return sizes;
  const double finest = mesh_ratio(analysis) > 0.0 ? sizes.back() / mesh_ratio(analysis) : sizes.back();
  for (double& size : sizes) size *= element_size_per_spacing<Dim>;
  const double last = method.kind == BasisKind::p1 ? finest : 2.0 * finest;
  while (sizes.back() / 2.0 > 0.9 * last) sizes.push_back(sizes.back() / 2.0);
  return sizes;
}

/// The grading of a case for clouds `factor` times as wide: spacings asked for at places, and how fast they grow from
/// there, so that the clouds of a study are similar.
Grading scaled(Grading grading, double factor) {
  if (!grading.has_places()) return grading;
  for (auto& part : grading.boxes) part.spacing *= factor;
  for (auto& part : grading.regions) part.spacing *= factor;
  for (auto& part : grading.boundaries) part.spacing *= factor;
  grading.growth *= factor;
  return grading;
}

template <int Dim> Case<Dim> configured(Case<Dim> analysis, const Method& method, double size) {
  ApproximationOptions& options = analysis.approximation;
  if (method.kind != BasisKind::mls) {
    analysis.geometry.ratio = 0.0;
    analysis.geometry.size = size;
    options.dilatation = false;
  } else {
    analysis.geometry.ratio = mesh_ratio(analysis);
    if (options.spacing > 0.0) options.grading = scaled(std::move(options.grading), size / options.spacing);
  }
  analysis.estimated = analysis.corrected = false;  // a study is of the methods themselves
  analysis.cells = CaseSettings::Cells::never;
  const bool same_kind = options.kind == method.kind;
  options.kind = method.kind;
  options.secondary = method.secondary;
  options.ratio = method.ratio;
  options.spacing = size;
  impose(analysis, same_kind                       ? analysis.model.essential
                   : method.kind == BasisKind::mls ? Essential::nitsche
                                                   : Essential::strong);
  return analysis;
}

template <int Dim> StudyRow row_of(std::size_t method, double size, std::uint64_t seed, const CaseResult<Dim>& result) {
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
  for (const char* stage : study_stages) row.seconds += result.times[stage];
  return row;
}

StudyPoint::Spread spread(std::vector<double> values) {
  std::ranges::sort(values);
  const std::size_t n = values.size();
  return {values.front(), 0.5 * (values[(n - 1) / 2] + values[n / 2]), values.back()};
}

template <class Value> StudyPoint::Spread spread_of(const std::vector<const StudyRow*>& rows, const Value& value) {
  std::vector<double> values;
  for (const StudyRow* row : rows) values.push_back(value(*row));
  return spread(std::move(values));
}

StudyPoint summary(const std::vector<const StudyRow*>& rows) {
  StudyPoint point;
  point.spacing = rows.front()->spacing;
  point.nodes = spread_of(rows, [](const StudyRow& row) { return static_cast<double>(row.nodes); }).median;
  point.seconds = spread_of(rows, [](const StudyRow& row) { return row.seconds; });
  for (std::size_t k = 0; k < std::size(error_kinds); ++k)
    if (const auto value = error_kinds[k].value; rows.front()->errors.*value)
      point.errors[k] = spread_of(rows, [&](const StudyRow& row) { return *(row.errors.*value); });
  for (const char* stage : study_stages)
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

template <int Dim> Study run_study(const Case<Dim>& analysis, const StudyOptions& options, const Progress& progress) {
  const std::set<double> different(options.spacings.begin(), options.spacings.end());
  if (different.size() < 2 || different.size() < options.spacings.size() || *different.begin() <= 0.0)
    throw InputError(fmt::format("spacings {}, expected at least two different positive numbers",
                                 fmt::join(options.spacings, ", ")));
  if (analysis.cells == CaseSettings::Cells::always)
    throw InputError(
        fmt::format("{}: a convergence study is of clouds and finite elements; on cells (basis.kind = \"cells\") every "
                    "answer has its study, the grids in result.json",
                    analysis.file.string()));
  Study study{.dimension = Dim, .methods = methods_for<Dim>(analysis, options.compare)};
  struct Run {
    std::size_t method;
    double size;
  };
  std::vector<Run> runs;
  double work = 0.0, done = 0.0;  // the number of fine cells, in the main
  for (std::size_t m = 0; m < study.methods.size(); ++m)
    for (const double size : sizes_for(analysis, study.methods[m], options)) {
      runs.push_back({m, size});
      work += options.seeds / std::pow(size, Dim);
    }
  for (const auto& [m, size] : runs) {
    const Method& method = study.methods[m];
    Case<Dim> variant = configured(analysis, method, size);
    for (int repetition = 0; repetition < options.seeds; ++repetition) {
      const std::uint64_t seed = analysis.approximation.seed + static_cast<std::uint64_t>(repetition);
      const std::string run = fmt::format("{}, spacing {:.4g}, seed {}", method.name, size, seed);
      if (progress) progress(run, done / work);
      variant.approximation.seed = seed;
      try {
        study.rows.push_back(row_of(m, size, seed, solve_case(variant)));
      } catch (const NumericalError& error) {
        throw NumericalError(fmt::format("{}: {}", run, error.what()));
      }
      done += 1.0 / std::pow(size, Dim);
    }
  }
  return study;
}

template Study run_study<2>(const Case<2>&, const StudyOptions&, const Progress&);
template Study run_study<3>(const Case<3>&, const StudyOptions&, const Progress&);

void write_study_csv(const std::filesystem::path& file, const Study& study) {
  std::ofstream csv(file);
  csv << "spacing,seed,method,nodes,fine_vertices,fine_cells,quadrature_points";
  for (const ErrorKind& kind : error_kinds) csv << ',' << kind.name;
  csv << ",strain_energy";
  for (const char* stage : study_stages) csv << ",seconds_" << stage;
  csv << ",seconds_total,cpu_seconds\n";
  for (const StudyRow& row : study.rows) {
    csv << fmt::format("{},{},{},{},{},{},{}", row.spacing, row.seed, study.methods[row.method].name, row.nodes,
                       row.fine_vertices, row.fine_cells, row.quadrature_points);
    for (const ErrorKind& kind : error_kinds)
      csv << (row.errors.*kind.value ? fmt::format(",{}", *(row.errors.*kind.value)) : ",");
    csv << fmt::format(",{}", row.strain_energy);
    for (const char* stage : study_stages) csv << fmt::format(",{:.6f}", row.times[stage]);
    csv << fmt::format(",{:.6f},{:.6f}\n", row.seconds, row.cpu_seconds);
  }
  if (!csv.flush()) throw InputError(fmt::format("cannot write {}", file.string()));
}

void write_study_json(const std::filesystem::path& file, const CaseSettings& analysis, const Study& study) {
  nlohmann::ordered_json json;
  json["title"] = analysis.title;
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    nlohmann::ordered_json& method = json["methods"][study.methods[m].name];
    method["label"] = study.methods[m].label;
    for (std::size_t k = 0; k < std::size(error_kinds); ++k)
      if (const auto order = study.order(m, k)) method["orders"][error_kinds[k].name] = *order;
    for (const StudyPoint& point : study.points(m)) {
      nlohmann::ordered_json entry{
          {"spacing", point.spacing}, {"nodes", point.nodes}, {"seconds", point.seconds.median}};
      for (std::size_t k = 0; k < std::size(error_kinds); ++k)
        if (point.errors[k]) entry[error_kinds[k].name] = point.errors[k]->median;
      method["medians"].push_back(std::move(entry));
    }
  }
  json["threads"] = num_threads();
  json["version"] = version();
  std::ofstream stream(file);
  stream << json.dump(2) << '\n';
  if (!stream.flush()) throw InputError(fmt::format("cannot write {}", file.string()));
}

std::string order_table(const Study& study) {
  const auto cell = [](std::optional<double> value) {
    return value ? fmt::format("{:.2f}", *value) : std::string("-");
  };
  std::string table =
      fmt::format("{:<10}{:>10}{:>10}{:>10}   observed orders in the spacing (P1, P2: in nodes^(-1/{}))\n", "method",
                  "L2", "energy", "recovered", study.dimension);
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    table += fmt::format("{:<10}", study.methods[m].name);
    for (std::size_t k = 0; k < std::size(error_kinds); ++k) table += fmt::format("{:>10}", cell(study.order(m, k)));
    table += '\n';
  }
  return table;
}

}  // namespace efree
