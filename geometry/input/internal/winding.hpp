// SPDX-License-Identifier: GPL-3.0-or-later
/// How often triangles wind around a point.
#pragma once

#include "efree/geometry/input/internal/oriented_triangles.hpp"

namespace efree::internal {

/// Generalised winding numbers (Jacobson, Kavan & Sorkine-Hornung 2013) by a tree of clusters: far triangles count by
/// the clusters they are in (Barill, Dickson, Schmidt, Levin & Jacobson 2018; first order), right to 0.01.
class Winding {
 public:
  /// Triangles that face outward; one at least.
  explicit Winding(std::vector<Triangle> triangles);
  /// 1 inside a closed surface, 0 outside, in between near holes. Thread-safe.
  double operator()(const Vec<3>& q) const;

 private:
  struct Cluster {
    Vec<3> centre, dipole;  ///< area times normal
    double radius;
    Index begin, end;  ///< its triangles
    Index after;       ///< the cluster that follows all within this one
  };
  void build(Index begin, Index end);

  std::vector<Triangle> triangles_;
  std::vector<Cluster> clusters_;  ///< each before those within it
};

}  // namespace efree::internal
