// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/inspect.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/lower_case.hpp"
#include "efree/geometry/cloud/spacing.hpp"
#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/input/surface_check.hpp"
#include "efree/geometry/mesh/walls.hpp"
#include "efree/geometry/meshing/gmsh_reader.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/io/case/internal/inspect_image.hpp"
#include "efree/io/case/internal/inspection_fields.hpp"
#include "efree/io/confined/internal/confined.hpp"
#include "efree/io/files/internal/cannot_write.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkFieldData.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkStringArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridWriter.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace efree {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

// --- Meshes ---------------------------------------------------------------------------------------------------------

/// Looked for in growing neighbourhoods, as looking far is slow.
template <int Dim>
std::optional<typename Inspection<Dim>::Feature> smallest_feature(const FineMesh<Dim>& mesh, double diagonal) {
  for (double reach = diagonal / 64.0; reach < diagonal; reach *= 2.0) {
    const Vector size = feature_size(mesh, reach);
    Index at = 0;
    if (const double least = size.minCoeff(&at); std::isfinite(least))
      return {{"thickness or diameter of a bend", least, mesh.vertex(at)}};
  }
  return {};
}

/// Where the sorted values have passed none, 5 % and half of the weights.
std::array<double, 3> shares(std::vector<std::pair<double, double>> weighted) {
  std::ranges::sort(weighted);
  double total = 0.0, passed = 0.0;
  for (const auto& [value, weight] : weighted) total += weight;
  std::array<double, 3> out{};
  constexpr std::array wanted{0.0, 0.05, 0.5};
  std::size_t next = 0;
  for (const auto& [value, weight] : weighted) {
    passed += weight;
    while (next < wanted.size() && passed >= wanted[next] * total) out[next++] = value;
  }
  return out;
}

/// Sizes for a body whose walls are no thinner than that.
template <int Dim> typename Inspection<Dim>::Suggestion suggestion(const Inspection<Dim>& in, double thickness) {
  constexpr double most = 2e6, regular = Dim == 2 ? 0.433 : 0.118;  // cells; the volume of one with edges of 1
  const double wanted = std::min(0.5 * thickness, in.box.diagonal().norm() / 20.0);
  const double h = std::max(wanted, std::pow(in.volume / (most * regular), 1.0 / Dim));
  const double cells = in.volume / (regular * std::pow(h, Dim)), vertices = cells / (Dim == 2 ? 2.0 : 5.5);
  const double nodes = std::clamp(vertices / (Dim == 2 ? 30.0 : 60.0), 1.0, 1e4);  // see default_spacing
  return {h, cells, std::max(1.5 * h, std::pow(in.volume / nodes, 1.0 / Dim)), h > wanted};
}
template <int Dim>
std::optional<typename Inspection<Dim>::Suggestion> suggestion(const Inspection<Dim>& in, const FineMesh<Dim>& mesh) {
  return suggestion(in, std::min(thin_wall(mesh, 0.05), in.box.diagonal().norm()));
}

template <int Dim> void add_mesh(const MeshData<Dim>& data, Inspection<Dim>& out) {
  GeometrySummary<Dim> summary = summarize(data);
  const FineMesh<Dim> mesh(data);
  out.box = summary.box;
  out.volume = summary.volume;
  out.boundary = summary.boundary;
  out.bodies = std::move(summary.bodies);
  out.groups = std::move(summary.groups);
  out.smallest = smallest_feature(mesh, out.box.diagonal().norm());
  out.facts = {{"connected_bodies", summary.num_components},
               {"vertices", summary.num_vertices},
               {"cells", summary.num_cells},
               {"shortest_edge", summary.smallest_edge},
               {"longest_edge", summary.largest_edge},
               {"smallest_angle_degrees", summary.smallest_angle}};
  out.suggestion = suggestion(out, mesh);

  std::vector<Index> group_of(mesh.num_facets(), -1);
  for (Index g = static_cast<Index>(out.groups.size()) - 1; g >= 0; --g)  // of several names the first is drawn
    for (const auto& group : mesh.groups())
      if (group.name == out.groups[g].name)
        for (const Index f : group.facets) group_of[f] = g;
  out.points = mesh.vertices();
  using Piece = typename Inspection<Dim>::Piece;
  if constexpr (Dim == 2)
    for (Index c = 0; c < mesh.num_cells(); ++c) {
      const auto& corners = mesh.cells().col(c);
      out.pieces.push_back(Piece{{corners[0], corners[1], corners[2], -1}, mesh.region(c), -1});
    }
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    Piece piece{.region = mesh.region(mesh.facet_cell(f)), .group = group_of[f]};
    for (int k = 0; k < Dim; ++k) piece.corners[k] = mesh.facets()(k, f);
    out.pieces.push_back(piece);
  }
}

