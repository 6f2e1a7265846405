// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/combinations.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// A part of the vectors where any of them is something, over the largest length among them.
Matrix condensed(const std::vector<Parts>& vectors, int part) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < vectors.front()[part].size(); ++i)
    if (std::ranges::any_of(vectors, [&](const Parts& vector) { return vector[part][i] != 0.0; })) rows.push_back(i);
  Matrix columns(std::ssize(rows), std::ssize(vectors));
  for (Index j = 0; j < columns.cols(); ++j)
    for (Index i = 0; i < columns.rows(); ++i) columns(i, j) = vectors[j][part][rows[i]];
  if (columns.size() > 0) columns /= columns.colwise().norm().maxCoeff();
  return columns;
}

}  // namespace

std::vector<std::vector<Term>> combinations(const std::vector<Parts>& vectors) {
  constexpr double rounding = 1e-11;
  const Matrix first = condensed(vectors, 0), second = condensed(vectors, 1);
  Matrix columns(first.rows() + second.rows(), first.cols());
  columns << first, second;
  std::vector<std::vector<Term>> sums(vectors.size());
  // Q R = those that are no sums (Gram & Schmidt, twice is enough).
  Matrix Q(columns.rows(), columns.cols()), R = Matrix::Zero(columns.cols(), columns.cols());
  std::vector<std::size_t> alone;
  for (Index k = 0; k < columns.cols(); ++k) {
    const auto rank = static_cast<Index>(alone.size());
    Vector rest = columns.col(k), along = Vector::Zero(rank);
    const double size = rest.norm();
    // Each part against its own: a small force beside a large motion is one.
    const auto is_left = [&] {
      return rest.head(first.rows()).norm() > rounding * first.col(k).norm() ||
             rest.tail(second.rows()).norm() > rounding * second.col(k).norm();
    };
    for (int pass = 0; pass < 2; ++pass) {
      const Vector more = Q.leftCols(rank).transpose() * rest;
      rest -= Q.leftCols(rank) * more;
      along += more;
    }
    const double left = rest.norm();
    if (is_left()) {
      Q.col(rank) = rest / left;
      R.col(rank).head(rank) = along;
      R(rank, rank) = left;
      alone.push_back(static_cast<std::size_t>(k));
    } else if (size > 0.0) {
      const Vector factors = R.topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solve(along);
      for (Index i = 0; i < rank; ++i)
        if (std::abs(factors[i]) * R.col(i).norm() > rounding * size) sums[k].push_back({alone[i], factors[i]});
    }
  }
  return sums;
}

}  // namespace efree::internal
