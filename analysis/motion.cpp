// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/motion.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <numbers>
#include <ranges>
#include <set>
#include <utility>

namespace efree {
namespace {

using internal::located, internal::said_at, internal::where_said;

/// Where the material of a region was said, and its density.
template <int Dim>
std::pair<std::string, Parameter> density_of(const Settings<Dim>& settings, const std::string& region) {
  std::string where = where_said(settings, "material");
  Parameter density = settings.density;
  for (const auto& material : settings.materials)
    if (material.region == region) {
      where = material.where;
      density = material.density;
    }
  if (density.is_constant() && !(density.at(Vec<3>::Zero()) > 0.0))
    throw InputError(said_at(where, "density is missing: bodies in motion need one"));
  return {where, density};
}

template <int Dim> void give_density(const Parameter& density, OtmBody<Dim>& body) {
  if (density.is_constant()) {
    body.density = density.at(Vec<3>::Zero());
    return;
  }
  body.densities.resize(body.points.cols());
  for (Index p = 0; p < body.points.cols(); ++p) {
    Vec<3> X = Vec<3>::Zero();
    X.template head<Dim>() = body.points.col(p);
    body.densities[p] = density.at(X);
  }
}

/// A body as it is built: its mesh, nodes on parts of its boundary, what it is made of.
template <int Dim> struct Built {
  OtmBody<Dim> body;
  std::map<std::string, std::vector<Index>> nodes_on;  ///< by part of the boundary, ascending
  std::map<std::string, Facets<Dim>> inside;           ///< of nodes, by part that holds a gas
};

template <int Dim> const std::vector<Index>* facets_of(const FineMesh<Dim>& mesh, const std::string& part) {
  const auto group = std::ranges::find(mesh.groups(), part, &FineMesh<Dim>::Group::name);
  return group == mesh.groups().end() ? nullptr : &group->facets;
}

/// Whether points share their dilatation.
template <int Dim> bool shares(const MotionSettings<Dim>& motion, const Material& material) {
  const bool shocks = motion.options.shock.on() && dynamic_cast<const Fluid*>(&material) != nullptr;
  return motion.shared_dilatation.value_or(!shocks);
}

template <int Dim> Built<Dim> at_vertices(const FineMesh<Dim>& mesh, const SharedMaterial& material, bool axisymmetric,
                                          const MotionSettings<Dim>& motion) {
  Built<Dim> result{otm_body(mesh, material, 0.0, axisymmetric), {}, {}};
  for (const auto& gas : motion.gases)
    if (const auto* facets = facets_of(mesh, gas.on)) result.inside[gas.on] = mesh.facets()(Eigen::all, *facets);
  if (!shares(motion, *material)) result.body.unions.clear();
  for (const auto& part : motion.moved)
    if (const auto* facets = facets_of(mesh, part.on)) {
      std::set<Index> nodes;
      for (const Index f : *facets)
        for (int i = 0; i < Dim; ++i) nodes.insert(mesh.facets()(i, f));
      result.nodes_on[part.on].assign(nodes.begin(), nodes.end());
    }
  return result;
}

/// Whether dilatations have to be shared on the functions of the static solver.
bool locks(const Material& material) {
  const auto rest = respond(material, Deformation::none(Points<3>::Zero(3, 1), material.history_size()), true);
  return !material.elastic() || incompressibility(rest.tangent_at(0)) > bearable_incompressibility(BasisKind::mls);
}

template <int Dim> Built<Dim> on_cloud(const FineMesh<Dim>& mesh, const SharedMaterial& material,
                                       const Settings<Dim>& settings, const MotionSettings<Dim>& motion,
                                       const Monitor& monitor) {
  ApproximationOptions options = settings.approximation;
  if (options.support == 0.0) options.support = otm_support;
  options.axisymmetric = settings.model.plane == Plane::axisymmetric;
  options.dilatation = averaged_if(shares(motion, *material) && locks(*material));
  options.pressures = PressureKind::constant;
  std::erase_if(options.grading.boundaries, [&](const auto& graded) { return !facets_of(mesh, graded.boundary); });
  // Functions of other nodes vanish where some are held: values there are those of the nodes.
  for (const auto& part : motion.moved)
    if (facets_of(mesh, part.on)) options.vanish_on.push_back(part.on);
  const Approximation<Dim> cloud = approximate(mesh, options, monitor);
  Built<Dim> result{otm_body(cloud, material, 0.0), {}, {}};
  for (const auto& part : motion.moved)
    if (const auto* facets = facets_of(mesh, part.on)) {
      std::set<Index> dofs;
      for (const Index f : *facets)
        for (const Index dof : cloud.space.facet(f)) dofs.insert(dof);
      for (std::size_t a = 0; a < cloud.node_dofs.size(); ++a)
        if (dofs.contains(cloud.node_dofs[a])) result.nodes_on[part.on].push_back(static_cast<Index>(a));
    }
  return result;
}

template <int Dim> void throw_bodies(const Settings<Dim>& settings, const MotionSettings<Dim>& motion,
                                     const std::string& region, OtmBody<Dim>& body) {
  body.velocity.setZero(Dim, body.nodes.cols());
  for (const auto& thrown : motion.velocities) {
    if (!thrown.region.empty() && thrown.region != region) continue;
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      const Vec<Dim> v = located(settings, thrown.where, [&] { return thrown.velocity(body.nodes.col(a)); });
      if (!v.allFinite())
        throw InputError(said_at(
            thrown.where, fmt::format("the velocity at ({:.6g}) is no number", fmt::join(body.nodes.col(a), ", "))));
      body.velocity.col(a) = v;
    }
  }
}

/// That bodies are not inside of walls and tools at the start.
template <int Dim> void check_gaps(const MotionSettings<Dim>& motion, const Points<Dim>& vertices) {
  const double size = (vertices.rowwise().maxCoeff() - vertices.rowwise().minCoeff()).norm();
  const auto check = [&](const ToolShape<Dim>& shape, const char* name, const std::string& where) {
    Index deepest = 0;
    double least = std::numeric_limits<double>::infinity();
    for (Index a = 0; a < static_cast<Index>(vertices.cols()); ++a)
      if (const double gap = shape(vertices.col(a)).gap; gap < least) {
        least = gap;
        deepest = a;
      }
    if (least < -1e-6 * size)
      throw InputError(said_at(where, fmt::format("bodies reach {} by {:.4g} at the start, at ({:.6g})", name, -least,
                                                  fmt::join(vertices.col(deepest), ", "))));
  };
  for (const auto& [wall, where] : motion.walls)
    check(tools::half_space<Dim>(wall.normal, wall.level), "through the wall", where);
  for (const auto& [tool, where] : motion.tools) check(tool.shape, "into the tool", where);
}

/// That bodies are not inside each other at the start, from where contact would not push them.
template <int Dim> void check_overlaps(const Settings<Dim>& settings, const MovingBodies<Dim>& bodies) {
  const Otm<Dim>& otm = bodies.otm;
  const std::vector<Index> inside = otm.points_in_others();
  if (inside.empty()) return;
  Index body = 0;
  while (otm.first_point(body + 1) <= inside.front()) ++body;
  throw InputError(said_at(
      where_said(settings, "geometry"),
      fmt::format("bodies overlap at the start: region \"{}\" is inside another one at ({:.6g}) (contact.stiffness = 0 "
                  "lets bodies pass through each other)",
                  bodies.names[body], fmt::join(otm.points().col(inside.front()), ", "))));
}

template <int Dim>
void check_probes(const MotionSettings<Dim>& motion, const Settings<Dim>& settings, MovingBodies<Dim>& bodies) {
  std::vector<std::string> fields;
  for (const auto& [name, values] : point_scalars(bodies.otm)) fields.push_back(name);
  const auto check_field = [&](const std::string& field, const std::string& where) {
    if (!field.empty() && std::ranges::find(fields, field) == fields.end())
      throw InputError(
          said_at(where, fmt::format("there is no field \"{}\"; the points have {}", field, fmt::join(fields, ", "))));
  };
  check_field(motion.colour, where_said(settings, "output.colour"));
  for (const auto& probe : motion.probes) {
    check_field(probe.field, probe.where);
    if (!probe.region.empty() && std::ranges::find(bodies.names, probe.region) == bodies.names.end())
      throw InputError(said_at(probe.where, fmt::format("there is no region \"{}\"; the mesh has \"{}\"", probe.region,
                                                        fmt::join(bodies.names, "\", \""))));
    Index nearest = -1;
    if (probe.of == MotionProbe<Dim>::Of::node) {
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t b = 0; b < bodies.names.size(); ++b) {
        if (!probe.region.empty() && probe.region != bodies.names[b]) continue;
        for (Index a = bodies.otm.first_node(b); a < bodies.otm.first_node(b + 1); ++a) {
          const double distance = (bodies.start.col(a) - probe.at).norm();
          if (distance >= least) continue;
          least = distance;
          nearest = a;
        }
      }
      bodies.remarks.push_back(fmt::format("probe \"{}\": the node at ({:.6g}), {:.3g} from there", probe.name,
                                           fmt::join(bodies.start.col(nearest), ", "), least));
    } else if (probe.field.empty()) {
      located(settings, probe.where, [&] { return probe.place(bodies.start.col(0)); });
    }
    bodies.nodes_of_probes.push_back(nearest);
  }
}

