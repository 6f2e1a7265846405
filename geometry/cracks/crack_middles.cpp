// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cracks/internal/crack_middles.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// A middle of these vertices, with equal weights.
template <int Dim, class Vertices, class IsCut>
CrackMiddle<Dim> middle_of(const Vertices& vertices, const IsCut& is_cut) {
  CrackMiddle<Dim> middle;
  middle.size = static_cast<int>(vertices.size());
  for (int i = 0; i < middle.size; ++i) {
    middle.vertices[i] = vertices[static_cast<std::size_t>(i)];
    middle.weights[i] = 1.0 / middle.size;
    middle.group[i] = i;
  }
  for (int i = 0; i < middle.size; ++i)
    for (int j = 0; j < i; ++j)
      if (!is_cut(i, j)) {
        const int first = std::min(middle.group[i], middle.group[j]),
                  second = std::max(middle.group[i], middle.group[j]);
        std::ranges::replace(middle.group, second, first);
      }
  std::array<int, Dim + 1> number{};
  for (int i = 0; i < middle.size; ++i) {
    if (middle.group[i] == i) number[i] = middle.groups++;
    middle.group[i] = number[middle.group[i]];
  }
  return middle;
}

/// The area vector of a simplex of a crack (in the plane the length across it).
Vec<2> area_vector(const std::array<Vec<2>, 2>& x) {
  return {x[1][1] - x[0][1], x[0][0] - x[1][0]};
}
Vec<3> area_vector(const std::array<Vec<3>, 3>& x) {
  return 0.5 * (x[1] - x[0]).cross(x[2] - x[0]);
}
/// How it changes as its corners move.
Vec<2> area_rate(const std::array<Vec<2>, 2>&, const std::array<Vec<2>, 2>& rate) {
  return area_vector(rate);
}
Vec<3> area_rate(const std::array<Vec<3>, 3>& x, const std::array<Vec<3>, 3>& rate) {
  return 0.5 * ((rate[1] - rate[0]).cross(x[2] - x[0]) + (x[1] - x[0]).cross(rate[2] - rate[0]));
}

}  // namespace

template <int Dim> Index CrackMiddles<Dim>::add(const CrackMiddle<Dim>& middle, const std::vector<Index>& edges) {
  middles_.push_back(middle);
  edges_.items.insert(edges_.items.end(), edges.begin(), edges.end());
  edges_.close_row();
  const auto number = static_cast<Index>(middles_.size()) - 1;
  place_among_edges(number);
  return number;
}

template <int Dim> CrackMiddles<Dim>::CrackMiddles(const Cells<Dim>& cells, const Skeleton<Dim>& skeleton,
                                                   const std::vector<char>& is_cut) {
  of_edge_.assign(is_cut.size(), -1);
  for (std::size_t e = 0; e < is_cut.size(); ++e)
    if (is_cut[e] != 0)
      of_edge_[e] = add(middle_of<Dim>(skeleton.edges.vertices[e], [](int, int) { return true; }), {});
  of_cell_.assign(cells.cols(), -1);
  if constexpr (Dim == 3) of_face_.assign(skeleton.facets.vertices.size(), -1);
  for (Index c = 0; c < cells.cols(); ++c) {
    std::array<std::array<Index, Dim + 1>, Dim + 1> between{};  // middles, by local vertices
    std::vector<Index> cut_edges;
    for (std::size_t i = 0; i < edges_of_cell<Dim>.size(); ++i) {
      const auto [a, b] = edges_of_cell<Dim>[i];
      const Index middle = of_edge_[skeleton.edge(c, i)];
      between[a][b] = between[b][a] = middle;
      if (middle >= 0) cut_edges.push_back(middle);
    }
    if (cut_edges.empty()) continue;
    std::array<Index, Dim + 1> corners;
    for (int i = 0; i <= Dim; ++i) corners[i] = cells(i, c);
    of_cell_[c] = add(middle_of<Dim>(corners, [&](int i, int j) { return between[i][j] >= 0; }), cut_edges);
    if constexpr (Dim == 2) {
      for (const Index edge : cut_edges) simplices_.push_back({edge, of_cell_[c]});
    } else {
      for (std::size_t i = 0; i < 4; ++i) {
        const std::array<int, 3>& local = facets_of_cell<3>[i];
        std::vector<Index> edges;
        for (int k = 0; k < 3; ++k)
          if (const Index middle = between[local[k]][local[(k + 1) % 3]]; middle >= 0) edges.push_back(middle);
        if (edges.empty()) continue;
        Index& face = of_face_[skeleton.facet(c, i)];
        if (face < 0)
          face = add(middle_of<3>(std::array{corners[local[0]], corners[local[1]], corners[local[2]]},
                                  [&](int a, int b) { return between[local[a]][local[b]] >= 0; }),
                     edges);
        for (const Index edge : edges) simplices_.push_back({edge, face, of_cell_[c]});
      }
    }
  }
}

