// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elasticity as long as it is enough (Regime::automatic).
#include "efree/analysis/analyse.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;

const ElasticModuli moduli{.E = 1.0, .nu = 0.3};

FineMesh<2> plate() {
  return triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, 0.2), {.size = 0.4});
}
/// A quarter of a plate with a hole, pulled along x.
Settings<2> pulled(SharedMaterial material, double tension_, Plane plane = Plane::stress) {
  return {.common = {.model = {.material = std::move(material), .plane = plane}},
          .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          .loads = {.tractions = {tension<2>("right", tension_)}, .body_force = {}},
          .probes = {{"top of the hole", {0.0, 1.0}}}};
}
Settings<2> in(Regime regime, Settings<2> settings) {
  settings.regime = regime;
  return settings;
}
Settings<2> through_time(Settings<2> settings) {
  settings.time.emplace();
  settings.time->path.step = settings.time->path.max_step = 0.125;
  return settings;
}
/// Held at its left end and bent by a traction on its right one; in a time of one step.
Settings<2> cantilever(SharedMaterial material, Vec<2> traction) {
  return {.common = {.model = {.material = std::move(material), .plane = Plane::stress}},
          .supports = {clamp<2>("left")},
          .loads = {.tractions = {{"right", [traction](const Vec<2>&, const Vec<2>&) { return traction; }}},
                    .body_force = {}},
          .probes = {{"tip", {20.0, 0.5}}}};
}
FineMesh<2> beam() {
  return triangulate(shapes::rectangle(0.0, 0.0, 20.0, 1.0), {.size = 0.5});
}

double apart(const Points<2>& u, const Points<2>& v) {
  return (u - v).colwise().norm().maxCoeff() / v.colwise().norm().maxCoeff();
}
/// Histories of two runs, by step: times, energies, reactions and probes.
void expect_same_path(const Result<2>& found, const Result<2>& expected) {
  ASSERT_EQ(found.history.size(), expected.history.size());
  for (std::size_t k = 0; k < found.history.size(); ++k) {
    const auto &a = found.history[k], &b = expected.history[k];
    EXPECT_EQ(a.time, b.time);
    EXPECT_NEAR(a.stored, b.stored, 1e-8 * b.stored) << b.time;
    EXPECT_NEAR(a.dissipated, b.dissipated, 1e-8 * b.stored) << b.time;
    EXPECT_LT((a.probes[0] - b.probes[0]).norm(), 1e-8 * b.probes[0].norm()) << b.time;
    double forces = 0.0;
    for (const auto& [part, of] : b.reactions) forces += of.force.norm();
    for (const auto& [part, of] : b.reactions)
      EXPECT_LT((a.reactions.at(part).force - of.force).norm(), 1e-8 * forces) << b.time;
  }
  EXPECT_LT(apart(found.fields.displacement, expected.fields.displacement), 1e-8);
  const double scale = expected.fields.stress.cwiseAbs().maxCoeff();
  EXPECT_LT((found.fields.stress - expected.fields.stress).cwiseAbs().maxCoeff(), 1e-8 * scale);
}

void expect_same_bits(const Result<2>& found, const Result<2>& expected) {
  EXPECT_EQ(found.regime, expected.regime);
  EXPECT_EQ(found.linear_checks, expected.linear_checks);
  EXPECT_EQ(found.stopped, expected.stopped);
  ASSERT_EQ(found.history.size(), expected.history.size());
  for (std::size_t k = 0; k < found.history.size(); ++k) {
    const auto &a = found.history[k], &b = expected.history[k];
    EXPECT_EQ(a.time, b.time);
    EXPECT_EQ(a.iterations, b.iterations);
    EXPECT_EQ(a.stored, b.stored);
    EXPECT_EQ(a.dissipated, b.dissipated);
    EXPECT_EQ(a.probes, b.probes);
  }
  EXPECT_EQ(found.fields.displacement, expected.fields.displacement);
  EXPECT_EQ(found.fields.stress, expected.fields.stress);
}

