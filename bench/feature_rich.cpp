// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective stiffness of plates full of holes against the truth (P2 on converged meshes): P1, P2, P2 with the smaller
/// holes dropped, and efree on uniform and graded clouds, all through the same code. Kinds of plate:
///
///   holes   10 x 10, 160 holes of radius 0.04 to 0.4, gaps at least 0.03
///   porous  5 x 5, 500 holes of radius 0.02 to 0.1, gaps at least 0.01
///   image   1024 x 1024 pixels, 30 % of them in 2300 pores of radius 4 to 10 that may overlap; smooth contours
///   pulled  the same image under the load of the plates
///
/// Symmetry on the left and below. Plates are pulled by unit tension on the right edge. The image, whose edges run
/// through pores, is stretched by moving it: pulled, scraps that a single ligament holds to the edge decide.
/// Prints CSV. Times run from the outline or image to the solution: mesh, clouds, weights, basis, quadrature, assembly,
/// factorisation; wall-clock and CPU (all threads) seconds, the least of `repeats` runs.
///
///   bench_feature_rich [holes | porous | image | pulled = holes] [seeds = 3] [repeats = 3] [only methods that begin
///   so]
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <numbers>
#include <string>

using namespace efree;

namespace {

struct Mesh {
  double detail;  ///< chords of the sampled circles; in an image what contours may move by when they are simplified
  double size;    ///< of the triangles
};

/// A kind of plate: of each seed, with all pores but those of radius below `dropped`, ready to be meshed.
struct Kind {
  double width;
  bool stretched;  ///< the right edge is moved by 1; else it is pulled by 1 per length
  std::function<std::function<FineMesh<2>(const Mesh&)>(std::uint64_t seed, double dropped)> plate;
};

struct Result {
  double stiffness = 0.0, seconds = 1e30, cpu_seconds = 1e30;
  Index unknowns = 0, vertices = 0;
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Kind discs(double width, int count, double r_min, double r_max, double gap) {
  return {width, false, [=](std::uint64_t seed, double dropped) {
            return [=](const Mesh& sizes) {
              PlanarDomain domain =
                  shapes::plate_with_random_holes(width, count, r_min, r_max, gap, seed, sizes.detail);
              std::erase_if(domain.boundary, [&](const Polyline& line) {
                if (line.name != "holes") return false;
                double low = 1e30, high = -1e30;
                for (const Vec<2>& x : line.points) low = std::min(low, x.x()), high = std::max(high, x.x());
                return 0.5 * (high - low) < dropped;
              });
              return triangulate(domain, {.size = sizes.size});
            };
          }};
}

/// Fills pores of no more than `most` pixels.
LabelImage<2> without_small_pores(LabelImage<2> image, double most) {
  const auto [parts, part_of] = connected_pixels(image);
  for (std::size_t pixel = 0; pixel < part_of.size(); ++pixel)
    if (static_cast<double>(parts[part_of[pixel]].pixels) <= most) image.labels[pixel] = 1;
  return image;
}

Kind porous_image(Index pixels, const RandomSpheres& pores, bool stretched) {
  return {static_cast<double>(pixels), stretched, [=](std::uint64_t seed, double dropped) {
            RandomSpheres seeded = pores;
            seeded.seed = seed;
            const LabelImage<2> image = without_small_pores(keep_largest(random_spheres<2>(pixels, seeded)).image,
                                                            std::numbers::pi * dropped * dropped);
            return [image](const Mesh& sizes) {
              return FineMesh<2>(
                  mesh_image<2>(image, {.size = sizes.size, .contour = Contour::smooth, .simplify = sizes.detail}));
            };
          }};
}

Result solve(const Kind& kind, const std::function<FineMesh<2>(const Mesh&)>& make, const Mesh& sizes,
             const ApproximationOptions& options, int repeats) {
  Result result;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t cpu_start = std::clock();
    const FineMesh<2> mesh = make(sizes);
    const auto approximation = approximate(mesh, options);
    const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; }, one = [](const Vec<2>&) { return 1.0; };
    const Essential essential = options.kind == BasisKind::mls ? Essential::nitsche : Essential::strong;
    std::vector<DisplacementCondition<2>> conditions{{"left", {zero, nullptr}, nullptr},
                                                     {"bottom", {nullptr, zero}, nullptr}};
    Loads<2> loads;
    if (kind.stretched)
      conditions.push_back({"right", {one, nullptr}, nullptr});
    else
      loads.tractions.push_back({"right", [](const Vec<2>&, const Vec<2>&) -> Vec<2> { return {1.0, 0.0}; }});
    const ElasticSolver<2> solver(approximation,
                                  {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = essential},
                                  conditions);
    const auto solution = solver.solve(loads);
    result.seconds = std::min(result.seconds, seconds_since(start));
    result.cpu_seconds = std::min(result.cpu_seconds, static_cast<double>(std::clock() - cpu_start) / CLOCKS_PER_SEC);
    // Of a square sheet: 2 energy = width^2 / E pulled, E stretched.
    result.stiffness =
        kind.stretched ? 2.0 * solution.strain_energy : 0.5 * kind.width * kind.width / solution.strain_energy;
    result.unknowns = 2 * approximation.shape.num_nodes();
    result.vertices = mesh.num_vertices();
  }
  return result;
}

