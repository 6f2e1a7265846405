// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/run_case.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <algorithm>
#include <ctime>
#include <limits>

namespace efree {
namespace {

/// Calls `work`; what is wrong with the input is said with the place in the case file in front, once.
template <class Work> auto located(const Case& analysis, const std::string& where, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    const std::string message = error.what();
    throw InputError(message.starts_with(analysis.file.string() + ":") ? message : where + ": " + message);
  }
}

/// Whether all probes lie in the body: better known before the analysis than after it.
void check_probes(const Case& analysis, const FineMesh<2>& mesh) {
  const FineSpace<2> space(mesh, 1);
  Fields<2> nothing;
  nothing.displacement.setZero(2, space.size());
  nothing.strain.setZero(3, space.size());
  nothing.stress.setZero(3, space.size());
  for (const Case::Probe& p : analysis.probes) located(analysis, p.where, [&] { return probe(space, nothing, p.at); });
}

/// Doubts about a quadrature with too few points, asked for or reached.
std::vector<std::string> doubts(const ApproximationOptions& options, const Approximation<2>& approximation) {
  if (options.kind != BasisKind::mls || options.secondary == SecondaryKind::full) return {};
  const double reached =
      static_cast<double>(approximation.quadrature.size()) / static_cast<double>(approximation.nodes.cols());
  const double asked = options.ratio > 0.0 ? options.ratio : std::numeric_limits<double>::infinity();
  if (asked >= 1.4 && reached >= 1.0) return {};
  return {fmt::format(
      "M/N = {:.2g}: under 1.4 the quadrature sees too little of the deformation; results may be far too soft",
      std::min(asked, reached))};
}

double process_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

double mesh_size(const Case& analysis) {
  return analysis.mesh_ratio > 0.0 ? analysis.approximation.spacing / analysis.mesh_ratio : analysis.mesh.size;
}

CaseMesh read_mesh(const Case& analysis, const Progress& progress) {
  StageTimes times;
  CaseMesh result;
  const double cpu_start = process_cpu_seconds();
  {
    const Stage stage("mesh", times, progress);
    GmshOptions options = analysis.mesh;
    options.size = mesh_size(analysis);
    result.mesh = located(analysis, analysis.mesh_where, [&] {
      return std::make_shared<const FineMesh<2>>(read_gmsh<2>(analysis.mesh_file.string(), options));
    });
  }
  result.seconds = times.total();
  result.cpu_seconds = process_cpu_seconds() - cpu_start;
  for (const Case::Mention& group : analysis.groups)
    located(analysis, group.where, [&] { return result.mesh->group(group.name).size(); });
  if (!analysis.probes.empty()) check_probes(analysis, *result.mesh);
  return result;
}

CaseResult solve_case(const Case& analysis, const CaseMesh& mesh, const Progress& progress) {
  CaseResult result;
  result.mesh = mesh.mesh;
  result.times.add("mesh", mesh.seconds);
  const double cpu_start = process_cpu_seconds();
  located(analysis, analysis.file.string(), [&] {
    result.approximation = approximate(*mesh.mesh, analysis.approximation, &result.times, progress);
    const ElasticSolver<2> solver(result.approximation, analysis.model, analysis.supports, &result.times, progress);
    const Stage stage("solve", result.times, progress);
    result.solution = solver.solve(analysis.loads);
  });
  result.warnings = doubts(analysis.approximation, result.approximation);
  result.cpu_seconds = mesh.cpu_seconds + process_cpu_seconds() - cpu_start;

  const Stage stage("output", result.times, progress);
  result.fields = recover_fields(result.approximation, result.solution);
  if (analysis.has_exact())
    result.errors = errors_against(result.approximation, result.fields,
                                   plane_lame(analysis.model.material, analysis.model.plane), analysis.exact);
  for (const Case::Probe& p : analysis.probes)
    result.probes.emplace_back(p.name, probe(result.approximation.space, result.fields, p.at));
  return result;
}

CaseResult solve_case(const Case& analysis, const Progress& progress) {
  return solve_case(analysis, read_mesh(analysis, progress), progress);
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace efree
