// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/grid_functions.hpp"

#include "efree/dynamics/internal/surface_functions.hpp"
#include "efree/dynamics/schemes/mpm/internal/spline.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/geometry/mesh/internal/facet_samples.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

namespace efree::internal {
namespace {

/// Mass of a node, over the largest around a position, from which on its weight is the spline. Splines are in balance
/// with uniform stresses at the points; nodes with hardly any mass would run ahead of the points under a load.
constexpr double enough_mass = 0.02;

/// Reduces the weights of nodes that have less.
template <int Dim> void reduce_light(const std::vector<double>& masses, std::vector<WeightedNode<Dim>>& nodes) {
  if (masses.empty()) return;
  const double enough = enough_mass * *std::ranges::max_element(masses);
  for (std::size_t k = 0; k < nodes.size(); ++k) nodes[k].weight *= std::min(1.0, masses[k] / enough);
}

/// Calls visit(site, N) for all nodes of the grid with splines at a position.
template <int Dim, class Visit>
void for_each_spline(const Vec<Dim>& at, int degree, double cell, const Vec<Dim>& origin, const Visit& visit) {
  GridBox all{.dim = Dim, .degree = degree, .cell = cell};
  for (int i = 0; i < Dim; ++i) all.low[i] = origin[i];
  for_each_site<Dim>(all, at.data(), [&](const auto& place, double N, const Vec<Dim>&) {
    Site<Dim> site;
    for (int i = 0; i < Dim; ++i) site[i] = static_cast<Index>(place[static_cast<std::size_t>(i)]);
    if (N > 0.0) visit(site, N);
  });
}

/// A node of the grid; -1: there is none.
template <int Dim> struct GridNode {
  Index node = -1;
  Vec<Dim> position = Vec<Dim>::Zero();
  double mass = 0.0;
};

/// Appends the functions at a position, of the nodes that find(site) returns, with the weights of light ones reduced
/// if asked for.
template <int Dim, class Find> void append_functions(const Vec<Dim>& at, int degree, double cell,
                                                     const Vec<Dim>& origin, bool reduces_light, const Find& find,
                                                     Index number, SparseRows& rows) {
  std::vector<WeightedNode<Dim>> nodes;
  std::vector<double> masses;
  for_each_spline<Dim>(at, degree, cell, origin, [&](const Site<Dim>& site, double N) {
    const GridNode<Dim> found = find(site);
    if (found.node < 0) return;
    nodes.push_back({found.node, (found.position - at) / cell, N});
    masses.push_back(found.mass);
  });
  if (reduces_light) reduce_light(masses, nodes);
  append_row(moving_least_squares(nodes), number, rows);
}

}  // namespace

template <int Dim> SparseRows functions_on_grid(const World<Dim>& world, const PointGrid<Dim>& grid,
                                                const std::vector<char>& is_mesh, const Points<Dim>& at,
                                                const std::vector<Index>& bodies) {
  SparseRows result(static_cast<Index>(at.cols()), world.nodes.size());
  for (Index k = 0; k < at.cols(); ++k) {
    const auto find = [&](const Site<Dim>& site) -> GridNode<Dim> {
      const Index node = grid.of_body(bodies[k]).find(site);
      if (node < 0 || !(world.nodes.mass[node] > 0.0)) return {};
      return {node, world.nodes.x.col(node), world.nodes.mass[node]};
    };
    append_functions<Dim>(at.col(k), grid.degree(), grid.cell(), grid.position(Site<Dim>::Zero()),
                          is_mesh[bodies[k]] == 0, find, k, result);
  }
  result.finalize();
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                                              \
  template SparseRows functions_on_grid(const World<Dim>&, const PointGrid<Dim>&, const std::vector<char>&, \
                                        const Points<Dim>&, const std::vector<Index>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal

namespace efree {

template <int Dim> SurfacePart<Dim> surface_on_lattice(const FineMesh<Dim>& mesh, const std::vector<Index>& facets,
                                                       MpmFrame frame, const MpmOptions& options,
                                                       const DeformableBody<Dim>& body) {
  const double size = frame == MpmFrame::mesh ? std::numeric_limits<double>::infinity() : 0.5 * options.cell;
  auto cut = internal::cut_facets(mesh, facets, size);
  SurfacePart<Dim> part{.facets = std::move(cut.facets), .positions = std::move(cut.vertices)};
  const auto count = static_cast<Index>(part.positions.cols());
  if (frame != MpmFrame::total) {
    part.bodies.assign(static_cast<std::size_t>(count), 0);
    return part;
  }
  Vector mass = Vector::Zero(body.nodes.cols());
  for (Index p = 0; p < body.points.cols(); ++p) {
    const ShapeRow<Dim> row = body.shape->row(p);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) mass[row.nodes[k]] += row.N[k] * body.volumes[p];
  }
  Vec<Dim> origin;
  for (int i = 0; i < Dim; ++i) origin[i] = options.origin[static_cast<std::size_t>(i)];
  std::map<std::array<Index, Dim>, Index> node_at;
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    std::array<Index, Dim> site;
    for (int i = 0; i < Dim; ++i)
      site[i] = static_cast<Index>(std::lround((body.nodes(i, a) - origin[i]) / options.cell));
    node_at[site] = a;
  }
  part.functions.resize(count, static_cast<Index>(body.nodes.cols()));
  const auto find = [&](const internal::Site<Dim>& site) -> internal::GridNode<Dim> {
    std::array<Index, Dim> key;
    std::ranges::copy(site, key.begin());
    const auto found = node_at.find(key);
    if (found == node_at.end()) return {};
    return {found->second, body.nodes.col(found->second), mass[found->second]};
  };
  for (Index k = 0; k < count; ++k)
    internal::append_functions<Dim>(part.positions.col(k), options.degree, options.cell, origin, true, find, k,
                                    part.functions);
  part.functions.finalize();
  return part;
}

template SurfacePart<2> surface_on_lattice(const FineMesh<2>&, const std::vector<Index>&, MpmFrame, const MpmOptions&,
                                           const DeformableBody<2>&);
template SurfacePart<3> surface_on_lattice(const FineMesh<3>&, const std::vector<Index>&, MpmFrame, const MpmOptions&,
                                           const DeformableBody<3>&);

}  // namespace efree
