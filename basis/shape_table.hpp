// SPDX-License-Identifier: GPL-3.0-or-later
/// The one central type: which nodes act at a point, and how strongly.
#pragma once

#include "efree/core/types.hpp"

#include <span>
#include <vector>

namespace efree {

/// One row: views into the table.
template <int Dim> struct ShapeRow {
  std::span<const Index> nodes;  ///< ascending
  std::span<const double> N;     ///< [-]
  std::span<const Vec<Dim>> dN;  ///< [1/length]; empty in a table without gradients
  std::span<const double> hoop;  ///< N over the radius [1/length]; empty unless axisymmetric
};

/// Compressed rows: row = evaluation point (fine degree of freedom, quadrature point), columns = nodes. MLS, finite
/// elements and everything to come are tables of this kind; drivers never know which.
template <int Dim> class ShapeTable {
 public:
  ShapeTable() = default;
  /// Takes flat arrays. dN and hoop are empty or as long as N.
  ShapeTable(Index num_nodes, std::vector<Index> offsets, std::vector<Index> nodes, std::vector<double> N,
             std::vector<Vec<Dim>> dN = {}, std::vector<double> hoop = {})
      : num_nodes_(num_nodes),
        offsets_(std::move(offsets)),
        nodes_(std::move(nodes)),
        N_(std::move(N)),
        dN_(std::move(dN)),
        hoop_(std::move(hoop)) {}

  /// Every point is a node of its own: finite elements.
  static ShapeTable identity(Index size);

  Index num_points() const { return static_cast<Index>(offsets_.size()) - 1; }
  Index num_nodes() const { return num_nodes_; }
  Index num_entries() const { return static_cast<Index>(nodes_.size()); }
  bool has_gradients() const { return !dN_.empty(); }
  bool has_hoop() const { return !hoop_.empty(); }

  ShapeRow<Dim> row(Index p) const {
    const auto begin = static_cast<std::size_t>(offsets_[p]), count = static_cast<std::size_t>(offsets_[p + 1]) - begin;
    return {{nodes_.data() + begin, count},
            {N_.data() + begin, count},
            {dN_.data() + (dN_.empty() ? 0 : begin), dN_.empty() ? 0 : count},
            {hoop_.data() + (hoop_.empty() ? 0 : begin), hoop_.empty() ? 0 : count}};
  }

  /// Zero-copy sparse view of N, num_points x num_nodes.
  Eigen::Map<const SparseRows> matrix() const {
    return {num_points(), num_nodes_, num_entries(), offsets_.data(), nodes_.data(), N_.data()};
  }

 private:
  Index num_nodes_ = 0;
  std::vector<Index> offsets_{0};
  std::vector<Index> nodes_;
  std::vector<double> N_;
  std::vector<Vec<Dim>> dN_;
  std::vector<double> hoop_;
};

/// Values at the points of `shape` of the field with the given coefficients (rows x N): rows x num_points.
template <int Dim> Matrix interpolate(const ShapeTable<Dim>& shape, const Eigen::Ref<const Matrix>& coefficients);

}  // namespace efree
