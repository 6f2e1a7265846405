// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of displacements at points and of reactions: as dual solutions say them against true ones.
///
///   bench_dual [part of a case's name = all]
///
/// By case, functional and degree of the elements: true error relative to the value; over it the estimate as it is
/// reported (functional_error), the signed sum of the cells' products of recovered differences, the sum of what these
/// could be, and the product of the two norms. Truth: quadratic elements on meshes of the same polygons refined twice
/// (in space once), extrapolated.
#include "cavity.hpp"
#include "clock.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "inclusion.hpp"
#include "kirsch.hpp"
#include "layers.hpp"
#include "refined.hpp"

#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <string>

using namespace efree;
using namespace efree::bench;

namespace {

/// A displacement at a point, or the reaction of a part, along an axis.
template <int Dim> struct Wanted {
  std::string name;
  std::string part;
  Vec<Dim> at;
  int axis;
};

template <int Dim> struct Problem {
  FineMesh<Dim> mesh;
  double h;
  ElasticModel model;
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;
  std::vector<Wanted<Dim>> wanted;
};

struct Found {
  double value, reported, signed_error, local, norms, seconds_u, seconds_z;
};

template <int Dim> std::vector<Found> find(const Problem<Dim>& problem, int degree, bool estimated, double tolerance) {
  const bool axisymmetric = problem.model.plane == Plane::axisymmetric;
  const auto elements = approximate<Dim>(
      problem.mesh, {.kind = degree == 1 ? BasisKind::p1 : BasisKind::p2, .axisymmetric = axisymmetric});
  Approximation<Dim> cloud;
  if (!shares_vertices(problem.mesh)) {
    cloud = approximate<Dim>(
        problem.mesh,
        {.axisymmetric = axisymmetric, .interpolation = 1, .spacing = (Dim == 2 ? 8.0 : 5.0) * problem.h});
    if (degree == 2) cloud = in_quadratic_space(cloud);
  }
  const double begin = cpu_seconds();
  // One of them: corrections from a cloud, or the elements' own factor where there can be no cloud.
  std::optional<Corrector<Dim>> corrector;
  std::optional<ElasticSolver<Dim>> solver;
  Solution<Dim> u;
  if (shares_vertices(problem.mesh)) {
    u = solver.emplace(elements, problem.model, problem.supports).solve(problem.loads);
  } else {
    corrector.emplace(cloud, problem.model, problem.supports);
    u = evaluate(elements, problem.model,
                 corrector->correct(Points<Dim>::Zero(Dim, cloud.space.size()), problem.loads, {.tolerance = tolerance})
                     .displacement);
  }
  const auto respond = [&](const Functional<Dim>& functional) {
    if (solver)
      return std::pair(solver->duals({functional}).front(), solver->value(functional, u.coefficients, problem.loads));
    auto z = corrector->duals({functional}, {.tolerance = tolerance}).front().displacement;
    const double value = corrector->value(functional, z, u.coefficients, problem.loads);
    return std::pair(std::move(z), value);
  };
  const auto materials = materials_of(problem.model, problem.mesh);
  const auto fields_of = [&](const Points<Dim>& of) {
    return recover_fields(elements, evaluate(elements, problem.model, of));
  };
  const auto fields = estimated ? recover_fields(elements, u) : Fields<Dim>{};
  const double own = estimated ? std::sqrt(recovery_products(elements, fields, fields, materials).sum()) : 0.0;
  const double seconds_u = cpu_seconds() - begin;
  std::vector<Found> found;
  for (const auto& wanted : problem.wanted) {
    const double start = cpu_seconds();
    const Vec<Dim> along = Vec<Dim>::Unit(wanted.axis);
    const auto functional = wanted.part.empty() ? displacement_at<Dim>(elements.space, wanted.at, along)
                                                : reaction_of<Dim>(elements.space, problem.supports,
                                                                   tied_facets(problem.mesh), wanted.part, along);
    const auto [z, value] = respond(functional);
    Found here{value, 0.0, 0.0, 0.0, 0.0, seconds_u, 0.0};
    if (estimated) {
      const auto dual = fields_of(z);
      here.reported = functional_error(elements, fields, dual, materials);
      here.seconds_z = cpu_seconds() - start;
      here.signed_error = recovery_products(elements, fields, dual, materials).sum();
      here.local = recovery_products(elements, fields, fields, materials)
                       .cwiseProduct(recovery_products(elements, dual, dual, materials))
                       .cwiseSqrt()
                       .sum();
      here.norms = own * std::sqrt(recovery_products(elements, dual, dual, materials).sum());
    }
    found.push_back(here);
  }
  return found;
}

template <int Dim> void compare(const std::string& name, const Problem<Dim>& problem) {
  const int times = Dim == 2 ? 2 : 1;
  const std::vector<Found> estimates[] = {find(problem, 1, true, 1e-4), find(problem, 2, true, 1e-4)};
  std::vector<std::vector<Found>> finer{estimates[1]};
  Problem<Dim> refined_problem = problem;
  for (int k = 0; k < times; ++k) {
    refined_problem.mesh = refined(refined_problem.mesh);
    refined_problem.h *= 0.5;
    finer.push_back(find(refined_problem, 2, false, Dim == 2 ? 1e-6 : 1e-4));
  }
  for (std::size_t w = 0; w < problem.wanted.size(); ++w) {
    const auto n = finer.size();
    double share = 0.25;
    const double last = finer[n - 1][w].value - finer[n - 2][w].value;
    if (n > 2) {
      const double ratio = last / (finer[n - 2][w].value - finer[n - 3][w].value);
      share = std::isfinite(ratio) ? std::clamp(ratio, 0.05, 0.6) : 0.0;
    }
    const double exact = finer[n - 1][w].value + last * share / (1.0 - share);
    for (int degree : {1, 2}) {
      const Found& e = estimates[degree - 1][w];
      const double truth = exact - e.value, size = std::abs(exact);
      std::printf("| %s | %s | %d | %.4g | %.2g | %.2f | %.2f | %.2f | %.2f | %.2g %.2g |\n", name.c_str(),
                  problem.wanted[w].name.c_str(), degree, exact, 100.0 * truth / size, e.reported / std::abs(truth),
                  e.signed_error / truth, e.local / std::abs(truth), e.norms / std::abs(truth), e.seconds_u,
                  e.seconds_z);
    }
  }
  std::fflush(stdout);
}

ElasticModel plane_stress(double nu = 0.3) {
  return {.material = LinearElastic(1.0, nu), .plane = Plane::stress};
}
DisplacementCondition<2> moved(const char* on, double x, double y) {
  return {on, {[x](const Vec<2>&) { return x; }, [y](const Vec<2>&) { return y; }}, nullptr};
}
template <int Dim> TractionCondition<Dim> pull(const char* on, const Vec<Dim>& t) {
  return {on, [t](const Vec<Dim>&, const Vec<Dim>&) { return t; }};
}

/// Of one material, in the plane.
template <class Run> void run_plane_cases(const Run& run) {
  for (const double h : {0.4, 0.2, 0.1})
    run("plate", [&] {
      return Problem<2>{Kirsch::mesh(h),
                        h,
                        {.material = LinearElastic(Kirsch::material), .plane = Plane::stress},
                        {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                        Kirsch::loads(),
                        {{"u_x hole", "", {1.0, 0.0}, 0},
                         {"u_y hole", "", {0.0, 1.0}, 1},
                         {"u_x corner", "", {Kirsch::half_width, Kirsch::half_width}, 0},
                         {"u_x inside", "", {2.03, 1.51}, 0},
                         {"R_x left", "left", {}, 0},
                         {"R_y bottom", "bottom", {}, 1}}};
    });
  for (const double h : {0.1, 0.05})
    run("slit", [&] {
      PlanarDomain domain = shapes::rectangle(-1.0, -1.0, 1.0, 1.0);
      domain.slits.push_back({"slit", {{-0.4, 0.0}, {0.4, 0.1}}});
      return Problem<2>{triangulate(domain, {.size = h}),
                        h,
                        plane_stress(),
                        {clamp<2>("bottom"), moved("top", 0.0, 1.0)},
                        {},
                        {{"u_y inside", "", {0.0, 0.5}, 1},
                         {"u_y near slit", "", {0.1, 0.2}, 1},
                         {"R_y top", "top", {}, 1},
                         {"R_x top", "top", {}, 0}}};
    });
  for (const double h : {0.1, 0.05})
    run("L", [&] {
      return Problem<2>{triangulate(shapes::l_shape(1.0), {.size = h}),
                        h,
                        plane_stress(),
                        {clamp<2>("top")},
                        {{},
                         [](const Vec<2>&) -> Vec<2> {
                           return {0.0, -1.0};
                         }},
                        {{"u_y tip", "", {1.0, 0.0}, 1},
                         {"u_x inside", "", {0.3, 0.2}, 0},
                         {"R_x top", "top", {}, 0},
                         {"R_y top", "top", {}, 1}}};
    });
  for (const double h : {6.0, 3.0})
    run("Cook", [&] {
      return Problem<2>{triangulate(shapes::cook(), {.size = h}),
                        h,
                        {.material = LinearElastic(1.0, 1.0 / 3.0), .plane = Plane::strain},
                        {clamp<2>("left")},
                        {{pull<2>("right", {0.0, 1.0})}, {}},
                        {{"u_y tip", "", {48.0, 60.0}, 1},
                         {"u_x tip", "", {48.0, 60.0}, 0},
                         {"u_y inside", "", {24.0, 30.0}, 1},
                         {"R_x left", "left", {}, 0},
                         {"R_y left", "left", {}, 1}}};
    });
  for (const double h : {0.5, 0.25})
    run("cantilever", [&] {
      return Problem<2>{triangulate(shapes::rectangle(0.0, 0.0, 10.0, 1.0), {.size = h}),
                        h,
                        plane_stress(),
                        {clamp<2>("left"), moved("right", 0.0, -1.0)},
                        {},
                        {{"u_y middle", "", {5.0, 0.5}, 1},
                         {"u_x quarter", "", {2.5, 0.0}, 0},
                         {"R_y right", "right", {}, 1},
                         {"R_x left", "left", {}, 0}}};
    });
}

/// Of two materials.
template <class Run> void run_inclusions(const Run& run) {
  static const Inclusion stiff(1.0, 0.6, 1000.0), soft(1.0, 0.6, 0.001);
  for (const Inclusion* inclusion : {&stiff, &soft})
    run(inclusion == &stiff ? "inclusion 1000 : 1" : "inclusion 1 : 1000", [&] {
      return Problem<2>{
          FineMesh<2>(cut_regions(inclusion->mesh(0.15))),
          0.15,
          inclusion->model(Essential::nitsche),
          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          inclusion->loads(),
          {{"u_x rim", "", {1.0, 0.0}, 0}, {"u_x inside", "", {0.3, 0.2}, 0}, {"R_x left", "left", {}, 0}}};
    });
  for (const Inclusion* inclusion : {&stiff, &soft})
    run(inclusion == &stiff ? "shared nodes, 1000 : 1" : "shared nodes, 1 : 1000", [&] {
      return Problem<2>{
          FineMesh<2>(inclusion->mesh(0.15)),
          0.15,
          inclusion->model(Essential::strong),
          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
          inclusion->loads(),
          {{"u_x rim", "", {1.0, 0.0}, 0}, {"u_x inside", "", {0.3, 0.2}, 0}, {"R_x left", "left", {}, 0}}};
    });
}

/// Bodies of revolution and in space.
template <class Run> void run_space_cases(const Run& run) {
  for (const double h : {0.12, 0.06})
    run("cylinder, section", [&] {
      return Problem<2>{
          triangulate(shapes::rectangle(1.0, 0.0, 2.0, 1.0), {.size = h}),
          h,
          {.material = LinearElastic(1.0, 0.3), .plane = Plane::axisymmetric},
          {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")},
          {{pressure<2>("left", [](const Vec<2>&) { return 1.0; })}, {}},
          {{"u_r inner", "", {1.0, 0.5}, 0}, {"u_r outer", "", {2.0, 0.5}, 0}, {"R_z top", "top", {}, 1}}};
    });
  for (const double h : {0.6, 0.3})
    run("cavity", [&] {
      return Problem<3>{Cavity::mesh(h),
                        h,
                        {.material = LinearElastic(Cavity::material)},
                        {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                        Cavity::loads(),
                        {{"u_z pole", "", {0.0, 0.0, 1.0}, 2},
                         {"u_z corner", "", Vec<3>::Constant(Cavity::half_width), 2},
                         {"u_x inside", "", {1.5, 1.2, 1.3}, 0},
                         {"R_z bottom", "bottom", {}, 2}}};
    });
  for (const double h : {0.5, 0.25})
    run("beam", [&] {
      return Problem<3>{FineMesh<3>(solids::box({4.0, 1.0, 1.0}, h)),
                        h,
                        {.material = LinearElastic(1.0, 0.3)},
                        {clamp<3>("left"), {"right", {nullptr, nullptr, [](const Vec<3>&) { return -1.0; }}, nullptr}},
                        {},
                        {{"u_z middle", "", {2.0, 0.5, 0.5}, 2},
                         {"u_x top", "", {2.0, 0.5, 1.0}, 0},
                         {"R_z right", "right", {}, 2},
                         {"R_z left", "left", {}, 2}}};
    });
}

}  // namespace

int main(int argc, char** argv) {
  const std::string part = argc > 1 ? argv[1] : "all";
  std::printf(
      "| case | functional | degree | value | true error [%%] | reported / truth | signed / truth | cell by cell / "
      "truth | "
      "norms / truth | CPU of u, of z [s] |\n|---|---|---|---|---|---|---|---|---|---|\n");
  const auto run = [&](const std::string& name, const auto& make) {
    if (part == "all" || name.find(part) != std::string::npos) compare(name, make());
  };
  run_plane_cases(run);
  run_inclusions(run);
  run_space_cases(run);
}
