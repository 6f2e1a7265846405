// SPDX-License-Identifier: GPL-3.0-or-later
// Equations without an algorithm: residuals, tangents and states, with materials that are not linear.
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/solvers/algorithms/linear_step.hpp"
#include "efree/solvers/linear/cholesky.hpp"
#include "efree/tests/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// P = F S, S = lambda tr(E) I + 2 mu E, E = (F^T F - I) / 2.
class SaintVenantKirchhoff final : public Material {
 public:
  SaintVenantKirchhoff(double lambda, double mu) : lambda_(lambda), mu_(mu) {}
  bool homogeneous() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    const Mat<3> one = Mat<3>::Identity();
    for (Index p = 0; p < deformation.size(); ++p) {
      const Mat<3> F = deformation.gradient(p), E = 0.5 * (F.transpose() * F - one);
      const Mat<3> S = lambda_ * E.trace() * one + 2.0 * mu_ * E;
      response.stress(p) = F * S;
      response.energy[p] = 0.5 * S.cwiseProduct(E).sum();
      if (!response.tangent) continue;
      for (int l = 0; l < 9; ++l) {
        Mat<3> dF = Mat<3>::Zero();
        dF(l % 3, l / 3) = 1.0;
        const Mat<3> dE = 0.5 * (dF.transpose() * F + F.transpose() * dF);
        const Mat<3> dP = dF * S + F * (lambda_ * dE.trace() * one + 2.0 * mu_ * dE);
        response.tangent_at(p).col(l) = dP.reshaped();
      }
    }
  }

 private:
  double lambda_, mu_;
};

/// Linear, but does not say so: equations have to ask it for everything.
class Silent final : public Material {
 public:
  explicit Silent(SharedMaterial of) : of_(std::move(of)) {}
  bool homogeneous() const override { return true; }
  bool finite_strain() const override { return of_->finite_strain(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    of_->respond(deformation, response);
  }

 private:
  SharedMaterial of_;
};

/// Stiffens for good with the largest strain xx that it has seen: P = (1 + largest) mu (H + H^T).
class Hardening final : public Material {
 public:
  Index history_size() const override { return 1; }
  bool homogeneous() const override { return true; }
  bool elastic() const override { return true; }  // it does not flow
  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    for (Index p = 0; p < deformation.size(); ++p) {
      const Mat<3> H = deformation.gradient(p) - Mat<3>::Identity();
      const double largest = std::max(deformation.history(0, p), H(0, 0));
      response.history(0, p) = largest;
      response.stress(p) = (1.0 + largest) * (H + H.transpose());
      response.energy[p] = 0.5 * response.stress(p).cwiseProduct(H).sum();
      if (!response.tangent) continue;
      for (int l = 0; l < 9; ++l) {
        Mat<3> dH = Mat<3>::Zero();
        dH(l % 3, l / 3) = 1.0;
        response.tangent_at(p).col(l) = ((1.0 + largest) * (dH + dH.transpose())).reshaped();
      }
    }
  }
};

struct Variant {
  std::string name;
  ApproximationOptions options;
  double stabilisation = 0.0;
  Essential essential = Essential::nitsche;
};
/// Everything that the work of the materials is made of.
std::vector<Variant> variants(double spacing) {
  return {{"plain", {.spacing = spacing, .dilatation = Dilatation::pointwise}},
          {"averaged dilatations", {.spacing = spacing, .dilatation = Dilatation::averaged}},
          {"stabilised", {.spacing = spacing, .dilatation = Dilatation::pointwise, .fine = true}, 0.3},
          {"both", {.spacing = spacing, .dilatation = Dilatation::averaged, .fine = true}, 0.3},
          {"quadratic elements, nodal values",
           {.kind = BasisKind::p2, .dilatation = Dilatation::averaged},
           0.0,
           Essential::strong}};
}

Matrix dense(const SymmetricMatrix& lower) {
  return Matrix(SymmetricMatrix(lower.selfadjointView<Eigen::Lower>()));
}

template <int Dim> std::vector<DisplacementCondition<Dim>> stretched(double by) {
  return {
      symmetry_plane<Dim>("left"), symmetry_plane<Dim>("bottom"), {"right", {}, [by](const Vec<Dim>&) { return by; }}};
}

