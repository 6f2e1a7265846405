// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/shape_table.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <numeric>

namespace efree {

template <int Dim> ShapeTable<Dim> ShapeTable<Dim>::identity(Index size) {
  std::vector<Index> offsets(size + 1), nodes(size);
  std::iota(offsets.begin(), offsets.end(), 0);
  std::iota(nodes.begin(), nodes.end(), 0);
  return {size, std::move(offsets), std::move(nodes), std::vector<double>(size, 1.0)};
}

template <int Dim> Matrix interpolate(const ShapeTable<Dim>& shape, const Eigen::Ref<const Matrix>& coefficients) {
  if (coefficients.cols() != shape.num_nodes())
    throw InputError(
        fmt::format("interpolate: {} columns of coefficients for {} nodes", coefficients.cols(), shape.num_nodes()));
  Matrix values(coefficients.rows(), shape.num_points());
  parallel_for(shape.num_points(), [&](Index p) {
    const auto row = shape.row(p);
    values.col(p).setZero();
    for (std::size_t k = 0; k < row.nodes.size(); ++k) values.col(p) += row.N[k] * coefficients.col(row.nodes[k]);
  });
  return values;
}

template class ShapeTable<2>;
template class ShapeTable<3>;
template Matrix interpolate<2>(const ShapeTable<2>&, const Eigen::Ref<const Matrix>&);
template Matrix interpolate<3>(const ShapeTable<3>&, const Eigen::Ref<const Matrix>&);

}  // namespace efree
