// SPDX-License-Identifier: GPL-3.0-or-later
/// Corrections towards the finite elements of the fine mesh: iterations, and estimated errors against true ones.
///
///   bench_correction iterations  [part of a case's name = all] [H/h = 4] [folder of the real files]
///   bench_correction effectivity [part = all] [H/h = 4] [folder]   of (a), what is said of cloud and corrections
///   bench_correction recovery    [part = all] [1 or 2 = 2] [folder]  of (b), what is said of the finite elements
///
/// Cases of "shared nodes" are solved by finite elements alone, whose regions share nodes.
/// The real files are fetched by examples/real_files/run; without their folder elephant and assembly are left out.
#include "efree/solvers/algorithms/correction.hpp"
#include "cavity.hpp"
#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"
#include "gyroid.hpp"
#include "inclusion.hpp"
#include "kirsch.hpp"
#include "layers.hpp"
#include "refined.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
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
  bool dilatation = false;
};

/// The answer of a cloud, and what corrects it.
template <int Dim> struct Answer {
  Approximation<Dim> cloud;
  Points<Dim> displacement;  ///< at the fine degrees of freedom
  Corrector<Dim> corrector;

  Answer(const Problem<Dim>& problem, ApproximationOptions options)
      : cloud(approximate<Dim>(problem.mesh, with(problem, options))),
        displacement(interpolate(
            cloud.shape, ElasticSolver<Dim>(cloud, problem.model, problem.supports).solve(problem.loads).coefficients)),
        corrector(cloud, problem.model, problem.supports) {}

 private:
  static ApproximationOptions with(const Problem<Dim>& problem, ApproximationOptions options) {
    options.axisymmetric = problem.model.plane == Plane::axisymmetric;
    options.dilatation = averaged_if(problem.dilatation);
    return options;
  }
};

/// Errors left, relative, after 0, 1, ... iterations.
std::vector<double> errors_left(const std::vector<double>& taken) {
  std::vector<double> left(taken.size());
  double sum = 0.0;
  for (std::size_t k = left.size(); k-- > 0;) left[k] = std::sqrt(sum), sum += taken[k];
  return left;
}

template <int Dim> void count_iterations(const std::string& name, const Problem<Dim>& problem, double ratio) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Answer<Dim> answer(problem, {.spacing = ratio * problem.h, .seed = seed});
    const auto to = [&](double error) {
      const std::clock_t start = std::clock();
      const auto one = answer.corrector.correct(answer.displacement, problem.loads, {.tolerance = error});
      return std::pair{one, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC};
    };
    const auto [usual, usual_seconds] = to(0.01);
    const auto [converged, seconds] = to(1e-6);
    std::printf("| %s | %d | %d | %g | %d | %td | %.3g | %d | %.2f | %d | %.2f |\n", name.c_str(), Dim,
                answer.cloud.space.degree(), ratio, answer.cloud.space.size(), answer.cloud.nodes.cols(),
                converged.start_error, usual.iterations, usual_seconds, converged.iterations, seconds);
    std::fflush(stdout);
  }
}

template <int Dim> void effectivity(const std::string& name, const Problem<Dim>& problem, double ratio) {
  for (const int order : {1, 2}) {
    double least_cloud = 1e9, most_cloud = 0.0, least_left = 1e9, most_left = 0.0, error = 0.0;
    for (const std::uint64_t seed : {1, 2, 3}) {
      const Answer<Dim> answer(problem, {.order = order, .spacing = ratio * problem.h, .seed = seed});
      const auto converged = answer.corrector.correct(answer.displacement, problem.loads, {.iterations = 40});
      const auto left = errors_left(converged.taken);
      error = std::max(error, converged.start_error);
      for (int k = 1; k <= 6 && left[k] > 1e-7; ++k) {
        const auto some = answer.corrector.correct(answer.displacement, problem.loads, {.iterations = k});
        if (k == 2) {
          least_cloud = std::min(least_cloud, some.start_error / converged.start_error);
          most_cloud = std::max(most_cloud, some.start_error / converged.start_error);
        }
        least_left = std::min(least_left, some.error / left[k]);
        most_left = std::max(most_left, some.error / left[k]);
      }
    }
    std::printf("| %s | %d | %d | %.3g | %.3f to %.3f | %.2f to %.2f |\n", name.c_str(), Dim, order, error, least_cloud,
                most_cloud, least_left, most_left);
    std::fflush(stdout);
  }
}

