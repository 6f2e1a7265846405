// SPDX-License-Identifier: GPL-3.0-or-later
/// One point of a material, led along a path.
#pragma once

#include "efree/materials/material.hpp"

#include <Eigen/LU>
#include <stdexcept>
#include <vector>

namespace efree::testing {

/// Some components of F are prescribed; the free ones, by i + 3 J, are such that P vanishes there.
class Specimen {
 public:
  explicit Specimen(const Material& material, std::vector<int> free = {})
      : material_(material),
        free_(std::move(free)),
        at_(Deformation::none(Points<3>::Zero(3, 1), material.history_size())) {}

  /// A step to these gradients, but for the free components, in which Newton's method goes on from where they are.
  void to(const Mat<3>& F) {
    Vec<9> prescribed = F.reshaped();
    prescribed(free_) = at_.F.col(0)(free_).eval();
    at_.F.col(0) = prescribed;
    for (int k = 0;; ++k) {
      response = respond(material_, at_, true);
      if (free_.empty()) break;
      const Matrix A = response.tangent_at(0)(free_, free_);
      const Vector step = A.partialPivLu().solve(Vector(response.P.col(0)(free_)));
      if (step.norm() < 1e-15) break;
      if (k == 100) {
        if (step.norm() < 1e-13) break;
        throw std::runtime_error("the specimen finds no equilibrium");
      }
      at_.F.col(0)(free_) -= step;
    }
    at_.history = response.history;
    dissipated += response.dissipated[0];
  }
  /// How long steps last from now on, and what heat comes in each.
  void lasts(double dt, double heat = 0.0) {
    at_.dt = dt;
    at_.heat = Vector::Constant(1, heat);
  }
  /// The free ones as they are, F(0, 0) as given.
  void stretch_to(double xx) {
    Mat<3> F = Mat<3>::Identity();
    F(0, 0) = xx;
    to(F);
  }

  Mat<3> F() const { return at_.gradient(0); }
  Mat<3> P() const { return Eigen::Map<const Mat<3>>(response.P.col(0).data()); }
  Mat<3> kirchhoff() const { return P() * F().transpose(); }
  double equivalent() const { return at_.history(6, 0); }
  Vector history() const { return at_.history.col(0); }

  MaterialResponse response;  ///< to the last step
  double dissipated = 0.0;    ///< so far

 private:
  const Material& material_;
  std::vector<int> free_;
  Deformation at_;
};

}  // namespace efree::testing
