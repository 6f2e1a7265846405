// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of clouds at the end of steps through time, and answers that are corrected.
#include "efree/analysis/analyse.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using ::testing::AllOf, ::testing::Contains, ::testing::HasSubstr, ::testing::Not, ::testing::StartsWith;

/// A quarter of a plate with a hole, pulled along x by what is prescribed on its right.
Settings<2> pulled(SharedMaterial material, double by, Plane plane = Plane::strain) {
  DisplacementCondition<2> right{"right", {}, {}};
  right.components[0] = [by](const Vec<2>&) { return by; };
  Settings<2> settings{
      .common = {.model = {.material = std::move(material), .plane = plane}, .approximation = {.spacing = 0.3}},
      .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), right},
      .probes = {{"crown", {0.0, 1.0}}},
      .reactions = {{"pull", "right"}},
      .time = TimeSettings<2>{.path = {.step = 0.25}}};
  return settings;
}
FineMesh<2> plate(double size) {
  return triangulate(shapes::quarter_plate_with_hole(1.0, 3.0, 0.5 * size), {.size = size});
}

/// The same by quadratic elements alone, all the way.
Result<2> by_elements(const FineMesh<2>& mesh, Settings<2> settings, Dilatation dilatation) {
  settings.common.approximation = {.kind = BasisKind::p2, .dilatation = dilatation};
  settings.common.model.essential = Essential::strong;
  return analyse(mesh, settings);
}

double crown(const Result<2>& result) {
  return result.probes.at(0).second.displacement[1];
}
double pull(const Result<2>& result) {
  return result.balance.reactions.at("right").force[0];
}

TEST(StepsEstimate, ALinearBodyInStepsHasTheErrorsOfOneThatIsSolvedAtOnce) {
  const FineMesh<2> mesh = plate(0.1);
  Settings<2> settings = pulled(LinearElastic(1.0, 0.3), 0.01);
  const Result<2> in_steps = analyse(mesh, settings);
  settings.time.reset();
  settings.correction.tolerance = 1e-5;  // what iterations leave is rough, and adds to what recovery sees
  const Result<2> at_once = analyse(mesh, settings);
  ASSERT_TRUE(in_steps.estimates && at_once.estimates);
  EXPECT_NEAR(in_steps.estimates->uncorrected, at_once.estimates->uncorrected, 0.02 * at_once.estimates->uncorrected);
  EXPECT_NEAR(in_steps.estimates->mesh, at_once.estimates->mesh, 0.05 * at_once.estimates->mesh);
  EXPECT_NEAR(crown(in_steps), crown(at_once), 1e-3 * std::abs(crown(at_once)));
  EXPECT_NEAR(pull(in_steps), pull(at_once), 1e-3 * pull(at_once));
}

