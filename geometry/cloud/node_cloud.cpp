// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cloud/node_cloud.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

namespace efree {
namespace {

/// Boundary facets in the order in which one walks along them, with the body to the left.
struct BoundaryWalk {
  std::vector<Index> next;   // facet that follows facet f
  std::vector<char> breaks;  // whether named parts end or loops meet between facet f and the next
  std::vector<char> turns;   // whether the boundary turns by more than 30 degrees there
};

/// The facet that follows f: turn around its end through the cells. Right also where a vertex joins several loops.
Index next_facet(const FineMesh<2>& mesh, Index f) {
  const Index pivot = mesh.facets()(1, f);
  Index cell = mesh.facet_cell(f), behind = mesh.facets()(0, f);
  while (true) {
    // The edge of the cell at the pivot that is not (behind, pivot) is the one opposite `behind`.
    const auto corners = mesh.cells().col(cell);
    const Index i = corners(0) == behind ? 0 : corners(1) == behind ? 1 : 2;
    const Index across = mesh.neighbour(i, cell);
    const Index ahead = corners(0) + corners(1) + corners(2) - behind - pivot;
    if (across < 0) {
      for (const Index g : mesh.facets_of(pivot))
        if (mesh.facets()(0, g) == pivot && mesh.facets()(1, g) == ahead) return g;
    }
    cell = across;
    behind = ahead;
  }
}

/// Groups of each boundary facet, ascending.
template <int Dim> Ragged<Index> groups_of_facets(const FineMesh<Dim>& mesh) {
  std::vector<std::pair<Index, Index>> pairs;
  for (std::size_t g = 0; g < mesh.groups().size(); ++g)
    for (const Index f : mesh.groups()[g].facets) pairs.push_back({f, static_cast<Index>(g)});
  std::sort(pairs.begin(), pairs.end());
  Ragged<Index> rows;
  auto pair = pairs.begin();
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (; pair != pairs.end() && pair->first == f; ++pair) rows.items.push_back(pair->second);
    rows.close_row();
  }
  return rows;
}

BoundaryWalk walk_boundary(const FineMesh<2>& mesh) {
  const double corner_cosine = std::cos(30.0 * std::numbers::pi / 180.0);
  const Ragged<Index> groups = groups_of_facets(mesh);
  BoundaryWalk walk;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const Index next = next_facet(mesh, f);
    const bool turns = mesh.facet_normal(f).dot(mesh.facet_normal(next)) < corner_cosine;
    const bool joins_loops = mesh.facets_of(mesh.facets()(1, f)).size() != 2;
    const bool changes_group = !std::ranges::equal(groups[f], groups[next]);
    walk.next.push_back(next);
    walk.breaks.push_back(joins_loops || changes_group);
    walk.turns.push_back(turns);
  }
  return walk;
}

/// Which vertices of a loop are corners on the scale of the cloud: the ends of parts, and the turns that a polygon
/// through corners needs to stay within an eighth of the spacing of all turns (Ramer 1972). A staircase of pixels is
/// straight; so is the notch no cloud of this spacing sees. Positions in the loop of the facets that end there,
/// ascending.
class CornerFinder {
 public:
  CornerFinder(const FineMesh<2>& mesh, const Vector& spacing, const BoundaryWalk& walk, std::span<const Index> loop)
      : mesh_(mesh), spacing_(spacing), walk_(walk), loop_(loop) {}

  std::vector<Index> corners() {
    const Index count = static_cast<Index>(loop_.size());
    for (Index k = 0; k < count; ++k)
      if (walk_.breaks[loop_[k]]) corners_.push_back(k);
    if (corners_.empty()) {
      // The turn farthest from the first one is an extreme point: if there are corners, it is one of them.
      Index first = 0;
      while (first < count && !walk_.turns[loop_[first]]) ++first;
      if (first == count) return {};
      corners_.push_back(farthest(first, first + count).position % count);
    }
    const std::size_t known = corners_.size();
    for (std::size_t i = 0; i < known; ++i) refine(corners_[i], i + 1 < known ? corners_[i + 1] : corners_[0] + count);
    for (Index& k : corners_) k %= count;
    std::sort(corners_.begin(), corners_.end());
    return corners_;
  }

