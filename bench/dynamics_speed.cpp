// SPDX-License-Identifier: GPL-3.0-or-later
// bench_dynamics_speed SCENE [STEPS]: time and memory of explicit dynamics, a fixed number of steps of one scene on
// OMP_NUM_THREADS threads (1 if not set). Prints the scene, CPU seconds of the steps (by the clock on several threads),
// steps, material points, updates of points per second, the largest resident memory of the process and the time
// reached. Without a scene it lists them.
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/quadrature/approximation.hpp"

#include "clock.hpp"
#include "elastic_block.hpp"
#include "taylor_bar.hpp"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace efree {
namespace {

template <int Dim> using Simulation = Dynamics<Dim>;
template <int Dim> using Body = DeformableBody<Dim>;

/// Largest resident memory so far [MiB]; 0 where the system does not say.
double peak_memory() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return std::atof(line.c_str() + 6) / 1024.0;
  return 0.0;
}

/// Copper, axisymmetric, some 12 thousand points.
Simulation<2> taylor_bar() {
  return bench::TaylorBar::bar<2>(bench::TaylorBar::mesh<2>(0.18e-3), 227.0, {});
}

/// A quarter of the bar in space.
Simulation<3> taylor_bar_quarter() {
  return bench::TaylorBar::bar<3>(bench::TaylorBar::quarter(0.55e-3), 227.0, {}, {}, true, bench::TaylorBar::copper(),
                                  true);
}

/// Two rubber discs that touch from the start, pressed against each other with friction.
Simulation<2> contact() {
  const FineMesh<2> disc = triangulate(shapes::annulus(0.05, 1.0, 0.04), {.size = 0.04});
  std::vector<Body<2>> bodies;
  for (const double side : {-1.0, 1.0}) {
    Body<2> body = deformable_body(disc, bench::soft(), 1.0);
    const Vec<2> centre(side, 0.3 * side);
    body.nodes.colwise() += centre;
    body.points.colwise() += centre;
    body.velocity = Vec<2>(-0.2 * side, 0.0).replicate(1, body.nodes.cols());
    bodies.push_back(std::move(body));
  }
  return {std::move(bodies), otm<2>(), {.contact = {.friction = 0.3}}};
}

/// A porous block on a cloud, with the consistent mass, that hits a rough wall.
Simulation<3> cloud() {
  const auto image = random_spheres<3>(32, {.porosity = 0.3, .r_min = 4.0, .r_max = 8.0});
  const FineMesh<3> mesh(keep_largest(mesh_image<3>(image, {.size = 1.6})).mesh);
  const J2 metal({.moduli = {.E = 1.0, .nu = 0.3}, .yield = Hardening::linear(2e-3, 1e-3), .strain = Strain::finite});
  Body<3> body = deformable_body(
      approximate(mesh, {.spacing = 2.6, .support = dynamics_support, .dilatation = Dilatation::pointwise}), metal,
      1.0);
  body.velocity = Vec<3>(2e-3, 0.0, -6e-3).replicate(1, body.nodes.cols());
  Simulation<3> simulation({body}, total_lagrangian<3>());
  simulation.add_wall({.normal = Vec<3>::UnitZ(), .friction = 0.2});
  return simulation;
}

/// A gas of higher pressure in a corner of a closed box, shape functions recomputed at small strains.
Simulation<2> gas() {
  const auto pressure = [](const Vec<3>& X) { return X.norm() < 0.4 ? 5.0 : 1.0; };
  Body<2> body = deformable_body(bench::block<2>(1.0, 0.025),
                                 Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = pressure}), 1.0);
  body.patches.clear();
  Simulation<2> simulation({body}, otm<2>({.reconnection_strain = 0.005, .merging = 0.0}),
                           {.shock = {.linear = 0.5, .quadratic = 2.0}});
  for (int i = 0; i < 2; ++i) {
    simulation.add_wall({.normal = Vec<2>::Unit(i)});
    simulation.add_wall({.normal = -Vec<2>::Unit(i), .level = -1.0});
  }
  return simulation;
}

template <int Dim> void time_steps(const char* scene, Index steps, Simulation<Dim> simulation) {
  const double start = bench::seconds();
  while (simulation.steps() < steps) simulation.step();
  const double seconds = bench::seconds() - start;
  std::printf("%s: %.3f s, %d steps, %d points, %.4g updates/s, %lld reconnections, peak %.1f MiB, time %.17g\n", scene,
              seconds, simulation.steps(), simulation.num_points(),
              static_cast<double>(simulation.count("point updates")) / seconds,
              static_cast<long long>(simulation.count("reconnections")), peak_memory(), simulation.time());
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  using namespace efree;
  if (std::getenv("OMP_NUM_THREADS") == nullptr) set_num_threads(1);
  struct Scene {
    std::string name;
    Index steps;
    std::function<void(const char*, Index)> run;
  };
  const auto scene = [](const char* name, Index steps, auto prepare) {
    return Scene{name, steps, [prepare](const char* of, Index count) { time_steps(of, count, prepare()); }};
  };
  for (const auto& [name, steps, run] :
       {scene("taylor_bar", 1900, taylor_bar), scene("taylor_bar_quarter", 1300, taylor_bar_quarter),
        scene("contact", 1500, contact), scene("cloud", 1100, cloud), scene("gas", 800, gas)}) {
    if (argc < 2) std::printf("%s, %d steps\n", name.c_str(), steps);
    if (argc > 1 && name == argv[1]) return run(argv[1], argc > 2 ? std::atoi(argv[2]) : steps), 0;
  }
  return 2;
}
