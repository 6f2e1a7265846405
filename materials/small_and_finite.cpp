// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/small_and_finite.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/finite_deformation.hpp"

namespace efree {

using internal::FiniteDeformation, internal::paired;

namespace {

Points<81> tangents_at_rest(const Material& material, const Points<3>& X) {
  return respond(material, Deformation::none(X, material.history_size()), true).A;
}

std::optional<MaterialResponse::Tangent> tangent_everywhere(const Material& material) {
  if (!material.homogeneous()) return std::nullopt;
  return tangents_at_rest(material, Points<3>::Zero(3, 1)).col(0).reshaped(9, 9);
}

/// The tangent at each point where nothing has happened yet.
template <class Work> void for_each_point(const Material& of,
                                          const std::optional<MaterialResponse::Tangent>& everywhere,
                                          const Deformation& given, const Work& work) {
  const Points<81> all = everywhere ? Points<81>() : tangents_at_rest(of, given.X);
  for (Index p = 0; p < given.size(); ++p)
    work(p, everywhere ? *everywhere : MaterialResponse::Tangent(all.col(p).reshaped(9, 9)));
}

}  // namespace

Linearised::Linearised(SharedMaterial of) : of_(std::move(of)), everywhere_(tangent_everywhere(*of_)) {}

void Linearised::respond(const Deformation& given, MaterialResponse& response) const {
  for_each_point(*of_, everywhere_, given, [&](Index p, const MaterialResponse::Tangent& A) {
    const Vec<9> H = given.F.col(p) - Mat<3>::Identity().reshaped();
    response.P.col(p) = A * H;
    response.energy[p] = 0.5 * H.dot(response.P.col(p));
    if (response.tangent) response.tangent_at(p) = A;
  });
}

GreenElastic::GreenElastic(SharedMaterial of) : of_(std::move(of)) {
  require(of_->linear(), "GreenElastic: a linear material expected");
  everywhere_ = tangent_everywhere(*of_);
}

void GreenElastic::respond(const Deformation& given, MaterialResponse& response) const {
  for_each_point(*of_, everywhere_, given, [&](Index p, const MaterialResponse::Tangent& C) {
    const FiniteDeformation at(given, p);
    const Vec<9> E = at.green().reshaped();
    const Mat<3> S = (C * E).reshaped(3, 3);
    response.stress(p) = at.F * S;
    response.energy[p] = 0.5 * E.dot(S.reshaped());
    if (!response.tangent) return;
    MaterialResponse::Tangent left = MaterialResponse::Tangent::Zero();  // dE = sym(F^T dF), P = F S
    for (int J = 0; J < 3; ++J) left.block<3, 3>(3 * J, 3 * J) = at.F;
    response.tangent_at(p) = paired(Mat<3>::Identity(), S) + left * C * left.transpose();
  });
}

}  // namespace efree
