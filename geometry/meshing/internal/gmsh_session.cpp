// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/gmsh_session.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/extent.hpp"
#include "efree/geometry/mesh/refine.hpp"
#include "efree/geometry/meshing/internal/curved_entities.hpp"

#include <fmt/format.h>
#include <gmsh.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

namespace efree::internal {
namespace {

constexpr const char* simplex_name[] = {"points", "lines", "triangles", "tetrahedra"};
constexpr const char* entity_name[] = {"point", "curve", "surface", "volume"};

/// What gmsh knows of a type of elements.
struct ElementType {
  std::string name;
  int order = 0, nodes = 0, corners = 0;
};
ElementType element_type(int type) {
  ElementType of;
  int dim = 0;
  std::vector<double> places;
  gmsh::model::mesh::getElementProperties(type, of.name, dim, of.order, of.nodes, places, of.corners);
  return of;
}

}  // namespace

GmshSession::GmshSession(std::string subject) : subject_(std::move(subject)), threads_(num_threads()) {
  gmsh::initialize(0, nullptr, /*readConfigFiles=*/false);
  gmsh::option::setNumber("General.Terminal", 0);
  gmsh::option::setNumber("General.AbortOnError", 0);
  gmsh::onelab::clear();  // parameters outlive sessions
  gmsh::logger::start();
}

GmshSession::~GmshSession() {
  gmsh::logger::stop();
  gmsh::finalize();
  set_num_threads(threads_);
}

void GmshSession::check() const {
  std::vector<std::string> log;
  gmsh::logger::get(log);
  const std::string mark = "Error: ";
  for (const std::string& entry : log)
    if (entry.starts_with(mark)) fail(entry.substr(mark.size()));
}

void GmshSession::open(const std::string& path) const {
  gmsh::open(path);
  check();
}

void GmshSession::generate(int dim) const {
  Vec<3> low, high;
  gmsh::model::getBoundingBox(-1, -1, low[0], low[1], low[2], high[0], high[1], high[2]);
  if ((high.array() > low.array()).any()) require_extent<3>(low, high, subject_);
  gmsh::model::mesh::generate(dim);
  check();
}

void GmshSession::forget() const {
  gmsh::model::mesh::clear();
  gmsh::logger::stop();
  gmsh::logger::start();
}

void GmshSession::fail(const std::string& what) const {
  throw InputError(fmt::format("{}: {}", subject_, what));
}

double gmsh_option(const std::string& name) {
  double value = 0.0;
  gmsh::option::getNumber(name, value);
  return value;
}

std::vector<GmshPart> physical_parts(int dim) {
  std::map<std::string, std::set<int>> parts;
  gmsh::vectorpair groups;
  gmsh::model::getPhysicalGroups(groups, dim);
  for (const auto& [d, tag] : groups) {
    std::string name;
    gmsh::model::getPhysicalName(d, tag, name);
    std::vector<int> tags;
    gmsh::model::getEntitiesForPhysicalGroup(d, tag, tags);
    for (const int entity : tags) parts[name.empty() ? std::to_string(tag) : name].insert(std::abs(entity));
  }
  std::vector<GmshPart> out;
  for (auto& [name, entities] : parts) out.push_back({name, std::move(entities)});
  return out;
}

std::set<int> all_entities(int dim) {
  gmsh::vectorpair found;
  gmsh::model::getEntities(found, dim);
  std::set<int> tags;
  for (const auto& [d, tag] : found) tags.insert(tag);
  return tags;
}

std::vector<GmshPart> named_entities(int dim, const std::string& fallback) {
  std::vector<GmshPart> parts;
  std::map<std::string, int> count;
  for (const int tag : all_entities(dim)) {
    std::string label;
    gmsh::model::getEntityName(dim, tag, label);
    std::string name = label.substr(label.rfind('/') + 1);
    if (name.starts_with("Open CASCADE STEP translator")) name.clear();  // what it calls a thing without a name
    parts.push_back({name, {tag}});
    ++count[name];
  }
  std::map<std::string, int> seen;
  for (GmshPart& part : parts)
    if (part.name.empty())
      part.name = fmt::format("{} {}", fallback, *part.entities.begin());
    else if (count[part.name] > 1)
      part.name = fmt::format("{} {}", part.name, ++seen[part.name]);
  return parts;
}

std::vector<GmshPart> region_parts(const GmshSession& session, int dim) {
  std::vector<GmshPart> parts = physical_parts(dim);
  if (parts.empty() && dim == 2) return {{"", all_entities(2)}};
  if (parts.empty()) return named_entities(3, "volume");
  std::map<int, std::string> owner;
  for (const GmshPart& part : parts)
    for (const int entity : part.entities)
      if (const auto [other, is_new] = owner.emplace(entity, part.name); !is_new)
        session.fail(fmt::format("{} {} belongs to the physical groups \"{}\" and \"{}\", expected one: it is a region",
                                 entity_name[dim], entity, other->second, part.name));
  return parts;
}

void check_gmsh_size(const GmshSession& session, double size) {
  double x0, y0, z0, x1, y1, z1;
  gmsh::model::getBoundingBox(-1, -1, x0, y0, z0, x1, y1, z1);
  const double most_edges_along_a_side = all_entities(3).empty() ? 1e5 : 2e3;
  if (const double extent = std::max({x1 - x0, y1 - y0, z1 - z0}); extent > most_edges_along_a_side * size)
    session.fail(fmt::format("mesh size {:g} is too small for a body {:g} wide; expected at least {:g}", size, extent,
                             extent / most_edges_along_a_side));
}

namespace {

/// Areas (dim 2) or volumes (3) of all that OpenCASCADE made; 0 for what gmsh's own kernel did, which has none.
double total_measure(int dim) {
  gmsh::vectorpair entities;
  gmsh::model::occ::getEntities(entities, dim);
  double sum = 0.0;
  for (const auto& [d, tag] : entities) {
    double mass = 0.0;
    gmsh::model::occ::getMass(d, tag, mass);
    sum += std::abs(mass);
  }
  return sum;
}

}  // namespace

void require_elements_per_turn(double elements) {
  const auto at_least = [](const char* name, double value) {
    gmsh::option::setNumber(name, std::max(value, gmsh_option(name)));
  };
  // gmsh scales sizes by curvature with its factor, but not the points of circles.
  at_least("Mesh.MeshSizeFromCurvature", elements * gmsh_option("Mesh.MeshSizeFactor"));
  at_least("Mesh.MinimumCirclePoints", elements);
}

void generate_tetrahedra(const GmshSession& session, double size, double sagitta) {
  const auto set = [](const char* name, double value) { gmsh::option::setNumber(name, value); };
  // HXT (10) takes a fraction of Delaunay's (1) time but orders its points by their addresses in memory, so that no two
  // of its meshes are the same.
  set("Mesh.Algorithm3D", 1);
  set("Mesh.Algorithm", 5);
  set("Mesh.ElementOrder", 1);
  set("Mesh.Optimize", 0);
  for (const char* threads :
       {"General.NumThreads", "Mesh.MaxNumThreads1D", "Mesh.MaxNumThreads2D", "Mesh.MaxNumThreads3D"})
    set(threads, 1);
  if (size > 0.0) {
    check_gmsh_size(session, size);
    // At least 2 triangles to a square and 6 tetrahedra to a cube of that size, 300 bytes each.
    require_memory(300.0 * (2.0 * total_measure(2) / (size * size) + 6.0 * total_measure(3) / std::pow(size, 3)),
                   fmt::format("a mesh of size {:g}", size), "use a larger size");
    const double largest =
        std::min(gmsh_option("Mesh.MeshSizeMax"), size / finer_than_told / gmsh_option("Mesh.MeshSizeFactor"));
    set("Mesh.MeshSizeMax", largest);
    set("Mesh.MeshSizeMin", std::min(gmsh_option("Mesh.MeshSizeMin"), largest));
    require_elements_per_turn(16.0);
  }
  mesh_with_walls<3>(
      session, sagitta, [&] { session.generate(3); }, [&] { return flat_gmsh_mesh<3>(session); });
}

template <int Dim> GmshNodes<Dim>::GmshNodes(const GmshSession& session) : session_(session) {
  std::vector<std::size_t> tags;
  std::vector<double> coordinates, parametric;
  gmsh::model::mesh::getNodes(tags, coordinates, parametric);
  const std::size_t count = tags.empty() ? 0 : *std::max_element(tags.begin(), tags.end()) + 1;
  points_ = Points<3>::Zero(3, static_cast<Eigen::Index>(count));
  for (std::size_t k = 0; k < tags.size(); ++k)
    points_.col(static_cast<Eigen::Index>(tags[k])) << coordinates[3 * k], coordinates[3 * k + 1],
        coordinates[3 * k + 2];
  for (const double x : coordinates) extent_ = std::max(extent_, std::abs(x));
}

template <int Dim> Vec<Dim> GmshNodes<Dim>::at(std::size_t tag) {
  const Vec<3> p = points_.col(static_cast<Eigen::Index>(tag));
  if constexpr (Dim == 2) {
    if (!has_plane_) z_ = p.z();
    has_plane_ = true;
    if (std::abs(p.z() - z_) > 1e-9 * extent_)
      session_.fail(fmt::format("the surfaces are not in one plane z = const, they have z = {} and z = {}", z_, p.z()));
  }
  return p.template head<Dim>();
}

std::vector<std::size_t> gmsh_simplices(int dim, int entity) {
  std::vector<int> types;
  gmsh::model::mesh::getElementTypes(types, dim, entity);
  std::vector<std::size_t> corners;
  for (const int type : types) {
    const ElementType of = element_type(type);
    if (of.corners != dim + 1) continue;
    std::vector<std::size_t> elements, nodes;
    gmsh::model::mesh::getElementsByType(type, elements, nodes, entity);
    for (std::size_t first = 0; first + of.nodes <= nodes.size(); first += of.nodes)  // corners come first
      for (int k = 0; k <= dim; ++k) corners.push_back(nodes[first + k]);
  }
  return corners;
}

int highest_order(int dim) {
  std::vector<int> types;
  gmsh::model::mesh::getElementTypes(types, dim);
  int order = 0;
  for (const int type : types)
    if (const ElementType of = element_type(type); of.corners == dim + 1) order = std::max(order, of.order);
  return order;
}

template <int Dim> MeshData<Dim> flat_gmsh_mesh(const GmshSession& session) {
  GmshNodes<Dim> nodes(session);
  MeshData<Dim> mesh;
  const std::vector<GmshPart> regions = region_parts(session, Dim);
  std::vector<std::size_t> corners;
  for (const GmshPart& region : regions) {
    for (const int entity : region.entities) {
      std::vector<int> types;
      gmsh::model::mesh::getElementTypes(types, Dim, entity);
      for (const int type : types)
        if (const ElementType of = element_type(type); of.corners != Dim + 1)
          session.fail(fmt::format(
              "{} {} has elements \"{}\", expected {} only; mesh it with {} (in gmsh without Recombine and transfinite "
              "{}), or give the geometry (.geo, .step) instead of the mesh",
              entity_name[Dim], entity, of.name, simplex_name[Dim], simplex_name[Dim],
              Dim == 2 ? "quadrangles" : "hexahedra"));
      const auto found = gmsh_simplices(Dim, entity);
      corners.insert(corners.end(), found.begin(), found.end());
    }
    mesh.regions.resize(corners.size() / (Dim + 1), static_cast<Index>(mesh.region_names.size()));
    mesh.region_names.push_back(region.name);
  }
  if (corners.empty()) session.fail(fmt::format("there are no {} in it", Dim == 2 ? "triangles" : "tetrahedra"));
  if (mesh.region_names.size() == 1) mesh.regions.clear();

  std::vector<Index> number(nodes.size(), -1);
  std::vector<Vec<Dim>> points;
  mesh.cells.resize(Dim + 1, static_cast<Eigen::Index>(corners.size() / (Dim + 1)));
  for (std::size_t k = 0; k < corners.size(); ++k) {
    Index& v = number[corners[k]];
    if (v < 0) {
      v = static_cast<Index>(points.size());
      points.push_back(nodes.at(corners[k]));
    }
    mesh.cells.data()[k] = v;
  }
  mesh.vertices.resize(Dim, static_cast<Eigen::Index>(points.size()));
  for (std::size_t v = 0; v < points.size(); ++v) mesh.vertices.col(static_cast<Eigen::Index>(v)) = points[v];

  std::vector<GmshPart> groups = physical_parts(Dim - 1);
  if (groups.empty() && Dim == 3) groups = named_entities(2, "surface");
  for (const GmshPart& part : groups) {
    typename MeshData<Dim>::Group group{part.name, {}};
    for (const int entity : part.entities) {
      const auto found = gmsh_simplices(Dim - 1, entity);
      for (std::size_t k = 0; k + Dim - 1 < found.size(); k += Dim) {
        std::array<Index, Dim> facet;
        for (int i = 0; i < Dim; ++i) facet[i] = number[found[k + i]];
        // Entities may belong to a part of the model that is not wanted.
        if (std::ranges::all_of(facet, [](Index v) { return v >= 0; })) group.facets.push_back(facet);
      }
    }
    mesh.groups.push_back(std::move(group));
  }
  return mesh;
}

template <int Dim>
CurvedMesh<Dim> gmsh_mesh(const GmshSession& session, double size, const std::vector<std::string>& slits, double unit) {
  CurvedMesh<Dim> curved{flat_gmsh_mesh<Dim>(session), offsets_of(curved_edges<Dim>(session), unit)};
  curved.mesh.vertices /= unit;
  if (size > 0.0) curved = split_long_edges<Dim>(std::move(curved), size / unit);
  std::vector<std::array<Index, Dim>> cut;
  for (const auto& group : curved.mesh.groups)
    if (std::ranges::find(slits, group.name) != slits.end())
      cut.insert(cut.end(), group.facets.begin(), group.facets.end());
  curved.mesh = cut_open<Dim>(std::move(curved.mesh), cut);
  return curved;
}

template class GmshNodes<2>;
template class GmshNodes<3>;
template MeshData<2> flat_gmsh_mesh<2>(const GmshSession&);
template MeshData<3> flat_gmsh_mesh<3>(const GmshSession&);
template CurvedMesh<2> gmsh_mesh<2>(const GmshSession&, double, const std::vector<std::string>&, double);
template CurvedMesh<3> gmsh_mesh<3>(const GmshSession&, double, const std::vector<std::string>&, double);

}  // namespace efree::internal