TEST(Model, AMetalBelowYieldIsTheLinearCaseWithAllThatThatHas) {
  const auto mesh = plate();
  const Result<2> automatic = analyse(mesh, pulled(J2({.moduli = moduli, .yield = 0.004}), 0.001));
  EXPECT_EQ(automatic.regime, Regime::linear);
  ASSERT_EQ(automatic.linear_checks.size(), 1u);
  EXPECT_TRUE(automatic.linear_checks[0].same);
  EXPECT_TRUE(automatic.history.empty());
  ASSERT_TRUE(automatic.estimates);
  const Result<2> linear = analyse(mesh, pulled(LinearElastic(moduli), 0.001));
  EXPECT_TRUE(linear.linear_checks.empty()) << "linear materials are not asked whether they are linear";
  EXPECT_LT(apart(automatic.fields.displacement, linear.fields.displacement), 1e-12);
  EXPECT_NEAR(automatic.estimates->total(), linear.estimates->total(), 1e-9);
  const Result<2> told = analyse(mesh, in(Regime::linear, pulled(J2({.moduli = moduli, .yield = 0.004}), 0.001)));
  EXPECT_EQ(automatic.fields.displacement, told.fields.displacement);
  EXPECT_EQ(automatic.fields.stress, told.fields.stress);
}

TEST(Model, AMetalThatYieldsIsTheFullModel) {
  const auto mesh = plate();
  for (const Plane plane : {Plane::stress, Plane::strain}) {
    const Settings<2> settings = pulled(J2({.moduli = moduli, .yield = Hardening::linear(0.002, 0.1)}), 0.001, plane);
    const Result<2> automatic = analyse(mesh, settings), full = analyse(mesh, in(Regime::finite, settings));
    EXPECT_EQ(automatic.regime, Regime::finite);
    ASSERT_EQ(automatic.linear_checks.size(), 1u);
    EXPECT_GT(automatic.linear_checks[0].overload, 1.2);
    EXPECT_LT(automatic.linear_checks[0].overload, 1.75) << "no more than 3.2 times the tension";
    EXPECT_GT(full.history.back().dissipated, 0.0);
    expect_same_path(automatic, full);
  }
}

TEST(Model, AlongAPathTheFullModelGoesOnWhereBothAgreedLast) {
  const auto mesh = plate();
  const Settings<2> settings =
      through_time(pulled(J2({.moduli = moduli, .yield = Hardening::linear(0.002, 0.1)}), 0.001, Plane::strain));
  const Result<2> automatic = analyse(mesh, settings), full = analyse(mesh, in(Regime::finite, settings));
  EXPECT_EQ(automatic.regime, Regime::finite);
  ASSERT_GT(automatic.linear_checks.size(), 2u) << "some steps are elastic";
  EXPECT_TRUE(automatic.linear_checks[1].same);
  EXPECT_FALSE(automatic.linear_checks.back().enough);
  expect_same_path(automatic, full);
  // Where nothing flows all of it is linear.
  const Result<2> elastic = analyse(mesh, through_time(pulled(J2({.moduli = moduli, .yield = 0.1}), 0.001)));
  EXPECT_EQ(elastic.regime, Regime::linear);
  EXPECT_EQ(elastic.linear_checks.size(), 8u);
  EXPECT_EQ(elastic.history.size(), 8u);
}

TEST(Model, FiniteStrainsMakeThePathTheFullModelsFromItsBeginning) {
  const auto mesh = plate();
  const Settings<2> settings = through_time(pulled(NeoHookean(moduli), 0.02, Plane::strain));
  const Result<2> automatic = analyse(mesh, settings), full = analyse(mesh, in(Regime::finite, settings));
  EXPECT_EQ(automatic.regime, Regime::finite);
  expect_same_path(automatic, full);
}

TEST(Model, WhoGoesOnFromAnyStepComesToTheSameEndBitForBit) {
  const auto mesh = plate();
  const Hardening yield = Hardening::linear(0.002, 0.1);
  Settings<2> stops = through_time(pulled(J2({.moduli = moduli, .yield = yield}), 0.001));
  stops.time->path.max_steps = 6;
  for (Settings<2> settings : {through_time(pulled(J2({.moduli = moduli, .yield = yield}), 0.001, Plane::strain)),
                               through_time(pulled(NeoHookean(moduli), 0.02)),
                               through_time(pulled(J2({.moduli = moduli, .yield = 0.1}), 0.001)), stops}) {
    std::vector<Checkpoint<2>> told;
    settings.steps.done = [&](const Checkpoint<2>& there, const Result<2>&) { told.push_back(there); };
    const Result<2> whole = analyse(mesh, settings);
    EXPECT_TRUE(told.front().agreed) << "begins by linear elasticity";
    EXPECT_EQ(told.back().agreed.has_value(), whole.regime == Regime::linear);
    settings.steps.done = {};
    for (const auto& there : told) {
      settings.steps.from = there;
      expect_same_bits(analyse(mesh, settings), whole);
    }
  }
}

