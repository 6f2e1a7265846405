// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/close_contacts.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/contact/internal/facet.hpp"

#include <fmt/ranges.h>
#include <Eigen/LU>
#include <algorithm>
#include <map>

namespace efree {
namespace {

using internal::area_of, internal::facet_corners, internal::FacetTree, internal::weights_in;

/// The surface of a region, without what touches another already.
template <int Dim> struct RegionSurface {
  Facets<Dim> facets;
  std::map<Index, std::vector<Index>> around{};  ///< by vertex, its facets
};

template <int Dim> std::vector<RegionSurface<Dim>> surfaces_of(const FineMesh<Dim>& mesh) {
  std::vector<char> touches(static_cast<std::size_t>(mesh.num_facets()), 0);
  for (const auto& [first, second] : tied_facets(mesh)) touches[first] = touches[second] = 1;
  std::vector<std::vector<Index>> facets(static_cast<std::size_t>(mesh.num_regions()));
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (touches[f] == 0) facets[mesh.region(mesh.facet_cell(f))].push_back(f);
  std::vector<RegionSurface<Dim>> result;
  for (const auto& of_region : facets) {
    RegionSurface<Dim>& surface = result.emplace_back(mesh.facets()(Eigen::all, of_region));
    for (Index f = 0; f < surface.facets.cols(); ++f)
      for (const Index v : surface.facets.col(f)) surface.around[v].push_back(f);
    std::erase_if(surface.around, [&](const auto& vertex) {
      const auto around = mesh.facets_of(vertex.first);
      return std::ranges::any_of(around, [&](Index f) { return touches[f] != 0; });
    });
  }
  return result;
}

/// How far in front of facets vertices end, over the tolerance.
constexpr double clearance = 1e-6;

/// From a vertex to the nearest facet in front of it or behind.
template <int Dim> struct Facing {
  double gap = std::numeric_limits<double>::infinity();  ///< negative inside
  Vec<Dim> normal = Vec<Dim>::Zero();                    ///< of the facet, outwards
};

template <int Dim> Facing<Dim> find_facing(const Points<Dim>& x, const RegionSurface<Dim>& own, Index vertex,
                                           const RegionSurface<Dim>& other, const std::vector<Index>& candidates) {
  constexpr double opposed = -0.5, beyond_edge = 1e-3;
  Facing<Dim> nearest;
  for (const Index f : candidates) {
    const Mat<Dim> corner = facet_corners(x, other.facets, f).colwise() - Vec<Dim>(x.col(vertex));
    const Vec<Dim> normal = area_of<Dim>(corner).normalized();
    const double gap = -normal.dot(corner.col(0));
    if (!(std::abs(gap) < std::abs(nearest.gap)) || weights_in<Dim>(corner).minCoeff() < -beyond_edge) continue;
    const auto is_opposed = [&](Index g) {
      return area_of<Dim>(facet_corners(x, own.facets, g)).normalized().dot(normal) < opposed;
    };
    if (std::ranges::any_of(own.around.at(vertex), is_opposed)) nearest = {gap, normal};
  }
  return nearest;
}

/// How vertices of the surfaces move: of each region those that are inside others, and, with `gaps`, onto earlier
/// regions those in front of them. And the deepest overlap that was found.
template <int Dim> std::pair<Points<Dim>, double> find_moves(const std::vector<RegionSurface<Dim>>& surfaces,
                                                             double tolerance, bool gaps, const Points<Dim>& x) {
  const double ahead = clearance * tolerance;
  double deepest = 0.0;
  Points<Dim> moved = Points<Dim>::Zero(Dim, x.cols());
  for (std::size_t region = 0; region < surfaces.size(); ++region)
    for (std::size_t other = 0; other < surfaces.size(); ++other) {
      if (region == other || surfaces[other].facets.cols() == 0) continue;
      const FacetTree<Dim> tree(x, surfaces[other].facets);
      std::vector<Index> candidates;
      for (const auto& [vertex, facets] : surfaces[region].around) {
        tree.centres.within(x.col(vertex), tree.reach + tolerance, candidates);
        const Facing<Dim> facing = find_facing(x, surfaces[region], vertex, surfaces[other], candidates);
        if (!(std::abs(facing.gap) <= tolerance)) continue;
        deepest = std::max(deepest, -facing.gap);
        const bool misses = std::abs(facing.gap - ahead) > 0.5 * ahead;
        const bool moves = gaps ? misses && other < region : facing.gap < -ahead;
        // Less what it moves for another region already, as above where two of them meet.
        if (moves) moved.col(vertex) += (ahead - facing.gap - facing.normal.dot(moved.col(vertex))) * facing.normal;
      }
    }
  return {moved, deepest};
}

/// What is around vertices that move goes along, the less the farther it is, and the farthest not at all: where flat
/// surfaces move as a whole their region is stretched evenly, so that flat cells do not turn over. `moved`: by vertex,
/// zero where it does not move by itself.
template <int Dim> void stretch(const FineMesh<Dim>& mesh, const std::vector<Index>& region_of, Points<Dim>& moved) {
  constexpr std::size_t most = 2048;  // vertices that others follow
  std::vector<std::vector<Index>> moving(static_cast<std::size_t>(mesh.num_regions()));
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (!moved.col(v).isZero(0.0)) moving[region_of[v]].push_back(v);
  Points<Dim> following = moved;
  Vector distance = Vector::Zero(mesh.num_vertices()), farthest = Vector::Zero(mesh.num_regions());
  parallel_for(mesh.num_vertices(), [&](Index v) {
    const std::vector<Index>& of = moving[region_of[v]];
    if (of.empty() || !moved.col(v).isZero(0.0)) return;
    double sum = 0.0, nearest = std::numeric_limits<double>::infinity();
    Vec<Dim> mean = Vec<Dim>::Zero();
    for (std::size_t k = 0; k < of.size(); k += 1 + of.size() / most) {
      const double squared = (mesh.vertex(of[k]) - mesh.vertex(v)).squaredNorm();
      const double weight = 1.0 / (squared * squared);
      sum += weight;
      mean += weight * moved.col(of[k]);
      nearest = std::min(nearest, squared);
    }
    following.col(v) = mean / sum;
    distance[v] = std::sqrt(nearest);
  });
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    farthest[region_of[v]] = std::max(farthest[region_of[v]], distance[v]);
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (distance[v] > 0.0) moved.col(v) = (1.0 - distance[v] / farthest[region_of[v]]) * following.col(v);
}

template <int Dim> void require_volumes(const FineMesh<Dim>& mesh, const Points<Dim>& x, double tolerance) {
  constexpr double least = 0.1;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    Mat<Dim> edges;
    for (int i = 0; i < Dim; ++i) edges.col(i) = x.col(mesh.cells()(i + 1, c)) - x.col(mesh.cells()(0, c));
    const double volume = edges.determinant() / (Dim == 2 ? 2.0 : 6.0);
    if (volume < least * mesh.volume(c))
      throw InputError(
          fmt::format("gaps and overlaps of up to {:.6g} cannot be closed: a cell at ({:.6g}) would keep "
                      "{:.2g} % of its volume; take less, or larger cells",
                      tolerance, fmt::join(mesh.centroid(c), ", "), 100.0 * volume / mesh.volume(c)));
  }
}

/// By region, in the plane areas; axisymmetric: over 2 pi.
template <int Dim> Vector region_volumes(const FineMesh<Dim>& mesh, bool axisymmetric) {
  Vector result = Vector::Zero(mesh.num_regions());
  for (Index c = 0; c < mesh.num_cells(); ++c)
    result[mesh.region(c)] += mesh.volume(c) * (axisymmetric ? mesh.centroid(c)[0] : 1.0);
  return result;
}

}  // namespace

