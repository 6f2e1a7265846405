// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/image_geometry.hpp"

#include "efree/geometry/input/image_reader.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/io/case/internal/case_parts.hpp"
#include "efree/io/case/internal/mesh_reports.hpp"
#include "efree/io/confined/internal/transfer.hpp"

#include <fmt/format.h>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <mutex>

namespace efree::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t largest_label = std::numeric_limits<Label>::max();

template <int Dim> RawImage<Dim> read_raw(const Section& image) {
  const Section raw = image.section("raw", {"size", "type", "big_endian", "header"});
  RawImage<Dim> result;
  const Vec<Dim> size = raw.template point<Dim>("size");
  for (int d = 0; d < Dim; ++d) {
    if (!(size[d] >= 1.0 && size[d] <= std::numeric_limits<Index>::max() && size[d] == std::floor(size[d])))
      raw.fail("size", fmt::format("size holds {}, expected numbers of pixels", size[d]));
    result.size[d] = static_cast<Index>(size[d]);
  }
  result.type = raw.text("type", result.type);
  result.big_endian = raw.boolean("big_endian", result.big_endian);
  result.header = raw.integer("header", 0, std::numeric_limits<std::int64_t>::max(), result.header);
  return result;
}

/// { 1 = "matrix", 2 = "grain" }
std::map<Label, std::string> region_names(const Section& image) {
  const Section section = image.section("regions", {});
  std::map<Label, std::string> names;
  for (const auto& [key, node] : section.table()) {
    const std::string text(key.str());
    int label = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), label);
    if (error != std::errc{} || end != text.data() + text.size() || label < 1 || label > largest_label)
      section.fail(text, fmt::format("\"{}\" is no label, expected an integer from 1 to {}", text, largest_label));
    names[static_cast<Label>(label)] = section.text(text);
  }
  return names;
}

/// How an image is read.
template <int Dim> ImageOptions<Dim> image_options(const Section& image, bool is_raw) {
  ImageOptions<Dim> reading;
  reading.spacing = read_pixel_spacing(image, Dim);
  reading.world = image.choice<std::string>("world", {{"LPS", "LPS"}, {"RAS", "RAS"}}, "");
  if (image.has("threshold")) reading.threshold = image.number("threshold", any_number);
  if (!reading.threshold) refuse(image, {"below"}, "an image without a threshold");
  reading.below = image.boolean("below", false);
  if (image.has("background")) {
    if (reading.threshold) refuse(image, {"background"}, "an image with a threshold");
    reading.background.clear();
    for (const double label : image.numbers("background", {0.0, static_cast<double>(largest_label), true, true}))
      reading.background.push_back(static_cast<Label>(label));
  }
  if (!is_raw) refuse(image, {"raw"}, "a file with a header");
  if (is_raw) reading.raw = read_raw<Dim>(image);
  return reading;
}

/// The image, without its islands if only the largest body counts. `made`, a mesh or an image, is told of it.
template <int Dim, class Made>
LabelImage<Dim> read_labels(const std::string& path, const ImageOptions<Dim>& reading, bool largest_only, Made& made) {
  auto [labels, remarks, warnings] = read_image_file<Dim>(path, reading);
  made.remarks = std::move(remarks);
  made.warnings = std::move(warnings);
  if (!largest_only) return std::move(labels);
  LargestBody<Dim> body = keep_largest(std::move(labels));
  report_islands(body.islands, body.fraction, made);
  return std::move(body.image);
}

/// Names of the regions by label.
template <int Dim>
std::map<Label, std::string> regions_of(const LabelImage<Dim>& labels, const std::map<Label, std::string>& names) {
  std::map<Label, std::string> regions;
  for (const LabelCount& count : count_labels(labels)) {
    if (count.label == 0) continue;
    const auto named = names.find(count.label);
    regions[count.label] = named == names.end() ? std::to_string(count.label) : named->second;
  }
  return regions;
}

}  // namespace

Section image_section(const Section& geometry) {
  return geometry.section("image", {"spacing", "world", "threshold", "below", "background", "largest_only", "contour",
                                    "simplify", "mesher", "facet_distance", "regions", "raw"});
}