 private:
  struct Farthest {
    Index position;
    double distance = 0.0;
  };
  Index vertex(Index k) const { return mesh_.facets()(1, loop_[k % static_cast<Index>(loop_.size())]); }

  /// The turn strictly between two positions that is farthest from the segment through both; `begin` if there is none.
  Farthest farthest(Index begin, Index end) const {
    Farthest result{begin};
    const Vec<2> from = mesh_.vertex(vertex(begin)), along = mesh_.vertex(vertex(end)) - from;
    const double length2 = along.squaredNorm();
    for (Index k = begin + 1; k < end; ++k) {
      if (!walk_.turns[loop_[k % static_cast<Index>(loop_.size())]]) continue;
      const Vec<2> x = mesh_.vertex(vertex(k)) - from;
      const double t = length2 > 0.0 ? std::clamp(x.dot(along) / length2, 0.0, 1.0) : 0.0;
      if (const double distance = (x - t * along).norm(); distance > result.distance) result = {k, distance};
    }
    return result;
  }
  void refine(Index begin, Index end) {
    std::vector<std::pair<Index, Index>> stack{{begin, end}};
    while (!stack.empty()) {
      const auto [from, to] = stack.back();
      stack.pop_back();
      const Farthest found = farthest(from, to);
      if (found.distance <= 0.125 * spacing_[vertex(found.position)]) continue;
      corners_.push_back(found.position);
      stack.push_back({from, found.position});
      stack.push_back({found.position, to});
    }
  }

  const FineMesh<2>& mesh_;
  const Vector& spacing_;
  const BoundaryWalk& walk_;
  std::span<const Index> loop_;
  std::vector<Index> corners_;
};

/// Puts nodes on a chain of facets that runs between two corners (or all around a loop): both ends, and in between the
/// vertices nearest to equal steps of the integral of ds/spacing, at least `intervals` of them as far as vertices go.
void place_on_chain(const FineMesh<2>& mesh, const Vector& spacing, std::span<const Index> chain, Index intervals,
                    std::vector<char>& is_node) {
  const Index count = static_cast<Index>(chain.size());
  std::vector<double> along(count + 1, 0.0);
  for (Index k = 0; k < count; ++k) {
    const Index a = mesh.facets()(0, chain[k]), b = mesh.facets()(1, chain[k]);
    along[k + 1] = along[k] + mesh.facet_measure(chain[k]) * 2.0 / (spacing[a] + spacing[b]);
  }
  // A chain that is a whole number of spacings long up to rounding gets that number.
  const double wanted = std::max(static_cast<double>(intervals), std::ceil(along[count] * (1.0 - 1e-9)));
  intervals = wanted < count ? static_cast<Index>(wanted) : count;
  Index vertex = 0;
  for (Index j = 0; j <= intervals; ++j) {
    const double target = along[count] * j / intervals;
    const Index last = count - (intervals - j);
    if (j > 0) ++vertex;
    while (vertex < last && std::abs(along[vertex + 1] - target) <= std::abs(along[vertex] - target)) ++vertex;
    is_node[vertex < count ? mesh.facets()(0, chain[vertex]) : mesh.facets()(1, chain[count - 1])] = 1;
  }
}

void place_on_loop(const FineMesh<2>& mesh, const Vector& spacing, const BoundaryWalk& walk, Index start,
                   std::vector<char>& is_node) {
  std::vector<Index> loop;
  Index f = start;
  do loop.push_back(f);
  while ((f = walk.next[f]) != start);
  const std::vector<Index> ends = CornerFinder(mesh, spacing, walk, loop).corners();
  // Three nodes on every loop: chains between two corners are halved, a chain with none or one has three intervals.
  const Index least = ends.size() < 2 ? 3 : ends.size() == 2 ? 2 : 1;
  if (ends.empty()) return place_on_chain(mesh, spacing, loop, least, is_node);
  const Index shift = ends.front() + 1;
  std::rotate(loop.begin(), loop.begin() + shift, loop.end());
  Index begin = 0;
  for (std::size_t k = 1; k <= ends.size(); ++k) {
    const Index end = k < ends.size() ? ends[k] + 1 - shift : static_cast<Index>(loop.size());
    place_on_chain(mesh, spacing, std::span(loop).subspan(begin, end - begin), least, is_node);
    begin = end;
  }
}

