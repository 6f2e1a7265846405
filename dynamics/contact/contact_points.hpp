// SPDX-License-Identifier: GPL-3.0-or-later
/// Points of the surface of bodies near a rigid one, where nodes are not on it and come and go.
#pragma once

#include "efree/dynamics/contact/rigid_body.hpp"

#include <span>
#include <utility>
#include <vector>

namespace efree {

/// Points with their gaps to one rigid body, and the nodes that move them.
template <int Dim> class ContactPoints {
 public:
  struct Point {
    Index number;  ///< that no other has, and the same in the next step
    Vec<Dim> at;
    Gap<Dim> gap;
    std::size_t begin;  ///< of its nodes
  };
  void begin_point(Index number, const Vec<Dim>& at, const Gap<Dim>& gap) {
    points_.push_back({number, at, gap, nodes_.size()});
  }
  /// A node of the last point, and its shape function there.
  void add_node(Index node, double N) { nodes_.emplace_back(node, N); }
  /// Shape functions of the last point sum up to one; it goes if it has no nodes.
  void end_point() {
    if (points_.back().begin == nodes_.size()) return points_.pop_back();
    double sum = 0.0;
    for (std::size_t k = points_.back().begin; k < nodes_.size(); ++k) sum += nodes_[k].second;
    for (std::size_t k = points_.back().begin; k < nodes_.size(); ++k) nodes_[k].second /= sum;
  }
  void append(const ContactPoints& others) {
    const std::size_t shift = nodes_.size();
    for (Point point : others.points_) {
      point.begin += shift;
      points_.push_back(point);
    }
    nodes_.insert(nodes_.end(), others.nodes_.begin(), others.nodes_.end());
  }
  const std::vector<Point>& points() const { return points_; }
  std::span<const std::pair<Index, double>> nodes_of(std::size_t k) const {
    const std::size_t end = k + 1 < points_.size() ? points_[k + 1].begin : nodes_.size();
    return std::span(nodes_).subspan(points_[k].begin, end - points_[k].begin);
  }

 private:
  std::vector<Point> points_;
  std::vector<std::pair<Index, double>> nodes_;
};

}  // namespace efree
