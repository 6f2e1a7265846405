// SPDX-License-Identifier: GPL-3.0-or-later
// bench_dynamics_digests [NAME...]: short runs of explicit dynamics, all or those named, on OMP_NUM_THREADS threads.
// Prints four lines per case, each beginning with its name:
//   time    steps, time, stable step, numbers of nodes and points
//   digests 64-bit FNV-1a digests of the bytes of all fields
//   energy  the energy balance and momenta to 17 digits
//   counts  reconnections, merged nodes and so on
// and a second time as NAME/resumed for the same case continued from a checkpoint at three fifths of its steps. Two
// versions with bitwise equal results print the same. CPU seconds per case go to the error stream.
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/quadrature/approximation.hpp"

#include "clock.hpp"
#include "elastic_block.hpp"
#include "perforation.hpp"
#include "plane_impact.hpp"
#include "shock_tube.hpp"
#include "taylor_bar.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace efree {
namespace {

// ---------------------------------------------------------------------------------------------------------------------
// The library's names for the types of explicit dynamics.

template <int Dim> using Body = DeformableBody<Dim>;

/// Options of the driver and of its scheme.
struct Options {
  Plane plane = Plane::strain;
  LmeOptions lme = OtmOptions{}.lme;
  double reconnection_strain = 0.2;
  bool exact_integration = true;
  double anisotropy = 3.0, merging = 0.4, insertion = 0.0;
  MomentumTransfer momentum = MomentumTransfer::affine;
  double courant = 0.5, stabilisation = 0.1;
  ShockViscosity shock{};
  struct {
    bool enabled = true;
    double friction = 0.0;
    bool seizing = false;
  } contact{};

  OtmOptions scheme() const {
    return {.lme = lme,
            .reconnection_strain = reconnection_strain,
            .exact_integration = exact_integration,
            .anisotropy = anisotropy,
            .merging = merging,
            .insertion = insertion,
            .momentum = momentum,
            .stabilisation = stabilisation,
            .seizing = contact.seizing};
  }
  DynamicsOptions driver() const {
    return {.plane = plane,
            .courant = courant,
            .shock = shock,
            .contact = {.enabled = contact.enabled, .friction = contact.friction}};
  }
};

/// By the total Lagrangian scheme if bodies have shape functions, else by OTM.
template <int Dim> struct Simulation : Dynamics<Dim> {
  Simulation(const std::vector<Body<Dim>>& bodies, const Options& options = {})
      : Dynamics<Dim>(bodies, bodies.front().shape ? total_lagrangian<Dim>() : otm<Dim>(options.scheme()),
                      options.driver()) {}
  Simulation(Dynamics<Dim>&& dynamics) : Dynamics<Dim>(std::move(dynamics)) {}
};

// ---------------------------------------------------------------------------------------------------------------------
// Output.

class Fnv1a {
 public:
  template <class Derived> Fnv1a& add(const Eigen::PlainObjectBase<Derived>& values) {
    return add(values.data(), sizeof(typename Derived::Scalar) * static_cast<std::size_t>(values.size()));
  }
  Fnv1a& add(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t k = 0; k < size; ++k) hash_ = (hash_ ^ bytes[k]) * 1099511628211u;
    return *this;
  }
  Fnv1a& add(double value) { return add(&value, sizeof value); }
  unsigned long long value() const { return hash_; }

 private:
  std::uint64_t hash_ = 14695981039346656037u;
};
template <class Values> unsigned long long digest(const Values& values) {
  return Fnv1a().add(values).value();
}

template <class Vector> void print_vector(const char* name, const Vector& values) {
  std::printf(" %s=", name);
  for (int i = 0; i < values.size(); ++i) std::printf("%s%.17g", i > 0 ? "," : "", values[i]);
}

template <int Dim> void print_results(const std::string& name, const Simulation<Dim>& simulation) {
  const Ledger ledger = simulation.ledger();
  std::printf("%s time: steps=%d time=%.17g stable=%.17g nodes=%d points=%d bodies=%d\n", name.c_str(),
              simulation.steps(), simulation.time(), simulation.stable_step(), simulation.num_nodes(),
              simulation.num_points(), simulation.num_bodies());

  Fnv1a history, tools;
  for (Index body = 0; body < simulation.num_bodies(); ++body) history.add(Matrix(simulation.history(body)));
  for (const auto& tool : simulation.rigid_bodies())
    tools.add(tool.centre)
        .add(tool.velocity)
        .add(tool.rotation)
        .add(tool.spin)
        .add(tool.force)
        .add(tool.impulse)
        .add(tool.work);
  std::printf(
      "%s digests: positions=%016llx velocities=%016llx masses=%016llx points=%016llx gradients=%016llx "
      "stresses=%016llx history=%016llx damage=%016llx release=%016llx tools=%016llx walls=%016llx\n",
      name.c_str(), digest(simulation.nodes()), digest(simulation.velocities()), digest(simulation.masses()),
      digest(simulation.points()), digest(simulation.deformation()), digest(simulation.cauchy_stress()),
      history.value(), digest(simulation.damage()), digest(simulation.release_rates()), tools.value(),
      digest(simulation.wall_forces()));

  const auto balance = simulation.balance();
  const auto energy = simulation.energy();
  std::printf("%s energy:", name.c_str());
  for (const auto& [part, value] : {std::pair{"kinetic", balance["kinetic"]},
                                    {"stored", balance["stored"]},
                                    {"dissipated", balance["dissipated"]},
                                    {"stabilising", balance["stabilisation"]},
                                    {"viscous", balance["viscous"]},
                                    {"contact", balance["contact"]},
                                    {"reconnection", balance["reconnection"]},
                                    {"fracture", balance["fracture"]},
                                    {"prescribed", balance["prescribed"]},
                                    {"gravity", balance["gravity"]},
                                    {"total", balance.total()},
                                    {"error", energy.error()},
                                    {"largest_error", energy.largest_error()}})
    std::printf(" %s=%.17g", part, value);
  print_vector("momentum", balance.momentum);
  print_vector("angular_momentum", balance.angular_momentum);
  std::puts("");

  std::printf("%s counts:", name.c_str());
  for (const auto& [part, count] : {std::pair{"updates", "point updates"},
                                    {"reconnections", "reconnections"},
                                    {"iterations", "lme iterations"},
                                    {"merged", "merged nodes"},
                                    {"inserted", "inserted nodes"},
                                    {"fused", "merged points"},
                                    {"joined", "shared supports"},
                                    {"eroded", "eroded points"},
                                    {"passed", "penetrated points"},
                                    {"kept", "kept supports"},
                                    {"widened", "enlarged supports"}})
    std::printf(" %s=%lld", part, static_cast<long long>(ledger.count(count)));
  std::printf(" overlapping=%zu held=%d\n", simulation.points_in_others().size(), simulation.num_inverted());
  std::fflush(stdout);
}

