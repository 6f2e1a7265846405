// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/selection.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/internal/unit_vector.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace efree {
namespace {

template <int Dim> std::string shown(const Vec<Dim>& x) {
  return fmt::format("({:.6g})", fmt::join(x, ", "));
}

double cosine(double degrees) {
  if (!(degrees > 0.0 && degrees <= 180.0))
    throw InputError(fmt::format("angle = {}, expected a number in (0, 180] degrees", degrees));
  // Facets that lie exactly at the angle belong to it, whatever rounding says.
  return std::cos(degrees * std::numbers::pi / 180.0) - 1e-12;
}

template <int Dim> Vec<Dim> unit(const Vec<Dim>& direction) {
  if (direction.isZero(0.0) || !direction.allFinite())
    throw InputError(fmt::format("normal = {}, expected a direction", shown<Dim>(direction)));
  return internal::unit_vector<Dim>(direction);
}

template <int Dim> double squared_distance(const FineMesh<Dim>& mesh, Index f, const Vec<Dim>& x) {
  const Vec<Dim> a = mesh.vertex(mesh.facets()(0, f));
  const auto to_segment = [&](const Vec<Dim>& from, const Vec<Dim>& to) {
    const Vec<Dim> along = to - from;
    const double t = std::clamp((x - from).dot(along) / along.squaredNorm(), 0.0, 1.0);
    return (x - from - t * along).squaredNorm();
  };
  if constexpr (Dim == 2) {
    return to_segment(a, mesh.vertex(mesh.facets()(1, f)));
  } else {
    const Vec<3> b = mesh.vertex(mesh.facets()(1, f)), c = mesh.vertex(mesh.facets()(2, f));
    const Vec<3> n = mesh.facet_normal(f);
    const auto is_left = [&](const Vec<3>& from, const Vec<3>& to) { return n.dot((to - from).cross(x - from)) >= 0; };
    if (is_left(a, b) && is_left(b, c) && is_left(c, a)) return std::pow(n.dot(x - a), 2);
    return std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
  }
}

/// Facets between regions, which are no boundary.
struct Interfaces {
  std::vector<TiedFacets> ties;
  std::vector<char> has;  ///< by facet
};

/// Facets that share an edge (a vertex in 2D). Vertices that ties put into one place count as one.
template <int Dim> class Neighbours {
 public:
  Neighbours(const FineMesh<Dim>& mesh, const std::vector<TiedFacets>& ties) : mesh_(mesh) {
    internal::DisjointSets places(mesh.num_vertices());
    for (const auto& [first, second] : ties)
      for (const Index v : mesh.facets().col(first))
        for (const Index w : mesh.facets().col(second))
          if (mesh.vertex(v) == mesh.vertex(w)) places.join(v, w);
    place_ = std::move(places).firsts();
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (place_[v] != v) copies_.emplace_back(place_[v], v);
    std::ranges::sort(copies_);
  }

  /// Calls visit(g) for every neighbour g of f.
  template <class Visit> void visit(Index f, const Visit& visit) const {
    for (const Index v : mesh_.facets().col(f)) {
      const Index place = place_[v];
      visit_at(f, place, visit);
      for (auto copy = std::ranges::lower_bound(copies_, std::pair(place, Index(0)));
           copy != copies_.end() && copy->first == place; ++copy)
        visit_at(f, copy->second, visit);
    }
  }

 private:
  template <class Visit> void visit_at(Index f, Index v, const Visit& visit) const {
    for (const Index g : mesh_.facets_of(v)) {
      int shared = 0;
      for (const Index a : mesh_.facets().col(f))
        for (const Index b : mesh_.facets().col(g)) shared += place_[a] == place_[b];
      if (g != f && shared == Dim - 1) visit(g);
    }
  }

  const FineMesh<Dim>& mesh_;
  std::vector<Index> place_;                       ///< by vertex: the first of those in its place
  std::vector<std::pair<Index, Index>> copies_{};  ///< (first, other) of those, ascending
};

template <int Dim>
std::vector<Index> select(const FineMesh<Dim>& mesh, const NearestPatch<Dim>& wanted, const Interfaces& outside) {
  const double least = cosine(wanted.angle);
  const Neighbours<Dim> neighbours(mesh, outside.ties);
  Index nearest = -1;
  double distance = std::numeric_limits<double>::infinity();
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    if (outside.has[f]) continue;
    const double here = squared_distance<Dim>(mesh, f, wanted.point);
    if (here < distance) nearest = f, distance = here;
  }
  if (nearest < 0) return {};
  std::vector<char> seen = outside.has;
  std::vector<Index> patch{nearest};
  seen[nearest] = 1;
  for (std::size_t k = 0; k < patch.size(); ++k) {
    const Vec<Dim> normal = mesh.facet_normal(patch[k]);
    neighbours.visit(patch[k], [&](Index g) {
      if (seen[g] || mesh.facet_normal(g).dot(normal) < least) return;
      seen[g] = 1;
      patch.push_back(g);
    });
  }
  std::ranges::sort(patch);
  return patch;
}