/// A region as a body.
template <int Dim> Built<Dim> build(const FineMesh<Dim>& part, const std::string& region,
                                    const SharedMaterial& material, const Settings<Dim>& settings,
                                    const MotionSettings<Dim>& motion, const Monitor& monitor) {
  const auto [where, density] = density_of(settings, region);
  if (!material->finite_strain())
    throw InputError(said_at(where,
                             "the material is for small strains, and bodies in motion turn: take hencky, "
                             "neo_hookean, st_venant_kirchhoff, j2 or another one for finite strains"));
  Built<Dim> result = located(settings, settings.where, [&] {
    return motion.cloud ? on_cloud(part, material, settings, motion, monitor)
                        : at_vertices(part, material, Dim == 2 && settings.model.plane == Plane::axisymmetric, motion);
  });
  give_density(density, result.body);
  throw_bodies(settings, motion, region, result.body);
  for (const auto& broken : motion.fractures)
    if (broken.region.empty() || broken.region == region) result.body.fracture = broken.fracture;
  return result;
}

/// Gases into the parts that hold them.
template <int Dim> void fill(const Settings<Dim>& settings, const MotionSettings<Dim>& motion,
                             const std::vector<Built<Dim>>& built, Otm<Dim>& otm) {
  for (const auto& gas : motion.gases) {
    if (motion.cloud) throw InputError(said_at(gas.where, "a gas needs nodes at the vertices of the mesh, no [cloud]"));
    OtmCavity<Dim> cavity{.facets = {}, .pressure = gas.pressure, .exponent = gas.exponent};
    for (std::size_t b = 0; b < built.size(); ++b)
      if (const auto found = built[b].inside.find(gas.on); found != built[b].inside.end()) {
        const Index before = static_cast<Index>(cavity.facets.cols()), more = static_cast<Index>(found->second.cols());
        cavity.facets.conservativeResize(Eigen::NoChange, before + more);
        cavity.facets.rightCols(more) = found->second.array() + otm.first_node(static_cast<Index>(b));
      }
    located(settings, gas.where, [&] { otm.add_cavity(cavity); });
  }
}