template <int Dim> Inspection<Dim> inspect_gmsh(const std::string& path, std::string kind, bool trust) {
  Inspection<Dim> out{.file = path, .kind = std::move(kind)};
  add_mesh(read_gmsh<Dim>(path, {.trust = trust}), out);
  if (out.groups.empty())
    out.remarks.emplace_back("no part of the boundary has a name: select by place, e.g. on = { box = [...] }");
  return out;
}

/// Spacing of the cloud at every vertex; none for finite elements.
template <int Dim> Vector cloud_spacing(const ApproximationOptions& options, const FineMesh<Dim>& mesh) {
  if (options.kind != BasisKind::mls) return {};
  return graded_spacing(mesh, options.spacing > 0.0 ? options.spacing : default_spacing(mesh), options.grading);
}

template <int Dim>
std::optional<typename Inspection<Dim>::Walls> find_walls(const FineMesh<Dim>& mesh, const Vector& spacing) {
  const Vector thickness = wall_thickness(mesh);
  typename Inspection<Dim>::Walls walls;
  if (spacing.size() > 0) walls.spacing = spacing.maxCoeff();
  std::vector<std::pair<double, double>> lengths, nodes, edges;
  double boundary = 0.0, faced = 0.0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const double measure = mesh.facet_measure(f);
    boundary += measure;
    if (!std::isfinite(thickness[f])) continue;
    faced += measure;
    Vec<Dim> middle = Vec<Dim>::Zero();
    double edge = 0.0, apart = 0.0;
    for (int k = 0; k < Dim; ++k) {
      const Vec<Dim> x = mesh.vertex(mesh.facets()(k, f));
      middle += x / Dim;
      edge += (mesh.vertex(mesh.facets()((k + 1) % Dim, f)) - x).norm() / Dim;
      if (spacing.size() > 0) apart += spacing[mesh.facets()(k, f)] / Dim;
    }
    if (lengths.empty() || thickness[f] < walls.thickness[0]) {
      walls.thickness[0] = thickness[f];
      walls.at = middle;
    }
    lengths.emplace_back(thickness[f], measure);
    edges.emplace_back(thickness[f] / edge, measure);
    if (spacing.size() > 0) nodes.emplace_back(thickness[f] / apart, measure);
  }
  if (lengths.empty()) return {};
  walls.thickness = shares(std::move(lengths));
  walls.nodes = shares(std::move(nodes));
  walls.edges = shares(std::move(edges));
  walls.share = faced / boundary;
  return walls;
}

/// What an analysis can do about walls that its cloud or mesh hardly resolves.
struct WallRemedies {
  bool corrections = false, quadratic_cells = false;
};

