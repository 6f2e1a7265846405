// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/rigid_map.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <random>
#include <type_traits>

namespace efree {
namespace {

constexpr int lanes = 4;
constexpr Index num_places = 700, num_others = 11;

/// Places at random, each with three of the others, by shares that sum to one.
template <int Dim> RigidMap<Dim> map_at_random(std::mt19937& random) {
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  const auto draw = [&] { return number(random); };
  RigidMap<Dim> map{.rows = {},
                    .places = Points<Dim>::NullaryExpr(Dim, num_places, draw),
                    .others = Points<Dim>::NullaryExpr(Dim, num_others, draw)};
  for (Index row = 0; row < num_places; ++row) {
    const double first = draw(), second = draw();
    map.rows.items.push_back({row % num_others, first});
    map.rows.items.push_back({(row + 2) % num_others, second});
    map.rows.items.push_back({(row + 5) % num_others, 1.0 - first - second});
    map.rows.close_row();
  }
  return map;
}

template <class T> class RigidMapOf : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(RigidMapOf, Dimensions);

TYPED_TEST(RigidMapOf, CarriesRigidMotionsOver) {
  constexpr int Dim = TypeParam::value;
  std::mt19937 random(1);
  const auto map = map_at_random<Dim>(random);
  // By lane, a rotation about the origin and a translation.
  const auto turn = [](int lane, int d) { return Dim == 2 && d > 0 ? 0.0 : 0.3 + lane - 0.7 * d; };
  const auto motion = [&](const auto& x, int lane, int d) {
    if constexpr (Dim == 2) {
      return (d == 0 ? -x[1] : x[0]) * turn(lane, 0) + 0.1 * d + lane;
    } else {
      const int e = (d + 1) % 3, f = (d + 2) % 3;
      return turn(lane, e) * x[f] - turn(lane, f) * x[e] + 0.1 * d + lane;
    }
  };
  LanesPair others{Lanes(Dim * lanes * num_others), Lanes(Dim * lanes * num_others)};
  for (Index i = 0; i < num_others; ++i)
    for (int d = 0; d < Dim; ++d)
      for (int lane = 0; lane < lanes; ++lane) {
        others.moves[lanes * (Dim * i + d) + lane] = motion(Vec<Dim>(map.others.col(i)), lane, d);
        others.turns[lanes * (Dim * i + d) + lane] = turn(lane, d);
      }
  const LanesPair moved = follow(map, lanes, others, true);
  double off = 0.0;
  for (Index row = 0; row < num_places; ++row)
    for (int d = 0; d < Dim; ++d)
      for (int lane = 0; lane < lanes; ++lane) {
        const std::size_t at = lanes * (Dim * row + d) + lane;
        off = std::max(off, std::abs(moved.moves[at] - motion(Vec<Dim>(map.places.col(row)), lane, d)));
        off = std::max(off, std::abs(moved.turns[at] - turn(lane, d)));
      }
  EXPECT_LT(off, 1e-13);
}

TYPED_TEST(RigidMapOf, GathersForcesThatDoTheSameWork) {
  constexpr int Dim = TypeParam::value;
  std::mt19937 random(2);
  const auto map = map_at_random<Dim>(random);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  const auto vectors = [&](Index count, bool turning) {
    LanesPair pair{Lanes(Dim * lanes * count), Lanes(turning ? Dim * lanes * count : 0)};
    std::ranges::generate(pair.moves, [&] { return number(random); });
    for (std::size_t i = 0; i < pair.turns.size(); ++i)  // in the plane about one axis
      pair.turns[i] = Dim == 2 && i / lanes % Dim > 0 ? 0.0 : number(random);
    return pair;
  };
  const auto work = [](const LanesPair& a, const LanesPair& b, int lane) {
    double sum = 0.0;
    for (std::size_t i = lane; i < a.moves.size(); i += lanes) sum += a.moves[i] * b.moves[i];
    for (std::size_t i = lane; i < std::min(a.turns.size(), b.turns.size()); i += lanes) sum += a.turns[i] * b.turns[i];
    return sum;
  };
  for (const bool turning : {false, true})
    for (const bool moments : {false, true}) {
      if (moments && !turning) continue;
      const LanesPair others = vectors(num_others, turning), forces = vectors(num_places, moments);
      const LanesPair moved = follow(map, lanes, others, moments);
      const LanesPair gathered = gather(map.mirrored(), lanes, forces, turning);
      for (int lane = 0; lane < lanes; ++lane)
        EXPECT_NEAR(work(others, gathered, lane), work(moved, forces, lane), 1e-11) << turning << moments;
    }
}

}  // namespace
}  // namespace efree
