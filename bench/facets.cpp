// SPDX-License-Identifier: GPL-3.0-or-later
/// What the faceted approximation of curved boundaries costs, and what is estimated of that.
///
///   bench_facets [part of a body's name = all]   effectivities of ShapeDerivative: quadratic elements on meshes of
///   more
///                               and more facets to a full turn; changes of the strain energy relative to it, by the
///                               derivative on these meshes, and true ones: of the exact solution (of the torus and the
///                               160 holes a reference of many facets) against the same polygons refined until their
///                               elements have converged. Then the root of their ratio (effectivity of
///                               Estimates::geometry), what the derivative leaves as a correction, and the effectivity
///                               of the whole estimate for the whole error.
///                               Those whose names begin with STL are given by triangles alone, so many to a full turn,
///                               and meshed with longest edges as in the name (surface_offsets).
///   bench_facets walls          a thin tube (radii 9.8 and 10) under pressure by sagitta over thickness: largest von
///                               Mises stress against Lame's, what is estimated of that, facets and seconds
#include "cavity.hpp"
#include "clock.hpp"
#include "efree/geometry/input/surface_offsets.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/solvers/algorithms/shape_derivative.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"
#include "efree/tests/geometry/surfaces.hpp"
#include "kirsch.hpp"
#include "lame.hpp"
#include "refined.hpp"

#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <numbers>
#include <string>
#include <vector>

using namespace efree;
using namespace efree::bench;

