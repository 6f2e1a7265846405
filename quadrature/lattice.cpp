// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/quadrature/lattice.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace efree {
namespace {

/// Distance from a plane, over the spacing, below which a corner is on it.
constexpr double on_plane = 1e-9;

template <int Dim> using Simplex = std::array<Vec<Dim>, Dim + 1>;

template <int Dim> double volume_of(const Simplex<Dim>& corners) {
  Mat<Dim> edges;
  for (int i = 0; i < Dim; ++i) edges.col(i) = corners[i + 1] - corners[0];
  return std::abs(edges.determinant()) / (Dim == 2 ? 2.0 : 6.0);
}

/// Calls visit(piece) for pieces that no plane cuts. Corners are over the spacing, from the origin on.
template <int Dim, class Visit> void cut(const Simplex<Dim>& simplex, const Visit& visit) {
  for (int axis = 0; axis < Dim; ++axis) {
    double low = simplex[0][axis], high = low;
    for (const Vec<Dim>& corner : simplex) {
      low = std::min(low, corner[axis]);
      high = std::max(high, corner[axis]);
    }
    const double first = std::floor(low + on_plane) + 1.0, last = std::ceil(high - on_plane) - 1.0;
    if (first > last) continue;
    const double plane = std::floor(0.5 * (first + last));
    // An edge that the plane cuts: its two ends have a part each, which other edges may cut again.
    for (int a = 0; a <= Dim; ++a)
      for (int b = 0; b <= Dim; ++b) {
        if (!(simplex[a][axis] < plane - on_plane) || !(simplex[b][axis] > plane + on_plane)) continue;
        const double t = (plane - simplex[a][axis]) / (simplex[b][axis] - simplex[a][axis]);
        Vec<Dim> middle = simplex[a] + t * (simplex[b] - simplex[a]);
        middle[axis] = plane;
        Simplex<Dim> below = simplex, above = simplex;
        below[b] = middle;
        above[a] = middle;
        cut<Dim>(below, visit);
        cut<Dim>(above, visit);
        return;
      }
  }
  visit(simplex);
}

template <int Dim> using Cell = std::array<Index, Dim>;
template <int Dim> struct Piece {
  double volume = 0.0;
  Vec<Dim> moment = Vec<Dim>::Zero();
};
template <int Dim> using Pieces = std::map<Cell<Dim>, Piece<Dim>>;

template <int Dim> void join_slivers(Pieces<Dim>& pieces, double least) {
  // Of cells as they are cut: what has joined one does not make it any larger for others.
  std::vector<std::pair<Cell<Dim>, Cell<Dim>>> joins;
  for (const auto& [cell, piece] : pieces) {
    if (piece.volume >= least) continue;
    double largest = piece.volume;
    Cell<Dim> best = cell;
    for (int axis = 0; axis < Dim; ++axis)
      for (const Index step : {-1, 1}) {
        Cell<Dim> next = cell;
        next[axis] += step;
        const auto found = pieces.find(next);
        if (found == pieces.end() || found->second.volume < least || found->second.volume <= largest) continue;
        largest = found->second.volume;
        best = next;
      }
    if (best != cell) joins.emplace_back(cell, best);
  }
  for (const auto& [from, to] : joins) {
    Piece<Dim>& into = pieces[to];
    into.volume += pieces[from].volume;
    into.moment += pieces[from].moment;
    pieces.erase(from);
  }
}

}  // namespace

template <int Dim>
LatticePieces<Dim> cut_by_lattice(const FineMesh<Dim>& mesh, const Vec<Dim>& origin, double spacing, double least) {
  if (!(spacing > 0.0) || !std::isfinite(spacing) || !origin.allFinite())
    throw InputError(fmt::format("spacing of a lattice {}, expected a positive length", spacing));
  const Points<Dim> at = (mesh.vertices().colwise() - origin) / spacing;
  if (!(at.cwiseAbs().maxCoeff() < 1e8))
    throw InputError(fmt::format("spacing of a lattice {:.6g}: the mesh is {:.3g} times as far from its origin",
                                 spacing, at.cwiseAbs().maxCoeff()));
  Pieces<Dim> pieces;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    Simplex<Dim> simplex;
    for (int i = 0; i <= Dim; ++i) simplex[i] = at.col(mesh.cells()(i, c));
    cut<Dim>(simplex, [&](const Simplex<Dim>& piece) {
      Vec<Dim> centroid = Vec<Dim>::Zero();
      for (const Vec<Dim>& corner : piece) centroid += corner / (Dim + 1);
      Cell<Dim> cell;
      for (int i = 0; i < Dim; ++i) cell[i] = static_cast<Index>(std::floor(centroid[i]));
      const double volume = volume_of<Dim>(piece);
      Piece<Dim>& into = pieces[cell];
      into.volume += volume;
      into.moment += volume * centroid;
    });
  }
  join_slivers<Dim>(pieces, least);
  std::erase_if(pieces, [](const auto& entry) { return !(entry.second.volume > 0.0); });
  LatticePieces<Dim> result;
  const auto M = static_cast<Index>(pieces.size());
  result.centroids.resize(Dim, M);
  result.volumes.resize(M);
  result.cell.resize(Dim, M);
  Index p = 0;
  for (const auto& [cell, piece] : pieces) {
    result.centroids.col(p) = origin + spacing / piece.volume * piece.moment;
    result.volumes[p] = std::pow(spacing, Dim) * piece.volume;
    result.cell.col(p++) = Eigen::Map<const Eigen::Vector<Index, Dim>>(cell.data());
  }
  return result;
}

template LatticePieces<2> cut_by_lattice(const FineMesh<2>&, const Vec<2>&, double, double);
template LatticePieces<3> cut_by_lattice(const FineMesh<3>&, const Vec<3>&, double, double);

}  // namespace efree
