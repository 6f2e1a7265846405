// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/surface_load.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <gtest/gtest.h>
#include <numbers>

namespace efree {
namespace {

FineMesh<2> bar(double from, double to, double spacing) {
  return triangulate(shapes::rectangle(from, 0.0, to, 0.1), {.size = spacing});
}
DeformableBody<2> body_of(const FineMesh<2>& mesh, double E) {
  return deformable_body(mesh, NeoHookean({.E = E, .nu = 0.0}), 1.0);
}

TEST(TiedBodies, AWaveCrossesAnInterfaceAsImpedancesSay) {
  constexpr double h = 0.025, p = 1e-4;
  const auto left = bar(0.0, 2.0, h), right = bar(2.0, 5.0, h);
  Dynamics<2> dynamics({body_of(left, 1.0), body_of(right, 4.0)}, otm<2>(), {.tied = true});
  const Index N = dynamics.num_nodes();
  SurfacePart<2> end{.facets = left.facets()(Eigen::all, left.group("left")),
                     .functions = SparseRows(left.num_vertices(), N)};
  for (Index a = 0; a < left.num_vertices(); ++a) end.functions.insert(a, a) = 1.0;
  dynamics.add_interaction(surface_load<2>({.part = end, .traction = [](const Vec<2>&, double t) {
                                              return Vec<2>(
                                                  t < 1.0 ? p * std::pow(std::sin(std::numbers::pi * t), 2) : 0.0, 0.0);
                                            }}));
  dynamics.run(3.25);
  // Of velocities, with impedances of 1 and 2 (Achenbach 1973, section 1.4).
  double through = 0.0, back = 0.0, across = 0.0;
  for (Index a = 0; a < N; ++a) {
    const Vec<2> v = dynamics.velocities().col(a);
    if (dynamics.nodes()(0, a) > 2.2)
      through = std::max(through, v[0]);
    else if (dynamics.nodes()(0, a) < 1.8)
      back = std::min(back, v[0]);
    across = std::max(across, std::abs(v[1]));
  }
  EXPECT_NEAR(through, p * 2.0 / 3.0, 0.01 * p);
  EXPECT_NEAR(back, -p / 3.0, 0.01 * p);
  EXPECT_LT(across, 0.01 * p);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-3);
}

/// Material points of both share the grid: the same wave, and momenta as those of one body.
TEST(TiedBodies, AWaveCrossesAnInterfaceOfMaterialPointsAsImpedancesSay) {
  constexpr double p = 1e-4;
  for (const MpmFrame frame : {MpmFrame::updated, MpmFrame::mesh}) {
    MpmOptions options{.cell = 0.05, .ties = {{0, 1}}};
    const double edge = frame == MpmFrame::mesh ? 0.025 : 0.05;
    const auto left = bar(0.0, 2.0, edge), right = bar(2.0, 5.0, edge);
    const auto body = [&](const FineMesh<2>& mesh, double E) {
      return body_on_lattice(mesh, frame, options, 2, body_of(mesh, E).material, 1.0);
    };
    const DeformableBody<2> first = body(left, 1.0);
    Dynamics<2> dynamics({first, body(right, 4.0)}, mpm<2>(options));
    dynamics.add_interaction(
        surface_load<2>({.part = surface_on_lattice(left, left.group("left"), frame, options, first),
                         .traction = [](const Vec<2>&, double t) {
                           return Vec<2>(t < 1.0 ? p * std::pow(std::sin(std::numbers::pi * t), 2) : 0.0, 0.0);
                         }}));
    dynamics.run(3.25);
    double through = 0.0, back = 0.0;
    for (Index k = 0; k < dynamics.num_points(); ++k) {
      const Vec<2> v = dynamics.point_velocities().col(k);
      const double x = dynamics.points()(0, k);
      if (x > 2.2)
        through = std::max(through, v[0]);
      else if (x < 1.8)
        back = std::min(back, v[0]);
    }
    EXPECT_NEAR(through, p * 2.0 / 3.0, 0.02 * p);
    EXPECT_NEAR(back, -p / 3.0, 0.02 * p);
    EXPECT_EQ(dynamics.balance()["contact"], 0.0);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-2);
  }
}

