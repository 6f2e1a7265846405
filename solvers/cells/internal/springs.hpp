// SPDX-License-Identifier: GPL-3.0-or-later
/// Elastic supports on grids of cells.
#pragma once

#include "efree/core/parallel.hpp"
#include "efree/core/types.hpp"

#include <algorithm>
#include <vector>

namespace efree::internal {

/// What an elastic support does at a node: force = pull - stiffness u, along the axes of the image.
struct NodeSpring {
  std::size_t node;
  Mat<3> stiffness;
  Vec<3> pull;    ///< stiffness times what is prescribed
  double stored;  ///< energy without displacement
};

/// The springs of one elastic support, lumped at the nodes of a grid.
struct SupportSprings {
  std::size_t restraint;
  std::vector<NodeSpring> nodes;  ///< ascending
};

/// All springs on a grid, scaled like its forces. Fields have three components one after the other, each of `size`
/// nodes.
struct Springs {
  std::size_t size = 0;
  std::vector<SupportSprings> supports{};

  /// f += S u. Bitwise the same on any number of threads.
  template <class T> void add_to(const T* u, T* f) const {
    for_nodes([&](const NodeSpring& at) {
      const Vec<3> force = at.stiffness * displacement(u, at.node);
      for (int c = 0; c < 3; ++c) f[c * size + at.node] += static_cast<T>(force[c]);
    });
  }
  /// f += what they pull with at rest.
  void add_pull(double* f) const {
    for_nodes([&](const NodeSpring& at) {
      for (int c = 0; c < 3; ++c) f[c * size + at.node] += at.pull[c];
    });
  }
  /// diagonal += a diagonal that is nowhere less than S.
  void add_bound(float* diagonal) const {
    for_nodes([&](const NodeSpring& at) {
      const Vec<3> bound = at.stiffness.cwiseAbs().rowwise().sum();
      for (int c = 0; c < 3; ++c) diagonal[c * size + at.node] += static_cast<float>(bound[c]);
    });
  }
  /// What they store.
  double energy(const double* u) const {
    double sum = 0.0;
    for (const SupportSprings& of : supports)
      for (const NodeSpring& at : of.nodes) {
        const Vec<3> x = displacement(u, at.node);
        sum += 0.5 * x.dot(at.stiffness * x) - x.dot(at.pull) + at.stored;
      }
    return sum;
  }
  /// The force with which a spring holds its node.
  Vec<3> force(const double* u, const NodeSpring& at) const {
    return at.pull - at.stiffness * displacement(u, at.node);
  }
  /// All of a node together.
  Mat<3> stiffness_at(std::size_t node) const {
    Mat<3> sum = Mat<3>::Zero();
    for (const SupportSprings& of : supports) {
      const auto at = std::ranges::lower_bound(of.nodes, node, {}, &NodeSpring::node);
      if (at != of.nodes.end() && at->node == node) sum += at->stiffness;
    }
    return sum;
  }
  /// Whether some of them pull.
  bool pull() const {
    const auto pulls = [](const NodeSpring& at) { return !at.pull.isZero(0.0); };
    return std::ranges::any_of(supports, [&](const auto& of) { return std::ranges::any_of(of.nodes, pulls); });
  }

 private:
  template <class T> Vec<3> displacement(const T* u, std::size_t node) const {
    return Vec<3>(u[node], u[size + node], u[2 * size + node]);
  }
  template <class F> void for_nodes(const F& f) const {
    for (const SupportSprings& of : supports)
      parallel_chunks(static_cast<Index>(of.nodes.size()), 1 << 13, [&](Index begin, Index end) {
        for (Index n = begin; n < end; ++n) f(of.nodes[n]);
      });
  }
};

}  // namespace efree::internal
