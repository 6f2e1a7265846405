// SPDX-License-Identifier: GPL-3.0-or-later
/// Corrections where the dilatation is averaged (B-bar), against closed forms and Cook's deflection: iterations,
/// errors.
///
///   bench_incompressible [part of a case's name = all] [H/h = 4] [iterations = 100] [folder of the real files]
#include "cavity.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "kirsch.hpp"
#include "lame.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <numbers>
#include <string>

using namespace efree;
using namespace efree::bench;

namespace {

template <int Dim> struct Problem {
  FineMesh<Dim> mesh;
  double h;
  ElasticModel model;
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;
  ExactSolution<Dim> exact{};
};

template <int Dim>
std::string errors_text(const Problem<Dim>& problem, const Approximation<Dim>& basis, const Points<Dim>& coefficients) {
  const auto solution = evaluate(basis, problem.model, coefficients);
  const auto fields = recover_fields(basis, solution);
  const auto materials = materials_of(problem.model, problem.mesh);
  char text[200];
  if (problem.exact.stress) {
    const Errors e = errors_against<Dim>(basis, fields, materials, problem.exact);
    const double said = recovery_error(basis, fields, materials).relative;
    std::snprintf(text, sizeof text, "%.2e, %.2e, %.2e (said %.2f)", *e.l2_displacement, *e.energy_norm,
                  *e.energy_norm_recovered, said / *e.energy_norm);
  } else {
    std::snprintf(text, sizeof text, "E %.5f, said %.2e", solution.strain_energy,
                  recovery_error(basis, fields, materials).relative);
  }
  return text;
}

template <int Dim> void study(const std::string& name, double nu, const Problem<Dim>& problem, double ratio, int most) {
  const bool axisymmetric = problem.model.plane == Plane::axisymmetric && Dim == 2;
  auto cloud = approximate<Dim>(
      problem.mesh, {.axisymmetric = axisymmetric, .spacing = ratio * problem.h, .dilatation = Dilatation::averaged});
  const auto solution = ElasticSolver<Dim>(cloud, problem.model, problem.supports).solve(problem.loads);
  const Approximation<Dim> functions = cloud.space.degree() == 2 ? cloud : in_quadratic_space(cloud);
  const Points<Dim> start = interpolate(functions.shape, solution.coefficients);
  const std::clock_t begin = std::clock();
  const Corrector<Dim> corrector(functions, problem.model, problem.supports);
  const double setup = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  const std::clock_t iterations = std::clock();
  const auto corrected = corrector.correct(start, problem.loads, {.iterations = most});
  const double seconds =
      static_cast<double>(std::clock() - iterations) / CLOCKS_PER_SEC / (static_cast<double>(corrected.taken.size()));
  std::vector<double> left(corrected.taken.size());
  double sum = 0.0;
  for (std::size_t k = left.size(); k-- > 0;) left[k] = std::sqrt(sum), sum += corrected.taken[k];
  const auto to = [&](double error) {
    return static_cast<int>(std::ranges::find_if(left, [&](double one) { return one < error; }) - left.begin());
  };
  std::printf(
      "%s nu %g: %d cells, %d dofs, %d nodes; start %.3g, coarse %.3g; to 1%% %d, 1e-3 %d, 1e-6 %d; set-up %.2f, one "
      "%.3f s\n",
      name.c_str(), nu, problem.mesh.num_cells(), functions.space.size(), static_cast<int>(cloud.nodes.cols()),
      corrected.start_error, left[0], to(0.01), to(1e-3), to(1e-6), setup, seconds);
  std::printf("    said of true error:");
  for (int k = 1; k < most && left[k] > 1e-6; k *= 2)
    std::printf(" %d: %.2f", k, corrector.correct(start, problem.loads, {.iterations = k}).error / left[k]);
  const auto open = corrector.correct(start, problem.loads);
  std::printf("; open: %d, error %.2e", open.iterations, open.error);
  if (open.iterations < most) std::printf(" (%.2f)", open.error / left[open.iterations]);
  std::printf("\n");
  std::printf("    cloud: %s\n", errors_text(problem, cloud, solution.coefficients).c_str());
  const auto elements =
      approximate<Dim>(problem.mesh, {.kind = BasisKind::p2,
                                      .axisymmetric = axisymmetric,
                                      .dilatation = averaged_if(takes_mean_dilatation(cloud, problem.model))});
  std::printf("    corrected: %s, left %.1e\n", errors_text(problem, elements, corrected.displacement).c_str(),
              corrected.error);
  if (functions.space.size() < 60000) {
    ElasticModel strong = problem.model;
    strong.essential = Essential::strong;
    for (const bool dilatation : {false, true}) {
      const auto basis = approximate<Dim>(
          problem.mesh, {.kind = BasisKind::p2, .axisymmetric = axisymmetric, .dilatation = averaged_if(dilatation)});
      const auto u = ElasticSolver<Dim>(basis, strong, problem.supports).solve(problem.loads).coefficients;
      std::printf("    %s: %s\n", dilatation ? "P2-P0" : "P2   ", errors_text(problem, basis, u).c_str());
    }
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string wanted = argc > 1 ? argv[1] : "all";
  const double ratio = argc > 2 ? std::atof(argv[2]) : 4.0;
  const int most = argc > 3 ? std::atoi(argv[3]) : 100;
  const std::filesystem::path folder = argc > 4 ? argv[4] : "";
  const auto run = [&](const std::string& name, double nu, const auto& make) {
    if (wanted == "all" || name.find(wanted) != std::string::npos) study(name, nu, make(), ratio, most);
  };
  const auto all = [&]<int ten_thousandths>() {
    constexpr double nu = ten_thousandths / 1e4;
    run("cylinder", nu, [&] {
      const ThickWall wall{false, {1.0, nu}};
      const double h = 0.05;
      return Problem<2>{wall.mesh<2>(1.0, h, h),
                        h,
                        {.material = LinearElastic(wall.material), .plane = Plane::axisymmetric},
                        {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")},
                        wall.loads<2>(),
                        {[=](const Vec<2>& x) { return wall.displacement<2>(x); },
                         [=](const Vec<2>& x) { return wall.stress<2>(x); }}};
    });
    run("cook", nu, [&] {
      const double h = 1.0;
      return Problem<2>{triangulate(shapes::cook(), {.size = h}),
                        h,
                        {.material = LinearElastic(240.565, nu), .plane = Plane::strain},
                        {clamp<2>("left")},
                        {{{"right",
                           [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                             return {0.0, 1.0 / 16.0};
                           }}},
                         {}}};
    });
    run("plate", nu, [&] {
      const double h = 0.05;
      return Problem<2>{Kirsch::mesh(h),
                        h,
                        {.material = LinearElastic(1.0, nu), .plane = Plane::strain},
                        {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                        Kirsch::loads()};
    });
    for (const double h : {0.3, 0.15})
      run(h == 0.3 ? "cavity coarse" : "cavity fine", nu, [&] {
        using Cavity = CavityIn<ten_thousandths>;
        return Problem<3>{Cavity::mesh(h),
                          h,
                          {.material = LinearElastic(Cavity::material)},
                          {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                          Cavity::loads(),
                          {Cavity::displacement, Cavity::stress}};
      });
    if (!folder.empty())
      run("liver", nu, [&] {
        auto analysis = std::get<Case<3>>(read_case(folder / "liver.toml"));
        analysis.common.model.material = LinearElastic(1.0, nu);
        const double h = mesh_size(analysis.geometry, analysis.common);
        auto made = prepare(analysis);
        ElasticModel model = analysis.common.model;
        model.regions = made.materials;
        return Problem<3>{*made.mesh, h, model, analysis.supports, analysis.loads};
      });
  };
  all.operator()<3000>();
  all.operator()<4500>();
  all.operator()<4900>();
  all.operator()<4990>();
  all.operator()<4999>();
}
