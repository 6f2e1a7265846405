// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/lattice_vertices.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <initializer_list>
#include <numeric>

namespace efree::internal {
namespace {

/// Points in which three or four regions meet keep this far from the sides of their faces and cells (barycentric).
constexpr double junction_margin = 0.15;

}  // namespace

void LatticeVertices::number_vertices() {
  const std::size_t planes = static_cast<std::size_t>(cubes_[2]) + 1;
  bits_.resize(num_points_);
  splits_.resize(planes);
  std::vector<std::int64_t> vertices(planes + 1, 0), copies(planes + 1, 0), cells(planes + 1, 0);
  for_each_plane([&](Index k) {
    for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
      const std::uint32_t bits = entities(at, point, splits_[k]);
      bits_[point] = bits;
      vertices[k + 1] += std::popcount(bits & (split_bit - 1));
      if (upward(at) == 7) cells[k + 1] += count_cells(point);
    });
    for (const Split& split : splits_[k]) copies[k + 1] += split.parts - 1;
  });
  std::partial_sum(vertices.begin(), vertices.end(), vertices.begin());
  std::partial_sum(copies.begin(), copies.end(), copies.begin());
  std::partial_sum(cells.begin(), cells.end(), cells.begin());
  num_main_ = vertices.back();
  num_vertices_ = vertices.back() + copies.back();
  num_cells_ = cells.back();
  if (static_cast<double>(num_vertices_) > largest_index || static_cast<double>(4 * num_cells_) > largest_index)
    throw InputError(fmt::format("image: it takes {} tetrahedra, at most {} can be numbered; take a larger size",
                                 num_cells_, static_cast<Index>(largest_index / 4)));
  if (num_cells_ == 0) throw NumericalError("image: with this size no material is found; take a smaller one");
  require_memory(28.0 * static_cast<double>(num_vertices_) + 24.0 * static_cast<double>(num_cells_),
                 fmt::format("image: a mesh of {} tetrahedra", num_cells_), "take a larger size");
  first_vertex_.resize(num_points_);
  for_each_plane([&](Index k) {
    std::int64_t next = vertices[k], copy = num_main_ + copies[k];
    for_each_point(k, [&](const std::array<Index, 3>&, std::size_t point) {
      first_vertex_[point] = static_cast<Index>(next);
      next += std::popcount(bits_[point] & (split_bit - 1));
    });
    for (Split& split : splits_[k]) {
      split.first_copy = copy;
      copy += split.parts - 1;
    }
  });
  first_cell_ = std::move(cells);
}

std::uint32_t LatticeVertices::entities(const std::array<Index, 3>& at, std::size_t point,
                                        std::vector<Split>& splits) const {
  const Label own = label_[point];
  if (own == on_boundary) return vertex_on_boundary(at, point, splits);
  std::uint32_t bits = own != 0 ? 1u : 0u;
  if (cut_mask_[point] == 0 && regions_.names.size() == 1) return bits;
  const unsigned up = upward(at);
  std::array<Label, 8> label;
  for (unsigned axes = 0; axes < 8; ++axes)
    label[axes] = (axes & up) == axes ? label_[point + offset_[axes]] : on_boundary;
  for (unsigned axes = 1; axes < 8; ++axes)
    if (label[axes] != on_boundary && label[axes] != own) bits |= 1u << (first_edge_bit - 1 + axes);
  if (regions_.names.size() == 1 || std::popcount(bits >> first_edge_bit) < 2) return bits;
  const auto all_different = [&](std::initializer_list<Label> labels) {
    for (auto a = labels.begin(); a != labels.end(); ++a)
      if (*a == on_boundary || std::find(labels.begin(), a, *a) != a) return false;
    return true;
  };
  for (int f = 0; f < 12; ++f)
    if (all_different({own, label[kuhn_faces()[f].middle], label[kuhn_faces()[f].far]}))
      bits |= 1u << (first_face_bit + f);
  for (int t = 0; t < 6; ++t) {
    const auto& corner = kuhn_tets()[t].corner;
    if (all_different({own, label[corner[1]], label[corner[2]], label[7]})) bits |= 1u << (first_cell_bit + t);
  }
  return bits;
}

std::uint32_t LatticeVertices::vertex_on_boundary(const std::array<Index, 3>& at, std::size_t point,
                                                  std::vector<Split>& splits) const {
  const unsigned up = upward(at), down = downward(at);
  // Of every tetrahedron around the point: its solid corners, those without a region, whether it has any solid.
  std::array<std::uint8_t, 24> solid_corners{}, free_corners{};
  std::uint32_t solid = 0;
  for (int s = 0; s < 24; ++s) {
    const auto& [number, own, next] = kuhn_star().tets[s];
    const KuhnTet& tet = kuhn_tets()[number];
    const unsigned below = tet.corner[own];
    if ((below & down) != below || ((7 ^ below) & up) != (7 ^ below)) continue;
    const std::size_t cube = point - offset_[below];
    for (int i = 0; i < 4; ++i) {
      const Label label = label_[cube + offset_[tet.corner[i]]];
      if (label == on_boundary)
        free_corners[s] |= static_cast<std::uint8_t>(1 << i);
      else if (label != 0)
        solid_corners[s] |= static_cast<std::uint8_t>(1 << i);
    }
    const bool is_solid = free_corners[s] == 15 ? region_inside(cube, tet) != 0 : solid_corners[s] != 0;
    if (is_solid) solid |= 1u << s;
  }
  if (solid == 0) return 0;
  Split split{point, 0, {}, 0};
  for (std::uint32_t left = solid; left != 0; ++split.parts) {
    std::uint32_t front = left & -left;
    left &= ~front;
    while (front != 0) {
      const int s = std::countr_zero(front);
      front &= front - 1;
      split.part[s] = static_cast<std::uint8_t>(split.parts);
      for (int f = 0; f < 4; ++f) {
        const std::uint8_t next = kuhn_star().tets[s].next[f];
        if (next == 24 || !(left >> next & 1)) continue;
        const unsigned face = 15u ^ (1u << f);
        // The face has something solid: beside a corner of that kind, or all of it between two solid tetrahedra.
        if ((solid_corners[s] & face) == 0 && (free_corners[s] & face) != face) continue;
        left &= ~(1u << next);
        front |= 1u << next;
      }
    }
  }
  if (split.parts == 1) return 1u;
  splits.push_back(split);
  return 1u | split_bit;
}