template <int Dim, class Predicate>
std::vector<Index> facets_where(const FineMesh<Dim>& mesh, const Interfaces& outside, const Predicate& wanted) {
  std::vector<Index> facets;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (!outside.has[f] && wanted(f)) facets.push_back(f);
  return facets;
}

template <int Dim> double diagonal(const FineMesh<Dim>& mesh) {
  return (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).norm();
}

/// Whether all vertices of facet f are where `wanted` says.
template <int Dim, class Predicate> bool all_vertices(const FineMesh<Dim>& mesh, Index f, const Predicate& wanted) {
  for (int k = 0; k < Dim; ++k)
    if (!wanted(mesh.vertex(mesh.facets()(k, f)))) return false;
  return true;
}

template <int Dim>
std::vector<Index> select(const FineMesh<Dim>& mesh, const InBox<Dim>& box, const Interfaces& outside) {
  if (!(box.low.array() <= box.high.array()).all())
    throw InputError(
        fmt::format("box from {} to {}, expected its lowest corner first", shown<Dim>(box.low), shown<Dim>(box.high)));
  const double rounding = 1e-9 * diagonal(mesh);
  return facets_where(mesh, outside, [&](Index f) {
    return all_vertices(mesh, f, [&](const Vec<Dim>& x) {
      return (x.array() >= box.low.array() - rounding).all() && (x.array() <= box.high.array() + rounding).all();
    });
  });
}

template <int Dim>
std::vector<Index> select(const FineMesh<Dim>& mesh, const OnPlane<Dim>& plane, const Interfaces& outside) {
  if (!(plane.tolerance >= 0.0))
    throw InputError(fmt::format("tolerance = {}, expected a length that is not negative", plane.tolerance));
  const Vec<Dim> n = unit<Dim>(plane.normal);
  const double tolerance = plane.tolerance > 0.0 ? plane.tolerance : 1e-6 * diagonal(mesh);
  return facets_where(mesh, outside, [&](Index f) {
    return all_vertices(mesh, f, [&](const Vec<Dim>& x) { return std::abs(n.dot(x - plane.point)) <= tolerance; });
  });
}

template <int Dim>
std::vector<Index> select(const FineMesh<Dim>& mesh, const Facing<Dim>& facing, const Interfaces& outside) {
  const Vec<Dim> n = unit<Dim>(facing.direction);
  const double least = cosine(facing.angle);
  return facets_where(mesh, outside, [&](Index f) { return mesh.facet_normal(f).dot(n) >= least; });
}

}  // namespace

template <int Dim>
std::vector<Index> select_facets(const FineMesh<Dim>& mesh, const Selection<Dim>& selection, std::string_view open) {
  Interfaces outside{tied_facets(mesh, open), std::vector<char>(mesh.num_facets(), 0)};
  for (const auto& [first, second] : outside.ties) outside.has[first] = outside.has[second] = 1;
  return std::visit([&](const auto& wanted) { return select(mesh, wanted, outside); }, selection);
}

template std::vector<Index> select_facets<2>(const FineMesh<2>&, const Selection<2>&, std::string_view);
template std::vector<Index> select_facets<3>(const FineMesh<3>&, const Selection<3>&, std::string_view);

}  // namespace efree
