// SPDX-License-Identifier: GPL-3.0-or-later
/// Nodes and points where a body has stretched so far that it has few of them.
#include "efree/otm/internal/motion.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <tuple>
#include <utility>

namespace efree::internal {
namespace {

/// Area of a triangle, over that of a regular one whose edges are the spacing, below which it is not split: where a
/// body has become that much thinner than its spacing nodes would come in and become one over and over. Tetrahedra are
/// slivers from the start, and say nothing of it.
constexpr double least_split = 0.1;

/// The points of `twice`, ascending, become two each: both as they were, functions and all, but of half the volume.
template <int Dim> void halve(OtmChunk<Dim>& chunk, const std::vector<Index>& twice) {
  std::vector<Index> from;
  for (Index p = 0; p < chunk.size(); ++p) {
    const bool is_twice = std::binary_search(twice.begin(), twice.end(), p);
    from.insert(from.end(), is_twice ? 2 : 1, p);
    if (!is_twice) continue;
    chunk.volume[p] *= 0.5;
    chunk.mass[p] *= 0.5;
    chunk.penalty[p] *= 0.5;
  }
  chunk.take(from);
}

/// More columns, before that one.
template <int Dim> void insert(Points<Dim>& columns, Index before, const Points<Dim>& more) {
  if (columns.cols() == 0) return;
  Points<Dim> result(Dim, columns.cols() + more.cols());
  result << columns.leftCols(before), more, columns.rightCols(columns.cols() - before);
  columns = std::move(result);
}
void insert(Vector& values, Index before, const Vector& more) {
  if (values.size() == 0) return;
  Vector result(values.size() + more.size());
  result << values.head(before), more, values.tail(values.size() - before);
  values = std::move(result);
}

/// Facets with both ends of an edge become two, with its middle.
template <int Dim> void split_facets(Facets<Dim>& facets, Index a, Index b, Index middle) {
  for (Eigen::Index f = facets.cols() - 1; f >= 0; --f) {
    const auto has = [&](Index node) { return (facets.col(f).array() == node).any(); };
    if (!has(a) || !has(b)) continue;
    facets.conservativeResize(Eigen::NoChange, facets.cols() + 1);
    facets.rightCols(1) = facets.col(f);
    for (Index& corner : facets.col(f))
      if (corner == b) corner = middle;
    for (Index& corner : facets.rightCols(1).reshaped())
      if (corner == a) corner = middle;
  }
}

}  // namespace

/// Nodes of a body, numbered after those it has; those of later bodies get other numbers. They have no mass yet.
template <int Dim>
void Motion<Dim>::add_nodes(Index body, const Points<Dim>& at, const Points<Dim>& velocity, const Vector& spacings) {
  const Index first = bodies[body + 1].first_node, count = static_cast<Index>(at.cols());
  const auto shift = [&](Index& node) {
    if (node >= first) node += count;
  };
  insert<Dim>(x, first, at);
  insert<Dim>(v, first, velocity);
  insert<Dim>(met, first, at);
  const Points<Dim> nothing = Points<Dim>::Zero(Dim, count);
  for (Points<Dim>* values : {&force, &shaken, &x_rest}) insert<Dim>(*values, first, nothing);
  insert(spacing, first, spacings);
  for (Vector* values : {&mass, &surface_area}) insert(*values, first, Vector(Vector::Zero(count)));
  for (Index& with : merged) shift(with);
  merged.insert(merged.begin() + first, count, -1);
  body_of_node.insert(body_of_node.begin() + first, count, body);
  for (auto& chunk : chunks) std::for_each(chunk.nodes.begin(), chunk.nodes.end(), shift);
  for (auto& one : prescribed) shift(one.node);
  for (auto& cavity : cavities)
    for (Index& corner : cavity.of.facets.reshaped()) shift(corner);
  for (auto& one : touches) {
    shift(one.node);
    for (auto& held : one.patch) shift(held.node);
  }
  for (auto& [node, with] : seized) shift(node);
  for (std::size_t b = body + 1; b < bodies.size(); ++b) bodies[b].first_node += count;
  surfaces.clear();
  approaching.clear();
  seen_at.resize(Dim, 0);
  counts.injected += count;
  changed_nodes = true;
}

/// Edges of sides of which a body has one cell only, as the body numbers its nodes, ascending. They are found when they
/// are asked for after cells have changed.
template <int Dim> const std::vector<std::pair<Index, Index>>& Motion<Dim>::outer_edges(Index of_body) {
  const Cells<Dim>& cells = bodies[of_body].cells;
  std::vector<std::pair<Index, Index>>& edges = bodies[of_body].outer;
  if (!edges.empty()) return edges;
  std::vector<std::array<Index, Dim>> sides;
  sides.reserve((Dim + 1) * static_cast<std::size_t>(cells.cols()));
  for (Eigen::Index c = 0; c < cells.cols(); ++c) {
    std::array<Index, Dim + 1> corners;
    std::copy_n(cells.col(c).data(), Dim + 1, corners.begin());
    std::sort(corners.begin(), corners.end());
    if (std::adjacent_find(corners.begin(), corners.end()) != corners.end()) continue;  // collapsed
    for (int without = 0; without <= Dim; ++without) {
      std::array<Index, Dim>& side = sides.emplace_back();
      std::copy(corners.begin(), corners.begin() + without, side.begin());
      std::copy(corners.begin() + without + 1, corners.end(), side.begin() + without);
    }
  }
  std::sort(sides.begin(), sides.end());
  for (std::size_t k = 0; k < sides.size(); ++k) {
    const auto& side = sides[k];
    if ((k > 0 && sides[k - 1] == side) || (k + 1 < sides.size() && sides[k + 1] == side)) continue;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < i; ++j) edges.emplace_back(side[j], side[i]);
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

/// Edges of a body's cells that are to be split, of no cell two: the longest first, of those longer than
/// OtmOptions::injection times the spacing, of cells that are not too thin, that have no other node near their middle;
/// on the surface no other of it, and nearer, as points between the surface and nodes inside have nothing else to hold
/// on to.
template <int Dim> std::vector<typename Motion<Dim>::Split> Motion<Dim>::overlong_edges(Index of_body) {
  const BodyOf& body = bodies[of_body];
  const Index begin = body.first_node;
  const auto most = [&](Index a, Index b) {
    return 0.5 * options.injection * (spacing[begin + a] + spacing[begin + b]);
  };
  const auto length = [&](Index a, Index b) { return (x.col(begin + a) - x.col(begin + b)).norm(); };
  const auto is_thin = [&](Index c) {
    if (Dim == 3) return false;
    const auto [in, p] = place_of_point[body.first_point + c];
    double edge = 0.0;
    for (const Index corner : body.cells.col(c)) edge += spacing[begin + corner] / (Dim + 1);
    return chunks[in].volume[p] < least_split * std::sqrt(3.0) / 4.0 * edge * edge * across(chunks[in].at(0, p));
  };
  std::map<std::pair<Index, Index>, std::vector<Index>> around;  // by edge, cells
  for (Eigen::Index c = 0; c < body.cells.cols(); ++c) {
    const auto [in, p] = place_of_point[body.first_point + c];
    if (chunks[in].is_eroded(p)) continue;
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j < i; ++j) {
        const std::pair<Index, Index> edge = std::minmax(body.cells(i, c), body.cells(j, c));
        if (edge.first == edge.second || length(edge.first, edge.second) <= most(edge.first, edge.second)) continue;
        std::vector<Index>& cells = around[edge];
        if (cells.empty() || cells.back() != c) cells.push_back(static_cast<Index>(c));
      }
  }
  std::vector<Split> result;
  if (around.empty()) return result;
  std::vector<std::pair<double, std::pair<Index, Index>>> order;
  for (const auto& [edge, cells] : around) order.push_back({-length(edge.first, edge.second), edge});
  std::sort(order.begin(), order.end());
  build_tree(of_body);
  const std::vector<std::pair<Index, Index>>& outer = outer_edges(of_body);
  std::vector<char> on_surface(x.cols(), 0);
  for (const auto& [a, b] : outer) on_surface[a] = on_surface[b] = 1;
  std::vector<char> is_split(static_cast<std::size_t>(body.cells.cols()), 0);
  std::vector<Index> near_by;
  for (const auto& [minus_length, edge] : order) {
    const auto& [a, b] = edge;
    const std::vector<Index>& cells = around[edge];
    if (std::any_of(cells.begin(), cells.end(), [&](Index c) { return is_split[c] != 0 || is_thin(c); })) continue;
    const Vec<Dim> middle = 0.5 * (x.col(begin + a) + x.col(begin + b));
    const bool is_outer = std::binary_search(outer.begin(), outer.end(), edge);
    const double room = (is_outer ? 0.25 : 0.5) * most(a, b);
    trees[of_body]->within(middle, room, near_by);
    if (std::any_of(near_by.begin(), near_by.end(),
                    [&](Index near) { return merged[begin + near] < 0 && (!is_outer || on_surface[near] != 0); }) ||
        std::any_of(result.begin(), result.end(),
                    [&](const Split& other) { return (other.middle - middle).squaredNorm() < room * room; }))
      continue;
    for (const Index c : cells) is_split[c] = 1;
    result.push_back({a, b, middle, cells});
  }
  return result;
}

/// Nodes come into the middle of edges, and cells around them, with their points, become two. Both points keep what
/// the one has felt, so that the energy stored is what it was; momentum and its moment are handed over by `renew`.
template <int Dim> void Motion<Dim>::inject() {
  for (Index b = 0; b + 1 < static_cast<Index>(bodies.size()); ++b) {
    BodyOf& body = bodies[b];
    if (!body.renewed || body.cells.cols() == 0) continue;
    const std::vector<Split> splits = overlong_edges(b);
    if (splits.empty()) continue;
    const Index begin = body.first_node, num_nodes = bodies[b + 1].first_node - begin;
    const auto count = static_cast<Index>(splits.size());
    Points<Dim> at(Dim, count), velocity(Dim, count);
    Vector spacings(count);
    for (Index k = 0; k < count; ++k) {
      const Index ends[] = {begin + splits[k].a, begin + splits[k].b};
      at.col(k) = splits[k].middle;
      velocity.col(k) = 0.5 * (v.col(ends[0]) + v.col(ends[1]));
      spacings[k] = 0.5 * (spacing[ends[0]] + spacing[ends[1]]);
      // Points that see both ends are to see what is between them.
      for (Index place = node_offsets[ends[0]]; place < node_offsets[ends[0] + 1]; ++place) {
        OtmChunk<Dim>& chunk = chunks[node_places[place].first];
        const auto sees = [&](Index p, Index node) {
          return std::any_of(chunk.local.begin() + chunk.offsets[p], chunk.local.begin() + chunk.offsets[p + 1],
                             [&](std::uint16_t local) { return chunk.nodes[local] == node; });
        };
        for (Index p = 0; p < chunk.size(); ++p)
          if (!chunk.is_eroded(p) && sees(p, ends[0]) && sees(p, ends[1])) chunk.wear(p);
      }
    }
    add_nodes(b, at, velocity, spacings);
    std::vector<std::map<Index, std::pair<Index, Vec<Dim>>>> halves(chunks.size());  // point: second number, way
    for (Index k = 0; k < count; ++k) {
      const auto& [a, e, middle, cells] = splits[k];
      const Index fresh = num_nodes + k;
      // It is held as both ends are.
      const std::size_t num_prescribed = prescribed.size();
      for (std::size_t i = 0; i < num_prescribed; ++i)
        for (std::size_t j = 0; j < num_prescribed; ++j)
          if (prescribed[i].node == begin + a && prescribed[j].node == begin + e &&
              prescribed[i].axis == prescribed[j].axis && prescribed[i].velocity == prescribed[j].velocity)
            prescribed.push_back({begin + fresh, prescribed[i].axis, prescribed[i].velocity});
      for (auto& cavity : cavities) split_facets<Dim>(cavity.of.facets, begin + a, begin + e, begin + fresh);
      for (const Index c : cells) {
        const auto [in, p] = place_of_point[body.first_point + c];
        const auto next = static_cast<Index>(body.cells.cols());
        halves[in][p] = {next, (x.col(begin + a) - x.col(begin + e)) / (2 * (Dim + 1))};
        chunks[in].wear(p);
        body.cells.conservativeResize(Eigen::NoChange, next + 1);
        body.cells.col(next) = body.cells.col(c);
        for (Index& corner : body.cells.col(c))
          if (corner == e) corner = fresh;
        for (Index& corner : body.cells.col(next))
          if (corner == a) corner = fresh;
      }
    }
    for (std::size_t c = 0; c < chunks.size(); ++c) {
      if (halves[c].empty()) continue;
      OtmChunk<Dim>& chunk = chunks[c];
      std::vector<Index> twice;
      for (const auto& [p, half] : halves[c]) twice.push_back(p);
      halve(chunk, twice);
      Index before = 0;
      for (const auto& [p, half] : halves[c]) {
        chunk.pairs.push_back({p + before, p + before + 1, half.second});
        chunk.number[p + ++before] = half.first;
      }
    }
    body.outer.clear();
    find_points();
    find_places();
    find_free();
    ball_offsets.clear();
  }
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