/// What is run on a kind of plate. Lengths are in units of the plate.
struct Plan {
  Mesh truth, truth_check;
  bool extrapolate;  ///< the truth linearly to size zero: at corners of pixels the energy error of P2 falls like h
  std::vector<Mesh> p1, p2;
  double smaller, larger;  ///< radii below which pores are dropped
  struct Family {
    std::string name;
    Mesh mesh;
    int degree;
  };
  std::vector<Family> families;  ///< of clouds
  std::vector<double> uniform, graded;
};

Plan plan_of_discs(double r_max, double unit) {
  // A fine mesh that resolves everything, and two about as coarse as the geometry allows.
  Plan plan{{0.007, 0.07},
            {0.014, 0.1},
            false,
            {{0.4, 0.4}, {0.2, 0.2}, {0.1, 0.1}, {0.05, 0.05}},
            {{0.2, 0.4}, {0.1, 0.25}, {0.07, 0.25}, {0.05, 0.25}, {0.03, 0.2}},
            0.25 * r_max,
            0.5 * r_max,
            {{"fine P1", {0.035, 0.035}, 1},
             {"fine P2", {0.035, 0.035}, 2},
             {"coarse P1", {0.05, 0.1}, 1},
             {"coarse P2", {0.05, 0.1}, 2},
             {"coarsest P2", {0.07, 0.15}, 2}},
            {0.3, 0.2, 0.15, 0.12},
            {0.6, 0.4, 0.3, 0.2, 0.15}};
  const auto scale = [&](Mesh& mesh) { mesh.detail *= unit, mesh.size *= unit; };
  scale(plan.truth), scale(plan.truth_check);
  std::ranges::for_each(plan.p1, scale), std::ranges::for_each(plan.p2, scale);
  for (auto& family : plan.families) scale(family.mesh);
  for (auto* spacings : {&plan.uniform, &plan.graded})
    for (double& H : *spacings) H *= unit;
  return plan;
}

Plan plan_of_image() {
  return {{0.0, 1.5},
          {0.0, 2.5},
          true,
          {{1.0, 8.0}, {0.5, 4.0}, {0.0, 2.0}, {0.0, 1.0}},
          {{1.0, 8.0}, {0.5, 8.0}, {0.35, 6.0}, {0.0, 8.0}, {0.0, 6.0}, {0.0, 5.0}, {0.0, 4.0}, {0.0, 3.0}},
          5.0,
          7.0,
          {{"fine P1", {0.0, 1.0}, 1},
           {"fine P2", {0.0, 1.0}, 2},
           {"coarse P2", {0.35, 4.0}, 2},
           {"coarsest P2", {0.5, 4.0}, 2}},
          {10.0, 7.0},
          {16.0, 10.0, 7.0, 5.0, 4.0}};
}