TEST(Equilibrium, TangentIsTheDerivativeOfTheResidual) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  for (const Plane plane : {Plane::strain, Plane::stress})
    for (const auto& [name, options, stabilisation, essential] : variants(0.6)) {
      const auto approximation = approximate(mesh, options);
      const Equilibrium<2> equations(approximation,
                                     {.material = SaintVenantKirchhoff(1.3, 0.7),
                                      .plane = plane,
                                      .essential = essential,
                                      .stabilisation = stabilisation},
                                     stretched<2>(0.1));
      ASSERT_FALSE(equations.linear());
      State state = equations.under(1.0, equations.rest());
      const auto unknowns = static_cast<Index>(equations.node_of_unknowns().size());
      state = equations.moved(state, 0.02 * Vector::Random(unknowns));
      SymmetricMatrix K;
      equations.tangent(state, K);
      const Vector direction = Vector::Random(unknowns);
      const double step = 1e-5;
      const Vector derivative = (equations.residual(equations.moved(state, step * direction)) -
                                 equations.residual(equations.moved(state, -step * direction))) /
                                (2.0 * step);
      const Vector product = K.selfadjointView<Eigen::Lower>() * direction;
      EXPECT_LT((product - derivative).cwiseAbs().maxCoeff(), 1e-7 * product.cwiseAbs().maxCoeff()) << name;
    }
}

TEST(Equilibrium, ResidualIsTheDerivativeOfTheEnergy) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  for (const auto& [name, options, stabilisation, essential] : variants(0.6)) {
    const auto approximation = approximate(mesh, options);
    // Nothing is held weakly: what holds the boundary is no energy of the materials.
    if (essential == Essential::nitsche) continue;
    const Equilibrium<2> equations(approximation,
                                   {.material = SaintVenantKirchhoff(1.3, 0.7),
                                    .plane = Plane::strain,
                                    .essential = essential,
                                    .stabilisation = stabilisation},
                                   stretched<2>(0.1));
    State state = equations.under(1.0, equations.rest());
    const auto unknowns = static_cast<Index>(equations.node_of_unknowns().size());
    state = equations.moved(state, 0.005 * Vector::Random(unknowns));
    const Vector direction = Vector::Random(unknowns);
    const double step = 1e-6;
    const double derivative = (equations.energy(equations.moved(state, step * direction)) -
                               equations.energy(equations.moved(state, -step * direction))) /
                              (2.0 * step);
    EXPECT_NEAR(equations.residual(state).dot(direction), derivative, 1e-7 * std::abs(derivative)) << name;
  }
}

/// Stresses of assumed strains H + s (tr mean H - tr H) are the split of the stiffness, whatever the material.
TEST(Equilibrium, AskedForEverythingALinearMaterialHasTheTangentOfTheSplitStiffness) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  OrthotropicModuli wood{{11.0, 0.9, 0.6}, {0.4, 0.35, 0.3}, {0.04, 0.7, 0.75}};
  for (const SharedMaterial& material :
       {SharedMaterial(LinearElastic(2.0, 0.4)), SharedMaterial(OrthotropicElastic(wood))})
    for (const Plane plane : {Plane::strain, Plane::stress})
      for (const auto& [name, options, stabilisation, essential] : variants(0.6)) {
        const auto approximation = approximate(mesh, options);
        const auto equations = [&, plane = plane, essential = essential,
                                stabilisation = stabilisation](SharedMaterial of) {
          return Equilibrium<2>(
              approximation,
              {.material = std::move(of), .plane = plane, .essential = essential, .stabilisation = stabilisation},
              stretched<2>(0.1));
        };
        const auto told = equations(material), silent = equations(Silent(material));
        ASSERT_TRUE(told.linear());
        ASSERT_FALSE(silent.linear());
        SymmetricMatrix K, asked;
        told.tangent(told.rest(), K);
        silent.tangent(silent.rest(), asked);
        EXPECT_LT((dense(K) - dense(asked)).cwiseAbs().maxCoeff(), 1e-12 * K.coeffs().cwiseAbs().maxCoeff()) << name;
        State state = told.under(1.0, told.rest()), same = silent.under(1.0, silent.rest());
        const Vector change = 0.1 * Vector::Random(K.cols());
        state = told.moved(state, change);
        same = silent.moved(same, change);
        const Vector r = told.residual(state);
        EXPECT_LT((r - silent.residual(same)).cwiseAbs().maxCoeff(), 1e-12 * r.cwiseAbs().maxCoeff()) << name;
        EXPECT_NEAR(told.energy(state), silent.energy(same), 1e-12 * told.energy(state)) << name;
      }
}

