// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/gmsh_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/lower_case.hpp"
#include "efree/core/internal/reading_bound.hpp"
#include "efree/geometry/mesh/spatial_order.hpp"
#include "efree/geometry/meshing/internal/cad_import.hpp"
#include "efree/geometry/meshing/internal/curved_entities.hpp"
#include "efree/geometry/meshing/internal/gmsh_script.hpp"
#include "efree/geometry/meshing/internal/gmsh_session.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmsh.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <new>
#include <optional>
#include <set>

namespace efree {
namespace {

using internal::GmshNodes, internal::GmshPart, internal::GmshSession;

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
void set_parameters(const GmshSession& session, const std::string& path,
                    const std::map<std::string, double>& parameters) {
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
  session.open(path);
}

/// From the middles of line elements to their curves, by their ends.
using Bulges = std::map<std::array<double, 4>, Vec<2>>;
std::array<double, 4> ends_key(const Vec<2>& a, const Vec<2>& b) {
  return {a.x(), a.y(), b.x(), b.y()};
}
Bulges bulges_of(const std::vector<internal::CurvedEdge<2>>& edges) {
  Bulges bulges;
  for (const auto& edge : edges) bulges.emplace(ends_key(edge.a, edge.b), edge.offset);
  return bulges;
}

/// The line elements of a curve as chains of points.
void add_curve(int curve, const std::string& name, const Bulges& bulges, GmshNodes<2>& nodes,
               std::vector<Polyline>& out) {
  const auto ends = internal::gmsh_simplices(1, curve);
  for (std::size_t k = 0; k + 1 < ends.size(); k += 2) {
    const Vec<2> a = nodes.at(ends[k]), b = nodes.at(ends[k + 1]);
    if (k == 0 || ends[k] != ends[k - 1]) out.push_back({name, {a}});
    out.back().points.push_back(b);
    const auto bulge = bulges.find(ends_key(a, b));
    out.back().bulges.push_back(bulge == bulges.end() ? Vec<2>(0.0, 0.0) : bulge->second);
  }
}

const char* const interface_name = "\x01interface";  // no name in a file

/// The surfaces of the open .geo file, their curves sampled by gmsh.
struct SampledSurfaces {
  /// A curve between two surfaces is listed twice, which by the even-odd rule keeps it from being boundary. All curves
  /// are embedded under the name `interface_name` if there are several regions.
  PlanarDomain domain;
  std::vector<std::string> region_names;
  std::vector<std::vector<Polyline>> outlines;  ///< of each region, an even-odd outline as in PlanarDomain
};

/// Whether a ray to the right of `p` meets an odd number of segments.
bool is_inside(const Vec<2>& p, const std::vector<Polyline>& outline) {
  bool inside = false;
  for (const Polyline& chain : outline)
    for (std::size_t k = 0; k + 1 < chain.points.size(); ++k) {
      const Vec<2>&a = chain.points[k], &b = chain.points[k + 1];
      if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
        inside = !inside;
    }
  return inside;
}

/// Least distance from a point to the segments of an outline.
double distance(const Vec<2>& p, const std::vector<Polyline>& outline) {
  double least = std::numeric_limits<double>::infinity();
  for (const Polyline& chain : outline)
    for (std::size_t k = 0; k + 1 < chain.points.size(); ++k) {
      const Vec<2>& a = chain.points[k];
      const Vec<2> along = chain.points[k + 1] - a;
      const double length = along.squaredNorm();
      const double share = length > 0.0 ? std::clamp(along.dot(p - a) / length, 0.0, 1.0) : 0.0;
      least = std::min(least, (p - a - share * along).norm());
    }
  return least;
}

/// A surface, its outline, and the box around it.
struct Outlined {
  int surface;
  std::vector<Polyline> outline;
  Eigen::AlignedBox2d box;
};

/// Refuses surfaces that lie on each other: by the even-odd rule what both cover would be cut out. Looked for at some
/// points of every outline, farther in than chords that stand for one curve are apart.
void refuse_overlaps(const GmshSession& session, const std::vector<Outlined>& surfaces) {
  constexpr std::size_t most = 64;
  constexpr double apart = 0.1;  // of a chord
  for (const Outlined& one : surfaces) {
    std::vector<std::array<Vec<2>, 2>> chords;
    for (const Polyline& chain : one.outline)
      for (std::size_t k = 0; k + 1 < chain.points.size(); ++k)
        chords.push_back({chain.points[k], chain.points[k + 1]});
    const std::size_t stride = (chords.size() + most - 1) / most;
    for (const Outlined& other : surfaces) {
      if (&other == &one || !one.box.intersects(other.box)) continue;
      for (std::size_t k = 0; k < chords.size(); k += stride) {
        const auto& [a, b] = chords[k];
        const Vec<2> p = 0.5 * (a + b);
        if (other.box.contains(p) && is_inside(p, other.outline) && distance(p, other.outline) > apart * (b - a).norm())
          session.fail(fmt::format(
              "surfaces {} and {} overlap around ({:.6g}, {:.6g}): make the outline of one a hole of the other, or "
              "part them (BooleanFragments)",
              one.surface, other.surface, p.x(), p.y()));
      }
    }
  }
}

SampledSurfaces sample_surfaces(const GmshSession& session, const std::vector<std::string>& slits) {
  GmshNodes<2> nodes(session);
  const Bulges bulges = bulges_of(internal::curved_edges<2>(session));
  SampledSurfaces sampled;
  PlanarDomain& domain = sampled.domain;
  std::set<int> used;
  std::vector<Outlined> surfaces;
  const auto regions = internal::region_parts(session, 2);
  for (const GmshPart& region : regions) {
    std::vector<Polyline> outline;
    for (const int surface : region.entities) {
      const std::size_t first = outline.size();
      std::string type;
      gmsh::model::getType(2, surface, type);
      if (type != "Plane")
        session.fail(fmt::format("surface {} is of type \"{}\", expected a plane surface", surface, type));
      gmsh::vectorpair entities;
      gmsh::model::getBoundary({{2, surface}}, entities, /*combined=*/false, /*oriented=*/false);
      for (const auto& [dim, curve] : entities) {
        add_curve(curve, "", bulges, nodes, outline);
        used.insert(curve);
        if (regions.size() > 1) add_curve(curve, interface_name, {}, nodes, domain.embedded);
      }
      Outlined& own = surfaces.emplace_back(Outlined{surface, {outline.begin() + first, outline.end()}, {}});
      for (const Polyline& chain : own.outline)
        for (const Vec<2>& point : chain.points) own.box.extend(point);
      gmsh::model::mesh::getEmbedded(2, surface, entities);
      for (const auto& [dim, tag] : entities)
        if (dim == 1) {
          add_curve(tag, "", {}, nodes, domain.embedded);
          used.insert(tag);
        } else {
          std::vector<std::size_t> tags;
          std::vector<double> coordinates, parametric;
          gmsh::model::mesh::getNodes(tags, coordinates, parametric, dim, tag);
          for (const std::size_t node : tags) domain.embedded.push_back({"", {nodes.at(node)}});
        }
    }
    domain.boundary.insert(domain.boundary.end(), outline.begin(), outline.end());
    sampled.region_names.push_back(region.name);
    sampled.outlines.push_back(std::move(outline));
  }
  if (used.empty()) session.fail("there is no surface in it");
  refuse_overlaps(session, surfaces);
  for (const GmshPart& part : internal::physical_parts(1)) {
    const bool is_slit = std::ranges::find(slits, part.name) != slits.end();
    for (const int curve : part.entities)
      if (used.contains(curve)) add_curve(curve, part.name, {}, nodes, is_slit ? domain.slits : domain.embedded);
  }
  return sampled;
}

/// The mesh of sampled surfaces with the regions of its cells: parts between interfaces lie in one region each, that of
/// their largest cell.
CurvedMesh<2> triangulate_regions(const SampledSurfaces& sampled, const TriangulateOptions& options) {
  CurvedMesh<2> curved = triangulate_curved(sampled.domain, options);
  MeshData<2>& mesh = curved.mesh;
  mesh.region_names = sampled.region_names;
  if (sampled.region_names.size() == 1) return curved;
  std::set<std::pair<Index, Index>> interface;
  std::erase_if(mesh.groups, [&](const MeshData<2>::Group& group) {
    if (group.name != interface_name) return false;
    for (const auto& [a, b] : group.facets) interface.insert(std::minmax(a, b));
    return true;
  });
  const FineMesh<2> fine(MeshData<2>{mesh.vertices, mesh.cells, {}});  // drops no vertex: all of them have a cell
  mesh.regions.assign(fine.num_cells(), -1);
  for (Index seed = 0; seed < fine.num_cells(); ++seed) {
    if (mesh.regions[seed] >= 0) continue;
    std::vector<Index> part{seed};
    mesh.regions[seed] = 0;
    Index largest = seed;
    for (std::size_t k = 0; k < part.size(); ++k) {
      const Index c = part[k];
      if (fine.volume(c) > fine.volume(largest)) largest = c;
      for (int i = 0; i < 3; ++i) {
        const Index other = fine.neighbour(i, c);
        if (other < 0 || mesh.regions[other] >= 0) continue;
        const Index a = fine.cells()((i + 1) % 3, c), b = fine.cells()((i + 2) % 3, c);
        if (interface.contains(std::minmax(a, b))) continue;
        mesh.regions[other] = 0;
        part.push_back(other);
      }
    }
    const Vec<2> point = fine.centroid(largest);
    const auto region =
        std::ranges::find_if(sampled.outlines, [&](const auto& outline) { return is_inside(point, outline); });
    // Chords of the outline and of the mesh are the same, so that one of them must hold the point.
    if (region == sampled.outlines.end())
      throw NumericalError(fmt::format("gmsh: no surface holds the point ({}, {})", point.x(), point.y()));
    for (const Index c : part) mesh.regions[c] = static_cast<Index>(region - sampled.outlines.begin());
  }
  return curved;
}

/// Bounds gmsh's sizes. gmsh rounds the number of intervals of a curve, so that chords can be 1 % longer than told.
void limit_sizes(double size) {
  const double largest =
      std::min(internal::gmsh_option("Mesh.MeshSizeMax"), 0.98 * size / internal::gmsh_option("Mesh.MeshSizeFactor"));
  gmsh::option::setNumber("Mesh.MeshSizeMax", largest);
  gmsh::option::setNumber("Mesh.MeshSizeMin", std::min(internal::gmsh_option("Mesh.MeshSizeMin"), largest));
}

void check_slits(const GmshSession& session, int dim, const std::vector<std::string>& slits) {
  std::vector<std::string> names;
  for (const GmshPart& part : internal::physical_parts(dim - 1)) names.push_back(part.name);
  for (const std::string& slit : slits)
    if (std::ranges::find(names, slit) == names.end())
      session.fail(
          fmt::format("slit \"{}\" is no physical {}; the file has {}", slit, dim == 2 ? "curve" : "surface",
                      names.empty() ? std::string("none") : fmt::format("\"{}\"", fmt::join(names, "\", \""))));
}

enum class Format { geo, msh, cad };

/// By extension, in any case of letters. Throws InputError for any other and for a file that cannot be read.
Format format_of(const std::string& path) {
  const std::string extension = internal::lower_case(std::filesystem::path(path).extension().string());
  const bool is_cad = extension == ".step" || extension == ".stp" || extension == ".iges" || extension == ".igs" ||
                      extension == ".brep";
  if (!is_cad && extension != ".geo" && extension != ".msh")
    throw InputError(fmt::format("{}: expected a .geo or .msh file, or a solid as .step, .iges or .brep", path));
  if (!std::filesystem::is_regular_file(path) || !std::ifstream(path))
    throw InputError(fmt::format("{}: cannot read the file", path));
  if (std::filesystem::file_size(path) == 0 && extension != ".geo")
    throw InputError(fmt::format("{}: the file is empty", path));
  return is_cad ? Format::cad : extension == ".geo" ? Format::geo : Format::msh;
}

/// The memory that a mesh takes is bounded by the length of its file; what a script makes is not.
void open(const GmshSession& session, const std::string& path, Format format) {
  std::optional<internal::ReadingBound> bound;
  if (format == Format::msh) bound.emplace(path);
  session.open(path);
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

/// Of the box around all that gmsh holds.
double model_diagonal() {
  std::array<double, 6> box{};
  gmsh::model::getBoundingBox(-1, -1, box[0], box[1], box[2], box[3], box[4], box[5]);
  return std::hypot(box[3] - box[0], box[4] - box[1], box[5] - box[2]);
}

/// A mesh along a space-filling curve.
template <int Dim> CurvedMesh<Dim> ordered(CurvedMesh<Dim> curved) {
  curved.mesh = in_spatial_order<Dim>(std::move(curved.mesh));
  return curved;
}

template <int Dim>
CurvedMesh<Dim> read(const GmshSession& session, const std::string& path, Format format, const GmshOptions& options) {
  if (format == Format::cad) {
    if constexpr (Dim == 2)
      session.fail("a CAD file holds solids, expected a planar .geo or .msh file");
    else {
      const double unit = internal::import_cad(session, path);
      check_slits(session, Dim, options.slits);
      const double size = options.size > 0.0 ? options.size * unit : options.factor * model_diagonal() / 20.0;
      internal::generate_tetrahedra(session, size, options.sagitta);
      return ordered<3>(internal::gmsh_mesh<3>(session, size, options.slits, unit));
    }
  }
  open(session, path, format);
  set_parameters(session, path, options.parameters);
  check_slits(session, Dim, options.slits);
  if (format == Format::msh) return {internal::gmsh_mesh<Dim>(session, 0.0, options.slits).mesh};
  if (options.factor != 1.0)
    gmsh::option::setNumber("Mesh.MeshSizeFactor", options.factor * internal::gmsh_option("Mesh.MeshSizeFactor"));
  if constexpr (Dim == 3) {
    if (internal::all_entities(3).empty()) session.fail("there is no volume in it");
    internal::generate_tetrahedra(session, options.size, options.sagitta);
    return ordered<3>(internal::gmsh_mesh<3>(session, options.size, options.slits));
  } else {
    gmsh::option::setNumber("Mesh.ElementOrder", 1);
    if (options.size == 0.0) {
      internal::mesh_with_walls<2>(
          session, options.sagitta, [&] { session.generate(2); }, [&] { return internal::flat_gmsh_mesh<2>(session); });
      return ordered<2>(internal::gmsh_mesh<2>(session, 0.0, options.slits));
    }
    internal::check_gmsh_size(session, options.size);
    limit_sizes(options.size);
    gmsh::option::setNumber("Mesh.MinimumCirclePoints",
                            std::max(16.0, internal::gmsh_option("Mesh.MinimumCirclePoints")));
    const auto fill = [&](const TriangulateOptions& how) {
      return triangulate_regions(sample_surfaces(session, options.slits), how);
    };
    const TriangulateOptions careless{.size = 10.0 * model_diagonal(), .min_angle = 0.0};  // tells thicknesses as well
    internal::mesh_with_walls<2>(
        session, options.sagitta, [&] { session.generate(1); }, [&] { return fill(careless).mesh; });
    return fill({.size = options.size});
  }
}

/// Calls body(session), with what the gmsh API throws turned into InputError.
template <class Body> auto in_session(const std::string& path, const Body& body) {
  const GmshSession session(path);
  try {
    return body(session);
  } catch (const std::string& message) {
    session.fail(message);
  } catch (const std::bad_alloc&) {
    session.fail("more than the memory there is: the file is damaged, or too large");
  }
}

}  // namespace

template <int Dim> MeshData<Dim> read_gmsh(const std::string& path, const GmshOptions& options) {
  return read_curved_gmsh<Dim>(path, options).mesh;
}

template <int Dim> CurvedMesh<Dim> read_curved_gmsh(const std::string& path, const GmshOptions& options) {
  const Format format = format_of(path);
  if (!(options.size >= 0.0))
    throw InputError(
        fmt::format("{}: size is {}, expected a positive length, or 0 for the file's own", path, options.size));
  if (!(options.factor > 0.0))
    throw InputError(fmt::format("{}: factor is {}, expected a positive number", path, options.factor));
  if (format == Format::msh && options.size > 0.0)
    throw InputError(fmt::format("{}: a .msh file comes with its own cells, a size ({}) applies to geometry only", path,
                                 options.size));
  if (format != Format::geo && !options.parameters.empty())
    throw InputError(fmt::format("{}: only .geo files have parameters", path));
  if (format == Format::geo) check_last_line(path);
  if (format != Format::cad && !options.trust) internal::require_harmless(path);
  return in_session(path, [&](const GmshSession& session) {
    CurvedMesh<Dim> curved = read<Dim>(session, path, format, options);
    curved.order = internal::highest_order(Dim);
    return curved;
  });
}

int gmsh_dimension(const std::string& path, bool trust) {
  const Format format = format_of(path);
  if (format == Format::cad) return 3;
  if (format == Format::geo) check_last_line(path);
  if (!trust) internal::require_harmless(path);
  return in_session(path, [&](const GmshSession& session) {
    open(session, path, format);
    return internal::all_entities(3).empty() ? 2 : 3;
  });
}

template MeshData<2> read_gmsh<2>(const std::string&, const GmshOptions&);
template MeshData<3> read_gmsh<3>(const std::string&, const GmshOptions&);
template CurvedMesh<2> read_curved_gmsh<2>(const std::string&, const GmshOptions&);
template CurvedMesh<3> read_curved_gmsh<3>(const std::string&, const GmshOptions&);

}  // namespace efree