/// Velocities of nodes on parts of the boundary, and across the axis.
template <int Dim> void prescribe(const MotionSettings<Dim>& motion, const std::vector<Built<Dim>>& built,
                                  bool axisymmetric, MovingBodies<Dim>& bodies) {
  std::map<std::pair<Index, int>, double> velocities;
  for (const auto& part : motion.moved)
    for (std::size_t b = 0; b < built.size(); ++b) {
      const auto nodes = built[b].nodes_on.find(part.on);
      if (nodes == built[b].nodes_on.end()) continue;
      for (const Index of_body : nodes->second) {
        const Index a = bodies.otm.first_node(static_cast<Index>(b)) + of_body;
        for (int i = 0; i < Dim; ++i)
          if (part.velocity[i]) velocities[{a, i}] = part.velocity[i](bodies.start.col(a));
      }
    }
  if (axisymmetric)
    for (Index a = 0; a < bodies.otm.num_nodes(); ++a)
      if (bodies.start(0, a) < 1e-9 * bodies.start.row(0).maxCoeff()) velocities[{a, 0}] = 0.0;
  for (const auto& [which, velocity] : velocities) bodies.otm.prescribe(which.first, which.second, velocity);
}

/// Forces are momenta over a step, which has to be a number that can be divided by.
template <int Dim> void check_times(const MotionSettings<Dim>& motion, const Settings<Dim>& settings, double stable) {
  constexpr double least = 1e-12;
  for (const auto& [name, time] : {std::pair("end", motion.end), std::pair("max_step", motion.max_step)})
    if (time < least * stable)
      throw InputError(
          said_at(where_said(settings, std::string("time.") + name),
                  fmt::format("{} is {:.3g}, next to nothing beside a stable step, {:.3g}", name, time, stable)));
}

}  // namespace

