// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/bodies.hpp"

#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/assembly/internal/rigid_motions.hpp"
#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/internal/spectrum.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

namespace efree {
namespace {

using internal::BoundaryPoint, internal::Motion, internal::for_each_point, internal::motion_along,
    internal::motion_names, internal::rigid_motions;

/// Number of the body each component of the mesh belongs to, tied ones together, counted from 0.
template <int Dim> std::vector<Index> tied_bodies(const FineMesh<Dim>& mesh, const std::vector<TiedFacets>& ties) {
  internal::DisjointSets sets(mesh.num_components());
  for (const auto& [f, other] : ties)
    sets.join(mesh.component()[mesh.facets()(0, f)], mesh.component()[mesh.facets()(0, other)]);
  std::vector<Index> body = std::move(sets).firsts();
  Index count = 0;
  for (Index c = 0; c < mesh.num_components(); ++c) body[c] = body[c] == c ? count++ : body[body[c]];
  return body;
}

/// Another body next to one, and how far away.
struct Neighbour {
  Index body;
  double distance;
};

/// Distance of a point from the nearest point of a facet.
template <int Dim> double distance(const Vec<Dim>& x, const FineMesh<Dim>& mesh, Index facet) {
  const auto corner = [&](int i) -> Vec<Dim> { return mesh.vertex(mesh.facets()(i, facet)); };
  double least = std::numeric_limits<double>::infinity();
  const auto from_edge = [&](const Vec<Dim>& a, const Vec<Dim>& b) {
    const Vec<Dim> along = b - a;
    const double share = std::clamp(along.dot(x - a) / along.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (x - a - share * along).norm());
  };
  for (int i = 0; i < Dim; ++i) from_edge(corner(i), corner((i + 1) % Dim));
  if constexpr (Dim == 3) {
    const Vec<3> u = corner(1) - corner(0), v = corner(2) - corner(0), n = u.cross(v), away = x - corner(0);
    const double area = n.squaredNorm();
    const double s = away.cross(v).dot(n) / area, t = u.cross(away).dot(n) / area;
    if (s >= 0.0 && t >= 0.0 && s + t <= 1.0) least = std::min(least, std::abs(away.dot(n)) / std::sqrt(area));
  }
  return least;
}

/// The body whose boundary is nearest to that of this one, by the vertices of both and the facets around the nearest
/// of them; nothing if there is no other.
template <int Dim>
std::optional<Neighbour> nearest_body(const FineMesh<Dim>& mesh, const Bodies<Dim>& bodies, Index body) {
  const auto body_at = [&](Index v) { return bodies.of_component[mesh.component()[v]]; };
  std::vector<Index> own, others;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    for (int i = 0; i < Dim; ++i) {
      const Index v = mesh.facets()(i, f);
      (body_at(v) == body ? own : others).push_back(v);
    }
  if (own.empty() || others.empty()) return std::nullopt;
  const auto unite = [](std::vector<Index>& vertices) {
    std::ranges::sort(vertices);
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  };
  unite(own), unite(others);
  internal::Neighbours<Dim> tree;
  tree.build(mesh.vertices()(Eigen::all, others));
  std::pair<Index, Index> pair{own.front(), others.front()};
  const auto apart = [&](Index v, Index w) { return (mesh.vertex(v) - mesh.vertex(w)).norm(); };
  for (const Index v : own)
    if (const Index w = others[tree.nearest(mesh.vertex(v))]; apart(v, w) < apart(pair.first, pair.second))
      pair = {v, w};
  double least = apart(pair.first, pair.second);
  for (const Index f : mesh.facets_of(pair.first))
    least = std::min(least, distance<Dim>(mesh.vertex(pair.second), mesh, f));
  for (const Index f : mesh.facets_of(pair.second))
    least = std::min(least, distance<Dim>(mesh.vertex(pair.first), mesh, f));
  return Neighbour{body_at(pair.second), least};
}

}  // namespace

template <int Dim> Bodies<Dim> find_bodies(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties) {
  const FineMesh<Dim>& mesh = space.mesh();
  Bodies<Dim> bodies;
  bodies.of_component = tied_bodies(mesh, ties);
  const Index count = 1 + *std::ranges::max_element(bodies.of_component);
  const auto body_at = [&](Index v) { return bodies.of_component[mesh.component()[v]]; };
  // Centre and radius of gyration of each body, so that translations and rotations weigh alike.
  Vector& volume = bodies.volumes;
  Points<Dim>& centre = bodies.centres;
  volume.setZero(count);
  centre.setZero(Dim, count);
  Vector polar = Vector::Zero(count);
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index body = body_at(mesh.cells()(0, c));
    volume[body] += mesh.volume(c);
    centre.col(body) += mesh.volume(c) * mesh.centroid(c);
  }
  for (Index body = 0; body < count; ++body) centre.col(body) /= volume[body];
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const Index body = body_at(mesh.cells()(0, c));
    double square = (mesh.centroid(c) - centre.col(body)).squaredNorm();
    for (int i = 0; i <= Dim; ++i)  // so that a single cell has a radius, too
      square += (mesh.vertex(mesh.cells()(i, c)) - mesh.centroid(c)).squaredNorm() / ((Dim + 1) * (Dim + 2));
    polar[body] += mesh.volume(c) * square;
  }
  const auto radius = [&](Index body) { return std::sqrt(polar[body] / volume[body]); };
  using Gram = Eigen::Matrix<double, rigid_motions<Dim>, rigid_motions<Dim>>;
  std::vector<Gram> gram(count, Gram::Zero());
  std::vector<double> held(count, 0.0);
  for (const auto& restraint : restraints)
    for_each_point<Dim>(space, mesh.group(restraint.on), [&](const BoundaryPoint<Dim>& point) {
      const Index body = body_at(mesh.facets()(0, point.facet));
      const Motion<Dim> motion =
          motion_along<Dim>(restraint.direction(point.n), point.x - centre.col(body), radius(body));
      gram[body] += point.weight * motion * motion.transpose();
      held[body] += point.weight;
    });

  bodies.free_motions.resize(count);
  for (Index body = 0; body < count; ++body) {
    if (space.axisymmetric()) {
      // Hoops resist every motion but the one along the axis.
      const double along_axis = gram[body](1, 1);
      gram[body] = std::max(held[body], 1e-300) * Gram::Identity();
      gram[body](1, 1) = along_axis;
    }
    const auto [stiffness, motions] = internal::spectrum<rigid_motions<Dim>>(gram[body]);
    const double scale = std::max(stiffness.maxCoeff(), 1e-300);
    const int nullity = static_cast<int>((stiffness.array() < 1e-10 * scale).count());
    if (nullity == 0) continue;
    bodies.free_motions[body] = space.axisymmetric()
                                    ? std::vector<std::string>{"translation along the axis of revolution, y"}
                                    : motion_names<Dim>(motions.leftCols(nullity), centre.col(body), radius(body));
  }
  return bodies;
}

