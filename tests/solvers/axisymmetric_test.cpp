// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of revolution: x is the radius, y the axis.
#include "efree/bench/lame.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solvers/patch_tolerance.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/LU>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// The mesh moved along x.
FineMesh<2> moved(const FineMesh<2>& mesh, double distance) {
  MeshData<2> data{mesh.vertices(), mesh.cells(), {}};
  data.vertices.row(0).array() += distance;
  for (const auto& group : mesh.groups()) {
    data.groups.push_back({group.name, {}});
    for (Index f : group.facets) data.groups.back().facets.push_back({mesh.facets()(0, f), mesh.facets()(1, f)});
  }
  return FineMesh<2>(data);
}

/// A body that touches the axis with its left side ("square"), or a ring around it ("square_ring").
testing::Body section(std::string name) {
  const bool ring = name.ends_with("_ring");
  if (ring) name.resize(name.size() - 5);
  testing::Body body = testing::body(name);
  body.mesh = moved(body.mesh, ring ? 0.7 : 0.0);
  return body;
}

/// u = (0.4 r, 0.3 - 0.7 z): the only strains that are constant and in equilibrium.
struct ConstantStrain {
  static Vec<2> displacement(const Vec<2>& x) { return {0.4 * x.x(), 0.3 - 0.7 * x.y()}; }
  static Voigt<2> strain() { return {0.4, -0.7, 0.4, 0.0}; }
};

/// Largest errors with displacements held on some parts and tractions on others; also of volume and strain energy.
testing::PatchError patch_error(const Approximation<2>& approximation, const ElasticModel& model,
                                const std::vector<std::string>& held, const std::vector<std::string>& loaded) {
  const VoigtMatrix<2> C = materials_of(model, approximation.space.mesh()).stiffness(0, Vec<2>::Zero()).C;
  const Voigt<2> stress = C * ConstantStrain::strain();
  std::vector<DisplacementCondition<2>> conditions;
  for (const auto& part : held) conditions.push_back(testing::displacement<2>(part, ConstantStrain::displacement));
  Loads<2> loads;
  for (const auto& part : loaded)
    loads.tractions.push_back({part, [&](const Vec<2>&, const Vec<2>& n) -> Vec<2> {
                                 return {stress[0] * n.x(), stress[1] * n.y()};
                               }});
  const auto solution = ElasticSolver<2>(approximation, model, conditions).solve(loads);
  const auto fields = recover_fields(approximation, solution);
  const auto& x = approximation.space.points();
  double displacement = 0.0;
  for (Index v = 0; v < x.cols(); ++v)
    displacement = std::max(displacement, (fields.displacement.col(v) - ConstantStrain::displacement(x.col(v))).norm());
  double volume = 0.0;
  for (Index c = 0; c < approximation.space.mesh().num_cells(); ++c) volume += approximation.space.volume(c);
  EXPECT_NEAR(approximation.quadrature.weights.sum() / volume, 1.0, 1e-13);
  EXPECT_NEAR(solution.strain_energy / (0.5 * volume * stress.dot(ConstantStrain::strain())), 1.0, patch_tolerance);
  EXPECT_LE((fields.strain.colwise() - ConstantStrain::strain()).cwiseAbs().maxCoeff(), 10.0 * patch_tolerance);
  const double scale = C(0, 0);
  return {displacement, (solution.stress.colwise() - stress).cwiseAbs().maxCoeff() / scale,
          (fields.stress.colwise() - stress).cwiseAbs().maxCoeff() / scale};
}

class AxisymmetricPatchTest : public ::testing::TestWithParam<std::tuple<std::string, SecondaryKind, Essential>> {
 protected:
  static void expect_exact(const testing::Body& body, ApproximationOptions options, ElasticModel model, int clouds) {
    options.axisymmetric = true;
    options.spacing = body.spacing;
    model.plane = Plane::axisymmetric;
    if (model.essential == Essential::strong) options.vanish_on = body.outer;
    std::vector<std::string> loaded{"left", "right", "top"};
    loaded.insert(loaded.end(), body.inner.begin(), body.inner.end());
    for (int seed = 1; seed <= clouds; ++seed) {
      options.seed = static_cast<std::uint64_t>(seed);
      const auto approximation = approximate(body.mesh, options);
      for (const bool all : {true, false}) {
        const auto error = all ? patch_error(approximation, model, body.outer, body.inner)
                               : patch_error(approximation, model, {"bottom"}, loaded);
        EXPECT_LE(error.displacement, patch_tolerance) << (all ? "held" : "loaded") << ", cloud " << seed;
        EXPECT_LE(error.stress, patch_tolerance) << (all ? "held" : "loaded") << ", cloud " << seed;
        EXPECT_LE(error.recovered, patch_tolerance) << (all ? "held" : "loaded") << ", cloud " << seed;
      }
    }
  }
};