// ---------------------------------------------------------------------------------------------------------------------
// Runs.

constexpr double unlimited = std::numeric_limits<double>::infinity();

template <int Dim> struct Run {
  std::function<Simulation<Dim>()> prepare;
  Index steps;
  /// Loads that change during the run; returns a bound on the next step.
  std::function<double(Simulation<Dim>&, Index step)> before_step = {};
};

template <int Dim> void advance(Simulation<Dim>& simulation, const Run<Dim>& run, Index from, Index to) {
  for (Index step = from; step < to; ++step)
    simulation.step(run.before_step ? run.before_step(simulation, step) : unlimited);
}
/// The last steps end at a given time.
template <int Dim> void finish(Simulation<Dim>& simulation) {
  simulation.run(simulation.time() + 2.5 * simulation.stable_step());
}

/// Straight through, and from a checkpoint in a second object.
template <int Dim> void run_case(const std::string& name, const Run<Dim>& run) {
  const double start = bench::cpu_seconds();
  const Index checkpoint = 3 * run.steps / 5;
  std::string state;
  double straight = 0.0;
  for (const bool is_resumed : {false, true}) {
    Simulation<Dim> simulation = run.prepare();
    try {
      if (is_resumed) {
        simulation.restore(state);
      } else {
        advance(simulation, run, 0, checkpoint);
        state = simulation.state();
      }
      advance(simulation, run, checkpoint, run.steps);
      finish(simulation);
    } catch (const NumericalError& error) {
      std::printf("%s stopped\n", name.c_str());
      std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    }
    print_results(is_resumed ? name + "/resumed" : name, simulation);
    if (!is_resumed) straight = bench::cpu_seconds() - start;
  }
  std::fprintf(stderr, "%-34s %8.3f s, resumed %8.3f s\n", name.c_str(), straight,
               bench::cpu_seconds() - start - straight);
}

// ---------------------------------------------------------------------------------------------------------------------
// Bodies.

template <int Dim> using VelocityField = std::function<Vec<Dim>(const Vec<Dim>&)>;

template <int Dim> void set_velocity(Body<Dim>& body, const VelocityField<Dim>& velocity) {
  body.velocity.resize(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) body.velocity.col(a) = velocity(body.nodes.col(a));
}
template <int Dim> void set_velocity(Body<Dim>& body, const Vec<Dim>& velocity) {
  body.velocity = velocity.replicate(1, body.nodes.cols());
}
template <int Dim> void translate(Body<Dim>& body, const Vec<Dim>& by) {
  body.nodes.colwise() += by;
  body.points.colwise() += by;
}
template <int Dim> Vec<Dim> in_plane(double x, double y) {
  Vec<Dim> result = Vec<Dim>::Zero();
  result[0] = x;
  result[1] = y;
  return result;
}
template <int Dim> std::function<Vec<Dim>(double)> constant(const Vec<Dim>& velocity) {
  return [velocity](double) { return velocity; };
}

SharedMaterial rubber() {
  return NeoHookean({.E = 1.0, .nu = 0.3});
}
SharedMaterial metal(double E = 100.0, double yield = 0.2) {
  return J2({.moduli = {.E = E, .nu = 0.3}, .yield = yield, .strain = Strain::finite});
}

/// A mesh and its mirror image in the plane x_axis = 0.
FineMesh<3> mirrored(const FineMesh<3>& half, int axis) {
  const Index n = half.num_vertices();
  std::vector<Index> image(static_cast<std::size_t>(n));
  Index next = n;
  for (Index a = 0; a < n; ++a) image[a] = std::abs(half.vertex(a)[axis]) < 1e-9 ? a : next++;
  MeshData<3> mesh;
  mesh.vertices.resize(3, next);
  for (Index a = 0; a < n; ++a) {
    Vec<3> at = half.vertex(a);
    mesh.vertices.col(a) = at;
    at[axis] = image[a] == a ? at[axis] : -at[axis];
    mesh.vertices.col(image[a]) = at;
  }
  const Index m = half.num_cells();
  mesh.cells.resize(4, 2 * m);
  mesh.cells.leftCols(m) = half.cells();
  for (Index c = 0; c < m; ++c)
    for (int i = 0; i < 4; ++i) mesh.cells(i, m + c) = image[half.cells()(i, c)];
  return FineMesh<3>(std::move(mesh));
}
/// About the origin, with a hollow in the middle.
FineMesh<3> thick_sphere(double inner, double outer, double size) {
  FineMesh<3> mesh(solids::thick_sphere(inner, outer, size));
  for (const int axis : {0, 1, 2}) mesh = mirrored(mesh, axis);
  return mesh;
}
FineMesh<2> disc(double size) {
  return triangulate(shapes::annulus(0.05, 1.0, size), {.size = size});
}

/// Two copies of a body about the origin that fly towards each other along x, `gap` apart, offset along y.
template <int Dim> std::vector<Body<Dim>> colliding_pair(const FineMesh<Dim>& mesh, double gap, double offset,
                                                         double speed, const SharedMaterial& material) {
  const double reach = mesh.vertices().row(0).maxCoeff() + 0.5 * gap;
  std::vector<Body<Dim>> bodies;
  for (const double side : {-1.0, 1.0}) {
    Body<Dim> body = deformable_body(mesh, material, 1.0);
    translate<Dim>(body, in_plane<Dim>(side * reach, 0.5 * side * offset));
    set_velocity<Dim>(body, in_plane<Dim>(-side * speed, 0.0));
    bodies.push_back(std::move(body));
  }
  return bodies;
}

/// Facets of the boundary whose vertices are all within that distance of the origin.
template <int Dim> Facets<Dim> inner_facets(const FineMesh<Dim>& mesh, double within) {
  std::vector<Index> inner;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    bool is_inner = true;
    for (const Index a : mesh.facets().col(f)) is_inner = is_inner && mesh.vertex(a).norm() < within;
    if (is_inner) inner.push_back(f);
  }
  return mesh.facets()(Eigen::all, inner);
}

