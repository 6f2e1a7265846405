// SPDX-License-Identifier: GPL-3.0-or-later
/// Index and matrix types shared by every layer.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace efree {

/// Index of a vertex, cell, facet, node or quadrature point. Flat arrays hold at most 2^31 - 1 entries.
using Index = std::int32_t;

template <int Dim> using Vec = Eigen::Matrix<double, Dim, 1>;    ///< a column
template <int Dim> using Mat = Eigen::Matrix<double, Dim, Dim>;  ///< a tensor
using Vector = Eigen::VectorXd;                                  ///< a column of any length
using Matrix = Eigen::MatrixXd;                                  ///< of any size

/// Dim x n, column = point.
template <int Dim> using Points = Eigen::Matrix<double, Dim, Eigen::Dynamic>;

/// Compressed rows: row = evaluation point, column = function. Column indices ascend within a row.
using SparseRows = Eigen::SparseMatrix<double, Eigen::RowMajor, Index>;

/// Components of a symmetric tensor in Voigt order: normal ones first, then shear. In space xx, yy, zz, yz, xz, xy; in
/// 2D xx, yy, zz, xy, where z is across the plane or, axisymmetric (x the radius, y the axis), along the hoop.
template <int Dim> inline constexpr int voigt_size = Dim == 2 ? 4 : 6;
template <int Dim> using Voigt = Eigen::Matrix<double, voigt_size<Dim>, 1>;                      ///< a symmetric tensor
template <int Dim> using VoigtMatrix = Eigen::Matrix<double, voigt_size<Dim>, voigt_size<Dim>>;  ///< a stiffness
/// A symmetric tensor in every column = point.
template <int Dim> using VoigtPoints = Points<voigt_size<Dim>>;

/// Scalar and vector fields over the reference configuration.
template <int Dim> using ScalarField = std::function<double(const Vec<Dim>&)>;
template <int Dim> using VectorField = std::function<Vec<Dim>(const Vec<Dim>&)>;   ///< vectors
template <int Dim> using VoigtField = std::function<Voigt<Dim>(const Vec<Dim>&)>;  ///< symmetric tensors

/// Rows of varying length in one flat array: row i is items[offsets[i] .. offsets[i+1]).
template <class T> struct Ragged {
  std::vector<Index> offsets{0};
  std::vector<T> items;

  Index rows() const { return static_cast<Index>(offsets.size()) - 1; }
  std::span<const T> operator[](Index i) const { return {items.data() + offsets[i], items.data() + offsets[i + 1]}; }
  /// Closes the row made of everything appended to `items` since the last call.
  void close_row() { offsets.push_back(static_cast<Index>(items.size())); }
};

}  // namespace efree