TEST_P(AxisymmetricPatchTest, ConstantStrainIsExact) {
  const auto [name, secondary, essential] = GetParam();
  const auto body = section(name);
  expect_exact(body, {.secondary = secondary}, {.material = LinearElastic(1.0, 0.3), .essential = essential},
               name == "square" ? 10 : 2);
}

TEST_P(AxisymmetricPatchTest, ConstantStrainIsExactWithUnionsStabilisationAndQuadraticCells) {
  const auto [name, secondary, essential] = GetParam();
  const auto body = section(name);
  const ElasticModel model{.material = LinearElastic(1.0, 0.45), .essential = essential};
  ElasticModel stabilised = model;
  stabilised.stabilisation = 0.5;
  expect_exact(body, {.secondary = secondary, .dilatation = Dilatation::averaged, .fine = true}, stabilised, 1);
  expect_exact(
      body,
      {.interpolation = 2, .grading = {.features = true}, .secondary = secondary, .dilatation = Dilatation::averaged},
      model, 1);
}

INSTANTIATE_TEST_SUITE_P(
    Bodies, AxisymmetricPatchTest,
    ::testing::Combine(::testing::Values("square", "square_ring", "slivers", "plate_with_hole", "l_shape_ring", "slit"),
                       ::testing::Values(SecondaryKind::cells, SecondaryKind::linear, SecondaryKind::mls),
                       ::testing::Values(Essential::nitsche, Essential::strong)),
    [](const auto& test) {
      return std::string(std::get<0>(test.param)) + "_" + testing::name_of(std::get<1>(test.param)) +
             (std::get<2>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
    });

/// u = (0.4 r^2 + 0.3 r z, 0.2 r^2 - 0.5 z^2): linear strains, constant body forces.
struct LinearStrain {
  static Vec<2> displacement(const Vec<2>& x) {
    return {0.4 * x.x() * x.x() + 0.3 * x.x() * x.y(), 0.2 * x.x() * x.x() - 0.5 * x.y() * x.y()};
  }
  static Voigt<2> strain(const Vec<2>& x) {
    return {0.8 * x.x() + 0.3 * x.y(), -x.y(), 0.4 * x.x() + 0.3 * x.y(), 0.7 * x.x()};
  }
  static Vec<2> force(const IsotropicModuli& moduli) {
    const double mu = moduli.E / (2.0 * (1.0 + moduli.nu)), lambda = 2.0 * mu * moduli.nu / (1.0 - 2.0 * moduli.nu);
    return {-1.2 * lambda - 2.4 * mu, 0.4 * lambda + 0.6 * mu};
  }
};

class AxisymmetricQuadraticPatch : public ::testing::TestWithParam<std::tuple<std::string, Essential>> {};

TEST_P(AxisymmetricQuadraticPatch, IsExactOnLinearFunctionsOfClusters) {
  const auto [name, essential] = GetParam();
  const auto body = section(name);
  const IsotropicModuli moduli{1.0, 0.3};
  const ElasticModel model{.material = LinearElastic(moduli), .plane = Plane::axisymmetric, .essential = essential};
  const VoigtMatrix<2> C = testing::hooke<2>(moduli, Plane::axisymmetric);
  std::vector<DisplacementCondition<2>> conditions;
  for (const auto& part : body.outer) conditions.push_back(testing::displacement<2>(part, LinearStrain::displacement));
  const auto pulled = [&](const Vec<2>& x, const Vec<2>& n) { return traction<2>(C * LinearStrain::strain(x), n); };
  Loads<2> loads{.tractions = {}, .body_force = [&](const Vec<2>&) { return LinearStrain::force(moduli); }};
  for (const auto& part : body.inner) loads.tractions.push_back({part, pulled});
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    ApproximationOptions options{.axisymmetric = true,
                                 .order = 2,
                                 .interpolation = 2,
                                 .spacing = body.spacing,
                                 .seed = seed,
                                 .secondary = SecondaryKind::linear};
    if (essential == Essential::strong) options.vanish_on = body.outer;
    const auto approximation = approximate(body.mesh, options);
    const auto solution = ElasticSolver<2>(approximation, model, conditions).solve(loads);
    const auto fields = recover_fields(approximation, solution);
    double displacement = 0.0, stress = 0.0, recovered = 0.0;
    for (Index v = 0; v < approximation.space.size(); ++v) {
      const Vec<2> x = approximation.space.points().col(v);
      displacement = std::max(displacement, (fields.displacement.col(v) - LinearStrain::displacement(x)).norm());
      recovered = std::max(recovered, (fields.stress.col(v) - C * LinearStrain::strain(x)).norm());
    }
    for (Index K = 0; K < approximation.quadrature.size(); ++K)
      stress = std::max(
          stress, (solution.stress.col(K) - C * LinearStrain::strain(approximation.quadrature.points.col(K))).norm());
    EXPECT_LE(displacement, patch_tolerance) << "cloud " << seed;
    EXPECT_LE(stress, patch_tolerance) << "cloud " << seed;
    EXPECT_LE(recovered, patch_tolerance) << "cloud " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Bodies, AxisymmetricQuadraticPatch,
                         ::testing::Combine(::testing::Values("square", "square_ring", "plate_with_hole",
                                                              "l_shape_ring", "slit"),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) +
                                  (std::get<1>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

TEST(AxisymmetricFiniteElements, ConstantStrainIsExact) {
  for (const char* name : {"l_shape", "l_shape_ring"}) {
    const auto body = section(name);
    for (const auto kind : {BasisKind::p1, BasisKind::p2})
      for (const auto essential : {Essential::nitsche, Essential::strong}) {
        const auto approximation = approximate(body.mesh, {.kind = kind, .axisymmetric = true});
        const auto error = patch_error(
            approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::axisymmetric, .essential = essential},
            {"bottom"}, {"left", "right", "top", "notch"});
        EXPECT_LE(error.displacement, patch_tolerance) << name;
        EXPECT_LE(error.stress, patch_tolerance) << name;
      }
  }
}

TEST(Axisymmetric, VolumeCentreAndHoopStrainAreThoseOfTheBodyOfRevolution) {
  const auto mesh = triangulate(shapes::rectangle(1, 0, 3, 2), {.size = 0.1});
  const auto approximation = approximate(mesh, {.axisymmetric = true, .spacing = 0.4});
  const auto& quadrature = approximation.quadrature;
  const double volume = std::numbers::pi * (9.0 - 1.0) * 2.0;
  EXPECT_NEAR(quadrature.weights.sum(), volume, 1e-11);
  // int r dV / V = 2/3 (27 - 1) / (9 - 1)
  const Vec<2> centre = quadrature.points * quadrature.weights / volume;
  EXPECT_NEAR(centre.x(), 2.0 / 3.0 * 26.0 / 8.0, 1e-12);
  EXPECT_NEAR(centre.y(), 1.0, 1e-12);
  // A ring that grows by 1 everywhere: hoop strain 1/r, whose mean over a point's cells is that of 2 pi dA / dV.
  Points<2> growth = Points<2>::Zero(2, approximation.nodes.cols());
  growth.row(0).setOnes();
  const auto strains = strain(quadrature, growth);
  ASSERT_EQ(strains.rows(), 4);
  for (Index K = 0; K < quadrature.size(); ++K) {
    EXPECT_NEAR(strains(0, K), 0.0, 1e-12);
    EXPECT_NEAR(strains(2, K) * quadrature.points(0, K), 1.0, 0.02);
  }
  EXPECT_NEAR(strains.row(2).dot(quadrature.weights), 2.0 * std::numbers::pi * 2.0 * 2.0, 1e-11);
}

/// Weighted products of a random strain-like field with a random displacement, both ways.
TEST(Axisymmetric, InternalForceIsTheAdjointOfTheGradient) {
  const auto body = section("plate_with_hole");
  for (const auto secondary : {SecondaryKind::cells, SecondaryKind::mls}) {
    const auto approximation =
        approximate(body.mesh, {.axisymmetric = true, .spacing = body.spacing, .secondary = secondary});
    const auto& quadrature = approximation.quadrature;
    const Points<2> U = Points<2>::Random(2, approximation.nodes.cols());
    const Gradients<2> stress = Gradients<2>::Random(5, quadrature.size());
    const double inside = (stress.cwiseProduct(gradient(quadrature, U)).colwise().sum() * quadrature.weights).value();
    EXPECT_NEAR(internal_force(quadrature, stress).cwiseProduct(U).sum(), inside, 1e-12 * std::abs(inside) + 1e-12);
    // ... and the stiffness is the composition of the two.
    const auto A = Materials<2>({LinearElastic(1.0, 0.3)}, Plane::axisymmetric).tangents(quadrature);
    const SymmetricMatrix K = stiffness_matrix(quadrature, A);
    const Vector Ku = K.selfadjointView<Eigen::Lower>() * Vector(U.reshaped());
    const Vector composed = internal_force(quadrature, Gradients<2>(A[0] * gradient(quadrature, U))).reshaped();
    EXPECT_LE((Ku - composed).cwiseAbs().maxCoeff(), 1e-12 * composed.cwiseAbs().maxCoeff());
  }
}

/// Rotating solid cylinder between planes that do not move, unit force per volume at the rim, E = 1, nu = 0.3: plane
/// strain, u = A r / 2 - k r^3 / 8 with a free rim at r = 1. The axis is part of the boundary, and nothing holds it.
struct RotatingCylinder {
  static constexpr IsotropicModuli material{1.0, 0.3};
  Lame lame = solid_lame(material);
  double k = 1.0 / (lame.lambda + 2.0 * lame.mu);
  double A = k * (2.0 * lame.lambda + 3.0 * lame.mu) / (4.0 * (lame.lambda + lame.mu));

  Vec<2> displacement(const Vec<2>& x) const { return {0.5 * A * x.x() - k * std::pow(x.x(), 3.0) / 8.0, 0.0}; }
  Voigt<2> stress(const Vec<2>& x) const {
    const double rr = x.x() * x.x();
    return testing::hooke<2>(material, Plane::axisymmetric) *
           Voigt<2>(0.5 * A - 3.0 * k * rr / 8.0, 0.0, 0.5 * A - k * rr / 8.0, 0.0);
  }

  struct Result {
    double l2, energy, recovered;
    double on_axis;  ///< largest radial displacement on the axis over that of the rim
  };
  Result solve(double H, ApproximationOptions options) const {
    const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 0.5), {.size = H / 4.0});
    options.axisymmetric = true;
    options.spacing = H;
    const auto approximation = approximate(mesh, options);
    const ElasticModel model{.material = LinearElastic(material), .plane = Plane::axisymmetric};
    const auto solution =
        ElasticSolver<2>(approximation, model, {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")})
            .solve({{}, [](const Vec<2>& x) -> Vec<2> {
                      return {x.x(), 0.0};
                    }});
    const auto fields = recover_fields(approximation, solution);
    const Errors errors = errors_against<2>(
        approximation, fields, materials_of(model, mesh),
        {[this](const Vec<2>& x) { return displacement(x); }, [this](const Vec<2>& x) { return stress(x); }});
    Result result{*errors.l2_displacement, *errors.energy_norm, *errors.energy_norm_recovered, 0.0};
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (mesh.vertex(v).x() == 0.0)
        result.on_axis = std::max(result.on_axis, std::abs(fields.displacement(0, v)) / displacement({1.0, 0.0}).x());
    return result;
  }
};

class AxisOfRevolution : public ::testing::TestWithParam<SecondaryKind> {};

TEST_P(AxisOfRevolution, NeedsNoConditionOfItsOwn) {
  const RotatingCylinder cylinder;
  const auto coarse = cylinder.solve(0.25, {.secondary = GetParam()});
  const auto fine = cylinder.solve(0.0625, {.secondary = GetParam()});
  const auto order = [&](double RotatingCylinder::Result::*error) {
    return std::log2(coarse.*error / (fine.*error)) / 2.0;
  };
  EXPECT_LE(fine.on_axis, 1e-3);
  EXPECT_GE(order(&RotatingCylinder::Result::l2), 1.6);
  EXPECT_LE(order(&RotatingCylinder::Result::l2), 2.8);
  EXPECT_GE(order(&RotatingCylinder::Result::energy), 0.9);
  EXPECT_LE(order(&RotatingCylinder::Result::energy), 1.8);
  EXPECT_GE(order(&RotatingCylinder::Result::recovered), 1.1);
  EXPECT_LE(order(&RotatingCylinder::Result::recovered), 2.0);
}

INSTANTIATE_TEST_SUITE_P(Secondary, AxisOfRevolution,
                         ::testing::Values(SecondaryKind::cells, SecondaryKind::linear, SecondaryKind::mls),
                         [](const auto& test) { return testing::name_of(test.param); });

/// Lame's cylinder and sphere: bars and orders, a wall of thickness 1 and inner radius 1 with 1 / H + 1 nodes through
/// it.
class Lame1852 : public ::testing::TestWithParam<std::tuple<bool, SecondaryKind>> {
 protected:
  static bench::ThickWall::WallErrors section_errors(bool sphere, SecondaryKind secondary, double H,
                                                     std::uint64_t seed = 1) {
    const bench::ThickWall wall{sphere};
    const auto mesh = triangulate(wall.section(4.0 * H, H / 4.0), {.size = H / 4.0});
    const auto approximation =
        approximate(mesh, {.axisymmetric = true, .spacing = H, .seed = seed, .secondary = secondary});
    return wall.errors<2>(approximation, wall.solver<2>(approximation).solve(wall.loads<2>()));
  }
};

TEST_P(Lame1852, EightNodesThroughTheWallGiveTheDisplacementWithinAPercent) {
  const auto [sphere, secondary] = GetParam();
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto errors = section_errors(sphere, secondary, 1.0 / 7.0, seed);
    EXPECT_LE(errors.displacement.mean, 0.01) << "cloud " << seed;
    EXPECT_LE(*errors.body.l2_displacement, 0.01) << "cloud " << seed;
    // At the pole, where the wall has next to no area, two of three clouds are off by 2 to 3 %.
    EXPECT_LE(errors.displacement.worst, sphere ? 0.035 : 0.01) << "cloud " << seed;
  }
}

TEST_P(Lame1852, RecoveredStressIsWithinAFewPercentOnEightNodesAndOneOnSixteen) {
  // Radial strains of order 1 lag at the wall, where they change fastest; no fit can know. Within 1 % takes more nodes.
  const auto [sphere, secondary] = GetParam();
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto errors = section_errors(sphere, secondary, 1.0 / 7.0, seed);
    EXPECT_LE(errors.hoop.mean, sphere ? 0.07 : 0.03) << "cloud " << seed;
    // Linear functions lose here: docs/evidence.md, "Indicators or linear functions".
    const double more = secondary == SecondaryKind::linear ? 1.05 : 1.0;
    EXPECT_LE(*errors.body.energy_norm_recovered, more * (sphere ? 0.04 : 0.018)) << "cloud " << seed;
  }
  const auto fine = section_errors(sphere, secondary, 1.0 / 15.0);
  EXPECT_LE(fine.hoop.mean, secondary == SecondaryKind::cells ? 0.01 : 0.015);
  EXPECT_LE(*fine.body.energy_norm_recovered, 0.007);
}

