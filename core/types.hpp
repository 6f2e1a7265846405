// SPDX-License-Identifier: GPL-3.0-or-later
/// Index and matrix types shared by every layer.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <cstdint>
#include <functional>
#include <span>
#include <type_traits>
#include <vector>

namespace efree {

/// Index of a vertex, cell, facet, node or quadrature point. Flat arrays hold at most 2^31 - 1 entries.
using Index = std::int32_t;

template <int Dim> using Vec = Eigen::Matrix<double, Dim, 1>;
template <int Dim> using Mat = Eigen::Matrix<double, Dim, Dim>;
using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

/// Dim x n, column = point.
template <int Dim> using Points = Eigen::Matrix<double, Dim, Eigen::Dynamic>;

/// Compressed rows: row = evaluation point, column = function. Column indices ascend within a row.
using SparseRows = Eigen::SparseMatrix<double, Eigen::RowMajor, Index>;

/// Components of a symmetric tensor in Voigt order: normal ones first, then shear. In the plane xx, yy, xy; in space
/// xx, yy, zz, yz, xz, xy. Axisymmetric (Dim = 2, Normals = 3; x is the radius r, y the axis z, t the hoop direction):
/// rr, zz, tt, rz.
template <int Dim, int Normals = Dim> inline constexpr int voigt_size = Normals + Dim*(Dim - 1) / 2;
template <int Dim, int Normals = Dim> using Voigt = Eigen::Matrix<double, voigt_size<Dim, Normals>, 1>;
template <int Dim, int Normals = Dim> using VoigtMatrix =
    Eigen::Matrix<double, voigt_size<Dim, Normals>, voigt_size<Dim, Normals>>;
/// Any of the above in Dim dimensions: in 2D the analysis decides whether there are 3 or 4.
template <int Dim> inline constexpr int voigt_rows = voigt_size<Dim>;
template <> inline constexpr int voigt_rows<2> = Eigen::Dynamic;
template <int Dim> using VoigtValue = Eigen::Matrix<double, voigt_rows<Dim>, 1, 0, voigt_size<Dim, 3>, 1>;
/// A VoigtValue in every column = point.
template <int Dim> using VoigtPoints = Eigen::Matrix<double, voigt_rows<Dim>, Eigen::Dynamic>;

/// Calls visit(Number<Normals>) with the number of normal strains of an analysis: 2 in the plane, else 3.
template <int N> using Number = std::integral_constant<int, N>;
template <int Dim, class Visit> decltype(auto) with_normals(bool axisymmetric, const Visit& visit) {
  if constexpr (Dim == 2)
    if (!axisymmetric) return visit(Number<2>{});
  return visit(Number<3>{});
}

/// Scalar and vector fields over the reference configuration.
template <int Dim> using ScalarField = std::function<double(const Vec<Dim>&)>;
template <int Dim> using VectorField = std::function<Vec<Dim>(const Vec<Dim>&)>;
template <int Dim> using VoigtField = std::function<VoigtValue<Dim>(const Vec<Dim>&)>;

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