TEST(StepsEstimate, ACorrectedRubberPlateIsThatOfItsElementsAndTheCloudIsOffByWhatIsSaid) {
  for (const auto& [plane, dilatation, nu, by] : {std::tuple{Plane::strain, Dilatation::pointwise, 0.3, 3.0},
                                                  {Plane::stress, Dilatation::pointwise, 0.45, 3.0},
                                                  {Plane::strain, Dilatation::averaged, 0.45, 3.0},
                                                  {Plane::strain, Dilatation::averaged, 0.49, 1.0},
                                                  {Plane::strain, Dilatation::averaged, 0.4999, 1.0},
                                                  {Plane::strain, Dilatation::averaged, 0.499999, 1.0}}) {
    SCOPED_TRACE(nu);
    const FineMesh<2> mesh = plate(nu > 0.45 ? 0.25 : 0.15);  // elements take ever smaller steps as nu grows
    Settings<2> settings = pulled(NeoHookean({.E = 1.0, .nu = nu}), by, plane);
    settings.common.approximation.dilatation = dilatation;
    const Result<2> corrected = analyse(mesh, settings), elements = by_elements(mesh, settings, averaged_if(nu > 0.49));
    ASSERT_TRUE(corrected.estimates && corrected.elements);
    EXPECT_NEAR(crown(corrected), crown(elements), 1e-6 * std::abs(crown(elements)));
    EXPECT_NEAR(pull(corrected), pull(elements), 1e-6 * pull(elements));
    EXPECT_LT(corrected.balance.error, 1e-8);
    EXPECT_EQ(corrected.estimates->cloud, 0.0);
    EXPECT_GT(corrected.estimates->uncorrected, 0.01);
    EXPECT_LT(corrected.estimates->uncorrected, 0.1);
    settings.corrected = false;
    const Result<2> alone = analyse(mesh, settings);
    ASSERT_TRUE(alone.estimates && alone.cloud_alone);
    EXPECT_FALSE(alone.elements);
    EXPECT_EQ(alone.estimates->cloud, alone.estimates->uncorrected);
    EXPECT_NEAR(alone.cloud_alone->reactions.at("pull"), std::abs(pull(alone) / pull(elements) - 1.0), 1e-5);
    const Vec<2> should = elements.probes.at(0).second.displacement;
    const double off = (alone.probes.at(0).second.displacement - should).norm() / should.norm();
    EXPECT_NEAR(alone.cloud_alone->probes.at("crown"), off, 1e-4);
    EXPECT_GT(off, 1e-3) << "the cloud alone is off";
  }
}

TEST(StepsEstimate, TheErrorOfACloudFallsWithItsSpacing) {
  const FineMesh<2> mesh = plate(0.06);
  std::vector<double> errors;
  for (const double spacing : {0.5, 0.25}) {
    Settings<2> settings = pulled(NeoHookean({.E = 1.0, .nu = 0.3}), 3.0);
    settings.common.approximation.spacing = spacing;
    errors.push_back(analyse(mesh, settings).estimates->uncorrected);
  }
  const double order = std::log2(errors[0] / errors[1]);
  EXPECT_GT(order, 0.7);
  EXPECT_LT(order, 1.6);
}

TEST(StepsEstimate, SolidsAreCorrectedToo) {
  struct Solid {
    double nu, by, size;  // from the motion of some clouds on coarser meshes, elements find no balance
  };
  for (const auto& [nu, by, size] : {Solid{0.3, 0.5, 0.15}, {0.4999, 0.1, 0.2}}) {
    const FineMesh<3> mesh(solids::box({1.0, 1.0, 1.0}, size));
    DisplacementCondition<3> bottom = clamp<3>("bottom"), top = clamp<3>("top");
    top.components[2] = [by = by](const Vec<3>&) { return by; };
    const Settings<3> settings{
        .common = {.model = {.material = NeoHookean({.E = 1.0, .nu = nu})}, .approximation = {.spacing = 0.4}},
        .supports = {bottom, top},
        .time = TimeSettings<3>{.path = {.step = 0.5}}};
    const Result<3> result = analyse(mesh, settings);
    ASSERT_TRUE(result.estimates) << nu;
    EXPECT_LT(result.balance.error, 1e-8);
    EXPECT_GT(result.estimates->uncorrected, 0.01);
    EXPECT_LT(result.estimates->uncorrected, 0.4);
  }
}

