// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/selection.hpp"

#include "efree/core/error.hpp"

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
  if (!(direction.norm() > 0.0) || !direction.allFinite())
    throw InputError(fmt::format("normal = {}, expected a direction", shown<Dim>(direction)));
  return direction.normalized();
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

/// Calls visit(g) for every facet that shares an edge (a vertex in 2D) with f.
template <int Dim, class Visit> void for_each_neighbour(const FineMesh<Dim>& mesh, Index f, const Visit& visit) {
  const auto facet = mesh.facets().col(f);
  for (int k = 0; k < Dim; ++k)
    for (const Index g : mesh.facets_of(facet[k])) {
      int shared = 0;
      for (int i = 0; i < Dim; ++i)
        for (int j = 0; j < Dim; ++j) shared += mesh.facets()(i, g) == facet[j];
      if (g != f && shared == Dim - 1) visit(g);
    }
}

template <int Dim> std::vector<Index> patch_around(const FineMesh<Dim>& mesh, const NearestPatch<Dim>& wanted,
                                                   const std::vector<char>& excluded) {
  const double least = cosine(wanted.angle);
  Index nearest = -1;
  double distance = std::numeric_limits<double>::infinity();
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    if (excluded[f]) continue;
    const double here = squared_distance<Dim>(mesh, f, wanted.point);
    if (here < distance) nearest = f, distance = here;
  }
  if (nearest < 0) return {};
  std::vector<char> seen = excluded;
  std::vector<Index> patch{nearest};
  seen[nearest] = 1;
  for (std::size_t k = 0; k < patch.size(); ++k) {
    const Vec<Dim> normal = mesh.facet_normal(patch[k]);
    for_each_neighbour(mesh, patch[k], [&](Index g) {
      if (seen[g] || mesh.facet_normal(g).dot(normal) < least) return;
      seen[g] = 1;
      patch.push_back(g);
    });
  }
  std::ranges::sort(patch);
  return patch;
}

template <int Dim, class Predicate>
std::vector<Index> facets_where(const FineMesh<Dim>& mesh, const std::vector<char>& excluded, const Predicate& wanted) {
  std::vector<Index> facets;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (!excluded[f] && wanted(f)) facets.push_back(f);
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
std::vector<Index> select(const FineMesh<Dim>& mesh, const InBox<Dim>& box, const std::vector<char>& excluded) {
  if (!(box.low.array() <= box.high.array()).all())
    throw InputError(
        fmt::format("box from {} to {}, expected its lowest corner first", shown<Dim>(box.low), shown<Dim>(box.high)));
  const double rounding = 1e-9 * diagonal(mesh);
  return facets_where(mesh, excluded, [&](Index f) {
    return all_vertices(mesh, f, [&](const Vec<Dim>& x) {
      return (x.array() >= box.low.array() - rounding).all() && (x.array() <= box.high.array() + rounding).all();
    });
  });
}

template <int Dim>
std::vector<Index> select(const FineMesh<Dim>& mesh, const OnPlane<Dim>& plane, const std::vector<char>& excluded) {
  if (!(plane.tolerance >= 0.0))
    throw InputError(fmt::format("tolerance = {}, expected a length that is not negative", plane.tolerance));
  const Vec<Dim> n = unit<Dim>(plane.normal);
  const double tolerance = plane.tolerance > 0.0 ? plane.tolerance : 1e-6 * diagonal(mesh);
  return facets_where(mesh, excluded, [&](Index f) {
    return all_vertices(mesh, f, [&](const Vec<Dim>& x) { return std::abs(n.dot(x - plane.point)) <= tolerance; });
  });
}

template <int Dim>
std::vector<Index> select(const FineMesh<Dim>& mesh, const Facing<Dim>& facing, const std::vector<char>& excluded) {
  const Vec<Dim> n = unit<Dim>(facing.direction);
  const double least = cosine(facing.angle);
  return facets_where(mesh, excluded, [&](Index f) { return mesh.facet_normal(f).dot(n) >= least; });
}

template <int Dim> std::vector<Index> select(const FineMesh<Dim>& mesh, const NearestPatch<Dim>& patch,
                                             const std::vector<char>& excluded) {
  return patch_around(mesh, patch, excluded);
}

}  // namespace

template <int Dim>
std::vector<Index> select_facets(const FineMesh<Dim>& mesh, const Selection<Dim>& selection, std::string_view open) {
  std::vector<char> excluded(mesh.num_facets(), 0);
  for (const auto& [first, second] : tied_facets(mesh, open)) excluded[first] = excluded[second] = 1;
  return std::visit([&](const auto& wanted) { return select(mesh, wanted, excluded); }, selection);
}

template std::vector<Index> select_facets<2>(const FineMesh<2>&, const Selection<2>&, std::string_view);
template std::vector<Index> select_facets<3>(const FineMesh<3>&, const Selection<3>&, std::string_view);

}  // namespace efree