/// Newton's method on equations that it does not know; E11 = e + e^2 / 2 of the stretch 1 + e, and no stress across.
TEST(Equilibrium, NewtonStretchesASaintVenantKirchhoffSheetAsInItsClosedForm) {
  const double lambda = 1.3, mu = 0.7, stretch = 0.3;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.1});
  const double E1 = stretch + 0.5 * stretch * stretch, E2 = -lambda / (lambda + 2.0 * mu) * E1;
  const double across = std::sqrt(1.0 + 2.0 * E2) - 1.0;
  for (const ApproximationOptions& options :
       {ApproximationOptions{.spacing = 0.3, .vanish_on = {"left", "bottom", "right"}},
        ApproximationOptions{
            .spacing = 0.3, .dilatation = Dilatation::averaged, .vanish_on = {"left", "bottom", "right"}},
        ApproximationOptions{.kind = BasisKind::p1}}) {
    const auto approximation = approximate(mesh, options);
    const Equilibrium<2> equations(
        approximation,
        {.material = SaintVenantKirchhoff(lambda, mu), .plane = Plane::strain, .essential = Essential::strong},
        stretched<2>(2.0 * stretch));
    Cholesky solver;
    SymmetricMatrix K;
    State state = equations.under(1.0, equations.rest());
    std::vector<double> left;
    for (int k = 0; k < 12 && (left.empty() || left.back() > 1e-12); ++k) {
      equations.tangent(state, K);
      if (k == 0) solver.analyse(K, equations.node_of_unknowns());
      solver.factorize(K);
      state = equations.moved(state, -solver.solve(equations.residual(state)));
      left.push_back(equations.residual(state).cwiseAbs().maxCoeff());
    }
    EXPECT_LE(left.back(), 1e-12) << ::testing::PrintToString(left);
    for (std::size_t k = 1; k < left.size(); ++k) {
      if (left[k - 1] > 0.1 || left[k] < 1e-12) continue;
      EXPECT_LT(left[k], 20.0 * left[k - 1] * left[k - 1]) << "quadratic convergence";
    }
    const Points<2> u = interpolate(approximation.shape, Points<2>(state.u.reshaped(2, approximation.nodes.cols())));
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const Vec<2> x = mesh.vertex(v);
      ASSERT_LT((u.col(v) - Vec<2>(stretch * x[0], across * x[1])).norm(), 1e-10);
    }
    const double energy = 2.0 * (0.5 * lambda * (E1 + E2) * (E1 + E2) + mu * (E1 * E1 + E2 * E2));
    EXPECT_NEAR(equations.energy(state), energy, 1e-10 * energy);
  }
}

TEST(Equilibrium, OneLinearStepIsRefusedWhereTheMaterialIsNotLinear) {
  const FineMesh<3> mesh(solids::box({1.0, 1.0, 1.0}, 0.3));
  const auto approximation = approximate<3>(mesh, {.spacing = 0.6});
  std::vector<DisplacementCondition<3>> conditions = stretched<3>(0.3);
  conditions.push_back(symmetry_plane<3>("front"));
  const auto solve = [&](SharedMaterial material) {
    return ElasticSolver<3>(approximation, {.material = std::move(material)}, conditions).solve({}).strain_energy;
  };
  EXPECT_THAT([&] { solve(SaintVenantKirchhoff(1.3, 0.7)); },
              ThrowsMessage<NumericalError>(HasSubstr("the materials are not linear")));
  const double energy = solve(LinearElastic(1.0, 0.3));
  EXPECT_NEAR(energy, 0.5 * 0.3 * 0.3, 1e-11);
  EXPECT_NEAR(solve(Silent(LinearElastic(1.0, 0.3))), energy, 1e-12);
}

TEST(Equilibrium, MaterialsRememberWhatIsCommittedAndNothingElse) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.25});
  const auto approximation = approximate(mesh, {.kind = BasisKind::p1});
  const Equilibrium<2> equations(approximation,
                                 {.material = Hardening(), .plane = Plane::strain, .essential = Essential::strong},
                                 stretched<2>(0.5));
  // Stretched along x alone: u = (factor x / 2, 0).
  const auto stretched_to = [&](double factor, State state) {
    Points<2> u = Points<2>::Zero(2, mesh.num_vertices());
    u.row(0) = 0.5 * factor * mesh.vertices().row(0);
    state.u = u.reshaped();
    state.factor = factor;
    return state;
  };
  const State rest = equations.rest();
  ASSERT_EQ(rest.history.size(), mesh.num_cells());
  const State far = stretched_to(1.0, rest);
  EXPECT_TRUE(far.history.isZero(0.0)) << "nothing is remembered before a commit";
  const State committed = equations.commit(far);
  EXPECT_LT((committed.history.array() - 0.5).abs().maxCoeff(), 1e-14);
  const double fresh = equations.energy(stretched_to(0.4, rest)),
               after = equations.energy(stretched_to(0.4, committed));
  EXPECT_NEAR(fresh, 1.2 * 0.2 * 0.2, 1e-13);
  EXPECT_NEAR(after, 1.5 * 0.2 * 0.2, 1e-13);
}

