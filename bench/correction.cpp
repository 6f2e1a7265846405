// SPDX-License-Identifier: GPL-3.0-or-later
/// Corrections towards the finite elements of the fine mesh: iterations, and estimated errors against true ones.
///
///   bench_correction [part of a case's name = all] [H/h = 4] [clouds = 1] [order = 1]
#include "efree/solvers/correction.hpp"
#include "cavity.hpp"
#include "efree/geometry/image_mesh.hpp"
#include "efree/geometry/label_image.hpp"
#include "efree/geometry/largest_body.hpp"
#include "efree/geometry/planar_domain.hpp"
#include "efree/geometry/solid_shapes.hpp"
#include "inclusion.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <numeric>
#include <string>

using namespace efree;
using namespace efree::bench;

namespace {

template <int Dim> struct Problem {
  std::string name;
  FineMesh<Dim> mesh;
  double h;
  ElasticModel model;
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;
  bool dilatation = false;
};

template <int Dim> void study(const Problem<Dim>& problem, double ratio, int clouds, int order) {
  for (int seed = 1; seed <= clouds; ++seed) {
    StageTimes times;
    const auto cloud = approximate<Dim>(problem.mesh,
                                        {.axisymmetric = problem.model.plane == Plane::axisymmetric,
                                         .order = order,
                                         .spacing = ratio * problem.h,
                                         .seed = static_cast<std::uint64_t>(seed),
                                         .dilatation = problem.dilatation},
                                        &times);
    const ElasticSolver<Dim> solver(cloud, problem.model, problem.supports, &times);
    const Solution<Dim> solution = solver.solve(problem.loads);
    const Corrector<Dim> corrector(cloud, problem.model, problem.supports, &times);
    const Points<Dim> start = interpolate(cloud.shape, solution.coefficients);
    Correction<Dim> converged;
    {
      const Stage stage("iterate", times, {});
      converged = corrector.correct(start, problem.loads, {.iterations = 40});
    }
    // Squared errors after each step.
    std::vector<double> left(converged.taken.size());
    double sum = 0.0;
    for (std::size_t k = left.size(); k-- > 0;) left[k] = sum, sum += converged.taken[k];
    int to_1e6 = 0;
    while (to_1e6 < static_cast<int>(left.size()) - 1 && left[to_1e6] > 1e-12) ++to_1e6;
    std::printf("| %s | %d | %g | %d | %td | %.3g | %.4g | %d |", problem.name.c_str(), Dim, ratio, cloud.space.size(),
                cloud.nodes.cols(), solution.strain_energy / converged.strain_energy - 1.0, converged.start_error,
                to_1e6);
    for (const int k : {0, 1, 2, 3, 4, 6}) {
      const auto some = corrector.correct(start, problem.loads, {.iterations = k});
      std::printf(" %.2g (%.2f, %.2f)", std::sqrt(left[k]), some.error / std::sqrt(left[k]),
                  some.start_error / converged.start_error);
    }
    std::printf(" | %.2f | %.2f | %.3f |\n", times.total() - times["iterate"] - times["correction"],
                times["correction"], times["iterate"] / 40.0);
    std::fflush(stdout);
  }
}

ElasticModel plane_stress(double nu = 0.3) {
  return {.material = {1.0, nu}, .plane = Plane::stress};
}
ElasticModel plane_strain(double nu) {
  return {.material = {1.0, nu}, .plane = Plane::strain};
}
DisplacementCondition<2> moved(const char* on, double x, double y) {
  return {on, {[x](const Vec<2>&) { return x; }, [y](const Vec<2>&) { return y; }}, nullptr};
}

FineMesh<2> slit_plate(double h) {
  PlanarDomain domain = shapes::rectangle(-1.0, -1.0, 1.0, 1.0);
  domain.slits.push_back({"slit", {{-0.4, 0.0}, {0.4, 0.1}}});
  return triangulate(domain, {.size = h});
}

}  // namespace

