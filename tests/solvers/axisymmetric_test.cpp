// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of revolution: x is the radius, y the axis.
#include "efree/bench/lame.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr double bar = 1e-11;

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
  static Voigt<2, 3> strain() { return {0.4, -0.7, 0.4, 0.0}; }
};

/// Largest errors with displacements held on some parts and tractions on others; also of volume and strain energy.
testing::PatchError patch_error(const Approximation<2>& approximation, const ElasticModel& model,
                                const std::vector<std::string>& held, const std::vector<std::string>& loaded) {
  const Lame lame = plane_lame(model.material, model.plane);
  const Voigt<2, 3> stress = stiffness<2, 3>(lame) * ConstantStrain::strain();
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
  EXPECT_NEAR(solution.strain_energy / (0.5 * volume * stress.dot(ConstantStrain::strain())), 1.0, bar);
  EXPECT_LE((fields.strain.colwise() - ConstantStrain::strain()).cwiseAbs().maxCoeff(), 10.0 * bar);
  const double scale = lame.lambda + 2.0 * lame.mu;
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
        EXPECT_LE(error.displacement, bar) << (all ? "held" : "loaded") << ", cloud " << seed;
        EXPECT_LE(error.stress, bar) << (all ? "held" : "loaded") << ", cloud " << seed;
        EXPECT_LE(error.recovered, bar) << (all ? "held" : "loaded") << ", cloud " << seed;
      }
    }
  }
};

TEST_P(AxisymmetricPatchTest, ConstantStrainIsExact) {
  const auto [name, secondary, essential] = GetParam();
  const auto body = section(name);
  expect_exact(body, {.secondary = secondary}, {.material = {1.0, 0.3}, .essential = essential},
               name == "square" ? 10 : 2);
}

TEST_P(AxisymmetricPatchTest, ConstantStrainIsExactWithUnionsStabilisationAndQuadraticCells) {
  const auto [name, secondary, essential] = GetParam();
  const auto body = section(name);
  const ElasticModel model{.material = {1.0, 0.45}, .essential = essential};
  ElasticModel stabilised = model;
  stabilised.stabilisation = 0.5;
  expect_exact(body, {.secondary = secondary, .dilatation = true, .fine = true}, stabilised, 1);
  expect_exact(body, {.interpolation = 2, .grading = {.features = true}, .secondary = secondary, .dilatation = true},
               model, 1);
}

INSTANTIATE_TEST_SUITE_P(Bodies, AxisymmetricPatchTest,
                         ::testing::Combine(::testing::Values("square", "square_ring", "slivers", "plate_with_hole",
                                                              "l_shape_ring", "slit"),
                                            ::testing::Values(SecondaryKind::cells, SecondaryKind::mls),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) +
                                  (std::get<1>(test.param) == SecondaryKind::cells ? "_cells" : "_mls") +
                                  (std::get<2>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

TEST(AxisymmetricFiniteElements, ConstantStrainIsExact) {
  for (const char* name : {"l_shape", "l_shape_ring"}) {
    const auto body = section(name);
    for (const auto kind : {BasisKind::p1, BasisKind::p2})
      for (const auto essential : {Essential::nitsche, Essential::strong}) {
        const auto approximation = approximate(body.mesh, {.kind = kind, .axisymmetric = true});
        const auto error = patch_error(
            approximation, {.material = {1.0, 0.3}, .plane = Plane::axisymmetric, .essential = essential}, {"bottom"},
            {"left", "right", "top", "notch"});
        EXPECT_LE(error.displacement, bar) << name;
        EXPECT_LE(error.stress, bar) << name;
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
TEST(Axisymmetric, InternalForceIsTheAdjointOfStrain) {
  const auto body = section("plate_with_hole");
  for (const auto secondary : {SecondaryKind::cells, SecondaryKind::mls}) {
    const auto approximation =
        approximate(body.mesh, {.axisymmetric = true, .spacing = body.spacing, .secondary = secondary});
    const auto& quadrature = approximation.quadrature;
    const Points<2> U = Points<2>::Random(2, approximation.nodes.cols());
    const VoigtPoints<2> stress = VoigtPoints<2>::Random(4, quadrature.size());
    const double inside = (stress.cwiseProduct(strain(quadrature, U)).colwise().sum() * quadrature.weights).value();
    EXPECT_NEAR(internal_force(quadrature, stress).cwiseProduct(U).sum(), inside, 1e-12 * std::abs(inside) + 1e-12);
    // ... and the stiffness is the composition of the two.
    const auto C = stiffness<2, 3>(solid_lame({1.0, 0.3}));
    const SymmetricMatrix K = stiffness_matrix(quadrature, C);
    const Vector Ku = K.selfadjointView<Eigen::Lower>() * Vector(U.reshaped());
    const Vector composed =
        internal_force(quadrature, VoigtPoints<2>(C * strain(quadrature, U))).reshaped();
    EXPECT_LE((Ku - composed).cwiseAbs().maxCoeff(), 1e-12 * composed.cwiseAbs().maxCoeff());
  }
}

// ---------------------------------------------------------------------------------------------------------------------

}  // namespace
}  // namespace efree
