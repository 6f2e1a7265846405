// SPDX-License-Identifier: GPL-3.0-or-later
/// Points of surfaces that are no nodes, and how impulses move them.
#pragma once

#include "efree/core/parallel.hpp"
#include "efree/dynamics/masses.hpp"

#include <vector>

namespace efree::internal {

/// Rows of the inverse mass (the series of find_velocities) for nodes that points of a surface move, each computed once
/// when it is asked for first: contact multiplies by few of them many times.
template <int Dim> class InverseMass {
 public:
  /// What an impulse of one along every axis changes of a node's velocity along it [1/mass].
  struct Entry {
    Index node;
    Vec<Dim> value;
  };
  /// Forgets all rows if masses or supports are no longer those with which they were computed, and says so.
  bool follow(const World<Dim>& world);
  /// Computes rows of these nodes that are not known.
  void find(const World<Dim>& world, const std::vector<Index>& nodes);
  /// Entries of nodes that points of a surface move, first the node itself.
  const std::vector<Entry>& row(Index node) const { return rows_[node]; }

 private:
  std::vector<std::vector<Entry>> rows_;  ///< by node; empty: not known
  std::vector<char> is_on_surface_;       ///< by node, 1: points of a surface move with it
  Vector mass_;                           ///< of the nodes, with which rows were computed
  Points<Dim> free_;                      ///< likewise
};

/// Velocities of surface points near a rigid body by impulses on these. Both have R components: one along a normal, or
/// all along the axes.
template <int R> class PushedPoints {
 public:
  using Values = Points<R>;

  /// normal: the one along which impulses of one component are.
  template <int Dim> PushedPoints(const World<Dim>& world, InverseMass<Dim>& inverse, const std::vector<Index>& near,
                                  const Vec<Dim>& normal) {
    std::vector<Index> number(world.nodes.size(), -1), nodes;
    shape_.resize(static_cast<Index>(near.size()), world.nodes.size());
    for (std::size_t s = 0; s < near.size(); ++s) {
      shape_.startVec(static_cast<Index>(s));
      for (SparseRows::InnerIterator entry(world.surface_points.shape, near[s]); entry; ++entry) {
        if (number[entry.col()] < 0) {
          number[entry.col()] = static_cast<Index>(nodes.size());
          nodes.push_back(entry.col());
        }
        shape_.insertBackByOuterInnerUnordered(static_cast<Index>(s), number[entry.col()]) = entry.value();
      }
    }
    shape_.finalize();
    shape_.conservativeResize(shape_.rows(), static_cast<Index>(nodes.size()));
    shape_of_nodes_ = shape_.transpose();
    inverse.find(world, nodes);
    for (const Index a : nodes) {
      for (const auto& [node, value] : inverse.row(a)) {
        if (number[node] < 0) continue;
        if constexpr (R == 1)
          inverse_.push_back({number[node], Vec<1>(normal.cwiseAbs2().dot(value))});
        else
          inverse_.push_back({number[node], value});
      }
      ends_.push_back(inverse_.size());
    }
    // Gershgorin's circles.
    Vector sums = shape_.cwiseAbs().transpose() * Vector::Ones(size()), bounds = Vector::Zero(sums.size());
    for (std::size_t k = 0, e = 0; k < ends_.size(); ++k)
      for (; e < ends_[k]; ++e) bounds[k] += inverse_[e].value.cwiseAbs().maxCoeff() * sums[inverse_[e].node];
    bounds_ = shape_.cwiseAbs() * bounds;
  }

  Index size() const { return shape_.rows(); }
  /// By point, bounds of the matrix from impulses to velocities (Gershgorin's circles).
  const Vector& bounds() const { return bounds_; }

  /// Velocities of the points by impulses on them; see velocities_of.
  Values velocities(const Values& impulses) const {
    const auto n = static_cast<Index>(ends_.size());
    Values on_nodes(R, n), of_nodes(R, n), of_points(R, size());
    parallel_for(n, [&](Index k) { on_nodes.col(k) = row_times<R>(shape_of_nodes_, k, impulses); });
    parallel_chunks(n, rows_at_once, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        std::size_t e = k == 0 ? 0 : ends_[k - 1];
        Vec<R> even = Vec<R>::Zero(), odd = even;  // an addition waits for the one before it
        for (; e + 1 < ends_[k]; e += 2) {
          even += inverse_[e].value.cwiseProduct(on_nodes.col(inverse_[e].node));
          odd += inverse_[e + 1].value.cwiseProduct(on_nodes.col(inverse_[e + 1].node));
        }
        if (e < ends_[k]) even += inverse_[e].value.cwiseProduct(on_nodes.col(inverse_[e].node));
        of_nodes.col(k) = even + odd;
      }
    });
    parallel_for(size(), [&](Index s) { of_points.col(s) = row_times<R>(shape_, s, of_nodes); });
    return of_points;
  }

 private:
  struct Entry {
    Index node;
    Vec<R> value;
  };
  static constexpr Index rows_at_once = 16;  // of the inverse mass: a microsecond of work

  SparseRows shape_;            // points x nodes, these numbered among themselves
  SparseRows shape_of_nodes_;   // its transpose
  std::vector<Entry> inverse_;  // of the mass, node by node
  std::vector<std::size_t> ends_;
  Vector bounds_;
};

}  // namespace efree::internal
