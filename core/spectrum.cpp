// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/internal/spectrum.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

namespace efree::internal {

/// Larger ones by the code for any size.
template <int N> constexpr int compiled_size = N <= 3 ? N : Eigen::Dynamic;

template <int N> Spectrum<N> spectrum(const Mat<N>& symmetric) {
  if constexpr (N == compiled_size<N>) {
    const Eigen::SelfAdjointEigenSolver<Mat<N>> eigen(symmetric);
    return {eigen.eigenvalues(), eigen.eigenvectors()};
  } else {
    const auto of = spectrum<compiled_size<N>>(symmetric);
    return {of.values, of.vectors};
  }
}

template <int N> Vec<N> eigenvalues(const Mat<N>& symmetric) {
  if constexpr (N == compiled_size<N>)
    return Eigen::SelfAdjointEigenSolver<Mat<N>>(symmetric, Eigen::EigenvaluesOnly).eigenvalues();
  else
    return eigenvalues<compiled_size<N>>(symmetric);
}

template <int N> Mat<N> pseudo_inverse(const Mat<N>& symmetric) {
  const Spectrum<N> of = spectrum<N>(symmetric);
  constexpr double negligible = 1e-12;
  const double zero = negligible * of.values.cwiseAbs().maxCoeff();
  const Vec<N> inverses =
      of.values.unaryExpr([zero](double value) { return std::abs(value) > zero ? 1.0 / value : 0.0; });
  return of.vectors * inverses.asDiagonal() * of.vectors.transpose();
}

Eigen::Matrix<double, 3, 9> least_squares_solution(const Mat<3>& matrix, const Eigen::Matrix<double, 3, 9>& right) {
  return matrix.completeOrthogonalDecomposition().solve(right);
}

Matrix triangular_factor(const Matrix& tall) {
  return Eigen::HouseholderQR<Matrix>(tall).matrixQR().topRows(tall.cols()).triangularView<Eigen::Upper>();
}

Matrix orthonormal_columns(const Matrix& tall) {
  return Eigen::HouseholderQR<Matrix>(tall).householderQ() * Matrix::Identity(tall.rows(), tall.cols());
}

template Spectrum<2> spectrum<2>(const Mat<2>&);
template Spectrum<3> spectrum<3>(const Mat<3>&);
template Spectrum<4> spectrum<4>(const Mat<4>&);
template Spectrum<6> spectrum<6>(const Mat<6>&);
template Spectrum<10> spectrum<10>(const Mat<10>&);
template Spectrum<Eigen::Dynamic> spectrum<Eigen::Dynamic>(const Matrix&);
template Vec<2> eigenvalues<2>(const Mat<2>&);
template Vec<3> eigenvalues<3>(const Mat<3>&);
template Vec<6> eigenvalues<6>(const Mat<6>&);
template Vector eigenvalues<Eigen::Dynamic>(const Matrix&);
template Mat<2> pseudo_inverse<2>(const Mat<2>&);
template Mat<3> pseudo_inverse<3>(const Mat<3>&);
template Matrix pseudo_inverse<Eigen::Dynamic>(const Matrix&);

}  // namespace efree::internal
