// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/crack_files.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/pictures/internal/colours.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/records/internal/series.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <regex>

namespace efree {
namespace fs = std::filesystem;
namespace {

using nlohmann::ordered_json;
using Triangles = std::vector<std::array<Index, 3>>;
using Lines = std::vector<std::array<Index, 2>>;

/// The surface as triangles of nodes, apart for what the body had at the start and for cracks. In the plane all of the
/// body, and cracks are lines.
struct DrawnSurface {
  Triangles body, cracks;
  Lines lines;
};
template <int Dim> DrawnSurface surface_of(const CrackedMesh<Dim>& mesh) {
  DrawnSurface surface;
  if constexpr (Dim == 2) {
    for (Index c = 0; c < mesh.cells.cols(); ++c)
      surface.body.push_back({mesh.cells(0, c), mesh.cells(1, c), mesh.cells(2, c)});
    for (Index f = 0; f < mesh.surface.cols(); ++f)
      if (mesh.is_crack[f] != 0) surface.lines.push_back({mesh.surface(0, f), mesh.surface(1, f)});
  } else {
    for (Index f = 0; f < mesh.surface.cols(); ++f)
      (mesh.is_crack[f] != 0 ? surface.cracks : surface.body)
          .push_back({mesh.surface(0, f), mesh.surface(1, f), mesh.surface(2, f)});
  }
  return surface;
}

template <int Dim> void write_vtu(const fs::path& file, const CrackFrame<Dim>& frame) {
  const auto row = [](const std::vector<Index>& values) {
    Matrix result(1, static_cast<Index>(values.size()));
    for (std::size_t k = 0; k < values.size(); ++k) result(0, static_cast<Index>(k)) = values[k];
    return result;
  };
  const std::vector<std::string> axes =
      Dim == 2 ? std::vector<std::string>{"x", "y"} : std::vector<std::string>{"x", "y", "z"};
  std::vector<PointValues> at_nodes{{"start", frame.mesh.reference, axes}};
  for (const auto& [name, values] : frame.scalars) at_nodes.push_back({name, values.transpose()});
  write_cells<Dim>(file, frame.mesh.current, frame.mesh.cells, at_nodes,
                   {{"body", row(frame.body)}, {"part", row(frame.mesh.part)}});
}

/// Numbers of the nodes that triangles or lines use, from 0 in the order of the nodes, and the nodes.
struct UsedNodes {
  std::vector<Index> number, nodes;
  template <class... Elements> explicit UsedNodes(Index count, const Elements&... all) : number(count, -1) {
    const auto mark = [&](const auto& elements) {
      for (const auto& element : elements)
        for (const Index n : element) number[n] = 0;
    };
    (mark(all), ...);
    for (Index n = 0; n < count; ++n)
      if (number[n] == 0) {
        number[n] = static_cast<Index>(nodes.size());
        nodes.push_back(n);
      }
  }
};

template <int Dim> void write_obj(const fs::path& file, const CrackFrame<Dim>& frame, const DrawnSurface& surface) {
  const UsedNodes used(static_cast<Index>(frame.mesh.current.cols()), surface.body, surface.cracks);
  std::string text = fmt::format("# time {}\n", frame.time);
  const auto append = std::back_inserter(text);
  for (const Index n : used.nodes) {
    Vec<3> x = Vec<3>::Zero();
    x.template head<Dim>() = frame.mesh.current.col(n);
    fmt::format_to(append, "v {:.9g} {:.9g} {:.9g}\n", x[0], x[1], x[2]);
  }
  const auto number = [&](Index n) { return used.number[n] + 1; };
  for (const auto& [name, triangles] : {std::pair{"surface", &surface.body}, {"cracks", &surface.cracks}}) {
    fmt::format_to(append, "o {}\n", name);
    for (const auto& [a, b, c] : *triangles) fmt::format_to(append, "f {} {} {}\n", number(a), number(b), number(c));
  }
  for (const auto& [a, b] : surface.lines) fmt::format_to(append, "l {} {}\n", number(a), number(b));
  std::ofstream out(file);
  out << text;
  if (!out.flush()) internal::cannot_write(file);
}

/// The binary part of a glTF file and the views of it.
class GltfBuffer {
 public:
  /// Appends numbers; returns the accessor. `target`: 34962 for vertices, 34963 for indices.
  template <class T> std::size_t add(const std::vector<T>& values, const char* type, std::size_t components, int target,
                                     ordered_json more = {}) {
    static_assert(std::endian::native == std::endian::little && sizeof(T) == 4);
    views_.push_back(
        {{"buffer", 0}, {"byteOffset", bytes_.size()}, {"byteLength", 4 * values.size()}, {"target", target}});
    const std::size_t begin = bytes_.size();
    bytes_.resize(begin + 4 * values.size());
    if (!values.empty()) std::memcpy(bytes_.data() + begin, values.data(), 4 * values.size());
    more.update({{"bufferView", views_.size() - 1},
                 {"componentType", std::is_same_v<T, float> ? 5126 : 5125},
                 {"count", values.size() / components},
                 {"type", type}});
    accessors_.push_back(more);
    return accessors_.size() - 1;
  }
  const std::string& bytes() const { return bytes_; }
  const ordered_json& views() const { return views_; }
  const ordered_json& accessors() const { return accessors_; }

