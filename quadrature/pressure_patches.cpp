// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/quadrature/internal/pressure_patches.hpp"

#include "efree/core/internal/groups.hpp"
#include "efree/core/internal/spectrum.hpp"
#include "efree/core/parallel.hpp"
#include "efree/heatgeo/geodesics.hpp"
#include "efree/quadrature/internal/regular_simplex.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <queue>
#include <span>
#include <utility>

namespace efree::internal {
namespace {

Index number_of_patches(const std::vector<Index>& patch_of) {
  return 1 + *std::ranges::max_element(patch_of);
}

/// How many nodes each patch holds: integrals of the size of their functions over it, as shares of those over the body.
template <int Dim>
Vector nodes_held(const Discretization<Dim>& points, const std::vector<Index>& patch_of, Index patches) {
  Vector whole = Vector::Zero(points.shape.num_nodes()), held = Vector::Zero(patches);
  const auto for_each = [&](const auto& visit) {
    for (Index K = 0; K < points.size(); ++K) {
      const auto row = points.shape.row(K);
      for (std::size_t k = 0; k < row.nodes.size(); ++k) visit(K, row.nodes[k], points.weights[K] * row.N[k]);
    }
  };
  for_each([&](Index, Index I, double part) { whole[I] += std::abs(part); });
  for_each([&](Index K, Index I, double part) {
    if (whole[I] > 0.0) held[patch_of[K]] += std::abs(part) / whole[I];
  });
  return held;
}

/// By patch the patches beside it, with about the surface between the two.
template <int Dim>
std::vector<std::map<Index, double>> surfaces_between(const FineMesh<Dim>& mesh, const SecondaryBasis<Dim>& secondary,
                                                      const std::vector<Index>& patch_of, Index patches) {
  const auto per_cell = static_cast<Index>(secondary.rule.weights.size());
  // Of the function that is largest there.
  const auto patch_at = [&](Index c) {
    double largest = 0.0;
    Index of = 0;
    for (Index g = c * per_cell; g < (c + 1) * per_cell; ++g)
      for (SparseRows::InnerIterator entry(secondary.in_cells, g); entry; ++entry)
        if (entry.value() > largest) largest = entry.value(), of = static_cast<Index>(entry.col());
    return patch_of[of];
  };
  std::vector<std::map<Index, double>> shared(patches);
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int i = 0; i <= Dim; ++i) {
      const Index other = mesh.neighbour(i, c);
      if (other < 0 || mesh.region(other) != mesh.region(c)) continue;
      const Index a = patch_at(c), b = patch_at(other);
      if (a == b) continue;
      const double facet = std::pow(mesh.volume(c), (Dim - 1.0) / Dim);
      shared[a][b] += facet;
      shared[b][a] += facet;
    }
  return shared;
}

/// Merges patches of fewer than `fewest` nodes with the neighbour that they share most of their surface with, the
/// smallest first. Seeds on the boundary, in corners above all, get such patches, whose pressures too few displacements
/// work on: the smallest inf-sup value of a cloud is theirs.
template <int Dim> void merge_small(const FineMesh<Dim>& mesh, const SecondaryBasis<Dim>& secondary,
                                    const Quadrature<Dim>& quadrature, double fewest, std::vector<Index>& patch_of) {
  const Index patches = number_of_patches(patch_of);
  Vector held = nodes_held(quadrature, patch_of, patches);
  auto shared = surfaces_between(mesh, secondary, patch_of, patches);
  std::vector<Index> into(patches);
  std::iota(into.begin(), into.end(), 0);
  using Small = std::pair<double, Index>;
  std::priority_queue<Small, std::vector<Small>, std::greater<>> small;
  for (Index g = 0; g < patches; ++g)
    if (held[g] < fewest) small.emplace(held[g], g);
  while (!small.empty()) {
    const auto [then, g] = small.top();
    small.pop();
    if (into[g] != g || held[g] != then || shared[g].empty()) continue;
    const Index to = std::ranges::max_element(shared[g], {}, [](const auto& other) { return other.second; })->first;
    into[g] = to;
    held[to] += held[g];
    if (held[to] < fewest) small.emplace(held[to], to);
    for (const auto& [other, surface] : shared[g]) {
      shared[other].erase(g);
      if (other == to) continue;
      shared[other][to] += surface;
      shared[to][other] += surface;
    }
    shared[g].clear();
  }
  std::vector<Index> number(patches, -1);
  Index left = 0;
  for (Index& g : patch_of) {
    while (into[g] != g) g = into[g];
    if (number[g] < 0) number[g] = left++;
    g = number[g];
  }
}

/// By point the number of the patch that `key` of its vertex stands for, in the order of the points.
template <class Key> std::vector<Index> numbered(const std::vector<Index>& vertices, Index keys, const Key& key) {
  std::vector<Index> numbers(keys, -1), patch_of;
  Index patches = 0;
  for (const Index v : vertices) {
    Index& number = numbers[key(v)];
    if (number < 0) number = patches++;
    patch_of.push_back(number);
  }
  return patch_of;
}

/// L^-1 (x - c) of these points, with their centroid c and covariance L L^T; none where they are (nearly) in a plane.
template <int Dim> std::optional<Points<Dim>> whitened(const Discretization<Dim>& points, std::span<const Index> of) {
  const auto size = static_cast<Index>(of.size());
  Vector weights(size);
  for (Index k = 0; k < size; ++k) weights[k] = points.weights[of[k]];
  weights /= weights.sum();
  Points<Dim> x = points.points(Eigen::all, of);
  x.colwise() -= Vec<Dim>(x * weights);
  const Points<Dim> scaled = x * weights.cwiseSqrt().asDiagonal();
  const Mat<Dim> root = triangular_factor(scaled.transpose());
  constexpr double flat = 1e-3;  // of the largest extent
  const auto extents = root.diagonal().cwiseAbs();
  if (!(extents.minCoeff() > flat * extents.maxCoeff())) return std::nullopt;
  root.transpose().template triangularView<Eigen::Lower>().solveInPlace(x);
  return x;
}

}  // namespace

