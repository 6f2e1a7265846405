// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/basis/shape_table.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

namespace efree {

template <int Dim> ShapeTable<Dim> ShapeTable<Dim>::identity(Index size) {
  std::vector<Offset> offsets(size + 1);
  std::vector<Index> nodes(size);
  std::iota(offsets.begin(), offsets.end(), 0);
  std::iota(nodes.begin(), nodes.end(), 0);
  return {size, std::move(offsets), std::move(nodes), std::vector<double>(size, 1.0)};
}

template <int Dim>
void ShapeTable<Dim>::reshape(Index num_nodes, std::span<const Index> counts, bool gradients, bool hoop) {
  num_nodes_ = num_nodes;
  offsets_.resize(counts.size() + 1);
  offsets_[0] = 0;
  for (std::size_t p = 0; p < counts.size(); ++p) {
    if (counts[p] < 0) throw InputError(fmt::format("a table with {} entries in row {}", counts[p], p));
    offsets_[p + 1] = offsets_[p] + counts[p];
  }
  const auto entries = static_cast<std::size_t>(offsets_.back());
  nodes_.resize(entries);
  N_.resize(entries);
  dN_.resize(gradients ? entries : 0);
  hoop_.resize(hoop ? entries : 0);
  // The transpose is another one now, in the same storage unless a copy of the table has it, too.
  if (transpose_.use_count() == 1)
    transpose_->is_made = false;
  else
    transpose_ = std::make_shared<Transpose>();
}

template <int Dim> SparseRows ShapeTable<Dim>::matrix() const {
  if (num_entries() > std::numeric_limits<Index>::max())
    throw InputError(fmt::format("a table of {} entries is too large for a sparse matrix", num_entries()));
  const std::vector<Index> offsets(offsets_.begin(), offsets_.end());
  return Eigen::Map<const SparseRows>(num_points(), num_nodes_, static_cast<Index>(num_entries()), offsets.data(),
                                      nodes_.data(), N_.data());
}

template <int Dim> const NodePlaces& ShapeTable<Dim>::by_node() const {
  if (!transpose_->is_made) {
    const std::lock_guard lock(transpose_->making);
    if (!transpose_->is_made) transpose(transpose_->places);
    transpose_->is_made = true;
  }
  return transpose_->places;
}

/// Every part of the rows counts its places of each node; their sums say where each part writes them.
template <int Dim> void ShapeTable<Dim>::transpose(NodePlaces& out) const {
  constexpr Index most_parts = 8;
  const Index part_rows = std::max<Index>(1024, (num_points() + most_parts - 1) / most_parts);
  std::vector<std::vector<Index>> next((num_points() + part_rows - 1) / part_rows);  // by part and node
  const auto for_each_entry = [&](Index begin, Index end, const auto& visit) {
    for (Index p = begin; p < end; ++p) {
      const auto [first, count] = range(p);
      for (std::size_t k = 0; k < count; ++k) visit(p, static_cast<Index>(k), nodes_[first + k]);
    }
  };
  parallel_chunks(num_points(), part_rows, [&](Index begin, Index end) {
    auto& counts = next[begin / part_rows];
    counts.assign(num_nodes_, 0);
    for_each_entry(begin, end, [&](Index, Index, Index node) { ++counts[node]; });
  });
  out.offsets_.resize(num_nodes_ + 1);
  out.offsets_[0] = 0;
  for (Index node = 0; node < num_nodes_; ++node) {
    Index before = 0;
    for (auto& part : next) before += std::exchange(part[node], before);
    out.offsets_[node + 1] = out.offsets_[node] + before;
  }
  out.places_.resize(static_cast<std::size_t>(out.offsets_.back()));
  parallel_chunks(num_points(), part_rows, [&](Index begin, Index end) {
    auto& cursor = next[begin / part_rows];
    for_each_entry(begin, end, [&](Index p, Index k, Index node) {
      out.places_[out.offsets_[node] + cursor[node]++] = {p, k};
    });
  });
}

namespace {

template <int Rows, int Dim>
Matrix interpolate_rows(const ShapeTable<Dim>& shape, const Eigen::Ref<const Matrix>& coefficients) {
  using Columns = Eigen::Matrix<double, Rows, Eigen::Dynamic>;
  Matrix values(coefficients.rows(), shape.num_points());
  const Eigen::Map<const Columns, 0, Eigen::OuterStride<>> from(coefficients.data(), coefficients.rows(),
                                                                coefficients.cols(), coefficients.outerStride());
  Eigen::Map<Columns> to(values.data(), values.rows(), values.cols());
  parallel_for(shape.num_points(), [&](Index p) {
    const auto row = shape.row(p);
    Eigen::Matrix<double, Rows, 1> sum = Eigen::Matrix<double, Rows, 1>::Zero(from.rows());
    for (std::size_t k = 0; k < row.nodes.size(); ++k) sum += row.N[k] * from.col(row.nodes[k]);
    to.col(p) = sum;
  });
  return values;
}

}  // namespace

template <int Dim> Matrix interpolate(const ShapeTable<Dim>& shape, const Eigen::Ref<const Matrix>& coefficients) {
  if (coefficients.cols() != shape.num_nodes())
    throw InputError(
        fmt::format("interpolate: {} columns of coefficients for {} nodes", coefficients.cols(), shape.num_nodes()));
  if (coefficients.rows() == Dim) return interpolate_rows<Dim>(shape, coefficients);
  return interpolate_rows<Eigen::Dynamic>(shape, coefficients);
}

template class ShapeTable<2>;
template class ShapeTable<3>;
template Matrix interpolate<2>(const ShapeTable<2>&, const Eigen::Ref<const Matrix>&);
template Matrix interpolate<3>(const ShapeTable<3>&, const Eigen::Ref<const Matrix>&);

}  // namespace efree
