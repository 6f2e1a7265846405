// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/kuhn.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <map>

namespace efree::internal {
namespace {

using Point = std::uint8_t;  // mask of corners
using Simplex = std::vector<Point>;

constexpr Point bit_of(int corner) {
  return static_cast<Point>(1 << corner);
}

/// Class of each corner; subsets of corners are masks.
using Classes = std::array<int, 4>;

std::vector<int> members(unsigned subset, const Classes& classes, int of) {
  std::vector<int> out;
  for (int i = 0; i < 4; ++i)
    if (subset >> i & 1 && classes[i] == of) out.push_back(i);
  return out;
}

/// What lies between classes a and b in the simplex of the corners `subset`, which have labels all.
std::vector<Simplex> between(unsigned subset, const Classes& classes, int a, int b) {
  const auto in_a = members(subset, classes, a), in_b = members(subset, classes, b);
  if (in_a.empty() || in_b.empty()) return {};
  const auto edge = [](int i, int j) { return static_cast<Point>(bit_of(i) | bit_of(j)); };
  const int corners = std::popcount(subset), together = static_cast<int>(in_a.size() + in_b.size());
  const Point all = static_cast<Point>(subset);
  if (corners == 2) return {{all}};
  if (corners == 3) {
    Simplex segment;
    for (const int i : in_a)
      for (const int j : in_b) segment.push_back(edge(i, j));
    if (together == 2) segment.push_back(all);  // the third corner has a label of its own
    return {segment};
  }
  std::vector<Point> others;
  for (int i = 0; i < 4; ++i)
    if (classes[i] != a && classes[i] != b) others.push_back(bit_of(i));
  if (together == 4) {
    Simplex cuts;
    for (const int i : in_a)
      for (const int j : in_b) cuts.push_back(edge(i, j));
    if (cuts.size() == 3) return {cuts};
    return {{cuts[0], cuts[1], cuts[3]}, {cuts[0], cuts[3], cuts[2]}};  // the diagonal: both first, both last
  }
  if (together == 3) {
    const auto& pair = in_a.size() == 2 ? in_a : in_b;
    const int single = in_a.size() == 2 ? in_b[0] : in_a[0];
    const Point near = edge(pair[0], single), far = edge(pair[1], single);
    const Point near_face = near | others[0], far_face = far | others[0];
    return {{near, near_face, far_face}, {near, far_face, far}};
  }
  const Point cut = edge(in_a[0], in_b[0]);
  if (classes[std::countr_zero(others[0])] == classes[std::countr_zero(others[1])])
    return {{cut, static_cast<Point>(cut | others[0]), static_cast<Point>(cut | others[1])}};
  return {{cut, static_cast<Point>(cut | others[0]), all}, {cut, static_cast<Point>(cut | others[1]), all}};
}

/// The part of class a of the simplex of the corners `subset`: seen from its first corner, all else of its surface.
std::vector<Simplex> part(unsigned subset, const Classes& classes, int a) {
  const auto in_a = members(subset, classes, a);
  if (in_a.empty()) return {};
  if (static_cast<int>(in_a.size()) == std::popcount(subset)) {
    Simplex whole;
    for (const int i : in_a) whole.push_back(bit_of(i));
    return {whole};
  }
  std::vector<Simplex> seen = part(subset & ~static_cast<unsigned>(bit_of(in_a[0])), classes, a);
  for (int b = 1; b <= 4; ++b)
    if (b != a)
      for (const Simplex& simplex : between(subset, classes, a, b)) seen.push_back(simplex);
  for (Simplex& simplex : seen) simplex.insert(simplex.begin(), bit_of(in_a[0]));
  return seen;
}

Subdivision subdivide(const Classes& classes) {
  Subdivision out;
  unsigned labelled = 0;
  Simplex rest;
  for (int i = 0; i < 4; ++i)
    if (classes[i] > 0)
      labelled |= 1u << i;
    else
      rest.push_back(bit_of(i));
  const auto add = [&](Simplex simplex, int owner) {
    simplex.insert(simplex.end(), rest.begin(), rest.end());
    Eigen::Matrix4d corners;
    for (int k = 0; k < 4; ++k)
      for (int i = 0; i < 4; ++i) corners(i, k) = simplex[k] >> i & 1 ? 1.0 / std::popcount(simplex[k]) : 0.0;
    if (corners.determinant() < 0.0) std::swap(simplex[2], simplex[3]);
    Subdivision::Piece piece{{}, static_cast<std::uint8_t>(owner)};
    std::copy(simplex.begin(), simplex.end(), piece.points.begin());
    out.pieces.push_back(piece);
  };
  if (labelled == 0) add({}, 4);
  for (int a = 1; a <= 4; ++a)
    for (const Simplex& simplex : part(labelled, classes, a)) add(simplex, members(labelled, classes, a)[0]);

  std::map<std::array<Point, 3>, std::uint8_t> open;
  for (const auto& piece : out.pieces)
    for (int i = 0; i < 4; ++i) {
      std::array<Point, 3> facet{piece.points[(i + 1) % 4], piece.points[(i + 2) % 4], piece.points[(i + 3) % 4]};
      std::sort(facet.begin(), facet.end());
      const auto [it, fresh] = open.insert({facet, piece.owner});
      if (fresh) continue;
      if (it->second != piece.owner) out.interfaces.push_back({facet, it->second, piece.owner});
      open.erase(it);
    }
  for (const auto& [facet, owner] : open) {
    const unsigned corners = facet[0] | facet[1] | facet[2];
    out.outer.push_back({facet, owner, static_cast<std::uint8_t>(std::countr_one(corners)), (corners & labelled) == 0});
  }
  return out;
}

std::array<KuhnTet, 6> make_tets() {
  constexpr std::array<std::array<std::uint8_t, 3>, 6> orders{
      {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}};
  const auto number = [&](std::uint8_t a, std::uint8_t b, std::uint8_t c) {
    return static_cast<std::uint8_t>(std::find(orders.begin(), orders.end(), std::array{a, b, c}) - orders.begin());
  };
  std::array<KuhnTet, 6> tets{};
  for (std::uint8_t t = 0; t < 6; ++t) {
    KuhnTet& tet = tets[t];
    tet.axes = orders[t];
    const auto [a, b, c] = tet.axes;
    tet.corner = {0, bit_of(a), static_cast<std::uint8_t>(bit_of(a) | bit_of(b)), 7};
    tet.is_odd = t == 1 || t == 2 || t == 5;
    for (unsigned point = 1; point < 16; ++point) {
      std::vector<std::uint8_t> chain;
      for (int i = 0; i < 4; ++i)
        if (point >> i & 1) chain.push_back(tet.corner[i]);
      tet.owner[point] = chain[0];
      const auto from_first = [&](int k) { return static_cast<std::uint8_t>(chain[k] ^ chain[0]); };
      if (chain.size() == 1) tet.bit[point] = 0;
      if (chain.size() == 2) tet.bit[point] = static_cast<std::uint8_t>(first_edge_bit - 1 + from_first(1));
      if (chain.size() == 3)
        for (int f = 0; f < 12; ++f)
          if (kuhn_faces()[f].middle == from_first(1) && kuhn_faces()[f].far == from_first(2))
            tet.bit[point] = static_cast<std::uint8_t>(first_face_bit + f);
      if (chain.size() == 4) tet.bit[point] = static_cast<std::uint8_t>(first_cell_bit + t);
    }
    tet.beyond = {number(b, c, a), number(b, a, c), number(a, c, b), number(c, a, b)};
    tet.beyond_axis = {static_cast<std::int8_t>(a), -1, -1, static_cast<std::int8_t>(c)};
  }
  return tets;
}

KuhnStar make_star() {
  KuhnStar star{};
  for (std::uint8_t t = 0; t < 6; ++t)
    for (std::uint8_t i = 0; i < 4; ++i) {
      auto& tet = star.tets[4 * t + i];
      tet.tet = t;
      tet.corner = i;
      // Across a face the corners stay in their order; only the one opposite the first goes last and back.
      for (int f = 0; f < 4; ++f) {
        const int there = f == 0 ? i - 1 : f == 3 ? i + 1 : i;
        tet.next[f] = f == i ? std::uint8_t{24} : static_cast<std::uint8_t>(4 * kuhn_tets()[t].beyond[f] + there);
      }
    }
  return star;
}

}  // namespace

const std::array<KuhnFace, 12>& kuhn_faces() {
  static const std::array<KuhnFace, 12> faces = [] {
    std::array<KuhnFace, 12> out{};
    int f = 0;
    for (std::uint8_t far = 1; far < 8; ++far)
      for (std::uint8_t middle = 1; middle < far; ++middle)
        if ((middle & far) == middle) out[f++] = {middle, far};
    return out;
  }();
  return faces;
}

const std::array<KuhnTet, 6>& kuhn_tets() {
  static const std::array<KuhnTet, 6> tets = make_tets();
  return tets;
}

const KuhnStar& kuhn_star() {
  static const KuhnStar star = make_star();
  return star;
}

const Subdivision& subdivision(int classes) {
  static const std::vector<Subdivision> all = [] {
    std::vector<Subdivision> out(625);
    for (int code = 0; code < 625; ++code) {
      const Classes of{code % 5, code / 5 % 5, code / 25 % 5, code / 125};
      int most = 0;
      bool in_order = true;
      for (const int c : of) {
        in_order = in_order && c <= most + 1;
        most = std::max(most, c);
      }
      if (in_order) out[code] = subdivide(of);
    }
    return out;
  }();
  return all[classes];
}

}  // namespace efree::internal
