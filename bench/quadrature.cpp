// SPDX-License-Identifier: GPL-3.0-or-later
/// Clusters of cells, linear functions on them and full integration on one cloud after the other: errors where the
/// solution is known (displacement in L2, energy norm, recovered stress), else the number that the problem asks for;
/// CPU seconds of the approximation (clouds, weights, basis, quadrature) and of assembly and solution, the least of
/// three runs (one where that takes a second). One thread. Medians over the seeds; Markdown.
///
///   bench_quadrature [part of a problem's name = all] [seeds = 3] [part of a basis' name = all]
#include "clock.hpp"
#include "efree/bench/cavity.hpp"
#include "efree/bench/inclusion.hpp"
#include "efree/bench/kirsch.hpp"
#include "efree/bench/lame.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/tests/bodies.hpp"

#include <cstdio>
#include <cstdlib>
#include <functional>

using namespace efree;
using efree::bench::cpu_seconds;
using efree::bench::median;

namespace {

struct Choice {
  SecondaryKind secondary;
  double ratio;
};
constexpr Choice choices[] = {{SecondaryKind::full, 0.0},   {SecondaryKind::cells, 2.0},  {SecondaryKind::cells, 2.5},
                              {SecondaryKind::cells, 4.0},  {SecondaryKind::linear, 1.0}, {SecondaryKind::linear, 1.25},
                              {SecondaryKind::linear, 1.5}, {SecondaryKind::linear, 2.0}, {SecondaryKind::linear, 2.25},
                              {SecondaryKind::linear, 2.5}, {SecondaryKind::linear, 3.0}};

/// A problem on a mesh: errors, or a single number of the solution in place of the first.
template <int Dim> struct Problem {
  std::string name;
  std::function<FineMesh<Dim>()> mesh;
  ApproximationOptions options;
  ElasticModel model;
  std::vector<DisplacementCondition<Dim>> conditions;
  Loads<Dim> loads;
  ExactSolution<Dim> exact{};
  std::function<double(const Approximation<Dim>&, const Solution<Dim>&)> number{};
};

std::string name_of(const Choice& choice) {
  char text[40];
  std::snprintf(text, sizeof text, "%s %g", testing::name_of(choice.secondary), choice.ratio);
  return text;
}

bool matches(const std::string& name, const std::string& wanted) {
  return wanted == "all" || name.find(wanted) != std::string::npos;
}

/// What the command line asks for.
struct Wanted {
  std::string problem, basis;
  int seeds;
};

template <int Dim> void run(const Problem<Dim>& problem, const Wanted& wanted) {
  if (!matches(problem.name, wanted.problem)) return;
  const FineMesh<Dim> mesh = problem.mesh();
  for (const Choice& choice : choices) {
    if (!matches(name_of(choice), wanted.basis)) continue;
    std::vector<std::vector<double>> columns(7);
    for (int seed = 1; seed <= wanted.seeds; ++seed) {
      ApproximationOptions options = problem.options;
      options.secondary = choice.secondary;
      options.ratio = choice.ratio;
      options.seed = static_cast<std::uint64_t>(seed);
      std::vector<double> seconds(2, 1e300), values(3, 0.0);
      double nodes = 0.0, ratio = 0.0;
      for (int repeat = 0; repeat < 3 && (repeat == 0 || seconds[0] + seconds[1] < 1.0); ++repeat) {
        const double start = cpu_seconds();
        const auto approximation = approximate(mesh, options);
        const double approximated = cpu_seconds();
        const auto solution = ElasticSolver<Dim>(approximation, problem.model, problem.conditions).solve(problem.loads);
        seconds = {std::min(seconds[0], approximated - start), std::min(seconds[1], cpu_seconds() - approximated)};
        if (repeat > 0) continue;
        nodes = static_cast<double>(approximation.nodes.cols());
        ratio = approximation.ratio();
        if (problem.number) {
          values[0] = problem.number(approximation, solution);
        } else {
          const Errors errors = errors_against(approximation, recover_fields(approximation, solution),
                                               materials_of(problem.model, mesh), problem.exact);
          values = {*errors.l2_displacement, *errors.energy_norm, *errors.energy_norm_recovered};
        }
      }
      const double row[] = {nodes, ratio, values[0], values[1], values[2], seconds[0], seconds[1]};
      for (int k = 0; k < 7; ++k) columns[k].push_back(row[k]);
    }
    std::printf("| %s | %s | %.0f | %.2f |", problem.name.c_str(), name_of(choice).c_str(), median(columns[0]),
                median(columns[1]));
    if (problem.number)
      std::printf(" %.5g | | |", median(columns[2]));
    else
      std::printf(" %.2e | %.3e | %.2e |", median(columns[2]), median(columns[3]), median(columns[4]));
    std::printf(" %.3f | %.3f |\n", median(columns[5]), median(columns[6]));
    std::fflush(stdout);
  }
}

Problem<2> kirsch(double H, int order, int mesh_ratio) {
  return {"kirsch order " + std::to_string(order) + ", H/h = " + std::to_string(mesh_ratio) +
              ", H = " + std::to_string(H).substr(0, 4),
          [=] { return bench::Kirsch::mesh(H / mesh_ratio); },
          {.order = order, .spacing = H},
          {.material = LinearElastic(bench::Kirsch::material), .plane = Plane::stress},
          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          bench::Kirsch::loads(),
          {bench::Kirsch::displacement, bench::Kirsch::stress}};
}

Problem<2> cook(double nu) {
  const auto shear = [](const Vec<2>&, const Vec<2>&) -> Vec<2> { return {0.0, 1.0 / 16.0}; };
  return {
      "cook nu = " + std::to_string(nu).substr(0, 8) + " (7.695e-2)",
      [] { return triangulate(shapes::cook(), {.size = 3.2 / 8.0}); },
      {.spacing = 3.2, .dilatation = averaged_if(nu > 0.4)},
      {.material = LinearElastic(240.565, nu), .plane = Plane::strain},
      {clamp<2>("left")},
      {.tractions = {{"right", shear}}, .body_force = {}},
      {},
      [](const Approximation<2>& approximation, const Solution<2>& solution) {
        return probe<2>(approximation.space, recover_fields(approximation, solution), {48.0, 52.0}).displacement.y();
      }};
}

template <int Dim> Problem<Dim> lame(bool sphere, double nu) {
  const bench::ThickWall wall{sphere, {1.0, nu}};
  const auto spacing = bench::ThickWall::spacing(Dim == 2 ? 9 : 5, 0.0);
  const double H = spacing.at_inner;
  std::vector<DisplacementCondition<Dim>> planes{symmetry_plane<Dim>("bottom")};
  if (!sphere) planes.push_back(symmetry_plane<Dim>("top"));
  if (Dim == 3) planes.push_back(symmetry_plane<Dim>("left")), planes.push_back(symmetry_plane<Dim>("front"));
  return {std::string("lame ") + (sphere ? "sphere" : "cylinder") + (Dim == 2 ? " section" : " solid") +
              ", nu = " + std::to_string(nu).substr(0, 6),
          [=] { return wall.mesh<Dim>(0.5, H / 3.0, H / 3.0); },
          {.axisymmetric = Dim == 2, .spacing = H, .dilatation = averaged_if(nu > 0.4)},
          {.material = LinearElastic(wall.material), .plane = Dim == 2 ? Plane::axisymmetric : Plane::strain},
          planes,
          wall.loads<Dim>(),
          {[wall](const Vec<Dim>& x) { return wall.displacement<Dim>(x); },
           [wall](const Vec<Dim>& x) { return wall.stress<Dim>(x); }}};
}

Problem<2> inclusion(double H, double ratio) {
  static const bench::Inclusion body10(1.0, 1.0, 10.0), body1000(1.5, 0.5, 1000.0);
  const bench::Inclusion& body = ratio == 10.0 ? body10 : body1000;
  return {"inclusion " + std::to_string(static_cast<int>(ratio)) + ", H = " + std::to_string(H).substr(0, 4),
          [&body, H] { return FineMesh<2>(cut_regions<2>(body.mesh(H / 5.0))); },
          {.spacing = H},
          body.model(Essential::nitsche),
          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          body.loads(),
          body.exact()};
}

template <int TenThousandths> Problem<3> cavity(double H, int order, double mesh_ratio) {
  using Cavity = bench::CavityIn<TenThousandths>;
  return {"cavity nu = " + std::to_string(Cavity::material.nu).substr(0, 6) + " order " + std::to_string(order) +
              ", H = " + std::to_string(H).substr(0, 4),
          [=] { return Cavity::mesh(H / mesh_ratio); },
          {.order = order, .spacing = H, .dilatation = averaged_if(Cavity::material.nu > 0.4)},
          {.material = LinearElastic(Cavity::material)},
          {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
          Cavity::loads(),
          {Cavity::displacement, Cavity::stress}};
}

Problem<2> holes() {
  return {
      "160 holes, energy",
      [] { return triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, 0.05), {.size = 0.05}); },
      {.spacing = 0.2},
      {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
      {.tractions = {tension<2>("right", 1.0)}, .body_force = {}},
      {},
      [](const Approximation<2>&, const Solution<2>& solution) { return solution.strain_energy; }};
}

template <int Dim> std::function<double(const Approximation<Dim>&, const Solution<Dim>&)> modulus(Index pixels) {
  return [pixels](const Approximation<Dim>&, const Solution<Dim>& solution) {
    return 2.0 * solution.strain_energy / (1e-4 * std::pow(pixels, Dim));
  };
}

Problem<2> image(double H, double size, double simplify) {
  constexpr Index pixels = 256;
  const auto label = keep_largest(random_spheres<2>(pixels, {.porosity = 0.3, .r_min = 4.0, .r_max = 10.0})).image;
  return {"image, graded H = " + std::to_string(H).substr(0, 3) + ", h = " + std::to_string(size).substr(0, 3),
          [=] {
            return FineMesh<2>(mesh_image<2>(label, {.size = size, .contour = Contour::smooth, .simplify = simplify}));
          },
          {.spacing = H, .grading = {.features = true}},
          {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
          {symmetry_plane<2>("left"),
           symmetry_plane<2>("bottom"),
           {"right", {[](const Vec<2>&) { return 0.01 * pixels; }, nullptr}, nullptr}},
          {},
          {},
          modulus<2>(pixels)};
}

Problem<3> block(double H) {
  constexpr Index voxels = 64;
  const auto label = keep_largest(random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
  DisplacementCondition<3> pulled{"top", {}, [](const Vec<3>&) { return 0.01 * voxels; }};
  return {"block, H = " + std::to_string(H).substr(0, 4),
          [=] { return FineMesh<3>(mesh_image<3>(label, {.size = 2.5})); },
          {.spacing = H},
          {.material = LinearElastic(1.0, 0.3)},
          {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom"), pulled},
          {},
          {},
          modulus<3>(voxels)};
}

}  // namespace

int main(int argc, char** argv) {
  const Wanted wanted{argc > 1 ? argv[1] : "all", argc > 3 ? argv[3] : "all", argc > 2 ? std::atoi(argv[2]) : 3};
  set_num_threads(1);
  std::printf(
      "| problem | secondary basis, M/N | nodes | M/N | displacement, L2 (or number) | energy norm | recovered | "
      "approximation [s] | assembly, solution [s] |\n|---|---|---|---|---|---|---|---|---|\n");
  for (const int order : {1, 2})
    for (const int mesh_ratio : {3, 4, 6, 8})
      for (const double H : {0.8, 0.4, 0.2, 0.1, 0.05}) run(kirsch(H, order, mesh_ratio), wanted);
  for (const double nu : {0.3, 0.4999, 0.499999}) run(cook(nu), wanted);
  for (const bool sphere : {false, true})
    for (const double nu : {0.3, 0.4999}) run(lame<2>(sphere, nu), wanted);
  run(lame<3>(false, 0.3), wanted);
  for (const double ratio : {10.0, 1000.0})
    for (const double H : {0.4, 0.1}) run(inclusion(H, ratio), wanted);
  for (const int order : {1, 2})
    for (const double H : {0.56, 0.4, 0.28}) run(cavity<3000>(H, order, order == 1 ? 5.0 : 3.0), wanted);
  run(cavity<4999>(0.4, 1, 5.0), wanted);
  run(holes(), wanted);
  for (const double H : {10.0, 5.0}) {
    run(image(H, 1.0, 0.0), wanted);
    run(image(H, 4.0, 0.5), wanted);
  }
  for (const double H : {12.0, 8.0, 6.0}) run(block(H), wanted);
}
