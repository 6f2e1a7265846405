// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"

#include "efree/dynamics/internal/power_iteration.hpp"
#include "efree/dynamics/masses.hpp"

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <limits>

namespace efree {
namespace {

/// Masses of nodes, over their mean, that are raised to this.
constexpr double least_mass = 0.35;
/// Gap below which points of a surface are near a rigid body, over the smallest spacing of nodes.
constexpr double skin = 0.1;

template <int Dim> class TotalLagrangian final : public Scheme<Dim> {
 public:
  std::string name() const override { return "total_lagrangian"; }
  void begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) override;
  void find_masses(World<Dim>& world) override;
};

template <int Dim> void require_body(const DeformableBody<Dim>& body, std::size_t b, bool axisymmetric) {
  const auto fail = [&](const std::string& what) { throw InputError(fmt::format("body {}: {}", b, what)); };
  const auto N = static_cast<Index>(body.nodes.cols()), M = static_cast<Index>(body.points.cols());
  if (N == 0 || M == 0) fail("expected nodes and points");
  if (!body.shape) fail("the total Lagrangian scheme keeps given shape functions, and it has none");
  if (body.shape->num_points() != M || body.shape->num_nodes() != N || !body.shape->has_gradients() ||
      body.shape->has_hoop() != axisymmetric)
    fail(fmt::format("shape functions of {} points and {} nodes, expected {} and {}, with gradients{}",
                     body.shape->num_points(), body.shape->num_nodes(), M, N,
                     axisymmetric ? " and values over the radius" : ""));
  if (body.mass_terms > 1 && (!body.surface || body.cells.size() != 0))
    fail("more than one term of the mass: expected points of a surface, and no cells");
  if (body.mass_terms < 1 || body.mass_terms > 8)
    fail(fmt::format("{} terms of the mass, expected 1 to 8", body.mass_terms));
  if (body.surface && body.surface->num_nodes() != N)
    fail(fmt::format("shape functions of {} nodes on the surface, expected {}", body.surface->num_nodes(), N));
}

template <int Dim> void put_table(World<Dim>& world, Chunk<Dim>& chunk, const ShapeTable<Dim>& shape) {
  std::vector<TableRow> rows(chunk.size());
  for (Index p = 0; p < chunk.size(); ++p) {
    const ShapeRow<Dim> row = shape.row(chunk.number[p]);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      rows[p].push_back({world.first_node[chunk.body] + row.nodes[k],
                         table_entry<Dim>(row.N[k], row.dN[k], world.axisymmetric() ? row.hoop[k] : 0.0)});
    complete_row<Dim>(rows[p].size(), [&](std::size_t k) -> TableEntry& { return rows[p][k].second; });
  }
  world.put_rows(chunk, rows);
}

/// Nodes that are much lighter than others make steps short: they get mass of their neighbours, such that the mass of
/// all and its centre stay where they are.
template <int Dim> void raise_light_masses(World<Dim>& world, Index body) {
  const SparseRows& coupling = world.consistent_mass.coupling;
  Vector& mass = world.nodes.mass;
  const auto nodes = world.nodes_of(body);
  const double least = least_mass * mass.segment(nodes.front(), std::ssize(nodes)).mean();
  for (const Index a : nodes) {
    if (mass[a] >= least) continue;
    Mat<Dim + 1> moment = Mat<Dim + 1>::Zero();
    const auto basis = [&](Index b) {
      Vec<Dim + 1> result;
      result << 1.0, (world.nodes.x.col(b) - world.nodes.x.col(a)) / world.nodes.spacing[a];
      return result;
    };
    std::vector<Index> around;
    for (SparseRows::InnerIterator entry(coupling, a); entry; ++entry)
      if (entry.value() > 0.0 && mass[entry.col()] > 2.0 * least) {
        around.push_back(entry.col());
        moment += basis(entry.col()) * basis(entry.col()).transpose();
      }
    const Vec<Dim + 1> by = moment.ldlt().solve(Vec<Dim + 1>::Unit(0));
    if (!((moment * by - Vec<Dim + 1>::Unit(0)).norm() < 1e-9)) continue;
    const auto left = [&](Index b) { return mass[b] - (least - mass[a]) * by.dot(basis(b)); };
    if (!std::ranges::all_of(around, [&](Index b) { return left(b) > least; })) continue;
    for (const Index b : around) mass[b] = left(b);
    mass[a] = least;
  }
}

/// The largest eigenvalue of D^-1 M of a body, from below.
template <int Dim> double largest_share(const World<Dim>& world, Index body) {
  constexpr int products = 30;
  const SparseRows& coupling = world.consistent_mass.coupling;
  Points<Dim> mode = Points<Dim>::Zero(Dim, world.nodes.size());
  const auto nodes = world.nodes_of(body);
  for (const Index a : nodes) mode.col(a).setConstant(a % 2 == 0 ? 1.0 : -1.0 + 0.1 * (a % 7));
  return internal::power_iteration<Dim>(
      world.nodes.mass, products,
      [&](const Points<Dim>& of, Points<Dim>& result) {
        result.setZero();
        for (const Index a : nodes) result.col(a) = row_times<Dim>(coupling, a, of);
      },
      mode);
}

/// An even number of terms has no inverse mass where D^-1 M has eigenvalues of 2, and a negative one beyond, as shape
/// functions may that are negative somewhere: such modes would grow without end. Three terms are positive at any.
template <int Dim> void keep_masses_positive(World<Dim>& world, Index body) {
  constexpr double near_two = 1.9;
  Index& terms = world.consistent_mass.terms[body];
  if (terms % 2 == 0 && largest_share(world, body) > near_two) terms = 3;
}

/// M between nodes of bodies with more than one term.
template <int Dim> void find_consistent_masses(World<Dim>& world) {
  std::vector<Eigen::Triplet<double, Index>> entries;  // N times the root of the point's mass
  for (const auto& chunk : world.chunks) {
    if (world.consistent_mass.terms[chunk.body] == 1) continue;
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p))
        entries.emplace_back(world.point_number(chunk, p), a, std::sqrt(chunk.matter.mass[p]) * entry.N);
  }
  SparseRows values(world.num_points(), world.nodes.size());
  values.setFromTriplets(entries.begin(), entries.end());
  const SparseRows by_node = values.transpose();
  world.consistent_mass.coupling = by_node * values;
  for (Index b = 0; b < world.num_bodies(); ++b)
    if (world.consistent_mass.terms[b] > 1) {
      raise_light_masses(world, b);
      keep_masses_positive(world, b);
    }
}