template <int Dim> std::string describe_body(const FineMesh<Dim>& mesh, const Bodies<Dim>& bodies, Index body) {
  std::vector<char> has(mesh.num_regions(), 0);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (bodies.of_component[mesh.component()[mesh.cells()(0, c)]] == body) has[mesh.region(c)] = 1;
  std::vector<std::string> regions;
  for (Index r = 0; r < mesh.num_regions(); ++r)
    if (has[r]) regions.push_back(fmt::format("\"{}\"", mesh.region_names()[r]));
  const std::string where = fmt::format("body around ({:.4g})", fmt::join(bodies.centres.col(body), ", "));
  if (mesh.num_regions() == 1) return where;
  return fmt::format("{} of region{} {}", where, regions.size() > 1 ? "s" : "", fmt::join(regions, ", "));
}

template <int Dim> std::string describe_neighbour(const FineMesh<Dim>& mesh, const Bodies<Dim>& bodies, Index body) {
  const auto neighbour = nearest_body(mesh, bodies, body);
  if (!neighbour) return "no other body is there";
  const std::string nearest =
      fmt::format("its nearest neighbour is the {}", describe_body(mesh, bodies, neighbour->body));
  if (neighbour->distance <= 1e-6 * mesh.size()) return nearest + ", which it touches but is not joined to";
  return fmt::format("{}, {:.3g} away", nearest, neighbour->distance);
}

template <int Dim> void require_restrained(const FineSpace<Dim>& space, const std::vector<Restraint<Dim>>& restraints,
                                           const std::vector<TiedFacets>& ties) {
  constexpr std::size_t most_named = 5;
  const Bodies<Dim> bodies = find_bodies(space, restraints, ties);
  std::vector<Index> free;
  for (Index body = 0; body < bodies.size(); ++body)
    if (bodies.is_free(body)) free.push_back(body);
  if (free.empty()) return;
  if (free.size() > most_named)
    std::ranges::stable_sort(free, std::greater<>{}, [&](Index body) { return bodies.volumes[body]; });
  const FineMesh<Dim>& mesh = space.mesh();
  std::vector<std::string> named;
  for (std::size_t k = 0; k < std::min(free.size(), most_named); ++k) {
    const std::string motions = fmt::format("{}", fmt::join(bodies.free_motions[free[k]], ", "));
    named.push_back(bodies.size() == 1 ? motions
                                       : fmt::format("{}: {}; {}", describe_body(mesh, bodies, free[k]), motions,
                                                     describe_neighbour(mesh, bodies, free[k])));
  }
  if (free.size() > most_named) named.push_back(fmt::format("and {} smaller bodies", free.size() - most_named));
  throw InputError(fmt::format("underconstrained: free to move ({}); prescribe displacements that hold it{}",
                               fmt::join(named, "; "),
                               bodies.size() == 1 ? "" : ", or join it to its neighbour in the geometry"));
}

template std::string describe_body<2>(const FineMesh<2>&, const Bodies<2>&, Index);
template std::string describe_body<3>(const FineMesh<3>&, const Bodies<3>&, Index);
template std::string describe_neighbour<2>(const FineMesh<2>&, const Bodies<2>&, Index);
template std::string describe_neighbour<3>(const FineMesh<3>&, const Bodies<3>&, Index);
template Bodies<2> find_bodies<2>(const FineSpace<2>&, const std::vector<Restraint<2>>&,
                                  const std::vector<TiedFacets>&);
template void require_restrained<2>(const FineSpace<2>&, const std::vector<Restraint<2>>&,
                                    const std::vector<TiedFacets>&);
template Bodies<3> find_bodies<3>(const FineSpace<3>&, const std::vector<Restraint<3>>&,
                                  const std::vector<TiedFacets>&);
template void require_restrained<3>(const FineSpace<3>&, const std::vector<Restraint<3>>&,
                                    const std::vector<TiedFacets>&);

}  // namespace efree
