// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/case_parts.hpp"

#include "efree/io/case/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <fstream>
#include <limits>
#include <sstream>

namespace efree::internal {

template <int Dim>
Expressions<Dim> read_definitions(const Section& root, const ScalarField<Dim>& grey, const ExpressionTime& time) {
  const Section section = root.section("definitions", {});
  std::vector<std::pair<std::string, const toml::node*>> entries;
  for (const auto& [key, node] : section.table()) entries.emplace_back(key.str(), &node);
  std::ranges::sort(entries, {}, [](const auto& entry) {
    const auto& begin = entry.second->source().begin;
    return std::pair(begin.line, begin.column);
  });
  Expressions<Dim> expressions;
  if (grey)
    expressions.define("grey", grey);
  else
    expressions.refuse("grey", "grey is the value of an image at a point, and the geometry is no image");
  if (time.clock)
    expressions.at_clock(time.clock);
  else if (time.runs)
    expressions.at_any_time();
  else if (time.time)
    expressions.at_time(*time.time);
  else if (!section.has("t"))
    expressions.refuse("t", time.why);
  for (const auto& [name, node] : entries)
    expressions.define(name, section.expression(*node, name), section.where(*node));
  return expressions;
}

template <int Dim> void read_common(const CaseText& text, const Section& analysis, const PlaneNames& planes,
                                    CommonSettings<Dim>& common, MeshSource<Dim>& geometry,
                                    std::optional<Plane> fallback) {
  common.where = text.file.string();
  common.said = places_in(text.root);
  common.title = text.root.text("title", text.file.stem().string());
  geometry = read_geometry<Dim>(text.geometry, text.folder(), text.reading);
  if (Dim == 3 && analysis.has("plane"))
    analysis.fail("plane", "plane means nothing here: the geometry is three-dimensional");
  common.model.plane = analysis.choice<Plane>("plane", planes, Dim == 3 ? std::optional(Plane::strain) : fallback);
}

std::vector<double> read_pixel_spacing(const Section& image, std::size_t dim) {
  if (!image.has("spacing")) return {};
  std::vector<double> spacing = image.numbers("spacing", positive);
  if (spacing.size() != 1 && spacing.size() != dim)
    image.fail("spacing", fmt::format("spacing has {} numbers, expected one or {}", spacing.size(), dim));
  return spacing;
}

Section::Keys cloud_keys() {
  return {"spacing", "seed",  "support", "weight",  "kernel",    "features",
          "growth",  "least", "boxes",   "regions", "boundaries"};
}
Section::Keys quadrature_keys() {
  return {"basis", "ratio", "stabilisation", "dilatation"};
}

template <int Dim> void read_approximation(const Section& cloud, const Section& quadrature, double mesh_ratio,
                                           CommonSettings<Dim>& result) {
  ApproximationOptions& options = result.approximation;
  options.spacing = cloud.number("spacing", positive, 0.0);
  if (options.spacing == 0.0 && mesh_ratio > 0.0)
    cloud.fail("spacing", "key \"spacing\" is missing in [cloud]: geometry.mesh_ratio is relative to it");
  options.seed = static_cast<std::uint64_t>(
      cloud.integer("seed", 0, std::numeric_limits<std::int64_t>::max(), static_cast<std::int64_t>(options.seed)));
  options.support = cloud.number("support", {1.0, 10.0, true, true}, options.support);
  options.weight = cloud.choice<Weight>("weight",
                                        {{"automatic", Weight::automatic},
                                         {"heat_geodesic", Weight::heat_geodesic},
                                         {"heat_flow", Weight::heat_flow},
                                         {"fast_marching", Weight::fast_marching},
                                         {"visibility", Weight::visibility},
                                         {"euclidean", Weight::euclidean}},
                                        options.weight);
  options.kernel = cloud.choice<Kernel>("kernel",
                                        {{"cubic_spline", Kernel::cubic_spline},
                                         {"quintic_spline", Kernel::quintic_spline},
                                         {"wendland_c2", Kernel::wendland_c2}},
                                        options.kernel);

  options.secondary = quadrature.choice<SecondaryKind>("basis",
                                                       {{"cells", SecondaryKind::cells},
                                                        {"linear", SecondaryKind::linear},
                                                        {"mls", SecondaryKind::mls},
                                                        {"full", SecondaryKind::full}},
                                                       options.secondary);
  options.ratio = quadrature.number("ratio", {0.25, 100.0, true, true}, options.ratio);
  result.model.stabilisation = quadrature.number("stabilisation", {0.0, 1.0, true, true}, 0.0);
  if (const auto averaged = quadrature.switch_or_auto("dilatation")) options.dilatation = averaged_if(*averaged);
}

template <int Dim> Grading read_grading(const Section& cloud, PlaceReader<Dim>& places, std::vector<Mention>& graded) {
  Grading grading;
  grading.features = cloud.boolean("features", grading.features);
  grading.growth = cloud.number("growth", positive, grading.growth);
  grading.least = cloud.number("least", positive, grading.least);
  for (const Section& entry : cloud.sections("boxes", {"box", "spacing"})) {
    const auto [a, b] = entry.corners<Dim>("box");
    SpacingBox box{.spacing = entry.number("spacing", positive)};
    for (int d = 0; d < Dim; ++d) {
      box.low[d] = std::min(a[d], b[d]);
      box.high[d] = std::max(a[d], b[d]);
    }
    grading.boxes.push_back(box);
  }
  for (const Section& entry : cloud.sections("regions", {"region", "spacing"})) {
    grading.regions.push_back({entry.text("region"), entry.number("spacing", positive)});
    graded.push_back({entry.text("region"), entry.where("region")});
  }
  for (const Section& entry : cloud.sections("boundaries", {"on", "spacing"}))
    grading.boundaries.push_back({places.name(entry), entry.number("spacing", positive)});
  return grading;
}

std::map<std::string, std::string> places_in(const Section& root) {
  std::map<std::string, std::string> said;
  for (const auto& [name, node] : root.table()) {
    const std::string section(name.str());
    const toml::array* entries = node.as_array();
    said[section] = root.where(entries && !entries->empty() ? entries->front() : node);
    if (const auto* table = node.as_table())
      for (const auto& [key, value] : *table) said[fmt::format("{}.{}", section, key.str())] = root.where(value);
  }
  return said;
}

std::string text_of(const toml::node_view<const toml::node>& node) {
  std::ostringstream stream;
  stream << node;
  return stream.str();
}

void add_file(Fingerprint& to, const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::string bytes(std::size_t{1} << 20U, '\0');
  while (!file.empty() && stream) {
    stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    to.add(std::string_view(bytes).substr(0, static_cast<std::size_t>(stream.gcount())));
  }
}

template Expressions<2> read_definitions<2>(const Section&, const ScalarField<2>&, const ExpressionTime&);
template Expressions<3> read_definitions<3>(const Section&, const ScalarField<3>&, const ExpressionTime&);
template void read_approximation<2>(const Section&, const Section&, double, CommonSettings<2>&);
template void read_common<2>(const CaseText&, const Section&, const PlaneNames&, CommonSettings<2>&, MeshSource<2>&,
                             std::optional<Plane>);
template void read_approximation<3>(const Section&, const Section&, double, CommonSettings<3>&);
template void read_common<3>(const CaseText&, const Section&, const PlaneNames&, CommonSettings<3>&, MeshSource<3>&,
                             std::optional<Plane>);
template Grading read_grading<2>(const Section&, PlaceReader<2>&, std::vector<Mention>&);
template Grading read_grading<3>(const Section&, PlaceReader<3>&, std::vector<Mention>&);

}  // namespace efree::internal
