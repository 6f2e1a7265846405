// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/solid_shapes.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/mesh/spatial_order.hpp"
#include "efree/geometry/meshing/internal/gmsh_session.hpp"

#include <fmt/format.h>
#include <gmsh.h>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

namespace efree::solids {
namespace {

namespace occ = gmsh::model::occ;
using internal::GmshSession;

/// The name of the surface through a point (the middle of its parameters).
using SurfaceName = std::function<std::string(const Vec<3>&)>;

/// Names a side by the plane x, y or z = 0 or `lengths` it lies in; "" if in none.
std::string side_name(const Vec<3>& x, const Vec<3>& lengths) {
  constexpr const char* names[3][2] = {{"left", "right"}, {"front", "back"}, {"bottom", "top"}};
  const double tolerance = 1e-9 * lengths.maxCoeff();
  for (int d = 0; d < 3; ++d) {
    if (std::abs(x[d]) < tolerance) return names[d][0];
    if (std::abs(x[d] - lengths[d]) < tolerance) return names[d][1];
  }
  return "";
}

void name_surfaces(const GmshSession& session, const SurfaceName& name) {
  std::map<std::string, std::vector<int>> groups;
  for (const int surface : internal::all_entities(2)) {
    std::vector<double> low, high, point;
    gmsh::model::getParametrizationBounds(2, surface, low, high);
    gmsh::model::getValue(2, surface, {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])}, point);
    groups[name({point[0], point[1], point[2]})].push_back(surface);
  }
  for (const auto& [group, surfaces] : groups)
    gmsh::model::setPhysicalName(2, gmsh::model::addPhysicalGroup(2, surfaces), group);
  std::vector<int> volumes;
  for (const int volume : internal::all_entities(3)) volumes.push_back(volume);
  if (volumes.empty()) session.fail("the shape is empty");
  gmsh::model::setPhysicalName(3, gmsh::model::addPhysicalGroup(3, volumes), "body");
}

/// Meshes what `build` makes with OpenCASCADE. `shape`: its name and sizes, with which messages begin.
CurvedMesh<3> mesh(
    const std::string& shape, double size, double sagitta, const std::function<void()>& build, const SurfaceName& name,
    const std::function<void()>& sizes = [] {}) {
  if (!(size > 0.0)) throw InputError(fmt::format("{}: size is {}, expected a positive length", shape, size));
  const GmshSession session(shape);
  try {
    build();
    session.check();
    occ::synchronize();
    name_surfaces(session, name);
    sizes();
    internal::generate_tetrahedra(session, size, sagitta);
    CurvedMesh<3> curved = internal::gmsh_mesh<3>(session, size, {});
    curved.mesh = in_spatial_order<3>(std::move(curved.mesh));
    return curved;
  } catch (const std::string& message) {
    session.fail(message);
  }
}

void cut(int body, int tool) {
  gmsh::vectorpair out;
  std::vector<gmsh::vectorpair> map;
  occ::cut({{3, body}}, {{3, tool}}, out, map);
}

/// Edges of about `near` where `radius` (of x, y, z) is `from`, a surface of that `area`, growing linearly to `far`
/// where it is `to`; no grading unless 0 < near < far. Throws InputError if the mesh takes more memory than there is.
void grade(double near, double far, const char* radius, double from, double to, double area) {
  if (!(near > 0.0 && near < far)) return;
  // As in generate_tetrahedra, over layers of that area at least: 6 int dx / h^3 with h = near + growth x.
  const double growth = (far - near) / (to - from);
  const double layers = 3.0 / growth * (1.0 / (near * near) - 1.0 / (far * far));
  require_memory(300.0 * area * (2.0 / (near * near) + layers), fmt::format("a mesh of size {:g} at a wall", near),
                 "use a larger size");
  namespace field = gmsh::model::mesh::field;
  const int sizes = field::add("MathEval");
  field::setString(sizes, "F",
                   fmt::format("{0}+({1}-{0})*Max(0,Min(1,({2}-{3})/({4}-{3})))", near / internal::finer_than_told,
                               far / internal::finer_than_told, radius, from, to));
  field::setAsBackgroundMesh(sizes);
}

/// Throws InputError if the facets of a surface of that area and least radius, at least 16 to a turn, take more memory
/// than there is.
void require_memory_of_facets(double area, double radius, double size) {
  if (!(size > 0.0)) return;  // which is refused elsewhere
  const double edge = std::min(size, 2.0 * std::numbers::pi * radius / 16.0);
  require_memory(600.0 * area / (edge * edge),
                 fmt::format("a mesh with edges of {:.3g} on a surface of {:.3g}", edge, area),
                 "it is too slender for 16 edges to a turn: take a shorter or thicker shape");
}

/// Area of an eighth of a sphere.
double eighth(double radius) {
  return 0.5 * std::numbers::pi * radius * radius;
}

void check_size_at(double size, const char* shape, const char* place) {
  if (!(size >= 0.0))
    throw InputError(fmt::format("{}: the size at the {} is {}, expected a positive length or 0", shape, place, size));
}

}  // namespace

MeshData<3> box(const Vec<3>& lengths, double size) {
  if (!(lengths.array() > 0.0).all())
    throw InputError(
        fmt::format("box: lengths {}, {}, {}, expected positive ones", lengths.x(), lengths.y(), lengths.z()));
  return mesh(
      fmt::format("box of {:g} x {:g} x {:g}", lengths.x(), lengths.y(), lengths.z()), size, 0.0,
      [&] { occ::addBox(0.0, 0.0, 0.0, lengths.x(), lengths.y(), lengths.z()); },
      [&](const Vec<3>& x) { return side_name(x, lengths); });
}