template <int Dim> MovingBodies<Dim> set_in_motion(const PreparedMesh<Dim>& mesh, const Settings<Dim>& settings,
                                                   const MotionSettings<Dim>& motion, const Monitor& monitor) {
  const FineMesh<Dim>& all = *mesh.mesh;
  const bool axisymmetric = Dim == 2 && settings.model.plane == Plane::axisymmetric;
  if (settings.loads.inside())
    throw InputError(
        said_at(settings.where, "forces in bodies in motion: expected MotionSettings::acceleration and no loads"));
  for (const auto& thrown : motion.velocities)
    if (!thrown.region.empty()) located(settings, thrown.where, [&] { return all.region(thrown.region); });
  for (const auto& broken : motion.fractures)
    if (!broken.region.empty()) located(settings, broken.where, [&] { return all.region(broken.region); });
  if (axisymmetric && all.vertices().row(0).minCoeff() < 0.0)
    throw InputError(said_at(where_said(settings, "analysis.plane"),
                             fmt::format("axisymmetric: x is the radius, and the body reaches to x = {:.6g}",
                                         all.vertices().row(0).minCoeff())));
  std::vector<Built<Dim>> built;
  std::vector<std::string> names, flat;
  std::vector<double> sizes;
  for (Index r = 0; r < all.num_regions(); ++r) {
    std::vector<char> kept(all.num_cells());
    for (Index c = 0; c < all.num_cells(); ++c) kept[c] = all.region(c) == r;
    if (std::ranges::count(kept, 1) == 0) continue;
    names.push_back(all.region_names()[r]);
    const FineMesh<Dim> part = all.num_regions() == 1 ? all : FineMesh<Dim>(extract(all, kept));
    built.push_back(build(part, names.back(), mesh.materials[r], settings, motion, monitor));
    const OtmBody<Dim>& body = built.back().body;
    const auto vertices = std::views::iota(Index{0}, part.num_vertices());
    if (!motion.cloud && std::ranges::all_of(vertices, [&](Index v) { return part.on_boundary(v); }))
      flat.push_back(names.back());
    for (Index p = 0; p < body.points.cols(); ++p) {
      const double turn = axisymmetric ? 2.0 * std::numbers::pi * body.points(0, p) : 1.0;
      sizes.push_back(std::pow(body.volumes[p] / turn, 1.0 / Dim));
    }
  }
  const Stage stage("bodies", monitor);
  OtmOptions options = motion.options;
  options.plane = settings.model.plane.value_or(Plane::strain);
  // Measured, with a checkpoint.
  constexpr double bytes_of_a_point = 4e3;
  require_memory(bytes_of_a_point * static_cast<double>(sizes.size()),
                 fmt::format("moving {} material points", sizes.size()), "take a coarser mesh, or a [cloud]");
  std::vector<OtmBody<Dim>> bodies;
  for (auto& one : built) bodies.push_back(std::move(one.body));
  MovingBodies<Dim> result{
      .otm = located(settings, settings.where, [&] { return Otm<Dim>(std::move(bodies), options); }),
      .names = std::move(names),
      .start = {},
      .size = Eigen::Map<const Vector>(sizes.data(), static_cast<Index>(sizes.size())),
      .nodes_of_probes = {}};
  result.start = result.otm.nodes();
  check_gaps(motion, all.vertices());
  check_overlaps(settings, result);
  for (const auto& [wall, where] : motion.walls)
    located(settings, where, [&, &added = wall] { result.otm.add_wall(added); });
  for (const auto& [tool, where] : motion.tools)
    located(settings, where, [&, &added = tool] { result.otm.add_tool(added); });
  located(settings, where_said(settings, "analysis.acceleration"), [&] { result.otm.accelerate(motion.acceleration); });
  fill(settings, motion, built, result.otm);
  prescribe(motion, built, axisymmetric, result);
  result.warnings = mesh.warnings;
  if (const auto ties = tied_facets(all); !ties.empty())
    result.warnings.push_back(
        fmt::format("regions touch along {} facets: they are bodies of their own, and nothing ties them", ties.size()));
  if (!flat.empty())
    result.warnings.push_back(
        fmt::format("no node lies inside {}, whose bending and squeezing are not resolved: a smaller mesh_size helps",
                    all.num_regions() == 1 ? "the body" : fmt::format("\"{}\"", fmt::join(flat, "\", \""))));
  if (motion.cloud && built.size() > 1)
    result.warnings.emplace_back("bodies on a cloud meet walls only: they pass through each other");
  check_probes(motion, settings, result);
  check_times(motion, settings, result.otm.stable_step());
  return result;
}

