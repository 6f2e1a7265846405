// SPDX-License-Identifier: GPL-3.0-or-later
// bench_image_impact VOXELS MESH DIR SPACING... [key=value ...]: a porous block of steel from a label image, 1 mm a
// voxel, thrown against a rigid wall at 20 m/s. Explicit linear finite elements on a mesh of MESH voxels an edge
// against clouds on the same mesh: force on the wall, both averaged over the time a wave takes through SPACING, step
// and time with all that goes before, on one thread. DIR keeps the impulses of the finite elements (and reuses
// them), those of the clouds, both forces and the bodies in the end. Keys: terms (of the mass), support, ratio
// (quadrature points a node), averaged (dilatation 0, 1), delaunay (mesh 0, 1), until (microseconds).
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/io/records/dynamics_record.hpp"
#include "efree/materials/j2.hpp"

#include "arguments.hpp"
#include "clock.hpp"
#include "ledger_text.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace efree {
namespace {

namespace fs = std::filesystem;

// Millimetres, newtons, tonnes, seconds.
constexpr double E = 210e3, nu = 0.3, density = 7.85e-9, speed = 20e3;

/// Impulse on the wall after each step, and what it cost.
struct History {
  std::vector<double> time{0.0}, impulse{0.0};
  double seconds = 0.0, step = 0.0;  ///< CPU, of all but the mesh; the first stable step

  double impulse_at(double t) const {
    const auto after = std::upper_bound(time.begin(), time.end(), t);
    if (after == time.begin()) return 0.0;
    if (after == time.end()) return impulse.back();
    const auto k = static_cast<std::size_t>(after - time.begin());
    return impulse[k - 1] + (impulse[k] - impulse[k - 1]) * (t - time[k - 1]) / (time[k] - time[k - 1]);
  }
  /// Mean force over that long around a time.
  double force(double t, double over) const { return (impulse_at(t + 0.5 * over) - impulse_at(t - 0.5 * over)) / over; }

  void write(const fs::path& file) const {
    std::ofstream out(file);
    out.precision(17);
    out << seconds << ' ' << step << '\n';
    for (std::size_t k = 0; k < time.size(); ++k) out << time[k] << ' ' << impulse[k] << '\n';
  }
  static History read(const fs::path& file) {
    std::ifstream in(file);
    History result;
    in >> result.seconds >> result.step;
    result.time.clear();
    result.impulse.clear();
    for (double t = 0.0, I = 0.0; in >> t >> I;) result.time.push_back(t), result.impulse.push_back(I);
    return result;
  }
};

History thrown(DeformableBody<3> body, double begin, double until, const fs::path& record) {
  body.velocity.setZero(3, body.nodes.cols());
  body.velocity.row(2).setConstant(-speed);
  Dynamics<3> dynamics({body}, total_lagrangian<3>());
  dynamics.add_wall({.normal = Vec<3>::Unit(2)});
  const double before = dynamics.balance().total();
  History result;
  result.step = dynamics.stable_step();
  std::printf("%d nodes, %d points, set up after %.1f s, masses %.2g to %.2g of the mean, step %.3g ns\n",
              dynamics.num_nodes(), dynamics.num_points(), bench::cpu_seconds() - begin,
              dynamics.masses().minCoeff() / dynamics.masses().mean(),
              dynamics.masses().maxCoeff() / dynamics.masses().mean(), 1e9 * result.step);
  std::fflush(stdout);
  double last = 0.0;
  while (dynamics.time() < until) {
    const double dt = dynamics.step(until - dynamics.time());
    result.impulse.push_back(result.impulse.back() - 0.5 * (last + dt) * dynamics.wall_forces()(2, 0));
    result.time.push_back(dynamics.time());
    last = dt;
  }
  result.seconds = bench::cpu_seconds() - begin;
  const auto now = dynamics.balance();
  std::printf(
      "%d steps, kinetic %.3f, stored %.3f, plastic %.3f, contact %.3f, total %.5f, momentum off by %.1e; %.1f s: "
      "%s; peak %.0f MB\n",
      dynamics.steps(), now["kinetic"] / before, now["stored"] / before, now["dissipated"] / before,
      now["contact"] / before, now.total() / before,
      std::abs((now.momentum[2] - result.impulse.back()) / (density * speed) / body.volumes.sum() + 1.0),
      result.seconds, bench::times_text(dynamics.ledger()).c_str(), peak_memory_mb());
  std::fflush(stdout);
  DynamicsRecord<3>(record).add(dynamics);
  return result;
}

void run(int voxels, double size, const fs::path& folder, const std::vector<double>& spacings, bench::Keys key) {
  const auto value = [&](const char* name, double otherwise) { return key.contains(name) ? key[name] : otherwise; };
  set_num_threads(1);
  fs::create_directories(folder);
  const double until = 1e-6 * value("until", 60.0 * voxels / 128.0);
  const bool delaunay = value("delaunay", 0.0) != 0.0;
  const double start = bench::cpu_seconds();
  const auto image = keep_largest(random_spheres<3>(voxels, {.porosity = 0.3})).image;
  const FineMesh<3> mesh(
      keep_largest(mesh_image<3>(image, {.size = size, .mesher = delaunay ? Mesher::delaunay : Mesher::lattice})).mesh);
  const double meshing = bench::cpu_seconds() - start;
  std::printf("%d voxels a side, %d tetrahedra, %d vertices, volume %.4f, %.1f s\n", voxels, mesh.num_cells(),
              mesh.num_vertices(), mesh.volumes().sum() / std::pow(voxels, 3), meshing);
  const J2 steel({.moduli = {.E = E, .nu = nu}, .yield = Hardening::linear(450.0, 129.24), .strain = Strain::finite});
  const double wave = std::sqrt(E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) / density);

