// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/splitting.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <algorithm>
#include <map>
#include <numeric>

namespace efree::internal {
namespace {

template <int Dim> constexpr int num_daughters = 1 << Dim;

/// Sum of the squared normal components of Hencky's strain ln V, F = V R.
double squared_normal_strains(const Mat<3>& F) {
  const auto [squares, axes] = spectrum<3>(F * F.transpose());
  const Mat<3> strain = axes * (0.5 * squares.array().log()).matrix().asDiagonal() * axes.transpose();
  return strain.diagonal().squaredNorm();
}

/// Corner k of a square (cube) around the origin.
template <int Dim> Vec<Dim> corner(int k, double edge) {
  Vec<Dim> result;
  for (int i = 0; i < Dim; ++i) result[i] = (k >> i & 1) != 0 ? 0.5 * edge : -0.5 * edge;
  return result;
}

/// Points of a chunk that are due, ascending.
template <int Dim> std::vector<Index> find_due(const World<Dim>& world, const Chunk<Dim>& chunk,
                                               const ParticleSplitting& options, const ParticleSizes& sizes) {
  std::vector<Index> due;
  for (Index p = 0; p < chunk.size(); ++p) {
    const int splits = sizes.splits[world.point_number(chunk, p)];
    if (chunk.is_eroded(p) || splits >= options.levels) continue;
    const double most = options.strain * (splits + 1) * (splits + 1);
    if (squared_normal_strains(chunk.matter.now.gradient(p)) > most) due.push_back(p);
  }
  return due;
}

/// Points that are due get their daughters after them, numbered from `next` on but for the first, which is the parent.
template <int Dim> void split_points(Chunk<Dim>& chunk, const std::vector<Index>& due, Index next) {
  constexpr int daughters = num_daughters<Dim>;
  std::vector<Index> from;
  for (Index p = 0, k = 0; p < chunk.size(); ++p) {
    const bool splits = k < std::ssize(due) && due[k] == p;
    from.insert(from.end(), splits ? daughters : 1, p);
    k += splits ? 1 : 0;
  }
  const std::vector<Index> first = chunk.take(from);
  for (const Index parent : due)
    for (int k = 0; k < daughters; ++k) {
      const Index p = first[parent] + k;
      chunk.matter.volume[p] /= daughters;
      chunk.matter.mass[p] /= daughters;
      if (k > 0) chunk.number[p] = next++;
    }
  chunk.patches.resize(static_cast<std::size_t>(chunk.size()) + 1);
  std::iota(chunk.patches.begin(), chunk.patches.end(), 0);
}

/// Nodes that are due, of a body, get their daughters after the last of the body, in their order.
template <int Dim> void split_nodes(World<Dim>& world, Index body, const std::vector<Index>& due,
                                    const ParticleSplitting& options, ParticleSizes& sizes) {
  constexpr int daughters = num_daughters<Dim>;
  Nodes<Dim>& nodes = world.nodes;
  const Index first = world.first_node[body + 1], count = (daughters - 1) * static_cast<Index>(due.size());
  Points<Dim> at(Dim, count), v(Dim, count);
  Vector spacing(count), smoothing(count), mass(count), radius(count);
  std::vector<std::uint8_t> splits;
  std::vector<WallBits> pressed;
  std::vector<PrescribedVelocity<Dim>> prescribed;
  std::vector<Index> parents;
  for (Index k = 0; const Index a : due) {
    nodes.mass[a] /= daughters;
    const double edge = options.separation * nodes.spacing[a];
    nodes.spacing[a] *= 0.5;
    // As far from a wall as before.
    if (nodes.radius.size() != 0) nodes.radius[a] = std::max(nodes.radius[a] - 0.5 * edge, 0.25 * nodes.radius[a]);
    sizes.smoothing[a] *= options.smoothing;
    ++sizes.splits[a];
    for (int c = 1; c < daughters; ++c, ++k) {
      at.col(k) = nodes.x.col(a) + corner<Dim>(c, edge);
      v.col(k) = nodes.v.col(a);
      spacing[k] = nodes.spacing[a];
      mass[k] = nodes.mass[a];
      radius[k] = nodes.radius.size() != 0 ? nodes.radius[a] : 0.0;
      smoothing[k] = sizes.smoothing[a];
      splits.push_back(sizes.splits[a]);
      pressed.push_back(sizes.pressed[a]);
      parents.push_back(a);
    }
    nodes.x.col(a) += corner<Dim>(0, edge);
  }
  std::multimap<Index, PrescribedVelocity<Dim>> by_node;
  for (const auto& one : world.prescribed) by_node.emplace(one.node, one);
  for (Index k = 0; k < count; ++k)
    for (auto [one, end] = by_node.equal_range(parents[k]); one != end; ++one) {
      prescribed.push_back(one->second);
      prescribed.back().node = first + k;
    }
  world.insert_nodes(body, at, v, spacing);
  nodes.mass.segment(first, count) = mass;
  if (nodes.radius.size() != 0) nodes.radius.segment(first, count) = radius;
  world.prescribed.insert(world.prescribed.end(), prescribed.begin(), prescribed.end());
  Vector all(sizes.smoothing.size() + count);
  all << sizes.smoothing.head(first), smoothing, sizes.smoothing.tail(sizes.smoothing.size() - first);
  sizes.smoothing = std::move(all);
  sizes.splits.insert(sizes.splits.begin() + first, splits.begin(), splits.end());
  sizes.pressed.insert(sizes.pressed.begin() + first, pressed.begin(), pressed.end());
}

/// Chunks that have become large are halved, so that threads have pieces of much the same size; points are along a
/// curve.
template <int Dim> void halve_large_chunks(World<Dim>& world) {
  constexpr Index most = 512;
  for (std::size_t c = 0; c < world.chunks.size(); ++c)
    while (world.chunks[c].size() > most) {
      const Index count = world.chunks[c].size();
      std::vector<Index> rear(static_cast<std::size_t>(count / 2));
      std::iota(rear.begin(), rear.end(), count - count / 2);
      world.split_chunk(c, rear);
    }
}

}  // namespace

template <int Dim> Index split_particles(World<Dim>& world, const ParticleSplitting& options, ParticleSizes& sizes) {
  std::vector<std::vector<Index>> due(world.chunks.size());
  parallel_chunks(static_cast<Index>(due.size()), 1,
                  [&](Index c, Index) { due[c] = find_due(world, world.chunks[c], options, sizes); });
  Index count = 0;
  for (Index b = 0; b < world.num_bodies(); ++b) {
    std::vector<Index> nodes;
    Index next = world.first_node[b + 1] - world.first_node[b];
    for (std::size_t c = 0; c < due.size(); ++c) {
      if (world.chunks[c].body != b || due[c].empty()) continue;
      for (const Index p : due[c]) nodes.push_back(world.first_node[b] + world.chunks[c].number[p]);
      split_points(world.chunks[c], due[c], next);
      next += (num_daughters<Dim> - 1) * static_cast<Index>(due[c].size());
    }
    if (nodes.empty()) continue;
    split_nodes(world, b, nodes, options, sizes);
    count += static_cast<Index>(nodes.size());
  }
  if (count == 0) return 0;
  halve_large_chunks(world);
  world.find_points();
  world.find_free_axes();
  return count;
}

template Index split_particles(World<2>&, const ParticleSplitting&, ParticleSizes&);
template Index split_particles(World<3>&, const ParticleSplitting&, ParticleSizes&);

}  // namespace efree::internal