template <int Dim> std::vector<std::pair<std::string, Vector>> point_scalars(const Otm<Dim>& otm) {
  const Index n = otm.num_points();
  const Tensors F = otm.deformation(), sigma = otm.cauchy_stress();
  Vector mises(n), pressure(n), J(n);
  for (Index p = 0; p < n; ++p) {
    const Voigt<3> stress = stress_of<3>(sigma.col(p));
    mises[p] = von_mises<3>(stress);
    pressure[p] = -stress.template head<3>().mean();
    J[p] = Eigen::Map<const Mat<3>>(F.col(p).data()).determinant();
  }
  std::vector<std::pair<std::string, Vector>> result{
      {"von_mises", mises}, {"pressure", pressure}, {"J", J}, {"damage", otm.damage()}};
  std::map<std::string, Vector> remembered;
  for (Index b = 0; b < otm.num_bodies(); ++b) {
    const Matrix history = otm.history(b);
    for (const HistoryPart& part : otm.material(b).history_parts())
      if (part.size == 1)
        remembered.try_emplace(part.name, Vector::Zero(n)).first->second.segment(otm.first_point(b), history.cols()) =
            history.row(part.offset);
  }
  for (auto& [name, values] : remembered) result.emplace_back(name, std::move(values));
  return result;
}

