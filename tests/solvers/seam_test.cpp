// SPDX-License-Identifier: GPL-3.0-or-later
// A material and a basis from outside the library: what users write themselves, solved like what is built in.
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>
#include <map>

namespace efree {
namespace {

/// A cubic crystal whose axes are x, y, z: P_ii = C11 eps_ii + C12 (eps_jj + eps_kk), P_ij = 2 C44 eps_ij.
class CubicCrystal final : public Material {
 public:
  CubicCrystal(double C11, double C12, double C44) : C11_(C11), C12_(C12), C44_(C44) {}
  bool homogeneous() const override { return true; }

  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    for (Index p = 0; p < deformation.size(); ++p) {
      const Mat<3> H = deformation.gradient(p) - Mat<3>::Identity(), eps = 0.5 * (H + H.transpose());
      const Vec<3> normal = (C11_ - C12_) * eps.diagonal() + Vec<3>::Constant(C12_ * eps.trace());
      response.stress(p) = 2.0 * C44_ * eps;
      response.stress(p).diagonal() = normal;
      response.energy[p] = 0.5 * response.stress(p).cwiseProduct(eps).sum();
      if (!response.tangent) continue;
      auto A = response.tangent_at(p);
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

/// Products of hats on a grid of squares (cubes) that knows nothing of the body in it: values at the degrees of freedom
/// of the fine mesh are all that a basis has to bring. Grid points whose function is nowhere in the body are left out.
template <int Dim> Approximation<Dim> grid_basis(const FineMesh<Dim>& mesh, double size) {
  Approximation<Dim> result;
  result.space = FineSpace<Dim>(mesh, 1);
  const Vec<Dim> low = mesh.vertices().rowwise().minCoeff().array() - 0.3 * size;
  std::map<std::array<Index, Dim>, Index> number;  // of the nodes
  std::vector<Vec<Dim>> nodes;
  std::vector<Offset> offsets{0};
  std::vector<Index> columns;
  std::vector<double> N;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Vec<Dim> at = (mesh.vertex(v) - low) / size;
    std::map<Index, double> row;
    for (int corner = 0; corner < 1 << Dim; ++corner) {
      std::array<Index, Dim> point;
      double value = 1.0;
      Vec<Dim> x;
      for (int d = 0; d < Dim; ++d) {
        point[d] = static_cast<Index>(std::floor(at[d])) + (corner >> d & 1);
        value *= 1.0 - std::abs(at[d] - point[d]);
        x[d] = low[d] + size * point[d];
      }
      const auto [found, is_new] = number.try_emplace(point, static_cast<Index>(nodes.size()));
      if (is_new) nodes.push_back(x);
      if (value > 0.0) row[found->second] = value;
    }
    for (const auto& [node, value] : row) columns.push_back(node), N.push_back(value);
    offsets.push_back(static_cast<Offset>(columns.size()));
  }
  result.nodes.resize(Dim, nodes.size());
  for (std::size_t I = 0; I < nodes.size(); ++I) result.nodes.col(static_cast<Index>(I)) = nodes[I];
  result.shape = {static_cast<Index>(nodes.size()), offsets, columns, N};
  result.quadrature = project(result.space, result.shape, every_cell(result.space));
  return result;
}

TEST(Seam, CrystalFromOutsidePulledAlongAnAxisStretchesAsInItsClosedForm) {
  // Copper; C. Kittel, Introduction to Solid State Physics, table of elastic stiffness constants [GPa].
  const double C11 = 168.4, C12 = 121.4, C44 = 75.4;
  const FineMesh<3> mesh(solids::box({1.0, 1.0, 1.0}, 0.2));
  const double E = (C11 - C12) * (C11 + 2.0 * C12) / (C11 + C12), nu = C12 / (C11 + C12);
  const ElasticModel model{.material = CubicCrystal(C11, C12, C44)};
  for (const auto& approximation :
       {approximate<3>(mesh, {.spacing = 0.5, .dilatation = Dilatation::pointwise}), grid_basis<3>(mesh, 0.4)}) {
    const ElasticSolver<3> solver(approximation, model,
                                  {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")});
    const auto solution = solver.solve({{tension<3>("right", 1.0)}, {}});
    const Points<3> u = interpolate(approximation.shape, solution.coefficients);
    double worst = 0.0;
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const Vec<3> x = mesh.vertex(v);
      worst = std::max(worst, (u.col(v) - Vec<3>(x[0], -nu * x[1], -nu * x[2]) / E).norm());
    }
    EXPECT_LT(worst, 1e-11 / E * 100.0);
  }
}

TEST(Seam, BasisFromOutsidePassesThePatchTestOnAPlateWithAHole) {
  const testing::Body body = testing::body("plate_with_hole");
  const auto approximation = grid_basis<2>(body.mesh, 0.2);
  std::vector<std::string> all = body.outer;
  all.insert(all.end(), body.inner.begin(), body.inner.end());
  for (const auto& field : testing::linear_fields<2>()) {
    const auto error = testing::patch_error<2>(
        approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}, field, all, {});
    EXPECT_LT(error.displacement, 1e-11) << field.name;
    EXPECT_LT(error.stress, 1e-11) << field.name;
  }
}

TEST(Seam, CrystalThatIsIsotropicIsTheBuiltInMaterial) {
  const IsotropicModuli moduli{2.0, 0.3};
  const Lame lame = solid_lame(moduli);
  const testing::Body body = testing::body("plate_with_hole");
  const auto approximation = approximate<2>(body.mesh, {.spacing = body.spacing});
  for (const Plane plane : {Plane::strain, Plane::stress}) {
    const auto pulled = [&](SharedMaterial material) {
      return ElasticSolver<2>(approximation, {.material = std::move(material), .plane = plane},
                              {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")})
          .solve({{tension<2>("right", 1.0)}, {}});
    };
    const auto crystal = pulled(CubicCrystal(lame.lambda + 2.0 * lame.mu, lame.lambda, lame.mu)),
               isotropic = pulled(LinearElastic(moduli));
    EXPECT_LT((crystal.coefficients - isotropic.coefficients).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LT((crystal.stress - isotropic.stress).cwiseAbs().maxCoeff(), 1e-11);
  }
}

/// A bar whose modulus grows along it: u' = 1 / E.
TEST(Seam, BarOfGradedModulusStretchesByTheIntegralOfItsCompliance) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.05});
  const ElasticModel model{.material = LinearElastic([](const Vec<3>& X) { return 1.0 + X[0]; }, 0.0),
                           .plane = Plane::stress};
  const std::vector<DisplacementCondition<2>> supports{symmetry_plane<2>("left"), symmetry_plane<2>("bottom")};
  const Loads<2> loads{{tension<2>("right", 1.0)}, {}};
  const auto cloud = approximate<2>(mesh, {.spacing = 0.2});
  const auto largest = [&](const FineSpace<2>& space, const Points<2>& u) {
    double worst = 0.0;
    for (Index v = 0; v < space.size(); ++v)
      worst = std::max(worst, (u.col(v) - Vec<2>(std::log1p(space.points()(0, v)), 0.0)).norm());
    return worst / std::log(3.0);
  };
  const auto solution = ElasticSolver<2>(cloud, model, supports).solve(loads);
  const Points<2> u = interpolate(cloud.shape, solution.coefficients);
  EXPECT_LT(largest(cloud.space, u), 2e-3) << "cloud";
  const auto corrected = Corrector<2>(cloud, model, supports).correct(u, loads, {.tolerance = 1e-6});
  EXPECT_LT(largest(cloud.space, corrected.displacement), 2e-5) << "corrected";
  EXPECT_NEAR(corrected.strain_energy, 0.5 * std::log(3.0), 1e-5);
  const auto elements = approximate<2>(mesh, {.kind = BasisKind::p2});
  const auto direct = ElasticSolver<2>(elements, model, supports).solve(loads);
  EXPECT_LT(largest(elements.space, direct.coefficients), 2e-5) << "quadratic elements";
  const auto fields = recover_fields(elements, direct);
  EXPECT_LT((fields.stress.colwise() - Voigt<2>(1.0, 0.0, 0.0, 0.0)).cwiseAbs().maxCoeff(), 2e-3);
  EXPECT_LT(recovery_error(elements, fields, materials_of(model, mesh)).relative, 1e-3);
}

/// Lekhnitskii (1968), Anisotropic Plates, section 10: Young's modulus at an angle to the axes.
TEST(Seam, OrthotropicSheetPulledAtAnAngleHasTheModulusOfThatAngle) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.1});
  OrthotropicModuli wood{{11.0, 0.9, 0.6}, {0.4, 0.35, 0.3}, {0.04, 0.7, 0.75}};
  const auto approximation = approximate<2>(mesh, {.spacing = 0.35});
  for (const double degrees : {0.0, 20.0, 45.0, 90.0}) {
    const double t = degrees * std::numbers::pi / 180.0, c = std::cos(t), s = std::sin(t);
    wood.axes.topLeftCorner<2, 2>() << c, -s, s, c;
    const ElasticModel model{.material = OrthotropicElastic(wood), .plane = Plane::stress};
    const double compliance = std::pow(c, 4) / wood.E[0] + std::pow(s, 4) / wood.E[1] +
                              (1.0 / wood.G[2] - 2.0 * wood.nu[2] / wood.E[0]) * s * s * c * c;
    const VoigtMatrix<2> S = materials_of(model, mesh).stiffness(0, Vec<2>::Zero()).S;
    EXPECT_NEAR(S(0, 0), compliance, 1e-13) << degrees;
    const Voigt<2> eps = S.col(0);
    const auto exact = [eps](const Vec<2>& x) -> Vec<2> { return {eps[0] * x[0] + eps[3] * x[1], eps[1] * x[1]}; };
    const auto solution = ElasticSolver<2>(approximation, model, {testing::displacement<2>("left", exact)})
                              .solve({{tension<2>("right", 1.0)}, {}});
    EXPECT_LT((solution.stress.colwise() - Voigt<2>(1.0, 0.0, 0.0, 0.0)).cwiseAbs().maxCoeff(), 1e-10) << degrees;
    const double nu_13 = wood.nu[1];
    if (degrees == 0.0) {
      EXPECT_NEAR(solution.strain(2, 0), -nu_13 / wood.E[0], 1e-12) << "it thins";
    }
  }
}

}  // namespace
}  // namespace efree
