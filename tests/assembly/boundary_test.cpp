// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/bodies.hpp"
#include "efree/assembly/loads.hpp"
#include "efree/assembly/nitsche.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

namespace efree {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };

/// Force and moment about the origin of a load vector: its work on the rigid motions, which the basis holds exactly.
Eigen::Vector3d resultant(const Approximation<2>& approximation, const Loads<2>& loads) {
  const Points<2> f = load_vector(approximation.space, approximation.shape, loads);
  const auto& x = approximation.nodes;
  return {f.row(0).sum(), f.row(1).sum(), (x.row(0).cwiseProduct(f.row(1)) - x.row(1).cwiseProduct(f.row(0))).sum()};
}

class LoadVector : public ::testing::TestWithParam<ApproximationOptions> {
 protected:
  FineMesh<2> mesh_ = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.1});
  Approximation<2> approximation_ = approximate(mesh_, GetParam());
};

TEST_P(LoadVector, PressureHasItsResultant) {
  const auto found =
      resultant(approximation_, {{pressure<2>("right", [](const Vec<2>& x) { return 3.0 * x.y(); })}, {}});
  EXPECT_LT((found - Eigen::Vector3d(-1.5, 0.0, 1.0)).norm(), 1e-12);
}

TEST_P(LoadVector, UniformPressureAllAroundHasNone) {
  Loads<2> loads;
  for (const char* side : {"left", "bottom", "right", "top"})
    loads.tractions.push_back(pressure<2>(side, [](const Vec<2>&) { return 5.0; }));
  EXPECT_LT(resultant(approximation_, loads).norm(), 1e-12);
}

TEST_P(LoadVector, ShearTractionAndBodyForceHaveTheirResultants) {
  const auto shear = [](const Vec<2>& x, const Vec<2>&) -> Vec<2> { return {x.x(), 0.0}; };
  EXPECT_LT((resultant(approximation_, {{{"top", shear}}, {}}) - Eigen::Vector3d(2.0, 0.0, -2.0)).norm(), 1e-12);
  const auto weight = [](const Vec<2>& x) -> Vec<2> { return {0.0, -1.0 - x.x()}; };
  EXPECT_LT((resultant(approximation_, {{}, weight}) - Eigen::Vector3d(0.0, -4.0, -14.0 / 3.0)).norm(), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Bases, LoadVector,
                         ::testing::Values(ApproximationOptions{.spacing = 0.4},
                                           ApproximationOptions{.order = 2, .spacing = 0.4},
                                           ApproximationOptions{.kind = BasisKind::p2}));

TEST(LoadVectorInput, TractionOrBodyForceThatIsNotFiniteIsRefusedWithThePoint) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.5});
  const auto approximation = approximate(mesh, {.kind = BasisKind::p1});
  const auto with_load = [&](const Loads<2>& loads) { load_vector(approximation.space, approximation.shape, loads); };
  const auto nan = [](const Vec<2>&, const Vec<2>&) -> Vec<2> { return {std::nan(""), 0.0}; };
  EXPECT_THAT(
      [&] {
        with_load({{{"right", nan}}, {}});
      },
      ThrowsMessage<InputError>(AllOf(HasSubstr("traction on \"right\""), HasSubstr("at (2, "))));
  const auto infinite = [](const Vec<2>& x) -> Vec<2> { return {1.0 / (x.x() - x.x()), 0.0}; };
  EXPECT_THAT([&] { with_load({{}, infinite}); }, ThrowsMessage<InputError>(HasSubstr("body force is (inf, 0) at (")));
  EXPECT_THAT(
      [&] {
        with_load({{{"rihgt", nan}}, {}});
      },
      ThrowsMessage<InputError>(AllOf(HasSubstr("rihgt"), HasSubstr("right"))));
}

TEST(Restraints, ConditionsAreComponentsOrNormal) {
  EXPECT_EQ(restraints<2>({clamp<2>("left")}).size(), 2u);
  EXPECT_THAT(
      [] {
        restraints<2>({{"left", {zero, nullptr}, zero}});
      },
      ThrowsMessage<InputError>(HasSubstr("not both")));
  EXPECT_THAT(
      [] {
        restraints<2>({{"left", {nullptr, nullptr}, nullptr}});
      },
      ThrowsMessage<InputError>(HasSubstr("prescribes nothing")));
}

class Rigid : public ::testing::Test {
 protected:
  /// Complaint about the conditions, empty if they hold the body.
  static std::string complaint(const FineMesh<2>& mesh, const std::vector<DisplacementCondition<2>>& conditions) {
    try {
      require_restrained<2>(FineSpace<2>(mesh, 1), restraints(conditions));
    } catch (const InputError& error) {
      return error.what();
    }
    return {};
  }
  const FineMesh<2> plate_ = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
};