namespace {

constexpr double pi = std::numbers::pi;

template <int Dim> struct Body {
  std::string name;
  std::vector<int> turns;  ///< facets to a full turn
  std::function<CurvedMesh<Dim>(int turn)> mesh;
  ElasticModel model;
  std::vector<DisplacementCondition<Dim>> supports;
  Loads<Dim> loads;
  double energy = 0.0;  ///< true one; 0: of `reference` facets to a turn, corrected
  int reference = 0;
  int refinements = 2;  ///< of the polygons, for their own energy
};

template <int Dim> struct Answered {
  double energy, mesh_error, change, size, seconds;
  Index cells, facets;
};

template <int Dim> Answered<Dim> answer(const Body<Dim>& body, const FineMesh<Dim>& mesh, const Matrix& offsets) {
  const double start = cpu_seconds();
  const auto elements = approximate<Dim>(mesh, {.kind = BasisKind::p2});
  const auto solution = ElasticSolver<Dim>(elements, body.model, body.supports).solve(body.loads);
  const auto materials = materials_of(body.model, mesh);
  Answered<Dim> out{solution.strain_energy, 0.0, 0.0, 0.0, 0.0, mesh.num_cells(), 0};
  if (offsets.size() > 0) {
    const auto fields = recover_fields(elements, solution);
    out.mesh_error = recovery_error(elements, fields, materials).relative;
    const ShapeDerivative<Dim> derivative(elements.space, offsets, materials, body.supports, {});
    const ShapeChange change = derivative.potential_energy(fields.displacement, body.loads);
    out.change = -change.sum;
    out.size = change.size();
    out.facets = static_cast<Index>((offsets.colwise().squaredNorm().array() > 0.0).count());
  }
  out.seconds = cpu_seconds() - start;
  return out;
}

/// Energy of the polygon, from finer and finer elements on it.
template <int Dim> double converged(const Body<Dim>& body, FineMesh<Dim> mesh, double coarsest) {
  std::vector<double> energies{coarsest};
  for (int k = 0; k < body.refinements; ++k) {
    mesh = refined(mesh);
    energies.push_back(answer(body, mesh, {}).energy);
  }
  const std::size_t n = energies.size();
  const double last = energies[n - 1] - energies[n - 2];
  const double share = n > 2 && energies[n - 2] != energies[n - 3]
                           ? std::min(0.5, std::abs(last / (energies[n - 2] - energies[n - 3])))
                           : 0.25;
  return energies[n - 1] + last * share / (1.0 - share);
}

template <int Dim> void tabulate(Body<Dim> body) {
  const auto prepared = [&](int turn) {
    CurvedMesh<Dim> curved = body.mesh(turn);
    FineMesh<Dim> mesh(std::move(curved.mesh));
    Matrix offsets = facet_offsets(mesh, curved.boundary);
    return std::pair(std::move(mesh), std::move(offsets));
  };
  if (body.energy == 0.0) {
    const auto [mesh, offsets] = prepared(body.reference);
    const auto fine = answer(body, mesh, offsets);
    body.energy = (Dim == 2 ? converged(body, mesh, fine.energy) : fine.energy) + fine.change;
  }
  for (const int turn : body.turns) {
    const auto [mesh, offsets] = prepared(turn);
    const auto found = answer(body, mesh, offsets);
    const double polygon = converged(body, mesh, found.energy);
    const double truth = body.energy - polygon, whole = body.energy - found.energy;
    const double stated = found.mesh_error * found.mesh_error + found.size / found.energy;
    std::printf("| %s | %d | %d | %.3g | %.3g | %.2f | %.2f | %.2f | %.2g |\n", body.name.c_str(), turn, found.cells,
                100.0 * found.change / body.energy, 100.0 * truth / body.energy,
                std::sqrt(found.size / std::abs(truth)), 1.0 - found.change / truth,
                std::sqrt(stated / std::abs(whole / body.energy)), found.seconds);
  }
}

/// Half the work of the tractions on the outer sides.
double energy_of_plate() {
  double kirsch = 0.0;
  constexpr int steps = 2000;
  for (int k = 0; k < steps; ++k) {
    const double along = Kirsch::half_width * (k + 0.5) / steps, weight = 0.5 * Kirsch::half_width / steps;
    const Vec<2> right(Kirsch::half_width, along), top(along, Kirsch::half_width);
    kirsch += weight * (Kirsch::traction(right, {1.0, 0.0}).dot(Kirsch::displacement(right)) +
                        Kirsch::traction(top, {0.0, 1.0}).dot(Kirsch::displacement(top)));
  }
  return kirsch;
}

std::vector<Body<2>> planar_bodies() {
  const auto plate = [](int turn) {
    const double size = 2.0 * pi / turn;
    return triangulate_curved(shapes::quarter_plate_with_hole(1.0, Kirsch::half_width, size),
                              {.size = std::min(0.5, size)});
  };
  const auto tube = [](double inner, double outer, std::vector<int> turns) {
    const double nu = 0.3, E = 1.0;
    const double u = (1.0 + nu) * inner * inner / (E * (outer * outer - inner * inner)) * inner *
                     (1.0 - 2.0 * nu + outer * outer / (inner * inner));
    char name[60];
    std::snprintf(name, sizeof name, "tube %g to %g", inner, outer);
    return Body<2>{
        name,
        std::move(turns),
        [=](int turn) {
          const double size = 2.0 * pi * outer / turn;
          return triangulate_curved(shapes::annulus(inner, outer, size * inner / outer), {.size = size});
        },
        {.material = LinearElastic(IsotropicModuli{E, nu}), .plane = Plane::strain, .essential = Essential::nitsche},
        {elastic_support<2>("outer", 1e-9)},
        {.tractions = {tension<2>("inner", -1.0)}, .body_force = {}},
        pi * inner * u};
  };
  Body<2> holes{
      "160 holes",
      {16, 24, 48},
      [](int turn) {
        PlanarDomain domain = shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, 10.0);
        // As many chords to each hole, whatever its size and its ligaments.
        for (Polyline& chain : domain.boundary) {
          if (chain.name != "holes") continue;
          Vec<2> centre = Vec<2>::Zero();
          for (std::size_t k = 0; k + 1 < chain.points.size(); ++k)
            centre += chain.points[k] / static_cast<double>(chain.points.size() - 1);
          const double radius = (chain.points.front() - centre).norm();
          chain.points.clear(), chain.bulges.clear();
          const auto at = [&](double angle) { return Vec<2>(std::cos(angle), std::sin(angle)); };
          for (int k = 0; k <= turn; ++k) {
            chain.points.push_back(centre + radius * at(2.0 * pi * (k % turn) / turn));
            if (k > 0) chain.bulges.push_back(radius * (1.0 - std::cos(pi / turn)) * at(pi * (2 * k - 1) / turn));
          }
        }
        return triangulate_curved(domain, {.size = 0.4});
      },
      {.material = LinearElastic(IsotropicModuli{1.0, 0.3}), .plane = Plane::stress, .essential = Essential::strong},
      {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
      {.tractions = {tension<2>("right", 1.0)}, .body_force = {}},
      0.0,
      128,
      1};
  return {{"plate with a hole",
           {12, 16, 24, 48, 96},
           plate,
           {.material = LinearElastic(Kirsch::material), .plane = Plane::stress, .essential = Essential::strong},
           {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
           Kirsch::loads(),
           energy_of_plate()},
          tube(1.0, 2.0, {12, 16, 24, 48}),
          tube(9.8, 10.0, {24, 48, 96, 192}),
          std::move(holes)};
}

std::vector<Body<3>> solid_bodies() {
  const auto size_of = [](double radius, int turn) { return 2.0 * pi * radius / turn; };
  const ThickWall sphere{true};
  const ElasticModel model{.material = LinearElastic(IsotropicModuli{1.0, 0.3}), .essential = Essential::strong};
  const std::vector<DisplacementCondition<3>> symmetric{symmetry_plane<3>("left"), symmetry_plane<3>("front"),
                                                        symmetry_plane<3>("bottom")};
  double cavity = 0.0;  // half the work of the tractions on the outer sides
  constexpr int steps = 200;
  constexpr double width = Cavity::half_width;
  for (int d = 0; d < 3; ++d)
    for (int i = 0; i < steps; ++i)
      for (int j = 0; j < steps; ++j) {
        Vec<3> x;
        x[d] = width, x[(d + 1) % 3] = width * (i + 0.5) / steps, x[(d + 2) % 3] = width * (j + 0.5) / steps;
        cavity += 0.5 * width * width / (steps * steps) *
                  traction<3>(Cavity::stress(x), Vec<3>::Unit(d)).dot(Cavity::displacement(x));
      }
  return {{"sphere 1 to 2",
           {12, 16, 24},
           [=](int turn) { return solids::thick_sphere(1.0, 2.0, size_of(2.0, turn), size_of(1.0, turn)); },
           model,
           symmetric,
           {.tractions = {tension<3>("inner", -1.0)}, .body_force = {}},
           0.25 * pi * sphere.at(1.0).u,
           0,
           1},
          {"spherical cavity",
           {12, 16, 24},
           [=](int turn) { return solids::spherical_cavity(1.0, Cavity::half_width, 1.0, size_of(1.0, turn)); },
           {.material = LinearElastic(Cavity::material), .essential = Essential::strong},
           symmetric,
           Cavity::loads(),
           cavity,
           0,
           1},
          {"torus",
           {12, 16},
           [=](int turn) { return solids::half_torus(1.0, 0.5, size_of(0.5, turn)); },
           model,
           {clamp<3>("start")},
           {.tractions = {tension<3>("end", 1.0)}, .body_force = {}},
           0.0,
           22,
           1}};
}

/// A mesh of triangles, its boundary parted by what name says of the middle of a facet.
CurvedMesh<3> meshed(const SurfaceSoup& surface, double size,
                     const std::function<std::string(const Vec<3>& middle, const Vec<3>& normal)>& name) {
  MeshData<3> data = mesh_surface(surface, {.size = size});
  data.groups.clear();
  const FineMesh<3> mesh(data);
  std::map<std::string, std::vector<std::array<Index, 3>>> parts;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const auto v = mesh.facets().col(f);
    const Vec<3> middle = (mesh.vertex(v[0]) + mesh.vertex(v[1]) + mesh.vertex(v[2])) / 3.0;
    parts[name(middle, mesh.facet_normal(f))].push_back({v[0], v[1], v[2]});
  }
  CurvedMesh<3> curved{.mesh = {mesh.vertices(), mesh.cells(), {}}};
  for (auto& [part, facets] : parts) curved.mesh.groups.push_back({part, std::move(facets)});
  curved.boundary = surface_offsets(mesh, surface, largest_smooth_angle, 0.1 * size);
  return curved;
}

/// A quarter of a plate with a hole, extruded along z.
SurfaceSoup plate_surface(int turn, double half_width, double height) {
  const int n = turn / 4;  // even, so that the corner has its ray
  SurfaceSoup soup;
  soup.points.resize(3, 4 * (n + 1));
  const auto at = [&](int k, int outer, int top) { return 4 * k + 2 * outer + top; };
  for (int k = 0; k <= n; ++k) {
    const double angle = 0.5 * pi * k / n;
    const Vec<2> ray(k == n ? 0.0 : std::cos(angle), k == 0 ? 0.0 : std::sin(angle));
    for (int top = 0; top < 2; ++top) {
      soup.points.col(at(k, 0, top)) << ray, height * top;
      soup.points.col(at(k, 1, top)) << half_width / ray.maxCoeff() * ray, height * top;
    }
  }
  const auto quad = [&](Index a, Index b, Index c, Index d) {
    soup.triangles.push_back({a, b, c});
    soup.triangles.push_back({a, c, d});
  };
  for (int k = 0; k < n; ++k) {
    quad(at(k, 0, 1), at(k, 1, 1), at(k + 1, 1, 1), at(k + 1, 0, 1));
    quad(at(k, 0, 0), at(k + 1, 0, 0), at(k + 1, 1, 0), at(k, 1, 0));
    quad(at(k, 0, 0), at(k, 0, 1), at(k + 1, 0, 1), at(k + 1, 0, 0));
    quad(at(k, 1, 0), at(k + 1, 1, 0), at(k + 1, 1, 1), at(k, 1, 1));
  }
  quad(at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1));
  quad(at(n, 0, 0), at(n, 0, 1), at(n, 1, 1), at(n, 1, 0));
  return soup;
}

