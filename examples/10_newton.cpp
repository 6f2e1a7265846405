// SPDX-License-Identifier: GPL-3.0-or-later
/// An algorithm of your own on equations that it does not know: Newton's method, for a sheet of a St. Venant-Kirchhoff
/// material in plane strain that is stretched by 30 %.
///
///   div P = 0,   P = F S,   S = lambda tr(E) I + 2 mu E,   E = (F^T F - I) / 2
///
///     o |-----------| ->   right: u_x = 0.6
///     o |___________| ->   left:  u_x = 0
///        o o o o o o       bottom: u_y = 0, top: P n = 0
///
/// Prints the forces out of balance after each step and the error against the closed form: S_yy = 0.
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

constexpr double lambda = 1.3, mu = 0.7;

class SaintVenantKirchhoff final : public Material {
 public:
  bool homogeneous() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    const auto second = [](const Mat<3>& E) { return Mat<3>(lambda * E.trace() * Mat<3>::Identity() + 2.0 * mu * E); };
    for (Index p = 0; p < deformation.size(); ++p) {
      const Mat<3> F = deformation.gradient(p), E = 0.5 * (F.transpose() * F - Mat<3>::Identity()), S = second(E);
      response.stress(p) = F * S;
      response.energy[p] = 0.5 * S.cwiseProduct(E).sum();
      for (int l = 0; l < 9 && response.tangent; ++l) {
        const Mat<3> dF = Mat<3>::Identity().col(l % 3) * Mat<3>::Identity().row(l / 3);
        const Mat<3> dP = dF * S + F * second(0.5 * (dF.transpose() * F + F.transpose() * dF));
        response.tangent_at(p).col(l) = dP.reshaped();
      }
    }
  }
};

int main() {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.1});
  const Approximation<2> sheet = approximate(mesh, {.spacing = 0.3, .vanish_on = {"left", "bottom", "right"}});
  const Equilibrium<2> equations(
      sheet, {.material = SaintVenantKirchhoff(), .plane = Plane::strain, .essential = Essential::strong},
      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), {"right", {}, [](const Vec<2>&) { return 0.6; }}});
  State state = equations.under(1.0, equations.rest());
  SymmetricMatrix K;
  equations.tangent(state, K);
  Cholesky solver(K, equations.node_of_unknowns());  // analysed once
  for (int step = 1; step <= 8; ++step) {
    state = equations.moved(state, -solver.solve(equations.residual(state)));
    std::printf("step %d: out of balance %.1e\n", step, equations.residual(state).cwiseAbs().maxCoeff());
    equations.tangent(state, K);  // in place
    solver.factorize(K);
  }
  const double E1 = 0.3 + 0.5 * 0.3 * 0.3, across = std::sqrt(1.0 - 2.0 * lambda / (lambda + 2.0 * mu) * E1) - 1.0;
  const Points<2> u = interpolate(sheet.shape, Points<2>(state.u.reshaped(2, sheet.nodes.cols())));
  const double error = (u - Vec<2>(0.3, across).asDiagonal() * sheet.space.points()).colwise().norm().maxCoeff();
  std::printf("error of the displacement: %.1e\n", error);
  return error < 1e-10 ? 0 : 1;
}