int main(int argc, char** argv) {
  const std::string wanted = argc > 1 ? argv[1] : "all";
  const double ratio = argc > 2 ? std::atof(argv[2]) : 4.0;
  const int clouds = argc > 3 ? std::atoi(argv[3]) : 1, order = argc > 4 ? std::atoi(argv[4]) : 1;
  std::printf(
      "| case | dimensions | H/h | fine degrees | nodes | energy of the cloud / elements - 1 | error of the cloud | "
      "iterations to 1e-6 | error left after 0, 1, 2, 3, 4, 6 (estimate over truth: left, cloud) | cloud [s] | set-up "
      "[s] | iteration [s] |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  const auto run = [&](const std::string& name, const auto& make) {
    if (wanted == "all" || name.find(wanted) != std::string::npos) {
      auto problem = make();
      problem.name = name;
      study(problem, ratio, clouds, order);
    }
  };
  run("plate", [] {
    return Problem<2>{"",
                      triangulate(shapes::quarter_plate_with_hole(1.0, 5.0, 0.05), {.size = 0.05}),
                      0.05,
                      plane_stress(),
                      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                      {{tension<2>("right", 1.0)}, {}}};
  });
  run("slit", [] {
    return Problem<2>{"", slit_plate(0.02), 0.02, plane_stress(), {clamp<2>("bottom")}, {{tension<2>("top", 1.0)}, {}}};
  });
  run("L", [] {
    return Problem<2>{"",
                      triangulate(shapes::l_shape(1.0), {.size = 0.02}),
                      0.02,
                      plane_stress(),
                      {clamp<2>("top")},
                      {{}, [](const Vec<2>&) -> Vec<2> {
                         return {0.0, -1.0};
                       }}};
  });
  for (const double nu : {1.0 / 3.0, 0.4999})
    run("Cook " + std::to_string(nu), [&] {
      return Problem<2>{"",
                        triangulate(shapes::cook(), {.size = 1.0}),
                        1.0,
                        plane_strain(nu),
                        {clamp<2>("left")},
                        {{{"right",
                           [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                             return {0.0, 1.0};
                           }}},
                         {}},
                        nu > 0.4};
    });
  run("160 holes", [] {
    return Problem<2>{"",
                      triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, 0.05), {.size = 0.05}),
                      0.05,
                      plane_stress(),
                      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                      {{tension<2>("right", 1.0)}, {}}};
  });
  for (const double contrast : {1000.0, 0.001})
    run("inclusion " + std::to_string(contrast), [&] {
      static const Inclusion stiff(1.0, 0.6, 1000.0), soft(1.0, 0.6, 0.001);
      const Inclusion& inclusion = contrast > 1.0 ? stiff : soft;
      return Problem<2>{"",
                        FineMesh<2>(cut_regions(inclusion.mesh(0.04))),
                        0.04,
                        inclusion.model(Essential::nitsche),
                        {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                        inclusion.loads()};
    });
  run("porous image", [] {
    const auto image = keep_largest(random_spheres<2>(256, {.porosity = 0.35, .r_min = 3.0, .r_max = 12.0})).image;
    return Problem<2>{"",
                      FineMesh<2>(mesh_image<2>(image, {.size = 1.5})),
                      1.5,
                      plane_stress(),
                      {moved("left", 0.0, 0.0), moved("right", 1.0, 0.0)},
                      {}};
  });
  run("cavity", [] {
    return Problem<3>{"",
                      Cavity::mesh(0.15),
                      0.15,
                      {.material = Cavity::material},
                      {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                      Cavity::loads()};
  });
  run("box nearly incompressible", [] {
    return Problem<3>{"",
                      FineMesh<3>(solids::box({2.0, 1.0, 1.0}, 0.1)),
                      0.1,
                      {.material = {1.0, 0.4999}},
                      {clamp<3>("left")},
                      {{{"right",
                         [](const Vec<3>&, const Vec<3>&) -> Vec<3> {
                           return {0.0, 0.0, 1.0};
                         }}},
                       {}},
                      true};
  });
  for (const Index voxels : {64, 128})
    run("block " + std::to_string(voxels), [&] {
      const auto image = keep_largest(random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
      const DisplacementCondition<3> pulled{"top", {}, [=](const Vec<3>&) { return 0.01 * voxels; }};
      return Problem<3>{"",
                        FineMesh<3>(mesh_image<3>(image, {.size = 3.0})),
                        2.3,
                        {.material = {1.0, 0.3}},
                        {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom"), pulled},
                        {}};
    });
}