template <int Dim> std::vector<Index> patches_around(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& seeds,
                                                     const SecondaryBasis<Dim>& secondary,
                                                     const Quadrature<Dim>& quadrature, double fewest) {
  const NearestSource owner = nearest_source(mesh, seeds.vertices);
  auto patch_of = numbered(secondary.vertices, seeds.size(), [&](Index v) { return owner.source[v]; });
  merge_small(mesh, secondary, quadrature, fewest, patch_of);
  return patch_of;
}

template <int Dim> std::vector<Index> patches_of_clusters(const SecondaryBasis<Dim>& secondary) {
  return numbered(secondary.vertices, 1 + *std::ranges::max_element(secondary.vertices), std::identity{});
}

SparseRows constant_pressures(const std::vector<Index>& patch_of) {
  return indicators(patch_of, number_of_patches(patch_of));
}

template <int Dim>
SparseRows linear_pressures(const Discretization<Dim>& points, const std::vector<Index>& patch_of, double fewest) {
  const Index patches = number_of_patches(patch_of);
  const Ragged<Index> members = members_of(patch_of, patches);
  const Vector held = nodes_held(points, patch_of, patches);
  const double enough = (1.0 - 1e-9) * fewest;  // sums in another order
  std::vector<std::optional<Points<Dim>>> places(patches);
  parallel_for(patches, [&](Index g) {
    if (held[g] >= enough && members[g].size() >= 2 * (Dim + 1)) places[g] = whitened(points, members[g]);
  });
  std::vector<Index> first(patches + 1, 0);
  for (Index g = 0; g < patches; ++g) first[g + 1] = first[g] + (places[g] ? Dim + 1 : 1);
  std::vector<Index> cursor(patches, 0), columns, offsets{0};
  std::vector<double> values;
  const auto corners = regular_simplex<Dim>();
  for (const Index g : patch_of) {
    const Index k = cursor[g]++;
    for (Index j = 0; j < first[g + 1] - first[g]; ++j) {
      columns.push_back(first[g] + j);
      values.push_back(places[g] ? (1.0 + corners.col(j).dot(places[g]->col(k))) / (Dim + 1) : 1.0);
    }
    offsets.push_back(static_cast<Index>(columns.size()));
  }
  return from_rows(first[patches], offsets, columns, values);
}

template std::vector<Index> patches_around<2>(const FineMesh<2>&, const NodeCloud<2>&, const SecondaryBasis<2>&,
                                              const Quadrature<2>&, double);
template std::vector<Index> patches_around<3>(const FineMesh<3>&, const NodeCloud<3>&, const SecondaryBasis<3>&,
                                              const Quadrature<3>&, double);
template std::vector<Index> patches_of_clusters<2>(const SecondaryBasis<2>&);
template std::vector<Index> patches_of_clusters<3>(const SecondaryBasis<3>&);
template SparseRows linear_pressures<2>(const Discretization<2>&, const std::vector<Index>&, double);
template SparseRows linear_pressures<3>(const Discretization<3>&, const std::vector<Index>&, double);

}  // namespace efree::internal
