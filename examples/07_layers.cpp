// SPDX-License-Identifier: GPL-3.0-or-later
/// The layers one by one: cloud, functions, quadrature, equations; one factor for several load cases.
///
///   div sigma = 0,   sigma = C : sym(grad u)
///
///        ^ ^ ^ ^ ^  case 2: sigma_yy = 1
///       |---------|
///     o |         | >  case 1: sigma_xx = 1        case 3: both
///     o |_________| >
///        o o o o o     left: u_x = 0, bottom: u_y = 0
///
/// The stresses are those of the loads, and displacements linear, which clouds reproduce: prints the largest error at
/// any fine vertex, and of any recovered stress.
#include <algorithm>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

int main() {
  constexpr double E = 2.0, nu = 0.3, H = 0.25;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = H / 4});
  const FineSpace<2> space(mesh, 1);

  const NodeCloud<2> nodes = sample_cloud(mesh, {.spacing = H}), points = sample_cloud(mesh, {.spacing = H / 2});
  const Mls<2> mls = moving_least_squares(space, nodes, {.order = 1, .support = 2.5});
  const SecondaryBasis<2> clusters = cell_clusters(space, points);
  const Approximation<2> sheet{.space = space,
                               .shape = mls.shape,
                               .nodes = space.points()(Eigen::all, mls.node_dofs),
                               .node_dofs = mls.node_dofs,
                               .quadrature = project(space, mls.shape, clusters)};

  const ElasticModel model{.material = LinearElastic(E, nu), .plane = Plane::stress};
  const Equilibrium<2> equations(sheet, model, {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")});
  SymmetricMatrix K;
  equations.tangent(equations.rest(), K);
  const Cholesky factor(K, equations.node_of_unknowns());
  std::printf("%d nodes, %d points, %d fine vertices\n", nodes.size(), sheet.quadrature.size(), mesh.num_vertices());

  double worst = 0.0;
  for (const Vec<2>& pull : {Vec<2>(1, 0), Vec<2>(0, 1), Vec<2>(1, 1)}) {
    const Loads<2> loads{.tractions = {tension<2>("right", pull.x()), tension<2>("top", pull.y())}};
    const State state = linear_step(equations.with(loads), factor, equations.rest());
    const Fields<2> fields = recover_fields(sheet, evaluate<2>(sheet, model, state.u.reshaped(2, nodes.size())));
    const Vec<2> strain = (pull - nu * pull.reverse()) / E;
    const double u = (fields.displacement - strain.asDiagonal() * mesh.vertices()).colwise().norm().maxCoeff();
    const double s = (fields.stress.colwise() - Voigt<2>(pull.x(), pull.y(), 0, 0)).colwise().norm().maxCoeff();
    std::printf("sigma = (%g, %g): largest error of displacements %.1e, of stresses %.1e\n", pull.x(), pull.y(), u, s);
    worst = std::max({worst, u, s});
  }
  return worst < 1e-10 ? 0 : 1;
}