/// What follows from walls that cloud or mesh hardly resolve.
template <int Dim>
void remark_on_walls(const ApproximationOptions& options, WallRemedies remedies, Inspection<Dim>& out) {
  if (!out.walls) return;
  // A wall bends as it should with two functions across it or more.
  constexpr double enough = 2.0;
  const auto& walls = *out.walls;
  if (walls.spacing > 0.0 && walls.nodes[1] < enough) {
    const double wanted = walls.spacing * walls.nodes[1] / enough;
    if (remedies.corrections)
      out.remarks.push_back(fmt::format(
          "the cloud alone is too stiff in walls of fewer than {:g} nodes: the answer is corrected towards the "
          "elements "
          "of the fine mesh, which takes more iterations, and the estimated error says how far off the cloud was",
          enough));
    else
      out.remarks.push_back(
          fmt::format("the cloud is too stiff in walls of fewer than {:g} nodes, and nothing corrects it: take [cloud] "
                      "spacing = {:.2g}",
                      enough, wanted));
  }
  if (walls.edges[1] < enough && options.kind != BasisKind::p2)
    out.remarks.push_back(fmt::format(
        "linear elements are too stiff in walls of fewer than {:g} edges of the fine mesh: {}", enough,
        remedies.corrections && options.kind == BasisKind::mls && options.interpolation == 0
            ? "quadratic ones take over where the estimate asks for them; a smaller mesh_size resolves stresses"
        : remedies.quadratic_cells ? "take a smaller mesh_size or quadratic cells"
                                   : "take a smaller mesh_size"));
}

/// A case as its analysis will see it: with its mesh size, and with the parts it selects.
template <int Dim> Inspection<Dim> inspect_case(const std::string& path, const PreparedMesh<Dim>& made,
                                                const ApproximationOptions& options, WallRemedies remedies) {
  const FineMesh<Dim>& mesh = *made.mesh;
  MeshData<Dim> data{mesh.vertices(), mesh.cells(), {}};
  data.region_names = mesh.region_names();
  for (Index c = 0; c < mesh.num_cells(); ++c) data.regions.push_back(mesh.region(c));
  for (const auto& group : mesh.groups()) {
    if (group.name.starts_with('\x01')) continue;
    data.groups.push_back({group.name, {}});
    for (const Index f : group.facets) {
      std::array<Index, Dim> facet;
      for (int k = 0; k < Dim; ++k) facet[k] = mesh.facets()(k, f);
      data.groups.back().facets.push_back(facet);
    }
  }
  Inspection<Dim> out{.file = path, .kind = "case"};
  add_mesh(data, out);
  for (const auto& [name, reported] : made.reports)
    out.facts.emplace_back(name, std::visit([](auto value) { return static_cast<double>(value); }, reported));
  out.remarks = made.warnings;
  Vector spacing;
  try {
    spacing = cloud_spacing(options, mesh);
  } catch (const InputError& error) {  // of a spacing below the edges of the mesh: what is in the way of an analysis
    out.remarks.emplace_back(error.what());
  }
  out.walls = find_walls(mesh, spacing);
  remark_on_walls(options, remedies, out);
  return out;
}
template <int Dim> Inspection<Dim> inspect_case(const std::string& path, const Case<Dim>& analysis) {
  const PreparedMesh<Dim> made = prepare(analysis);
  const Settings<Dim> settings = with_defaults<Dim>(analysis, made);
  const ApproximationOptions& options = settings.common.approximation;
  return inspect_case(
      path, made, options,
      {.corrections = settings.corrected && options.dilatation != Dilatation::averaged, .quadratic_cells = true});
}
template <int Dim> Inspection<Dim> inspect_case(const std::string& path, const DynamicsCase<Dim>& dynamics_case) {
  ApproximationOptions options = dynamics_case.common.approximation;
  if (dynamics_case.method != DynamicsMethod::total_lagrangian)
    options.kind = BasisKind::p1;  // no nodes but the vertices
  Inspection<Dim> inspection = inspect_case(path, prepare(dynamics_case), options, {});
  if (inspection.suggestion) inspection.suggestion->spacing = 0.0;  // no cloud comes with the mesh
  return inspection;
}
template <int Dim> Inspection<Dim> inspect_case(const std::string& path, const EffectiveCase<Dim>& analysis) {
  EffectiveCase<Dim> geometry_alone = analysis;
  geometry_alone.common.materials.clear();
  return inspect_case(path, prepare(geometry_alone), {}, {});
}

