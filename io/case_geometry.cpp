// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/geometry/gmsh_reader.hpp"
#include "efree/geometry/planar_domain.hpp"
#include "efree/geometry/solid_shapes.hpp"
#include "efree/io/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <span>

namespace efree::internal {
namespace {

namespace fs = std::filesystem;

/// What endings of names stand for.
enum class FileKind { gmsh, cad };
constexpr std::pair<std::string_view, FileKind> file_kinds[] = {
    {".geo", FileKind::gmsh}, {".msh", FileKind::gmsh}, {".step", FileKind::cad}, {".stp", FileKind::cad},
    {".iges", FileKind::cad}, {".igs", FileKind::cad},  {".brep", FileKind::cad}};

FileKind kind_of(const Section& geometry, const fs::path& file) {
  std::string name = file.filename().string();
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const auto& [ending, kind] : file_kinds)
    if (name.ends_with(ending)) return kind;
  std::vector<std::string_view> endings;
  for (const auto& entry : file_kinds) endings.push_back(entry.first);
  geometry.fail("file", fmt::format("{}: a file of unknown kind, expected a name that ends in {}", file.string(),
                                    fmt::join(endings, ", ")));
}

fs::path file_of(const Section& geometry, const fs::path& folder) {
  const fs::path file = folder / geometry.text("file");
  if (fs::is_directory(file)) geometry.fail("file", fmt::format("{} is a directory, expected a file", file.string()));
  if (!fs::is_regular_file(file)) geometry.fail("file", fmt::format("there is no file {}", file.string()));
  return file;
}

/// One number that makes a shape.
struct Parameter {
  std::string_view name;
  Interval range = positive;
  std::optional<double> fallback{};
  bool whole = false;
};
template <int Dim> struct Shape {
  std::string_view name;
  std::vector<Parameter> parameters;
  MeshData<Dim> (*make)(std::span<const double> p, double size);
};

MeshData<2> filled(const PlanarDomain& domain, double size) {
  return triangulate_data(domain, {.size = size});
}

template <int Dim> std::vector<Shape<Dim>> all_shapes();
template <> std::vector<Shape<2>> all_shapes<2>() {
  using P = std::span<const double>;
  constexpr Interval count{1.0, 1e6, true, true}, seed{0.0, 0x1p53, true, true};
  return {{"rectangle",
           {{"width"}, {"height"}, {"x", any_number, 0.0}, {"y", any_number, 0.0}},
           [](P p, double size) { return filled(shapes::rectangle(p[2], p[3], p[2] + p[0], p[3] + p[1]), size); }},
          {"plate_with_hole",
           {{"radius"}, {"half_width"}},
           [](P p, double size) { return filled(shapes::quarter_plate_with_hole(p[0], p[1], size), size); }},
          {"l_shape", {{"side"}}, [](P p, double size) { return filled(shapes::l_shape(p[0]), size); }},
          {"cook", {}, [](P, double size) { return filled(shapes::cook(), size); }},
          {"annulus",
           {{"inner"}, {"outer"}},
           [](P p, double size) { return filled(shapes::annulus(p[0], p[1], size), size); }},
          {"random_holes",
           {{"width"},
            {"count", count, {}, true},
            {"r_min"},
            {"r_max"},
            {"gap", not_negative, 0.0},
            {"seed", seed, 1.0, true}},
           [](P p, double size) {
             return filled(shapes::plate_with_random_holes(p[0], static_cast<int>(p[1]), p[2], p[3], p[4],
                                                           static_cast<std::uint64_t>(p[5]), size),
                           size);
           }}};
}
template <> std::vector<Shape<3>> all_shapes<3>() {
  using P = std::span<const double>;
  return {
      {"box",
       {{"width"}, {"depth"}, {"height"}},
       [](P p, double size) {
         return solids::box({p[0], p[1], p[2]}, size);
       }},
      {"spherical_cavity",
       {{"radius"}, {"half_width"}, {"size_at_hole", not_negative, 0.0}},
       [](P p, double size) { return solids::spherical_cavity(p[0], p[1], size, p[2]); }},
      {"thick_cylinder",
       {{"inner"}, {"outer"}, {"height"}},
       [](P p, double size) { return solids::thick_cylinder(p[0], p[1], p[2], size); }},
      {"thick_sphere", {{"inner"}, {"outer"}}, [](P p, double size) { return solids::thick_sphere(p[0], p[1], size); }},
      {"cylinder", {{"radius"}, {"height"}}, [](P p, double size) { return solids::cylinder(p[0], p[1], size); }}};
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

/// Complains of sections and keys that have no meaning for this kind of geometry.
void refuse(const Section& geometry, const Section::Keys& keys, std::string_view kind) {
  for (const std::string_view key : keys)
    if (geometry.has(key)) geometry.fail(key, fmt::format("{} has no meaning for {}", key, kind));
}

void require_size(const Section& geometry, std::string_view kind) {
  if (!geometry.has("mesh_size") && !geometry.has("mesh_ratio"))
    geometry.fail("", fmt::format("key \"mesh_size\" or \"mesh_ratio\" is missing in [geometry]: {} has no sizes of "
                                  "its own",
                                  kind));
}

template <int Dim> auto shape_mesh(const Section& geometry) {
  const std::string name = geometry.text("shape");
  refuse(geometry, {"slits"}, "a built-in shape");
  require_size(geometry, "a built-in shape");
  const auto shapes = all_shapes<Dim>();
  const Shape<Dim>& shape = *find_shape(shapes, name);
  Section::Keys known;
  for (const Parameter& parameter : shape.parameters) known.push_back(parameter.name);
  if (known.empty()) refuse(geometry, {"parameters"}, fmt::format("the shape \"{}\"", name));
  const Section section = geometry.section("parameters", known);
  Section::Keys missing;
  for (const Parameter& parameter : shape.parameters)
    if (!parameter.fallback && !section.has(parameter.name)) missing.push_back(parameter.name);
  if (!missing.empty())
    geometry.fail(geometry.has("parameters") ? "parameters" : "shape",
                  fmt::format("the shape \"{}\" needs {} in [geometry.parameters]", name, fmt::join(missing, ", ")));
  std::vector<double> values;
  for (const Parameter& parameter : shape.parameters) {
    values.push_back(section.number(parameter.name, parameter.range, parameter.fallback));
    if (parameter.whole && values.back() != std::floor(values.back()))
      section.fail(parameter.name, fmt::format("{} is {}, expected a whole number", parameter.name, values.back()));
  }
  return [make = shape.make, values](double size) { return MadeMesh<Dim>{make(values, size)}; };
}

template <int Dim> auto gmsh_mesh(const Section& geometry, const fs::path& file) {
  GmshOptions options{.slits = geometry.texts("slits")};
  const Section parameters = geometry.section("parameters", {});
  for (const auto& [key, node] : parameters.table())
    options.parameters[std::string(key.str())] = parameters.number(key.str(), any_number);
  return [path = file.string(), options](double size) {
    GmshOptions sized = options;
    sized.size = size;
    return MadeMesh<Dim>{read_gmsh<Dim>(path, sized)};
  };
}

}  // namespace

Section::Keys geometry_keys() {
  return {"file", "shape", "mesh_size", "mesh_ratio", "slits", "parameters"};
}

int geometry_dimension(const Section& geometry, const fs::path& folder) {
  if (geometry.has("file") == geometry.has("shape"))
    geometry.fail("shape", fmt::format("[geometry] has {}, expected exactly one of file and shape",
                                       geometry.has("file") ? "both file and shape" : "neither file nor shape"));
  if (geometry.has("shape")) return shape_dimension(geometry);
  const fs::path file = file_of(geometry, folder);
  switch (kind_of(geometry, file)) {
    case FileKind::cad:
      return 3;
    case FileKind::gmsh:
      break;
  }
  try {
    return gmsh_dimension(file.string());
  } catch (const InputError& error) {
    geometry.fail("file", error.what());
  }
}

template <int Dim> CaseGeometry<Dim> read_geometry(const Section& geometry, const fs::path& folder) {
  CaseGeometry<Dim> result;
  if (geometry.has("mesh_size") && geometry.has("mesh_ratio"))
    geometry.fail("mesh_ratio", "mesh_size and mesh_ratio say the same thing, expected one of them");
  result.size = geometry.number("mesh_size", positive, 0.0);
  result.ratio = geometry.number("mesh_ratio", {1.0, Interval::infinity, true}, 0.0);
  result.slits = geometry.texts("slits");
  result.where = geometry.where(geometry.has("file") ? "file" : "shape");
  if (geometry.has("shape"))
    result.mesh = shape_mesh<Dim>(geometry);
  else
    result.mesh = gmsh_mesh<Dim>(geometry, file_of(geometry, folder));
  return result;
}

template CaseGeometry<2> read_geometry<2>(const Section&, const fs::path&);
template CaseGeometry<3> read_geometry<3>(const Section&, const fs::path&);

}  // namespace efree::internal
