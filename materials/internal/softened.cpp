// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/internal/softened.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/finite_deformation.hpp"

#include <cmath>

namespace efree::internal {

Softened::Softened(SharedMaterial of, double share) : of_(std::move(of)), power_((std::sqrt(share) - 1.0) / 3.0) {
  require(of_->finite_strain() && share > 0.0 && share <= 1.0,
          "Softened: a material of finite strains, and a share in ]0, 1] expected");
}

void Softened::respond(const Deformation& deformation, MaterialResponse& response) const {
  Deformation seen = deformation;
  Vector scale(deformation.size());
  for (Index p = 0; p < deformation.size(); ++p) {
    scale[p] = std::exp(power_ * FiniteDeformation(deformation, p).log_J);
    seen.F.col(p) *= scale[p];
  }
  of_->respond(seen, response);
  // F' = c F, c = J^b: dF' = L dF, L = c (1 + b F x F^-T), and P = L^T P'.
  for (Index p = 0; p < deformation.size(); ++p) {
    const Mat<3> inverse = FiniteDeformation(deformation, p).F_invT();
    const Vec<9> F = deformation.F.col(p), F_invT = inverse.reshaped(), P = response.P.col(p);
    const double work = P.dot(F);
    response.P.col(p) = scale[p] * (P + power_ * work * F_invT);
    if (!response.tangent) continue;
    const MaterialResponse::Tangent L =
        scale[p] * (MaterialResponse::Tangent::Identity() + power_ * F * F_invT.transpose());
    const MaterialResponse::Tangent A = response.tangent_at(p);
    response.tangent_at(p) =
        L.transpose() * A * L + scale[p] * power_ *
                                    (P * F_invT.transpose() + F_invT * P.transpose() +
                                     power_ * work * F_invT * F_invT.transpose() - work * crossed(inverse, inverse));
  }
}

}  // namespace efree::internal