  const std::string name = std::to_string(voxels) + "_" + std::to_string(size).substr(0, 4) + (delaunay ? "d" : "");
  const fs::path file = folder / ("elements_" + name + ".txt");
  if (!fs::exists(file)) {
    const double begin = bench::cpu_seconds();
    thrown(deformable_body(approximate(mesh, {.kind = BasisKind::p1}), steel, density), begin, until,
           folder / ("elements_" + name))
        .write(file);
  }
  const History elements = History::read(file);
  for (const double spacing : spacings) {
    const double begin = bench::cpu_seconds();
    DeformableBody<3> body =
        deformable_body(approximate(mesh, {.spacing = spacing,
                                           .support = value("support", dynamics_support),
                                           .ratio = value("ratio", 0.0),
                                           .dilatation = averaged_if(value("averaged", 0.0) != 0.0),
                                           .pressures = PressureKind::constant}),
                        steel, density);
    body.mass_terms = static_cast<Index>(value("terms", body.mass_terms));
    const std::string cloud = "cloud_" + name + "_" + std::to_string(spacing).substr(0, 4);
    const History found = thrown(std::move(body), begin, until, folder / cloud);
    found.write(folder / (cloud + ".txt"));
    const double over = spacing / wave;
    double off = 0.0, all = 0.0;
    std::ofstream forces(folder / ("force_" + name + "_" + std::to_string(spacing).substr(0, 4) + ".csv"));
    forces << "us,elements kN,cloud kN\n";
    for (double t = 0.5 * over; t < until - 0.5 * over; t += 0.1 * over) {
      const double force = elements.force(t, over);
      off += std::pow(found.force(t, over) - force, 2);
      all += force * force;
      forces << 1e6 * t << ',' << 1e-3 * force << ',' << 1e-3 * found.force(t, over) << '\n';
    }
    std::printf("| %g | force off by %.2f %% | impulse off by %.2f %% | step times %.2f | time over %.1f |\n", spacing,
                100.0 * std::sqrt(off / all), 100.0 * (found.impulse.back() / elements.impulse.back() - 1.0),
                found.step / elements.step, (elements.seconds + meshing) / (found.seconds + meshing));
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  if (argc < 4) return std::puts("bench_image_impact VOXELS MESH DIR SPACING... [key=value ...]"), 2;
  const auto [spacings, keys] = efree::bench::arguments(argc, argv, 4);
  efree::run(std::atoi(argv[1]), std::atof(argv[2]), argv[3], spacings, keys);
}