TEST_F(Rigid, ClampedOrSimplySupportedBodiesAreHeld) {
  EXPECT_EQ(complaint(plate_, {clamp<2>("left")}), "");
  EXPECT_EQ(complaint(plate_, {{"left", {zero, nullptr}, {}}, {"bottom", {nullptr, zero}, {}}}), "");
  EXPECT_EQ(complaint(plate_, {{"left", {}, zero}, {"bottom", {}, zero}}), "");
}

TEST_F(Rigid, FreeMotionsAreNamed) {
  EXPECT_THAT(complaint(plate_, {}),
              AllOf(HasSubstr("translation along x"), HasSubstr("translation along y"), HasSubstr("rotation")));
  EXPECT_THAT(complaint(plate_, {{"left", {zero, nullptr}, {}}}),
              AllOf(HasSubstr("translation along y"), Not(HasSubstr("along x")), Not(HasSubstr("rotation"))));
  EXPECT_THAT(complaint(plate_, {{"bottom", {nullptr, zero}, {}}}),
              AllOf(HasSubstr("translation along x"), Not(HasSubstr("along y")), Not(HasSubstr("rotation"))));
}

TEST_F(Rigid, InclinedPlaneLeavesAnObliqueTranslation) {
  PlanarDomain wedge;
  wedge.boundary = {{"slope", {{0, 0}, {4, 3}}}, {"rest", {{4, 3}, {0, 3}, {0, 0}}}};
  EXPECT_THAT(complaint(triangulate(wedge, {.size = 0.5}), {{"slope", {}, zero}}),
              HasSubstr("translation along (0.8, 0.6)"));
}

TEST_F(Rigid, SidesHeldAlongThemselvesLeaveTheRotationAboutTheirCorner) {
  const auto mesh = triangulate(shapes::rectangle(3, -2, 5, -1), {.size = 0.25});
  EXPECT_THAT(complaint(mesh, {{"left", {nullptr, zero}, {}}, {"bottom", {zero, nullptr}, {}}}),
              AllOf(HasSubstr("rotation about (3, -2)"), Not(HasSubstr("translation"))));
}

TEST_F(Rigid, OneBodyOfTwoThatIsFreeIsNamed) {
  PlanarDomain two = shapes::rectangle(0, 0, 1, 1);
  two.boundary.push_back({"other", {{2, 0}, {3, 0}, {3, 1}, {2, 1}, {2, 0}}});
  const auto mesh = triangulate(two, {.size = 0.25});
  EXPECT_THAT(complaint(mesh, {clamp<2>("left")}),
              AllOf(HasSubstr("free to move (body around (2.5, 0.5): translation along x"),
                    HasSubstr("its nearest neighbour is the body around (0.5, 0.5), 1 away"),
                    Not(HasSubstr("body around (0.5, 0.5): "))));
  EXPECT_EQ(complaint(mesh, {clamp<2>("left"), clamp<2>("other")}), "");
}

TEST_F(Rigid, AFreeBodyHasItsRegionAndTheDistanceFromTheFacetsOfItsNeighbour) {
  PlanarDomain two = shapes::rectangle(0, 0, 3, 1);
  // Beside the middle of the long side, and no vertex of either is opposite of one of the other.
  two.boundary.push_back({"lid", {{1.07, 1.02}, {1.21, 1.02}, {1.21, 1.13}, {1.07, 1.13}, {1.07, 1.02}}});
  const auto plain = triangulate(two, {.size = 0.5});
  MeshData<2> data = extract(plain, std::vector<char>(plain.num_cells(), 1));
  for (Index c = 0; c < plain.num_cells(); ++c) data.regions.push_back(plain.centroid(c)[1] > 1.0);
  data.region_names = {"plate", "lid"};
  EXPECT_THAT(complaint(FineMesh<2>(data), {clamp<2>("left")}),
              AllOf(HasSubstr("(body around (1.14, 1.075) of region \"lid\": translation along x"),
                    HasSubstr("its nearest neighbour is the body around (1.5, 0.5) of region \"plate\", 0.02 away")));
  data.vertices.row(1) =
      data.vertices.row(1).cwiseMin(1.0).eval() + (data.vertices.row(1).array() - 1.02).cwiseMax(0.0).matrix().eval();
  EXPECT_THAT(complaint(FineMesh<2>(data), {clamp<2>("left")}), HasSubstr("which it touches but is not joined to"));
}

class NodalConditionsTest : public ::testing::Test {
 protected:
  NodalConditions<2> conditions(const std::vector<std::string>& vanish_on,
                                const std::vector<DisplacementCondition<2>>& given) const {
    const auto approximation = approximate(mesh_, {.spacing = 0.3, .vanish_on = vanish_on});
    return nodal_conditions(approximation.space, approximation.shape, approximation.node_dofs, restraints(given));
  }
  const FineMesh<2> mesh_ = triangulate(shapes::quarter_plate_with_hole(0.3, 1.0, 0.05), {.size = 0.05});
};