/// A block that is torn apart while it turns.
template <int Dim> Body<Dim> spreading_block(double size, const SharedMaterial& material) {
  Body<Dim> body = deformable_body(bench::block<Dim>(1.0, size), material, 1.0);
  set_velocity<Dim>(body, [](const Vec<Dim>& x) {
    return in_plane<Dim>(0.2 + 1.5 * (x[0] - 0.5) - 0.5 * (x[1] - 0.5), 0.1 - 0.5 * (x[1] - 0.5) + 0.5 * (x[0] - 0.5));
  });
  return body;
}

/// Nodes with |x_axis - at| < 1e-9.
template <int Dim> void prescribe_plane(Simulation<Dim>& simulation, int plane, double at, int axis, double velocity) {
  for (Index a = 0; a < simulation.num_nodes(); ++a)
    if (std::abs(simulation.nodes()(plane, a) - at) < 1e-9) simulation.prescribe(a, axis, velocity);
}

// ---------------------------------------------------------------------------------------------------------------------
// Taylor bars.

/// Plane strain, each point with its own dilatation, on a wall with friction: rate hardening and thermal softening.
Simulation<2> taylor_bar_plane() {
  using bench::TaylorBar;
  Body<2> body = deformable_body(TaylorBar::mesh<2>(0.3e-3), TaylorBar::johnson_cook(), TaylorBar::density);
  body.patches.clear();
  set_velocity<2>(body, Vec<2>(0.0, -227.0));
  Simulation<2> simulation({body});
  simulation.add_wall({.normal = Vec<2>::UnitY(), .friction = 0.1});
  prescribe_plane<2>(simulation, 0, 0.0, 0, 0.0);
  return simulation;
}

/// A short rod against a free rigid plate.
Simulation<3> rod_on_plate(double size, double speed, const Options& options, const FractureCriteria& fracture = {}) {
  using bench::TaylorBar;
  Body<3> body = deformable_body(FineMesh<3>(solids::cylinder(TaylorBar::radius, 8e-3, size)), TaylorBar::copper(),
                                 TaylorBar::density);
  body.fracture = fracture;
  set_velocity<3>(body, Vec<3>(0.0, 0.0, -speed));
  Simulation<3> simulation({body}, options);
  simulation.add_rigid_body({.shape = rigid_shapes::half_space<3>(Vec<3>::UnitZ(), 0.0), .mass = 1.0, .inertia = 1e-3});
  return simulation;
}

// ---------------------------------------------------------------------------------------------------------------------
// Contact.

/// Two rings under inner pressure.
Simulation<2> touching_balloons(const SharedMaterial& material, double size, double pressure, double insertion) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.9, 1.0, size), {.size = size});
  Simulation<2> simulation(colliding_pair<2>(ring, 0.01, 0.0, 0.05, material),
                           {.insertion = insertion, .contact = {.friction = 0.1}});
  for (const Index body : {0, 1}) {
    GasCavity<2> gas{.facets = inner_facets(ring, 0.95), .pressure = pressure};
    gas.facets.array() += simulation.first_node(body);
    simulation.add_cavity(gas);
  }
  return simulation;
}

/// A hollow ball under pressure that falls on a sticking wall.
Simulation<3> inflated_ball() {
  const FineMesh<3> shell = thick_sphere(0.5, 1.0, 0.3);
  Body<3> body = deformable_body(shell, rubber(), 1.0);
  set_velocity<3>(body, Vec<3>(0.02, 0.0, -0.1));
  Simulation<3> simulation({body});
  simulation.add_wall({.normal = Vec<3>::UnitZ(), .level = -1.01, .friction = unlimited});
  simulation.add_cavity({.facets = inner_facets(shell, 0.75), .pressure = 0.02, .exponent = 1.0});
  simulation.set_gravity(Vec<3>(0.0, 0.0, -0.01));
  return simulation;
}

Simulation<3> seizing_blocks() {
  const FineMesh<3> box(solids::box({1.0, 1.0, 1.0}, 0.25));
  auto bodies = colliding_pair<3>(box, 0.1, 0.3, 0.15, metal(1.0, 0.02));
  bodies[1].density = 3.0;
  return {std::move(bodies), {.contact = {.seizing = true}}};
}

/// A hard disc on a stack of rubber and soil that lies on a wall, in plane strain.
Simulation<2> layered_stack() {
  std::vector<Body<2>> bodies;
  bodies.push_back(deformable_body(bench::block<2>(3.0, 0.07),
                                   DruckerPrager({.moduli = {.E = 0.5, .nu = 0.25},
                                                  .cohesion = Hardening::linear(2e-3, 1e-2),
                                                  .friction = 0.5,
                                                  .dilatancy = 0.2,
                                                  .strain = Strain::finite}),
                                   1.5));
  bodies.push_back(
      deformable_body(bench::block<2>(3.0, 0.07), Ogden(std::vector<OgdenTerm>{{0.2, 2.0}, {-0.02, -2.0}}, 1.0), 1.0));
  translate<2>(bodies.back(), Vec<2>(0.0, 1.01));
  // Denser to the right.
  bodies.back().densities.resize(bodies.back().points.cols());
  for (Index p = 0; p < bodies.back().points.cols(); ++p)
    bodies.back().densities[p] = 1.0 + 0.2 * bodies.back().points(0, p);
  bodies.push_back(deformable_body(disc(0.08), metal(), 8.0));
  translate<2>(bodies.back(), Vec<2>(1.6, 3.03));
  set_velocity<2>(bodies.back(), Vec<2>(0.05, -0.3));
  Simulation<2> simulation(std::move(bodies), {.contact = {.friction = 0.2}});
  simulation.add_wall({.normal = Vec<2>::UnitY(), .friction = 0.5});
  simulation.set_gravity(Vec<2>(0.0, -0.01));
  return simulation;
}

// ---------------------------------------------------------------------------------------------------------------------
// Walls and rigid tools.