int LatticeVertices::count_cells(std::size_t cube) const {
  const auto corner = corners(cube);
  if (is_uniform(corner)) return corner[0] != 0 ? 6 : 0;
  int count = 0;
  for (const KuhnTet& tet : kuhn_tets())
    for (const auto& piece : subdivision_of(corner, tet).pieces)
      if (region_of(cube, tet, piece.owner) != 0) ++count;
  return count;
}

const Subdivision& LatticeVertices::subdivision_of(const std::array<Label, 8>& corner, const KuhnTet& tet) {
  std::array<Label, 4> label;
  std::array<int, 4> of;
  int most = 0, code = 0, power = 1;
  for (int i = 0; i < 4; ++i, power *= 5) {
    label[i] = corner[tet.corner[i]];
    of[i] = 0;
    if (label[i] != on_boundary) {
      for (int j = 0; j < i && of[i] == 0; ++j)
        if (label[j] == label[i]) of[i] = of[j];
      if (of[i] == 0) of[i] = ++most;
    }
    code += power * of[i];
  }
  return internal::subdivision(code);
}

Label LatticeVertices::region_of(std::size_t cube, const KuhnTet& tet, int owner) const {
  return owner == 4 ? region_inside(cube, tet) : label_[cube + offset_[tet.corner[owner]]];
}

void LatticeVertices::place_vertices(LatticeMesh& out) const {
  out.mesh.vertices.resize(3, static_cast<Index>(num_vertices_));
  out.point_of_vertex.assign(num_vertices_, -1);
  const auto set = [&](std::int64_t vertex, const Vec<3>& u) {
    out.mesh.vertices.col(vertex) = image_.origin + image_.spacing.cwiseProduct(u);
  };
  for_each_plane([&](Index k) {
    for_each_point(k, [&](const std::array<Index, 3>& at, std::size_t point) {
      std::uint32_t bits = bits_[point] & (split_bit - 1);
      if (bits == 0) return;
      std::int64_t vertex = first_vertex_[point];
      const Vec<3> u = position(at, point);
      for (; bits != 0; bits &= bits - 1, ++vertex) {
        const int bit = std::countr_zero(bits);
        if (bit == 0) {
          set(vertex, u);
          if (flags_[point] == 0) out.point_of_vertex[vertex] = static_cast<Index>(point);
        } else if (bit < first_face_bit) {
          const unsigned axes = static_cast<unsigned>(bit - first_edge_bit + 1);
          set(vertex, u + kept_cut(point, axes) * (position(point + offset_[axes]) - u));
        } else {
          set(vertex, junction(point, bit, u));
        }
      }
    });
    for (const Split& split : splits_[k])
      for (int copy = 0; copy + 1 < split.parts; ++copy) set(split.first_copy + copy, position(split.point));
  });
}

Vec<3> LatticeVertices::junction(std::size_t point, int bit, const Vec<3>& u) const {
  std::array<unsigned, 4> corner{};
  int count = 3;
  if (bit < first_cell_bit) {
    const auto& face = kuhn_faces()[bit - first_face_bit];
    corner = {0, face.middle, face.far, 0};
  } else {
    const auto& tet = kuhn_tets()[bit - first_cell_bit];
    std::copy(tet.corner.begin(), tet.corner.end(), corner.begin());
    count = 4;
  }
  std::array<double, 4> weight{};
  for (int i = 0; i < count; ++i)
    for (int j = i + 1; j < count; ++j) {
      const double t = kept_cut(point + offset_[corner[i]], corner[i] ^ corner[j]);
      weight[i] += 1.0 - t;
      weight[j] += t;
    }
  double sum = 0.0;
  for (int i = 0; i < count; ++i) {
    weight[i] = std::max(weight[i], junction_margin * count * (count - 1) / 2);
    sum += weight[i];
  }
  Vec<3> out = u;
  for (int i = 1; i < count; ++i) out += weight[i] / sum * (position(point + offset_[corner[i]]) - u);
  return out;
}

Index LatticeVertices::vertex(std::size_t cube, int number, std::uint8_t point) const {
  const KuhnTet& tet = kuhn_tets()[number];
  const std::size_t owner = cube + offset_[tet.owner[point]];
  const std::uint32_t bits = bits_[owner];
  if (bits & split_bit) {  // a point on the boundary owns nothing but itself
    const auto& plane = splits_[owner / stride_[2]];
    const Split& split = *std::ranges::lower_bound(plane, owner, {}, &Split::point);
    const int part = split.part[4 * number + std::countr_zero(static_cast<unsigned>(point))];
    if (part > 0) return static_cast<Index>(split.first_copy + part - 1);
  }
  return first_vertex_[owner] + std::popcount(bits & ((1u << tet.bit[point]) - 1));
}

}  // namespace efree::internal