TEST(Instability, ModeOfAClampedColumnIsEulers) {
  const double length = 10.0, thickness = 0.5;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, length, thickness), {.size = 0.125});
  // Shortened by a share of 4 pi^2 / 12 (t / l)^2 it gives way sideways by 1 - cos(2 pi x / l) (Euler 1744).
  const double critical = length * std::numbers::pi * std::numbers::pi / 3.0 * std::pow(thickness / length, 2);
  DisplacementCondition<2> left{"left", {}, {}}, right{"right", {}, {}};
  left.components = {[](const Vec<2>&) { return 0.0; }, [](const Vec<2>&) { return 0.0; }};
  right.components = {[=](const Vec<2>&) { return -1.06 * critical; }, [](const Vec<2>&) { return 0.0; }};
  Settings<2> settings{.common = {.model = {.material = NeoHookean({.E = 1.0, .nu = 0.0}), .plane = Plane::strain},
                                  .approximation = {.spacing = 0.25}},
                       .supports = {left, right},
                       .time = TimeSettings<2>{.path = {.step = 0.1}}};
  const Result<2> result = analyse(mesh, settings);
  ASSERT_EQ(result.history.back().negative_pivots, 1) << "beyond Euler's load in one direction";
  ASSERT_GT(result.instability.size(), 0);
  EXPECT_THAT(result.warnings, Contains(HasSubstr("instability_mode")));
  EXPECT_FALSE(result.estimates);
  const FineSpace<2>& space = result.approximation.space;
  const double sign = result.instability.row(1).sum() > 0.0 ? 1.0 : -1.0;
  double worst = 0.0;
  for (Index dof = 0; dof < space.size(); ++dof) {
    const double x = space.points()(0, dof);
    const double euler = 0.5 * (1.0 - std::cos(2.0 * std::numbers::pi * x / length));
    worst = std::max(worst, std::abs(sign * result.instability(1, dof) - euler));
  }
  EXPECT_LT(worst, 0.02);
  EXPECT_EQ(result.history.front().negative_pivots, 0) << "stable before";
}

TEST(StepsEstimate, ABodyThatMovesAsAWholeHasNoErrorAndIsAnAnswer) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.2});
  DisplacementCondition<2> left{"left", {}, {}};
  left.components = {[](const Vec<2>&) { return 1.0; }, [](const Vec<2>&) { return 0.0; }};
  const Result<2> result = analyse(
      mesh, Settings<2>{.common = {.model = {.material = NeoHookean({.E = 1.0, .nu = 0.3}), .plane = Plane::strain},
                                   .approximation = {.spacing = 0.4}},
                        .supports = {left},
                        .time = TimeSettings<2>{.path = {.step = 0.5}}});
  EXPECT_EQ(result.refusal, "");
  EXPECT_FALSE(result.estimates);
  EXPECT_THAT(result.warnings, Not(Contains(HasSubstr("not estimated"))));
}

TEST(StepsEstimate, ElementsStayAtTheirSupportsAtThreeTimesTheLength) {
  const FineMesh<2> mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 2.0, 0.06), {.size = 0.06});
  DisplacementCondition<2> right{"right", {}, {}};
  right.components[0] = [](const Vec<2>&) { return 4.0; };
  const Result<2> result = analyse(
      mesh, Settings<2>{.common = {.model = {.material = NeoHookean({.E = 1.0, .nu = 0.3}), .plane = Plane::strain},
                                   .approximation = {.spacing = 0.25}},
                        .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), right},
                        .time = TimeSettings<2>{.path = {.step = 0.1}}});
  ASSERT_TRUE(result.estimates);
  EXPECT_NEAR(result.fields.displacement.row(0).maxCoeff(), 4.0, 1e-9);
  double off = 0.0;  // along the axes of symmetry
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (mesh.vertex(v)[0] == 0.0) off = std::max(off, std::abs(result.fields.displacement(0, v)));
    if (mesh.vertex(v)[1] == 0.0) off = std::max(off, std::abs(result.fields.displacement(1, v)));
  }
  EXPECT_LT(off, 1e-9);
}

TEST(StepsEstimate, SimpleShearIsExactAndStaysSo) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  Settings<2> settings{.common = {.model = {.material = NeoHookean({.mu = 1.0, .lambda = 1.0}), .plane = Plane::strain},
                                  .approximation = {.spacing = 0.3}},
                       .time = TimeSettings<2>{.path = {.step = 0.5}}};
  for (const char* side : {"left", "right", "top", "bottom"}) {
    DisplacementCondition<2> sheared{side, {}, {}};
    sheared.components = {[](const Vec<2>& x) { return x[1]; }, [](const Vec<2>&) { return 0.0; }};
    settings.supports.push_back(sheared);
  }
  const Result<2> result = analyse(mesh, settings);
  ASSERT_TRUE(result.cloud_alone);
  // P = mu (F - F^-T) at J = 1: the shear stress is mu times the shear.
  EXPECT_NEAR(result.balance.reactions.at("top").force[0], 1.0, 1e-9);
  EXPECT_LT(result.cloud_alone->reactions.at("top"), 1e-9);
}

