// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/fine_mesh.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/bodies.hpp"
#include "efree/geometry/mesh/internal/extent.hpp"
#include "efree/geometry/mesh/internal/signed_volume.hpp"
#include "efree/geometry/mesh/internal/sorted_facet.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>

namespace efree {
namespace {

template <int Dim> using Key = std::array<Index, Dim>;

/// Vertices of the facet opposite local vertex i, so that it is oriented outward for a positively oriented cell.
template <int Dim> Key<Dim> facet_opposite(const Cells<Dim>& cells, Index c, Index i) {
  Key<Dim> facet;
  for (int k = 0; k < Dim; ++k) facet[k] = cells((i + 1 + k) % (Dim + 1), c);
  if (Dim == 3 && i % 2 == 1) std::swap(facet[0], facet[1]);
  return facet;
}

/// One side of a facet: its sorted vertices, the cell, and the local vertex opposite.
template <int Dim> struct HalfFacet {
  Key<Dim> key;
  Index cell;
  Index opposite;
  friend bool operator<(const HalfFacet& a, const HalfFacet& b) {
    for (int k = 0; k < Dim; ++k)
      if (a.key[k] != b.key[k]) return a.key[k] < b.key[k];
    return a.cell < b.cell;
  }
};

/// All sides of all cells, ascending by key, then by cell. Linear: a counting sort by the first vertex, then short
/// sorts.
template <int Dim> std::vector<HalfFacet<Dim>> sorted_half_facets(const Cells<Dim>& cells) {
  std::vector<std::size_t> begin(static_cast<std::size_t>(cells.maxCoeff()) + 2, 0);
  const auto for_each_side = [&](const auto& body) {
    for (Index c = 0; c < cells.cols(); ++c)
      for (Index i = 0; i <= Dim; ++i)
        body(HalfFacet<Dim>{internal::sorted_facet<Dim>(facet_opposite<Dim>(cells, c, i)), c, i});
  };
  for_each_side([&](const HalfFacet<Dim>& side) { ++begin[side.key[0] + 1]; });
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<HalfFacet<Dim>> sides(begin.back());
  std::vector<std::size_t> cursor = begin;
  for_each_side([&](const HalfFacet<Dim>& side) { sides[cursor[side.key[0]]++] = side; });
  for (std::size_t v = 0; v + 1 < begin.size(); ++v) std::sort(sides.begin() + begin[v], sides.begin() + begin[v + 1]);
  return sides;
}

/// Rows of a bipartite incidence, by counting sort: row r lists the items that were given with r, in order.
template <class ForEach> Ragged<Index> incidence(Index rows, const ForEach& for_each_pair) {
  Ragged<Index> out;
  // Two ahead: where a row ends is moved there while it is filled, from where it begins.
  out.offsets.assign(static_cast<std::size_t>(rows) + 2, 0);
  for_each_pair([&](Index row, Index) { ++out.offsets[row + 2]; });
  std::partial_sum(out.offsets.begin(), out.offsets.end(), out.offsets.begin());
  out.items.resize(out.offsets.back());
  for_each_pair([&](Index row, Index item) { out.items[out.offsets[row + 1]++] = item; });
  out.offsets.pop_back();
  return out;
}

/// Cells around each vertex, ascending.
template <int Dim> Ragged<Index> cells_around(const Cells<Dim>& cells, Index vertices) {
  return incidence(vertices, [&](auto&& emit) {
    for (Index c = 0; c < cells.cols(); ++c)
      for (int i = 0; i <= Dim; ++i) emit(cells(i, c), c);
  });
}

/// Cells across the facets, -1 on the boundary. Linear: the facets around a vertex of which it is the smallest are few,
/// and are compared one by one.
template <int Dim> Cells<Dim> neighbours_of(const Cells<Dim>& cells, const Ragged<Index>& around) {
  struct Side {
    Index cell;
    Index opposite;
    bool is_matched;
  };
  Cells<Dim> neighbours = Cells<Dim>::Constant(Dim + 1, cells.cols(), -1);
  parallel_chunks(around.rows(), 20000, [&](Index from, Index to) {
    std::vector<std::uint64_t> rests;  // of the sorted vertices of a side, in one number
    std::vector<Side> sides;
    for (Index first = from; first < to; ++first) {
      Key<Dim> crowded{};
      bool is_crowded = false;
      rests.clear();
      sides.clear();
      const auto add = [&](std::uint64_t rest, Index cell, Index opposite) {
        const auto found = std::find(rests.begin(), rests.end(), rest);
        if (found == rests.end()) {
          rests.push_back(rest);
          sides.push_back({cell, opposite, false});
          return;
        }
        Side& other = sides[found - rests.begin()];
        if (other.is_matched) {
          Key<Dim> key{first};
          for (int k = Dim - 1; k > 0; --k) key[k] = static_cast<Index>(rest >> 32 * (Dim - 1 - k) & 0xffffffff);
          crowded = is_crowded ? std::min(crowded, key) : key;
          is_crowded = true;
          return;
        }
        other.is_matched = true;
        neighbours(opposite, cell) = other.cell;
        neighbours(other.opposite, other.cell) = cell;
      };
      for (const Index c : around[first]) {
        // A cell's smallest vertex is that of all its sides but one, which has the second smallest.
        const auto cell = cells.col(c);
        int smaller = 0;
        for (int i = 0; i <= Dim; ++i) smaller += cell[i] < first;
        if (smaller > 1) continue;
        Key<Dim> rest;  // its other vertices without the one smaller, ascending, and where they are
        Key<Dim> at;
        int count = 0;
        Index least = 0;
        for (int i = 0; i <= Dim; ++i) {
          if (cell[i] < first) least = i;
          if (cell[i] <= first) continue;
          int k = count++;
          for (; k > 0 && rest[k - 1] > cell[i]; --k) rest[k] = rest[k - 1], at[k] = at[k - 1];
          rest[k] = cell[i], at[k] = i;
        }
        const auto without = [&](int left_out) {
          std::uint64_t packed = 0;
          for (int k = 0; k < count; ++k)
            if (k != left_out) packed = packed << 32 | static_cast<std::uint32_t>(rest[k]);
          return packed;
        };
        if (smaller == 1)
          add(without(-1), c, least);
        else
          for (int k = 0; k < count; ++k) add(without(k), c, at[k]);
      }
      if (is_crowded)
        throw InputError(
            fmt::format("mesh: the facet of vertices {} belongs to more than two cells", fmt::join(crowded, ", ")));
    }
  });
  return neighbours;
}
template <int Dim> Cells<Dim> neighbours_of(const Cells<Dim>& cells) {
  return neighbours_of<Dim>(cells, cells_around<Dim>(cells, cells.maxCoeff() + 1));
}

/// Whether the facet of a cell opposite its vertex i faces the other way for the cell beyond it, as it does for cells
/// that lie on different sides of it.
template <int Dim> bool faces_back(const Cells<Dim>& cells, Index c, Index i, Index beyond) {
  const Key<Dim> facet = facet_opposite<Dim>(cells, c, i);
  Index opposite = 0;  // of the cell beyond: the vertex that is not on the facet
  while (std::ranges::find(facet, cells(opposite, beyond)) != facet.end()) ++opposite;
  const Key<Dim> back = facet_opposite<Dim>(cells, beyond, opposite);
  if (Dim == 2) return back[0] == facet[1];
  const auto at = std::ranges::find(back, facet[0]) - back.begin();
  return back[(at + 1) % Dim] == facet[Dim - 1];
}

/// Throws InputError if two cells lie on the same side of a facet they share.
template <int Dim> void check_folds(const Points<Dim>& x, const Cells<Dim>& cells, const Cells<Dim>& neighbours) {
  parallel_for(static_cast<Index>(cells.cols()), [&](Index c) {
    for (Index i = 0; i <= Dim; ++i) {
      const Index beyond = neighbours(i, c);
      if (beyond < c || faces_back<Dim>(cells, c, i, beyond)) continue;
      const Key<Dim> facet = facet_opposite<Dim>(cells, c, i);
      Vec<Dim> middle = Vec<Dim>::Zero();
      for (const Index v : facet) middle += x.col(v) / Dim;
      throw InputError(
          fmt::format("mesh: it folds over itself at ({:.6g}): the cells {} and {} lie on the same side of the facet "
                      "they share",
                      fmt::join(middle, ", "), c, beyond));
    }
  });
}

/// Throws InputError if the cells around a vertex take more than a full turn.
void check_turns(const Points<2>& x, const Cells<2>& cells) {
  Vector turn = Vector::Zero(x.cols());
  for (Index c = 0; c < cells.cols(); ++c)
    for (int i = 0; i < 3; ++i) {
      const Vec<2> a = x.col(cells((i + 1) % 3, c)) - x.col(cells(i, c));
      const Vec<2> b = x.col(cells((i + 2) % 3, c)) - x.col(cells(i, c));
      turn[cells(i, c)] += std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    }
  Index v = 0;
  if (turn.maxCoeff(&v) > 2.0 * std::numbers::pi + 1e-6)
    throw InputError(
        fmt::format("mesh: it folds over itself at ({:.6g}): the cells around this vertex take more than a full turn",
                    fmt::join(x.col(v), ", ")));
}

template <int Dim> void check_indices(const MeshData<Dim>& data) {
  const Index vertices = static_cast<Index>(data.vertices.cols()), *const cells = data.cells.data();
  for (Eigen::Index k = 0; k < data.cells.size(); ++k)
    if (cells[k] < 0 || cells[k] >= vertices)
      throw InputError(fmt::format("mesh: a cell names vertex {}, expected 0 to {}", cells[k], vertices - 1));
}

template <int Dim> void check_regions(const MeshData<Dim>& data) {
  if (data.regions.empty() && data.region_names.size() <= 1) return;
  if (static_cast<Index>(data.regions.size()) != data.cells.cols())
    throw InputError(fmt::format("mesh: {} region numbers for {} cells", data.regions.size(), data.cells.cols()));
  const Index named = static_cast<Index>(data.region_names.size());
  for (Index region : data.regions)
    if (region < 0 || region >= named)
      throw InputError(fmt::format("mesh: a cell lies in region {}, but {} regions have a name", region, named));
  for (std::size_t i = 0; i < data.region_names.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (data.region_names[i] == data.region_names[j])
        throw InputError(fmt::format("mesh: two regions are named \"{}\"", data.region_names[i]));
}

/// "a", "b", ... or `none`.
std::string quoted(const std::vector<std::string>& names, std::string_view none) {
  if (names.empty()) return std::string(none);
  return fmt::format("\"{}\"", fmt::join(names, "\", \""));
}

}  // namespace

template <int Dim> FineMesh<Dim>::FineMesh(MeshData<Dim> data) {
  const Index given_vertices = static_cast<Index>(data.vertices.cols());
  if (data.cells.cols() == 0) throw InputError("mesh: there is no cell in it");
  check_indices(data);
  if (!data.vertices.allFinite()) throw InputError("mesh: a vertex coordinate is not a finite number");
  const Vec<Dim> low = data.vertices.rowwise().minCoeff(), high = data.vertices.rowwise().maxCoeff();
  internal::require_extent<Dim>(low, high, "mesh");
  internal::require_thickness<Dim>(low, high, "mesh");
  check_regions(data);
  regions_ = std::move(data.regions);
  region_names_ = data.region_names.empty() ? std::vector<std::string>{""} : std::move(data.region_names);

  // Keep the vertices that some cell uses, in their order.
  std::vector<Index> renumbered(given_vertices, -1);
  for (Eigen::Index k = 0; k < data.cells.size(); ++k) renumbered[data.cells.data()[k]] = 0;
  Index used = 0;
  for (Index& v : renumbered)
    if (v == 0) v = used++;
  vertices_ = std::move(data.vertices);
  cells_ = std::move(data.cells);
  if (used < given_vertices) {
    for (Index v = 0; v < given_vertices; ++v)
      if (renumbered[v] >= 0) vertices_.col(renumbered[v]) = vertices_.col(v).eval();
    vertices_.conservativeResize(Dim, used);
    for (Eigen::Index k = 0; k < cells_.size(); ++k) cells_.data()[k] = renumbered[cells_.data()[k]];
  }

  volumes_.resize(cells_.cols());
  constexpr Index cells_per_chunk = 100000;
  std::vector<double> squares((num_cells() - 1) / cells_per_chunk + 1, 0.0);
  parallel_chunks(num_cells(), cells_per_chunk, [&](Index begin, Index end) {
    double square = 0.0;
    for (Index c = begin; c < end; ++c) {
      double volume = internal::signed_volume<Dim>(vertices_, cells_, c);
      if (volume < 0.0) {
        std::swap(cells_(Dim - 1, c), cells_(Dim, c));
        volume = -volume;
      }
      if (!(volume > 0.0))
        throw InputError(fmt::format("mesh: cell {} at ({}) has no volume", c, fmt::join(centroid(c), ", ")));
      volumes_[c] = volume;
      for (int i = 0; i <= Dim; ++i)
        for (int j = 0; j < i; ++j)
          square = std::max(square, (vertex(cells_(i, c)) - vertex(cells_(j, c))).squaredNorm());
    }
    squares[begin / cells_per_chunk] = square;
  });
  size_ = std::sqrt(*std::ranges::max_element(squares));

  vertex_cells_ = cells_around<Dim>(cells_, num_vertices());
  neighbours_ = neighbours_of<Dim>(cells_, vertex_cells_);
  check_folds<Dim>(vertices_, cells_, neighbours_);
  if constexpr (Dim == 2) check_turns(vertices_, cells_);

  const Index facet_count = static_cast<Index>((neighbours_.array() < 0).count());
  facets_.resize(Dim, facet_count);
  facet_cells_.reserve(facet_count);
  for (Index c = 0; c < num_cells(); ++c)
    for (Index i = 0; i <= Dim; ++i)
      if (neighbours_(i, c) < 0) {
        const auto facet = facet_opposite<Dim>(cells_, c, i);
        for (int k = 0; k < Dim; ++k) facets_(k, facet_cells_.size()) = facet[k];
        facet_cells_.push_back(c);
      }
  vertex_facets_ = incidence(num_vertices(), [&](auto&& emit) {
    for (Index f = 0; f < num_facets(); ++f)
      for (int k = 0; k < Dim; ++k) emit(facets_(k, f), f);
  });

  const auto find_facet = [&](const Key<Dim>& wanted) -> Index {
    const Key<Dim> sought = internal::sorted_facet<Dim>(wanted);
    for (Index f : facets_of(wanted[0])) {
      Key<Dim> key;
      for (int k = 0; k < Dim; ++k) key[k] = facets_(k, f);
      if (internal::sorted_facet<Dim>(key) == sought) return f;
    }
    return -1;
  };
  const auto is_inner_facet = [&](const Key<Dim>& wanted) {
    for (Index c : cells_of(wanted[0])) {
      int shared = 0;
      for (Index v : wanted)
        for (int i = 0; i <= Dim; ++i) shared += cells_(i, c) == v;
      if (shared == Dim) return true;
    }
    return false;
  };
  for (const auto& group : data.groups) {
    Group resolved{group.name, {}};
    resolved.facets.reserve(group.facets.size());
    for (auto facet : group.facets) {
      for (Index& v : facet) {
        if (v < 0 || v >= given_vertices || renumbered[v] < 0)
          throw InputError(fmt::format("mesh: group \"{}\" names vertex {}, which no cell has", group.name, v));
        v = renumbered[v];
      }
      if (const Index f = find_facet(facet); f >= 0)
        resolved.facets.push_back(f);
      else if (!is_inner_facet(facet))
        throw InputError(fmt::format("mesh: group \"{}\" has a facet of vertices {} that no cell has", group.name,
                                     fmt::join(facet, ", ")));
    }
    std::sort(resolved.facets.begin(), resolved.facets.end());
    resolved.facets.erase(std::unique(resolved.facets.begin(), resolved.facets.end()), resolved.facets.end());
    if (!resolved.facets.empty()) groups_.push_back(std::move(resolved));
  }

  components_ = internal::first_of_body<Dim>(cells_, num_vertices());
  for (Index v = 0; v < num_vertices(); ++v)
    components_[v] = components_[v] == v ? num_components_++ : components_[components_[v]];
}

template <int Dim> Vec<Dim> FineMesh<Dim>::centroid(Index c) const {
  Vec<Dim> sum = Vec<Dim>::Zero();
  for (int i = 0; i <= Dim; ++i) sum += vertices_.col(cells_(i, c));
  return sum / (Dim + 1);
}

template <int Dim> Eigen::Matrix<double, Dim, Dim + 1> FineMesh<Dim>::hat_gradients(Index c) const {
  Eigen::Matrix<double, Dim, Dim + 1> gradients;
  if constexpr (Dim == 2) {
    const Vec<2> a = vertex(cells_(0, c)), b = vertex(cells_(1, c)), d = vertex(cells_(2, c));
    const double scale = 0.5 / volumes_[c];
    gradients.col(0) = scale * Vec<2>(b.y() - d.y(), d.x() - b.x());
    gradients.col(1) = scale * Vec<2>(d.y() - a.y(), a.x() - d.x());
    gradients.col(2) = scale * Vec<2>(a.y() - b.y(), b.x() - a.x());
  } else {
    Mat<Dim> edges;
    for (int k = 0; k < Dim; ++k) edges.col(k) = vertex(cells_(k + 1, c)) - vertex(cells_(0, c));
    gradients.template rightCols<Dim>() = edges.inverse().transpose();
    gradients.col(0) = -gradients.template rightCols<Dim>().rowwise().sum();
  }
  return gradients;
}

template <int Dim> double FineMesh<Dim>::facet_measure(Index f) const {
  if constexpr (Dim == 2)
    return (vertex(facets_(1, f)) - vertex(facets_(0, f))).norm();
  else
    return 0.5 *
           (vertex(facets_(1, f)) - vertex(facets_(0, f))).cross(vertex(facets_(2, f)) - vertex(facets_(0, f))).norm();
}

template <int Dim> Vec<Dim> FineMesh<Dim>::facet_normal(Index f) const {
  if constexpr (Dim == 2) {
    const Vec<2> along = (vertex(facets_(1, f)) - vertex(facets_(0, f))).normalized();
    return {along.y(), -along.x()};
  } else {
    return (vertex(facets_(1, f)) - vertex(facets_(0, f)))
        .cross(vertex(facets_(2, f)) - vertex(facets_(0, f)))
        .normalized();
  }
}

template <int Dim> const std::vector<Index>& FineMesh<Dim>::group(std::string_view name) const {
  for (const Group& group : groups_)
    if (group.name == name) return group.facets;
  std::vector<std::string> names;
  for (const Group& group : groups_) names.push_back(group.name);
  throw InputError(
      fmt::format("no part of the boundary is named \"{}\"; the mesh has {}", name, quoted(names, "no named parts")));
}

template <int Dim> FineMesh<Dim> FineMesh<Dim>::with_groups(std::vector<Group> groups) && {
  for (Group& group : groups) {
    std::ranges::sort(group.facets);
    if (!group.facets.empty() && (group.facets.front() < 0 || group.facets.back() >= num_facets()))
      throw InputError(fmt::format("mesh: group \"{}\" names a facet that is not one of {}", group.name, num_facets()));
    if (std::ranges::count(groups, group.name, &Group::name) > 1)
      throw InputError(fmt::format("mesh: two parts of the boundary are named \"{}\"", group.name));
  }
  groups_ = std::move(groups);
  return std::move(*this);
}

template <int Dim> Index FineMesh<Dim>::region(std::string_view name) const {
  const auto found = std::ranges::find(region_names_, name);
  if (found == region_names_.end()) {
    const bool unnamed = region_names_ == std::vector<std::string>{""};
    throw InputError(fmt::format("no region is named \"{}\"; the mesh has {}", name,
                                 unnamed ? "one region without a name" : quoted(region_names_, "none")));
  }
  return static_cast<Index>(found - region_names_.begin());
}

template <int Dim> MeshData<Dim> cut_open(MeshData<Dim> mesh, const std::vector<std::array<Index, Dim>>& facets) {
  if (facets.empty()) return mesh;
  check_indices(mesh);
  std::vector<Key<Dim>> cut;
  for (const auto& facet : facets) cut.push_back(internal::sorted_facet<Dim>(facet));
  std::sort(cut.begin(), cut.end());
  cut.erase(std::unique(cut.begin(), cut.end()), cut.end());
  const auto is_cut = [&](const Key<Dim>& key) { return std::binary_search(cut.begin(), cut.end(), key); };

  const auto sides = sorted_half_facets<Dim>(mesh.cells);
  for (const auto& key : cut) {
    const auto side = std::lower_bound(sides.begin(), sides.end(), HalfFacet<Dim>{key, -1, 0});
    if (side == sides.end() || side->key != key)
      throw InputError(fmt::format("cut: no cell has a facet of vertices {}", fmt::join(key, ", ")));
  }

  const Cells<Dim> old_cells = mesh.cells;
  const Cells<Dim> neighbours = neighbours_of<Dim>(old_cells);
  std::vector<Index> touched;
  for (const auto& key : cut) touched.insert(touched.end(), key.begin(), key.end());
  std::sort(touched.begin(), touched.end());
  touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
  std::vector<Index> slot(mesh.vertices.cols(), -1);
  for (std::size_t t = 0; t < touched.size(); ++t) slot[touched[t]] = static_cast<Index>(t);
  const auto stars = incidence(static_cast<Index>(touched.size()), [&](auto&& emit) {
    for (Index c = 0; c < old_cells.cols(); ++c)
      for (int i = 0; i <= Dim; ++i)
        if (slot[old_cells(i, c)] >= 0) emit(slot[old_cells(i, c)], c);
  });

  std::vector<Vec<Dim>> copies;
  const Index first_copy = static_cast<Index>(mesh.vertices.cols());
  for (std::size_t t = 0; t < touched.size(); ++t) {
    const Index v = touched[t];
    std::vector<Index> star(stars[static_cast<Index>(t)].begin(), stars[static_cast<Index>(t)].end());
    std::vector<char> seen(star.size(), 0);
    const auto position = [&](Index c) { return std::lower_bound(star.begin(), star.end(), c) - star.begin(); };
    bool first_part = true;
    for (std::size_t s = 0; s < star.size(); ++s) {
      if (seen[s]) continue;
      Index name = v;
      if (!first_part) {
        name = first_copy + static_cast<Index>(copies.size());
        copies.push_back(mesh.vertices.col(v));
      }
      first_part = false;
      std::vector<Index> stack{star[s]};
      seen[s] = 1;
      while (!stack.empty()) {
        const Index c = stack.back();
        stack.pop_back();
        for (int i = 0; i <= Dim; ++i) {
          if (old_cells(i, c) == v) {
            mesh.cells(i, c) = name;
            continue;
          }
          const Index next = neighbours(i, c);
          if (next < 0 || is_cut(internal::sorted_facet<Dim>(facet_opposite<Dim>(old_cells, c, i)))) continue;
          const auto p = position(next);
          if (!seen[p]) {
            seen[p] = 1;
            stack.push_back(next);
          }
        }
      }
    }
  }
  for (std::size_t side = 0; side + 1 < sides.size(); ++side) {
    const auto &a = sides[side], &b = sides[side + 1];
    if (a.key == b.key && is_cut(a.key) &&
        internal::sorted_facet<Dim>(facet_opposite<Dim>(mesh.cells, a.cell, a.opposite)) ==
            internal::sorted_facet<Dim>(facet_opposite<Dim>(mesh.cells, b.cell, b.opposite)))
      throw InputError(fmt::format(
          "cut: the facet of vertices {} stays closed, a cut that ends inside the body takes more than one facet",
          fmt::join(a.key, ", ")));
  }

  mesh.vertices.conservativeResize(Dim, first_copy + static_cast<Index>(copies.size()));
  for (std::size_t k = 0; k < copies.size(); ++k) mesh.vertices.col(first_copy + static_cast<Index>(k)) = copies[k];

  // A group facet becomes the facets of all cells that had it: one, or the two sides of the cut.
  for (auto& group : mesh.groups) {
    std::vector<Key<Dim>> followed;
    for (const auto& facet : group.facets) {
      auto side =
          std::lower_bound(sides.begin(), sides.end(), HalfFacet<Dim>{internal::sorted_facet<Dim>(facet), -1, 0});
      for (; side != sides.end() && side->key == internal::sorted_facet<Dim>(facet); ++side)
        followed.push_back(facet_opposite<Dim>(mesh.cells, side->cell, side->opposite));
    }
    group.facets.assign(followed.begin(), followed.end());
  }
  return mesh;
}

template <int Dim> MeshData<Dim> cut_regions(MeshData<Dim> mesh) {
  if (mesh.region_names.size() <= 1) return mesh;
  check_indices(mesh);
  check_regions(mesh);
  const Cells<Dim> neighbours = neighbours_of<Dim>(mesh.cells);
  std::vector<Key<Dim>> interface;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    for (Index i = 0; i <= Dim; ++i)
      if (const Index other = neighbours(i, c); other > c && mesh.regions[other] != mesh.regions[c])
        interface.push_back(facet_opposite<Dim>(mesh.cells, c, i));
  return cut_open<Dim>(std::move(mesh), interface);
}

template <int Dim> MeshData<Dim> extract(const FineMesh<Dim>& mesh, const std::vector<char>& kept) {
  require(static_cast<Index>(kept.size()) == mesh.num_cells(), "extract: a flag for each cell expected");
  std::vector<Index> cells;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (kept[c]) cells.push_back(c);
  MeshData<Dim> data;
  data.vertices = mesh.vertices();
  data.cells = mesh.cells()(Eigen::all, cells);
  data.region_names = mesh.region_names();
  if (mesh.num_regions() > 1)
    for (const Index c : cells) data.regions.push_back(mesh.region(c));
  for (const auto& group : mesh.groups()) {
    data.groups.push_back({group.name, {}});
    for (const Index f : group.facets) {
      if (!kept[mesh.facet_cell(f)]) continue;
      auto& facet = data.groups.back().facets.emplace_back();
      for (int k = 0; k < Dim; ++k) facet[k] = mesh.facets()(k, f);
    }
  }
  return data;
}

template <int Dim> Unhinged<Dim> cut_hinges(const FineMesh<Dim>& mesh) {
  // Stars that come apart, as the cells of all their parts but the first.
  struct Part {
    Index vertex;
    std::vector<Index> cells;
  };
  std::vector<Part> parts;
  std::vector<Index> reached, last(mesh.num_cells(), -1);  // by cell: the vertex whose star it was last reached in
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (!mesh.on_boundary(v)) continue;
    bool first = true;
    for (const Index start : mesh.cells_of(v)) {
      if (last[start] == v) continue;
      reached.assign(1, start);
      last[start] = v;
      for (std::size_t k = 0; k < reached.size(); ++k)
        for (Index i = 0; i <= Dim; ++i) {
          const Index next = mesh.neighbour(i, reached[k]);
          if (next < 0 || last[next] == v || mesh.cells()(i, reached[k]) == v) continue;
          last[next] = v;
          reached.push_back(next);
        }
      if (!first) parts.push_back({v, reached});
      first = false;
    }
  }
  Unhinged<Dim> result;
  if (parts.empty()) return result;
  result.mesh = extract(mesh, std::vector<char>(mesh.num_cells(), 1));
  auto& cells = result.mesh.cells;
  result.mesh.vertices.conservativeResize(Dim, mesh.num_vertices() + static_cast<Index>(parts.size()));
  Index copy = mesh.num_vertices();
  for (const Part& part : parts) {
    if (result.hinges.empty() || result.hinges.back() != part.vertex) result.hinges.push_back(part.vertex);
    result.mesh.vertices.col(copy) = mesh.vertex(part.vertex);
    for (const Index c : part.cells)
      cells.col(c) = (mesh.cells().col(c).array() == part.vertex).select(copy, cells.col(c));
    ++copy;
  }
  // Facets follow their cells.
  for (std::size_t g = 0; g < mesh.groups().size(); ++g)
    for (std::size_t k = 0; k < mesh.groups()[g].facets.size(); ++k) {
      const Index c = mesh.facet_cell(mesh.groups()[g].facets[k]);
      for (Index& v : result.mesh.groups[g].facets[k])
        for (int i = 0; i <= Dim; ++i)
          if (mesh.cells()(i, c) == v) {
            v = cells(i, c);
            break;
          }
    }
  return result;
}

template <int Dim> std::vector<TiedFacets> tied_facets(const FineMesh<Dim>& mesh, std::string_view open) {
  std::vector<TiedFacets> ties;
  if (mesh.num_regions() <= 1) return ties;
  std::vector<char> is_open(mesh.num_facets(), 0);
  if (!open.empty())
    for (Index f : mesh.group(open)) is_open[f] = 1;
  // Facets in the same place have the same centre: the mean of the same coordinates, summed in ascending order.
  using Place = std::array<double, Dim>;
  const auto place = [&](Index f) {
    Place centre;
    for (int d = 0; d < Dim; ++d) {
      std::array<double, Dim> x;
      for (int k = 0; k < Dim; ++k) x[k] = mesh.vertices()(d, mesh.facets()(k, f));
      std::sort(x.begin(), x.end());
      centre[d] = std::accumulate(x.begin(), x.end(), 0.0);
    }
    return centre;
  };
  const auto region = [&](Index f) { return mesh.region(mesh.facet_cell(f)); };
  std::vector<std::pair<Place, Index>> sides;
  for (Index f = 0; f < mesh.num_facets(); ++f) sides.emplace_back(place(f), f);
  std::sort(sides.begin(), sides.end());
  for (std::size_t s = 0; s + 1 < sides.size(); ++s) {
    Index a = sides[s].second, b = sides[s + 1].second;
    if (sides[s].first != sides[s + 1].first || region(a) == region(b) || (is_open[a] && is_open[b])) continue;
    if (region(a) > region(b)) std::swap(a, b);
    ties.push_back({a, b});
  }
  std::ranges::sort(ties, {}, &TiedFacets::first);
  return ties;
}

template class FineMesh<2>;
template class FineMesh<3>;
template MeshData<2> cut_open<2>(MeshData<2>, const std::vector<std::array<Index, 2>>&);
template MeshData<3> cut_open<3>(MeshData<3>, const std::vector<std::array<Index, 3>>&);

template MeshData<2> cut_regions<2>(MeshData<2>);
template MeshData<3> cut_regions<3>(MeshData<3>);
template MeshData<2> extract<2>(const FineMesh<2>&, const std::vector<char>&);
template Unhinged<2> cut_hinges<2>(const FineMesh<2>&);
template std::vector<TiedFacets> tied_facets<2>(const FineMesh<2>&, std::string_view);
template MeshData<3> extract<3>(const FineMesh<3>&, const std::vector<char>&);
template Unhinged<3> cut_hinges<3>(const FineMesh<3>&);
template std::vector<TiedFacets> tied_facets<3>(const FineMesh<3>&, std::string_view);

}  // namespace efree
