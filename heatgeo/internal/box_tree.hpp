// SPDX-License-Identifier: GPL-3.0-or-later
/// Finds what lies near a place, in an order that keeps neighbours together.
#pragma once

#include "efree/core/types.hpp"

#include <Eigen/Geometry>

namespace efree {

/// Boxes in space, halved again and again along the longest side of what their middles span (Bentley 1975). Adapts to
/// sizes that differ from place to place. Immutable.
class BoxTree {
 public:
  using Box = Eigen::AlignedBox3d;

  /// Of nothing.
  BoxTree() = default;
  /// Cost n log n.
  explicit BoxTree(const std::vector<Box>& boxes);

  /// The boxes' numbers, neighbours together.
  const std::vector<Index>& order() const { return order_; }

  /// Calls body(begin, end) for ranges of `order` that together hold every box that meets the open ball, and some
  /// around it. The order is always the same.
  template <class Body> void for_each_near(const Vec<3>& centre, double radius, const Body& body) const {
    const double reach = radius * radius;
    for (std::size_t k = 0; k < nodes_.size();) {
      const Node& node = nodes_[k];
      const bool near = node.box.squaredExteriorDistance(centre) < reach;
      if (near && node.is_leaf) body(node.begin, node.end);
      k = near ? k + 1 : static_cast<std::size_t>(node.skip);
    }
  }

 private:
  struct Node {
    Box box;
    Index begin, end;
    Index skip;  ///< the next node that is not below this one
    bool is_leaf;
  };
  struct Item {
    Vec<3> middle;
    Index number;
  };
  void part(const std::vector<Box>& boxes, std::vector<Item>& items, Index begin, Index end);

  std::vector<Index> order_;
  std::vector<Node> nodes_;  ///< each before those below it
};

}  // namespace efree
