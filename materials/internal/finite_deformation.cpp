// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/internal/finite_deformation.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/LU>
#include <cmath>

namespace efree::internal {

double growth(const Mat<3>& H) {
  const double trace = H.trace();
  return trace + 0.5 * (trace * trace - H.cwiseProduct(H.transpose()).sum()) + H.determinant();
}

std::string place(const Vec<3>& X) {
  return fmt::format("at ({:.6g})", fmt::join(X, ", "));
}

FiniteDeformation::FiniteDeformation(const Deformation& given, Index p)
    : F(given.gradient(p)), H(F - Mat<3>::Identity()), growth(internal::growth(H)), J(1.0 + growth) {
  if (std::abs(growth) > 0.5) {  // the digits are in F
    J = F.determinant();
    growth = J - 1.0;
    log_J = std::log(J);
  } else {
    log_J = std::log1p(growth);
  }
  if (!(J > 0.0) || !std::isfinite(J))
    throw NumericalError(
        fmt::format("the deformation gradient {} has the determinant J = {:.6g}: matter is turned inside out",
                    place(given.X.col(p)), J));
}

Mat<3> FiniteDeformation::F_invT() const {
  return F.inverse().transpose();
}

MaterialResponse::Tangent paired(const Mat<3>& A, const Mat<3>& B) {
  MaterialResponse::Tangent result;
  for (int J = 0; J < 3; ++J)
    for (int L = 0; L < 3; ++L) result.block<3, 3>(3 * J, 3 * L) = B(J, L) * A;
  return result;
}

MaterialResponse::Tangent crossed(const Mat<3>& A, const Mat<3>& B) {
  MaterialResponse::Tangent result;
  for (int J = 0; J < 3; ++J)
    for (int L = 0; L < 3; ++L) result.block<3, 3>(3 * J, 3 * L) = A.col(L) * B.col(J).transpose();
  return result;
}

}  // namespace efree::internal
