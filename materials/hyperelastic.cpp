// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/hyperelastic.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/finite_deformation.hpp"
#include "efree/materials/internal/principal.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree {

using namespace internal;

namespace {

double positive(const Parameter& parameter, const char* what, const Vec<3>& X) {
  const double value = parameter.at(X);
  if (!(value > 0.0) || !std::isfinite(value))
    throw InputError(fmt::format("{} = {}{}, expected a positive number", what, value,
                                 parameter.is_constant() ? "" : " " + place(X)));
  return value;
}

/// P = dW/dF and its derivative of W = c10 (I1 - 3) + c01 (I2 - 3) + U(J), by the invariants of C: of J^-m I with
/// dI/dF = g the derivatives are J^-m (g - m I T) and J^-m (dg/dF - m (g T + T g) + m^2 I T T + m I crossed(T, T)),
/// T = F^-T.
void respond_by_invariants(const FiniteDeformation& at, double c10, double c01, double kappa, Index p,
                           MaterialResponse& response) {
  const Mat<3>& F = at.F;
  const Mat<3> T = at.F_invT(), C = F.transpose() * F, E = at.green();
  const double I1 = C.trace(), I2 = 0.5 * (I1 * I1 - C.squaredNorm());
  // I1 - 3 and I2 - 3, so that energies of small strains keep their digits.
  const double more1 = 2.0 * E.trace(), more2 = 2.0 * more1 + 2.0 * (E.trace() * E.trace() - E.squaredNorm());
  const Volumetric volumetric(kappa, at);
  const double of_I1 = c10 * std::exp(-2.0 / 3.0 * at.log_J), of_I2 = c01 * std::exp(-4.0 / 3.0 * at.log_J);
  const Mat<3> g1 = 2.0 * F, g2 = 2.0 * (I1 * F - F * C);
  const double by_T = volumetric.stress - 2.0 / 3.0 * of_I1 * I1 - 4.0 / 3.0 * of_I2 * I2;
  response.stress(p) = of_I1 * g1 + of_I2 * g2 + by_T * T;
  response.energy[p] = of_I1 * more1 + 3.0 * c10 * std::expm1(-2.0 / 3.0 * at.log_J) + of_I2 * more2 +
                       3.0 * c01 * std::expm1(-4.0 / 3.0 * at.log_J) + volumetric.energy;
  if (!response.tangent) return;
  const Vec<9> t = T.reshaped(), f = F.reshaped();
  const Vec<9> g = (2.0 / 3.0 * of_I1 * g1 + 4.0 / 3.0 * of_I2 * g2).reshaped();
  auto A = response.tangent_at(p);
  A = (volumetric.slope + 4.0 / 9.0 * of_I1 * I1 + 16.0 / 9.0 * of_I2 * I2) * t * t.transpose() - g * t.transpose() -
      t * g.transpose() - by_T * crossed(T, T);
  A.diagonal().array() += 2.0 * of_I1 + 2.0 * of_I2 * I1;
  if (of_I2 != 0.0)
    A += of_I2 *
         (4.0 * f * f.transpose() - 2.0 * (paired(identity, C) + crossed(F, F) + paired(F * F.transpose(), identity)));
}

/// W, of which `law` are the derivatives by logarithmic strains.
void respond_by_stretches(const PrincipalFrame& frame, const PrincipalStress& law, double energy, Index p,
                          MaterialResponse& response) {
  response.stress(p) = frame.stress(law.stress);
  response.energy[p] = energy;
  if (response.tangent) response.tangent_at(p) = frame.tangent(law);
}

}  // namespace

void StVenantKirchhoff::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const auto [lambda, mu, kappa] = moduli_.at(given.X.col(p));
    const FiniteDeformation at(given, p);
    const Mat<3> E = at.green();
    const Mat<3> S = lambda * E.trace() * identity + 2.0 * mu * E;
    response.stress(p) = at.F * S;
    response.energy[p] = 0.5 * S.cwiseProduct(E).sum();
    if (!response.tangent) continue;
    const Vec<9> f = at.F.reshaped();
    response.tangent_at(p) = paired(identity, S) + lambda * f * f.transpose() +
                             mu * (crossed(at.F, at.F) + paired(at.F * at.F.transpose(), identity));
  }
}

