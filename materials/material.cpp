// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/material.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/spectrum.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace efree {

Deformation Deformation::none(Points<3> X, Index history_size) {
  const Eigen::Index n = X.cols();
  const Mat<3> unit = Mat<3>::Identity();
  return {std::move(X), Eigen::Map<const Vec<9>>(unit.data()).replicate(1, n), Matrix::Zero(history_size, n), 0.0};
}

MaterialResponse respond(const Material& material, const Deformation& deformation, bool tangent) {
  const Index n = deformation.size(), history = material.history_size();
  if (deformation.history.rows() != history || deformation.history.cols() != n)
    throw InputError(fmt::format("a history of {} x {}, expected {} x {}", deformation.history.rows(),
                                 deformation.history.cols(), history, n));
  MaterialResponse response{Tensors::Zero(9, n), deformation.history, Vector::Zero(n), {}, tangent, Vector::Zero(n)};
  if (tangent) response.A.setZero(81, n);
  material.respond(deformation, response);
  return response;
}

double incompressibility(const MaterialResponse::Tangent& A) {
  // Symmetric tensors in an orthonormal basis (Mandel).
  Eigen::Matrix<double, 9, 6> basis = Eigen::Matrix<double, 9, 6>::Zero();
  for (int i = 0, c = 3; i < 3; ++i) {
    basis(4 * i, i) = 1.0;
    for (int j = i + 1; j < 3; ++j, ++c) basis(i + 3 * j, c) = basis(j + 3 * i, c) = std::sqrt(0.5);
  }
  const Mat<6> C = basis.transpose() * A * basis;
  Vec<6> m = Vec<6>::Zero();
  m.head<3>().setOnes();
  const double K = 1.0 / m.dot(C.ldlt().solve(m));
  const Mat<6> rest = C - K * m * m.transpose();
  // The smallest eigenvalue is that of the strain by pressure, zero.
  return 2.0 * K / internal::eigenvalues<6>(rest)[1];
}

const Material& SharedMaterial::operator*() const {
  require(material_ != nullptr, "no material is given");
  return *material_;
}

namespace {

using Across = Eigen::Matrix<double, 9, 3>;
/// Strains across the plane as changes of F: zz, then yz and xz, symmetric.
const Across across = [] {
  Across columns = Across::Zero();
  columns(8, 0) = 1.0;
  columns(5, 1) = columns(7, 1) = 1.0;  // (2,1), (1,2)
  columns(2, 2) = columns(6, 2) = 1.0;  // (2,0), (0,2)
  return columns;
}();

}  // namespace

std::vector<HistoryPart> PlaneStress::history_parts() const {
  std::vector<HistoryPart> parts = of_->history_parts();
  parts.push_back({"strains_across", of_->history_size(), 3});
  return parts;
}

Eigen::Matrix<double, 3, 9> PlaneStress::strains_across(const MaterialResponse::Tangent& A) {
  const Mat<3> stiffness = across.transpose() * A * across;
  // Matter that is torn across the plane has no stiffness there: then the least strains.
  return -internal::least_squares_solution(stiffness, across.transpose() * A);
}

MaterialResponse::Tangent PlaneStress::condensed(const MaterialResponse::Tangent& A) {
  MaterialResponse::Tangent left = A + A * across * strains_across(A);
  left.row(8).setZero();
  left.col(8).setZero();
  return left;
}

void PlaneStress::respond(const Deformation& given, MaterialResponse& response) const {
  constexpr int most = 100, halvings = 30;
  const Index inner_size = of_->history_size();
  const bool has_potential = of_->symmetric();
  if (given.size() == 0) return;
  const double least =
      1e-13 * efree::respond(*of_, Deformation::none(given.X.col(0), inner_size), true).A.cwiseAbs().maxCoeff();
  Deformation one = Deformation::none(Points<3>::Zero(3, 1), inner_size);
  one.dt = given.dt;
  MaterialResponse inner{Tensors::Zero(9, 1),     one.history, Vector::Zero(1),
                         Points<81>::Zero(81, 1), true,        Vector::Zero(1)};
  MaterialResponse ahead = inner;
  for (Index p = 0; p < given.size(); ++p) {
    const auto ask = [&](const Vec<3>& strain, MaterialResponse& answer) {
      one.F.col(0) = given.F.col(p) + across * strain;
      of_->respond(one, answer);
    };
    const auto fail = [&] {
      throw NumericalError(fmt::format("plane stress: no strain across the plane without stress at ({:.6g})",
                                       fmt::join(given.X.col(p), ", ")));
    };
    // From `strain` as far along `step` as the potential falls, or the stresses across do; without a potential also as
    // far as they push that way. Where there is an answer.
    const auto advance = [&](Vec<3>& strain, const Vec<3>& step, bool newton) {
      const Vec<3> r = across.transpose() * inner.P.col(0);
      const double potential = inner.energy[0] + inner.dissipated[0];
      double part = 1.0;
      for (int k = 0; k < halvings; ++k, part *= 0.5) {
        const Vec<3> there = strain + part * step;
        try {
          ask(there, ahead);
        } catch (const NumericalError&) {
          continue;
        }
        const Vec<3> left = across.transpose() * ahead.P.col(0);
        const bool falls = has_potential
                               ? ahead.energy[0] + ahead.dissipated[0] <= potential + 1e-4 * part * r.dot(step)
                               : left.dot(step) <= 0.0;
        if (falls || (newton && left.norm() <= (1.0 - 0.1 * part) * r.norm())) {
          strain = there;
          std::swap(inner, ahead);
          return true;
        }
      }
      return false;
    };
    one.X = given.X.col(p);
    if (given.heat.size() != 0) one.heat = given.heat.segment(p, 1);
    one.history = given.history.col(p).head(inner_size);
    Vec<3> strain = given.history.col(p).tail<3>();
    MaterialResponse::Tangent A;
    ask(strain, inner);
    for (int k = 0;; ++k) {
      A = inner.tangent_at(0);
      const Vec<3> r = across.transpose() * inner.P.col(0);
      // Where matter is torn or flows freely there is no stiffness: then a step is only a direction.
      const Mat<3> stiffness = across.transpose() * A * across + least * Mat<3>::Identity();
      Vec<3> step = -stiffness.partialPivLu().solve(r);
      // Strains count against the thickness that is left.
      const double thickness = of_->finite_strain() ? std::abs(one.F(8, 0)) : 1.0 + strain.norm();
      if (step.norm() <= 1e-12 * thickness ||
          r.norm() <= std::numeric_limits<double>::epsilon() * A.norm() * thickness) {
        inner.P.col(0) += A * (across * step);
        break;
      }
      const bool newton = !has_potential || r.dot(step) < 0.0;
      if (!newton) {
        // Not convex here: downhill, as far as the curvature's size says.
        const auto [curvature, axes] = internal::spectrum<3>(0.5 * (stiffness + stiffness.transpose()));
        const Vec<3> size = curvature.cwiseAbs();
        step = -axes * (axes.transpose() * r).cwiseQuotient(size.cwiseMax(1e-3 * size.maxCoeff()));
      }
      step *= std::min(1.0, 0.9 * thickness / step.norm());
      if (k == most || !step.allFinite() || !advance(strain, step, newton)) fail();
    }
    response.P.col(p) = inner.P.col(0);
    response.P(8, p) = 0.0;
    response.energy[p] = inner.energy[0];
    response.dissipated[p] = inner.dissipated[0];
    response.history.col(p) << inner.history.col(0), strain;
    if (response.tangent) response.tangent_at(p) = condensed(A);
  }
}

}  // namespace efree