/// A rigid gear that turns and sinks into a block on a sticking wall.
Simulation<2> gear_on_block() {
  Body<2> body = deformable_body(bench::block<2>(2.0, 0.045), rubber(), 1.0);
  Points<2> corners(2, 8);
  const Vec<2> centre(1.0, 1.52);
  for (int k = 0; k < 8; ++k)
    corners.col(k) = centre + 0.5 * Vec<2>(std::cos(k * std::numbers::pi / 4.0), std::sin(k * std::numbers::pi / 4.0));
  Simulation<2> simulation({body});
  simulation.add_wall({.normal = Vec<2>::UnitY(), .friction = unlimited});
  simulation.add_rigid_body({.shape = rigid_shapes::solid<2>(corners, rigid_shapes::polygon(8)),
                             .friction = 0.3,
                             .velocity = constant<2>({0.05, -0.15}),
                             .spin = constant<1>(Vec<1>(0.3)),
                             .centre = centre});
  return simulation;
}

/// A block between a free spinning ball, a prescribed cylinder and a sticking cube.
Simulation<3> block_between_tools() {
  Body<3> body = deformable_body(bench::block<3>(2.0, 0.25), rubber(), 1.0);
  set_velocity<3>(body, Vec<3>(0.0, 0.02, 0.0));
  Simulation<3> simulation({body});
  const Vec<3> centre(1.5, 1.56, 0.4);
  simulation.add_rigid_body({.shape = rigid_shapes::ball<3>(centre, 0.55),
                             .friction = 0.3,
                             .velocity = constant<3>({0.0, -0.15, 0.0}),
                             .spin = constant<3>({0.1, 0.2, -0.3}),
                             .centre = centre,
                             .mass = 0.6,
                             .inertia = 0.1});
  simulation.add_rigid_body({.shape = rigid_shapes::cylinder({0.5, -1.01, 0.0}, {0.0, 0.0, 1.0}, 1.0),
                             .friction = 0.2,
                             .velocity = [](double t) { return Vec<3>(0.0, 0.05 * std::min(1.0, t), 0.0); }});
  FineMesh<3> cube(solids::box({1.0, 1.0, 1.0}, 0.5));
  Points<3> corners = cube.vertices();
  corners.colwise() += Vec<3>(2.01, 0.2, 0.1);
  simulation.add_rigid_body({.shape = rigid_shapes::solid<3>(corners, cube.facets()),
                             .friction = unlimited,
                             .velocity = constant<3>({-0.05, 0.0, 0.0})});
  return simulation;
}

/// A block that slides along a wall with friction into a corner that sticks.
Simulation<2> block_on_walls() {
  Body<2> body = deformable_body(bench::block<2>(1.0, 0.03), rubber(), 1.0);
  set_velocity<2>(body, Vec<2>(0.15, -0.2));
  Simulation<2> simulation({body});
  simulation.add_wall({.normal = Vec<2>::UnitY(), .friction = 0.2});
  simulation.add_wall({.normal = -Vec<2>::UnitX(), .level = -1.05, .friction = unlimited});
  return simulation;
}

/// Axisymmetric upsetting: two plates, one of them free, press a disc of metal.
Simulation<2> upset_disc() {
  Body<2> body = deformable_body(
      triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.04}),
      J2({.moduli = {.E = 50.0, .nu = 0.3}, .yield = Hardening::voce(1.0, 2.0, 10.0), .strain = Strain::finite}), 1.0,
      true);
  Simulation<2> simulation({body}, {.plane = Plane::axisymmetric});
  prescribe_plane<2>(simulation, 0, 0.0, 0, 0.0);
  simulation.add_rigid_body({.shape = rigid_shapes::half_space<2>(Vec<2>::UnitY(), 0.0), .friction = 0.1});
  simulation.add_rigid_body({.shape = rigid_shapes::half_space<2>(-Vec<2>::UnitY(), -1.0),
                             .friction = 0.1,
                             .velocity = constant<2>({0.0, -0.5}),
                             .mass = 20.0});
  return simulation;
}

/// A block that slides on a wall, below a free ball, in gravity.
template <int Dim> Simulation<Dim> loaded_block(double size) {
  Body<Dim> body = deformable_body(bench::block<Dim>(2.0, size), rubber(), 1.0);
  set_velocity<Dim>(body, in_plane<Dim>(0.3, -0.1));
  Simulation<Dim> simulation({body}, {.reconnection_strain = 0.02});
  simulation.add_wall({.normal = Vec<Dim>::UnitY(), .level = -0.02, .friction = 0.3});
  const Vec<Dim> centre = in_plane<Dim>(1.2, 1.53);
  simulation.add_rigid_body({.shape = rigid_shapes::ball<Dim>(centre, 0.5),
                             .velocity = constant<Dim>(in_plane<Dim>(0.0, -0.2)),
                             .centre = centre,
                             .mass = 0.5,
                             .inertia = 0.1});
  simulation.set_gravity(in_plane<Dim>(0.02, -0.1));
  return simulation;
}

/// An axisymmetric ball that is dropped on a wall.
Simulation<2> dropped_ball() {
  std::vector<Vec<2>> half;
  const int n = 50;
  for (int k = 0; k <= n; ++k) {
    const double angle = std::numbers::pi * (static_cast<double>(k) / n - 0.5);
    half.push_back(Vec<2>(k == 0 || k == n ? 0.0 : std::cos(angle), 1.0 + std::sin(angle)));
  }
  half.push_back(half.front());
  Body<2> body = deformable_body(triangulate({.boundary = {{"", half}}}, {.size = 0.04}), rubber(), 1.0, true);
  set_velocity<2>(body, Vec<2>(0.0, -0.1));
  Simulation<2> simulation({body}, {.plane = Plane::axisymmetric});
  prescribe_plane<2>(simulation, 0, 0.0, 0, 0.0);
  simulation.add_wall({.normal = Vec<2>::UnitY(), .level = -0.02});
  simulation.set_gravity(Vec<2>(0.0, -0.02));
  return simulation;
}

// ---------------------------------------------------------------------------------------------------------------------
// FractureCriteria.

/// Kalthoff and Winkler's plate: a crack from a notch by eigenerosion.
Simulation<2> notched_plate() {
  constexpr double side = 0.1, notch = 0.05, height = 0.025, size = 2.5e-3;
  Body<2> body = deformable_body(triangulate(shapes::rectangle(0.0, 0.0, side, side), {.size = size}),
                                 NeoHookean({.E = 190e9, .nu = 0.3}), 8000.0);
  body.fracture = {.toughness = 2.213e4, .neighbourhood = 2.0};
  Simulation<2> simulation({body});
  const Points<2> points = simulation.points();
  for (Index p = 0; p < simulation.num_points(); ++p)
    if (points(0, p) < notch && std::abs(points(1, p) - height) < size) simulation.erode(p);
  for (Index a = 0; a < simulation.num_nodes(); ++a) {
    if (simulation.nodes()(1, a) < 1e-9) simulation.prescribe(a, 1, 0.0);
    if (simulation.nodes()(0, a) < 1e-9 && simulation.nodes()(1, a) < height - 0.5 * size)
      simulation.prescribe(a, 0, 30.0);
  }
  return simulation;
}

