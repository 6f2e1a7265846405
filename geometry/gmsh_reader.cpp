// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/gmsh_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/planar_domain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmsh.h>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

namespace efree {
namespace {

constexpr int line_type = 1, triangle_type = 2;  // gmsh's numbers of elements

/// gmsh between initialize and finalize. Errors are read from its log: left to throw, they would leave gmsh's parser in
/// a state in which it reads no other file.
class Session {
 public:
  explicit Session(std::string path) : path_(std::move(path)) {
    gmsh::initialize(0, nullptr, /*readConfigFiles=*/false);
    gmsh::option::setNumber("General.Terminal", 0);
    gmsh::option::setNumber("General.AbortOnError", 0);
    gmsh::onelab::clear();  // parameters outlive sessions
    gmsh::logger::start();
  }
  ~Session() {
    gmsh::logger::stop();
    gmsh::finalize();
    set_num_threads(threads_);
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Throws InputError with gmsh's first complaint so far, if any.
  void check() const {
    std::vector<std::string> log;
    gmsh::logger::get(log);
    const std::string mark = "Error: ";
    for (const std::string& entry : log)
      if (entry.starts_with(mark)) fail(entry.substr(mark.size()));
  }

  void open() const {
    gmsh::open(path_);
    check();
  }
  void generate(int dim) const {
    gmsh::model::mesh::generate(dim);
    check();
  }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(fmt::format("{}: {}", path_, what)); }

 private:
  std::string path_;
  int threads_ = num_threads();  // gmsh sets it to one
};

/// Full names of the numbers that the open .geo file lets one set.
std::vector<std::string> parameter_names() {
  std::vector<std::string> names;
  gmsh::onelab::getNames(names);
  std::erase_if(names, [](const std::string& name) {
    std::vector<double> value;
    gmsh::onelab::getNumber(name, value);
    return value.empty() || name.starts_with("Gmsh/") || name.starts_with("ONELAB/");
  });
  return names;
}

/// Sets parameters of the open file, named in full ("Parameters/radius") or by the last part ("radius"), and reopens
/// it.
void set_parameters(const Session& session, const std::map<std::string, double>& parameters) {
  if (parameters.empty()) return;
  const std::vector<std::string> names = parameter_names();
  for (const auto& [key, value] : parameters) {
    std::vector<std::string> matches;
    for (const std::string& name : names)
      if (name == key || name.ends_with('/' + key)) matches.push_back(name);
    if (matches.size() != 1)
      session.fail(
          fmt::format("{} parameter \"{}\"; the file defines {}", matches.empty() ? "unknown" : "ambiguous", key,
                      names.empty() ? std::string("none with a name") : fmt::format("{}", fmt::join(names, ", "))));
    gmsh::onelab::setNumber(matches[0], {value});
  }
  gmsh::clear();
  session.open();
}

/// Named physical curves: the tags of the curves, in ascending order of name. Without a name the number serves.
std::map<std::string, std::set<int>> physical_curves() {
  std::map<std::string, std::set<int>> curves;
  gmsh::vectorpair groups;
  gmsh::model::getPhysicalGroups(groups, 1);
  for (const auto& [dim, tag] : groups) {
    std::string name;
    gmsh::model::getPhysicalName(dim, tag, name);
    std::vector<int> tags;
    gmsh::model::getEntitiesForPhysicalGroup(dim, tag, tags);
    for (const int curve : tags) curves[name.empty() ? std::to_string(tag) : name].insert(std::abs(curve));
  }
  return curves;
}

/// Tags of the physical surfaces, or of all surfaces if none is physical.
std::set<int> wanted_surfaces() {
  std::set<int> surfaces;
  gmsh::vectorpair found;
  gmsh::model::getPhysicalGroups(found, 2);
  for (const auto& [dim, tag] : found) {
    std::vector<int> tags;
    gmsh::model::getEntitiesForPhysicalGroup(dim, tag, tags);
    for (const int surface : tags) surfaces.insert(std::abs(surface));
  }
  if (!surfaces.empty()) return surfaces;
  gmsh::model::getEntities(found, 2);
  for (const auto& [dim, tag] : found) surfaces.insert(tag);
  return surfaces;
}

/// Coordinates of mesh nodes by gmsh's tags, and the check that the nodes asked for lie in one plane z = const.
class Nodes {
 public:
  explicit Nodes(const Session& session) : session_(session) {
    std::vector<std::size_t> tags;
    std::vector<double> coordinates, parametric;
    gmsh::model::mesh::getNodes(tags, coordinates, parametric);
    const std::size_t count = tags.empty() ? 0 : *std::max_element(tags.begin(), tags.end()) + 1;
    points_ = Points<3>::Zero(3, static_cast<Eigen::Index>(count));
    for (std::size_t k = 0; k < tags.size(); ++k)
      points_.col(static_cast<Eigen::Index>(tags[k])) << coordinates[3 * k], coordinates[3 * k + 1],
          coordinates[3 * k + 2];
    for (std::size_t k = 0; k < coordinates.size(); ++k) extent_ = std::max(extent_, std::abs(coordinates[k]));
  }