template <int Dim> std::vector<double> measure(const MotionProbe<Dim>& probe, const MovingBodies<Dim>& bodies,
                                               const std::vector<std::pair<std::string, Vector>>& scalars, Index node) {
  using Of = typename MotionProbe<Dim>::Of;
  const Otm<Dim>& otm = bodies.otm;
  const Points<Dim>& x = otm.nodes();
  if (probe.of == Of::node) {
    const Vec<Dim> u = x.col(node) - bodies.start.col(node), v = otm.velocities().col(node);
    std::vector<double> both(u.begin(), u.end());
    both.insert(both.end(), v.begin(), v.end());
    return both;
  }
  double least = std::numeric_limits<double>::infinity(), most = -least;
  const bool nodal = probe.field.empty();
  const Points<Dim> points = nodal ? Points<Dim>(Dim, 0) : otm.points();
  const auto field = std::ranges::find(scalars, probe.field, [](const auto& entry) { return entry.first; });
  for (std::size_t b = 0; b < bodies.names.size(); ++b) {
    if (!probe.region.empty() && probe.region != bodies.names[b]) continue;
    const Index begin = nodal ? otm.first_node(b) : otm.first_point(b);
    const Index end = nodal ? otm.first_node(b + 1) : otm.first_point(b + 1);
    for (Index k = begin; k < end; ++k) {
      const Vec<Dim> at = nodal ? x.col(k) : points.col(k);
      if (!probe.box.isEmpty() && !probe.box.contains(at)) continue;
      const double value = nodal ? probe.place(at) : field->second[k];
      least = std::min(least, value);
      most = std::max(most, value);
    }
  }
  if (least > most) return {std::numeric_limits<double>::quiet_NaN()};
  return {probe.of == Of::largest ? most : probe.of == Of::smallest ? least : most - least};
}

template <int Dim> std::vector<std::pair<std::string, std::vector<double>>> measure(const MotionSettings<Dim>& motion,
                                                                                    const MovingBodies<Dim>& bodies) {
  const bool asks = std::ranges::any_of(motion.probes, [](const auto& probe) { return !probe.field.empty(); });
  const auto scalars = asks ? point_scalars(bodies.otm) : std::vector<std::pair<std::string, Vector>>{};
  std::vector<std::pair<std::string, std::vector<double>>> result;
  for (std::size_t k = 0; k < motion.probes.size(); ++k)
    result.emplace_back(motion.probes[k].name, measure(motion.probes[k], bodies, scalars, bodies.nodes_of_probes[k]));
  return result;
}