 private:
  std::string bytes_;
  ordered_json views_ = ordered_json::array(), accessors_ = ordered_json::array();
};

void write_number(std::ofstream& out, std::size_t number) {
  const auto bytes = std::bit_cast<std::array<char, 4>>(static_cast<std::uint32_t>(number));
  out.write(bytes.data(), bytes.size());
}

/// Vertices and indices of triangles or lines, as a primitive of glTF. Without normals, which the standard has viewers
/// compute for flat shading.
template <int Dim, std::size_t Corners>
ordered_json add_primitive(const CrackedMesh<Dim>& mesh, const std::vector<std::array<Index, Corners>>& elements,
                           const std::vector<float>* vertex_colours, int material, GltfBuffer& buffer) {
  const UsedNodes used(static_cast<Index>(mesh.current.cols()), elements);
  std::vector<float> positions, used_colours;
  std::vector<std::uint32_t> indices;
  std::array<float, 3> low, high;
  low.fill(std::numeric_limits<float>::infinity());
  high.fill(-std::numeric_limits<float>::infinity());
  for (const Index n : used.nodes)
    for (std::size_t i = 0; i < 3; ++i) {
      const auto x = i < Dim ? static_cast<float>(mesh.current(static_cast<Index>(i), n)) : 0.0F;
      positions.push_back(x);
      low[i] = std::min(low[i], x);
      high[i] = std::max(high[i], x);
      if (vertex_colours) used_colours.push_back((*vertex_colours)[3 * static_cast<std::size_t>(n) + i]);
    }
  for (const auto& element : elements)
    for (const Index n : element) indices.push_back(static_cast<std::uint32_t>(used.number[n]));
  ordered_json attributes = {{"POSITION", buffer.add(positions, "VEC3", 3, 34962, {{"min", low}, {"max", high}})}};
  if (vertex_colours) attributes["COLOR_0"] = buffer.add(used_colours, "VEC3", 3, 34962);
  return {{"attributes", attributes},
          {"indices", buffer.add(indices, "SCALAR", 1, 34963)},
          {"mode", Corners == 3 ? 4 : 1},  // triangles, lines
          {"material", material}};
}

/// glTF 2.0 as one binary file (Khronos Group 2021, 4.4).
template <int Dim> void write_glb(const fs::path& file, const CrackFrame<Dim>& frame, const DrawnSurface& surface,
                                  const Vector& values, const std::array<double, 2>& range) {
  const internal::drawing::ColourScale scale(range);
  const Eigen::VectorXf places = scale.places(values);
  std::vector<float> vertex_colours;  // of vertices they are linear, those of the scale as screens show them
  for (const float place : places)
    for (const float c : scale.at(place)) vertex_colours.push_back(std::pow(c, 2.2F));
  GltfBuffer buffer;
  ordered_json primitives = {add_primitive(frame.mesh, surface.body, &vertex_colours, 0, buffer)};
  if (!surface.cracks.empty()) primitives.push_back(add_primitive(frame.mesh, surface.cracks, nullptr, 1, buffer));
  if (!surface.lines.empty()) primitives.push_back(add_primitive(frame.mesh, surface.lines, nullptr, 1, buffer));
  const auto material = [](const char* name, const std::array<double, 4>& base) {
    return ordered_json{{"name", name},
                        {"doubleSided", true},
                        {"pbrMetallicRoughness", {{"baseColorFactor", base}, {"metallicFactor", 0.0}}}};
  };
  const ordered_json json = {
      {"asset", {{"version", "2.0"}, {"generator", "efree " + version()}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"mesh", 0}, {"name", "cracked body"}}}},
      {"meshes", {{{"primitives", primitives}}}},
      {"materials", {material("surface", {1.0, 1.0, 1.0, 1.0}), material("cracks", {0.45, 0.05, 0.03, 1.0})}},
      {"accessors", buffer.accessors()},
      {"bufferViews", buffer.views()},
      {"buffers", {{{"byteLength", buffer.bytes().size()}}}}};
  std::string text = json.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::ofstream out(file, std::ios::binary);
  out << "glTF";
  write_number(out, 2);
  write_number(out, 12 + 8 + text.size() + 8 + buffer.bytes().size());
  write_number(out, text.size());
  out << "JSON" << text;
  write_number(out, buffer.bytes().size());
  out.write("BIN\0", 4);
  out.write(buffer.bytes().data(), static_cast<std::streamsize>(buffer.bytes().size()));
  if (!out.flush()) internal::cannot_write(file);
}

std::string name_of(std::size_t frame, const char* extension) {
  return fmt::format("cracks_{:04}.{}", frame, extension);
}

