// SPDX-License-Identifier: GPL-3.0-or-later
/// Load paths that leave the size of their steps open.
#include "efree/analysis/analyse.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/j2.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

namespace efree {
namespace {

using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;

/// A unit square of hardening metal on a support, whose top is moved as `moved` says of the time.
template <class Moved> Settings<2> moved_square(const Moved& moved) {
  Settings<2> settings{
      .common = {.model = {.material = J2({.moduli = {.E = 200.0, .nu = 0.3}, .yield = Hardening::linear(0.2, 20.0)}),
                           .plane = Plane::strain}},
      .reactions = {{"top", "top"}},
      .time = TimeSettings<2>{}};
  settings.time->acting = [moved](double time) {
    DisplacementCondition<2> top{"top", {}, {}};
    for (int i = 0; i < 2; ++i) top.components[i] = [value = moved(time)[i]](const Vec<2>&) { return value; };
    return Acting<2>{{clamp<2>("bottom"), top}, {}};
  };
  return settings;
}
Vec<2> along_a_circle(double time) {
  return {0.01 * std::sin(5.0 * time), 0.01 * (1.0 - std::cos(5.0 * time))};
}
Vec<2> to_and_fro(double time) {
  return {0.0, 0.01 * std::sin(12.0 * std::numbers::pi * time)};
}

FineMesh<2> square(double size) {
  return triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = size});
}

/// A path on the same mesh and cloud with 1000 steps.
Result<2> with_small_steps(const FineMesh<2>& mesh, Settings<2> settings, const Result<2>& like) {
  settings.time->path.step = settings.time->path.max_step = 0.001;
  settings.estimated = false;
  for (const auto& step : like.history) settings.time->path.stops.push_back(step.time);
  return analyse(mesh, settings);
}
double off_in_force(const Result<2>& result, const Result<2>& truth) {
  double off = 0.0, largest = 0.0;
  for (const auto& step : result.history)
    for (const auto& there : truth.history) {
      largest = std::max(largest, there.reactions.at("top").force.norm());
      if (step.time == there.time)
        off = std::max(off, (step.reactions.at("top").force - there.reactions.at("top").force).norm());
    }
  return off / largest;
}

/// A path with steps left open whose loads are followed, on that mesh: within so much of what small steps dissipate.
Result<2> followed_path(const FineMesh<2>& mesh, const Settings<2>& settings, double off) {
  const Result<2> result = analyse(mesh, settings);
  EXPECT_THAT(result.warnings, Not(Contains(HasSubstr("turn"))));
  const double truth = with_small_steps(mesh, settings, result).history.back().dissipated;
  EXPECT_NEAR(result.history.back().dissipated, truth, off * truth);
  return result;
}

TEST(OpenSteps, AreSmallEnoughWhereALoadTurns) {
  const FineMesh<2> mesh = square(0.1);
  Settings<2> settings = moved_square(along_a_circle);
  settings.common.approximation.spacing = 0.2;
  const Result<2> result = analyse(mesh, settings);
  ASSERT_TRUE(result.path_errors);
  EXPECT_LT(result.path_errors->steps, 0.027);
  EXPECT_LT(result.history.size(), 100u) << "steps are smaller than they need to be";
  const double off = off_in_force(result, with_small_steps(mesh, settings, result));
  EXPECT_GT(result.path_errors->steps, 0.6 * off);
  EXPECT_LT(result.path_errors->steps, 2.0 * off);
  settings.time->path.max_step = 0.1;
  const Result<2> given = analyse(mesh, settings);
  EXPECT_LT(given.history.size(), 20u) << "steps that are given stay";
  EXPECT_GT(given.path_errors->steps, 0.05);
}

TEST(OpenSteps, FollowALoadThatTurnsWithinStepsByDefault) {
  const FineMesh<2> mesh = square(0.2);
  Settings<2> settings = moved_square(to_and_fro);
  settings.common.approximation.spacing = 0.4;
  followed_path(mesh, settings, 0.02);
}