/// Two halves of a bar that fly apart, and a third one ahead that leaves.
TEST(TiedBodies, OfMaterialPointsStayTogetherWhereOthersPart) {
  const auto run = [](bool tied, int threads, bool resumed) {
    MpmOptions options{.cell = 0.05};
    if (tied) options.ties = {{1, 0}};
    std::vector<DeformableBody<2>> bodies;
    for (const auto& [from, speed] : {std::pair(0.0, -0.05), std::pair(1.0, 0.05), std::pair(2.0, 0.1)}) {
      bodies.push_back(
          points_on_lattice(bar(from, from + 1.0, 0.05), options, 2, body_of(bar(0.0, 1.0, 0.1), 1.0).material, 1.0));
      bodies.back().velocity.setZero(2, bodies.back().points.cols());
      bodies.back().velocity.row(0).setConstant(speed);
    }
    set_num_threads(threads);
    Dynamics<2> dynamics(bodies, mpm<2>(options));
    dynamics.run(1.0);
    if (resumed) {
      const std::string state = dynamics.state();
      dynamics = Dynamics<2>(bodies, mpm<2>(options));
      dynamics.restore(state);
    }
    dynamics.run(2.0);
    return dynamics;
  };
  const int threads = num_threads();
  const auto gap = [](const Dynamics<2>& dynamics, Index after) {
    const Points<2> x = dynamics.points();
    const Index begin = dynamics.first_point(after), end = dynamics.first_point(after + 1);
    return x.row(0).segment(end, dynamics.first_point(after + 2) - end).minCoeff() -
           x.row(0).segment(begin, end - begin).maxCoeff();
  };
  const Dynamics<2> tied = run(true, 1, false), free = run(false, 1, false);
  EXPECT_NEAR(gap(tied, 0), 0.025, 0.005) << "points are 0.025 apart";
  EXPECT_NEAR(gap(free, 0), 0.025 + 2.0 * 0.1, 0.005);
  EXPECT_GT(gap(tied, 1), 0.1);
  EXPECT_NEAR(tied.balance().momentum[0], free.balance().momentum[0], 1e-15);
  for (const auto& again : {run(true, 2, false), run(true, 2, true)}) {
    EXPECT_EQ(again.points(), tied.points());
    EXPECT_EQ(again.cauchy_stress(), tied.cauchy_stress());
  }
  set_num_threads(threads);
  const MpmOptions wrong{.cell = 0.05, .ties = {{0, 1}}};
  const auto alone = points_on_lattice(bar(0.0, 1.0, 0.05), wrong, 2, body_of(bar(0.0, 1.0, 0.1), 1.0).material, 1.0);
  EXPECT_THROW(Dynamics<2>({alone}, mpm<2>(wrong)), InputError);
}

TEST(TiedBodies, TwoHalvesMoveAsTheWhole) {
  // A beam of two halves of one material, thrown to turn and to bend: as one body that has the same mesh.
  constexpr double h = 0.05;
  std::vector<DeformableBody<2>> halves{body_of(bar(0.0, 1.0, h), 1.0), body_of(bar(1.0, 2.0, h), 1.0)};
  for (auto& half : halves) {
    half.velocity.resize(2, half.nodes.cols());
    for (Index a = 0; a < half.nodes.cols(); ++a) half.velocity.col(a) = Vec<2>(0.05, 0.1 * std::cos(half.nodes(0, a)));
  }
  Dynamics<2> tied(halves, otm<2>(), {.tied = true});
  const auto& nodes = tied.world().nodes;
  const auto followers = std::ranges::count_if(nodes.master, [](Index master) { return master >= 0; });
  EXPECT_GE(followers, 3);
  const auto before = tied.balance();
  tied.run(10.0);
  const auto after = tied.balance();
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-13);
  EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-13);
  EXPECT_LT(std::abs(tied.energy().largest_error()), 0.01);
  EXPECT_GT(after["stored"], 1e-3 * before["kinetic"]);
  EXPECT_EQ(after["contact"], 0.0);
  for (Index a = 0; a < tied.num_nodes(); ++a)
    if (nodes.follows(a)) EXPECT_EQ(nodes.x.col(a), nodes.x.col(nodes.master[a]));
}

TEST(TiedBodies, GoOnFromAStateBitwise) {
  std::vector<DeformableBody<2>> halves{body_of(bar(0.0, 1.0, 0.1), 1.0), body_of(bar(1.0, 2.0, 0.1), 2.0)};
  halves[0].velocity = Vec<2>(0.2, 0.05).replicate(1, halves[0].nodes.cols());
  const auto make = [&] { return Dynamics<2>(halves, otm<2>(), {.tied = true}); };
  Dynamics<2> whole = make(), first = make(), second = make();
  whole.run(2.0);
  first.run(2.0);
  second.restore(first.state());
  for (int k = 0; k < 50; ++k) {
    whole.step();
    second.step();
  }
  EXPECT_EQ(whole.nodes(), second.nodes());
  EXPECT_EQ(whole.velocities(), second.velocities());
  EXPECT_EQ(whole.deformation(), second.deformation());
}

}  // namespace
}  // namespace efree