/// A field by its name, or the first there is of those that are drawn if nobody says one.
const std::pair<std::string, Vector>& find_field(const std::vector<std::pair<std::string, Vector>>& fields,
                                                 const std::string& name) {
  const auto find = [&](const std::string& field) {
    return std::ranges::find(fields, field, [](const auto& entry) { return entry.first; });
  };
  auto found = find(name.empty() ? "equivalent_plastic_strain" : name);
  if (name.empty() && found == fields.end()) found = find("von_mises");
  if (name.empty() && found == fields.end()) found = fields.begin();
  if (found != fields.end()) return *found;
  if (fields.empty()) throw InputError("cracks: the points have no fields to colour by");
  std::vector<std::string> names;
  for (const auto& [field, values] : fields) names.push_back(field);
  throw InputError(fmt::format("there is no field \"{}\"; the points have \"{}\"", name, fmt::join(names, "\", \"")));
}

/// What all pictures show: the same part of space, and the same colours.
template <int Dim> struct CommonView {
  BoundingBox<Dim> box;
  std::array<double, 2> range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};

  CommonView(const RecordedRun<Dim>& run, const std::string& colour) {
    for (Index k = 0; k < run.num_frames(); ++k) {
      const RecordedFrame<Dim> frame = run.frame(k);
      for (Index p = 0; p < frame.points.cols(); ++p) box.extend(Vec<Dim>(frame.points.col(p)));
      const auto [low, high] = internal::drawing::colour_range(find_field(frame.scalars, colour).second);
      range = {std::min(range[0], low), std::max(range[1], high)};
    }
  }
};

void write_table(const fs::path& file, const std::vector<CrackRow>& rows) {
  std::ofstream out(file);
  out << "t,edges,cut_edges,parts,largest_part,crack_area,largest_stretch\n";
  for (const CrackRow& row : rows)
    out << fmt::format("{},{},{},{},{:.6g},{:.9g},{:.6g}\n", row.time, row.edges, row.cut_edges, row.parts,
                       row.largest_part, row.crack_area, row.largest_stretch);
  if (!out.flush()) internal::cannot_write(file);
}

}  // namespace

template <int Dim> std::vector<CrackRow> write_cracks(OutputDirectory& out, const RecordedRun<Dim>& run,
                                                      const CrackFileOptions& options, const Monitor& monitor) {
  static const std::regex ours(R"(cracks(_[0-9]{4,9}\.(vtu|obj|glb|png)|\.pvd|\.csv))");
  out.supersede_all([](const std::string& name) { return std::regex_match(name, ours); });
  const auto report = [&](const char* stage, double fraction) {
    if (monitor.progress) monitor.progress(stage, fraction);
  };
  report("mesh between points", 0.0);
  const CommonView<Dim> view(run, options.colour);
  CrackSeries<Dim> series(run, options.cracks);
  report("mesh between points", 1.0);
  std::vector<CrackRow> rows;
  std::vector<std::pair<double, std::string>> frames;
  while (series.has_next()) {
    report("cracks", static_cast<double>(rows.size()) / run.num_frames());
    const internal::Stopwatch clock;
    const CrackFrame<Dim> frame = series.next();
    const CrackedMesh<Dim>& mesh = frame.mesh;
    rows.push_back({.time = frame.time,
                    .edges = frame.edges,
                    .cut_edges = frame.cut_edges,
                    .parts = static_cast<Index>(mesh.volumes.size()),
                    .largest_part = mesh.volumes[0] / mesh.volumes.sum(),
                    .crack_area = mesh.crack_area,
                    .largest_stretch = frame.largest_stretch,
                    .seconds = clock()});
    const auto& [field, values] = find_field(frame.scalars, options.colour);
    const DrawnSurface surface = surface_of(mesh);
    const auto file = [&](const char* extension) { return out.file(name_of(rows.size() - 1, extension)); };
    frames.emplace_back(frame.time, name_of(rows.size() - 1, "vtu"));
    write_vtu(file("vtu"), frame);
    write_obj(file("obj"), frame, surface);
    write_glb(file("glb"), frame, surface, values, view.range);
    if (options.pictures)
      draw_cracks<Dim>(file("png"), {.mesh = mesh,
                                     .values = values,
                                     .range = view.range,
                                     .title = fmt::format("{}, time {:.4g}", run.title(), frame.time),
                                     .field = field,
                                     .view = view.box});
  }
  internal::write_series(out.file("cracks.pvd"), frames);
  write_table(out.file("cracks.csv"), rows);
  report("cracks", 1.0);
  return rows;
}

template std::vector<CrackRow> write_cracks(OutputDirectory&, const RecordedRun<2>&, const CrackFileOptions&,
                                            const Monitor&);
template std::vector<CrackRow> write_cracks(OutputDirectory&, const RecordedRun<3>&, const CrackFileOptions&,
                                            const Monitor&);

}  // namespace efree
