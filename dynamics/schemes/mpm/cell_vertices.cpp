// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/cell_vertices.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/ranges.h>
#include <Eigen/LU>
#include <map>
#include <numeric>

namespace efree::internal {
namespace {

/// Some cells with local numbers of vertices, in the order in which these come up; seen: the numbers they had.
template <int Dim>
Cells<Dim> number_locally(const Cells<Dim>& cells, const std::vector<Index>& some, std::vector<Index>& seen) {
  std::map<Index, Index> local;
  seen.clear();
  Cells<Dim> result(Dim + 1, std::ssize(some));
  for (std::size_t k = 0; k < some.size(); ++k)
    for (int i = 0; i <= Dim; ++i) {
      const auto [place, is_new] = local.try_emplace(cells(i, some[k]), static_cast<Index>(seen.size()));
      if (is_new) seen.push_back(place->first);
      result(i, static_cast<Index>(k)) = place->second;
    }
  return result;
}

}  // namespace

template <int Dim>
CellVertices<Dim>::CellVertices(const Chunk<Dim>& chunk, const Cells<Dim>& of_body, const Points<Dim>& vertices)
    : cells(number_locally<Dim>(of_body, chunk.number, number)), X(vertices(Eigen::all, number)), x(X) {
  complete(chunk.matter);
}

template <int Dim>
CellVertices<Dim> CellVertices<Dim>::select(const std::vector<Index>& some, std::vector<Index>& selected) const {
  CellVertices result;
  result.cells = number_locally<Dim>(cells, some, selected);
  for (const Index l : selected) result.number.push_back(number[l]);
  result.X = X(Eigen::all, selected);
  result.x = x(Eigen::all, selected);
  return result;
}

template <int Dim> void CellVertices<Dim>::release(Index point) {
  for (Points<Dim>* positions : {&X, &x}) {
    const Vec<Dim> middle = (*positions)(Eigen::all, cells.col(point)).rowwise().mean();
    positions->conservativeResize(Eigen::NoChange, positions->cols() + 1);
    positions->rightCols(1) = middle;
  }
  cells.col(point).setConstant(static_cast<Index>(number.size()));
  number.push_back(-1);
}

template <int Dim> void CellVertices<Dim>::complete(const Matter<Dim>& matter) {
  mass.setZero(X.cols());
  table = {};
  for (Index c = 0; c < cells.cols(); ++c) {
    Mat<Dim> edges;
    for (int i = 0; i < Dim; ++i) edges.col(i) = X.col(cells(i + 1, c)) - X.col(cells(0, c));
    if (is_released(c)) edges.setIdentity();  // it is not deformed any more
    if (!(edges.determinant() > 0.0))
      throw InputError(fmt::format("the cell at ({:.6g}) has no volume, or its vertices are in the wrong order",
                                   fmt::join(X.col(cells(0, c)), ", ")));
    const Mat<Dim> slopes = edges.inverse();  // by rows, of all functions but the first
    TableEntry row[Dim + 1];
    for (int i = 0; i <= Dim; ++i) {
      const Vec<Dim> dN = i == 0 ? Vec<Dim>(-slopes.colwise().sum().transpose()) : Vec<Dim>(slopes.row(i - 1));
      row[i] = table_entry<Dim>(1.0 / (Dim + 1), dN, 0.0);
      table.local.push_back(static_cast<std::uint16_t>(cells(i, c)));
      mass[cells(i, c)] += matter.mass[c] / (Dim + 1);
    }
    complete_row<Dim>(Dim + 1, [&](std::size_t k) -> TableEntry& { return row[k]; });
    table.entries.insert(table.entries.end(), row, row + Dim + 1);
    table.offsets.push_back(static_cast<Index>(table.entries.size()));
  }
  table.nodes.resize(number.size());
  std::iota(table.nodes.begin(), table.nodes.end(), 0);
  for (auto* numbers : {&table.x, &table.force}) numbers->assign(4 * number.size(), 0.0);
}

template <int Dim>
Points<Dim * Dim> CellVertices<Dim>::spatial_gradients(Chunk<Dim>& chunk, const Points<Dim>& values) {
  double* columns = chunk.columns();
  interpolate_by_table(table, values, false, columns);
  Points<Dim * Dim> result(Dim * Dim, chunk.size());
  for (Index p = 0; p < chunk.size(); ++p) {
    Mat<Dim> gradient;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) gradient(i, j) = columns[16 * p + 4 * i + j];
    const Mat<Dim> F = chunk.matter.F_since[p].template topLeftCorner<Dim, Dim>();
    Eigen::Map<Mat<Dim>>(result.col(p).data()) = gradient * F.inverse();
  }
  return result;
}

template <int Dim> const double* CellVertices<Dim>::forces(const World<Dim>& world, Chunk<Dim>& chunk) {
  scatter_by_table(world, chunk, chunk.matter.F_since, table);
  return table.force.data();
}

template struct CellVertices<2>;
template struct CellVertices<3>;

}  // namespace efree::internal