TEST_P(Lame1852, SectionsConverge) {
  const auto [sphere, secondary] = GetParam();
  const auto coarse = section_errors(sphere, secondary, 0.25), fine = section_errors(sphere, secondary, 0.0625);
  const auto order = [](double before, double after) { return std::log2(before / after) / 2.0; };
  EXPECT_GE(order(*coarse.body.l2_displacement, *fine.body.l2_displacement), 1.6);
  EXPECT_LE(order(*coarse.body.l2_displacement, *fine.body.l2_displacement), 3.0);
  EXPECT_GE(order(*coarse.body.energy_norm, *fine.body.energy_norm), 1.0);
  EXPECT_LE(order(*coarse.body.energy_norm, *fine.body.energy_norm), 1.8);
  EXPECT_GE(order(*coarse.body.energy_norm_recovered, *fine.body.energy_norm_recovered), 1.3);
  EXPECT_LE(order(*coarse.body.energy_norm_recovered, *fine.body.energy_norm_recovered), 2.2);
}

INSTANTIATE_TEST_SUITE_P(Walls, Lame1852,
                         ::testing::Combine(::testing::Bool(),
                                            ::testing::Values(SecondaryKind::cells, SecondaryKind::linear,
                                                              SecondaryKind::mls)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param) ? "sphere" : "cylinder") + "_" +
                                  testing::name_of(std::get<1>(test.param));
                         });