/// Weights as the mean of its edges' middles.
template <int Dim> void CrackMiddles<Dim>::place_among_edges(Index number) {
  CrackMiddle<Dim>& middle = middles_[number];
  const auto edges = edges_[number];
  if (middle.groups < 2 || edges.empty()) return;
  middle.weights.fill(0.0);
  for (const Index e : edges)
    for (int i = 0; i < middle.size; ++i)
      for (int k = 0; k < 2; ++k)
        if (middles_[e].vertices[k] == middle.vertices[i])
          middle.weights[i] += middles_[e].weights[k] / static_cast<double>(edges.size());
}

template <int Dim> void CrackMiddles<Dim>::smooth(const Points<Dim>& vertices, int sweeps) {
  constexpr double least_weight = 0.01;  // of a vertex on an edge: its piece does not vanish
  // A simplex of little area resists least, relatively, but would hold its corners in line once it had none. So areas
  // below a floor count as this, which sinks from sweep to sweep from the mean to so much of it.
  constexpr double last_floor = 1e-3;
  const double mean = simplices_.empty() ? 0.0 : area(vertices) / static_cast<double>(simplices_.size());

  const auto count = static_cast<Index>(middles_.size());
  Points<Dim> at(Dim, count);
  std::vector<std::vector<Index>> moved(middles_.size());  // by edge: middles of faces and cells that move with its own
  for (Index m = 0; m < count; ++m) {
    at.col(m) = middles_[m].position(vertices);
    for (const Index e : edges_[m])
      if (middles_[m].groups > 1) moved[e].push_back(m);
  }
  // By edge: the simplices of the cells around it, and how far their corners move with its middle.
  struct Neighbour {
    Index simplex;
    std::array<double, Dim> rate;
  };
  std::vector<std::vector<Neighbour>> around(middles_.size());
  for (std::size_t s = 0; s < simplices_.size(); ++s)
    for (const Index e : edges_[simplices_[s].back()]) {
      Neighbour neighbour{static_cast<Index>(s), {}};
      for (int i = 0; i < Dim; ++i) {
        const Index corner = simplices_[s][i];
        const auto of = edges_[corner];
        if (corner == e)
          neighbour.rate[i] = 1.0;
        else if (middles_[corner].groups > 1 && std::ranges::find(of, e) != of.end())
          neighbour.rate[i] = 1.0 / static_cast<double>(of.size());
      }
      around[e].push_back(neighbour);
    }
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    const double floor = mean * std::pow(last_floor, static_cast<double>(sweep) / sweeps);
    for (Index m = 0; m < count && middles_[m].size == 2; ++m) {
      // sum |N + t dN|^2 / (2 |N|) is the area at t = 0, with its slope, and no less than it elsewhere.
      const Vec<Dim> along = vertices.col(middles_[m].vertices[1]) - vertices.col(middles_[m].vertices[0]);
      double slope = 0.0, curvature = 0.0;
      for (const Neighbour& of : around[m]) {
        std::array<Vec<Dim>, Dim> x, rate;
        for (int i = 0; i < Dim; ++i) {
          x[i] = at.col(simplices_[of.simplex][i]);
          rate[i] = of.rate[i] * along;
        }
        const Vec<Dim> N = area_vector(x), dN = area_rate(x, rate);
        const double size = std::max(N.norm(), floor);
        slope += N.dot(dN) / size;
        curvature += dN.squaredNorm() / size;
      }
      if (!(curvature > 0.0)) continue;
      auto& weights = middles_[m].weights;
      weights[1] = std::clamp(weights[1] - slope / curvature, least_weight, 1.0 - least_weight);
      weights[0] = 1.0 - weights[1];
      at.col(m) = middles_[m].position(vertices);
      for (const Index other : moved[m]) {
        place_among_edges(other);
        at.col(other) = middles_[other].position(vertices);
      }
    }
  }
}

template <int Dim> double CrackMiddles<Dim>::area(const Points<Dim>& vertices) const {
  double sum = 0.0;
  for (const auto& simplex : simplices_) {
    std::array<Vec<Dim>, Dim> x;
    for (int i = 0; i < Dim; ++i) x[i] = middles_[simplex[i]].position(vertices);
    sum += area_vector(x).norm();
  }
  return sum;
}

template class CrackMiddles<2>;
template class CrackMiddles<3>;

}  // namespace efree::internal