TEST(Equilibrium, TangentsAreSummedIntoTheSamePlaces) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  const auto approximation = approximate(mesh, {.spacing = 0.6, .dilatation = Dilatation::averaged});
  const Equilibrium<2> equations(approximation, {.material = SaintVenantKirchhoff(1.3, 0.7), .plane = Plane::strain},
                                 stretched<2>(0.1));
  SymmetricMatrix K;
  equations.tangent(equations.rest(), K);
  const double* values = K.valuePtr();
  const Index* rows = K.innerIndexPtr();
  const SymmetricMatrix first = K;
  State moved = equations.moved(equations.rest(), 0.1 * Vector::Random(K.cols()));
  equations.tangent(moved, K);
  EXPECT_GT((K.coeffs() - first.coeffs()).abs().maxCoeff(), 0.01);
  equations.tangent(equations.rest(), K);
  EXPECT_TRUE((K.coeffs() == first.coeffs()).all());
  EXPECT_EQ(K.valuePtr(), values);
  EXPECT_EQ(K.innerIndexPtr(), rows);
}

class StateFile : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(::testing::TempDir()) / (std::string("efree_state_") + test->name());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path folder_;
};

TEST_F(StateFile, IsReadAsItWasWrittenBitForBit) {
  const State state{Vector::Random(37), Vector::Random(11), 0.1, 0.03, 1.0 / 3.0};
  write_state(state, folder_ / "a.state");
  EXPECT_TRUE(read_state(folder_ / "a.state") == state);
  const State nothing{};
  write_state(nothing, folder_ / "a.state");
  EXPECT_TRUE(read_state(folder_ / "a.state") == nothing) << "written over the other";
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1) << "nothing else is left";
}

TEST_F(StateFile, DamagedOnesAreRefusedWithTheirName) {
  const auto file = folder_ / "a.state";
  const auto refused = [&](const std::string& why) {
    EXPECT_THAT([&] { read_state(file); },
                ThrowsMessage<InputError>(::testing::AllOf(HasSubstr("a.state"), HasSubstr(why))));
  };
  refused("cannot be read");
  write_state({Vector::Random(37), Vector::Random(11)}, file);
  std::filesystem::resize_file(file, 200);
  refused("damaged");
  std::fstream(file, std::ios::in | std::ios::out | std::ios::binary)
      .seekp(16)
      .write("\xff\xff\xff\xff\xff\xff\xff\x7f", 8);
  refused("damaged");
  std::ofstream(file) << "not a state at all, but longer than the head of one would be";
  refused("expected a state");
  EXPECT_THAT([&] { write_state({}, folder_ / "missing" / "a.state"); },
              ThrowsMessage<InputError>(HasSubstr("cannot be written")));
}

/// First Piola-Kirchhoff stress times the area before: a bar stretched by a half between walls that slide. S_xx =
/// (lambda + 2 mu) E_xx, E_xx = (1.5^2 - 1) / 2, P_xx = 1.5 S_xx.
TEST(Reactions, OfALargeStretchAreThoseOfItsMaterial) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.4});
  const auto elements = approximate<2>(mesh, {.kind = BasisKind::p1});
  DisplacementCondition<2> pulled = clamp<2>("right");
  pulled.components[0] = [](const Vec<2>&) { return 1.0; };
  const ElasticModel model{
      .material = SaintVenantKirchhoff(1.0, 1.0), .plane = Plane::strain, .essential = Essential::strong};
  const Equilibrium<2> equations(elements, model,
                                 {clamp<2>("left"), pulled, symmetry_plane<2>("bottom"), symmetry_plane<2>("top")});
  State state = equations.under(1.0, equations.rest());
  Points<2> u = Points<2>::Zero(2, elements.space.size());
  u.row(0) = 0.5 * elements.space.points().row(0);
  state.u = u.reshaped();
  ASSERT_LT(equations.residual(state).norm(), 1e-12);
  const auto reactions = equations.reactions(state);
  EXPECT_NEAR(reactions.at("right").force.x(), 1.5 * 3.0 * 0.625, 1e-12);
  EXPECT_NEAR(reactions.at("left").force.x(), -1.5 * 3.0 * 0.625, 1e-12);
  EXPECT_NEAR(reactions.at("top").force.y() + reactions.at("bottom").force.y(), 0.0, 1e-12);
  EXPECT_NEAR(reactions.at("right").moment[0] + reactions.at("left").moment[0] + reactions.at("top").moment[0] +
                  reactions.at("bottom").moment[0],
              0.0, 1e-12);
}

}  // namespace
}  // namespace efree