TEST(Model, ByArcLengthTheFullModelGoesOnFromStepsOfTheLinearOne) {
  const auto mesh = plate();
  Settings<2> settings = through_time(pulled(NeoHookean(moduli), 0.02));
  std::vector<Checkpoint<2>> told;
  settings.steps.done = [&](const Checkpoint<2>& there, const Result<2>&) { told.push_back(there); };
  const Result<2> whole = analyse(mesh, settings);
  settings.steps = {.from = told.front()};
  settings.time->path.control = Control::arc_length;
  const Result<2> by_arc = analyse(mesh, settings);
  EXPECT_EQ(by_arc.regime, Regime::finite);
  EXPECT_EQ(by_arc.history.back().time, 1.0);
  EXPECT_LT(apart(by_arc.fields.displacement, whole.fields.displacement), 1e-8);
  settings.steps.from->agreed->u.resize(2);
  EXPECT_THROW(analyse(mesh, settings), InputError);
}

TEST(Model, LinearMaterialsThroughTimeAreLinear) {
  const Result<2> result = analyse(plate(), through_time(pulled(LinearElastic(moduli), 0.001)));
  EXPECT_EQ(result.regime, Regime::linear);
  EXPECT_TRUE(result.linear_checks.empty());
  EXPECT_EQ(result.history.size(), 8u);
}

TEST(Model, TheErrorThatIsSaidIsTheOneThatIsMade) {
  const auto mesh = plate();
  for (const double traction : {1e-4, 1e-3}) {
    Settings<2> settings = through_time(pulled(NeoHookean(moduli), traction, Plane::strain));
    settings.time->path.step = settings.time->path.max_step = 1.0;
    settings.estimated = settings.corrected = false;  // the cloud's own answers
    settings.regime_tolerance = 1.0;
    const Result<2> linear = analyse(mesh, settings), full = analyse(mesh, in(Regime::finite, settings));
    ASSERT_EQ(linear.regime, Regime::linear);
    const LinearCheck& check = linear.linear_checks.back();
    const double error = apart(linear.fields.displacement, full.fields.displacement);
    EXPECT_NEAR(check.displacement, error, 0.03 * error);
    const VoigtPoints<2> difference = linear.solution.stress - full.solution.stress;
    const auto norm = [](const VoigtPoints<2>& s) {
      return (s.topRows<3>().colwise().squaredNorm() + 2.0 * s.row(3).cwiseAbs2()).cwiseSqrt().maxCoeff();
    };
    EXPECT_NEAR(check.stress, norm(difference) / norm(linear.solution.stress), 0.03 * check.stress);
    EXPECT_GT(check.strain, 2.0 * traction);
    settings.regime_tolerance = 1.1 * check.stress;
    EXPECT_EQ(analyse(mesh, settings).regime, Regime::linear);
    settings.regime_tolerance = 0.9 * check.stress;
    EXPECT_EQ(analyse(mesh, settings).regime, Regime::finite);
  }
}

TEST(Model, EvenStretchIsInBalanceAndYetNotLinear) {
  // No Poisson's ratio: nothing moves across, and every material keeps the straight lines of the linear one.
  Settings<2> settings{
      .common = {.model = {.material = StVenantKirchhoff({.E = 1.0, .nu = 0.0}), .plane = Plane::strain}},
      .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
      .probes = {{"end", {20.0, 1.0}}}};
  settings.supports.push_back({"right", {}, [](const Vec<2>&) { return -2.0; }});
  const auto mesh = beam();
  for (const bool in_time : {false, true}) {
    if (in_time) settings = through_time(settings);
    const Result<2> automatic = analyse(mesh, settings);
    EXPECT_EQ(automatic.regime, Regime::finite);
    EXPECT_FALSE(automatic.linear_checks.back().same);
    // First Piola-Kirchhoff stress (1 - 0.1) * ((1 - 0.1)^2 - 1) / 2, where linear elasticity has -0.1.
    EXPECT_NEAR(automatic.balance.reactions.at("left").force.x(), 0.0855, 1e-9);
    expect_same_path(automatic, analyse(mesh, in(Regime::finite, settings)));
  }
}

