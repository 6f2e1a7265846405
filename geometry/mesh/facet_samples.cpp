// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/internal/facet_samples.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

namespace efree::internal {

template <int Dim>
Points<Dim> sample_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets, double apart) {
  std::vector<Vec<Dim>> samples;
  std::vector<Index> corners;
  std::vector<std::array<Index, 2>> edges;
  const auto parts = [&](double length) { return std::max(1, static_cast<int>(std::ceil(length / apart))); };
  for (const Index f : facets) {
    std::array<Vec<Dim>, Dim> x;
    double longest = 0.0;
    for (int i = 0; i < Dim; ++i) {
      const Index a = mesh.facets()(i, f), b = mesh.facets()((i + 1) % Dim, f);
      corners.push_back(a);
      edges.push_back({std::min(a, b), std::max(a, b)});
      x[i] = mesh.vertex(a);
      longest = std::max(longest, (mesh.vertex(a) - mesh.vertex(b)).norm());
    }
    if constexpr (Dim == 3) {
      const int n = parts(longest);
      for (int a = 1; a < n; ++a)
        for (int b = 1; a + b < n; ++b) samples.emplace_back((a * x[0] + b * x[1] + (n - a - b) * x[2]) / n);
    }
  }
  // Edges once, and to the bit the same whichever facet they are of.
  std::ranges::sort(edges);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  for (const auto& [a, b] : edges) {
    const int n = parts((mesh.vertex(a) - mesh.vertex(b)).norm());
    for (int k = 1; k < n; ++k) samples.emplace_back((k * mesh.vertex(a) + (n - k) * mesh.vertex(b)) / n);
  }
  for (const Index v : corners) samples.emplace_back(mesh.vertex(v));
  // Both sides of a slit have the same coordinates.
  std::ranges::sort(samples, [](const Vec<Dim>& x, const Vec<Dim>& y) {
    return std::lexicographical_compare(x.begin(), x.end(), y.begin(), y.end());
  });
  samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
  Points<Dim> result(Dim, static_cast<Index>(samples.size()));
  for (std::size_t s = 0; s < samples.size(); ++s) result.col(static_cast<Index>(s)) = samples[s];
  return result;
}

template <int Dim> Points<Dim> sample_boundary(const FineMesh<Dim>& mesh, double apart) {
  std::vector<Index> all(mesh.num_facets());
  std::iota(all.begin(), all.end(), 0);
  return sample_facets(mesh, all, apart);
}

template <int Dim> CutFacets<Dim> cut_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets, double size) {
  double longest = 0.0;
  for (const Index f : facets)
    for (int i = 0; i < Dim; ++i)
      longest =
          std::max(longest, (mesh.vertex(mesh.facets()(i, f)) - mesh.vertex(mesh.facets()((i + 1) % Dim, f))).norm());
  const int n = std::max(1, static_cast<int>(std::ceil(longest / size * (1.0 - 1e-12))));
  // Weights of vertices of the mesh, which sum up to n.
  std::map<std::vector<std::pair<Index, int>>, Index> numbers;
  std::vector<Vec<Dim>> places;
  std::vector<Index> corners;
  const auto vertex = [&](Index f, const std::array<int, Dim>& weights) {
    std::vector<std::pair<Index, int>> key;
    for (int i = 0; i < Dim; ++i)
      if (weights[i] > 0) key.emplace_back(mesh.facets()(i, f), weights[i]);
    std::ranges::sort(key);
    const auto [found, is_new] = numbers.try_emplace(key, static_cast<Index>(places.size()));
    if (is_new) {
      places.push_back(Vec<Dim>::Zero());
      for (const auto& [of, weight] : key) places.back() += weight * mesh.vertex(of);
      if (n > 1) places.back() /= n;
    }
    corners.push_back(found->second);
  };
  for (const Index f : facets) {
    if constexpr (Dim == 2) {
      for (int k = 0; k < n; ++k) vertex(f, {n - k, k}), vertex(f, {n - k - 1, k + 1});
    } else {
      for (int i = 0; i < n; ++i)
        for (int j = 0; i + j < n; ++j) {
          const int k = n - i - j;
          vertex(f, {k, i, j}), vertex(f, {k - 1, i + 1, j}), vertex(f, {k - 1, i, j + 1});
          if (k > 1) vertex(f, {k - 1, i + 1, j}), vertex(f, {k - 2, i + 1, j + 1}), vertex(f, {k - 1, i, j + 1});
        }
    }
  }
  CutFacets<Dim> result{Points<Dim>(Dim, std::ssize(places)), Facets<Dim>(Dim, std::ssize(corners) / Dim)};
  for (Index v = 0; v < std::ssize(places); ++v) result.vertices.col(v) = places[v];
  std::ranges::copy(corners, result.facets.reshaped().begin());
  return result;
}

template CutFacets<2> cut_facets(const FineMesh<2>&, const std::vector<Index>&, double);
template CutFacets<3> cut_facets(const FineMesh<3>&, const std::vector<Index>&, double);
template Points<2> sample_boundary(const FineMesh<2>&, double);
template Points<3> sample_boundary(const FineMesh<3>&, double);
template Points<2> sample_facets(const FineMesh<2>&, const std::vector<Index>&, double);
template Points<3> sample_facets(const FineMesh<3>&, const std::vector<Index>&, double);

}  // namespace efree::internal
