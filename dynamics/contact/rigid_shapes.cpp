// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/rigid_body.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/contact/internal/facet.hpp"
#include "efree/geometry/mesh/internal/box_tree.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

namespace efree::rigid_shapes {
namespace {

/// Closed facets, in a tree of their boxes: they may be of any size.
template <int Dim> class Hull {
 public:
  Hull(const Points<Dim>& vertices, const Facets<Dim>& facets) : vertices_(vertices), facets_(facets) {
    std::vector<internal::BoxEntry<Dim>> entries;
    for (Index f = 0; f < facets.cols(); ++f) {
      Eigen::AlignedBox<double, Dim> box;
      for (int i = 0; i < Dim; ++i) box.extend(Vec<Dim>(vertices.col(facets(i, f))));
      box_.extend(box);
      entries.emplace_back(internal::box_between<Dim>(box.min(), box.max()), f);
    }
    tree_ = {entries.begin(), entries.end()};
    size_ = box_.diagonal().norm();
  }

  Mat<Dim> corners(Index f) const { return internal::facet_corners(vertices_, facets_, f); }
  Vec<Dim> middle() const { return box_.center(); }
  void turn() { facets_.row(0).swap(facets_.row(1)); }

  Gap<Dim> gap(const Vec<Dim>& x) const {
    // Far away the distance from the box is enough.
    const double from_box = box_.exteriorDistance(x);
    if (from_box > size_) {
      const Vec<Dim> to = x.cwiseMax(box_.min()).cwiseMin(box_.max());
      return {from_box, (x - to) / from_box};
    }
    // Facets whose boxes are no further away than one of them.
    const double slack = 1e-9 * size_;
    internal::NearestFacet<Dim> nearest(slack);
    const auto compare = [&](const internal::BoxEntry<Dim>& entry) {
      nearest.compare(entry.second, corners(entry.second).colwise() - x);
    };
    thread_local std::vector<internal::BoxEntry<Dim>> found;
    found.clear();
    tree_.query(boost::geometry::index::nearest(internal::box_corner<Dim>(x), 1), std::back_inserter(found));
    compare(found.front());
    const Vec<Dim> reach = Vec<Dim>::Constant(nearest.distance() + slack);
    found.clear();
    tree_.query(boost::geometry::index::intersects(internal::box_between<Dim>(x - reach, x + reach)),
                std::back_inserter(found));
    for (const auto& entry : found) compare(entry);
    const double side = nearest.is_inside() ? -1.0 : 1.0;
    // On the surface the direction is that of the facet.
    const Vec<Dim> out = nearest.distance() > 1e-7 * size_ ? Vec<Dim>(-side * nearest.to())
                                                           : internal::area_of<Dim>(corners(nearest.facet()));
    return {side * nearest.distance(), out.normalized()};
  }

 private:
  Points<Dim> vertices_;
  Facets<Dim> facets_;  ///< outwards
  Eigen::AlignedBox<double, Dim> box_{};
  double size_;  ///< its diagonal
  internal::BoxTree<Dim> tree_;
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
  const Vec<Dim> middle = hull->middle();
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
  if (volume < 0.0) hull->turn();
  return [hull](const Vec<Dim>& x) { return hull->gap(x); };
}

RigidShape<3> solid(const SurfaceSoup& surface) {
  Facets<3> facets(3, static_cast<Index>(surface.triangles.size()));
  for (Index f = 0; f < facets.cols(); ++f)
    for (int i = 0; i < 3; ++i) facets(i, f) = surface.triangles[f][i];
  return solid<3>(surface.points, facets);
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