std::vector<Body<3>> triangulated_bodies() {
  std::vector<Body<3>> bodies;
  const auto add = [&](const char* what, double size, std::function<CurvedMesh<3>(int turn)> mesh, double energy,
                       IsotropicModuli moduli, std::vector<DisplacementCondition<3>> supports, Loads<3> loads) {
    char name[60];
    std::snprintf(name, sizeof name, "STL %s, edges %g", what, size);
    bodies.push_back({name,
                      {16, 24, 32},
                      std::move(mesh),
                      {.material = LinearElastic(moduli), .essential = Essential::nitsche},
                      std::move(supports),
                      std::move(loads),
                      energy,
                      0,
                      1});
  };
  const auto shell = [](const Vec<3>& x, const Vec<3>& normal) -> std::string {
    return normal.dot(x) < 0.0 ? "inner" : "outer";
  };
  const Loads<3> pressure{.tractions = {tension<3>("inner", -1.0)}, .body_force = {}};
  const ThickWall sphere{true}, cylinder{false};
  constexpr double height = 0.5;
  const auto ring = [=](const Vec<3>& x, const Vec<3>& normal) -> std::string {
    return std::abs(normal.z()) > 0.9 ? "ends" : shell(Vec<3>(x.x(), x.y(), 0.0), normal);
  };
  // Stresses of the plate in plane strain are those in plane stress.
  constexpr IsotropicModuli plane = Kirsch::material;
  const double nu = plane.nu / (1.0 + plane.nu);
  const IsotropicModuli solid{plane.E * (1.0 - nu * nu), nu};
  const auto side = [](const Vec<3>& x, const Vec<3>& normal) -> std::string {
    if (std::abs(normal.z()) > 0.9) return "ends";
    if (x.x() > 0.999 * Kirsch::half_width) return "right";
    if (x.y() > 0.999 * Kirsch::half_width) return "top";
    return normal.x() < -0.999 && x.x() < 1e-6 ? "left" : normal.y() < -0.999 && x.y() < 1e-6 ? "bottom" : "hole";
  };
  const auto pulled = [](const Vec<3>& x, const Vec<3>& n) {
    const Vec<2> t = Kirsch::traction(Vec<2>(x.head<2>()), Vec<2>(n.head<2>()));
    return Vec<3>(t.x(), t.y(), 0.0);
  };
  for (const double size : {0.7, 0.5})
    add(
        "sphere 1 to 2", size,
        [=](int turn) {
          return meshed(test::together(test::sphere_surface({0, 0, 0}, 2.0, turn / 2),
                                       test::sphere_surface({0, 0, 0}, 1.0, turn / 2)),
                        size, shell);
        },
        2.0 * pi * sphere.at(1.0).u, sphere.material, {elastic_support<3>("outer", 1e-9)}, pressure);
  for (const double size : {0.5, 0.25})
    add(
        "tube 1 to 2", size,
        [=](int turn) {
          return meshed(test::revolved_surface({{1, 0}, {2, 0}, {2, height}, {1, height}}, turn), size, ring);
        },
        height * pi * cylinder.at(1.0).u, cylinder.material,
        {symmetry_plane<3>("ends"), elastic_support<3>("outer", 1e-9)}, pressure);
  for (const double size : {0.5, 0.25})
    add("plate with a hole", size,
        [=](int turn) { return meshed(plate_surface(turn, Kirsch::half_width, height), size, side); },
        height * energy_of_plate(), solid,
        {symmetry_plane<3>("ends"), symmetry_plane<3>("left"), symmetry_plane<3>("bottom")},
        {.tractions = {{"right", pulled}, {"top", pulled}}, .body_force = {}});
  return bodies;
}