int run(const std::string& name, const Kind& kind, const Plan& plan, int seeds, int repeats, const std::string& only) {
  std::printf("plate,seed,method,detail,size,spacing,vertices,unknowns,fewer,seconds,cpu_seconds,stiffness,error\n");
  std::fflush(stdout);
  for (int s = 1; s <= seeds; ++s) {
    const auto seed = static_cast<std::uint64_t>(s);
    const auto all = kind.plate(seed, 0.0);
    const ApproximationOptions quadratic{.kind = BasisKind::p2};
    const Result finest = solve(kind, all, plan.truth, quadratic, 1);
    const Result coarser = solve(kind, all, plan.truth_check, quadratic, 1);
    const double slope = (coarser.stiffness - finest.stiffness) / (plan.truth_check.size - plan.truth.size);
    const double truth = finest.stiffness - (plan.extrapolate ? slope * plan.truth.size : 0.0);
    const auto print = [&](const std::string& method, const Mesh& sizes, double spacing, const Result& r) {
      std::printf("%s,%d,%s,%g,%g,%g,%d,%d,%.2f,%.4f,%.4f,%.6f,%+.5f\n", name.c_str(), s, method.c_str(), sizes.detail,
                  sizes.size, spacing, r.vertices, r.unknowns, 2.0 * r.vertices / r.unknowns, r.seconds, r.cpu_seconds,
                  r.stiffness, r.stiffness / truth - 1.0);
      std::fflush(stdout);
    };
    print("truth", plan.truth, 0.0, finest);
    print("truth check", plan.truth_check, 0.0, coarser);
    const auto report = [&](const std::string& method, const auto& plate, const Mesh& sizes,
                            const ApproximationOptions& options) {
      if (method.starts_with(only)) print(method, sizes, options.spacing, solve(kind, plate, sizes, options, repeats));
    };
    for (const Mesh& sizes : plan.p1) report("P1", all, sizes, {.kind = BasisKind::p1});
    for (const Mesh& sizes : plan.p2) report("P2", all, sizes, quadratic);
    const auto some = kind.plate(seed, plan.smaller), few = kind.plate(seed, plan.larger);
    for (const Mesh& sizes : plan.p2) {
      report("P2 without small pores", some, sizes, quadratic);
      report("P2 without more of them", few, sizes, quadratic);
    }
    for (const auto& family : plan.families) {
      for (const double H : plan.uniform)
        report("uniform on " + family.name, all, family.mesh, {.interpolation = family.degree, .spacing = H});
      for (const double H : plan.graded)
        report("graded on " + family.name, all, family.mesh,
               {.interpolation = family.degree, .spacing = H, .grading = {.features = true}});
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "holes", only = argc > 4 ? argv[4] : "";
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 3, repeats = argc > 3 ? std::atoi(argv[3]) : 3;
  if (name == "holes")
    return run(name, discs(10.0, 160, 0.04, 0.4, 0.03), plan_of_discs(0.4, 1.0), seeds, repeats, only);
  if (name == "porous")
    return run(name, discs(5.0, 500, 0.02, 0.1, 0.01), plan_of_discs(0.1, 0.3), seeds, repeats, only);
  if (name == "image" || name == "pulled")
    return run(name, porous_image(1024, {.porosity = 0.3, .r_min = 4.0, .r_max = 10.0}, name == "image"),
               plan_of_image(), seeds, repeats, only);
  std::fprintf(stderr, "bench_feature_rich: no plate '%s', expected holes, porous, image or pulled\n", name.c_str());
  return 2;
}