// --- Surfaces -------------------------------------------------------------------------------------------------------

Inspection<3> inspect_surface(const std::string& path) {
  const SurfaceCheck check = check_surface(read_surface(path));
  Inspection<3> out{.file = path, .kind = "surface"};
  out.box = check.box;
  out.volume = check.volume;
  out.boundary = check.area;
  if (check.fault.empty()) out.bodies.push_back({"", check.triangles, check.volume, check.box});
  out.groups = check.groups;
  if (check.thinnest) out.smallest = {"wall", check.thinnest->thickness, check.thinnest->at};
  out.facts = {{"triangles", check.triangles},
               {"points", check.points},
               {"shells", check.shells},
               {"degenerate_triangles", check.degenerate},
               {"open_edges", check.open_edges},
               {"edges_of_more_than_two_triangles", check.crowded_edges},
               {"crossing_pairs_of_triangles", check.crossings},
               {"shortest_edge", check.shortest_edge},
               {"longest_edge", check.longest_edge},
               {"narrow_gaps", check.gaps.size()}};
  if (check.fault.empty())
    out.suggestion = suggestion(out, check.thinnest ? check.thinnest->thickness : check.box.diagonal().norm());
  if (!check.fault.empty())
    out.remarks.push_back(
        fmt::format("no closed surface as it is ({}); [geometry.surface] wrap = true puts one around it", check.fault));
  if (!check.gaps.empty()) {
    const auto narrowest = std::ranges::min_element(check.gaps, {}, &SurfaceGap::narrowest);
    out.facts.emplace_back("narrowest_gap", narrowest->narrowest);
    out.remarks.push_back(fmt::format(
        "{} gap{} narrower than the default mesh_size {:.3g}, the narrowest {:.3g} wide at ({:.6g}): a mesh may close "
        "{}, which analyses warn of or refuse",
        check.gaps.size(), check.gaps.size() == 1 ? "" : "s", default_surface_size(check.surface), narrowest->narrowest,
        fmt::join(narrowest->at, ", "), check.gaps.size() == 1 ? "it" : "them"));
  }
  out.points = check.surface.points;
  for (std::size_t t = 0; t < check.surface.triangles.size(); ++t) {
    const auto& [a, b, c] = check.surface.triangles[t];
    out.pieces.push_back({{a, b, c, -1}, 0, check.group_of[t]});
  }
  return out;
}

// --- Text and JSON --------------------------------------------------------------------------------------------------

/// Round-off, measured by `scale`, is shown as 0.
template <int Dim> std::string tuple(const Vec<Dim>& x, double scale) {
  const Vec<Dim> shown = x.unaryExpr([&](double v) { return std::abs(v) < 1e-9 * scale ? 0.0 : v; });
  return fmt::format("({:.6g})", fmt::join(shown, ", "));
}
template <int Dim> std::string range(const BoundingBox<Dim>& box, double scale) {
  return fmt::format("{} to {}", tuple<Dim>(box.min(), scale), tuple<Dim>(box.max(), scale));
}
template <int Dim> std::string direction(const Vec<Dim>& normal) {
  const Vec<Dim> shown = normal.unaryExpr([](double v) { return std::abs(v) < 5e-4 ? 0.0 : v; });
  return shown.norm() > 0.0 ? fmt::format("({:.3f})", fmt::join(shown, ", ")) : "none";
}

/// Columns as wide as their widest entries, the first to the left and the others to the right.
std::string table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths(rows.front().size(), 0);
  for (const auto& row : rows)
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  std::string out;
  for (const auto& row : rows) {
    std::string line = "  ";
    for (std::size_t c = 0; c < row.size(); ++c)
      line += c == 0 || c + 1 == row.size() ? fmt::format("{:<{}}  ", row[c], widths[c])
                                            : fmt::format("{:>{}}  ", row[c], widths[c]);
    while (line.ends_with(' ')) line.pop_back();
    out += line + '\n';
  }
  return out;
}