CurvedMesh<3> spherical_cavity(double radius, double half_width, double size, double size_at_hole, double sagitta) {
  if (!(radius > 0.0 && radius < half_width))
    throw InputError(fmt::format("spherical cavity: radius {} and half width {}, expected 0 < radius < half width",
                                 radius, half_width));
  check_size_at(size_at_hole, "spherical cavity", "hole");
  const auto build = [&] {
    const int body = occ::addBox(0.0, 0.0, 0.0, half_width, half_width, half_width);
    cut(body, occ::addSphere(0.0, 0.0, 0.0, radius));
  };
  const auto name = [&](const Vec<3>& x) {
    return std::abs(x.norm() - radius) < 1e-9 * radius ? "cavity" : side_name(x, Vec<3>::Constant(half_width));
  };
  return mesh(fmt::format("spherical cavity of radius {:g} and half width {:g}", radius, half_width), size, sagitta,
              build, name,
              [&] { grade(size_at_hole, size, "Sqrt(x*x+y*y+z*z)", radius, 3.0 * radius, eighth(radius)); });
}

CurvedMesh<3> thick_cylinder(double inner, double outer, double height, double size, double size_at_inner,
                             double sagitta) {
  if (!(inner > 0.0 && inner < outer && height > 0.0))
    throw InputError(
        fmt::format("thick cylinder: radii {} and {}, height {}, expected 0 < inner < outer and a positive height",
                    inner, outer, height));
  check_size_at(size_at_inner, "thick cylinder", "inner wall");
  const double quarter = 0.5 * std::numbers::pi;
  require_memory_of_facets(quarter * inner * height, inner, size);
  const auto build = [&] {
    const int body = occ::addCylinder(0.0, 0.0, 0.0, 0.0, 0.0, height, outer, -1, quarter);
    cut(body, occ::addCylinder(0.0, 0.0, 0.0, 0.0, 0.0, height, inner, -1, quarter));
  };
  const auto name = [&](const Vec<3>& x) -> std::string {
    const std::string side = side_name(x, {2.0 * outer, 2.0 * outer, height});
    if (!side.empty()) return side;
    return std::hypot(x.x(), x.y()) < 0.5 * (inner + outer) ? "inner" : "outer";
  };
  return mesh(fmt::format("thick cylinder of radii {:g} and {:g} and height {:g}", inner, outer, height), size, sagitta,
              build, name,
              [&] { grade(size_at_inner, size, "Sqrt(x*x+y*y)", inner, outer, quarter * inner * height); });
}

CurvedMesh<3> thick_sphere(double inner, double outer, double size, double size_at_inner, double sagitta) {
  if (!(inner > 0.0 && inner < outer))
    throw InputError(fmt::format("thick sphere: radii {} and {}, expected 0 < inner < outer", inner, outer));
  check_size_at(size_at_inner, "thick sphere", "inner wall");
  const double quarter = 0.5 * std::numbers::pi;
  const auto build = [&] {
    const int body = occ::addSphere(0.0, 0.0, 0.0, outer, -1, 0.0, quarter, quarter);
    cut(body, occ::addSphere(0.0, 0.0, 0.0, inner, -1, 0.0, quarter, quarter));
  };
  const auto name = [&](const Vec<3>& x) -> std::string {
    const std::string side = side_name(x, Vec<3>::Constant(2.0 * outer));
    if (!side.empty()) return side;
    return x.norm() < 0.5 * (inner + outer) ? "inner" : "outer";
  };
  return mesh(fmt::format("thick sphere of radii {:g} and {:g}", inner, outer), size, sagitta, build, name,
              [&] { grade(size_at_inner, size, "Sqrt(x*x+y*y+z*z)", inner, outer, eighth(inner)); });
}

CurvedMesh<3> cylinder(double radius, double height, double size, double sagitta) {
  if (!(radius > 0.0 && height > 0.0))
    throw InputError(fmt::format("cylinder: radius {} and height {}, expected positive ones", radius, height));
  require_memory_of_facets(2.0 * std::numbers::pi * radius * height, radius, size);
  const auto name = [&](const Vec<3>& x) -> std::string {
    const double tolerance = 1e-9 * std::max(radius, height);
    return std::abs(x.z()) < tolerance ? "bottom" : std::abs(x.z() - height) < tolerance ? "top" : "side";
  };
  return mesh(
      fmt::format("cylinder of radius {:g} and height {:g}", radius, height), size, sagitta,
      [&] { occ::addCylinder(0.0, 0.0, 0.0, 0.0, 0.0, height, radius); }, name);
}

CurvedMesh<3> half_torus(double radius, double section, double size, double sagitta) {
  if (!(section > 0.0 && section < radius))
    throw InputError(
        fmt::format("half torus: radius {} and section {}, expected 0 < section < radius", radius, section));
  require_memory_of_facets(2.0 * std::numbers::pi * std::numbers::pi * radius * section, section, size);
  const auto name = [&](const Vec<3>& x) -> std::string {
    if (std::abs(x.y()) > 1e-9 * radius || std::hypot(std::abs(x.x()) - radius, x.z()) > 0.999 * section)
      return "surface";
    return x.x() > 0.0 ? "start" : "end";
  };
  return mesh(
      fmt::format("half torus of radius {:g} and section {:g}", radius, section), size, sagitta,
      [&] { occ::addTorus(0.0, 0.0, 0.0, radius, section, -1, std::numbers::pi); }, name);
}

}  // namespace efree::solids
