// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/internal/pushed_points.hpp"

#include "efree/core/parallel.hpp"

namespace efree::internal {
namespace {

/// Velocities of nodes by an impulse on one of them, term by term of the series.
template <int Dim> class UnitImpulse {
 public:
  explicit UnitImpulse(const World<Dim>& world)
      : world_(world), v_(Points<Dim>::Zero(Dim, world.nodes.size())), sum_(v_) {}

  /// Calls visit(node, velocity) for all nodes that it moves, first that one.
  template <class Visit> void apply(Index at, const Visit& visit) {
    const auto& [terms, coupling, free_sum] = world_.consistent_mass;
    const Nodes<Dim>& nodes = world_.nodes;
    const Vec<Dim> impulse = nodes.free.col(at);
    add(at);
    v_.col(at) = impulse / nodes.mass[at];
    const Index count = terms.empty() ? 1 : terms[nodes.body[at]];
    for (Index term = 1; term < count; ++term) {
      for (const Index a : moved_) sum_.col(a) = free_sum.col(a).cwiseProduct(v_.col(a));
      sum_.col(at) += impulse;
      for (std::size_t k = 0, known = moved_.size(); k < known; ++k) {
        const Vec<Dim> v = nodes.free.col(moved_[k]).cwiseProduct(v_.col(moved_[k]));
        for (SparseRows::InnerIterator entry(coupling, moved_[k]); entry; ++entry) {
          add(entry.col());
          sum_.col(entry.col()) -= entry.value() * v;
        }
      }
      for (const Index a : moved_) v_.col(a) = nodes.free.col(a).cwiseProduct(sum_.col(a)) / nodes.mass[a];
    }
    for (const Index a : moved_) {
      visit(a, Vec<Dim>(v_.col(a)));
      is_moved_[a] = 0;
      v_.col(a).setZero();
      sum_.col(a).setZero();
    }
    moved_.clear();
  }

 private:
  void add(Index node) {
    if (std::exchange(is_moved_[node], 1) == 0) moved_.push_back(node);
  }

  const World<Dim>& world_;
  Points<Dim> v_, sum_;  // zero where nothing moves
  std::vector<char> is_moved_ = std::vector<char>(static_cast<std::size_t>(world_.nodes.size()), 0);
  std::vector<Index> moved_;
};

}  // namespace

template <int Dim> bool InverseMass<Dim>::follow(const World<Dim>& world) {
  const Nodes<Dim>& nodes = world.nodes;
  if (mass_.size() == nodes.size() && mass_ == nodes.mass && free_ == nodes.free) return false;
  mass_ = nodes.mass;
  free_ = nodes.free;
  rows_.assign(static_cast<std::size_t>(nodes.size()), {});
  is_on_surface_.assign(rows_.size(), 0);
  const SparseRows& shape = world.surface_points.shape;
  for (Index s = 0; s < shape.rows(); ++s)
    for (SparseRows::InnerIterator entry(shape, s); entry; ++entry) is_on_surface_[entry.col()] = 1;
  return true;
}

template <int Dim> void InverseMass<Dim>::find(const World<Dim>& world, const std::vector<Index>& nodes) {
  std::vector<Index> missing;
  for (const Index a : nodes)
    if (rows_[a].empty()) missing.push_back(a);
  parallel_chunks(static_cast<Index>(missing.size()), 16, [&](Index begin, Index end) {
    UnitImpulse<Dim> impulse(world);
    for (Index k = begin; k < end; ++k)
      impulse.apply(missing[k], [&, &row = rows_[missing[k]]](Index a, const Vec<Dim>& v) {
        if (is_on_surface_[a]) row.push_back({a, v});
      });
  });
}

template class InverseMass<2>;
template class InverseMass<3>;

}  // namespace efree::internal