/// Blocks whose ends are pulled apart.
template <int Dim> Simulation<Dim> pulled_block(double size, double rate, const FractureCriteria& fracture,
                                                const SharedMaterial& material, const Options& options = {}) {
  Body<Dim> body = deformable_body(bench::block<Dim>(1.0, size), material, 1.0);
  body.fracture = fracture;
  set_velocity<Dim>(body, [rate](const Vec<Dim>& x) { return in_plane<Dim>(0.0, rate * (x[1] - 0.5)); });
  Simulation<Dim> simulation({body}, options);
  prescribe_plane<Dim>(simulation, 1, 0.0, 1, -0.5 * rate);
  prescribe_plane<Dim>(simulation, 1, 1.0, 1, 0.5 * rate);
  return simulation;
}

/// A half of a bar that is stretched between two planes of symmetry, with insertion of nodes.
Simulation<2> stretched_bar() {
  auto simulation = pulled_block<2>(0.07, 1.5, {}, metal(), {.insertion = 1.4});
  prescribe_plane<2>(simulation, 0, 0.0, 0, 0.0);
  return simulation;
}

/// Torn apart in gravity, with insertion of nodes; some points are eroded from the start.
template <int Dim> Simulation<Dim> torn_block(double size) {
  Body<Dim> body = spreading_block<Dim>(size, metal());
  body.fracture = {.neighbourhood = 0.0, .stretch = 1.8};
  Simulation<Dim> simulation({body}, {.insertion = 1.5});
  simulation.erode(0);
  simulation.set_gravity(in_plane<Dim>(0.1, -0.4));
  return simulation;
}

// ---------------------------------------------------------------------------------------------------------------------
// Gases and liquids.

/// A gas of higher pressure in a corner of a closed box.
template <int Dim> Simulation<Dim> gas_in_box(double size, const Options& options) {
  const auto pressure = [](const Vec<3>& X) { return X.norm() < 0.4 ? 5.0 : 1.0; };
  Body<Dim> body = deformable_body(bench::block<Dim>(1.0, size),
                                   Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = pressure}), 1.0);
  body.patches.clear();
  Simulation<Dim> simulation({body}, options);
  for (int i = 0; i < Dim; ++i) {
    simulation.add_wall({.normal = Vec<Dim>::Unit(i)});
    simulation.add_wall({.normal = -Vec<Dim>::Unit(i), .level = -1.0});
  }
  return simulation;
}

/// A column of liquid that collapses between walls.
Simulation<2> dam_break(double viscosity, const Options& options) {
  Body<2> body = deformable_body(
      triangulate(shapes::rectangle(0.0, 0.0, 1.0, 2.0), {.size = 0.05}),
      Fluid({.state = EquationOfState::tait(100.0, 7.15), .viscosity = viscosity, .bulk_viscosity = 0.5 * viscosity}),
      1.0);
  Simulation<2> simulation({body}, options);
  simulation.add_wall({.normal = Vec<2>::UnitY()});
  simulation.add_wall({.normal = Vec<2>::UnitX()});
  simulation.set_gravity(Vec<2>(0.0, -5.0));
  return simulation;
}

// ---------------------------------------------------------------------------------------------------------------------
// Bodies with given shape functions: clouds and finite elements.

FineMesh<3> porous_mesh(int voxels, double size) {
  const auto image = random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 4.0, .r_max = 8.0});
  return FineMesh<3>(keep_largest(mesh_image<3>(image, {.size = size})).mesh);
}

/// A porous block that hits a rough wall and is struck by a rigid ball.
Simulation<3> porous_block(const FineMesh<3>& mesh, const ApproximationOptions& approximation) {
  const J2 steel({.moduli = {.E = 1.0, .nu = 0.3}, .yield = Hardening::linear(2e-3, 1e-3), .strain = Strain::finite});
  Body<3> body = deformable_body(approximate(mesh, approximation), steel, 1.0);
  set_velocity<3>(body, Vec<3>(2e-3, 0.0, -6e-3));
  Simulation<3> simulation({body});
  simulation.add_wall({.normal = Vec<3>::UnitZ(), .friction = 0.2});
  const double edge = mesh.vertices().row(0).maxCoeff();
  const Vec<3> centre(0.5 * edge, 0.5 * edge, 1.5 * edge + 0.1);
  simulation.add_rigid_body({.shape = rigid_shapes::ball<3>(centre, 0.5 * edge),
                             .friction = 0.1,
                             .velocity = constant<3>({0.0, 0.0, -0.02}),
                             .spin = constant<3>({0.0, 0.0, 1e-3}),
                             .centre = centre});
  return simulation;
}

/// A perforated plate on a cloud, with several terms of the mass, that slides along a wall and sticks to another.
Simulation<2> perforated_plate(Index mass_terms, Dilatation dilatation) {
  const FineMesh<2> mesh =
      triangulate(shapes::plate_with_random_holes(1.0, 8, 0.05, 0.1, 0.03, 1, 0.012), {.size = 0.012});
  Body<2> body = deformable_body(approximate(mesh, {.spacing = 0.04,
                                                    .support = dynamics_support,
                                                    .dilatation = dilatation,
                                                    .pressures = PressureKind::constant}),
                                 rubber(), 1.0);
  body.mass_terms = mass_terms;
  set_velocity<2>(body, Vec<2>(0.15, -0.2));
  Simulation<2> simulation({body});
  simulation.add_wall({.normal = Vec<2>::UnitY(), .level = -0.01, .friction = 0.2});
  simulation.add_wall({.normal = -Vec<2>::UnitX(), .level = -1.03, .friction = unlimited});
  simulation.add_rigid_body({.shape = rigid_shapes::half_space<2>(-Vec<2>::UnitY(), -1.02),
                             .friction = 0.3,
                             .velocity = constant<2>({0.0, -0.1})});
  simulation.set_gravity(Vec<2>(0.0, -0.01));
  return simulation;
}

