// SPDX-License-Identifier: GPL-3.0-or-later
// bench_dynamics_speed SCENE [STEPS] [SIZE]: time and memory of explicit dynamics, a fixed number of steps of one scene
// on OMP_NUM_THREADS threads (1 if not set). SIZE: points along an edge over those by default, for scenes of clay.
// Prints the scene, CPU seconds of the steps (by the clock on several threads), steps, material points, updates of
// points per second, the peak memory of the process, its increase over the memory before the scene by point, likewise
// for the peak of the steps alone, and the time reached. Without a scene it lists them.
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
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
#include "soil_scenes.hpp"
#include "taylor_bar.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace efree {
namespace {

template <int Dim> using Simulation = Dynamics<Dim>;
template <int Dim> using Body = DeformableBody<Dim>;

/// A line of the process's memory [bytes]: VmHWM, the largest that was resident, or VmRSS, what is. 0 where the system
/// does not say.
double memory(const char* name) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(name)) return 1024.0 * std::atof(line.c_str() + 6);
  return 0.0;
}
/// Makes VmHWM what is resident now.
void forget_peak() {
  std::ofstream("/proc/self/clear_refs") << "5";
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

/// Clay that falls down its free sides, on a rough floor and between smooth walls in the planes of symmetry.
template <int Dim, class Lattice> Simulation<Dim> clay(std::unique_ptr<Scheme<Dim>> scheme, const Lattice& on_lattice) {
  constexpr bench::Soil of = bench::soft_clay<Dim>;
  std::vector<Body<Dim>> bodies;
  bodies.push_back(on_lattice(bench::block<Dim>(1.0, 1.0), of.material(), of.density));
  Simulation<Dim> simulation(std::move(bodies), std::move(scheme), {.imbalance = 10.0});
  const Vec<Dim> up = Vec<Dim>::Unit(Dim - 1);
  simulation.add_wall({.normal = up, .friction = std::numeric_limits<double>::infinity()});
  for (int i = 0; i < Dim - 1; ++i) simulation.add_wall({.normal = Vec<Dim>::Unit(i)});
  simulation.set_gravity(-bench::earth_gravity * up);
  return simulation;
}
template <int Dim> Simulation<Dim> clay_particles(double size) {
  const SphOptions options{.spacing = (Dim == 2 ? 1.0 / 300.0 : 1.0 / 40.0) / size};
  return clay<Dim>(sph<Dim>(options), [&](const auto& mesh, const auto& material, double density) {
    return particles_on_lattice<Dim>(mesh, SphFrame::updated, options, material, density);
  });
}
template <int Dim> Simulation<Dim> clay_points(double size) {
  const MpmOptions options{.cell = (Dim == 2 ? 1.0 / 150.0 : 1.0 / 20.0) / size};
  return clay<Dim>(mpm<Dim>(options), [&](const auto& mesh, const auto& material, double density) {
    return points_on_lattice<Dim>(mesh, options, 2, material, density);
  });
}

template <class Prepare> void time_steps(const char* scene, Index steps, const Prepare& prepare) {
  const double before = memory("VmRSS:");
  auto simulation = prepare();
  const double peak_before = memory("VmHWM:");
  forget_peak();
  const double start = bench::seconds();
  while (simulation.steps() < steps) simulation.step();
  const double seconds = bench::seconds() - start;
  const double peak_of_steps = memory("VmHWM:"), peak = std::max(peak_before, peak_of_steps);
  const double points = simulation.num_points();
  std::printf(
      "%s: %.3f s, %d steps, %.0f points, %.4g updates/s, %lld reconnections, peak %.1f MiB, %.0f bytes/point, of the "
      "steps %.0f, time %.17g\n",
      scene, seconds, simulation.steps(), points, static_cast<double>(simulation.count("point updates")) / seconds,
      static_cast<long long>(simulation.count("reconnections")), peak / (1024.0 * 1024.0), (peak - before) / points,
      (peak_of_steps - before) / points, simulation.time());
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  using namespace efree;
  if (std::getenv("OMP_NUM_THREADS") == nullptr) set_num_threads(1);
  struct Scene {
    std::string name;
    Index steps;
    std::function<void(const char*, Index, double)> run;
  };
  const auto scene = [](const char* name, Index steps, auto prepare) {
    return Scene{name, steps, [prepare](const char* of, Index count, double) { time_steps(of, count, prepare); }};
  };
  const auto scene_of_size = [](const char* name, Index steps, auto prepare) {
    return Scene{name, steps, [prepare](const char* of, Index count, double size) {
                   bench::block<3>(1.0, 1.0);  // memory that meshing takes once is not of the points
                   time_steps(of, count, [&] { return prepare(size); });
                 }};
  };
  for (const auto& [name, steps, run] :
       {scene("taylor_bar", 1900, taylor_bar), scene("taylor_bar_quarter", 1300, taylor_bar_quarter),
        scene("contact", 1500, contact), scene("cloud", 1100, cloud), scene("gas", 800, gas),
        scene_of_size("sph", 200, clay_particles<2>), scene_of_size("sph_in_space", 60, clay_particles<3>),
        scene_of_size("mpm", 200, clay_points<2>), scene_of_size("mpm_in_space", 100, clay_points<3>)}) {
    if (argc < 2) std::printf("%s, %d steps\n", name.c_str(), steps);
    if (argc > 1 && name == argv[1])
      return run(argv[1], argc > 2 ? std::atoi(argv[2]) : steps, argc > 3 ? std::atof(argv[3]) : 1.0), 0;
  }
  return 2;
}
