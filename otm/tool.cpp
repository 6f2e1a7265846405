// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/otm/tool.hpp"

#include "efree/basis/internal/neighbours.hpp"
#include "efree/core/error.hpp"
#include "efree/otm/internal/facet.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <cmath>
#include <memory>
#include <vector>

namespace efree::tools {
namespace {

/// Closed facets, and where their middles are.
template <int Dim> struct Hull {
  Points<Dim> vertices;
  Facets<Dim> facets;  ///< outwards
  internal::Neighbours<Dim> tree;
  double reach = 0.0;  ///< of a facet from its middle, at the most
  Eigen::AlignedBox<double, Dim> box{};

  Mat<Dim> corners(Index f) const { return vertices(Eigen::all, facets.col(f)); }

  ToolGap<Dim> gap(const Vec<Dim>& x) const {
    // Nobody near asks from further away.
    const double from_box = box.exteriorDistance(x);
    if (from_box > 2.0 * reach) {
      const Vec<Dim> to = x.cwiseMax(box.min()).cwiseMin(box.max());
      return {from_box, (x - to) / from_box};
    }
    thread_local std::vector<Index> found;
    const double at_most = (tree.points().col(tree.nearest(x)) - x).norm();
    tree.within(x, at_most + reach, found);
    internal::NearestFacet<Dim> nearest(1e-9 * reach);
    for (const Index f : found) nearest.look(f, corners(f).colwise() - x);
    const double side = nearest.is_inside() ? -1.0 : 1.0;
    // On the surface there is no way to it.
    const Vec<Dim> out = nearest.distance() > 1e-6 * reach ? Vec<Dim>(-side * nearest.to())
                                                           : internal::area_of<Dim>(corners(nearest.facet()));
    return {side * nearest.distance(), out.normalized()};
  }
};

}  // namespace

template <int Dim> ToolShape<Dim> half_space(const Vec<Dim>& normal, double level) {
  if (!(std::abs(normal.norm() - 1.0) <= 1e-9)) throw InputError("a plane's normal: expected a unit vector");
  require(std::isfinite(level), "a plane: expected a level that is a number");
  return [normal, level](const Vec<Dim>& x) { return ToolGap<Dim>{x.dot(normal) - level, normal}; };
}

template <int Dim> ToolShape<Dim> ball(const Vec<Dim>& centre, double radius) {
  require(centre.allFinite() && radius > 0.0 && std::isfinite(radius), "a ball: expected a centre, a positive radius");
  return [centre, radius](const Vec<Dim>& x) {
    const Vec<Dim> from = x - centre;
    const double distance = from.norm();
    return ToolGap<Dim>{distance - radius, distance > 0.0 ? Vec<Dim>(from / distance) : Vec<Dim>(Vec<Dim>::Unit(0))};
  };
}

ToolShape<3> cylinder(const Vec<3>& point, const Vec<3>& axis, double radius) {
  require(point.allFinite() && axis.allFinite() && axis.norm() > 0.0 && radius > 0.0 && std::isfinite(radius),
          "a cylinder: expected a point of its axis, a direction, a positive radius");
  const Vec<3> along = axis.normalized();
  return [point, along, radius](const Vec<3>& x) {
    const Vec<3> to = x - point, from = to - along.dot(to) * along;
    const double distance = from.norm();
    return ToolGap<3>{distance - radius, distance > 0.0 ? Vec<3>(from / distance) : Vec<3>(along.unitOrthogonal())};
  };
}

template <int Dim> ToolShape<Dim> solid(const Points<Dim>& vertices, const Facets<Dim>& facets) {
  if (facets.cols() == 0 || facets.minCoeff() < 0 || facets.maxCoeff() >= vertices.cols())
    throw InputError(fmt::format("a tool: expected facets of its {} vertices", vertices.cols()));
  require(vertices.allFinite(), "a tool: expected vertices that are numbers");
  auto hull = std::make_shared<Hull<Dim>>();
  hull->vertices = vertices;
  hull->facets = facets;
  for (const Index a : facets.reshaped()) hull->box.extend(Vec<Dim>(vertices.col(a)));
  const Vec<Dim> middle = hull->box.center();
  Points<Dim> centres(Dim, facets.cols());
  Vec<Dim> sum = Vec<Dim>::Zero();
  double size = 0.0, volume = 0.0;
  for (Index f = 0; f < static_cast<Index>(facets.cols()); ++f) {
    const Mat<Dim> corners = hull->corners(f).colwise() - middle;
    const Vec<Dim> area = internal::area_of<Dim>(corners);
    if (!(area.norm() > 0.0)) throw InputError(fmt::format("a tool: facet {} has no area", f));
    sum += area;
    size += area.norm();
    volume += corners.col(0).dot(area) / Dim;
    centres.col(f) = hull->corners(f).rowwise().mean();
    hull->reach = std::max(hull->reach,
                           std::sqrt((hull->corners(f).colwise() - centres.col(f)).colwise().squaredNorm().maxCoeff()));
  }
  if (!(sum.norm() < 1e-9 * size)) throw InputError("a tool: its facets are not closed, or not oriented alike");
  if (!(std::abs(volume) > 1e-12 * std::pow(size, Dim / (Dim - 1.0))))
    throw InputError("a tool: its facets enclose nothing");
  if (volume < 0.0) hull->facets.row(0).swap(hull->facets.row(1));
  hull->tree.build(centres);
  return [hull](const Vec<Dim>& x) { return hull->gap(x); };
}

Facets<2> polygon(Index corners) {
  Facets<2> facets(2, corners);
  for (Index k = 0; k < corners; ++k) facets.col(k) << k, (k + 1) % corners;
  return facets;
}

template ToolShape<2> half_space(const Vec<2>&, double);
template ToolShape<3> half_space(const Vec<3>&, double);
template ToolShape<2> ball(const Vec<2>&, double);
template ToolShape<3> ball(const Vec<3>&, double);
template ToolShape<2> solid(const Points<2>&, const Facets<2>&);
template ToolShape<3> solid(const Points<3>&, const Facets<3>&);

}  // namespace efree::tools
