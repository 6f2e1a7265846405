// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/run_case.hpp"

#include "efree/assembly/bodies.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/io/internal/refinement.hpp"
#include "efree/io/internal/told_errors.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/resource.h>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <utility>

namespace efree {
namespace {

/// Calls `work`; what is wrong with the input is said with the place in the case file in front, once.
template <class Work> auto located(const CaseSettings& analysis, const std::string& where, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    const std::string message = error.what();
    throw InputError(message.starts_with(analysis.file.string() + ":") ? message : where + ": " + message);
  }
}

/// Whether all probes lie in the body: better known before the analysis than after it.
template <int Dim> void check_probes(const Case<Dim>& analysis, const FineMesh<Dim>& mesh) {
  const Locator<Dim> locate_probe(mesh, analysis.probes.size());
  for (const auto& p : analysis.probes) located(analysis, p.where, [&] { return locate_probe(p.at); });
}

/// The material of each region.
template <int Dim>
std::vector<SharedMaterial> region_materials(const CaseSettings& analysis, const FineMesh<Dim>& mesh) {
  if (analysis.materials.front().region.empty())
    return std::vector<SharedMaterial>(mesh.num_regions(), analysis.model.material);
  std::vector<SharedMaterial> materials(mesh.num_regions());
  std::vector<char> given(mesh.num_regions(), 0);
  for (const auto& material : analysis.materials) {
    const Index region = located(analysis, material.where, [&] { return mesh.region(material.region); });
    materials[region] = material.material;
    given[region] = 1;
  }
  std::vector<std::string> missing;
  for (Index r = 0; r < mesh.num_regions(); ++r)
    if (!given[r]) missing.push_back(mesh.region_names()[r]);
  if (!missing.empty())
    throw InputError(fmt::format("{}: no [[material]] for the region \"{}\"; the mesh has \"{}\"",
                                 analysis.materials.back().where, fmt::join(missing, "\", \""),
                                 fmt::join(mesh.region_names(), "\", \"")));
  return materials;
}

/// The parts of the boundary that have names and do not tie regions to each other, those that the case selects, and one
/// of all slits if there is more than one region.
template <int Dim>
FineMesh<Dim> with_parts(const Case<Dim>& analysis, FineMesh<Dim> mesh, std::string& open_interface) {
  using Group = typename FineMesh<Dim>::Group;
  std::vector<Group> groups = mesh.groups();
  if (mesh.num_regions() > 1) {
    Group slits{"\x01slits", {}};  // no name in a file
    for (const Group& group : groups)
      if (std::ranges::find(analysis.geometry.slits, group.name) != analysis.geometry.slits.end())
        slits.facets.insert(slits.facets.end(), group.facets.begin(), group.facets.end());
    if (!slits.facets.empty()) {
      open_interface = slits.name;
      groups.push_back(std::move(slits));
      mesh = std::move(mesh).with_groups(groups);
    }
  }
  const std::vector<TiedFacets> ties = tied_facets(mesh, open_interface);
  if (!ties.empty()) {
    std::vector<char> tied(mesh.num_facets(), 0);
    for (const auto& [first, second] : ties) tied[first] = tied[second] = 1;
    for (Group& group : groups) std::erase_if(group.facets, [&](Index f) { return tied[f]; });
    std::erase_if(groups, [](const Group& group) { return group.facets.empty(); });
  }
  for (const auto& selected : analysis.selections)
    located(analysis, selected.where, [&] {
      if (std::ranges::find(groups, selected.name, &Group::name) != groups.end())
        throw InputError(
            fmt::format("the mesh has a part named \"{}\", which this selection would be called", selected.name));
      groups.push_back({selected.name, select_facets(mesh, selected.how, open_interface)});
      if (groups.back().facets.empty())
        throw InputError(
            fmt::format("the selection \"{}\" is empty: no facet of the boundary, whose vertices lie in "
                        "({:.6g}) to ({:.6g}), belongs to it",
                        selected.name, fmt::join(mesh.vertices().rowwise().minCoeff().eval(), ", "),
                        fmt::join(mesh.vertices().rowwise().maxCoeff().eval(), ", ")));
    });
  return std::move(mesh).with_groups(std::move(groups));
}

/// The mesh with its hinges cut, which is said.
template <int Dim> FineMesh<Dim> without_hinges(FineMesh<Dim> mesh, CaseMesh<Dim>& result) {
  const Unhinged<Dim> cut = cut_hinges(mesh);
  if (cut.hinges.empty()) return mesh;
  const auto count = static_cast<Index>(cut.hinges.size());
  result.reports.push_back({"hinges_cut", count});
  result.remarks.push_back(
      fmt::format("cells hang together by a vertex or an edge only at {} vert{}, such as ({:.6g}): "
                  "cut there",
                  count, count == 1 ? "ex" : "ices", fmt::join(mesh.vertex(cut.hinges[0]), ", ")));
  return FineMesh<Dim>(cut.mesh);
}

/// The mesh without the bodies that neither the conditions hold nor a load moves, which is said. Where all are free, or
/// one with more than half of the volume, or loaded ones, they stay: the solver refuses them by name.
template <int Dim>
FineMesh<Dim> without_free_bodies(const Case<Dim>& analysis, FineMesh<Dim> mesh, CaseMesh<Dim>& result) {
  for (const auto& group : analysis.groups) located(analysis, group.where, [&] { mesh.group(group.name); });
  if (mesh.num_components() == 1 || analysis.loads.body_force) return mesh;
  const auto ties = tied_facets(mesh, result.open_interface);
  const Bodies<Dim> bodies =
      find_bodies(FineSpace<Dim>(mesh, 1, analysis.approximation.axisymmetric), restraints(analysis.supports), ties);
  const auto body_of = [&](Index cell) { return bodies.of_component[mesh.component()[mesh.cells()(0, cell)]]; };
  std::vector<char> out(bodies.size());
  for (Index body = 0; body < bodies.size(); ++body) out[body] = bodies.is_free(body);
  for (const auto& load : analysis.loads.tractions)
    for (const Index f : mesh.group(load.on)) out[body_of(mesh.facet_cell(f))] = 0;
  Index count = 0, largest = -1;
  double volume = 0.0;
  for (Index body = 0; body < bodies.size(); ++body) {
    if (!out[body]) continue;
    ++count;
    volume += bodies.volumes[body];
    if (largest < 0 || bodies.volumes[body] > bodies.volumes[largest]) largest = body;
  }
  if (count == 0 || count == bodies.size() || bodies.volumes[largest] > 0.5 * bodies.volumes.sum()) return mesh;
  std::vector<char> kept(mesh.num_cells());
  for (Index c = 0; c < mesh.num_cells(); ++c) kept[c] = !out[body_of(c)];
  const double fraction = volume / bodies.volumes.sum();
  const std::string what =
      fmt::format("{} bod{} with {:.2g} % of the volume", count, count == 1 ? "y" : "ies", 100.0 * fraction);
  result.reports.push_back({"free_bodies", count});
  result.reports.push_back({"free_bodies_fraction", fraction});
  result.remarks.push_back(fmt::format("{} neither held nor loaded, the largest around ({:.4g}): left out", what,
                                       fmt::join(bodies.centres.col(largest), ", ")));
  FineMesh<Dim> rest(extract(mesh, kept));
  const auto remains = [&](const std::string& name) {
    return std::ranges::find(rest.groups(), name, &FineMesh<Dim>::Group::name) != rest.groups().end();
  };
  for (const auto& group : analysis.groups)
    if (!remains(group.name))
      throw InputError(
          fmt::format("{}: all of the boundary \"{}\" is on bodies that are neither held nor loaded ({}) "
                      "and left out",
                      group.where, group.name, what));
  if (!result.open_interface.empty() && !remains(result.open_interface)) result.open_interface.clear();
  return rest;
}

/// Doubts about a quadrature with too few points, asked for or reached.
template <int Dim>
std::vector<std::string> doubts(const ApproximationOptions& options, const Approximation<Dim>& approximation) {
  if (options.kind != BasisKind::mls || options.secondary == SecondaryKind::full) return {};
  const double reached = approximation.ratio();
  const double asked = options.ratio > 0.0 ? options.ratio : std::numeric_limits<double>::infinity();
  if (asked >= 1.4 && reached >= 1.0) return {};
  return {fmt::format(
      "M/N = {:.2g}: under 1.4 the quadrature sees too little of the deformation; results may be far too soft",
      std::min(asked, reached))};
}

/// Bytes that an analysis takes at least: shape functions at the fine vertices, the stiffness and what is gathered for
/// them, for nodes as far apart as they may be.
template <int Dim> double least_memory(const ApproximationOptions& asked, const FineMesh<Dim>& mesh) {
  constexpr double entry = sizeof(double) + sizeof(Index);
  const double vertices = mesh.num_vertices(), cells = mesh.num_cells();
  const double edges = Dim == 2 ? 1.5 * cells : 1.2 * cells;
  if (asked.kind != BasisKind::mls) {
    const bool linear = asked.kind == BasisKind::p1;
    const double nodes = linear ? vertices : vertices + edges;
    const double coupled = Dim == 2 ? (linear ? 7.0 : 11.5) : (linear ? 15.0 : 28.0);
    return 0.5 * Dim * Dim * coupled * nodes * entry;
  }
  // Volume to a node, and nodes in a support, of a random packing; see sample_cloud.
  const double packing = Dim == 2 ? 1.436 : 1.363, ball = Dim == 2 ? 3.14 : 4.19;
  const double nodes = mesh.volumes().sum() / (packing * std::pow(asked.spacing, Dim));
  const ApproximationOptions options = with_defaults<Dim>(asked, vertices / nodes);
  const double seen = std::min(nodes, ball / packing * std::pow(options.support, Dim));
  const double coupled = std::min(nodes, std::pow(2.0, Dim) * seen);
  const double points = options.interpolation == 2 ? vertices + edges : vertices;
  return entry * (points * seen + 0.5 * Dim * Dim * nodes * coupled);
}

/// Relative error in the energy norm from which on an answer is doubtful: one per cent of the energy.
constexpr double doubtful = 0.1;

double bearable_error(const CaseSettings& analysis) {
  return analysis.accuracy > 0.0 ? analysis.accuracy : doubtful;
}

/// Wall-clock seconds since it was made.
class Stopwatch {
 public:
  double operator()() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Whether the case leaves no choice of its mesh.
template <int Dim> bool says_its_mesh(const Case<Dim>& analysis) {
  return analysis.geometry.size > 0.0 || analysis.geometry.ratio > 0.0;
}
constexpr const char* mesh_is_said =
    "the case says the size of its mesh: leave mesh_size out, so that it can be chosen";

/// The warning that an accuracy is not reached.
std::string not_reached(const CaseSettings& analysis, double error, const std::string& why) {
  return fmt::format("an error of {:.2g} % in the energy norm was asked for, {:.2g} % is reached: {}",
                     100.0 * analysis.accuracy, 100.0 * error, why);
}

/// The warnings that errors which were asked for are not reached.
template <int Dim> void warn_of_misses(const CaseSettings& analysis, const std::string& why, CaseResult<Dim>& result) {
  if (analysis.accuracy > 0.0 && result.estimates->total() > analysis.accuracy)
    result.warnings.push_back(not_reached(analysis, result.estimates->total(), why));
  for (const auto& goal : analysis.goals) {
    const double error = internal::relative_error_of(goal, result);
    if (error <= goal.error) continue;
    result.warnings.push_back(
        fmt::format("an error of {:.2g} % of the {} \"{}\" was asked for, {:.2g} % is reached: {}", 100.0 * goal.error,
                    goal.of == CaseSettings::Goal::Of::probe ? "probe" : "reaction", goal.name, 100.0 * error, why));
  }
}

/// Estimated error from which on nothing more is done: recovery overlooks up to a quarter of the error at corners.
double aim(const CaseSettings& analysis) {
  return analysis.accuracy > 0.0 ? 0.75 * analysis.accuracy : doubtful;
}

/// What iterations may leave: a twentieth of the square of the error that is aimed at.
double tolerance_of(const CaseSettings& analysis) {
  double tolerance = 0.3 * aim(analysis);
  for (const auto& goal : analysis.goals) tolerance = std::min(tolerance, goal.error);
  return tolerance;
}

/// Error over what is aimed at, the largest of all that was asked for (see Attempt).
template <int Dim> double excess(const CaseSettings& analysis, const CaseResult<Dim>& result) {
  const double energy = analysis.accuracy > 0.0 ? result.estimates->total() / aim(analysis) : 0.0;
  return std::max(energy, internal::missed_goals(analysis, result));
}

/// Doubts about an answer that is far from the truth, or, beyond what the case bears, a refusal.
template <int Dim> void judge(const CaseSettings& analysis, CaseResult<Dim>& result) {
  if (!result.estimates) return;
  const Estimates& errors = *result.estimates;
  if (errors.total() < std::min(bearable_error(analysis), analysis.largest_error)) return;
  const std::string what =
      result.cells
          ? fmt::format("the grid leaves an error of about {:.2g} %: use a smaller mesh_size", 100.0 * errors.mesh)
      : errors.cloud > errors.mesh
          ? fmt::format(
                "the answer is {:.2g} % off that of the finite elements of its mesh: correct it "
                "(analysis.correction = \"auto\"), or use a smaller spacing",
                100.0 * errors.cloud)
          : fmt::format("the fine mesh leaves an error of about {:.2g} %: use a smaller mesh_size{}",
                        100.0 * errors.mesh,
                        result.basis().space.degree() == 1 ? ", or quadratic cells (basis.interpolation = 2)" : "");
  if (errors.total() < analysis.largest_error)
    result.warnings.push_back(fmt::format("in the energy norm {}", what));
  else
    result.refusal = fmt::format("in the energy norm {}; to accept it say analysis.largest_error = {:.2g}", what,
                                 1.1 * errors.total());
}

/// Bytes that an answer by quadratic elements takes at its peak for each cell of the mesh, which is included: measured
/// (docs/method.md, "Memory of quadratic elements").
template <int Dim> constexpr double quadratic_bytes_per_cell = Dim == 2 ? 2.5e3 : 5.2e3;
/// Share of the memory there is that may be planned for.
constexpr double usable_memory = 0.8;

/// Whether there is memory for quadratic elements on a mesh.
template <int Dim> bool has_memory_for_quadratic_elements(const FineMesh<Dim>& mesh) {
  return quadratic_bytes_per_cell<Dim> * mesh.num_cells() < usable_memory * available_memory();
}

/// Whether there are errors to be told by dual solutions.
template <int Dim> bool names_numbers(const Case<Dim>& analysis) {
  return !analysis.probes.empty() || !analysis.reactions.empty() || analysis.largest_displacement ||
         analysis.largest_stress;
}

/// A corrected displacement as a solution of the finite elements of its space.
template <int Dim> struct Corrected {
  Correction<Dim> correction;
  Approximation<Dim> elements;
  Solution<Dim> solution;
  Fields<Dim> fields;
  RecoveryError mesh_error;
  std::shared_ptr<const Corrector<Dim>> corrector;  ///< for dual solutions; none if the case asks for none
};
template <int Dim> Corrected<Dim> corrected(const Case<Dim>& analysis, const CaseResult<Dim>& result,
                                            const Approximation<Dim>& functions, const Points<Dim>& start,
                                            const CorrectionOptions& options) {
  Corrected<Dim> result_of;
  result_of.corrector = std::make_shared<const Corrector<Dim>>(functions, result.model, analysis.supports);
  result_of.correction = result_of.corrector->correct(start, analysis.loads, options);
  if (!names_numbers(analysis)) result_of.corrector.reset();
  return_freed_memory();
  const auto elements = functions.space.degree() == 1 ? BasisKind::p1 : BasisKind::p2;
  result_of.elements = approximate<Dim>(*result.mesh, {.kind = elements,
                                                       .axisymmetric = functions.space.axisymmetric(),
                                                       .dilatation = takes_mean_dilatation(functions, result.model)});
  result_of.solution = evaluate(result_of.elements, result.model, result_of.correction.displacement);
  result_of.fields = recover_fields(result_of.elements, result_of.solution);
  result_of.mesh_error = recovery_error(result_of.elements, result_of.fields, materials_of(result.model, *result.mesh));
  return result_of;
}

/// Errors of what the case names, of the answer in the result, by dual solutions of the elements of `best`, which has
/// these fields. A warning instead if their iterations do not end.
template <int Dim> void tell_errors(const Case<Dim>& analysis, const Corrected<Dim>& best,
                                    const Approximation<Dim>& elements, const Fields<Dim>& fields, double tolerance,
                                    CaseResult<Dim>& result, const Progress& progress) {
  const auto respond = [&](const Functional<Dim>& functional) {
    return best.corrector->respond(functional, best.correction.displacement, analysis.loads,
                                   {.tolerance = std::min(tolerance, 0.01)});
  };
  try {
    internal::tell_errors(analysis, {elements, fields, false, respond}, result, progress);
  } catch (const NumericalError& error) {
    result.probe_errors.clear();
    result.reactions.clear();
    result.warnings.push_back(fmt::format("errors of probes and reactions are not known: {}", error.what()));
  }
}

/// Values at the vertices (columns) as values in the quadratic space of the mesh.
template <int Dim> Matrix at_midpoints_too(const FineSpace<Dim>& quadratic, const Matrix& u) {
  Matrix result(u.rows(), quadratic.size());
  result.leftCols(u.cols()) = u;
  Index dof = static_cast<Index>(u.cols());
  for (const auto& [a, b] : quadratic.edges()) result.col(dof++) = 0.5 * (u.col(a) + u.col(b));
  return result;
}

/// Whether a case is answered by quadratic elements and no cloud: in the plane, where linear elements on the same cells
/// are factored in less time than a cloud takes to build, and lead to the quadratic ones in fewer iterations. If an
/// accuracy is asked for, that is, and nothing of a cloud is said.
template <int Dim> bool needs_no_cloud(const Case<Dim>& analysis) {
  const ApproximationOptions& basis = analysis.approximation;
  return Dim == 2 && analysis.asks_for_accuracy() && analysis.cells == CaseSettings::Cells::automatic &&
         basis.kind == BasisKind::mls && basis.spacing == 0.0 && basis.order == 1 && basis.interpolation != 1 &&
         !basis.dilatation && analysis.estimated && analysis.corrected && analysis.correction.iterations < 0;
}

/// Quadratic elements, from the linear ones on.
template <int Dim>
void answer_by_elements(const Case<Dim>& analysis, CaseResult<Dim>& result, const Progress& progress) {
  std::optional<Stage> stage;
  stage.emplace("correction", result.times, progress);
  Approximation<Dim> quadratic;
  quadratic.space = FineSpace<Dim>(*result.mesh, 2, analysis.approximation.axisymmetric);
  const Points<Dim> nothing = Points<Dim>::Zero(Dim, quadratic.space.size());
  const double tolerance = tolerance_of(analysis);
  Corrected<Dim> best = corrected(analysis, result, quadratic, nothing, {.tolerance = tolerance});
  double squares = 0.0;  // what linear elements left
  for (std::size_t k = 1; k < best.correction.taken.size(); ++k) squares += best.correction.taken[k];
  result.estimates = {.cloud = best.correction.error,
                      .uncorrected = std::sqrt(squares),
                      .mesh = best.mesh_error.relative,
                      .corrections = best.correction.iterations};
  result.approximation = std::move(best.elements);
  result.solution = std::move(best.solution);
  result.fields = std::move(best.fields);
  result.error_density = internal::error_density(result, best.mesh_error.squares);
  stage.reset();
  tell_errors(analysis, best, result.approximation, result.fields, tolerance, result, progress);
}

/// The answer of the finite elements of the fine mesh, as near as the case wants it, and how far that of the cloud is
/// from it. Where linear cells are too coarse, and the case leaves their degree open, quadratic ones take over; where
/// dilatations are averaged quadratic ones do not lock (takes_mean_dilatation). None, and a warning, if
/// there is no memory for these, or if, very near to nu = 1/2, their iterations do not end.
template <int Dim>
std::optional<Estimates> correct(const Case<Dim>& analysis, CaseResult<Dim>& result, const Progress& progress) {
  std::optional<Stage> stage;
  stage.emplace("correction", result.times, progress);
  const Approximation<Dim>& cloud = result.approximation;
  const bool memory = has_memory_for_quadratic_elements(*result.mesh);
  const auto none = [&](const std::string& why) {
    result.warnings.push_back(fmt::format("{}: the answer is that of the cloud, and its error is not known", why));
    return std::nullopt;
  };
  if (cloud.averaged && !memory)
    return none("there is no memory for the quadratic elements that nearly incompressible materials need");
  CorrectionOptions options = analysis.correction;
  const double bearable = aim(analysis);
  options.tolerance = std::min(options.tolerance, tolerance_of(analysis));
  // As many as the estimate takes. What a cloud with averaged dilatations is off is seen at the end only.
  if (!analysis.corrected) options.iterations = cloud.averaged ? -1 : 2;
  std::optional<Approximation<Dim>> lifted;
  if (cloud.averaged && cloud.space.degree() == 1) lifted.emplace(in_quadratic_space(cloud));
  const Approximation<Dim>& functions = lifted ? *lifted : cloud;
  const Points<Dim> start = interpolate(cloud.shape, result.solution.coefficients);
  Corrected<Dim> best;
  try {
    best = corrected(analysis, result, functions, start, options);
  } catch (const NumericalError& error) {
    if (!cloud.averaged) throw;
    return none(error.what());
  }
  double uncorrected = best.correction.start_error;
  if (cloud.averaged) {
    result.fields = recover_fields(cloud, result.solution);
    Fields<Dim> fields = result.fields;
    if (lifted) fields.stress = at_midpoints_too(functions.space, fields.stress);
    fields.displacement = lifted ? Points<Dim>(at_midpoints_too(functions.space, start)) : start;
    uncorrected =
        mixed_distance(best.elements, best.correction.displacement, fields, materials_of(result.model, *result.mesh));
  }
  Estimates estimates{.cloud = analysis.corrected ? best.correction.error : uncorrected,
                      .uncorrected = uncorrected,
                      .mesh = best.mesh_error.relative,
                      .corrections = analysis.corrected ? best.correction.iterations : 0};
  const auto tell = [&](double tolerance) {
    stage.reset();
    tell_errors(analysis, best, analysis.corrected ? *result.elements : best.elements,
                analysis.corrected ? result.fields : best.fields, tolerance, result, progress);
  };
  if (!analysis.corrected) {
    if (result.fields.displacement.size() == 0) result.fields = recover_fields(cloud, result.solution);
    tell(options.tolerance);
    return estimates;
  }
  const auto hand_out = [&] {
    result.elements = std::move(best.elements);
    result.solution = std::move(best.solution);
    result.fields = std::move(best.fields);
    result.error_density = internal::error_density(result, best.mesh_error.squares);
  };
  hand_out();
  const bool free = analysis.approximation.interpolation == 0 && options.iterations < 0;
  bool finer = free && functions.space.degree() == 1 && memory;
  if (finer && estimates.total() <= bearable) {
    if (!analysis.goals.empty()) tell(options.tolerance);
    finer = internal::missed_goals(analysis, result) > 1.0;
    if (!finer && !analysis.goals.empty()) return estimates;
  }
  std::optional<Approximation<Dim>> quadratic;
  if (finer) {
    if (!stage) stage.emplace("correction", result.times, progress);
    quadratic.emplace(in_quadratic_space(cloud));
    const Points<Dim> from = std::move(best.correction.displacement);
    best = {};  // what is replaced makes room
    result.elements.reset();
    result.solution = {};
    result.fields = {};
    best = corrected(analysis, result, *quadratic, from, options);
    estimates.cloud = best.correction.error;
    estimates.mesh = best.mesh_error.relative;
    estimates.corrections += best.correction.iterations;
    hand_out();
  }
  tell(options.tolerance);
  return estimates;
}

/// Why a case cannot be solved on cells; empty if it can.
template <int Dim> std::string why_not_on_cells(const Case<Dim>& analysis, const CaseMesh<Dim>& mesh) {
  if (!mesh.image) return "the geometry is not an image in space on a lattice";
  if (analysis.loads.body_force) return "there is a body force";
  if (analysis.has_exact()) return "there is an exact solution to compare with";
  if (mesh.open_interface.size() > 0) return "regions are open along a part";
  std::vector<char> seen(mesh.materials.size(), 0);
  for (Index c = 0; c < mesh.mesh->num_cells(); ++c) {
    const Index region = mesh.mesh->region(c);
    if (std::exchange(seen[region], 1)) continue;
    Vec<3> there = Vec<3>::Zero();
    there.head<Dim>() = mesh.mesh->centroid(c);
    if (!is_isotropic(mesh.materials[region], there)) return "a material is not isotropic";
  }
  if (locks_without_dilatation(analysis)) return "a material is nearly incompressible";
  for (const auto& group : analysis.groups)
    if (!is_side(group.name)) return fmt::format("\"{}\" is not a side of the image", group.name);
  return "";
}

/// Linear elasticity on a grid as fine as the lattice of the mesh, which only carries the fields. Where the case does
/// not say how fine that is, grids of half the edges follow until the error is bearable: down to the voxels, to half of
/// them if the answer were refused else, or as far as an accuracy that is asked for takes it.
void answer_on_cells(const Case<3>& analysis, const CaseMesh<3>& mesh, CaseResult<3>& result,
                     const Progress& progress) {
  const FineSpace<3> space(*mesh.mesh, 1);
  require_restrained(space, restraints(analysis.supports), tied_facets(*mesh.mesh, mesh.open_interface));
  std::vector<SharedMaterial> of_label(mesh.region_of_label.rbegin()->first + 1);
  std::vector<Index> region_of_label(of_label.size(), -1);
  for (const auto& [label, name] : mesh.region_of_label) {
    const auto& names = mesh.mesh->region_names();
    const auto found = std::ranges::find(names, name);
    if (found != names.end()) region_of_label[label] = static_cast<Index>(found - names.begin());
    const auto material =
        std::ranges::find_if(analysis.materials, [&](const auto& m) { return m.region.empty() || m.region == name; });
    if (material == analysis.materials.end())
      throw InputError(fmt::format("{}: no [[material]] for the region \"{}\"", analysis.materials.back().where, name));
    of_label[label] = material->material;
  }
  const Stopwatch seconds;
  const bool fixed = says_its_mesh(analysis), asked = analysis.asks_for_accuracy();
  result.approximation.space = space;
  // Fields at the vertices of the mesh, which only carries them, and the errors of what the case names.
  const auto tell = [&] {
    const Stage stage("output", result.times, progress);
    result.fields = recover_fields(*result.cells, *mesh.image, *mesh.mesh, region_of_label, mesh.materials);
    internal::tell_errors_on_cells(analysis, result);
  };
  std::string why = fixed ? mesh_is_said : "";
  for (double size = mesh.size;; size *= 0.5) {
    const double begin = seconds();
    try {
      result.cells = solve_on_cells(*mesh.image, of_label, analysis.supports, analysis.loads,
                                    {.size = size, .half_voxel = true}, &result.times, progress);
    } catch (const NumericalError& failure) {
      if (!result.cells) throw;
      why = fmt::format("a finer grid fails: {}", failure.what());
      break;
    }
    const CellLevel& finest = result.cells->finest();
    const double error = std::hypot(finest.iteration_error, result.cells->grid_error), spent = seconds() - begin;
    result.solution.strain_energy = finest.strain_energy;
    result.estimates = {.cloud = finest.iteration_error,
                        .uncorrected = finest.iteration_error,
                        .mesh = result.cells->grid_error,
                        .corrections = finest.iterations};
    if (!analysis.goals.empty()) tell();
    const double missed = internal::missed_goals(analysis, result);
    result.attempts.push_back({size, finest.cells, 1, error, spent,
                               std::max(missed, analysis.accuracy > 0.0 ? error / analysis.accuracy : 0.0)});
    if (error <= bearable_error(analysis) && missed <= 1.0) {
      why.clear();
      break;
    }
    // Below its voxels an image says no more: only an answer that would be none is worth the time.
    const double least = (error < analysis.largest_error ? 1.0 : 0.5) * mesh.image->spacing.minCoeff();
    if (fixed || (!asked && size < 1.99 * least)) break;
    double points = 8.0;
    for (const Index n : result.cells->grid.cubes) points *= n + 1.0;
    if (cell_memory * points > 0.5 * available_memory()) {
      why = "a finer grid would take more memory than there is";
      break;
    }
    if (seconds() + 9.0 * spent > analysis.time_limit) {
      why = fmt::format("a finer grid would take about {:.3g} s, and the time limit is {:.3g} s", 9.0 * spent,
                        analysis.time_limit);
      break;
    }
  }
  if (asked && !why.empty()) warn_of_misses(analysis, why, result);
  if (analysis.goals.empty()) tell();
}

/// Whether the case is solved on cells. Throws InputError if it should be, but cannot.
template <int Dim> bool is_on_cells(const Case<Dim>& analysis, const CaseMesh<Dim>& mesh) {
  if (Dim == 2 || analysis.cells == CaseSettings::Cells::never) return false;
  const std::string why = why_not_on_cells(analysis, mesh);
  if (analysis.cells == CaseSettings::Cells::always && !why.empty())
    throw InputError(fmt::format("{}: basis.kind = \"cells\" does not do here: {}", analysis.file.string(), why));
  return why.empty();
}

double process_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

template <int Dim> double mesh_size(const Case<Dim>& analysis) {
  return analysis.geometry.ratio > 0.0 ? analysis.approximation.spacing / analysis.geometry.ratio
                                       : analysis.geometry.size;
}

template <int Dim> CaseMesh<Dim> read_mesh(const Case<Dim>& analysis, const Progress& progress) {
  StageTimes times;
  CaseMesh<Dim> result;
  const double cpu_start = process_cpu_seconds();
  {
    const Stage stage("mesh", times, progress);
    FineMesh<Dim> mesh = located(analysis, analysis.geometry.where, [&] {
      MadeMesh<Dim> made = analysis.geometry.mesh({mesh_size(analysis), analysis.geometry.coarsening});
      result.size = made.size;
      result.reports = std::move(made.reports);
      result.remarks = std::move(made.remarks);
      result.image = std::move(made.image);
      result.region_of_label = std::move(made.region_of_label);
      // Functions of moving least squares would smear the strain's jump across an interface; finite elements have it.
      const bool parted = analysis.approximation.kind == BasisKind::mls;
      return FineMesh<Dim>(parted ? cut_regions(std::move(made.mesh)) : std::move(made.mesh));
    });
    mesh = without_hinges(std::move(mesh), result);
    mesh = with_parts(analysis, std::move(mesh), result.open_interface);
    mesh = without_free_bodies(analysis, std::move(mesh), result);
    if (result.size == 0.0) result.size = mesh.size();
    result.mesh = std::make_shared<const FineMesh<Dim>>(std::move(mesh));
  }
  result.seconds = times.total();
  result.cpu_seconds = process_cpu_seconds() - cpu_start;
  for (const auto& group : analysis.groups) {
    const auto& facets = located(analysis, group.where, [&] { return result.mesh->group(group.name); });
    typename CaseMesh<Dim>::Part part{group.name, static_cast<Index>(facets.size()), 0.0};
    for (const Index f : facets) part.measure += result.mesh->facet_measure(f);
    result.remarks.push_back(fmt::format("boundary \"{}\": {} facets, {} {:.6g}", part.name, part.facets,
                                         Dim == 2 ? "length" : "area", part.measure));
    result.parts.push_back(std::move(part));
  }
  for (const auto& region : analysis.graded)
    located(analysis, region.where, [&] { return result.mesh->region(region.name); });
  result.materials = region_materials(analysis, *result.mesh);
  check_probes(analysis, *result.mesh);
  return result;
}

template <int Dim>
CaseResult<Dim> solve_case(const Case<Dim>& analysis, const CaseMesh<Dim>& mesh, const Progress& progress) {
  CaseResult<Dim> result;
  result.mesh = mesh.mesh;
  result.parts = mesh.parts;
  result.reports = mesh.reports;
  result.model = analysis.model;
  result.model.regions = mesh.materials;
  result.model.open_interface = mesh.open_interface;
  result.times.add("mesh", mesh.seconds);
  const double cpu_start = process_cpu_seconds();
  const bool on_cells = is_on_cells(analysis, mesh);
  const bool without_cloud = !on_cells && needs_no_cloud(analysis) && has_memory_for_quadratic_elements(*mesh.mesh);
  located(analysis, analysis.file.string(), [&] {
    if constexpr (Dim == 3)
      if (on_cells) return answer_on_cells(analysis, mesh, result, progress);
    if (without_cloud) return answer_by_elements(analysis, result, progress);
    ApproximationOptions options = analysis.approximation;
    if (options.kind == BasisKind::mls && options.spacing == 0.0) options.spacing = default_spacing(*mesh.mesh);
    require_memory(least_memory(options, *mesh.mesh),
                   fmt::format("the analysis on {} fine cells", mesh.mesh->num_cells()),
                   "use a wider cloud spacing or a coarser mesh");
    result.approximation = approximate(*mesh.mesh, options, &result.times, progress);
    std::optional<ElasticSolver<Dim>> solver(std::in_place, result.approximation, result.model, analysis.supports,
                                             &result.times, progress);
    {
      const Stage stage("solve", result.times, progress);
      result.solution = solver->solve(analysis.loads);
    }
    if (analysis.approximation.kind != BasisKind::mls) {
      result.fields = recover_fields(result.approximation, result.solution);
      const internal::Reference<Dim> reference{result.approximation, result.fields,
                                               result.model.essential == Essential::nitsche,
                                               [&](const Functional<Dim>& functional) {
                                                 return solver->respond(functional, result.solution, analysis.loads);
                                               }};
      internal::tell_errors(analysis, reference, result, progress);
    } else if (analysis.estimated) {
      solver.reset();  // its factor is of no use any more
      result.estimates = correct(analysis, result, progress);
    }
  });
  if (!on_cells && !without_cloud) {
    const auto doubtful_quadrature = doubts(analysis.approximation, result.approximation);
    result.warnings.insert(result.warnings.end(), doubtful_quadrature.begin(), doubtful_quadrature.end());
  }
  judge(analysis, result);
  result.cpu_seconds = mesh.cpu_seconds + process_cpu_seconds() - cpu_start;

  const Stage stage("output", result.times, progress);
  const Approximation<Dim>& basis = result.basis();
  if (result.fields.displacement.size() == 0) result.fields = recover_fields(basis, result.solution);
  const auto materials = materials_of(result.model, *mesh.mesh);
  if (analysis.has_exact()) result.errors = errors_against(basis, result.fields, materials, analysis.exact);
  if (result.probes.empty() && result.extremes.empty()) internal::read_off(analysis, result);
  if constexpr (Dim == 3)
    if (on_cells)
      result.error_density = internal::error_density(
          result, recovery_errors(*result.cells, result.fields, *mesh.mesh, result.model.regions));
  if (result.error_density.size() == 0)
    result.error_density = internal::error_density(result, recovery_error(basis, result.fields, materials).squares);
  return result;
}

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
template <int Dim> std::string goals_text(const CaseSettings& analysis, const CaseResult<Dim>& result) {
  std::string text;
  for (const auto& goal : analysis.goals)
    text += fmt::format(", {:.2g} % of \"{}\"", 100.0 * internal::relative_error_of(goal, result), goal.name);
  return text;
}

/// Edges that the cells of a mesh have in the mean, of boxes cut into two triangles or six tetrahedra.
template <int Dim> double mean_edge(const FineMesh<Dim>& mesh) {
  return std::pow((Dim == 2 ? 2.0 : 6.0) * mesh.volumes().sum() / mesh.num_cells(), 1.0 / Dim);
}

}  // namespace

template <int Dim> CaseResult<Dim> solve_to_accuracy(const Case<Dim>& analysis, const Progress& progress,
                                                     const std::function<void(const std::string&)>& say) {
  require_estimates(analysis);
  const Stopwatch seconds;
  const auto tell = [&](const std::string& message) {
    if (say) say(message);
  };
  const bool fixed = says_its_mesh(analysis);
  Case<Dim> trial = analysis;
  trial.geometry.coarsening = Dim == 2 ? 8.0 : 4.0;  // next to nothing, and quadratic cells may do there
  std::optional<CaseResult<Dim>> best;
  double least = 0.0;  // excess, of the best
  std::vector<Attempt> attempts;
  std::string why;
  for (;;) {
    const double begin = seconds();
    const CaseMesh<Dim> mesh = read_mesh(trial, progress);
    if (is_on_cells(analysis, mesh)) return solve_case(analysis, read_mesh(analysis, progress), progress);
    if (attempts.empty())
      for (const std::string& remark : mesh.remarks) tell(remark);
    CaseResult<Dim> result;
    try {
      result = solve_case(trial, mesh, progress);
    } catch (const NumericalError& failure) {
      if (!best) throw;
      why = fmt::format("a finer mesh fails: {}", failure.what());
      break;
    }
    if (!result.estimates) {
      why = result.warnings.front();
      if (!best) throw InputError(fmt::format("{}: {}", analysis.file.string(), why));
      break;
    }
    const double error = result.estimates->total();
    const double beyond = excess(analysis, result);
    attempts.push_back(
        {mesh.size, mesh.mesh->num_cells(), result.basis().space.degree(), error, seconds() - begin, beyond});
    tell(fmt::format("{} cells of degree {}: error {:.2g} % in the energy norm{}, {:.2g} s", attempts.back().cells,
                     attempts.back().degree, 100.0 * error, goals_text(analysis, result), attempts.back().seconds));
    if (!best || beyond < least) best = std::move(result), least = beyond;
    if (beyond <= 1.0) break;
    if (fixed) {
      why = mesh_is_said;
      break;
    }
    double finer = internal::refinement(attempts, Dim);
    // As fine as memory allows, where that is less. Meshes turn out with two and a half times the cells meant at most.
    const double room =
        0.4 * usable_memory * available_memory() / (quadratic_bytes_per_cell<Dim> * attempts.back().cells);
    if (room < 1.5) {
      why = "a finer mesh would take more memory than there is";
      break;
    }
    finer = std::max(finer, std::pow(room, -1.0 / Dim));
    const double growth = std::pow(finer, -Dim);
    if (seconds() + growth * attempts.back().seconds > analysis.time_limit) {
      why = fmt::format("a finer mesh would take about {:.3g} s, and the time limit is {:.3g} s",
                        growth * attempts.back().seconds, analysis.time_limit);
      break;
    }
    // A boundary of many details has cells smaller than asked for: then only meshes below their size differ.
    trial.geometry.size = finer * std::min(mesh.size, 1.5 * mean_edge(*mesh.mesh));
  }
  best->attempts = std::move(attempts);
  if (!why.empty()) warn_of_misses(analysis, why, *best);
  return std::move(*best);
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

template double mesh_size<2>(const Case<2>&);
template double mesh_size<3>(const Case<3>&);
template CaseMesh<2> read_mesh<2>(const Case<2>&, const Progress&);
template CaseMesh<3> read_mesh<3>(const Case<3>&, const Progress&);
template CaseResult<2> solve_to_accuracy<2>(const Case<2>&, const Progress&,
                                            const std::function<void(const std::string&)>&);
template CaseResult<2> solve_case<2>(const Case<2>&, const CaseMesh<2>&, const Progress&);
template CaseResult<3> solve_to_accuracy<3>(const Case<3>&, const Progress&,
                                            const std::function<void(const std::string&)>&);
template CaseResult<3> solve_case<3>(const Case<3>&, const CaseMesh<3>&, const Progress&);

}  // namespace efree
