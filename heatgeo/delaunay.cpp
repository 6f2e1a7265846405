// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/heat.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

namespace efree {
namespace {

/// Triangles with neighbours, neighbour(i, c) lying opposite vertex i.
class Flipper {
 public:
  explicit Flipper(const FineMesh<2>& mesh) : cells(mesh.cells()), mesh_(mesh), neighbours_(3, mesh.num_cells()) {
    for (Index c = 0; c < mesh.num_cells(); ++c)
      for (Index i = 0; i < 3; ++i) neighbours_(i, c) = mesh.neighbour(i, c);
  }

  /// Lawson's flips; exact predicates make them end.
  void run() {
    for (Index c = 0; c < cells.cols(); ++c)
      for (Index i = 0; i < 3; ++i) {
        pending_.push_back({i, c});
        while (!pending_.empty()) {
          const auto [facet, cell] = pending_.back();
          pending_.pop_back();
          if (!is_delaunay(facet, cell)) flip(facet, cell);
        }
      }
  }

  Cells<2> cells;

 private:
  using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_2;
  Point point(Index i, Index c) const {
    const auto x = mesh_.vertices().col(cells(i, c));
    return {x.x(), x.y()};
  }

  Index mirror(Index c, Index of) const { return neighbours_(0, c) == of ? 0 : neighbours_(1, c) == of ? 1 : 2; }

  bool is_delaunay(Index i, Index c) const {
    const Index n = neighbours_(i, c);
    if (n < 0) return true;
    return CGAL::side_of_oriented_circle(point(0, c), point(1, c), point(2, c), point(mirror(n, c), n)) !=
           CGAL::ON_POSITIVE_SIDE;
  }

  /// Cells (p, a, b) and (q, b, a) become (p, a, q) and (p, q, b).
  void flip(Index i, Index c) {
    const Index n = neighbours_(i, c), j = mirror(n, c);
    const Index p = cells(i, c), a = cells((i + 1) % 3, c), b = cells((i + 2) % 3, c), q = cells(j, n);
    const Index beyond_bp = neighbours_((i + 1) % 3, c), beyond_pa = neighbours_((i + 2) % 3, c);
    const Index beyond_aq = neighbours_((j + 1) % 3, n), beyond_qb = neighbours_((j + 2) % 3, n);
    if (beyond_bp >= 0) neighbours_(mirror(beyond_bp, c), beyond_bp) = n;
    if (beyond_aq >= 0) neighbours_(mirror(beyond_aq, n), beyond_aq) = c;
    cells.col(c) << p, a, q;
    neighbours_.col(c) << beyond_aq, n, beyond_pa;
    cells.col(n) << p, q, b;
    neighbours_.col(n) << beyond_qb, beyond_bp, c;
    pending_.insert(pending_.end(), {{0, c}, {2, c}, {0, n}, {1, n}});
  }

  struct Facet {
    Index opposite, cell;
  };

  const FineMesh<2>& mesh_;
  Cells<2> neighbours_;
  std::vector<Facet> pending_;
};

}  // namespace

Cells<2> delaunay_cells(const FineMesh<2>& mesh) {
  Flipper flipper(mesh);
  flipper.run();
  return std::move(flipper.cells);
}

}  // namespace efree