TEST_F(NodalConditionsTest, CornerWhereTwoSymmetryPlanesMeetIsFixedInBoth) {
  const auto approximation = approximate(mesh_, {.spacing = 0.3, .vanish_on = {"right", "top"}});
  const auto result = nodal_conditions(approximation.space, approximation.shape, approximation.node_dofs,
                                       restraints<2>({{"right", {zero, nullptr}, {}}, {"top", {nullptr, zero}, {}}}));
  int both = 0;
  for (std::size_t k = 0; k < result.nodes.size(); ++k)
    if (result.fixed[k] == 2) {
      ++both;
      EXPECT_LT((approximation.nodes.col(result.nodes[k]) - Vec<2>(1.0, 1.0)).norm(), 1e-12);
    }
  EXPECT_EQ(both, 1);
}

TEST_F(NodalConditionsTest, FunctionsThatDoNotVanishAreRefused) {
  EXPECT_THAT([&] { conditions({}, {clamp<2>("left")}); },
              ThrowsMessage<InputError>(HasSubstr("vanish_on = \"left\"")));
}

TEST_F(NodalConditionsTest, NormalDisplacementOnACurveIsRefused) {
  EXPECT_THAT([&] { conditions({"hole"}, {{"hole", {}, zero}}); }, ThrowsMessage<InputError>(HasSubstr("not flat")));
}

TEST_F(NodalConditionsTest, ConditionsThatContradictEachOtherAreRefused) {
  const ScalarField<2> one = [](const Vec<2>&) { return 1.0; };
  EXPECT_THAT(
      [&] {
        conditions({"right", "top"}, {{"right", {zero, nullptr}, {}}, {"top", {one, zero}, {}}});
      },
      ThrowsMessage<InputError>(AllOf(HasSubstr("(1, 1)"), HasSubstr("contradict"))));
}

TEST_F(NodalConditionsTest, DisplacementThatIsNotFiniteIsRefused) {
  const ScalarField<2> nan = [](const Vec<2>&) { return std::nan(""); };
  EXPECT_THAT(
      [&] {
        conditions({"right"}, {{"right", {nan, nullptr}, {}}});
      },
      ThrowsMessage<InputError>(HasSubstr("displacement on \"right\" is nan at (1, ")));
}

class NitscheOn : public ::testing::TestWithParam<std::tuple<std::string, SecondaryKind>> {};

TEST_P(NitscheOn, ClampedBodiesKeepHalfOfTheirEnergy) {
  // a(u, u) - 2 int (sigma n).u + int beta u.u >= a(u, u) / 2 for every u, whatever the functions of the quadrature are
  // on the boundary: the trace inequality that the penalty rests on.
  const auto [name, secondary] = GetParam();
  const auto body = testing::body(name);
  std::vector<DisplacementCondition<2>> clamped;
  for (const auto& side : body.outer) clamped.push_back(clamp<2>(side));
  for (const bool split : {false, true}) {
    const auto approximation = approximate(body.mesh, {.order = 2,
                                                       .interpolation = 2,
                                                       .spacing = body.spacing,
                                                       .secondary = secondary,
                                                       .dilatation = averaged_if(split)});
    const Materials<2> materials({LinearElastic(1.0, split ? 0.49 : 0.3)}, Plane::strain);
    std::vector<StiffnessTerm<2>> terms;
    if (split) {
      terms.push_back(
          {&approximation.quadrature, materials.tangents(approximation.quadrature, StiffnessPart::deviatoric)});
      terms.push_back(
          {&approximation.dilatation, materials.tangents(approximation.dilatation, StiffnessPart::volumetric), true});
    } else {
      terms.push_back({&approximation.quadrature, materials.tangents(approximation.quadrature)});
    }
    SymmetricMatrix form = nitsche(approximation.space, approximation.shape, terms, restraints(clamped)).matrix;
    double largest = 0.0;
    for (const auto& term : terms) {
      const SymmetricMatrix K = stiffness_matrix(*term.discretization, term.tangents);
      form += 0.5 * K;
      largest = std::max(largest, K.diagonal().maxCoeff());
    }
    const Matrix dense = SymmetricMatrix(form.selfadjointView<Eigen::Lower>());
    const Vector eigenvalues = Eigen::SelfAdjointEigenSolver<Matrix>(dense, Eigen::EigenvaluesOnly).eigenvalues();
    EXPECT_GE(eigenvalues.minCoeff(), -1e-10 * largest) << (split ? "volumetric part on patches" : "");
  }
}

INSTANTIATE_TEST_SUITE_P(Bodies, NitscheOn,
                         ::testing::Combine(::testing::Values("square", "slivers", "l_shape", "slit"),
                                            ::testing::Values(SecondaryKind::cells, SecondaryKind::linear,
                                                              SecondaryKind::mls)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param)) + "_" +
                                  testing::name_of(std::get<1>(test.param));
                         });

}  // namespace
}  // namespace efree