/// Eight nodes through the wall, growing from the inner wall: not more of them, but where stress changes.
template <int Dim> bench::ThickWall::WallErrors graded_wall_errors(bool sphere, int order, std::uint64_t seed) {
  const bench::ThickWall wall{sphere};
  const auto [at_inner, at_outer, grading] = bench::ThickWall::spacing(8, Grading{}.growth);
  const auto mesh = wall.mesh<Dim>(4.0 / 7.0, at_outer / 2.5, at_inner / 2.5);
  const auto approximation = approximate(
      mesh, {.axisymmetric = Dim == 2, .order = order, .spacing = at_outer, .grading = grading, .seed = seed});
  return wall.errors<Dim>(approximation, wall.solver<Dim>(approximation).solve(wall.loads<Dim>()));
}
void expect_within_a_percent(const bench::ThickWall::WallErrors& errors) {
  EXPECT_LE(errors.displacement.worst, 0.01);
  EXPECT_LE(*errors.body.l2_displacement, 0.01);
}

class Lame1852Graded : public ::testing::TestWithParam<bool> {};

TEST_P(Lame1852Graded, EightNodesGiveTheDisplacementEverywhereOnTheWallOfSectionsWithinAPercent) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    expect_within_a_percent(graded_wall_errors<2>(GetParam(), 1, seed));
  }
}
TEST_P(Lame1852Graded, OrderTwoGivesTheMeanHoopStressAtTheWallOfSectionsWithinAPercentToo) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    const auto errors = graded_wall_errors<2>(GetParam(), 2, seed);
    expect_within_a_percent(errors);
    EXPECT_LE(errors.hoop.mean, 0.01);
    EXPECT_LE(errors.hoop.worst, GetParam() ? 0.025 : 0.01);
  }
}
TEST_P(Lame1852Graded, OrderTwoGivesBothInSpaceWithinAPercent) {
  const auto errors = graded_wall_errors<3>(GetParam(), 2, 1);
  expect_within_a_percent(errors);
  EXPECT_LE(errors.hoop.mean, 0.01);
  EXPECT_LE(errors.hoop.worst, 0.025);
}
INSTANTIATE_TEST_SUITE_P(Walls, Lame1852Graded, ::testing::Bool(),
                         [](const auto& test) { return test.param ? "sphere" : "cylinder"; });