/// An axisymmetric cloud on a wall, nodes on the axis held.
Simulation<2> axisymmetric_cloud() {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 2.0), {.size = 0.02});
  Body<2> body = deformable_body(
      approximate(mesh, {.axisymmetric = true, .spacing = 0.06, .support = dynamics_support}), rubber(), 1.0);
  set_velocity<2>(body, Vec<2>(0.0, -0.2));
  Simulation<2> simulation({body}, {.plane = Plane::axisymmetric});
  prescribe_plane<2>(simulation, 0, 0.0, 0, 0.0);
  simulation.add_wall({.normal = Vec<2>::UnitY(), .friction = 0.1});
  return simulation;
}

/// Two bodies of linear finite elements with cells, in contact.
Simulation<2> elements_against_elements() {
  const FineMesh<2> mesh = bench::block<2>(1.0, 0.04);
  Body<2> elements = deformable_body(approximate(mesh, {.kind = BasisKind::p1}), metal(1.0, 0.02), 1.0);
  if (elements.points.cols() == mesh.num_cells()) elements.cells = mesh.cells();
  set_velocity<2>(elements, Vec<2>(0.1, 0.05));
  Body<2> block = deformable_body(approximate(mesh, {.kind = BasisKind::p1}), rubber(), 1.0);
  block.cells = elements.cells;
  translate<2>(block, Vec<2>(1.02, 0.2));
  set_velocity<2>(block, Vec<2>(-0.15, 0.0));
  return {{elements, block}, {.contact = {.friction = 0.3}}};
}

// ---------------------------------------------------------------------------------------------------------------------
// Particles and points on grids.

SharedMaterial clay(double cohesion = 2.0) {
  return DruckerPrager(
      {.moduli = {.E = 1e3, .nu = 0.3}, .cohesion = cohesion, .friction = 0.4, .strain = Strain::finite});
}

/// Soil that falls down its free sides, whose particles split.
template <int Dim> Simulation<Dim> falling_particles(double spacing, double splitting) {
  SphOptions options{.spacing = spacing};
  options.splitting.strain = splitting;
  Body<Dim> body = particles_on_lattice<Dim>(bench::block<Dim>(1.0, 0.5), SphFrame::updated, options, clay(), 1.0);
  set_velocity<Dim>(body, [](const Vec<Dim>& x) { return Vec<Dim>(x[1] * Vec<Dim>::Unit(0)); });
  Dynamics<Dim> simulation({body}, sph<Dim>(options), {.imbalance = 10.0});
  simulation.add_wall({.normal = Vec<Dim>::UnitY(), .friction = unlimited});
  simulation.add_wall({.normal = Vec<Dim>::UnitX()});
  const Vec<Dim> centre = in_plane<Dim>(0.5, 1.21);
  simulation.add_rigid_body({.shape = rigid_shapes::ball<Dim>(centre, 0.2),
                             .velocity = constant<Dim>(in_plane<Dim>(0.0, -2.0)),
                             .centre = centre});
  simulation.set_gravity(in_plane<Dim>(0.0, -10.0));
  return simulation;
}

/// Two bodies that spin and collide, with corrected gradients and artificial stress; one breaks.
Simulation<2> corrected_particles() {
  SphOptions options{.spacing = 0.05, .corrected = true};
  options.artificial_stress.strength = 0.5;
  const FineMesh<2> mesh = bench::block<2>(1.0, 0.5);
  Body<2> one = particles_on_lattice<2>(mesh, SphFrame::updated, options, rubber(), 1.0),
          other = particles_on_lattice<2>(mesh, SphFrame::updated, options, metal(1.0, 0.02), 2.0);
  set_velocity<2>(one, [](const Vec<2>& x) { return Vec<2>(0.3 - 0.1 * x[1], 0.1 * x[0]); });
  set_velocity<2>(other, [](const Vec<2>& x) { return Vec<2>(-0.3 - 0.4 * x[1], -0.2); });
  translate<2>(other, Vec<2>(1.1, 0.3));
  other.fracture = {.stretch = 1.6};
  return Dynamics<2>({one, other}, sph<2>(options), {.imbalance = 10.0});
}

/// A block that hits a wall, with shock viscosity, prescribed velocities and eigenerosion.
Simulation<2> shocked_particles() {
  const SphOptions options{.spacing = 0.04};
  Body<2> body = particles_on_lattice<2>(bench::block<2>(1.0, 0.5), SphFrame::updated, options, metal(1.0, 0.05), 1.0);
  body.fracture = {.toughness = 4e-3, .neighbourhood = 1.5};
  set_velocity<2>(body, [](const Vec<2>& x) { return Vec<2>(x[0] - 0.5, -0.4); });
  Dynamics<2> simulation({body}, sph<2>(options), {.imbalance = 10.0, .shock = {.linear = 0.5, .quadratic = 1.0}});
  simulation.add_wall({.normal = Vec<2>::UnitY(), .friction = 0.2});
  for (Index a = 0; a < body.nodes.cols(); ++a)
    if (body.nodes(0, a) < 0.08) simulation.prescribe(a, 0, -0.5);
  return simulation;
}

/// Two bodies that meet above a wall. Points with pressure patches, points without, or meshes.
template <int Dim> Simulation<Dim> points_on_grid(MpmFrame frame, const MpmOptions& options,
                                                  const SharedMaterial& material, bool patches,
                                                  const DynamicsOptions& driver = {.imbalance = 10.0}) {
  const double size = frame == MpmFrame::mesh ? options.cell : 0.5;
  Body<Dim> one = body_on_lattice<Dim>(bench::block<Dim>(1.0, size), frame, options, 2, material, 1.0);
  if (!patches) one.patches.clear();
  Body<Dim> other = one;
  translate<Dim>(other, in_plane<Dim>(0.2, 1.05));
  const auto spin = [](Body<Dim>& body, double fall) {
    const Points<Dim>& at = body.nodes.cols() > 0 ? body.nodes : body.points;
    body.velocity.setZero(Dim, at.cols());
    body.velocity.row(0) = 0.2 * at.row(1);
    body.velocity.row(1) = -0.2 * at.row(0).array() - fall;
  };
  spin(one, 0.1);
  spin(other, 0.5);
  Dynamics<Dim> simulation({one, other}, mpm<Dim>(options), driver);
  simulation.add_wall({.normal = Vec<Dim>::UnitY(), .level = -0.02, .friction = 0.3});
  simulation.set_gravity(in_plane<Dim>(0.0, -0.1));
  return simulation;
}

// ---------------------------------------------------------------------------------------------------------------------
// Options.