TEST(OpenSteps, EndWhereALoadTurnsBackOrComesToRest) {
  const FineMesh<2> mesh = square(0.2);
  const auto turns_back = [](double time) { return Vec<2>(0.0, 0.01 * (0.5 - std::abs(time - 0.4371))); };
  const auto rests = [](double time) {  // and goes on sideways
    return Vec<2>(0.01 * std::max(0.0, time - 0.6123), 0.01 * std::min(time, 0.6123));
  };
  for (const auto& [moved, turn] :
       {std::pair<std::function<Vec<2>(double)>, double>(turns_back, 0.4371), {rests, 0.6123}}) {
    for (const double step : {0.0, 0.1}) {
      Settings<2> settings = moved_square(moved);
      settings.common.approximation.spacing = 0.4;
      settings.time->path.step = step;
      const Result<2> result = analyse(mesh, settings);
      const auto nearest = std::ranges::min_element(
          result.history, {}, [&](const HistoryStep<2>& there) { return std::abs(there.time - turn); });
      EXPECT_NEAR(nearest->time, turn, 1e-9);
      EXPECT_LT(result.history.size(), 20u) << "no other stops";
      const Result<2> truth = with_small_steps(mesh, settings, result);
      EXPECT_LT(off_in_force(result, truth), 0.03);
      EXPECT_LT(off_in_force(result, truth), 2.0 * result.path_errors->steps + 1e-3);
    }
  }
}

TEST(OpenSteps, ALoadThatIsNoNumberLaterLeavesTheStepsBefore) {
  const FineMesh<2> mesh = square(0.2);
  Settings<2> settings = moved_square([](double time) {
    if (time > 0.62) throw InputError("not a number");
    return Vec<2>(0.0, 0.01 * (0.3 - std::abs(time - 0.3)));
  });
  settings.common.approximation.spacing = 0.4;
  const Result<2> result = analyse(mesh, settings);
  EXPECT_EQ(result.stopped, "not a number");
  EXPECT_GT(result.history.back().time, 0.4);
  EXPECT_EQ(std::ranges::count_if(result.history, [](const auto& step) { return std::abs(step.time - 0.3) < 0.02; }), 1)
      << "one stop where it turns";
}

TEST(OpenSteps, FollowSmallCyclesOnALargeMean) {
  const FineMesh<2> mesh = square(0.3);
  Settings<2> settings = moved_square([](double time) {
    return Vec<2>(0.0, 0.1 * std::min(10.0 * time, 1.0) + 0.004 * std::sin(80.0 * std::numbers::pi * time));
  });
  settings.common.approximation.spacing = 0.5;
  followed_path(mesh, settings, 0.03);
}

TEST(OpenSteps, FollowLoadsWhereTheyAct) {
  const FineMesh<2> mesh = square(0.3);
  const auto cycles = [](double time) { return 0.005 * std::sin(80.0 * std::numbers::pi * time); };
  const auto dissipated = [&](const ScalarField<2>& beside, double by_time) {
    Settings<2> settings = moved_square([](double) { return Vec<2>(0.0, 0.0); });
    settings.common.approximation.spacing = 0.5;
    settings.time->acting = [=](double time) {
      DisplacementCondition<2> top{"top", {}, {}};
      top.components[0] = [](const Vec<2>&) { return 0.0; };
      top.components[1] = [=](const Vec<2>& x) { return cycles(time) * beside(x) + by_time * time * (1.0 - x[1]); };
      return Acting<2>{{clamp<2>("bottom"), top}, {}};
    };
    const Result<2> result = analyse(mesh, settings);
    EXPECT_THAT(result.warnings, Not(Contains(HasSubstr("turn"))));
    EXPECT_GT(result.history.size(), 79u);
    return result.history.back().dissipated;
  };
  const double plain = dissipated([](const Vec<2>&) { return 1.0; }, 0.0);
  const ScalarField<2> without_value_elsewhere = [](const Vec<2>& x) {
    if (x[1] < 0.5) throw InputError("no value there");
    return 1.0;
  };
  EXPECT_NEAR(dissipated(without_value_elsewhere, 0.0), plain, 1e-6 * plain);
  EXPECT_NEAR(dissipated([](const Vec<2>&) { return 1.0; }, 10.0), plain, 1e-6 * plain) << "large elsewhere";
}

TEST(OpenSteps, DoNotFollowWhatIsNothingBesideOtherLoads) {
  const FineMesh<2> mesh = square(0.3);
  Settings<2> settings =
      moved_square([](double time) { return Vec<2>(1e-12 * std::sin(200.0 * std::numbers::pi * time), 0.01 * time); });
  settings.common.approximation.spacing = 0.5;
  EXPECT_LT(analyse(mesh, settings).history.size(), 15u);
}