/// The finite elements of a mesh: energy, and error as recovery says it.
struct Elements {
  double energy, recovery;
};
template <int Dim>
Elements finite_elements(const Problem<Dim>& problem, int degree, bool recover, double tolerance = 1e-5) {
  const auto elements = approximate<Dim>(problem.mesh, {.kind = degree == 1 ? BasisKind::p1 : BasisKind::p2,
                                                        .axisymmetric = problem.model.plane == Plane::axisymmetric});
  const auto recovered = [&](const Solution<Dim>& solution) {
    return recovery_error(elements, recover_fields(elements, solution), materials_of(problem.model, problem.mesh))
        .relative;
  };
  if (shares_vertices(problem.mesh)) {
    const auto solution = ElasticSolver<Dim>(elements, problem.model, problem.supports).solve(problem.loads);
    return {solution.strain_energy, recover ? recovered(solution) : 0.0};
  }
  const auto linear =
      approximate<Dim>(problem.mesh, {.interpolation = 1, .spacing = (Dim == 2 ? 8.0 : 5.0) * problem.h});
  const auto cloud = degree == 1 ? linear : in_quadratic_space(linear);
  const auto corrected =
      Corrector<Dim>(cloud, problem.model, problem.supports)
          .correct(Points<Dim>::Zero(Dim, cloud.space.size()), problem.loads, {.tolerance = tolerance});
  if (!recover) return {corrected.strain_energy, 0.0};
  return {corrected.strain_energy, recovered(evaluate(elements, problem.model, corrected.displacement))};
}

/// True errors from the energy of quadratic cells on the mesh refined `times` times, extrapolated.
template <int Dim> void recovery(const std::string& name, const Problem<Dim>& problem, int times) {
  // Factors of quadratic elements in space, without a cloud, take more memory than a second refinement is worth.
  if (Dim == 3 && shares_vertices(problem.mesh)) times = 1;
  const Elements linear = finite_elements(problem, 1, true), quadratic = finite_elements(problem, 2, true);
  std::vector<double> energies{quadratic.energy};
  Problem<Dim> finer = problem;
  for (int k = 0; k < times; ++k) {
    finer.mesh = refined(finer.mesh);
    finer.h *= 0.5;
    energies.push_back(finite_elements(finer, 2, false, Dim == 2 ? 1e-5 : 1e-3).energy);
  }
  // Between an eighth, quite smooth, and a half, at a crack, if it cannot be seen.
  double share = 0.25;
  const auto n = energies.size();
  const double last = energies[n - 1] - energies[n - 2];
  if (n > 2) share = std::clamp(last / (energies[n - 2] - energies[n - 3]), 0.05, 0.6);
  const double exact = energies.back() + last * share / (1.0 - share);
  const auto error = [&](double energy) { return std::sqrt(std::abs(exact - energy) / exact); };
  std::printf("| %s | %d | %d | %.2f | %.3g | %.2f | %.3g | %.2f |\n", name.c_str(), Dim, problem.mesh.num_cells(),
              share, error(linear.energy), linear.recovery / error(linear.energy), error(quadratic.energy),
              quadratic.recovery / error(quadratic.energy));
}

ElasticModel plane_stress(double nu = 0.3) {
  return {.material = LinearElastic(1.0, nu), .plane = Plane::stress};
}
DisplacementCondition<2> moved(const char* on, double x, double y) {
  return {on, {[x](const Vec<2>&) { return x; }, [y](const Vec<2>&) { return y; }}, nullptr};
}

FineMesh<2> slit_plate(double h) {
  PlanarDomain domain = shapes::rectangle(-1.0, -1.0, 1.0, 1.0);
  domain.slits.push_back({"slit", {{-0.4, 0.0}, {0.4, 0.1}}});
  return triangulate(domain, {.size = h});
}

/// A cube of an image between sliding planes, its top moved by one per cent.
Problem<3> pulled(const LabelImage<3>& image, double size, double h) {
  const double height = image.size[2];
  return {FineMesh<3>(keep_largest(mesh_image<3>(image, {.size = size})).mesh),
          h,
          {.material = LinearElastic(1.0, 0.3)},
          {symmetry_plane<3>("left"),
           symmetry_plane<3>("front"),
           symmetry_plane<3>("bottom"),
           {"top", {}, [=](const Vec<3>&) { return 0.01 * height; }}},
          {}};
}

