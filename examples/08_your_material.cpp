// SPDX-License-Identifier: GPL-3.0-or-later
/// A material of your own: a cubic crystal, copper, pulled along an axis.
///
///   div P = 0,   P_ii = C11 eps_ii + C12 (eps_jj + eps_kk),   P_ij = 2 C44 eps_ij
///
///       ________
///      /       /|     left, front, bottom: symmetry planes
///     /_______/ | ->  right: P n = (1, 0, 0)
///     |       | /
///     |_______|/
///
/// Prints the largest error of the displacement at any fine vertex, against u = (x, -nu y, -nu z) / E.
#include <algorithm>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

/// Stresses and their derivative by the deformation gradient, at many points at once, in three dimensions.
class CubicCrystal final : public Material {
 public:
  CubicCrystal(double C11, double C12, double C44) : C11_(C11), C12_(C12), C44_(C44) {}
  bool homogeneous() const override { return true; }  // the same at every point
  bool linear() const override { return true; }       // in F - I: the tangent is asked for once
  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    for (Index p = 0; p < deformation.size(); ++p) {
      const Mat<3> H = deformation.gradient(p) - Mat<3>::Identity(), eps = 0.5 * (H + H.transpose());
      response.stress(p) = 2.0 * C44_ * eps;
      response.stress(p).diagonal() = (C11_ - C12_) * eps.diagonal() + Vec<3>::Constant(C12_ * eps.trace());
      response.energy[p] = 0.5 * response.stress(p).cwiseProduct(eps).sum();
      if (!response.tangent) continue;
      auto A = response.tangent_at(p);  // by component i + 3 j
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
          A(4 * i, 4 * j) = i == j ? C11_ : C12_;
          if (i != j) A(i + 3 * j, i + 3 * j) = A(i + 3 * j, j + 3 * i) = C44_;
        }
    }
  }

 private:
  double C11_, C12_, C44_;
};

int main() {
  constexpr double C11 = 168.4, C12 = 121.4, C44 = 75.4;  // [GPa], Kittel, Introduction to Solid State Physics
  constexpr double E = (C11 - C12) * (C11 + 2.0 * C12) / (C11 + C12), nu = C12 / (C11 + C12);
  const FineMesh<3> mesh(solids::box({1.0, 1.0, 1.0}, 0.2));
  const Result<3> crystal =
      analyse(mesh, {.common = {.model = {.material = CubicCrystal(C11, C12, C44)}, .approximation = {.spacing = 0.5}},
                     .supports = {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                     .loads = {.tractions = {tension<3>("right", 1.0)}}});
  const Points<3> exact = Vec<3>(1.0 / E, -nu / E, -nu / E).asDiagonal() * crystal.basis().space.points();
  const double error = (crystal.fields.displacement - exact).colwise().norm().maxCoeff() * E;
  std::printf("E = %.1f GPa along the axis, nu = %.3f: error of the displacement %.1e\n", E, nu, error);
  return error < 1e-9 ? 0 : 1;
}
