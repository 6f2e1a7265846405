// SPDX-License-Identifier: GPL-3.0-or-later
// Methods from outside of the library in its driver: a block falls on a wall with friction while its left side is held,
// by particles in a grid and by masses and springs. Status 1, with what is wrong, unless no energy is gained, the wall
// is hit, the support holds, the record is written, and results are bitwise the same on one and two threads
// and after a checkpoint.
#include "mass_spring.hpp"
#include "particle_in_cell.hpp"

#include <cstdio>
#include <filesystem>

using namespace efree;

namespace {

int failures = 0;
void expect(bool good, const std::string& method, const char* what) {
  if (good) return;
  ++failures;
  std::printf("%s: %s\n", method.c_str(), what);
}

const SharedMaterial rubber = NeoHookean({.E = 100.0, .nu = 0.3});
constexpr double h = 0.05;

/// Places of a lattice over the unit square.
Points<2> lattice(double first, Index count) {
  Points<2> x(2, count * count);
  for (Index i = 0; i < count; ++i)
    for (Index j = 0; j < count; ++j) x.col(i * count + j) << first + i * h, 0.1 + first + j * h;
  return x;
}

Dynamics<2> particles() {
  DeformableBody<2> body;
  body.points = lattice(0.5 * h, 20);
  body.volumes.setConstant(body.points.cols(), h * h);
  body.material = rubber;
  body.density = 1.0;
  return {{body}, std::make_unique<ParticleInCell>(2.0 * h, Vec<2>(0.0, -1.0))};
}

Dynamics<2> masses() {
  DeformableBody<2> body;
  body.nodes = lattice(0.0, 21);
  body.velocity = Vec<2>(0.0, -1.0).replicate(1, body.nodes.cols());
  body.material = rubber;
  Dynamics<2> result({body}, std::make_unique<MassLattice>(h * h));
  result.add_interaction(std::make_unique<Springs>(body.nodes, 1.5 * h, 50.0));
  return result;
}

Dynamics<2> scene(Dynamics<2> (*method)()) {
  Dynamics<2> result = method();
  result.add_wall({.normal = Vec<2>(0.0, 1.0), .friction = 0.3});
  result.prescribe([](const Vec<2>& x) { return x[0] < 0.01; }, 0, 0.0);
  result.set_gravity(Vec<2>(0.0, -5.0));
  return result;
}

void check(Dynamics<2> (*method)(), const std::filesystem::path& folder) {
  constexpr double until = 0.3;
  set_num_threads(1);
  Dynamics<2> run = scene(method);
  const std::string name = run.scheme();
  DynamicsRecord<2> record(folder / name);
  record.add(run);
  run.run(0.5 * until);
  expect(run.wall_forces()(1, 0) < 0.0, name, "no force on the wall");
  const std::string state = run.state();
  run.run(until);
  record.add(run);

  double held = 0.0;
  for (Index a = 0; a < run.num_nodes(); ++a)
    if (run.nodes()(0, a) < 0.01) held = std::max(held, std::abs(run.velocities()(0, a)));
  expect(held == 0.0, name, "nodes of the support move");
  expect(run.nodes().row(1).maxCoeff() > 0.8 && run.nodes().row(1).minCoeff() > -2.1 * h, name,
         "it is not on the wall");
  const auto energy = run.balance();
  expect(energy["kinetic"] + energy["stored"] < 0.5 + energy["gravity"], name, "it gains energy");
  expect(energy["gravity"] > 0.0 && energy["contact"] > 0.0, name, "no work of gravity, no friction");
  expect(std::filesystem::file_size(folder / name / "nodes_0001.vtu") > 0, name, "no record");

  set_num_threads(2);
  Dynamics<2> other = scene(method), resumed = scene(method);
  other.run(0.5 * until);
  other.run(until);
  resumed.restore(state);
  resumed.run(until);
  for (const Dynamics<2>* same : {&other, &resumed})
    expect(same->nodes() == run.nodes() && same->velocities() == run.velocities() && same->points() == run.points() &&
               same->cauchy_stress() == run.cauchy_stress(),
           name, same == &other ? "two threads differ from one" : "a run that was resumed differs");
  std::printf("%s: %d steps, kinetic energy %.3f, stored %.3f\n", name.c_str(), run.steps(), energy["kinetic"],
              energy["stored"]);
}

}  // namespace

int main(int argc, char** argv) {
  const std::filesystem::path folder = argc > 1 ? argv[1] : "outside_methods";
  check(particles, folder);
  check(masses, folder);
  return failures == 0 ? 0 : 1;
}