/// The largest difference between the forces on a part on two ways through the same times, relative.
double off_on_the_way(const Result<2>& result, const Result<2>& reference, const std::string& part) {
  double off = 0.0, largest = 0.0;
  for (const auto& step : result.history)
    for (const auto& there : reference.history)
      if (step.time == there.time) {
        off = std::max(off, (step.reactions.at(part).force - there.reactions.at(part).force).norm());
        largest = std::max(largest, there.reactions.at(part).force.norm());
      }
  return off / largest;
}

TEST(StepsEstimate, PathsThatFlowAreOffByWhatACoarserCloudTells) {
  const FineMesh<2> mesh = plate(0.06);
  for (const double spacing : {0.5, 0.3}) {
    Settings<2> settings = pulled(J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = 0.01, .kinematic = 0.1}), 0.05);
    settings.common.approximation.spacing = spacing;
    const Result<2> result = analyse(mesh, settings);
    EXPECT_FALSE(result.estimates);
    ASSERT_TRUE(result.path_errors) << result.warnings.at(0);
    EXPECT_NEAR(result.path_errors->coarser, 1.5, 0.25);
    EXPECT_EQ(result.path_errors->until, 1.0);
    Settings<2> finer = settings;
    finer.common.approximation.spacing = 0.1;
    finer.estimated = false;
    for (const auto& step : result.history) finer.time->path.stops.push_back(step.time);
    const double off = off_on_the_way(result, analyse(mesh, finer), "right"),
                 said = result.path_errors->reactions.at("pull");
    EXPECT_GT(said, 0.5 * off);
    EXPECT_LT(said, 12.0 * off);
    EXPECT_GE(result.path_errors->largest().first, said);
  }
}

/// A block on a support, whose top is moved as `moved` says of the time; steps of that size, stops where it turns.
Settings<2> moved_block(const std::function<Vec<2>(double)>& moved, bool slides, double step,
                        std::vector<double> turns = {}) {
  Settings<2> settings = pulled(J2({.moduli = {.E = 200.0, .nu = 0.3}, .yield = 0.2, .kinematic = 20.0}), 0.0);
  settings.common.approximation.spacing = 0.25;
  settings.supports.clear();
  settings.probes.clear();
  settings.reactions = {{"top", "top"}};
  settings.time->path = {.step = step, .max_step = step, .stops = std::move(turns)};
  settings.time->acting = [=](double time) {
    DisplacementCondition<2> bottom{"bottom", {}, {}}, top{"top", {}, {}};
    for (int i = slides ? 1 : 0; i < 2; ++i) {
      bottom.components[i] = [](const Vec<2>&) { return 0.0; };
      top.components[i] = [value = moved(time)[i]](const Vec<2>&) { return value; };
    }
    Acting<2> acting{{bottom, top}, {}};
    if (slides) acting.supports.push_back(symmetry_plane<2>("left"));
    return acting;
  };
  return settings;
}

TEST(StepsEstimate, ErrorsByTheSizeOfStepsAreStatedWhereALoadTurns) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  const auto moved = [](double time) {
    return Vec<2>(0.01 * std::sin(5.0 * time), 0.01 * (1.0 - std::cos(5.0 * time)));
  };
  for (const double step : {0.125, 0.05, 0.02}) {
    const Result<2> result = analyse(mesh, moved_block(moved, false, step));
    ASSERT_TRUE(result.path_errors);
    Settings<2> finer = moved_block(moved, false, 0.001);
    finer.estimated = false;
    for (const auto& at : result.history) finer.time->path.stops.push_back(at.time);
    const double off = off_on_the_way(result, analyse(mesh, finer), "top"), said = result.path_errors->steps;
    EXPECT_GT(said, 0.6 * off) << "steps of " << step;
    EXPECT_LT(said, 2.0 * off) << "steps of " << step;
    EXPECT_GT(off, 0.1 * step) << "a case in which steps do not matter";
    EXPECT_GE(result.path_errors->reactions.at("top"), said * 0.9);
  }
}