TEST(OpenSteps, ThatTakeAShortDetourEndOnIt) {
  const FineMesh<2> mesh = square(0.2);
  Settings<2> settings = moved_square([](double time) {
    return Vec<2>(0.003 * time, time < 0.013 ? 0.01 * std::sin(std::numbers::pi * time / 0.013) : 0.0);
  });
  settings.common.approximation.spacing = 0.4;
  const Result<2> result = analyse(mesh, settings);
  EXPECT_THAT(result.warnings, Not(Contains(HasSubstr("turn"))));
  EXPECT_LT(off_in_force(result, with_small_steps(mesh, settings, result)), 0.03);
}

TEST(OpenSteps, FollowATableOfKinks) {
  const FineMesh<2> mesh = square(0.3);
  Settings<2> settings = moved_square([](double time) {  // between -0.005 and 0.005, 40 pieces
    const double piece = std::floor(40.0 * time), share = 40.0 * time - piece;
    const auto value = [](double k) { return 0.005 * std::sin(1.7 * k * k); };
    return Vec<2>(0.0, (1.0 - share) * value(piece) + share * value(piece + 1.0));
  });
  settings.common.approximation.spacing = 0.5;
  EXPECT_LT(followed_path(mesh, settings, 0.02).history.size(), 60u);
}

TEST(OpenSteps, AreWarnedOfWhereLoadsTurnTooOften) {
  const FineMesh<2> mesh = square(0.3);
  Settings<2> settings = moved_square([](double time) {
    return Vec<2>(0.003 * time, 0.005 * std::exp(-std::pow((time - 0.7007) / 2e-3, 2)) * std::sin(1e5 * time));
  });
  settings.common.approximation.spacing = 0.5;
  EXPECT_THAT(analyse(mesh, settings).warnings, Contains(HasSubstr("turn")));
}

TEST(OpenSteps, EncloseAJumpBesideAnotherLoad) {
  const FineMesh<2> mesh = square(0.2);
  const auto jumps = [](double time) { return time > 0.33 ? 0.003 : 0.001 * time; };
  for (const bool beside : {false, true}) {
    Settings<2> settings = moved_square([&](double time) { return Vec<2>(beside ? 0.01 * time : 0.0, jumps(time)); });
    settings.common.approximation.spacing = 0.4;
    const Result<2> result = analyse(mesh, settings);
    EXPECT_LT(result.history.size(), 25u) << "no steps are small enough";
    EXPECT_THAT(result.warnings, Not(Contains(HasSubstr("turn"))));
    const Result<2> truth = with_small_steps(mesh, settings, result);
    EXPECT_LT(off_in_force(result, truth), 0.03);
  }
}

TEST(OpenSteps, ARunThatWasKilledGoesOnWithThemBitForBit) {
  const MeshSource<2> source{.mesh = [](const MeshSize& size, const Stage&) {
    const double edge = size.length > 0.0 ? size.length : size.coarsening * 0.3;
    const FineMesh<2> mesh = square(edge);
    return MadeMesh<2>{.mesh = extract(mesh, std::vector<char>(mesh.num_cells(), 1)), .size = edge};
  }};
  Settings<2> settings = moved_square(along_a_circle);
  std::vector<Checkpoint<2>> all;
  settings.steps.done = [&](const Checkpoint<2>& there, const Result<2>&) { all.push_back(there); };
  const Result<2> whole = analyse(source, settings);
  const auto smaller = std::ranges::find_if(all, [](const Checkpoint<2>& there) { return there.scale < 1.0; });
  ASSERT_NE(smaller, all.begin());
  ASSERT_NE(smaller, all.end());
  EXPECT_EQ(all.back().at.steps, static_cast<int>(whole.history.size()));
  EXPECT_LT(whole.path_errors->largest().first, 0.05);
  const auto first_smaller = static_cast<std::size_t>(smaller - all.begin());
  for (const std::size_t k : {first_smaller / 2, first_smaller + 3, all.size() - 2}) {
    SCOPED_TRACE(k);
    settings.steps.from = all[k];
    settings.steps.done = {};
    const Result<2> resumed = analyse(source, settings);
    EXPECT_EQ(resumed.history.size(), whole.history.size());
    EXPECT_EQ(resumed.fields.displacement, whole.fields.displacement);
    EXPECT_EQ(resumed.path_errors->steps, whole.path_errors->steps);
  }
}

}  // namespace
}  // namespace efree
