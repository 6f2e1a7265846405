// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/dynamics_checks.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"
#include "efree/materials/equation_of_state.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree::internal {
namespace {

/// Depth over the spacing up to which bodies may be inside each other at the start: chords of a curve on both sides.
constexpr double allowed_overlap = 0.05;
/// The same of rigid bodies with each other and with walls, over their size: rounding.
constexpr double allowed_rigid_overlap = 1e-4;
/// Speeds of solids over that of pressure waves that are more likely due to mixed units.
constexpr double plausible_speed = 10.0;

}  // namespace

template <int Dim> void check_gaps(const DynamicsSettings<Dim>& settings, const Points<Dim>& vertices, double allowed) {
  const auto check = [&](const RigidShape<Dim>& shape, const char* name, const std::string& where) {
    Index deepest = 0;
    double smallest = std::numeric_limits<double>::infinity();
    for (Index a = 0; a < static_cast<Index>(vertices.cols()); ++a)
      if (const double gap = shape(vertices.col(a)).gap; gap < smallest) {
        smallest = gap;
        deepest = a;
      }
    if (smallest < -allowed)
      throw InputError(said_at(where, fmt::format("bodies reach {} by {:.4g} at the start, at ({:.6g})", name,
                                                  -smallest, fmt::join(vertices.col(deepest), ", "))));
  };
  for (const auto& [wall, where] : settings.walls)
    check(rigid_shapes::half_space<Dim>(wall.normal, wall.level), "through the wall", where);
  for (const auto& [body, where] : settings.rigid_bodies) check(body.shape, "into the rigid body", where);
}

template <int Dim> void check_rigid_bodies(const DynamicsSettings<Dim>& settings) {
  const auto check = [](const auto& one, const RigidShape<Dim>& shape, const char* name) {
    const RigidBody<Dim>& body = one.body;
    if (body.corners.cols() == 0) return;
    const double size = body.round + (body.corners.rowwise().maxCoeff() - body.corners.rowwise().minCoeff()).norm();
    for (const Vec<Dim> at : body.corners.colwise())
      if (const double gap = shape(at).gap - body.round; gap < -allowed_rigid_overlap * size)
        throw InputError(said_at(
            one.where, fmt::format("the rigid body reaches {} by {:.4g} at the start, at ({:.6g}): contact would throw "
                                   "them apart. Move them apart",
                                   name, -gap, fmt::join(at, ", "))));
  };
  const auto& all = settings.rigid_bodies;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].body.is_free())
      for (const auto& [wall, where] : settings.walls)
        check(all[i], rigid_shapes::half_space<Dim>(wall.normal, wall.level), "through a wall");
    for (std::size_t j = 0; j < all.size(); ++j)
      if (i != j && (all[i].body.is_free() || all[j].body.is_free()))
        check(all[i], all[j].body.shape, "into another one");
  }
}

template <int Dim> void check_overlaps(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const World<Dim>& world = dynamics.world();
  const auto fail = [&](Index body, const std::string& where, const std::string& instead) {
    throw InputError(said_at(
        where_said(settings.common, "geometry"),
        fmt::format("bodies overlap at the start: region \"{}\" is inside {}. Move them apart, {}or let bodies pass "
                    "through each other by contact.enabled = false",
                    model.names[body], where, instead)));
  };
  if (const std::vector<Index> inside = dynamics.points_in_others(); !inside.empty())
    fail(world.locate(inside.front()).first.body,
         fmt::format("another one at ({:.6g})", fmt::join(dynamics.points().col(inside.front()), ", ")), "");
  const Overlap overlap = dynamics.deepest_overlap();
  if (overlap.node < 0 || overlap.depth < allowed_overlap * world.nodes.spacing[overlap.node]) return;
  fail(world.nodes.body[overlap.node],
       fmt::format("region \"{}\" by {:.3g} at ({:.6g})", model.names[overlap.body], overlap.depth,
                   fmt::join(dynamics.nodes().col(overlap.node), ", ")),
       fmt::format("close overlaps by contact.close = {:.2g}, ", 1.1 * overlap.depth));
}

template <int Dim> std::vector<std::string> warnings_of_speeds(const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const World<Dim>& world = dynamics.world();
  const std::vector<BodyMass> masses = dynamics.body_masses();
  std::vector<double> volume(dynamics.num_bodies());
  for (const auto& chunk : world.chunks) volume[chunk.body] += chunk.matter.volume.sum();
  std::vector<std::string> result;
  double rigid = 0.0;
  for (const RigidState<Dim>& body : dynamics.rigid_bodies()) rigid = std::max(rigid, body.velocity.norm());
  const bool by_nodes = dynamics.nodes_persist();
  const Points<Dim> velocities = by_nodes ? dynamics.velocities() : dynamics.point_velocities();
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    if (dynamic_cast<const Fluid*>(&dynamics.material(b)) != nullptr) continue;
    const Index first = by_nodes ? dynamics.first_node(b) : dynamics.first_point(b),
                end = by_nodes ? dynamics.first_node(b + 1) : dynamics.first_point(b + 1);
    const double own = std::sqrt(velocities.middleCols(first, end - first).colwise().squaredNorm().maxCoeff());
    const double waves = std::sqrt(world.bodies[b].modulus * volume[b] / masses[b].real), speed = std::max(own, rigid);
    if (!(speed > plausible_speed * waves)) continue;
    const std::string& name = model.names[b];
    const bool is_own = own >= rigid;
    result.push_back(
        fmt::format("{} starts at a speed of {:.3g}, {:.3g} times that of pressure waves in {}, {:.3g}: are units "
                    "mixed? A stress is "
                    "a density times a length squared over a time squared: m, kg, s and Pa, or mm, t, s and MPa",
                    is_own ? fmt::format("Region \"{}\"", name) : "A rigid body", speed, speed / waves,
                    is_own ? "it" : fmt::format("region \"{}\"", name), waves));
  }
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                           \
  template void check_gaps(const DynamicsSettings<Dim>&, const Points<Dim>&, double);    \
  template void check_rigid_bodies(const DynamicsSettings<Dim>&);                        \
  template void check_overlaps(const DynamicsSettings<Dim>&, const DynamicsModel<Dim>&); \
  template std::vector<std::string> warnings_of_speeds(const DynamicsModel<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