/// Plane strain, as a slice of the tube.
void walls() {
  constexpr double inner = 9.8, outer = 10.0;
  const IsotropicModuli moduli{210e3, 0.3};
  const double mean = inner * inner / (outer * outer - inner * inner), decay = outer * outer / (inner * inner);
  const double radial = -1.0, hoop = mean * (1.0 + decay), axial = 2.0 * moduli.nu * mean;
  const double lame = std::sqrt(0.5 * ((radial - hoop) * (radial - hoop) + (hoop - axial) * (hoop - axial) +
                                       (axial - radial) * (axial - radial)));
  std::printf("| sagitta / wall | chords | cells | von Mises / Lame - 1 [%%] | estimated [%%] | s |\n");
  for (const double sagitta : {0.35, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005}) {
    CurvedMesh<2> curved = triangulate_curved(shapes::annulus(inner, outer, 5.0, sagitta), {.size = 1.0});
    const FineMesh<2> mesh(std::move(curved.mesh));
    const double start = cpu_seconds();
    const auto elements = approximate<2>(mesh, {.kind = BasisKind::p2});
    const auto solution =
        ElasticSolver<2>(elements,
                         {.material = LinearElastic(moduli), .plane = Plane::strain, .essential = Essential::nitsche},
                         {elastic_support<2>("outer", 1e-3)})
            .solve({.tractions = {tension<2>("inner", -1.0)}, .body_force = {}});
    const auto fields = recover_fields(elements, solution);
    double most = 0.0;
    for (const auto& stress : fields.stress.colwise()) most = std::max(most, von_mises<2>(Voigt<2>(stress)));
    const double angle = std::acos(1.0 - sagitta * (outer - inner) / outer);
    std::printf("| %g | %.0f | %d | %.3g | %.3g | %.2g |\n", sagitta, std::ceil(pi / angle), mesh.num_cells(),
                100.0 * (most / lame - 1.0), 300.0 * sagitta, cpu_seconds() - start);
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  const std::string part = argc > 1 ? argv[1] : "";
  if (part == "walls") return walls(), 0;
  std::printf(
      "| body | facets to a turn | cells | estimated change of the energy [%%] | true [%%] | effectivity | left "
      "after correction | of the whole error | s |\n|---|---|---|---|---|---|---|---|---|\n");
  const auto run = [&](const auto& bodies) {
    for (const auto& body : bodies)
      if (body.name.find(part) != std::string::npos) tabulate(body);
  };
  run(planar_bodies());
  run(solid_bodies());
  run(triangulated_bodies());
}
