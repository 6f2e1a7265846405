// SPDX-License-Identifier: GPL-3.0-or-later
/// Boxes in a tree, by Boost.Geometry.
#pragma once

#include "efree/core/types.hpp"

#include <boost/geometry.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <utility>

namespace efree::internal {

template <int Dim> using BoxCorner = boost::geometry::model::point<double, Dim, boost::geometry::cs::cartesian>;
template <int Dim> BoxCorner<Dim> box_corner(const Vec<Dim>& x) {
  if constexpr (Dim == 2)
    return {x[0], x[1]};
  else
    return {x[0], x[1], x[2]};
}

template <int Dim> using Box = boost::geometry::model::box<BoxCorner<Dim>>;
template <int Dim> Box<Dim> box_between(const Vec<Dim>& low, const Vec<Dim>& high) {
  return {box_corner<Dim>(low), box_corner<Dim>(high)};
}

/// A box and the number of what is in it.
template <int Dim> using BoxEntry = std::pair<Box<Dim>, Index>;
/// Packed where it is made of all entries at once.
template <int Dim> using BoxTree = boost::geometry::index::rtree<BoxEntry<Dim>, boost::geometry::index::linear<16>>;

}  // namespace efree::internal
