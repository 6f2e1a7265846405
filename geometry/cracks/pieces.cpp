// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cracks/internal/pieces.hpp"

#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// Numbers of the nodes of middles, after those of the vertices.
template <int Dim> class NodeNumbers {
 public:
  NodeNumbers(Index vertices, const CrackMiddles<Dim>& of) : middles_(of), first_{vertices} {
    for (const CrackMiddle<Dim>& middle : of.all()) first_.push_back(first_.back() + middle.groups);
  }
  /// The node of a middle on the side of one of its vertices.
  Index operator()(Index middle, Index vertex) const {
    return first_[middle] + middles_.all()[middle].group_of(vertex);
  }

 private:
  const CrackMiddles<Dim>& middles_;
  std::vector<Index> first_;  // by middle, that of its first group; and the end
};

/// Cuts one cell after the other.
template <int Dim> class PieceMaker {
 public:
  PieceMaker(const Cells<Dim>& cells, const Skeleton<Dim>& skeleton, const CrackMiddles<Dim>& middles, Index vertices)
      : cells_(cells), skeleton_(skeleton), middles_(middles), node_(vertices, middles) {}

  void add_cell(Index c) {
    cell_ = c;
    const Index middle = middles_.of_cell(c);
    if (middle < 0) add(corner_nodes(c), cells_(0, c));
    for (std::size_t i = 0; i <= Dim; ++i) {
      std::array<Index, Dim> facet;
      for (int k = 0; k < Dim; ++k) facet[k] = cells_(facets_of_cell<Dim>[i][k], c);
      const bool is_outside = skeleton_.facets.count[skeleton_.facet(c, i)] == 1;
      divide_facet(facet, i, [&](const std::array<Index, Dim>& part, Index vertex, bool by_cut) {
        if (is_outside) add_surface(part, false);
        if (middle < 0) return;
        Simplex piece;
        piece[0] = node_(middle, vertex);
        std::ranges::copy(part, piece.begin() + 1);
        add(piece, vertex);
        if (by_cut) add_surface(opposite(piece, vertex), true);
      });
    }
  }

  using Simplex = std::array<Index, Dim + 1>;
  Pieces<Dim> pieces;

 private:
  void add(const Simplex& piece, Index vertex) {
    pieces.cells.push_back(piece);
    pieces.vertex.push_back(vertex);
  }
  void add_surface(const std::array<Index, Dim>& facet, bool by_cut) {
    pieces.surface.push_back(facet);
    pieces.is_crack.push_back(by_cut ? 1 : 0);
  }
  Simplex corner_nodes(Index c) const {
    Simplex nodes;
    for (int i = 0; i <= Dim; ++i) nodes[i] = cells_(i, c);
    return nodes;
  }
  /// The facet opposite a node, outwards.
  static std::array<Index, Dim> opposite(const Simplex& piece, Index node) {
    const auto at = static_cast<std::size_t>(std::ranges::find(piece, node) - piece.begin());
    const auto& local = facets_of_cell<Dim>[Dim == 2 ? (at + 1) % 3 : at];
    std::array<Index, Dim> facet;
    for (int k = 0; k < Dim; ++k) facet[k] = piece[local[k]];
    return facet;
  }
  /// The middle of a cell's edge, or -1.
  Index middle_between(Index a, Index b) const {
    for (std::size_t i = 0; i < edges_of_cell<Dim>.size(); ++i) {
      const Index edge = skeleton_.edge(cell_, i);
      const auto& ends = skeleton_.edges.vertices[edge];
      if (ends[0] == std::min(a, b) && ends[1] == std::max(a, b)) return middles_.of_edge(edge);
    }
    return -1;
  }
  /// Calls add(nodes, one of their vertices, whether it ends at a cut) for the parts of an edge, in its direction.
  template <class Add> void divide_edge(Index a, Index b, const Add& add) const {
    const Index middle = middle_between(a, b);
    if (middle < 0) {
      add(std::array{a, b}, a, false);
    } else {
      add(std::array{a, node_(middle, a)}, a, true);
      add(std::array{node_(middle, b), b}, b, true);
    }
  }
  /// Likewise for facet i of the cell.
  template <class Add> void divide_facet(const std::array<Index, Dim>& facet, std::size_t i, const Add& add) const {
    if constexpr (Dim == 2) {
      divide_edge(facet[0], facet[1], add);
    } else {
      const Index middle = middles_.of_face(skeleton_.facet(cell_, i));
      if (middle < 0) return add(facet, facet[0], false);
      for (std::size_t k = 0; k < 3; ++k)
        divide_edge(facet[k], facet[(k + 1) % 3], [&](const std::array<Index, 2>& part, Index vertex, bool by_cut) {
          add(std::array{part[0], part[1], node_(middle, vertex)}, vertex, by_cut);
        });
    }
  }

  const Cells<Dim>& cells_;
  const Skeleton<Dim>& skeleton_;
  const CrackMiddles<Dim>& middles_;
  NodeNumbers<Dim> node_;
  Index cell_ = 0;
};

}  // namespace

template <int Dim> Pieces<Dim> cut_into_pieces(const Cells<Dim>& cells, const Skeleton<Dim>& skeleton,
                                               const CrackMiddles<Dim>& middles, Index vertices) {
  PieceMaker<Dim> maker(cells, skeleton, middles, vertices);
  for (Index c = 0; c < cells.cols(); ++c) maker.add_cell(c);
  return std::move(maker.pieces);
}

template Pieces<2> cut_into_pieces(const Cells<2>&, const Skeleton<2>&, const CrackMiddles<2>&, Index);
template Pieces<3> cut_into_pieces(const Cells<3>&, const Skeleton<3>&, const CrackMiddles<3>&, Index);

}  // namespace efree::internal
