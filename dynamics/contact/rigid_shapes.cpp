// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/rigid_body.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/contact/internal/facet.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <boost/geometry.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <cmath>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

namespace efree::rigid_shapes {
namespace {

namespace bg = boost::geometry;
template <int Dim> using Place = bg::model::point<double, Dim, bg::cs::cartesian>;
template <int Dim> Place<Dim> place(const Vec<Dim>& x) {
  if constexpr (Dim == 2)
    return {x[0], x[1]};
  else
    return {x[0], x[1], x[2]};
}

/// Closed facets, in a tree of their boxes: they may be of any size.
template <int Dim> class Hull {
 public:
  Hull(const Points<Dim>& vertices, const Facets<Dim>& facets) : vertices_(vertices), facets_(facets) {
    std::vector<Entry> entries;
    for (Index f = 0; f < facets.cols(); ++f) {
      Eigen::AlignedBox<double, Dim> box;
      for (int i = 0; i < Dim; ++i) box.extend(Vec<Dim>(vertices.col(facets(i, f))));
      box_.extend(box);
      entries.emplace_back(Box(place<Dim>(box.min()), place<Dim>(box.max())), f);
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
    const auto compare = [&](const Entry& entry) {
      nearest.compare(entry.second, corners(entry.second).colwise() - x);
    };
    thread_local std::vector<Entry> found;
    found.clear();
    tree_.query(bg::index::nearest(place<Dim>(x), 1), std::back_inserter(found));
    compare(found.front());
    const Vec<Dim> reach = Vec<Dim>::Constant(nearest.distance() + slack);
    found.clear();
    tree_.query(bg::index::intersects(Box(place<Dim>(x - reach), place<Dim>(x + reach))), std::back_inserter(found));
    for (const Entry& entry : found) compare(entry);
    const double side = nearest.is_inside() ? -1.0 : 1.0;
    // On the surface the direction is that of the facet.
    const Vec<Dim> out = nearest.distance() > 1e-7 * size_ ? Vec<Dim>(-side * nearest.to())
                                                           : internal::area_of<Dim>(corners(nearest.facet()));
    return {side * nearest.distance(), out.normalized()};
  }

 private:
  using Box = bg::model::box<Place<Dim>>;
  using Entry = std::pair<Box, Index>;
  Points<Dim> vertices_;
  Facets<Dim> facets_;  ///< outwards
  Eigen::AlignedBox<double, Dim> box_{};
  double size_;  ///< its diagonal
  bg::index::rtree<Entry, bg::index::linear<16>> tree_;
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

RigidShape<3> ground(const GreyImage<2>& heights) {
  const auto [nx, ny] = heights.size;
  if (nx < 2 || ny < 2)
    throw InputError(fmt::format("a ground of heights: {} x {} pixels, expected at least 2 x 2", nx, ny));
  require(heights.values.size() == static_cast<std::size_t>(nx * ny) &&
              std::ranges::all_of(heights.values, [](float height) { return std::isfinite(height); }),
          "a ground of heights: expected a height for every pixel that is a number");
  // The surface, the same corners along its rim at the bottom, and the middle of the bottom.
  const Index top = nx * ny, rim = 2 * (nx + ny) - 4;
  Points<3> vertices(3, top + rim + 1);
  for (Index j = 0; j < ny; ++j)
    for (Index i = 0; i < nx; ++i) {
      const Vec<2> at = heights.origin + heights.spacing.cwiseProduct(
                                             Vec<2>(static_cast<double>(i) + 0.5, static_cast<double>(j) + 0.5));
      vertices.col(i + nx * j) << at, heights.values[static_cast<std::size_t>(i + nx * j)];
    }
  const auto surface = vertices.leftCols(top);
  const Vec<3> lowest = surface.rowwise().minCoeff(), highest = surface.rowwise().maxCoeff();
  const double bottom = lowest[2] - (highest - lowest).head<2>().maxCoeff();
  std::vector<Index> around;  // counterclockwise
  for (Index i = 0; i < nx - 1; ++i) around.push_back(i);
  for (Index j = 0; j < ny - 1; ++j) around.push_back(nx - 1 + nx * j);
  for (Index i = nx - 1; i > 0; --i) around.push_back(i + nx * (ny - 1));
  for (Index j = ny - 1; j > 0; --j) around.push_back(nx * j);
  for (Index k = 0; k < rim; ++k) vertices.col(top + k) << vertices.col(around[k]).head<2>(), bottom;
  vertices.col(top + rim) << 0.5 * (lowest + highest).head<2>(), bottom;
  std::vector<std::array<Index, 3>> triangles;
  for (Index j = 0; j < ny - 1; ++j)
    for (Index i = 0; i < nx - 1; ++i) {
      const Index a = i + nx * j, b = a + 1, c = b + nx, d = a + nx;
      triangles.push_back({a, b, c});
      triangles.push_back({a, c, d});
    }
  for (Index k = 0; k < rim; ++k) {
    const Index next = (k + 1) % rim, a = top + k, b = top + next, c = around[next], d = around[k];
    triangles.push_back({a, b, c});
    triangles.push_back({a, c, d});
    triangles.push_back({b, a, top + rim});
  }
  Facets<3> facets(3, static_cast<Index>(triangles.size()));
  for (Index f = 0; f < facets.cols(); ++f)
    for (int i = 0; i < 3; ++i) facets(i, f) = triangles[static_cast<std::size_t>(f)][static_cast<std::size_t>(i)];
  return solid<3>(vertices, facets);
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
