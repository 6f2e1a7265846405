// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/rigid_body.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/contact/internal/facet.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <memory>

namespace efree::rigid_shapes {
namespace {

/// Closed facets.
template <int Dim> struct Hull {
  Points<Dim> vertices;
  Facets<Dim> facets;  ///< outwards
  Eigen::AlignedBox<double, Dim> box{};
  internal::FacetTree<Dim> tree{vertices, facets};

  Mat<Dim> corners(Index f) const { return internal::facet_corners(vertices, facets, f); }

  Gap<Dim> gap(const Vec<Dim>& x) const {
    // Far away the distance from the box is enough.
    const double from_box = box.exteriorDistance(x), reach = tree.reach;
    if (from_box > 2.0 * reach) {
      const Vec<Dim> to = x.cwiseMax(box.min()).cwiseMin(box.max());
      return {from_box, (x - to) / from_box};
    }
    thread_local std::vector<Index> found;
    const double at_most = (tree.centres.points().col(tree.centres.nearest(x)) - x).norm();
    tree.centres.within(x, at_most + reach, found);
    internal::NearestFacet<Dim> nearest(1e-9 * reach);
    for (const Index f : found) nearest.compare(f, corners(f).colwise() - x);
    const double side = nearest.is_inside() ? -1.0 : 1.0;
    // On the surface the direction is that of the facet.
    const Vec<Dim> out = nearest.distance() > 1e-6 * reach ? Vec<Dim>(-side * nearest.to())
                                                           : internal::area_of<Dim>(corners(nearest.facet()));
    return {side * nearest.distance(), out.normalized()};
  }
};

}  // namespace

template <int Dim> RigidShape<Dim> half_space(const Vec<Dim>& normal, double level) {
  if (!(std::abs(normal.norm() - 1.0) <= 1e-9)) throw InputError("a plane's normal: expected a unit vector");
  require(std::isfinite(level), "a plane: expected a level that is a number");
  return [normal, level](const Vec<Dim>& x) { return Gap<Dim>{x.dot(normal) - level, normal}; };
}

template <int Dim> RigidShape<Dim> ball(const Vec<Dim>& centre, double radius) {
  require(centre.allFinite() && radius > 0.0 && std::isfinite(radius), "a ball: expected a centre, a positive radius");
  return [centre, radius](const Vec<Dim>& x) {
    const Vec<Dim> from = x - centre;
    const double distance = from.norm();
    return Gap<Dim>{distance - radius, distance > 0.0 ? Vec<Dim>(from / distance) : Vec<Dim>(Vec<Dim>::Unit(0))};
  };
}

RigidShape<3> cylinder(const Vec<3>& point, const Vec<3>& axis, double radius) {
  require(point.allFinite() && axis.allFinite() && axis.norm() > 0.0 && radius > 0.0 && std::isfinite(radius),
          "a cylinder: expected a point of its axis, a direction, a positive radius");
  const Vec<3> along = axis.normalized();
  return [point, along, radius](const Vec<3>& x) {
    const Vec<3> to = x - point, from = to - along.dot(to) * along;
    const double distance = from.norm();
    return Gap<3>{distance - radius, distance > 0.0 ? Vec<3>(from / distance) : Vec<3>(along.unitOrthogonal())};
  };
}

template <int Dim> RigidShape<Dim> solid(const Points<Dim>& vertices, const Facets<Dim>& facets) {
  if (facets.cols() == 0 || facets.minCoeff() < 0 || facets.maxCoeff() >= vertices.cols())
    throw InputError(fmt::format("a rigid body: expected facets of its {} vertices", vertices.cols()));
  require(vertices.allFinite(), "a rigid body: expected vertices that are numbers");
  const auto hull = std::make_shared<Hull<Dim>>(vertices, facets);
  for (const Index a : facets.reshaped()) hull->box.extend(Vec<Dim>(vertices.col(a)));
  const Vec<Dim> middle = hull->box.center();
  Vec<Dim> sum = Vec<Dim>::Zero();
  double size = 0.0, volume = 0.0;
  for (Index f = 0; f < facets.cols(); ++f) {
    const Mat<Dim> corners = hull->corners(f).colwise() - middle;
    const Vec<Dim> area = internal::area_of<Dim>(corners);
    if (!(area.norm() > 0.0)) throw InputError(fmt::format("a rigid body: facet {} has no area", f));
    sum += area;
    size += area.norm();
    volume += corners.col(0).dot(area) / Dim;
  }
  if (!(sum.norm() < 1e-9 * size)) throw InputError("a rigid body: its facets are not closed, or not oriented alike");
  if (!(std::abs(volume) > 1e-12 * std::pow(size, Dim / (Dim - 1.0))))
    throw InputError("a rigid body: its facets enclose nothing");
  if (volume < 0.0) hull->facets.row(0).swap(hull->facets.row(1));
  return [hull](const Vec<Dim>& x) { return hull->gap(x); };
}

Facets<2> polygon(Index corners) {
  Facets<2> facets(2, corners);
  for (Index k = 0; k < corners; ++k) facets.col(k) << k, (k + 1) % corners;
  return facets;
}

template RigidShape<2> half_space(const Vec<2>&, double);
template RigidShape<3> half_space(const Vec<3>&, double);
template RigidShape<2> ball(const Vec<2>&, double);
template RigidShape<3> ball(const Vec<3>&, double);
template RigidShape<2> solid(const Points<2>&, const Facets<2>&);
template RigidShape<3> solid(const Points<3>&, const Facets<3>&);

}  // namespace efree::rigid_shapes
