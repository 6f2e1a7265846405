// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/internal/facet_samples.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

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

template Points<2> sample_boundary(const FineMesh<2>&, double);
template Points<3> sample_boundary(const FineMesh<3>&, double);
template Points<2> sample_facets(const FineMesh<2>&, const std::vector<Index>&, double);
template Points<3> sample_facets(const FineMesh<3>&, const std::vector<Index>&, double);

}  // namespace efree::internal