template <int Dim> ordered_json json_of(const Vec<Dim>& x) {
  return std::vector<double>(x.begin(), x.end());
}
template <int Dim> ordered_json json_of(const BoundingBox<Dim>& box) {
  return {json_of<Dim>(box.min()), json_of<Dim>(box.max())};
}

AnyInspection inspect_here(const fs::path& file, const Reading& reading) {
  const std::string path = file.string(), name = internal::lower_case(file.filename().string());
  const auto ends = [&](auto... endings) { return (name.ends_with(endings) || ...); };
  std::error_code error;  // names that are too long are no files
  const bool is_folder = fs::is_directory(file, error);
  if (!is_folder && !fs::is_regular_file(file, error)) throw InputError(fmt::format("there is no file {}", path));
  if (ends(".toml"))
    return std::visit([&](const auto& of) -> AnyInspection { return inspect_case(path, of); },
                      read_case(file, reading));
  if (ends(".stl", ".off", ".obj", ".ply")) return inspect_surface(path);
  if (ends(".step", ".stp", ".iges", ".igs", ".brep")) return inspect_gmsh<3>(path, "CAD", reading.trust);
  if (ends(".geo", ".msh")) {
    const std::string kind = ends(".geo") ? "gmsh geometry" : "gmsh mesh";
    if (gmsh_dimension(path, reading.trust) == 2) return inspect_gmsh<2>(path, kind, reading.trust);
    return inspect_gmsh<3>(path, kind, reading.trust);
  }
  if (ends(".raw"))
    throw InputError(
        fmt::format("{}: a .raw file says nothing about itself; inspect a case that gives its size and "
                    "type in [geometry.image] raw",
                    path));
  if (is_folder || ends(".png", ".pgm", ".pbm", ".ppm", ".pnm", ".tif", ".tiff", ".nrrd", ".nhdr", ".mha", ".mhd",
                        ".nii", ".nii.gz", ".inr", ".inr.gz")) {
    const ImageValues values = image_values(path);
    if (values.dimension == 2) return internal::inspect_image<2>(path, values);
    return internal::inspect_image<3>(path, values);
  }
  throw InputError(fmt::format(
      "{}: a file of unknown kind, expected a case (.toml), gmsh (.geo, .msh), CAD (.step, .iges, .brep), an "
      "image (.png, .tif, .pgm, .nrrd, .mha, .nii, .inr, ..., a folder of slices) or a surface (.stl, .off, .obj, "
      ".ply)",
      path));
}

}  // namespace

AnyInspection inspect(const fs::path& file, const Reading& reading, const Monitor& monitor) {
  const Stage stage("inspect", monitor);
  return internal::confined(
      {file.string(), "what reads it", reading}, [&] { return inspect_here(file, reading); }, [&] { stage.tick(0.0); });
}