TEST(Model, ASlenderBeamTurnsAndIsNotLinear) {
  const auto mesh = beam();
  const Settings<2> settings = cantilever(LinearElastic(moduli), {0.0, 2e-5});
  const Result<2> automatic = analyse(mesh, in(Regime::automatic, settings));
  EXPECT_EQ(automatic.regime, Regime::finite);
  EXPECT_GT(automatic.linear_checks[0].rotation, 0.04);
  EXPECT_LT(automatic.linear_checks[0].strain, 0.004) << "strains alone would not say so";
  const Result<2> full = analyse(mesh, in(Regime::finite, settings));
  expect_same_path(automatic, full);
  EXPECT_LT(full.probes[0].second.displacement.x(), -0.01) << "the tip comes back, which linear elasticity has not";
  const Result<2> kirchhoff = analyse(mesh, in(Regime::finite, cantilever(StVenantKirchhoff(moduli), {0.0, 2e-5})));
  EXPECT_LT(apart(full.fields.displacement, kirchhoff.fields.displacement), 1e-8);
  const Result<2> little = analyse(mesh, in(Regime::automatic, cantilever(LinearElastic(moduli), {0.0, 1e-7})));
  EXPECT_EQ(little.regime, Regime::linear);
  EXPECT_TRUE(little.estimates);
  EXPECT_EQ(analyse(mesh, settings).regime, Regime::linear) << "nobody asked: linear materials are";
}

TEST(Model, AColumnThatBucklesIsNotLinearThoughItsStrainsAreSmall) {
  const auto mesh = beam();
  const double euler = M_PI * M_PI / (48.0 * 400.0);  // stress of Euler's load, clamped at one end
  const auto check = [&](double share) {
    Settings<2> settings = in(Regime::automatic, cantilever(LinearElastic(moduli), {-share * euler, 0.0}));
    settings.common.approximation.kind = BasisKind::p2;
    settings.time.emplace();
    settings.time->path.step = settings.time->path.max_step = 1.0;
    return analyse(mesh, settings).linear_checks.at(0);
  };
  EXPECT_EQ(check(0.95).negative_pivots, 0);
  EXPECT_TRUE(check(0.95).enough);
  EXPECT_EQ(check(1.05).negative_pivots, 1);
  EXPECT_FALSE(check(1.05).enough);
  EXPECT_THAT(text_of(check(1.05)), HasSubstr("not positive definite"));
}

TEST(Model, StressesThatOnlyTheCorrectedAnswerHasAreWarnedOf) {
  const auto mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, 0.05), {.size = 0.1});
  Settings<2> settings = pulled(J2({.moduli = moduli, .yield = 1.0}), 0.001);
  settings.common.approximation.spacing = 1.5;
  const Result<2> free = analyse(mesh, settings);
  ASSERT_EQ(free.regime, Regime::linear);
  EXPECT_THAT(free.warnings, Not(Contains(HasSubstr("what the material bears"))));
  double largest = 0.0;
  for (const auto& stress : free.solution.stress.colwise()) largest = std::max(largest, von_mises<2>(stress));
  settings.common.model.material = J2({.moduli = moduli, .yield = 0.97 * largest});
  const Result<2> over = analyse(mesh, settings);
  ASSERT_EQ(over.regime, Regime::linear) << "the cloud sees less";
  EXPECT_THAT(over.warnings, Contains(HasSubstr("what the material bears")));
}

TEST(Model, WhatCannotBeIsRefused) {
  const auto mesh = plate();
  const auto refused = [&](const auto& change) {
    Settings<2> settings = pulled(NeoHookean(moduli), 1e-4);
    change(settings);
    try {
      analyse(mesh, settings);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_THAT(refused([](auto& s) { s.accuracy = 0.01; }), HasSubstr("analysis.model = \"linear\""));
  EXPECT_THAT(refused([](auto& s) { s.cases.push_back({"a", {}}); }), HasSubstr("analysis.model = \"linear\""));
  EXPECT_THAT(refused([](auto& s) { s.regime_tolerance = 0.0; }), HasSubstr("regime_tolerance"));
  EXPECT_EQ(refused([](auto& s) {
              s.regime = Regime::linear;
              s.cases.push_back({"a", {}});
            }),
            "no error");
}

}  // namespace
}  // namespace efree