TEST(Lame1852Solids, EightNodesThroughTheWallGiveTheSameDisplacementInSpaceWithinAPercent) {
  const double H = 1.0 / 7.0;
  for (const bool sphere : {false, true}) {
    const bench::ThickWall wall{sphere};
    const FineMesh<3> mesh(wall.solid(2.0 * H, H / 1.5));
    const auto approximation = approximate(mesh, {.spacing = H});
    const auto errors = wall.errors<3>(approximation, wall.solver<3>(approximation).solve(wall.loads<3>()));
    EXPECT_LE(errors.displacement.mean, 0.01) << (sphere ? "sphere" : "cylinder");
    EXPECT_LE(*errors.body.l2_displacement, 0.01) << (sphere ? "sphere" : "cylinder");
    // Hoop stress at the wall: see the sections.
    EXPECT_LE(errors.hoop.mean, sphere ? 0.05 : 0.02) << (sphere ? "sphere" : "cylinder");
    EXPECT_LE(*errors.body.energy_norm_recovered, sphere ? 0.022 : 0.015) << (sphere ? "sphere" : "cylinder");
  }
}

TEST(Axisymmetric, RegionsAreTiedAndSeeThePressureOfAShrinkFit) {
  // Two rings of different moduli with a common interface at r = 1.5, pressed from inside: Lame in each of them.
  PlanarDomain rings{.boundary = {{"bottom", {{1, 0}, {2, 0}}},
                                  {"outer", {{2, 0}, {2, 0.5}}},
                                  {"top", {{2, 0.5}, {1, 0.5}}},
                                  {"inner", {{1, 0.5}, {1, 0}}}},
                     .embedded = {{"", {{1.5, 0}, {1.5, 0.5}}}}};
  MeshData<2> data = triangulate_data(rings, {.size = 0.03});
  data.region_names = {"liner", "jacket"};
  for (Index c = 0; c < data.cells.cols(); ++c)
    data.regions.push_back(data.vertices(0, data.cells(0, c)) + data.vertices(0, data.cells(1, c)) +
                               data.vertices(0, data.cells(2, c)) >
                           4.5);
  const FineMesh<2> mesh(cut_regions(std::move(data)));
  const auto approximation = approximate(mesh, {.axisymmetric = true, .spacing = 0.125});
  const ElasticModel model{
      .material = {}, .plane = Plane::axisymmetric, .regions = {LinearElastic(1.0, 0.3), LinearElastic(100.0, 0.2)}};
  const auto solution =
      ElasticSolver<2>(approximation, model, {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")})
          .solve({.tractions = {pressure<2>("inner", [](const Vec<2>&) { return 1.0; })}, .body_force = {}});
  // u = a r + b / r in each ring, sigma_rr = 2 (lambda + mu) a - 2 mu b / r^2; four conditions for (a1, b1, a2, b2).
  const Lame in = solid_lame({1.0, 0.3}), out = solid_lame({100.0, 0.2});
  const auto radial = [](const Lame& lame, double r) {
    return Vec<2>(2.0 * (lame.lambda + lame.mu), -2.0 * lame.mu / (r * r));
  };
  Mat<4> A = Mat<4>::Zero();
  A.row(0).head<2>() = radial(in, 1.0);
  A.row(1) << 1.5, 1.0 / 1.5, -1.5, -1.0 / 1.5;
  A.row(2) << radial(in, 1.5).transpose(), -radial(out, 1.5).transpose();
  A.row(3).tail<2>() = radial(out, 2.0);
  const Vec<4> ab = A.inverse() * Vec<4>(-1.0, 0.0, 0.0, 0.0);
  const auto fields = recover_fields(approximation, solution);
  for (const double r : {1.0, 1.25, 1.75, 2.0}) {
    const Vec<2> half = r < 1.5 ? Vec<2>(ab.head<2>()) : Vec<2>(ab.tail<2>());
    const Lame& lame = r < 1.5 ? in : out;
    const auto values = probe<2>(approximation.space, fields, {r, 0.25});
    EXPECT_NEAR(values.displacement.x(), half[0] * r + half[1] / r, 0.01 * (ab[0] + ab[1])) << "r = " << r;
    EXPECT_NEAR(values.stress[0], radial(lame, r).dot(half), 0.03) << "r = " << r;
  }
}

TEST(Axisymmetric, BadInputIsRefusedWithAReason) {
  const auto refuses = [](const auto& work, const char* text) {
    EXPECT_THAT(work, ThrowsMessage<InputError>(HasSubstr(text)));
  };
  const auto mesh = section("square").mesh;
  const ApproximationOptions options{.axisymmetric = true, .spacing = 0.25};
  refuses([&] { approximate(moved(mesh, -0.1), options); }, "negative radius");
  const auto approximation = approximate(mesh, options);
  const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::axisymmetric};
  // Nothing held; only radial displacements held; only the axis itself, which has no area.
  refuses([&] { ElasticSolver<2>(approximation, model, {}); }, "translation along the axis");
  refuses([&] { ElasticSolver<2>(approximation, model, {symmetry_plane<2>("right")}); }, "translation along the axis");
  refuses([&] { ElasticSolver<2>(approximation, model, {clamp<2>("left")}); }, "translation along the axis");
  EXPECT_NO_THROW(ElasticSolver<2>(approximation, model, {symmetry_plane<2>("bottom")}));
  refuses(
      [&] {
        ElasticSolver<2>(approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                         {clamp<2>("bottom")});
      },
      "expected Plane::axisymmetric");
  const auto plane = approximate(mesh, {.spacing = 0.25});
  refuses([&] { ElasticSolver<2>(plane, model, {clamp<2>("bottom")}); }, "axisymmetric = true");
}

TEST(Axisymmetric, VonMisesStressKnowsTheHoops) {
  EXPECT_NEAR(von_mises<2>(Voigt<2>(1.0, 1.0, 1.0, 0.0)), 0.0, 1e-15);
  EXPECT_NEAR(von_mises<2>(Voigt<2>(0.0, 0.0, 2.0, 0.0)), 2.0, 1e-15);
  EXPECT_NEAR(von_mises<2>(Voigt<2>(0.0, 0.0, 0.0, 1.0)), std::sqrt(3.0), 1e-15);
}

}  // namespace
}  // namespace efree