template <int Dim> std::string inspection_text(const Inspection<Dim>& in) {
  const char* const volume = Dim == 2 ? "area" : "volume";
  const char* const area = Dim == 2 ? "length" : "area";
  const Vec<Dim> size = in.box.sizes();
  const double scale = size.norm();
  std::string out = fmt::format("{}: {}, {} dimensions\n", in.file, in.kind, Dim);
  out += fmt::format("box {}, {:.6g} large\n", range<Dim>(in.box, scale), fmt::join(size, " x "));
  if (in.volume > 0.0) out += fmt::format("{} {:.6g}, ", volume, in.volume);
  out += fmt::format("{} of the boundary {:.6g}\n", area, in.boundary);
  if (!in.bodies.empty()) {
    std::vector<std::vector<std::string>> rows{{"region", volume, "share", "box"}};
    for (const auto& body : in.bodies)
      rows.push_back({body.name.empty() ? "(no name)" : fmt::format("\"{}\"", body.name),
                      fmt::format("{:.6g}", body.volume), fmt::format("{:.3g} %", 100.0 * body.volume / in.volume),
                      range<Dim>(body.box, scale)});
    out += fmt::format("\nregions: {}\n{}", in.bodies.size(), table(rows));
  }
  if (!in.groups.empty()) {
    std::vector<std::vector<std::string>> rows{{"name", "facets", area, "mean normal", "", "box"}};
    // Of many parts those that are next to nothing are told together.
    constexpr std::size_t most = 40;
    constexpr double little = 0.01;
    std::size_t small = 0;
    double small_facets = 0.0, small_measure = 0.0;
    for (const auto& group : in.groups) {
      if (in.groups.size() > most && group.measure < little * in.boundary) {
        ++small;
        small_facets += group.num_facets;
        small_measure += group.measure;
        continue;
      }
      rows.push_back({fmt::format("\"{}\"", group.name), fmt::format("{}", group.num_facets),
                      fmt::format("{:.6g}", group.measure), direction<Dim>(group.mean_normal),
                      group.normal ? "flat" : "curved", range<Dim>(group.box, scale)});
    }
    out += fmt::format("\nnamed parts of the boundary: {}\n{}", in.groups.size(), table(rows));
    if (small > 0)
      out += fmt::format("  and {} of less than {:g} % of the boundary each (--json has all): {:g} facets, {} {:.6g}\n",
                         small, 100.0 * little, small_facets, area, small_measure);
  }
  out += "\n";
  if (in.smallest)
    out += fmt::format("smallest feature: {} {:.4g} at {}\n", in.smallest->what, in.smallest->size,
                       tuple<Dim>(in.smallest->at, scale));
  if (in.walls) {
    const bool cloud = in.walls->spacing > 0.0;
    const auto list = [](const std::array<double, 3>& values) {
      return fmt::format("{:.3g}", fmt::join(values, ", "));
    };
    const auto& across = cloud ? in.walls->nodes : in.walls->edges;
    out += fmt::format("walls: {:.2g} {} across at the thinnest, {:.2g} at 5 %, {:.2g} at half of the boundary",
                       across[0], cloud ? "nodes" : "edges of the fine mesh", across[1], across[2]);
    out += fmt::format(" (thickness {}", list(in.walls->thickness));
    if (cloud)
      out +=
          fmt::format("; spacing {:.4g}; edges of the fine mesh across {}", in.walls->spacing, list(in.walls->edges));
    out += fmt::format("); the thinnest at {}\n", tuple<Dim>(in.walls->at, scale));
  }
  if (in.suggestion)
    out += fmt::format("to begin with: mesh_size = {:.2g} ({}), about {:.2g} cells{}\n", in.suggestion->mesh_size,
                       in.suggestion->limited ? "two edges across the thin walls would take too many cells"
                                              : "two edges across the walls but the thinnest 5 % of the boundary",
                       in.suggestion->cells,
                       in.suggestion->spacing > 0.0
                           ? fmt::format("; the cloud then has a spacing of about {:.2g}", in.suggestion->spacing)
                           : "");
  std::vector<std::vector<std::string>> rows;
  for (auto [name, value] : in.facts) {
    std::ranges::replace(name, '_', ' ');
    rows.push_back({name, fmt::format("{:.6g}", value), ""});
  }
  if (!rows.empty()) out += fmt::format("quality\n{}", table(rows));
  for (const std::string& remark : in.remarks) out += fmt::format("note: {}\n", remark);
  return out;
}