template <int Dim> MotionEnd run_motion(MovingBodies<Dim>& bodies, const MotionSettings<Dim>& motion,
                                        const MotionWatcher& watcher, const Monitor& monitor) {
  using Clock = std::chrono::steady_clock;
  const auto began = Clock::now();
  const auto seconds = [&] { return std::chrono::duration<double>(Clock::now() - began).count(); };
  const auto call = [](const auto& of) {
    if (of) of();
  };
  Otm<Dim>& otm = bodies.otm;
  MotionEnd result;
  const Stage stage("motion", monitor);
  const double from = otm.time();
  if (otm.counts().steps == 0) {
    call(watcher.line);
    call(watcher.frame);
  }
  // Whether a step passes one of so many times up to the end.
  const auto passes = [&](double before, Index times) {
    const double interval = motion.end / static_cast<double>(times);
    return times > 0 && std::floor(before / interval) < std::floor(otm.time() / interval);
  };
  const double min_step = motion.min_step > 0.0 ? motion.min_step : 1e-3 * std::min(otm.stable_step(), motion.max_step);
  double next_checkpoint = motion.checkpoint, next_detail = 0.0;
  // Steps are shorter than stable ones where nodes, or tools, go fast for the spacing. One may be, for a start.
  constexpr Index short_steps_in_a_row = 100;
  Index short_steps = 0;
  const auto is_over = [&] { return motion.end - otm.time() <= 1e-12 * motion.end; };
  while (!is_over()) {
    if (monitor.cancelled && monitor.cancelled()) {
      if (otm.counts().steps > 0) call(watcher.checkpoint);
      throw Cancelled("motion");
    }
    const double before = otm.time(), left = motion.end - before, stable = otm.stable_step();
    if (stable < min_step && left > stable) {
      result.refusal = fmt::format(
          "at time {:.6g} steps are stable up to {:.3g} only, less than min_step = {:.3g}: something is crushed or has "
          "become too stiff",
          before, stable, min_step);
      break;
    }
    // The last two share what is left, so that no step is tiny.
    const double most = std::min(motion.max_step, left > stable && left < 2.0 * stable ? 0.5 * left : left);
    const double step = otm.step(most);
    short_steps = step < std::min(min_step, most) ? short_steps + 1 : 0;
    if (short_steps == short_steps_in_a_row) {
      result.refusal = fmt::format(
          "at time {:.6g} steps are {:.3g} long, less than min_step = {:.3g}: nodes are next to each other (a sliver "
          "of the mesh), or nodes or tools too fast for their spacing",
          otm.time(), step, min_step);
      break;
    }
    const bool last = is_over();
    const bool has_line = last || passes(before, motion.lines);
    if (has_line) call(watcher.line);
    if (last || passes(before, motion.frames)) call(watcher.frame);
    const double now = seconds();
    if (now >= next_detail || last) {
      next_detail = now + 0.1;
      const double done = otm.time() / motion.end;
      stage.tick(done);
      if (monitor.detail)
        monitor.detail(fmt::format("time {:.4g} of {:.4g}, step {} of {:.3g}, energy off by {:.2g} %, {:.0f} s to go",
                                   otm.time(), motion.end, otm.counts().steps, otm.stable_step(),
                                   100.0 * otm.energy().error(),
                                   now * (motion.end - otm.time()) / (otm.time() - from)));
    }
    if (last) {
      const double error = otm.energy().largest_error();
      if (const double bearable = std::min(refused_imbalance, motion.options.imbalance); !(std::abs(error) <= bearable))
        result.refusal = fmt::format(
            "the energy is off by {:.2g} %, more than {:.2g} %: smaller steps (otm.courant) or finer bodies may help",
            100.0 * error, 100.0 * bearable);
      break;
    }
    if (now >= motion.time_limit) {
      call(watcher.checkpoint);
      result.can_go_on = true;
      result.refusal = fmt::format("the time limit of {:.6g} s is over at time {:.6g} of {:.6g}; --resume goes on",
                                   motion.time_limit, otm.time(), motion.end);
      break;
    }
    if (now >= next_checkpoint) {
      call(watcher.checkpoint);
      next_checkpoint = seconds() + motion.checkpoint;
    }
  }
  result.seconds = seconds();
  return result;
}

template MovingBodies<2> set_in_motion(const PreparedMesh<2>&, const Settings<2>&, const MotionSettings<2>&,
                                       const Monitor&);
template std::vector<std::pair<std::string, Vector>> point_scalars(const Otm<2>&);
template std::vector<double> measure(const MotionProbe<2>&, const MovingBodies<2>&,
                                     const std::vector<std::pair<std::string, Vector>>&, Index);
template std::vector<std::pair<std::string, std::vector<double>>> measure(const MotionSettings<2>&,
                                                                          const MovingBodies<2>&);
template MotionEnd run_motion(MovingBodies<2>&, const MotionSettings<2>&, const MotionWatcher&, const Monitor&);
template MovingBodies<3> set_in_motion(const PreparedMesh<3>&, const Settings<3>&, const MotionSettings<3>&,
                                       const Monitor&);
template std::vector<std::pair<std::string, Vector>> point_scalars(const Otm<3>&);
template std::vector<double> measure(const MotionProbe<3>&, const MovingBodies<3>&,
                                     const std::vector<std::pair<std::string, Vector>>&, Index);
template std::vector<std::pair<std::string, std::vector<double>>> measure(const MotionSettings<3>&,
                                                                          const MovingBodies<3>&);
template MotionEnd run_motion(MovingBodies<3>&, const MotionSettings<3>&, const MotionWatcher&, const Monitor&);

}  // namespace efree