TEST(StepsEstimate, WhatHappensInTheFirstOfFiveStepsIsInTheErrorByTheirSize) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  const auto moved = [](double time) { return Vec<2>(0.01 * std::sin(3.0 * time), -0.01); };  // at once
  const Result<2> result = analyse(mesh, moved_block(moved, false, 0.2));
  ASSERT_TRUE(result.path_errors);
  Settings<2> finer = moved_block(moved, false, 0.002);
  finer.estimated = false;
  for (const auto& at : result.history) finer.time->path.stops.push_back(at.time);
  const Result<2> truth = analyse(mesh, finer);
  const double off = off_on_the_way(result, truth, "top");
  EXPECT_GT(off, 0.02) << "a case in which steps do not matter";
  EXPECT_GT(result.path_errors->steps, 0.6 * off);
  EXPECT_LT(result.path_errors->steps, 2.5 * off);
  const double dissipated = std::abs(result.history.back().dissipated / truth.history.back().dissipated - 1.0);
  EXPECT_GT(result.path_errors->dissipated, 0.6 * dissipated);
}

TEST(StepsEstimate, ALoadThatTurnsWithinAStepIsWarnedOf) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.2});
  const auto warnings = [&](const std::function<Vec<2>(double)>& moved) {
    return analyse(mesh, moved_block(moved, false, 0.1)).warnings;
  };
  EXPECT_THAT(warnings([](double time) {
                const double angle = 20.0 * std::numbers::pi * time;
                return Vec<2>(0.01 * (1.0 - std::cos(angle)), 0.01 * std::sin(angle));
              }),
              Contains(AllOf(StartsWith("displacements, forces and stresses may be off by any amount"),
                             HasSubstr("\"top\" turns within a step, from time"))));
  const auto pulse = [](double time) { return 0.01 * std::exp(-std::pow((time - 0.245) / 0.015, 2)); };
  EXPECT_THAT(warnings([&](double time) { return Vec<2>(pulse(time), 0.003 * time + pulse(time + 0.02)); }),
              Contains(HasSubstr("from time 0.2")));
  EXPECT_THAT(warnings([](double time) { return Vec<2>(0.0, 0.01 * std::sin(3.0 * time)); }),
              Not(Contains(HasSubstr("turns within a step"))));
}

TEST(StepsEstimate, CyclesOfOneLoadAreFollowedByStepsThatAreLongerThanThem) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.2});
  const auto cycles = [](double time) { return Vec<2>(0.0, 0.01 * std::sin(20.0 * std::numbers::pi * time)); };
  const Result<2> result = analyse(mesh, moved_block(cycles, true, 0.1));
  EXPECT_THAT(result.warnings, Not(Contains(HasSubstr("turns within a step"))));
  const Result<2> truth = analyse(mesh, moved_block(cycles, true, 0.002));
  EXPECT_NEAR(result.history.back().dissipated, truth.history.back().dissipated,
              0.01 * truth.history.back().dissipated);
}

TEST(StepsEstimate, StepsThatEndWhereALoadTurnsBackAreExactInPlainCompression) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  const auto moved = [](double time) { return Vec<2>(0.0, 0.01 * (0.4 - std::abs(time - 0.4))); };
  const Result<2> result = analyse(mesh, moved_block(moved, true, 0.2, {0.4}));
  ASSERT_TRUE(result.path_errors);
  EXPECT_GT(result.history.back().dissipated, 0.0);
  EXPECT_LT(result.path_errors->steps, 0.02) << "a path with fewer steps has passed over the turn";
}

