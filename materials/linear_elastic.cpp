// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/linear_elastic.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <cmath>

namespace efree {

Lame solid_lame(const IsotropicModuli& moduli) {
  const ElasticConstants constants = ElasticModuli{.E = moduli.E, .nu = moduli.nu}.at(Vec<3>::Zero());
  return {constants.lambda, constants.mu};
}

Lame plane_lame(const IsotropicModuli& moduli, Plane plane) {
  const auto [lambda, mu] = solid_lame(moduli);
  return {plane == Plane::stress ? 2.0 * lambda * mu / (lambda + 2.0 * mu) : lambda, mu};
}

namespace {

/// The unit tensor, flattened.
Vec<9> unit() {
  return Mat<3>::Identity().reshaped();
}

}  // namespace

void LinearElastic::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const ElasticConstants one = moduli_.at(given.X.col(p));
    const Mat<3> H = given.gradient(p) - Mat<3>::Identity();
    response.stress(p) = one.lambda * H.trace() * Mat<3>::Identity() + one.mu * (H + H.transpose());
    response.energy[p] = 0.5 * response.stress(p).cwiseProduct(H).sum();
    if (!response.tangent) continue;
    auto A = response.tangent_at(p);
    A = one.lambda * unit() * unit().transpose();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        A(i + 3 * j, i + 3 * j) += one.mu;
        A(i + 3 * j, j + 3 * i) += one.mu;
      }
  }
}

OrthotropicElastic::OrthotropicElastic(const OrthotropicModuli& moduli) : OrthotropicElastic(moduli, 1.0) {}

OrthotropicElastic::OrthotropicElastic(const OrthotropicModuli& moduli, Parameter factor) : factor_(std::move(factor)) {
  const auto& [E, nu, G, axes] = moduli;
  if (!(E.minCoeff() > 0.0 && E.allFinite()))
    throw InputError(fmt::format("Young's moduli E = ({}), expected positive numbers", fmt::join(E, ", ")));
  if (!(G.minCoeff() > 0.0 && G.allFinite()))
    throw InputError(fmt::format("shear moduli G = ({}), expected positive numbers", fmt::join(G, ", ")));
  if (!((axes.transpose() * axes - Mat<3>::Identity()).norm() < 1e-9))
    throw InputError("axes of an orthotropic material: expected orthonormal columns");
  Mat<3> compliance = E.cwiseInverse().asDiagonal();
  compliance(1, 2) = compliance(2, 1) = -nu[0] / E[1];
  compliance(0, 2) = compliance(2, 0) = -nu[1] / E[0];
  compliance(0, 1) = compliance(1, 0) = -nu[2] / E[0];
  const Eigen::LLT<Mat<3>> cholesky(compliance);
  if (cholesky.info() != Eigen::Success || !compliance.allFinite())
    throw InputError(
        fmt::format("Poisson's ratios nu_yz, nu_xz, nu_xy = ({}) make the stiffness indefinite for E = ({}); expected "
                    "nu_ij^2 < E_i / E_j, and all three together small enough",
                    fmt::join(nu, ", "), fmt::join(E, ", ")));
  if (factor_.is_constant() && !(factor_.at(Vec<3>::Zero()) > 0.0))
    throw InputError(fmt::format("the stiffness of an orthotropic material times {}, expected a positive number",
                                 factor_.at(Vec<3>::Zero())));
  const Mat<3> normal = cholesky.solve(Mat<3>::Identity());
  // Along the axes first, then turned: C_ijkl = R_ia R_jb R_kc R_ld C_abcd.
  MaterialResponse::Tangent C = MaterialResponse::Tangent::Zero(), turn;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      C(4 * i, 4 * j) = normal(i, j);
      if (i != j) C(i + 3 * j, i + 3 * j) = C(i + 3 * j, j + 3 * i) = G[3 - i - j];
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) turn(i + 3 * j, a + 3 * b) = axes(i, a) * axes(j, b);
    }
  C_ = turn * C * turn.transpose();
}

void OrthotropicElastic::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const double factor = factor_.at(given.X.col(p));
    if (!(factor > 0.0) || !std::isfinite(factor))
      throw InputError(
          fmt::format("the stiffness of an orthotropic material times {} at ({:.6g}), expected a positive "
                      "number",
                      factor, fmt::join(given.X.col(p), ", ")));
    const MaterialResponse::Tangent C = factor * C_;
    const Vec<9> H = given.F.col(p) - unit();
    response.P.col(p).noalias() = C * H;
    response.energy[p] = 0.5 * H.dot(response.P.col(p));
    if (response.tangent) response.tangent_at(p) = C;
  }
}

}  // namespace efree