void NeoHookean::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const auto [lambda, mu, kappa] = moduli_.at(given.X.col(p));
    const FiniteDeformation at(given, p);
    const Mat<3> T = at.F_invT();
    response.stress(p) = mu * (at.F - T) + lambda * at.log_J * T;
    response.energy[p] = mu * (at.green().trace() - at.log_J) + 0.5 * lambda * at.log_J * at.log_J;
    if (!response.tangent) continue;
    const Vec<9> t = T.reshaped();
    auto A = response.tangent_at(p);
    A = lambda * t * t.transpose() + (mu - lambda * at.log_J) * crossed(T, T);
    A.diagonal().array() += mu;
  }
}

MooneyRivlin::MooneyRivlin(Parameter c10, Parameter c01, Parameter kappa)
    : c10_(std::move(c10)), c01_(std::move(c01)), kappa_(std::move(kappa)) {
  if (homogeneous()) at(Vec<3>::Zero());
}

MooneyRivlin::Constants MooneyRivlin::at(const Vec<3>& X) const {
  const double c10 = c10_.at(X), c01 = c01_.at(X);
  if (!(c10 + c01 > 0.0) || !std::isfinite(c10 + c01))
    throw InputError(fmt::format("Mooney-Rivlin c10 = {}, c01 = {}{}, expected a positive sum", c10, c01,
                                 homogeneous() ? "" : " " + place(X)));
  return {c10, c01, positive(kappa_, "bulk modulus kappa", X)};
}

void MooneyRivlin::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const auto [c10, c01, kappa] = at(given.X.col(p));
    respond_by_invariants(FiniteDeformation(given, p), c10, c01, kappa, p, response);
  }
}

void NeoHookeanSplit::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const auto [lambda, mu, kappa] = moduli_.at(given.X.col(p));
    respond_by_invariants(FiniteDeformation(given, p), 0.5 * mu, 0.0, kappa, p, response);
  }
}

Ogden::Ogden(std::vector<OgdenTerm> terms, Parameter kappa) : terms_(std::move(terms)), kappa_(std::move(kappa)) {
  double shear = 0.0;
  for (const auto& [mu, alpha] : terms_) {
    if (alpha == 0.0 || !std::isfinite(alpha) || !std::isfinite(mu))
      throw InputError(fmt::format("Ogden's term mu = {}, alpha = {}, expected numbers, alpha not zero", mu, alpha));
    shear += 0.5 * mu * alpha;
  }
  if (!(shear > 0.0))
    throw InputError(fmt::format("Ogden's terms make a shear modulus of {}, expected a positive one", shear));
  if (kappa_.is_constant()) positive(kappa_, "bulk modulus kappa", Vec<3>::Zero());
}

void Ogden::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const FiniteDeformation at(given, p);
    const Volumetric volumetric(positive(kappa_, "bulk modulus kappa", given.X.col(p)), at);
    const PrincipalFrame frame(at.F, identity);
    const Vec<3> strain = frame.strain().array() - at.log_J / 3.0;
    double energy = volumetric.energy;
    PrincipalStress law{Vec<3>::Constant(volumetric.stress), Mat<3>::Constant(volumetric.slope), Mat<3>::Zero()};
    for (const auto& [mu, alpha] : terms_) {
      // Of stretches to the power of alpha: less one, so that small strains keep their digits.
      const Vec<3> beyond = (alpha * strain).unaryExpr([](double x) { return std::expm1(x); });
      const Vec<3> power = beyond.array() + 1.0;
      energy += mu / alpha * beyond.sum();
      law.stress.array() += mu * (beyond.array() - beyond.mean());
      law.slope += mu * alpha *
                   (Mat<3>(power.asDiagonal()) - (power.replicate<1, 3>() + power.transpose().replicate<3, 1>()) / 3.0 +
                    Mat<3>::Constant(power.mean() / 3.0));
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < a; ++b) {
          const double x = alpha * (strain[a] - strain[b]);
          const double secant = mu * alpha * power[b] * (x == 0.0 ? 1.0 : std::expm1(x) / x);
          law.secant(a, b) += secant;
          law.secant(b, a) += secant;
        }
    }
    respond_by_stretches(frame, law, energy, p, response);
  }
}

void Hencky::respond(const Deformation& given, MaterialResponse& response) const {
  for (Index p = 0; p < given.size(); ++p) {
    const auto [lambda, mu, kappa] = moduli_.at(given.X.col(p));
    const FiniteDeformation at(given, p);
    const PrincipalFrame frame(at.F, identity);
    const auto law = PrincipalStress::linear(frame.strain(), kappa, mu);
    respond_by_stretches(frame, law, 0.5 * law.stress.dot(frame.strain()), p, response);
  }
}

}  // namespace efree