/// Two halves of a block of metal that run into each other.
Simulation<2> compressed_block(const Options& options) {
  Body<2> body = deformable_body(bench::block<2>(2.0, 0.045), metal(), 1.0);
  set_velocity<2>(body, [](const Vec<2>& x) { return Vec<2>(x[0] < 1.0 ? 0.7 : -0.3, 0.3 * (x[0] - 1.0)); });
  return {{body}, options};
}

/// Small strains, loaded in changing steps: velocities are prescribed and gravity turns half way.
Simulation<2> elastic_bar() {
  Body<2> body = deformable_body(bench::block<2>(4.0, 0.08), LinearElastic(ElasticModuli{.E = 1.0, .nu = 0.3}), 1.0);
  set_velocity<2>(body, [](const Vec<2>& x) { return Vec<2>(1e-4 * std::sin(2.0 * x[0]), 0.0); });
  Simulation<2> simulation({body});
  prescribe_plane<2>(simulation, 0, 0.0, 0, 0.0);
  simulation.set_gravity(Vec<2>(1e-5, 0.0));
  return simulation;
}
double change_loads(Simulation<2>& simulation, Index step) {
  if (step == 100) prescribe_plane<2>(simulation, 0, 0.0, 1, 0.0);
  if (step == 150) simulation.set_gravity(Vec<2>(0.0, 1e-5));
  return (step % 3 == 0 ? 0.3 : 1.0) * simulation.stable_step();
}

// ---------------------------------------------------------------------------------------------------------------------

struct Case {
  std::string name;
  std::function<void(const std::string& name)> run;
};
template <int Dim> Case make_case(std::string name, Run<Dim> run) {
  return {std::move(name), [run = std::move(run)](const std::string& of) { run_case<Dim>(of, run); }};
}