/// Root mean square of the differences of stresses over that of the stresses, at the middles of cells of both meshes.
double off_in_stresses(const Result<2>& result, const Result<2>& reference) {
  double off = 0.0, size = 0.0;
  for (Index c = 0; c < result.mesh->num_cells(); ++c) {
    const Vec<2> x = result.mesh->centroid(c);
    const auto stress = [&](const Result<2>& of) { return probe(of.approximation.space, of.fields, x).stress; };
    Voigt<2> weights(1.0, 1.0, 1.0, 2.0);
    off += result.mesh->volume(c) * weights.dot((stress(result) - stress(reference)).cwiseAbs2());
    size += result.mesh->volume(c) * weights.dot(stress(reference).cwiseAbs2());
  }
  return std::sqrt(off / size);
}

TEST(StepsEstimate, StressesOfAPathThatFlowsAreOffByWhatACoarserCloudTells) {
  const FineMesh<2> mesh = plate(0.06);
  Settings<2> settings = pulled(J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = 0.01, .kinematic = 0.1}), 0.05);
  const Result<2> result = analyse(mesh, settings);
  ASSERT_TRUE(result.path_errors && result.path_errors->stress);
  settings.common.approximation.spacing = 0.1;
  settings.estimated = false;
  const double off = off_in_stresses(result, analyse(mesh, settings)), said = *result.path_errors->stress;
  EXPECT_GT(said, 0.5 * off);
  EXPECT_LT(said, 3.0 * off);
}

TEST(StepsEstimate, APathByArcLengthHasTheErrorsOfItsCurve) {
  const FineMesh<2> mesh = plate(0.06);
  Settings<2> settings = pulled(J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = 0.01, .kinematic = 0.1}), 0.05);
  const Result<2> by_time = analyse(mesh, settings);
  settings.time->path.control = Control::arc_length;
  settings.time->path.step = 0.1;
  const Result<2> by_arc = analyse(mesh, settings);
  ASSERT_TRUE(by_time.path_errors && by_arc.path_errors);
  const double of_time = by_time.path_errors->reactions.at("pull"), of_arc = by_arc.path_errors->reactions.at("pull");
  EXPECT_GT(of_arc, 0.3 * of_time);
  EXPECT_LT(of_arc, 2.0 * of_time);
}

TEST(StepsEstimate, APathFartherOffThanBearableIsRefusedAndKeepsItsResults) {
  const FineMesh<2> mesh = plate(0.1);
  Settings<2> settings = pulled(J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = 0.01, .kinematic = 0.1}), 0.05);
  settings.largest_error = 0.01;
  const Result<2> refused = analyse(mesh, settings);
  EXPECT_THAT(refused.refusal, AllOf(HasSubstr("% off"), HasSubstr("analysis.largest_error = ")));
  EXPECT_EQ(refused.stopped, "");
  EXPECT_GT(refused.fields.displacement.size(), 0);
  settings.largest_error = 10.0;
  EXPECT_EQ(analyse(mesh, settings).refusal, "");
}

TEST(StepsEstimate, ABarThatHasFlowedAndIsUnloadedHasTheErrorsOfItsPath) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.15});
  const auto at = [](double time) {
    const double force = 2.0 * (1.0 - std::abs(2.0 * time - 1.0));
    return Acting<2>{.supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                     .loads = {.tractions = {pressure<2>("right", [force](const Vec<2>&) { return -force; })}}};
  };
  Settings<2> settings{
      .common = {.model = {.material = J2({.moduli = {.E = 1000.0, .nu = 0.3}, .yield = Hardening::linear(1.0, 50.0)}),
                           .plane = Plane::stress},
                 .approximation = {.spacing = 0.3}},
      .time = TimeSettings<2>{.path = {.step = 0.05, .stops = {0.5}}, .acting = at}};
  settings.supports = at(0.0).supports;
  const Result<2> result = analyse(mesh, settings);
  EXPECT_LT(result.history.back().stored, 1e-12 * result.history.back().dissipated);
  EXPECT_TRUE(result.path_errors);
}