std::vector<char> boundary_nodes(const FineMesh<2>& mesh, const Vector& spacing) {
  const BoundaryWalk walk = walk_boundary(mesh);
  std::vector<char> is_node(mesh.num_vertices(), 0), seen(mesh.num_facets(), 0);
  for (Index start = 0; start < mesh.num_facets(); ++start) {
    if (seen[start]) continue;
    for (Index f = start; !seen[f]; f = walk.next[f]) seen[f] = 1;
    place_on_loop(mesh, spacing, walk, start, is_node);
  }
  return is_node;
}

/// What a vertex is to the surface, in the order in which nodes are sought.
enum class Place : char { corner, ridge, face, inside };

/// Ridges are the boundary edges where the surface turns by more than 30 degrees or where named groups end; corners are
/// the vertices where ridges end, meet or turn by more than 30 degrees.
std::vector<Place> places(const FineMesh<3>& mesh) {
  const double ridge_cosine = std::cos(30.0 * std::numbers::pi / 180.0);
  const Ragged<Index> groups = groups_of_facets(mesh);
  struct Side {
    Index a, b, facet;  ///< a < b
    std::uint64_t edge() const { return static_cast<std::uint64_t>(a) << 32 | static_cast<std::uint64_t>(b); }
  };
  std::vector<Side> sides;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    for (int k = 0; k < 3; ++k) {
      const Index a = mesh.facets()(k, f), b = mesh.facets()((k + 1) % 3, f);
      sides.push_back({std::min(a, b), std::max(a, b), f});
    }
  std::ranges::sort(sides, [](const Side& s, const Side& t) {
    return s.edge() != t.edge() ? s.edge() < t.edge() : s.facet < t.facet;
  });

  std::vector<Place> place(mesh.num_vertices(), Place::inside);
  for (Index f = 0; f < mesh.num_facets(); ++f)
    for (int k = 0; k < 3; ++k) place[mesh.facets()(k, f)] = Place::face;
  std::vector<std::array<Index, 2>> ridges;
  for (std::size_t s = 0; s < sides.size();) {
    std::size_t end = s + 1;
    while (end < sides.size() && sides[end].a == sides[s].a && sides[end].b == sides[s].b) ++end;
    const Index f = sides[s].facet, g = sides[end - 1].facet;
    if (end - s != 2 || mesh.facet_normal(f).dot(mesh.facet_normal(g)) < ridge_cosine ||
        !std::ranges::equal(groups[f], groups[g]))
      ridges.push_back({sides[s].a, sides[s].b});
    s = end;
  }
  std::vector<int> count(mesh.num_vertices(), 0);
  Points<3> sum =
      Points<3>::Zero(3, mesh.num_vertices());  // of the unit vectors along the ridges, away from the vertex
  for (const auto& [a, b] : ridges) {
    const Vec<3> along = (mesh.vertex(b) - mesh.vertex(a)).normalized();
    sum.col(a) += along, sum.col(b) -= along;
    ++count[a], ++count[b];
  }
  const double straight = 2.0 - 2.0 * ridge_cosine;  // |e1 + e2|^2 for a turn of 30 degrees
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (count[v] > 0) place[v] = count[v] == 2 && sum.col(v).squaredNorm() < straight ? Place::ridge : Place::corner;
  return place;
}