/// A case file of examples/real_files on a mesh of this size, 0: its own.
Problem<3> real_file(const std::filesystem::path& file, double size) {
  auto analysis = std::get<Case<3>>(read_case(file));
  if (size > 0.0) analysis.geometry.size = size;
  auto made = prepare(analysis);
  ElasticModel model = analysis.common.model;
  model.regions = made.materials;
  model.open_interface = made.open_interface;
  return {*made.mesh, made.size, model, analysis.supports, analysis.loads};
}

const Inclusion stiff(1.0, 0.6, 1000.0), soft(1.0, 0.6, 0.001);

/// Bodies in the plane; c: how many times coarser.
template <class Run> void run_plane_cases(const Run& run, const std::string& mode, double c) {
  run("plate", [&] {
    return Problem<2>{Kirsch::mesh(0.05 * c),
                      0.05 * c,
                      {.material = LinearElastic(Kirsch::material), .plane = Plane::stress},
                      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                      Kirsch::loads()};
  });
  run("slit", [&] {
    return Problem<2>{
        slit_plate(0.02 * c), 0.02 * c, plane_stress(), {clamp<2>("bottom")}, {{tension<2>("top", 1.0)}, {}}};
  });
  run("L", [&] {
    return Problem<2>{triangulate(shapes::l_shape(1.0), {.size = 0.02 * c}),
                      0.02 * c,
                      plane_stress(),
                      {clamp<2>("top")},
                      {{}, [](const Vec<2>&) -> Vec<2> {
                         return {0.0, -1.0};
                       }}};
  });
  run("Cook", [&] {
    return Problem<2>{triangulate(shapes::cook(), {.size = c}),
                      c,
                      {.material = LinearElastic(1.0, 1.0 / 3.0), .plane = Plane::strain},
                      {clamp<2>("left")},
                      {{{"right",
                         [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                           return {0.0, 1.0};
                         }}},
                       {}}};
  });
  run("160 holes", [&] {
    return Problem<2>{
        triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, 0.05), {.size = 0.05 * c}),
        0.05 * c,
        plane_stress(),
        {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
        {{tension<2>("right", 1.0)}, {}}};
  });
  for (const Inclusion* inclusion : {&stiff, &soft})
    run(inclusion == &stiff ? "inclusion 1000 : 1" : "inclusion 1 : 1000", [&] {
      return Problem<2>{FineMesh<2>(cut_regions(inclusion->mesh(0.04 * c))),
                        0.04 * c,
                        inclusion->model(Essential::nitsche),
                        {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                        inclusion->loads()};
    });
  run("porous image", [&] {
    const auto image =
        keep_largest(random_spheres<2>(mode == "recovery" ? 128 : 256, {.porosity = 0.35, .r_min = 3.0, .r_max = 12.0}))
            .image;
    return Problem<2>{FineMesh<2>(mesh_image<2>(image, {.size = 1.5})),
                      1.5,
                      plane_stress(),
                      {moved("left", 0.0, 0.0), moved("right", 1.0, 0.0)},
                      {}};
  });
  if (mode != "recovery")
    run("slivers of 0.1 degree", [&] {
      return Problem<2>{testing::with_split_cells(triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.02}), 0.003),
                        0.02,
                        plane_stress(),
                        {clamp<2>("left")},
                        {{tension<2>("right", 1.0)}, {}}};
    });
}

/// Bodies in space.
template <class Run> void run_space_cases(const Run& run, const std::string& mode, double c) {
  run("cavity", [&] {
    return Problem<3>{Cavity::mesh(0.15 * c),
                      0.15 * c,
                      {.material = LinearElastic(Cavity::material)},
                      {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                      Cavity::loads()};
  });
  if (mode != "recovery")
    run("flat cells of half a degree", [&] {
      return Problem<3>{testing::with_sides(testing::with_flat_cells(testing::box(16), 0.5)),
                        1.0 / 16,
                        {.material = LinearElastic(1.0, 0.3)},
                        {clamp<3>("left")},
                        {{tension<3>("right", 1.0)}, {}}};
    });
  const double lattice = mode == "recovery" ? 3.0 : 2.0;
  run("block", [&] {
    const auto spheres =
        random_spheres<3>(mode == "iterations" ? 64 : 32, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0});
    return pulled(keep_largest(spheres).image, lattice, 1.3 * lattice);
  });
  run("gyroid", [&] { return pulled(gyroid_labels(mode == "iterations" ? 64 : 32), lattice, 1.3 * lattice); });
}