  std::size_t size() const { return static_cast<std::size_t>(points_.cols()); }

  Vec<2> at(std::size_t tag) {
    const Vec<3> p = points_.col(static_cast<Eigen::Index>(tag));
    if (!has_plane_) z_ = p.z();
    has_plane_ = true;
    if (std::abs(p.z() - z_) > 1e-9 * extent_)
      session_.fail(fmt::format("the surfaces are not in one plane z = const, they have z = {} and z = {}", z_, p.z()));
    return p.head<2>();
  }

 private:
  const Session& session_;
  Points<3> points_;
  double extent_ = 0.0, z_ = 0.0;
  bool has_plane_ = false;
};

std::vector<std::size_t> element_nodes(int type, int entity) {
  std::vector<std::size_t> elements, nodes;
  gmsh::model::mesh::getElementsByType(type, elements, nodes, entity);
  return nodes;
}

/// Reads the mesh that gmsh holds.
FineMesh<2> read_mesh(const Session& session, const std::vector<std::string>& slits) {
  Nodes nodes(session);
  MeshData<2> mesh;
  std::vector<Index> number(nodes.size(), -1);
  std::vector<Vec<2>> points;
  std::vector<std::size_t> corners;
  for (const int surface : wanted_surfaces()) {
    std::vector<int> types;
    gmsh::model::mesh::getElementTypes(types, 2, surface);
    for (const int type : types)
      if (type != triangle_type)
        session.fail(
            fmt::format("surface {} has elements of gmsh's type {}, expected 3-node triangles only", surface, type));
    const auto found = element_nodes(triangle_type, surface);
    corners.insert(corners.end(), found.begin(), found.end());
  }
  if (corners.empty()) session.fail("there are no triangles in it");
  mesh.cells.resize(3, static_cast<Eigen::Index>(corners.size() / 3));
  for (std::size_t k = 0; k < corners.size(); ++k) {
    Index& v = number[corners[k]];
    if (v < 0) {
      v = static_cast<Index>(points.size());
      points.push_back(nodes.at(corners[k]));
    }
    mesh.cells.data()[k] = v;
  }
  mesh.vertices.resize(2, static_cast<Eigen::Index>(points.size()));
  for (std::size_t v = 0; v < points.size(); ++v) mesh.vertices.col(static_cast<Eigen::Index>(v)) = points[v];

  std::vector<std::array<Index, 2>> cut;
  for (const auto& [name, curves] : physical_curves()) {
    MeshData<2>::Group group{name, {}};
    for (const int curve : curves) {
      const auto ends = element_nodes(line_type, curve);
      for (std::size_t k = 0; k + 1 < ends.size(); k += 2)  // curves may belong to surfaces that are not wanted
        if (number[ends[k]] >= 0 && number[ends[k + 1]] >= 0)
          group.facets.push_back({number[ends[k]], number[ends[k + 1]]});
    }
    if (std::find(slits.begin(), slits.end(), name) != slits.end())
      cut.insert(cut.end(), group.facets.begin(), group.facets.end());
    mesh.groups.push_back(std::move(group));
  }
  return FineMesh<2>(cut_open<2>(std::move(mesh), cut));
}

/// The line elements of a curve as chains of points.
void add_curve(int curve, const std::string& name, Nodes& nodes, std::vector<Polyline>& out) {
  const auto ends = element_nodes(line_type, curve);
  for (std::size_t k = 0; k + 1 < ends.size(); k += 2) {
    if (k == 0 || ends[k] != ends[k - 1]) out.push_back({name, {nodes.at(ends[k])}});
    out.back().points.push_back(nodes.at(ends[k + 1]));
  }
}

/// The surfaces of the open .geo file, their curves sampled by gmsh. A curve between two surfaces is listed twice,
/// which by the even-odd rule keeps it from being boundary.
PlanarDomain sample_surfaces(const Session& session, const std::vector<std::string>& slits) {
  Nodes nodes(session);
  PlanarDomain domain;
  std::set<int> used;
  for (const int surface : wanted_surfaces()) {
    std::string type;
    gmsh::model::getType(2, surface, type);
    if (type != "Plane")
      session.fail(fmt::format("surface {} is of type \"{}\", expected a plane surface", surface, type));
    gmsh::vectorpair entities;
    gmsh::model::getBoundary({{2, surface}}, entities, /*combined=*/false, /*oriented=*/false);
    for (const auto& [dim, curve] : entities) {
      add_curve(curve, "", nodes, domain.boundary);
      used.insert(curve);
    }
    gmsh::model::mesh::getEmbedded(2, surface, entities);
    for (const auto& [dim, tag] : entities)
      if (dim == 1) {
        add_curve(tag, "", nodes, domain.embedded);
        used.insert(tag);
      } else {
        std::vector<std::size_t> tags;
        std::vector<double> coordinates, parametric;
        gmsh::model::mesh::getNodes(tags, coordinates, parametric, dim, tag);
        for (const std::size_t node : tags) domain.embedded.push_back({"", {nodes.at(node)}});
      }
  }
  if (used.empty()) session.fail("there is no surface in it");
  for (const auto& [name, curves] : physical_curves()) {
    const bool is_slit = std::find(slits.begin(), slits.end(), name) != slits.end();
    for (const int curve : curves)
      if (used.contains(curve)) add_curve(curve, name, nodes, is_slit ? domain.slits : domain.embedded);
  }
  return domain;
}

double option(const std::string& name) {
  double value = 0.0;
  gmsh::option::getNumber(name, value);
  return value;
}

/// Bounds gmsh's sizes. gmsh rounds the number of intervals of a curve, so that chords can be 1 % longer than told.
void limit_sizes(double size) {
  const double largest = std::min(option("Mesh.MeshSizeMax"), 0.98 * size / option("Mesh.MeshSizeFactor"));
  gmsh::option::setNumber("Mesh.MeshSizeMax", largest);
  gmsh::option::setNumber("Mesh.MeshSizeMin", std::min(option("Mesh.MeshSizeMin"), largest));
}

void check_slits(const Session& session, const std::vector<std::string>& slits) {
  const auto curves = physical_curves();
  std::vector<std::string> names;
  for (const auto& curve : curves) names.push_back('"' + curve.first + '"');
  for (const std::string& slit : slits)
    if (!curves.contains(slit))
      session.fail(fmt::format("slit \"{}\" is no physical curve; the file has {}", slit,
                               names.empty() ? std::string("none") : fmt::format("{}", fmt::join(names, ", "))));
}

/// Refuses a size that no machine could mesh before gmsh begins to sample the curves.
void check_size(const Session& session, double size) {
  double x0, y0, z0, x1, y1, z1;
  gmsh::model::getBoundingBox(-1, -1, x0, y0, z0, x1, y1, z1);
  constexpr double most_edges_along_a_side = 1e5;
  if (const double extent = std::max(x1 - x0, y1 - y0); extent > most_edges_along_a_side * size)
    session.fail(fmt::format("mesh size {:g} is too small for a body {:g} wide; expected at least {:g}", size, extent,
                             extent / most_edges_along_a_side));
}

/// gmsh's parser can skip a last line that has no end.
void check_last_line(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  file.seekg(-1, std::ios::end);
  if (const int last = file.get(); last != '\n' && last != '\r')
    throw InputError(fmt::format(
        "{}: the file is empty or its last line has no end; add a line break, without it gmsh may skip that line",
        path));
}

FineMesh<2> read(const Session& session, bool is_geometry, const GmshOptions& options) {
  session.open();
  set_parameters(session, options.parameters);
  check_slits(session, options.slits);
  if (!is_geometry) return read_mesh(session, options.slits);

  gmsh::option::setNumber("Mesh.ElementOrder", 1);
  if (options.size == 0.0) {
    session.generate(2);
    return read_mesh(session, options.slits);
  }
  check_size(session, options.size);
  limit_sizes(options.size);
  gmsh::option::setNumber("Mesh.MinimumCirclePoints", std::max(16.0, option("Mesh.MinimumCirclePoints")));
  session.generate(1);
  return triangulate(sample_surfaces(session, options.slits), {.size = options.size});
}

}  // namespace

FineMesh<2> read_gmsh(const std::string& path, const GmshOptions& options) {
  const std::string extension = std::filesystem::path(path).extension().string();
  const bool is_geometry = extension == ".geo";
  if (!is_geometry && extension != ".msh") throw InputError(fmt::format("{}: expected a .geo or .msh file", path));
  if (!std::filesystem::is_regular_file(path) || !std::ifstream(path))
    throw InputError(fmt::format("{}: cannot read the file", path));
  if (!(options.size >= 0.0))
    throw InputError(
        fmt::format("{}: size is {}, expected a positive length, or 0 for the file's own", path, options.size));
  if (!is_geometry && options.size > 0.0)
    throw InputError(fmt::format("{}: a .msh file comes with its own triangles, a size ({}) applies to .geo files only",
                                 path, options.size));
  if (!is_geometry && !options.parameters.empty())
    throw InputError(fmt::format("{}: a .msh file has no parameters", path));
  if (is_geometry) check_last_line(path);
  const Session session(path);
  try {
    return read(session, is_geometry, options);
  } catch (const std::string& message) {  // what the gmsh API throws
    session.fail(message);
  }
}

}  // namespace efree