template <int Dim>
ScalarField<Dim> grey_of(const Section& geometry, const fs::path& file, bool is_raw, const Confinement& confinement) {
  struct Grey {
    std::once_flag read;
    ScalarField<Dim> value;
  };
  return [grey = std::make_shared<Grey>(), path = file.string(), confinement,
          reading = image_options<Dim>(image_section(geometry), is_raw)](const Vec<Dim>& x) {
    std::call_once(grey->read, [&] {
      grey->value = grey_value<Dim>(confined(confinement, [&] { return read_grey_image<Dim>(path, reading); }));
    });
    return grey->value(x);
  };
}

template <int Dim>
std::function<MadeMesh<Dim>(const MeshSize&)> image_mesh(const Section& geometry, const fs::path& file, bool is_raw) {
  refuse(geometry, {"slits", "parameters", "surface"}, "an image");
  const Section image = image_section(geometry);
  const ImageOptions<Dim> reading = image_options<Dim>(image, is_raw);
  ImageMeshOptions meshing{.names = region_names(image)};
  if (Dim == 3) refuse(image, {"contour", "simplify"}, "an image in three dimensions, where boundaries are smooth");
  if (Dim == 2)
    refuse(image, {"mesher", "facet_distance"},
           "an image in the plane, which constrained Delaunay triangulation meshes");
  meshing.mesher =
      image.choice<Mesher>("mesher", {{"lattice", Mesher::lattice}, {"delaunay", Mesher::delaunay}}, meshing.mesher);
  if (meshing.mesher == Mesher::lattice)
    refuse(image, {"facet_distance"}, "an image on a lattice (mesher = \"delaunay\" has it)");
  meshing.contour =
      image.choice<Contour>("contour", {{"pixel", Contour::pixel}, {"smooth", Contour::smooth}}, meshing.contour);
  meshing.simplify = image.number("simplify", not_negative, meshing.simplify);
  meshing.facet_distance = image.number("facet_distance", positive, meshing.facet_distance);
  const bool largest_only = image.boolean("largest_only", false);
  return [path = file.string(), reading, meshing, largest_only](const MeshSize& size) {
    MadeMesh<Dim> made;
    LabelImage<Dim> labels = read_labels<Dim>(path, reading, largest_only, made);
    ImageMeshOptions sized = meshing;
    // As fine as pixels in the plane, where contours stay whatever the size, two voxels in space.
    sized.size = size_or(Dim == 2 ? size : at_most(may_lose_parts, size),
                         (Dim == 2 ? 1.0 : 2.0) * labels.spacing.minCoeff(), made);
    if constexpr (Dim == 3)
      if (sized.mesher == Mesher::lattice) {
        LatticeMesh on_lattice = mesh_on_lattice(labels, sized);
        made.mesh = std::move(on_lattice.mesh);
        report_lost(on_lattice.lost, made);
        if (largest_only && on_lattice.lost.broken_off > 0) {
          LargestMesh<3> body = keep_largest(std::move(made.mesh));
          made.mesh = std::move(body.mesh);
          made.remarks.push_back(
              fmt::format("what has come apart is left out, too: {} bodies, {:.3g} % of the material", body.islands,
                          100.0 * body.fraction));
        }
        return made;
      }
    made.mesh = mesh_image<Dim>(labels, sized);
    return made;
  };
}

std::function<MadeImage<3>()> image_alone(const Section& geometry, const fs::path& file, bool is_raw) {
  const Section image = image_section(geometry);
  if (image.has("mesher") && image.text("mesher") != "lattice") return {};
  return [path = file.string(), reading = image_options<3>(image, is_raw), names = region_names(image),
          largest_only = image.boolean("largest_only", false)] {
    MadeImage<3> made;
    made.image = read_labels<3>(path, reading, largest_only, made);
    (void)image_regions<3>(made.image, {.size = 1.0, .names = names});  // checks names against labels
    made.region_of_label = regions_of(made.image, names);
    return made;
  };
}

template std::function<MadeMesh<2>(const MeshSize&)> image_mesh<2>(const Section&, const fs::path&, bool);
template std::function<MadeMesh<3>(const MeshSize&)> image_mesh<3>(const Section&, const fs::path&, bool);
template ScalarField<2> grey_of<2>(const Section&, const fs::path&, bool, const Confinement&);
template ScalarField<3> grey_of<3>(const Section&, const fs::path&, bool, const Confinement&);

}  // namespace efree::internal