/// Bodies of two materials whose regions share nodes.
template <class Run> void run_shared_node_cases(const Run& run) {
  for (const double ratio : {1000.0, 0.001}) {
    const std::string moduli = ratio > 1.0 ? "1000 : 1" : "1 : 1000";
    const ElasticModel two{.material = {},
                           .plane = Plane::stress,
                           .essential = Essential::strong,
                           .regions = {LinearElastic(1.0, 0.3), LinearElastic(ratio, 0.3)}};
    for (const double h : {0.2, 0.1})
      run("shared nodes, inclusion " + moduli, [&] {
        const Inclusion& inclusion = ratio > 1.0 ? stiff : soft;
        return Problem<2>{FineMesh<2>(inclusion.mesh(h)),
                          h,
                          inclusion.model(Essential::strong),
                          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                          inclusion.loads()};
      });
    run("shared nodes, sandwich " + moduli, [&] {
      return Problem<2>{FineMesh<2>(layers({0.0, 0.0}, {8.0, 1.0}, 1, {0.25, 0.75}, 0.1)),
                        0.1,
                        two,
                        {clamp<2>("left")},
                        {{}, [](const Vec<2>&) -> Vec<2> {
                           return {0.0, -1.0};
                         }}};
    });
    run("shared nodes, ball " + moduli, [&] {
      return Problem<3>{testing::with_sides(with_ball(testing::box(8, 0.0))),
                        0.125,
                        two,
                        {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                        {{tension<3>("top", 1.0)}, {}}};
    });
  }
}

/// Whether there is a table of that name; prints its first lines.
bool print_table_head(const std::string& mode) {
  if (mode == "iterations")
    std::printf(
        "| case | dimensions | degree | H/h | fine degrees | nodes | error of the cloud | iterations to 1 %% | CPU [s] "
        "| "
        "to 1e-6 | CPU [s] |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
  else if (mode == "effectivity")
    std::printf(
        "| case | dimensions | order | error of the cloud | estimate / truth: cloud, after 2 iterations | left, after "
        "1 to 6 |\n|---|---|---|---|---|---|\n");
  else if (mode == "recovery")
    std::printf(
        "| case | dimensions | cells | squared error kept by halving | error of P1 | estimate / truth | error of P2 | "
        "estimate / truth |\n|---|---|---|---|---|---|---|---|\n");
  else
    return false;
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "", wanted = argc > 2 ? argv[2] : "all";
  const double number = argc > 3 ? std::atof(argv[3]) : mode == "recovery" ? 2.0 : 4.0;
  const std::filesystem::path folder = argc > 4 ? argv[4] : "";
  if (!print_table_head(mode))
    return std::fprintf(stderr, "bench_correction iterations | effectivity | recovery [case] [number] [folder]\n"), 1;
  // Reference solutions of quadratic cells need coarser meshes to begin with.
  const double c = mode == "recovery" ? 2.0 : 1.0;
  const auto run = [&](const std::string& name, const auto& make) {
    if (wanted != "all" && name.find(wanted) == std::string::npos) return;
    const auto problem = make();
    if (mode == "iterations")
      count_iterations(name, problem, number);
    else if (mode == "effectivity")
      effectivity(name, problem, number);
    else
      recovery(name, problem, static_cast<int>(number));
    std::fflush(stdout);
  };
  run_plane_cases(run, mode, c);
  run_space_cases(run, mode, c);
  if (mode == "recovery") run_shared_node_cases(run);
  if (folder.empty()) std::fprintf(stderr, "the real files are left out: no folder of theirs\n");
  const std::map<std::string, double> sizes{
      {"elephant", 0.02}, {"assembly", 6.0}, {"holder", 0.0}, {"lever", 0.0}, {"turbine", 0.0}};
  for (const auto& [name, size] : sizes)
    if (!folder.empty()) run(name, [&] { return real_file(folder / (name + ".toml"), c * size); });
}
