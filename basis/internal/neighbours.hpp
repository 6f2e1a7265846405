// SPDX-License-Identifier: GPL-3.0-or-later
/// Which points are near, by a k-d tree (nanoflann).
#pragma once

#include "efree/core/types.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nanoflann.hpp>
#include <vector>

namespace efree::internal {

/// A tree of points, which are copied.
template <int Dim> class Neighbours {
 public:
  /// Forgets all there was. Cost n log n.
  void build(const Points<Dim>& points) {
    points_.points = points;
    tree_ = std::make_unique<Tree>(Dim, points_, nanoflann::KDTreeSingleIndexAdaptorParams(16));
  }
  const Points<Dim>& points() const { return points_.points; }
  /// Those not further than r from x, ascending.
  void within(const Vec<Dim>& x, double r, std::vector<Index>& found) const {
    found.clear();
    Within result{r * r, found};
    tree_->findNeighbors(result, x.data(), nanoflann::SearchParams(32, 0.0f, false));
    std::sort(found.begin(), found.end());
  }
  /// The nearest of all.
  Index nearest(const Vec<Dim>& x) const {
    Index point = 0;
    double distance = 0.0;
    tree_->knnSearch(x.data(), 1, &point, &distance);
    return point;
  }
  /// Mean distance of a point of the tree from the 2 Dim next to it: the spacing, in a lattice as in a cloud.
  double spacing(const Vec<Dim>& x) const {
    constexpr std::size_t count = 2 * Dim + 1;
    std::array<Index, count> point{};
    std::array<double, count> distance{};
    const std::size_t found = tree_->knnSearch(x.data(), count, point.data(), distance.data());
    double sum = 0.0;
    for (std::size_t k = 1; k < found; ++k) sum += std::sqrt(distance[k]);
    return sum / static_cast<double>(found - 1);
  }

 private:
  /// What nanoflann tells its finds to.
  struct Within {
    double r2;
    std::vector<Index>& found;
    std::size_t size() const { return found.size(); }
    bool full() const { return true; }
    double worstDist() const { return r2; }
    bool addPoint(double distance, Index point) {
      if (distance <= r2) found.push_back(point);
      return true;
    }
  };
  struct Cloud {
    Points<Dim> points;
    std::size_t kdtree_get_point_count() const { return static_cast<std::size_t>(points.cols()); }
    double kdtree_get_pt(std::size_t p, std::size_t i) const {
      return points(static_cast<Index>(i), static_cast<Index>(p));
    }
    template <class Box> bool kdtree_get_bbox(Box&) const { return false; }
  };
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, Dim, Index>;

  Cloud points_;
  std::unique_ptr<Tree> tree_;
};

}  // namespace efree::internal
