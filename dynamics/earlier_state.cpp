// SPDX-License-Identifier: GPL-3.0-or-later
/// A start from the state of an earlier run.
#include "efree/dynamics/internal/earlier_state.hpp"

#include "efree/dynamics/internal/driver.hpp"
#include "efree/dynamics/internal/mass_scaling.hpp"
#include "efree/dynamics/internal/world.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace efree::internal {
namespace {

/// Relative difference up to which numbers are the same on another machine.
constexpr double same_number = 1e-9;

/// Coordinates and volumes summed with weights that change from column to column, so that an exchange shows.
template <class Columns> void add_weighted_sums(const Columns& values, std::vector<double>& sums) {
  for (Eigen::Index i = 0; i < values.rows(); ++i) {
    double sum = 0.0, size = 0.0;
    for (Eigen::Index k = 0; k < values.cols(); ++k) {
      sum += static_cast<double>(k % 97 + 1) * values(i, k);
      size += static_cast<double>(k % 97 + 1) * std::abs(values(i, k));
    }
    sums.insert(sums.end(), {sum, size});
  }
}

/// By point: sum of its shape functions, with weights that change from node to node.
template <int Dim> Eigen::RowVectorXd row_sums(const ShapeTable<Dim>& shape) {
  Eigen::RowVectorXd result = Eigen::RowVectorXd::Zero(shape.num_points());
  for (Index p = 0; p < shape.num_points(); ++p) {
    const ShapeRow<Dim> row = shape.row(p);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      result[p] += static_cast<double>(row.nodes[k] % 97 + 1) * row.N[k];
  }
  return result;
}

/// Stresses under a small and two large deformations: what flows flows in these.
std::vector<double> probe_material(const Material& material, const Vec<3>& X) {
  std::array<Mat<3>, 3> gradients;
  gradients[0] << 1.001, 4e-4, 0.0, -2e-4, 0.999, 3e-4, 1e-4, 0.0, 1.0005;
  gradients[1] << 1.2, 0.1, 0.0, 0.0, 0.9, 0.05, 0.0, 0.0, 0.95;
  gradients[2] << 0.97, 0.0, 0.02, 0.01, 0.98, 0.0, 0.0, -0.01, 0.96;
  std::vector<double> result;
  for (const Mat<3>& F : gradients) {
    Deformation deformation = Deformation::none(X, material.history_size());
    deformation.F.col(0) = F.reshaped();
    deformation.dt = 1.0;
    Vec<9> P = Vec<9>::Constant(std::numeric_limits<double>::quiet_NaN());
    try {
      P = respond(material, deformation, false).P.col(0);
    } catch (const NumericalError&) {  // it bears no such deformation, as the other one does not
    }
    result.insert(result.end(), P.begin(), P.end());
  }
  return result;
}

bool are_same(const std::vector<double>& one, const std::vector<double>& other) {
  if (one.size() != other.size()) return false;
  double largest = 0.0;
  for (const double number : one)
    if (std::isfinite(number)) largest = std::max(largest, std::abs(number));
  for (std::size_t k = 0; k < one.size(); ++k)
    if (std::isnan(one[k]) != std::isnan(other[k]) || std::abs(one[k] - other[k]) > same_number * largest) return false;
  return true;
}

}  // namespace

template <int Dim> StateIdentity identify(const std::vector<DeformableBody<Dim>>& bodies, const Scheme<Dim>& scheme,
                                          const DynamicsOptions& options) {
  StateIdentity result{.scheme = scheme.name(),
                       .options = scheme.identity(),
                       .plane = Dim == 2 ? static_cast<int>(options.plane) : 0,
                       .bodies = {},
                       .mass_factor = options.mass_scaling.factor,
                       .scaled_step = options.mass_scaling.step};
  for (const DeformableBody<Dim>& body : bodies) {
    BodyIdentity& of = result.bodies.emplace_back();
    of.nodes = static_cast<Index>(body.nodes.cols());
    of.points = static_cast<Index>(body.points.cols());
    add_weighted_sums(body.nodes, of.places);
    add_weighted_sums(body.points, of.places);
    add_weighted_sums(body.volumes.transpose(), of.places);
    add_weighted_sums(Eigen::Map<const Eigen::RowVector<Index, Eigen::Dynamic>>(
                          body.patches.data(), static_cast<Eigen::Index>(body.patches.size()))
                          .template cast<double>(),
                      of.places);
    if (body.shape) add_weighted_sums(row_sums(*body.shape), of.places);
    Vec<3> X = Vec<3>::Zero();
    if (of.points > 0) X.template head<Dim>() = body.points.col(0);
    of.response = probe_material(*body.material, X);
    Vector densities = body.densities;
    if (densities.size() == 0) densities.setConstant(of.points, body.density);
    add_weighted_sums(densities.transpose(), of.densities);
  }
  return result;
}

