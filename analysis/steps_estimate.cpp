// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/steps_estimate.hpp"

#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/solvers/algorithms/elements_beside.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <optional>
#include <string>

namespace efree::internal {
namespace {

/// Nodes of finite elements whose tangents are factored in a time that is worth an estimate.
template <int Dim> constexpr Index most_nodes = Dim == 2 ? 200000 : 30000;

/// Whether strains are more than rounding: the energy that is stored, or has been dissipated, against that of strains
/// of 1e-10, and against the largest that was stored.
template <int Dim> bool is_deformed(const Result<Dim>& result) {
  constexpr double rounding = 1e-10;
  const auto materials = materials_of(result.model, *result.mesh);
  const auto& points = result.approximation.quadrature;
  Stiffness<Dim> room;
  double least = 0.0;
  for (Index K = 0; K < points.size(); ++K)
    least += points.weights[K] * materials.stiffness(points.region[K], points.points.col(K), room).C(0, 0);
  least *= rounding * rounding;
  for (const auto& step : result.history) least = std::max(least, rounding * step.stored);
  return result.history.back().stored + result.history.back().dissipated > least;
}

/// Why the error is not looked for; empty if it is.
template <int Dim> std::string reason_not_to(const Settings<Dim>& settings, const Result<Dim>& result) {
  const Approximation<Dim>& cloud = result.approximation;
  const FineMesh<Dim>& mesh = *result.mesh;
  if (settings.common.approximation.kind != BasisKind::mls) return "there is no cloud beside the finite elements";
  if (!settings.estimated) return "nobody asked for it";
  if (!is_elastic(result.model)) return "materials flow, and what they remember depends on the whole path";
  if (result.instability.size() > 0) return "the body was not stable on its way";
  const bool quadratic = ElementsBeside<Dim>::degree(cloud) == 2;
  const Index nodes =
      quadratic && cloud.space.degree() == 1 ? (Dim == 2 ? 4 : 8) * mesh.num_vertices() : cloud.space.size();
  if ((quadratic && !has_memory_for_quadratic_elements(mesh)) || nodes > most_nodes<Dim>)
    return fmt::format("tangents of about {} nodes of finite elements take too long", nodes);
  return "";
}

}  // namespace

template <int Dim> std::string estimate_steps(const Settings<Dim>& settings, Program<Dim> program, const State& last,
                                              Result<Dim>& result, const Monitor& monitor) {
  if (!is_deformed(result)) return {};
  std::string unknown = reason_not_to(settings, result);
  std::optional<ElementsBeside<Dim>> beside;
  std::optional<BesideCloud<Dim>> there;
  if (unknown.empty()) {
    const Stage stage("correction", monitor);
    try {
      beside.emplace(result.approximation, result.model, std::move(program), stage.within());
      there = beside->balance(last, result.fields.stress);
    } catch (const NumericalError& error) {
      unknown = "the finite elements of the fine mesh find no balance near the cloud's";
      result.warnings.push_back(fmt::format("{}, and may bear less: {}", unknown, error.what()));
    }
  }
  if (!there) return unknown;
  const NonlinearEquilibrium<Dim>& equations = beside->equations();
  const Approximation<Dim>& elements = beside->elements();
  PointFields<Dim> points = equations.fields(there->state);
  Solution<Dim> solution = solution_of(equations, there->state, points);
  Fields<Dim> fields = recover_fields(elements, solution);
  const RecoveryError mesh = recovery_error_of_points(elements, solution.stress, fields, equations.materials());
  const bool corrected = settings.corrected && result.stopped.empty();
  result.estimates = {.cloud = corrected ? 0.0 : there->distance,
                      .uncorrected = there->distance,
                      .mesh = mesh.relative,
                      .corrections = corrected ? there->iterations : 0};
  const HistoryStep<Dim>& cloud = result.history.back();
  CloudAlone& off = result.cloud_alone.emplace();
  constexpr double small = 0.01;  // of the largest
  const auto relative = [](const auto& of_cloud, const auto& should, double largest) {
    const double size = std::max(should.norm(), small * largest);
    return size > 0.0 ? (of_cloud - should).stableNorm() / size : 0.0;
  };
  const Resultants<Dim> reactions = equations.reactions(there->state);
  double most = 0.0;
  for (const auto& [part, of] : reactions) most = std::max(most, of.force.norm());
  for (const auto& [part, of] : reactions)
    off.reactions[part] = relative(cloud.reactions.at(part).force, of.force, most);
  for (const Reaction& reaction : settings.reactions)
    off.reactions[reaction.name] =
        relative(cloud.reactions.at(reaction.name).force, reactions.at(reaction.on).force, most);
  most = fields.displacement.colwise().norm().maxCoeff();
  const Locator<Dim> locator(elements.space.mesh(), settings.probes.size());
  for (std::size_t k = 0; k < settings.probes.size(); ++k)
    off.probes[settings.probes[k].name] =
        relative(cloud.probes[k], probe(elements.space, fields, locator(settings.probes[k].at)).displacement, most);
  if (!corrected) return {};
  result.elements = elements;
  result.balance = {reactions, equations.applied(there->state)};
  result.solution = std::move(solution);
  result.fields = std::move(fields);
  result.error_density = error_density(result, mesh.squares);
  return {};
}

template std::string estimate_steps<2>(const Settings<2>&, Program<2>, const State&, Result<2>&, const Monitor&);
template std::string estimate_steps<3>(const Settings<3>&, Program<3>, const State&, Result<3>&, const Monitor&);

}  // namespace efree::internal