TEST(StepsEstimate, ElementsThatFindNoBalanceAreWarnedOfWhereThePathHasItsErrors) {
  const Result<2> result = analyse(plate(0.25), pulled(NeoHookean({.E = 1.0, .nu = 0.4999}), 6.0));
  ASSERT_FALSE(result.estimates);
  ASSERT_TRUE(result.path_errors);
  EXPECT_THAT(result.warnings, Contains(HasSubstr("find no balance")));
}

TEST(StepsEstimate, ACoarserCloudThatStopsEarlierIsWarnedOf) {
  const FineMesh<2> mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 2.0, 0.15), {.size = 0.15});
  Settings<2> settings = pulled(
      J2({.moduli = {.E = 210e3, .nu = 0.3}, .yield = Hardening::linear(450.0, 129.24), .strain = Strain::finite}),
      0.8);
  settings.common.approximation.spacing = 0.25;
  settings.common.approximation.dilatation = Dilatation::pointwise;
  settings.time->path.max_step = 0.25;
  const Result<2> whole = analyse(mesh, settings);
  settings.time->path.max_steps = static_cast<int>(whole.history.size());
  const Result<2> result = analyse(mesh, settings);
  ASSERT_TRUE(whole.path_errors && result.path_errors);
  EXPECT_THAT(whole.warnings, Not(Contains(HasSubstr("beyond time"))));
  ASSERT_LT(result.path_errors->until, 1.0) << "the coarser one takes more steps";
  EXPECT_THAT(result.warnings, Contains(AllOf(StartsWith("displacements, forces and stresses beyond time"),
                                              HasSubstr("not estimated"))));
}

TEST(LoadCases, OfANearlyIncompressibleCloudAreOffAsEachAlone) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  Settings<2> settings{.common = {.model = {.material = LinearElastic(1.0, 0.4999), .plane = Plane::strain},
                                  .approximation = {.spacing = 0.3}},
                       .supports = {clamp<2>("left")}};
  const auto pulled_by = [](double force) {
    return Loads<2>{.tractions = {pressure<2>("right", [force](const Vec<2>& x) { return -force * x[1]; })}};
  };
  for (const double force : {1.0, -2.0}) settings.cases.push_back({force > 0.0 ? "pull" : "push", pulled_by(force)});
  const Result<2> together = analyse(mesh, settings);
  settings.cases.clear();
  settings.loads = pulled_by(1.0);
  const Result<2> alone = analyse(mesh, settings);
  ASSERT_TRUE(alone.estimates && together.estimates && together.more.at(0).estimates);
  EXPECT_NEAR(together.estimates->uncorrected, alone.estimates->uncorrected, 1e-6);
  EXPECT_NEAR(together.more[0].estimates->uncorrected, alone.estimates->uncorrected, 1e-6) << "the same, twice";
}

TEST(StepsEstimate, WhatCannotBeEstimatedIsSaid) {
  const FineMesh<2> mesh = plate(0.2);
  const auto warnings = [&](const Settings<2>& settings) {
    const Result<2> result = analyse(mesh, settings);
    EXPECT_FALSE(result.estimates || result.path_errors);
    return result.warnings;
  };
  const SharedMaterial metal = J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = 0.01, .kinematic = 0.1});
  Settings<2> settings = pulled(metal, 0.05);
  settings.common.approximation = {.kind = BasisKind::p2};
  EXPECT_THAT(warnings(settings), Contains(AllOf(StartsWith("displacements, forces and stresses may be off by any"),
                                                 HasSubstr("not estimated (there is no cloud"))));
  settings = pulled(NeoHookean({.E = 1.0, .nu = 0.3}), 0.5);
  settings.common.model.material = NeoHookean({.E = 1.0, .nu = 0.3});
  settings.estimated = false;
  EXPECT_THAT(warnings(settings), Contains(HasSubstr("not estimated")));
  settings.estimated = true;
  EXPECT_THAT(analyse(mesh, settings).warnings, Not(Contains(HasSubstr("not estimated"))));
}

}  // namespace
}  // namespace efree