/// Marks what nodes cover: the vertices closer than the spacing that can be reached inside that ball.
template <int Dim> class Cover {
 public:
  Cover(const FineMesh<Dim>& mesh, const Vector& spacing)
      : mesh_(mesh),
        spacing_(spacing),
        covered_(mesh.num_vertices(), 0),
        vertex_stamp_(mesh.num_vertices(), -1),
        cell_stamp_(mesh.num_cells(), -1) {}

  bool covers(Index v) const { return covered_[v]; }

  void add(Index node) {
    const Vec<Dim> centre = mesh_.vertex(node);
    const double reach = spacing_[node] * spacing_[node];
    stack_.assign(1, node);
    vertex_stamp_[node] = node;
    while (!stack_.empty()) {
      const Index v = stack_.back();
      stack_.pop_back();
      covered_[v] = 1;
      for (const Index c : mesh_.cells_of(v)) {
        if (cell_stamp_[c] == node) continue;
        cell_stamp_[c] = node;
        for (int i = 0; i <= Dim; ++i) {
          const Index w = mesh_.cells()(i, c);
          if (vertex_stamp_[w] == node) continue;
          vertex_stamp_[w] = node;
          if ((mesh_.vertex(w) - centre).squaredNorm() < reach) stack_.push_back(w);
        }
      }
    }
  }

 private:
  const FineMesh<Dim>& mesh_;
  const Vector& spacing_;
  std::vector<char> covered_;
  std::vector<Index> vertex_stamp_, cell_stamp_;  // node that last reached the vertex, the cell
  std::vector<Index> stack_;
};

/// 0 .. n-1 in random order (Fisher & Yates); the standard library's shuffle differs between platforms.
std::vector<Index> permutation(Index n, std::uint64_t seed) {
  std::vector<Index> order(n);
  std::iota(order.begin(), order.end(), 0);
  std::mt19937_64 generator(seed);
  for (Index i = n - 1; i > 0; --i) std::swap(order[i], order[generator() % static_cast<std::uint64_t>(i + 1)]);
  return order;
}

}  // namespace

template <int Dim> NodeCloud<Dim> sample_cloud(const FineMesh<Dim>& mesh, const Vector& spacing, std::uint64_t seed) {
  if (spacing.size() != mesh.num_vertices())
    throw InputError(
        fmt::format("cloud: {} spacings for {} vertices, expected one for each", spacing.size(), mesh.num_vertices()));
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (!(spacing[v] > 0.0 && std::isfinite(spacing[v])))
      throw InputError(fmt::format("cloud: the spacing at ({}) is {}, expected a positive length",
                                   fmt::join(mesh.vertex(v), ", "), spacing[v]));

  std::vector<Index> order = permutation(mesh.num_vertices(), seed);
  std::vector<char> is_node(mesh.num_vertices(), 0);
  Cover<Dim> cover(mesh, spacing);
  if constexpr (Dim == 2) {
    is_node = boundary_nodes(mesh, spacing);
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (is_node[v]) cover.add(v);
  } else {
    const std::vector<Place> place = places(mesh);
    std::ranges::stable_sort(order, {}, [&](Index v) { return place[v]; });
  }
  for (const Index v : order) {
    if (cover.covers(v)) continue;
    is_node[v] = 1;
    cover.add(v);
  }

  NodeCloud<Dim> cloud;
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (is_node[v]) cloud.vertices.push_back(v);
  cloud.positions = mesh.vertices()(Eigen::all, cloud.vertices);
  cloud.spacing = spacing(cloud.vertices);
  return cloud;
}

template <int Dim> NodeCloud<Dim> sample_cloud(const FineMesh<Dim>& mesh, const CloudOptions& options) {
  if (!(options.spacing > 0.0 && std::isfinite(options.spacing)))
    throw InputError(fmt::format("cloud: spacing is {}, expected a positive length", options.spacing));
  return sample_cloud<Dim>(mesh, Vector::Constant(mesh.num_vertices(), options.spacing), options.seed);
}

template NodeCloud<2> sample_cloud<2>(const FineMesh<2>&, const CloudOptions&);
template NodeCloud<2> sample_cloud<2>(const FineMesh<2>&, const Vector&, std::uint64_t);
template NodeCloud<3> sample_cloud<3>(const FineMesh<3>&, const CloudOptions&);
template NodeCloud<3> sample_cloud<3>(const FineMesh<3>&, const Vector&, std::uint64_t);

}  // namespace efree
