// SPDX-License-Identifier: GPL-3.0-or-later
/// What acts on the bodies of a run of explicit dynamics.
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/region_body.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/contact/internal/facet.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>

namespace efree::internal {
namespace {

/// A part of the boundary, of all bodies.
template <int Dim> SurfacePart<Dim> join_surfaces(const std::vector<RegionBody<Dim>>& regions, const std::string& part,
                                                  const Dynamics<Dim>& dynamics) {
  SurfacePart<Dim> result{.facets = Facets<Dim>(Dim, 0)};
  std::vector<Eigen::Triplet<double, Index>> entries, of_places;
  const auto append = [&](const SparseRows& rows, Index first_vertex, Index first_node, auto& to) {
    for (Index k = 0; k < rows.rows(); ++k)
      for (SparseRows::InnerIterator entry(rows, k); entry; ++entry)
        to.emplace_back(first_vertex + k, first_node + entry.col(), entry.value());
  };
  Index vertices = 0;
  for (std::size_t b = 0; b < regions.size(); ++b) {
    const auto found = regions[b].surfaces.find(part);
    if (found != regions[b].surfaces.end()) {
      const auto& [facets, functions, positions, places, bodies] = found->second;
      const Eigen::Index before = result.facets.cols();
      result.facets.conservativeResize(Eigen::NoChange, before + facets.cols());
      result.facets.rightCols(facets.cols()) = facets.array() + vertices;
      append(functions, vertices, dynamics.first_node(static_cast<Index>(b)), entries);
      append(places, vertices, dynamics.first_node(static_cast<Index>(b)), of_places);
      result.positions.conservativeResize(Dim, result.positions.cols() + positions.cols());
      result.positions.rightCols(positions.cols()) = positions;
      result.bodies.insert(result.bodies.end(), bodies.size(), static_cast<Index>(b));
      vertices += static_cast<Index>(std::max(functions.rows(), positions.cols()));
    }
  }
  result.functions.resize(vertices, dynamics.num_nodes());
  result.functions.setFromTriplets(entries.begin(), entries.end());
  if (of_places.empty()) return result;
  result.places.resize(vertices, dynamics.num_nodes());
  result.places.setFromTriplets(of_places.begin(), of_places.end());
  return result;
}

template <int Dim> double area_of_surface(const SurfacePart<Dim>& part, const Dynamics<Dim>& dynamics) {
  const Points<Dim> at = part.positions.cols() > 0
                             ? part.positions
                             : Points<Dim>((part.functions * dynamics.nodes().transpose()).transpose());
  double area = 0.0;
  for (Index f = 0; f < part.facets.cols(); ++f) {
    const Mat<Dim> corners = facet_corners(at, part.facets, f);
    area += area_of<Dim>(corners).norm() * dynamics.world().out_of_plane(corners.row(0).mean());
  }
  return area;
}

template <int Dim> void add_boundary_loads(const DynamicsSettings<Dim>& settings,
                                           const std::vector<RegionBody<Dim>>& regions, DynamicsModel<Dim>& model) {
  for (const auto& [on, load, force, where] : settings.boundary_loads) {
    if (settings.method == DynamicsMethod::sph && settings.sph.options.splitting.strain > 0.0)
      throw InputError(said_at(where, "loads on a boundary are not for particles that split: leave out sph.splitting"));
    SurfaceLoad<Dim> added = load;
    added.part = join_surfaces(regions, on, model.dynamics);
    if (force) {
      if (is_axisymmetric(settings) && force(0.0)[0] != 0.0)
        throw InputError(
            said_at(where, "around an axis of revolution radial forces have no resultant: expected [0, F]"));
      const double area = area_of_surface(added.part, model.dynamics);
      added.traction = [force = force, area](const Vec<Dim>&, double t) { return Vec<Dim>(force(t) / area); };
    }
    located(settings.common, where, [&] { model.dynamics.add_interaction(surface_load<Dim>(std::move(added))); });
  }
}

template <int Dim> void add_cavities(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                     DynamicsModel<Dim>& model) {
  for (const auto& gas : settings.gases) {
    if (settings.method != DynamicsMethod::otm)
      throw InputError(
          said_at(gas.where,
                  "a gas needs nodes at the vertices of the mesh: leave out [cloud], [mpm] and [sph], and take "
                  "dynamics.method = \"otm\""));
    const SurfacePart<Dim> part = join_surfaces(regions, gas.on, model.dynamics);
    GasCavity<Dim> cavity{.facets = part.facets, .pressure = gas.pressure, .exponent = gas.exponent};
    for (Index& corner : cavity.facets.reshaped())
      corner = static_cast<Index>(SparseRows::InnerIterator(part.functions, corner).col());
    located(settings.common, gas.where, [&] { model.dynamics.add_cavity(cavity); });
  }
}

/// Nodes, or points, whose velocity along an axis is prescribed, by the part of the boundary that says it: the last one
/// that has them.
template <int Dim, class Numbers>
std::map<Index, std::vector<Index>> find_prescribed(const DynamicsSettings<Dim>& settings,
                                                    const std::vector<RegionBody<Dim>>& regions, int axis,
                                                    const Numbers& of) {
  std::map<Index, Index> part_of;
  for (std::size_t k = 0; k < settings.boundary_velocities.size(); ++k) {
    const auto& part = settings.boundary_velocities[k];
    for (std::size_t b = 0; b < regions.size() && part.velocity[axis]; ++b)
      for (const Index number : of(static_cast<Index>(b), part.on)) part_of[number] = static_cast<Index>(k);
  }
  std::map<Index, std::vector<Index>> result;
  for (const auto& [number, part] : part_of) result[part].push_back(number);
  return result;
}

/// Of prescribed displacements at the start.
template <int Dim> void require_no_jump(const BoundaryVelocity<Dim>& part, int axis, const Points<Dim>& at) {
  for (Eigen::Index k = 0; part.is_displacement && k < at.cols(); ++k)
    if (const double jump = part.velocity[axis](at.col(k), 0.0); jump != 0.0)
      throw InputError(said_at(part.where, fmt::format("the displacement along {} at ({:.6g}) is {:.3g} at the start, "
                                                       "expected 0: take a ramp, such as ramp = [[0, 0], [1e-3, 1]]",
                                                       "xyz"[axis], fmt::join(at.col(k), ", "), jump)));
}

/// Velocities on parts of the boundary, of nodes or of the points near them; nodes on the axis of a section stay there.
template <int Dim> void prescribe_velocities(const DynamicsSettings<Dim>& settings,
                                             const std::vector<RegionBody<Dim>>& regions, DynamicsModel<Dim>& model) {
  Dynamics<Dim>& dynamics = model.dynamics;
  const auto numbers = [&](const auto& by_part, const std::string& part, Index first) {
    std::vector<Index> result;
    if (const auto found = by_part.find(part); found != by_part.end())
      for (const Index number : found->second) result.push_back(first + number);
    return result;
  };
  const auto nodes_on = [&](Index b, const std::string& part) {
    return numbers(regions[b].nodes_on, part, dynamics.first_node(b));
  };
  const auto points_on = [&](Index b, const std::string& part) {
    return numbers(regions[b].points_on, part, dynamics.first_point(b));
  };
  const Points<Dim> nodes = dynamics.nodes(), points = dynamics.points();
  const double radius = is_axisymmetric(settings) ? nodes.row(0).maxCoeff() : 0.0;
  const auto is_on_axis = [&](Index a) { return is_axisymmetric(settings) && nodes(0, a) < 1e-9 * radius; };
  for (Index a = 0; a < nodes.cols(); ++a)
    if (is_on_axis(a)) dynamics.prescribe(a, 0, 0.0);
  for (int i = 0; i < Dim; ++i) {
    auto by_part = find_prescribed(settings, regions, i, nodes_on);
    for (auto& [k, these] : by_part) {
      const BoundaryVelocity<Dim>& part = settings.boundary_velocities[k];
      if (i == 0) std::erase_if(these, is_on_axis);
      require_no_jump<Dim>(part, i, nodes(Eigen::all, these));
      if (part.depends_on_time) {
        dynamics.prescribe(these, i, part.velocity[i], part.is_displacement);
        continue;
      }
      for (const Index a : these) dynamics.prescribe(a, i, part.velocity[i](nodes.col(a), 0.0));
    }
    for (const auto& [k, these] : find_prescribed(settings, regions, i, points_on)) {
      const BoundaryVelocity<Dim>& part = settings.boundary_velocities[k];
      require_no_jump<Dim>(part, i, points(Eigen::all, these));
      if (part.depends_on_time) {
        dynamics.prescribe_points(these, i, part.velocity[i], part.is_displacement);
        continue;
      }
      Vector values(std::ssize(these));
      for (Index p = 0; p < values.size(); ++p) values[p] = part.velocity[i](points.col(these[p]), 0.0);
      dynamics.prescribe_points(these, i, values);
    }
  }
}

}  // namespace

template <int Dim> void add_loads(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                  DynamicsModel<Dim>& model) {
  for (const auto& [wall, where] : settings.walls)
    located(settings.common, where, [&, &added = wall] { model.dynamics.add_wall(added); });
  for (const auto& [body, where] : settings.rigid_bodies)
    located(settings.common, where, [&, &added = body] { model.dynamics.add_rigid_body(added); });
  located(settings.common, where_said(settings.common, "analysis.gravity"), [&] {
    if (settings.gravity_field)
      model.dynamics.set_gravity_field(settings.gravity_field);
    else if (settings.gravity_depends_on_time)
      model.dynamics.set_gravity_law(settings.gravity);
    else if (settings.gravity)
      model.dynamics.set_gravity(settings.gravity(0.0));
  });
  add_boundary_loads(settings, regions, model);
  add_cavities(settings, regions, model);
  prescribe_velocities(settings, regions, model);
}

template void add_loads(const DynamicsSettings<2>&, const std::vector<RegionBody<2>>&, DynamicsModel<2>&);
template void add_loads(const DynamicsSettings<3>&, const std::vector<RegionBody<3>>&, DynamicsModel<3>&);

}  // namespace efree::internal
