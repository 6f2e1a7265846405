// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/core/internal/lower_case.hpp"
#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/input/surface_check.hpp"
#include "efree/geometry/input/surface_gaps.hpp"
#include "efree/geometry/input/surface_offsets.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/gmsh_reader.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/geometry/meshing/surface_image.hpp"
#include "efree/io/case/internal/case_parts.hpp"
#include "efree/io/case/internal/image_geometry.hpp"
#include "efree/io/case/internal/mesh_reports.hpp"
#include "efree/io/case/internal/read_geometry.hpp"
#include "efree/io/confined/internal/confined.hpp"
#include "efree/io/confined/internal/transfer.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <span>

namespace efree::internal {
namespace {

namespace fs = std::filesystem;

/// What endings of names stand for. Some images say only inside how many dimensions they have.
enum class FileKind { gmsh, cad, planar_image, image, slices, raw_image, surface };
constexpr std::pair<std::string_view, FileKind> file_kinds[] = {
    {".geo", FileKind::gmsh},         {".msh", FileKind::gmsh},         {".step", FileKind::cad},
    {".stp", FileKind::cad},          {".iges", FileKind::cad},         {".igs", FileKind::cad},
    {".brep", FileKind::cad},         {".png", FileKind::planar_image}, {".pgm", FileKind::planar_image},
    {".pbm", FileKind::planar_image}, {".ppm", FileKind::planar_image}, {".pnm", FileKind::planar_image},
    {".tif", FileKind::image},        {".tiff", FileKind::image},       {".nrrd", FileKind::image},
    {".nhdr", FileKind::image},       {".mha", FileKind::image},        {".mhd", FileKind::image},
    {".nii", FileKind::image},        {".nii.gz", FileKind::image},     {".inr", FileKind::image},
    {".inr.gz", FileKind::image},     {".raw", FileKind::raw_image},    {".stl", FileKind::surface},
    {".off", FileKind::surface},      {".obj", FileKind::surface},      {".ply", FileKind::surface}};

FileKind kind_of(const Section& geometry, const fs::path& file) {
  if (is_slices(file.string())) return FileKind::slices;
  const std::string name = lower_case(file.filename().string());
  for (const auto& [ending, kind] : file_kinds)
    if (name.ends_with(ending)) return kind;
  std::vector<std::string_view> endings;
  for (const auto& entry : file_kinds) endings.push_back(entry.first);
  geometry.fail("file", fmt::format("{}: a file of unknown kind, expected a name that ends in {}", file.string(),
                                    fmt::join(endings, ", ")));
}

fs::path file_of(const Section& geometry, const fs::path& folder) {
  const fs::path file = folder / geometry.text("file");
  if (is_slices(file.string())) return file;
  std::error_code error;  // names that are too long are no files
  if (!fs::is_regular_file(file, error)) geometry.fail("file", fmt::format("there is no file {}", file.string()));
  return file;
}

/// One number that makes a shape.
struct ShapeParameter {
  std::string_view name;
  Interval range = positive;
  std::optional<double> fallback{};
  bool whole = false;
};
template <int Dim> struct Shape {
  std::string_view name;
  std::vector<ShapeParameter> parameters;
  CurvedMesh<Dim> (*make)(std::span<const double> p, double size, double sagitta);
  bool arcs = false;  ///< whether it has some, so that coarse meshes have another shape
};

CurvedMesh<2> filled(const PlanarDomain& domain, double size) {
  return triangulate_curved(domain, {.size = size});
}

template <int Dim> std::vector<Shape<Dim>> all_shapes();
template <> std::vector<Shape<2>> all_shapes<2>() {
  using P = std::span<const double>;
  constexpr Interval count{1.0, 1e6, true, true}, seed{0.0, 0x1p53, true, true};
  return {
      {"rectangle",
       {{"width"}, {"height"}, {"x", any_number, 0.0}, {"y", any_number, 0.0}},
       [](P p, double size, double) { return filled(shapes::rectangle(p[2], p[3], p[2] + p[0], p[3] + p[1]), size); }},
      {"plate_with_hole",
       {{"radius"}, {"half_width"}},
       [](P p, double size, double sagitta) {
         return filled(shapes::quarter_plate_with_hole(p[0], p[1], size, sagitta), size);
       },
       true},
      {"l_shape", {{"side"}}, [](P p, double size, double) { return filled(shapes::l_shape(p[0]), size); }},
      {"cook", {}, [](P, double size, double) { return filled(shapes::cook(), size); }},
      {"annulus",
       {{"inner"}, {"outer"}},
       [](P p, double size, double sagitta) { return filled(shapes::annulus(p[0], p[1], size, sagitta), size); },
       true},
      {"random_holes",
       {{"width"}, {"count", count, {}, true}, {"r_min"}, {"r_max"}, {"gap"}, {"seed", seed, 1.0, true}},
       [](P p, double size, double sagitta) {
         return filled(shapes::plate_with_random_holes(p[0], static_cast<int>(p[1]), p[2], p[3], p[4],
                                                       static_cast<std::uint64_t>(p[5]), size, sagitta),
                       size);
       },
       true}};
}
template <> std::vector<Shape<3>> all_shapes<3>() {
  using P = std::span<const double>;
  return {
      {"box",
       {{"width"}, {"depth"}, {"height"}},
       [](P p, double size, double) {
         return CurvedMesh<3>{solids::box({p[0], p[1], p[2]}, size)};
       }},
      {"spherical_cavity",
       {{"radius"}, {"half_width"}, {"size_at_hole", not_negative, 0.0}},
       [](P p, double size, double sagitta) { return solids::spherical_cavity(p[0], p[1], size, p[2], sagitta); }},
      {"thick_cylinder",
       {{"inner"}, {"outer"}, {"height"}, {"size_at_inner", not_negative, 0.0}},
       [](P p, double size, double sagitta) { return solids::thick_cylinder(p[0], p[1], p[2], size, p[3], sagitta); }},
      {"thick_sphere",
       {{"inner"}, {"outer"}, {"size_at_inner", not_negative, 0.0}},
       [](P p, double size, double sagitta) { return solids::thick_sphere(p[0], p[1], size, p[2], sagitta); }},
      {"cylinder", {{"radius"}, {"height"}}, [](P p, double size, double sagitta) {
         return solids::cylinder(p[0], p[1], size, sagitta);
       }}};
}

template <int Dim> const Shape<Dim>* find_shape(const std::vector<Shape<Dim>>& shapes, const std::string& name) {
  const auto found = std::ranges::find(shapes, name, &Shape<Dim>::name);
  return found == shapes.end() ? nullptr : &*found;
}

int shape_dimension(const Section& geometry) {
  const std::string name = geometry.text("shape");
  const auto planar = all_shapes<2>();
  const auto solid = all_shapes<3>();
  if (find_shape(planar, name)) return 2;
  if (find_shape(solid, name)) return 3;
  Section::Keys known;
  for (const auto& shape : planar) known.push_back(shape.name);
  for (const auto& shape : solid) known.push_back(shape.name);
  geometry.fail("shape", fmt::format("there is no shape \"{}\"; {}", name, suggestion(name, known)));
}

/// A length in a unit, to 46 bits, as it comes out whatever the unit of both.
double in_unit(double length, double unit) {
  constexpr int bits = 46;
  int exponent = 0;
  const double mantissa = std::frexp(length / unit, &exponent);
  return std::ldexp(std::round(std::ldexp(mantissa, bits)), exponent - bits);
}

/// The shape with these parameters, made in a unit of its own, its longest length: meshers decide by rounded numbers,
/// and cases in metres and in inches are to have the same mesh.
template <int Dim> CurvedMesh<Dim> make_shape(const Shape<Dim>& shape, const std::vector<double>& values,
                                              double longest, double size, double sagitta) {
  if (values.empty()) return shape.make(values, size, sagitta);  // which has one size only
  std::vector<double> in_own_unit = values;
  for (std::size_t k = 0; k < values.size(); ++k)
    if (!shape.parameters[k].whole) in_own_unit[k] = in_unit(values[k], longest);
  try {
    return scaled(shape.make(in_own_unit, in_unit(size, longest), sagitta), longest);
  } catch (const InputError&) {
    return shape.make(values, size, sagitta);  // says the lengths of the case
  }
}

template <int Dim> auto shape_mesh(const Section& geometry) {
  const std::string name = geometry.text("shape");
  refuse(geometry, {"slits", "image", "surface"}, "a built-in shape");
  const auto shapes = all_shapes<Dim>();
  const Shape<Dim> shape = *find_shape(shapes, name);
  Section::Keys known;
  for (const ShapeParameter& parameter : shape.parameters) known.push_back(parameter.name);
  if (known.empty()) refuse(geometry, {"parameters"}, fmt::format("the shape \"{}\"", name));
  const Section section = geometry.section("parameters", known);
  Section::Keys missing;
  for (const ShapeParameter& parameter : shape.parameters)
    if (!parameter.fallback && !section.has(parameter.name)) missing.push_back(parameter.name);
  if (!missing.empty())
    geometry.fail(geometry.has("parameters") ? "parameters" : "shape",
                  fmt::format("the shape \"{}\" needs {} in [geometry.parameters]", name, fmt::join(missing, ", ")));
  std::vector<double> values;
  for (const ShapeParameter& parameter : shape.parameters) {
    values.push_back(section.number(parameter.name, parameter.range, parameter.fallback));
    if (parameter.whole && values.back() != std::floor(values.back()))
      section.fail(parameter.name, fmt::format("{} is {}, expected a whole number", parameter.name, values.back()));
  }
  double longest = known.empty() ? 60.0 : 0.0;  // Cook's membrane has no parameters
  for (std::size_t k = 0; k < values.size(); ++k)
    if (!shape.parameters[k].whole) longest = std::max(longest, values[k]);
  return [shape, values, longest](const MeshSize& size) {
    MadeMesh<Dim> made;
    const double length = size_or(shape.arcs ? at_most(4.0, size) : size, longest / 20.0, made);
    CurvedMesh<Dim> curved = make_shape(shape, values, longest, length, size.sagitta_or_natural());
    made.mesh = std::move(curved.mesh);
    made.boundary = std::move(curved.boundary);
    return made;
  };
}

template <int Dim> auto gmsh_mesh(const Section& geometry, const fs::path& file, bool trust) {
  refuse(geometry, {"image", "surface"}, "a gmsh or CAD file");
  GmshOptions options{.slits = geometry.texts("slits"), .trust = trust};
  const Section parameters = geometry.section("parameters", {});
  for (const auto& [key, node] : parameters.table())
    options.parameters[std::string(key.str())] = parameters.number(key.str(), any_number);
  return [path = file.string(), options](const MeshSize& size) {
    GmshOptions sized = options;
    sized.size = size.length;
    // The file's own sizes keep their proportions; the first meshes of an accuracy are not coarser than those.
    constexpr double most = 2.5;
    if (size.coarsening <= most) sized.factor = size.coarsening;
    sized.sagitta = size.sagitta_or_natural();
    CurvedMesh<Dim> curved = read_curved_gmsh<Dim>(path, sized);
    MadeMesh<Dim> made{.mesh = std::move(curved.mesh), .size = size.length};
    if (lower_case(path).ends_with(".msh"))
      made.smooth = true;
    else
      made.boundary = std::move(curved.boundary);
    if (curved.order > 1)
      made.remarks.push_back(
          fmt::format("elements of order {}: their corner nodes are read, edges become straight", curved.order));
    return made;
  };
}

/// What keeps a gap of this width open.
std::string remedy(double width, double diagonal, Mesher mesher, bool wrap) {
  constexpr double finest = 200.0;  // cells along the diagonal
  // Sizes at which slits in forks and rings stay open; a lattice has voxels of half its size.
  const double size = (mesher == Mesher::lattice ? 0.5 : 3.0) * width;
  if (size * finest >= diagonal)
    return wrap ? fmt::format("Take alpha = {:.2g} and mesh_size = {:.2g}, or no wrap", 0.4 * width, width)
                : fmt::format("Take mesh_size = {:.2g}", size);
  return mesher == Mesher::lattice || wrap
             ? "Between closed bodies mesher = \"delaunay\" without a wrap keeps it; within one body widen it"
             : "Widen it: no mesh_size that is feasible resolves it";
}

/// Warns of gaps of a surface that its mesh closes.
void warn_of_closed_gaps(const std::vector<SurfaceGap>& closed, double diagonal, Mesher mesher, bool wrap,
                         MadeMesh<3>& made) {
  made.reports.push_back({"closed_gaps", static_cast<Index>(closed.size())});
  if (closed.empty()) return;
  const SurfaceGap& largest = *std::ranges::max_element(closed, {}, &SurfaceGap::area);
  const std::string width = largest.widest < 1.1 * largest.narrowest
                                ? fmt::format("{:.3g} wide", largest.narrowest)
                                : fmt::format("{:.3g} to {:.3g} wide", largest.narrowest, largest.widest);
  made.warnings.push_back(fmt::format(
      "The body may be far too stiff, or joined to another: the mesh of size {:.3g} closes {} of the surface{}, {} at "
      "({:.6g}), over an area of {:.3g}. {}",
      made.size, closed.size() == 1 ? "1 gap" : fmt::format("{} gaps", closed.size()),
      closed.size() == 1 ? "" : ", the largest", width, fmt::join(largest.at, ", "), 0.5 * largest.area,
      remedy(largest.narrowest, diagonal, mesher, wrap)));
}

std::function<MadeMesh<3>(const MeshSize&)> surface_mesh(const Section& geometry, const fs::path& file) {
  refuse(geometry, {"slits", "parameters", "image"}, "a surface");
  const Section section =
      geometry.section("surface", {"mesher", "wrap", "alpha", "offset", "feature_angle", "largest_only"});
  const auto mesher = section.choice<Mesher>("mesher", {{"delaunay", Mesher::delaunay}, {"lattice", Mesher::lattice}},
                                             Mesher::delaunay);
  if (mesher == Mesher::lattice)
    refuse(section, {"wrap", "alpha", "offset", "feature_angle"},
           "a surface on a lattice, which takes holes and crossings as they are");
  const bool wrap = section.boolean("wrap", false);
  if (!wrap) refuse(section, {"alpha", "offset"}, "a surface that is not wrapped (wrap = true)");
  const WrapOptions wrapping{.alpha = section.number("alpha", positive, 0.0),
                             .offset = section.number("offset", positive, 0.0)};
  SurfaceMeshOptions meshing;
  meshing.feature_angle = section.number("feature_angle", {0.0, 180.0, false, true}, meshing.feature_angle);
  const bool largest_only = section.boolean("largest_only", false);
  // Edges that the case keeps are no facets of a smooth surface.
  const double smooth_angle = section.has("feature_angle")
                                  ? std::min(largest_smooth_angle, meshing.feature_angle * std::numbers::pi / 180.0)
                                  : largest_smooth_angle;
  return [path = file.string(), mesher, wrap, wrapping, meshing, largest_only, smooth_angle](const MeshSize& size) {
    MadeMesh<3> made;
    const SurfaceSoup given = read_surface(path);
    SurfaceSoup soup = given;
    double wrap_alpha = 0.0, wrap_offset = 0.0;
    if (wrap) {
      SurfaceWrap wrapped = wrap_surface(given, wrapping);
      soup = std::move(wrapped.surface);
      wrap_alpha = wrapped.alpha;
      wrap_offset = wrapped.offset;
      made.reports = {{"wrap_alpha", wrapped.alpha},
                      {"wrap_offset", wrapped.offset},
                      {"wrap_max_distance", wrapped.max_distance},
                      {"wrap_mean_distance", wrapped.mean_distance},
                      {"wrap_volume", wrapped.volume}};
      made.remarks.push_back(fmt::format(
          "wrap: alpha {:.4g}, offset {:.4g}; up to {:.4g} (mean {:.4g}) from the given triangles; encloses {:.6g}",
          wrapped.alpha, wrapped.offset, wrapped.max_distance, wrapped.mean_distance, wrapped.volume));
    }
    SurfaceMeshOptions sized = meshing;
    sized.size = size_or(at_most(may_lose_parts, size), default_surface_size(soup), made);
    if (mesher == Mesher::lattice) {
      SurfaceLattice on_lattice = mesh_surface_on_lattice(soup, sized.size);
      made.mesh = std::move(on_lattice.mesh);
      made.reports.push_back({"triangles_turned", on_lattice.turned});
      made.reports.push_back({"shells_turned", on_lattice.shells_turned});
      made.reports.push_back({"closed_fraction", on_lattice.closed});
      made.remarks.push_back(
          fmt::format("{} triangles turned to face as their neighbours do, {:.3g} % of the boundary "
                      "closes holes",
                      on_lattice.turned, 100.0 * on_lattice.closed));
      if (on_lattice.shells_turned > 0)
        made.remarks.push_back(fmt::format(
            "{} closed shell{} faced the wrong way and {} turned: shells within others are cavities, all others bodies",
            on_lattice.shells_turned, on_lattice.shells_turned == 1 ? "" : "s",
            on_lattice.shells_turned == 1 ? "was" : "were"));
      report_lost(on_lattice.lost, made);
    } else {
      try {
        made.mesh = mesh_surface(soup, sized);
      } catch (const InputError& error) {
        if (!wrap) throw;
        throw InputError(fmt::format("{}; {}: where it went in through holes, a larger alpha leaves them closed",
                                     error.what(), made.remarks.front()));
      }
    }
    // Of the file's triangles: a wrap is off these, and closes gaps, too.
    const double reach = mesher == Mesher::lattice ? 0.5 * sized.size : 0.1 * sized.size + wrap_offset;
    const double widest = std::max(2.0 * sized.size, wrap_alpha + 2.0 * wrap_offset);
    warn_of_closed_gaps(closed_gaps(find_gaps(given, widest, 0.5 * sized.size), made.mesh, reach),
                        40.0 * default_surface_size(given), mesher, wrap, made);
    made.boundary = surface_offsets(FineMesh<3>(made.mesh), given, smooth_angle, reach + wrap_offset);
    made.smooth = true;
    if (largest_only) {
      LargestMesh<3> body = keep_largest(std::move(made.mesh));
      made.mesh = std::move(body.mesh);
      report_islands(body.islands, body.fraction, made);
    }
    return made;
  };
}

/// Who reads files of this kind.
std::string_view reader_of(FileKind kind) {
  switch (kind) {
    case FileKind::gmsh:
      return "gmsh";
    case FileKind::cad:
      return "gmsh with OpenCASCADE";
    case FileKind::surface:
      return "CGAL";
    default:
      return "the reader of images";
  }
}

Confinement confinement_of(const fs::path& file, FileKind kind, const Reading& reading) {
  return {file.string(), std::string(reader_of(kind)), reading};
}

/// What makes the mesh of a file, and the grey values if it is an image.
template <int Dim>
void read_file(const Section& geometry, const fs::path& file, const Reading& reading, MeshSource<Dim>& result) {
  const FileKind kind = kind_of(geometry, file);
  const Confinement confinement = confinement_of(file, kind, reading);
  const auto confine = [&](auto mesh) -> decltype(result.mesh) {
    return [mesh = std::move(mesh), confinement](const MeshSize& size, const Stage& stage) {
      return confined(
          confinement, [&] { return mesh(size); }, [&] { stage.tick(0.0); });
    };
  };
  switch (kind) {
    case FileKind::gmsh:
    case FileKind::cad:
      result.mesh = confine(gmsh_mesh<Dim>(geometry, file, reading.trust));
      return;
    case FileKind::planar_image:
    case FileKind::image:
    case FileKind::slices:
    case FileKind::raw_image:
      result.mesh = confine(image_mesh<Dim>(geometry, file, kind == FileKind::raw_image));
      if constexpr (Dim == 3)
        if (auto image = image_alone(geometry, file, kind == FileKind::raw_image))
          result.image = [image = std::move(image), confinement](const Stage& stage) {
            return confined(confinement, image, [&] { stage.tick(0.0); });
          };
      result.grey = grey_of<Dim>(geometry, file, kind == FileKind::raw_image, confinement);
      return;
    case FileKind::surface:
      break;
  }
  if constexpr (Dim == 3)
    result.mesh = confine(surface_mesh(geometry, file));
  else
    geometry.fail("file", fmt::format("{}: a surface bounds a solid, there is nothing planar in it", file.string()));
}

}  // namespace

Section::Keys geometry_keys() {
  return {"file", "shape", "mesh_size", "mesh_ratio", "slits", "parameters", "image", "surface"};
}

int geometry_dimension(const Section& geometry, const fs::path& folder, bool has_plane, const Reading& reading,
                       const Monitor& monitor) {
  if (geometry.has("file") == geometry.has("shape"))
    geometry.fail("shape", fmt::format("[geometry] has {}, expected exactly one of file and shape",
                                       geometry.has("file") ? "both file and shape" : "neither file nor shape"));
  if (geometry.has("shape")) return shape_dimension(geometry);
  const fs::path file = file_of(geometry, folder);
  switch (kind_of(geometry, file)) {
    case FileKind::cad:
    case FileKind::slices:
    case FileKind::surface:
      return 3;
    case FileKind::planar_image:
      return 2;
    case FileKind::image:
      return has_plane ? 2 : 3;
    case FileKind::raw_image: {
      const Section raw = image_section(geometry).section("raw", {});
      const std::size_t dimension = raw.has("size") ? raw.numbers("size", positive).size() : 0;
      if (dimension != 2 && dimension != 3)
        geometry.fail("file",
                      "a .raw file needs [geometry.image] raw = { size = [...], type = \"...\" }, two or three "
                      "numbers in size");
      return static_cast<int>(dimension);
    }
    case FileKind::gmsh:
      break;
  }
  try {
    const Stage stage("read", monitor);
    return confined(
        confinement_of(file, FileKind::gmsh, reading), [&] { return gmsh_dimension(file.string(), reading.trust); },
        [&] { stage.tick(0.0); });
  } catch (const InputError& error) {
    geometry.fail("file", error.what());
  }
}

template <int Dim>
MeshSource<Dim> read_geometry(const Section& geometry, const fs::path& folder, const Reading& reading) {
  MeshSource<Dim> result;
  if (geometry.has("mesh_size") && geometry.has("mesh_ratio"))
    geometry.fail("mesh_ratio", "mesh_size and mesh_ratio say the same thing, expected one of them");
  result.size = geometry.number("mesh_size", positive, 0.0);
  result.ratio = geometry.number("mesh_ratio", {1.0, Interval::infinity, true}, 0.0);
  result.slits = geometry.texts("slits");
  result.where = geometry.where(geometry.has("file") ? "file" : "shape");
  if (geometry.has("shape"))
    result.mesh = [mesh = shape_mesh<Dim>(geometry),
                   confinement = Confinement{fmt::format("the shape \"{}\"", geometry.text("shape")), "the mesher",
                                             reading}](const MeshSize& size, const Stage& stage) {
      return confined(
          confinement, [&] { return mesh(size); }, [&] { stage.tick(0.0); });
    };
  else
    read_file(geometry, file_of(geometry, folder), reading, result);
  return result;
}

template MeshSource<2> read_geometry<2>(const Section&, const fs::path&, const Reading&);
template MeshSource<3> read_geometry<3>(const Section&, const fs::path&, const Reading&);

}  // namespace efree::internal