template <int Dim> std::string inspection_json(const Inspection<Dim>& in) {
  ordered_json json{{"file", in.file}, {"kind", in.kind}, {"dimensions", Dim}, {"box", json_of<Dim>(in.box)}};
  json["volume"] = in.volume > 0.0 ? ordered_json(in.volume) : ordered_json();
  json["boundary"] = in.boundary;
  json["regions"] = ordered_json::array();
  for (const auto& body : in.bodies)
    json["regions"].push_back({{"name", body.name}, {"volume", body.volume}, {"box", json_of<Dim>(body.box)}});
  json["suggestion"] = nullptr;
  if (in.suggestion) {
    json["suggestion"] = {{"mesh_size", in.suggestion->mesh_size}, {"cells", in.suggestion->cells}};
    if (in.suggestion->spacing > 0.0) json["suggestion"]["spacing"] = in.suggestion->spacing;
  }
  json["parts"] = ordered_json::array();
  for (const auto& group : in.groups)
    json["parts"].push_back({{"name", group.name},
                             {"facets", group.num_facets},
                             {"measure", group.measure},
                             {"flat", group.normal.has_value()},
                             {"mean_normal", json_of<Dim>(group.mean_normal)},
                             {"box", json_of<Dim>(group.box)}});
  json["smallest_feature"] = nullptr;
  if (in.smallest)
    json["smallest_feature"] = {
        {"what", in.smallest->what}, {"size", in.smallest->size}, {"at", json_of<Dim>(in.smallest->at)}};
  json["walls"] = nullptr;
  if (in.walls) {
    const bool cloud = in.walls->spacing > 0.0;
    json["walls"] = {
        {"thickness", in.walls->thickness}, {"nodes", cloud ? ordered_json(in.walls->nodes) : ordered_json()},
        {"edges", in.walls->edges},         {"spacing", cloud ? ordered_json(in.walls->spacing) : ordered_json()},
        {"at", json_of<Dim>(in.walls->at)}, {"share", in.walls->share}};
  }
  json["facts"] = ordered_json::object();
  for (const auto& [name, value] : in.facts) json["facts"][name] = value;
  json["remarks"] = in.remarks;
  return json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + '\n';
}

template <int Dim> void write_pieces(const fs::path& file, const Inspection<Dim>& in) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  points->SetNumberOfPoints(in.points.cols());
  for (Index p = 0; p < in.points.cols(); ++p)
    points->SetPoint(p, in.points(0, p), in.points(1, p), Dim == 3 ? in.points(Dim - 1, p) : 0.0);
  vtkNew<vtkUnstructuredGrid> grid;
  grid->SetPoints(points);
  grid->AllocateExact(static_cast<vtkIdType>(in.pieces.size()), 4 * static_cast<vtkIdType>(in.pieces.size()));
  vtkNew<vtkIntArray> region, group;
  region->SetName("region");
  group->SetName("group");
  constexpr std::array<int, 5> types{VTK_EMPTY_CELL, VTK_VERTEX, VTK_LINE, VTK_TRIANGLE, VTK_QUAD};
  for (const auto& piece : in.pieces) {
    std::array<vtkIdType, 4> corners{};
    std::size_t count = 0;
    for (; count < 4 && piece.corners[count] >= 0; ++count) corners[count] = piece.corners[count];
    grid->InsertNextCell(types[count], static_cast<vtkIdType>(count), corners.data());
    region->InsertNextValue(piece.region);
    group->InsertNextValue(piece.group);
  }
  grid->GetCellData()->AddArray(region);
  grid->GetCellData()->AddArray(group);
  const auto add_names = [&](const char* array, const auto& parts) {
    vtkNew<vtkStringArray> names;
    names->SetName(array);
    for (const auto& part : parts) names->InsertNextValue(part.name);
    grid->GetFieldData()->AddArray(names);
  };
  add_names("region_names", in.bodies);
  add_names("group_names", in.groups);
  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->SetFileName(file.c_str());
  writer->SetInputData(grid);
  writer->SetDataModeToAppended();
  writer->EncodeAppendedDataOff();
  writer->SetCompressorTypeToZLib();
  if (!writer->Write() || writer->GetErrorCode() != 0) internal::cannot_write(file);
}

template std::string inspection_text<2>(const Inspection<2>&);
template std::string inspection_text<3>(const Inspection<3>&);
template std::string inspection_json<2>(const Inspection<2>&);
template std::string inspection_json<3>(const Inspection<3>&);
template void write_pieces<2>(const fs::path&, const Inspection<2>&);
template void write_pieces<3>(const fs::path&, const Inspection<3>&);

}  // namespace efree