std::vector<Case> cases() {
  using bench::PlaneImpact, bench::Perforation, bench::ShockTube, bench::RiemannProblem, bench::TaylorBar;
  const auto plane = [](std::string name, Index steps, std::function<Simulation<2>()> prepare,
                        std::function<double(Simulation<2>&, Index)> before_step = {}) {
    return make_case<2>(std::move(name), {std::move(prepare), steps, std::move(before_step)});
  };
  const auto space = [](std::string name, Index steps, std::function<Simulation<3>()> prepare) {
    return make_case<3>(std::move(name), {std::move(prepare), steps});
  };
  return {
      plane("taylor_bar_axisymmetric", 400, [] { return TaylorBar::bar<2>(TaylorBar::mesh<2>(0.25e-3), 227.0, {}); }),
      plane("taylor_bar_plane_strain", 300, taylor_bar_plane),
      space(
          "taylor_bar_quarter", 300,
          [] { return TaylorBar::bar<3>(TaylorBar::quarter(0.7e-3), 227.0, {}, {}, true, TaylorBar::copper(), true); }),
      plane("taylor_bar_insertion", 5000,
            [] { return TaylorBar::bar<2>(TaylorBar::mesh<2>(0.8e-3), 750.0, {.insertion = 2.0}); }),
      plane("taylor_bar_merging", 2000, [] { return TaylorBar::bar<2>(TaylorBar::mesh<2>(0.6e-3), 750.0, {}); }),
      space(
          "rod_insertion", 800,
          [] { return rod_on_plate(2.4e-3, 750.0, {.insertion = 3.0, .shock = {.linear = 0.06, .quadratic = 1.5}}); }),
      plane("taylor_bar_overspeed", 400,
            [] { return TaylorBar::bar<2>(TaylorBar::mesh<2>(0.4e-3), 60e3, {}, {.courant = 0.9}); }),
      space("rod_overspeed", 400, [] { return rod_on_plate(2.0e-3, 30e3, {.courant = 0.9}); }),
      space("rod_overspeed_erosion", 300,
            [] { return rod_on_plate(2.0e-3, 30e3, {.courant = 0.9}, {.stretch = 100.0}); }),

      plane("balloons", 400, [] { return touching_balloons(rubber(), 0.03, 0.004, 0.0); }),
      plane("balloons_insertion", 500, [] { return touching_balloons(metal(1.0, 0.02), 0.04, 0.02, 1.4); }),
      space("inflated_ball", 100, inflated_ball),
      plane("bouncing_discs", 400,
            [] {
              return Simulation<2>(colliding_pair<2>(disc(0.08), 0.02, 0.5, 0.1, rubber()),
                                   {.contact = {.friction = 0.3}});
            }),
      space("bouncing_spheres", 100,
            [] {
              return Simulation<3>(colliding_pair<3>(thick_sphere(0.3, 1.0, 0.35), 0.02, 0.4, 0.15, rubber()),
                                   {.contact = {.friction = 0.2}});
            }),
      plane("no_contact", 100,
            [] {
              return Simulation<2>(colliding_pair<2>(disc(0.06), 0.02, 0.0, 0.2, rubber()),
                                   {.contact = {.enabled = false}});
            }),
      plane("seizing_discs", 300,
            [] {
              return Simulation<2>(colliding_pair<2>(disc(0.08), 0.02, 0.5, 0.1, metal(1.0, 0.02)),
                                   {.contact = {.seizing = true}});
            }),
      plane("seizing_insertion", 400,
            [] {
              return Simulation<2>(colliding_pair<2>(disc(0.08), 0.02, 0.3, 0.4, metal(1.0, 0.01)),
                                   {.insertion = 1.3, .contact = {.seizing = true}});
            }),
      space("seizing_blocks", 80, seizing_blocks),
      plane("layered_stack", 300, layered_stack),

      plane("gear_on_block", 300, gear_on_block),
      space("block_between_tools", 120, block_between_tools),
      plane("block_on_walls", 300, block_on_walls),
      plane("upset_disc", 300, upset_disc),
      plane("gravity_on_block", 300, [] { return loaded_block<2>(0.06); }),
      space("gravity_on_block_3d", 100, [] { return loaded_block<3>(0.34); }),
      plane("dropped_ball", 300, dropped_ball),

      plane("crack_from_notch", 400, notched_plate),
      space("eigenerosion_3d", 60,
            [] { return pulled_block<3>(0.2, 0.2, {.toughness = 8e-3, .neighbourhood = 1.5}, rubber()); }),
      plane("eigenerosion_local", 300,
            [] { return pulled_block<2>(0.04, 0.1, {.toughness = 8e-4, .neighbourhood = 0.0}, rubber()); }),
      plane("stretched_bar", 700, stretched_bar),
      plane("torn_block", 800, [] { return torn_block<2>(0.08); }),
      space("torn_block_3d", 150, [] { return torn_block<3>(0.4); }),
      plane("ductile_failure", 500,
            [] {
              return pulled_block<2>(
                  0.05, 1.0, {.strain = JohnsonCookFailure{.D = {0.02, 0.2, -0.8, 0.05, 0.0}, .reference = 1e-3}},
                  metal(100.0, 0.3));
            }),
      plane("perforation", 1000, [] { return Perforation::bodies<2>(0.7e-3, 600.0, true, Perforation::fracture()); }),
      plane("perforation_without_erosion", 1500, [] { return Perforation::bodies<2>(0.7e-3, 1500.0, false, {}); }),
      space("perforation_3d", 100, [] { return Perforation::bodies<3>(3e-3, 700.0, false, Perforation::fracture()); }),

      plane("shock_tube", 900, [] { return std::move(ShockTube(RiemannProblem::sod(), 400).dynamics); }),
      plane("shock_tube_elements", 900,
            [] { return std::move(ShockTube(RiemannProblem::collision(), 400, true).dynamics); }),
      plane("gas_in_box", 150,
            [] {
              return gas_in_box<2>(
                  0.025, {.reconnection_strain = 0.05, .merging = 0.0, .shock = {.linear = 0.5, .quadratic = 2.0}});
            }),
      space("gas_in_box_3d", 40,
            [] {
              return gas_in_box<3>(0.15, {.reconnection_strain = 0.05, .shock = {.linear = 0.5, .quadratic = 2.0}});
            }),
      plane("dam_break", 700, [] { return dam_break(0.0, {.reconnection_strain = 0.1}); }),
      plane("viscous_column", 200, [] { return dam_break(0.02, {.shock = {.linear = 0.1}}); }),
      plane("plane_impact", 300,
            [] {
              return PlaneImpact::bar<2>(PlaneImpact::mesh<2>(0.006), 800.0, {},
                                         {.shock = {.linear = 0.5, .quadratic = 2.0}});
            }),
      space("plane_impact_3d", 100,
            [] {
              return PlaneImpact::bar<3>(PlaneImpact::mesh<3>(0.03), 800.0, {},
                                         {.shock = {.linear = 0.5, .quadratic = 2.0}}, false);
            }),

      space("porous_block_cloud", 150,
            [] {
              return porous_block(porous_mesh(32, 2.0),
                                  {.spacing = 4.0, .support = dynamics_support, .dilatation = Dilatation::pointwise});
            }),
      space("porous_block_elements", 200, [] { return porous_block(porous_mesh(32, 2.5), {.kind = BasisKind::p1}); }),
      plane("perforated_plate_cloud", 200, [] { return perforated_plate(4, Dilatation::pointwise); }),
      plane("perforated_plate_averaged", 200, [] { return perforated_plate(1, Dilatation::averaged); }),
      plane("axisymmetric_cloud", 200, axisymmetric_cloud),
      plane("elements_against_elements", 400, elements_against_elements),

      plane("momentum_affine", 200, [] { return compressed_block({.reconnection_strain = 0.1}); }),
      plane("momentum_nodes", 200,
            [] { return compressed_block({.reconnection_strain = 0.1, .momentum = MomentumTransfer::nodes}); }),
      plane("momentum_points", 200,
            [] { return compressed_block({.reconnection_strain = 0.1, .momentum = MomentumTransfer::points}); }),
      plane("reconnection_every_step", 60, [] { return compressed_block({.reconnection_strain = 0.0}); }),
      plane("isotropic_supports", 200,
            [] {
              return compressed_block({.lme = {.gamma = 1.8, .cutoff = 1e-6},
                                       .reconnection_strain = 0.1,
                                       .exact_integration = false,
                                       .anisotropy = 1.0,
                                       .merging = 0.0,
                                       .courant = 0.3,
                                       .stabilisation = 0.3});
            }),
      plane("elastic_bar", 300, elastic_bar, change_loads),

      plane("sph_soil", 300, [] { return falling_particles<2>(0.04, 0.0); }),
      plane("sph_splitting", 300, [] { return falling_particles<2>(0.05, 0.02); }),
      space("sph_soil_3d", 60, [] { return falling_particles<3>(0.1, 0.0); }),
      space("sph_splitting_3d", 60, [] { return falling_particles<3>(0.1, 0.05); }),
      plane("sph_corrected", 300, corrected_particles),
      plane("sph_shock", 300, shocked_particles),
      plane("mpm_patches", 200,
            [] { return points_on_grid<2>(MpmFrame::updated, {.cell = 0.08}, metal(1.0, 0.02), true); }),
      plane("mpm_without_patches", 200,
            [] {
              return points_on_grid<2>(MpmFrame::updated, {.cell = 0.08, .transfer = Transfer::xpic}, clay(0.01),
                                       false);
            }),
      plane("mpm_remap", 200,
            [] {
              return points_on_grid<2>(MpmFrame::updated, {.cell = 0.08, .transfer = Transfer::flip, .remap = true},
                                       metal(1.0, 0.02), false);
            }),
      plane("mpm_shock", 200,
            [] {
              return points_on_grid<2>(MpmFrame::updated, {.cell = 0.08, .transfer = Transfer::apic}, rubber(), true,
                                       {.imbalance = 10.0, .shock = {.linear = 0.5, .quadratic = 1.0}});
            }),
      plane("mpm_mesh", 200, [] { return points_on_grid<2>(MpmFrame::mesh, {.cell = 0.1}, metal(1.0, 0.02), true); }),
      space("mpm_patches_3d", 60,
            [] { return points_on_grid<3>(MpmFrame::updated, {.cell = 0.2}, metal(1.0, 0.02), true); }),
  };
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  const std::vector<std::string> names(argv + 1, argv + argc);
  const auto cases = efree::cases();
  for (const std::string& name : names)
    if (std::ranges::find(cases, name, &efree::Case::name) == cases.end()) {
      std::fprintf(stderr, "there is no case \"%s\"; cases:", name.c_str());
      for (const auto& one : cases) std::fprintf(stderr, " %s", one.name.c_str());
      return std::fputs("\n", stderr), 2;
    }
  for (const auto& [name, run] : cases)
    if (names.empty() || std::ranges::find(names, name) != names.end()) run(name);
}