void require_same(const StateIdentity& here, const StateIdentity& there, const std::vector<std::string>& names) {
  const auto fail = [](const std::string& what) { throw InputError(what); };
  if (here.scheme != there.scheme)
    fail(fmt::format("the earlier run has the method \"{}\", and this one \"{}\": expected the same", there.scheme,
                     here.scheme));
  if (!are_same(here.options, there.options))
    fail(fmt::format("the earlier run had other options of the method \"{}\": expected the same{}", here.scheme,
                     here.scheme == "mpm"   ? " cell, degree, transfer, order, remap and contact.tie"
                     : here.scheme == "sph" ? " spacing, smoothing, kernel, corrected and splitting"
                                            : ""));
  if (here.plane != there.plane)
    fail("one run is of plane strain and the other one of an axisymmetric section: expected the same");
  if (here.bodies.size() != there.bodies.size())
    fail(fmt::format("the earlier run has {} bodies, and this one {}: expected the same bodies", there.bodies.size(),
                     here.bodies.size()));
  for (std::size_t b = 0; b < here.bodies.size(); ++b) {
    const BodyIdentity &one = here.bodies[b], &other = there.bodies[b];
    const std::string body = b < names.size() && !names[b].empty() ? fmt::format("body \"{}\"", names[b])
                             : here.bodies.size() == 1             ? std::string("the body")
                                                                   : fmt::format("body {}", b);
    if (one.nodes != other.nodes || one.points != other.points)
      fail(
          fmt::format("{} had {} nodes and {} material points at the start of the earlier run, and has {} and {} in "
                      "this one: expected the same geometry and mesh, or cloud",
                      body, other.nodes, other.points, one.nodes, one.points));
    if (!are_same(one.places, other.places))
      fail(
          fmt::format("{} had other places of nodes or points, shape functions or pressure patches at the start of the "
                      "earlier run: expected the same geometry, mesh or cloud, and quadrature; on a cloud functions "
                      "depend on which parts have a [[boundary]], so keep these",
                      body));
    if (!are_same(one.response, other.response) || !are_same(one.densities, other.densities))
      fail(fmt::format("{} was of another material in the earlier run: expected the same", body));
  }
}

template <int Dim>
void Driver<Dim>::begin_from(std::string_view state, bool velocities, const std::vector<std::string>& names) {
  constexpr std::size_t of_bodies = 3;  // interactions that every run has: gravity, supports, contact of bodies
  Unpacker unpacker(state);
  Archive archive(unpacker);
  StateIdentity of;
  archive(of);
  require_same(identity, of, names);
  Ledger none;
  for (const auto& energy : world.ledger.energies()) none.add_energy(energy.name, energy.kind, 0.0);
  for (const auto& count : world.ledger.counts()) none.add_count(count.name, 0);
  std::vector<std::pair<std::vector<Index>, Vector>> crack_radii;  // of this run's fracture criteria
  for (const auto& chunk : world.chunks) crack_radii.emplace_back(chunk.number, chunk.matter.crack_radius);
  unpack_world(world, watch, archive);
  inertia.pack(archive);
  archive(resting, start_shares);
  resting.clear();
  stable.pack(archive);
  scheme->pack(archive);
  for (std::size_t k = 0; k < of_bodies; ++k) world.interactions[k]->pack(archive);
  world.gravity.setZero();
  world.ledger = none;
  world.contacts = {};
  world.time = 0.0;
  world.steps_of_earlier_run = world.steps;
  world.new_supports = !world.prescribed.empty();
  world.prescribed.clear();
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    Chunk<Dim>& chunk = world.chunks[c];
    chunk.dissipated = chunk.viscous = chunk.lost = 0.0;
    chunk.seconds = {};
    if (c < crack_radii.size() && crack_radii[c].first == chunk.number)
      chunk.matter.crack_radius = crack_radii[c].second;
    complete_storage(world, chunk);
  }
  world.find_node_chunks();
  world.find_free_axes();
  ++world.point_changes;
  scheme->resume(world);
  use_large_pages(world);
  if (!velocities) {
    for (Points<Dim>* values : {&world.nodes.v, &world.nodes.momentum}) values->setZero();
    world.last_step = 0.0;
    scheme->stop(world);
  }
  world.nodes.v_before = world.nodes.v;
  change_mass_scaling(world, *scheme, stable, {of.mass_factor, of.scaled_step});
  assemble_internal_forces(world, *scheme, false);
  gravity->set_field(world, {});
  lacks_walls = true;
  begin_watch();
}

template StateIdentity identify(const std::vector<DeformableBody<2>>&, const Scheme<2>&, const DynamicsOptions&);
template StateIdentity identify(const std::vector<DeformableBody<3>>&, const Scheme<3>&, const DynamicsOptions&);
template void Driver<2>::begin_from(std::string_view, bool, const std::vector<std::string>&);
template void Driver<3>::begin_from(std::string_view, bool, const std::vector<std::string>&);

}  // namespace efree::internal