template <int Dim> void find_surface_points(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) {
  SurfacePoints& surface = world.surface_points;
  std::vector<Eigen::Triplet<double, Index>> entries;
  Index count = 0;
  surface.skin = std::numeric_limits<double>::infinity();
  surface.bodies.assign(bodies.size(), 0);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!bodies[b].surface) continue;
    surface.bodies[b] = 1;
    for (Index s = 0; s < bodies[b].surface->num_points(); ++s, ++count) {
      const ShapeRow<Dim> row = bodies[b].surface->row(s);
      double sum = 0.0;
      for (std::size_t k = 0; k < row.nodes.size(); ++k) {
        entries.emplace_back(count, world.first_node[b] + row.nodes[k], row.N[k]);
        sum += std::abs(row.N[k]);
      }
      surface.reach = std::max(surface.reach, sum);
    }
    for (const Index a : world.nodes_of(static_cast<Index>(b)))
      surface.skin = std::min(surface.skin, skin * world.nodes.spacing[a]);
  }
  surface.shape.resize(count, world.nodes.size());
  surface.shape.setFromTriplets(entries.begin(), entries.end());
}

template <int Dim> void TotalLagrangian<Dim>::begin(World<Dim>& world, std::span<const DeformableBody<Dim>> bodies) {
  bool has_surfaces = false, consistent = false;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    require_body(bodies[b], b, world.axisymmetric());
    has_surfaces = has_surfaces || bodies[b].surface;
    consistent = consistent || bodies[b].mass_terms > 1;
  }
  for (Chunk<Dim>& chunk : world.chunks) put_table(world, chunk, *bodies[chunk.body].shape);
  if (has_surfaces) find_surface_points(world, bodies);
  if (consistent || has_surfaces)
    for (const auto& body : bodies) world.consistent_mass.terms.push_back(body.mass_terms);
  find_masses(world);
}

template <int Dim> void TotalLagrangian<Dim>::find_masses(World<Dim>& world) {
  sum_lumped_masses(world);
  if (!world.consistent_mass.terms.empty()) find_consistent_masses(world);
  require_masses(world);
}

}  // namespace

template <int Dim> std::unique_ptr<Scheme<Dim>> total_lagrangian() {
  return std::make_unique<TotalLagrangian<Dim>>();
}

template std::unique_ptr<Scheme<2>> total_lagrangian<2>();
template std::unique_ptr<Scheme<3>> total_lagrangian<3>();

}  // namespace efree