template <int Dim> ClosedContacts close_contacts(FineMesh<Dim>& mesh, double tolerance, bool axisymmetric) {
  constexpr double on_axis = 1e-12;  // radius over the size of the mesh
  require(tolerance > 0.0, "close_contacts: expected a positive tolerance");
  // Where surfaces are curved, vertices of one are inside the facets of the other once these are on them, and so on.
  constexpr int passes = 10;
  const std::vector<RegionSurface<Dim>> surfaces = surfaces_of(mesh);
  std::vector<Index> region_of(static_cast<std::size_t>(mesh.num_vertices()));
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (const Index v : mesh.cells().col(c)) region_of[v] = mesh.region(c);
  Points<Dim> x = mesh.vertices();
  ClosedContacts result;
  std::vector<char> touched(static_cast<std::size_t>(mesh.num_vertices()), 0);
  for (int pass = 0; pass < passes; ++pass) {
    auto [moves, overlap] = find_moves(surfaces, tolerance, pass == 0, x);
    result.overlap = overlap;
    if (pass > 0 && overlap <= clearance * tolerance) break;
    for (Index v = 0; v < x.cols(); ++v)
      if (!moves.col(v).isZero(0.0)) touched[v] = 1;
    stretch(mesh, region_of, moves);
    for (Index v = 0; axisymmetric && v < x.cols(); ++v)
      if (x(0, v) <= on_axis * mesh.size()) moves(0, v) = 0.0;
    x += moves;
  }
  const Vector moved = (x - mesh.vertices()).colwise().norm();
  result.furthest = moved.maxCoeff();
  result.vertices = std::ranges::count(touched, 1);
  result.volume_change.setZero(mesh.num_regions());
  if (result.vertices == 0) return result;
  require_volumes(mesh, x, tolerance);
  const Vector before = region_volumes(mesh, axisymmetric);
  MeshData<Dim> data = extract(mesh, std::vector<char>(static_cast<std::size_t>(mesh.num_cells()), 1));
  data.vertices = x;
  mesh = FineMesh<Dim>(std::move(data));
  result.volume_change =
      (before.array() > 0.0).select(region_volumes(mesh, axisymmetric).array() / before.array() - 1.0, 0.0);
  return result;
}

template ClosedContacts close_contacts(FineMesh<2>&, double, bool);
template ClosedContacts close_contacts(FineMesh<3>&, double, bool);

}  // namespace efree
