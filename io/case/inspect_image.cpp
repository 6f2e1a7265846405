// SPDX-License-Identifier: GPL-3.0-or-later
/// What an image holds.
#include "efree/io/case/internal/inspect_image.hpp"

#include "efree/geometry/input/image_summary.hpp"

#include <fmt/format.h>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

namespace efree::internal {
namespace {

/// Diameter of the ball (disc in 2D) with that volume.
template <int Dim> double equivalent_diameter(double volume) {
  return Dim == 2 ? 2.0 * std::sqrt(volume / std::numbers::pi) : std::cbrt(6.0 * volume / std::numbers::pi);
}

/// Rectangles of one label, row by row.
void add_rows(const LabelImage<2>& image, Inspection<2>& out, std::vector<Vec<2>>& points) {
  std::vector<Index> number(std::numeric_limits<Label>::max() + 1, -1);
  for (std::size_t b = 0; b < out.bodies.size(); ++b) number[std::stoul(out.bodies[b].name)] = static_cast<Index>(b);
  for (Index j = 0; j < image.size[1]; ++j)
    for (Index i = 0; i < image.size[0];) {
      const Label label = image.at({i, j});
      Index end = i + 1;
      while (end < image.size[0] && image.at({end, j}) == label) ++end;
      if (label != 0) {
        const auto first = static_cast<Index>(points.size());
        for (const auto& [x, y] : {std::pair{i, j}, {end, j}, {end, j + 1}, {i, j + 1}})
          points.push_back(image.in_world(image.origin + image.spacing.cwiseProduct(Vec<2>(x, y))));
        out.pieces.push_back({{first, first + 1, first + 2, first + 3}, number[label], -1});
      }
      i = end;
    }
}

}  // namespace

template <int Dim> Inspection<Dim> inspect_image(const std::string& path, const ImageValues& values) {
  ImageOptions<Dim> options;
  if (!values.are_labels) options.threshold = values.threshold;
  const auto [image, remarks, warnings] = read_image_file<Dim>(path, options);
  ImageSummary<Dim> summary = summarize_image(image);
  Inspection<Dim> out{.file = path, .kind = values.are_labels ? "label image" : "grey image"};
  for (int corner = 0; corner < 1 << Dim; ++corner) {
    Vec<Dim> at = image.origin;
    for (int d = 0; d < Dim; ++d)
      if (corner >> d & 1) at[d] += image.size[d] * image.spacing[d];
    out.box.extend(image.in_world(at));
  }
  out.bodies = std::move(summary.labels);
  out.groups = std::move(summary.groups);
  for (const auto& body : out.bodies) out.volume += body.volume;
  for (const auto& group : out.groups) out.boundary += group.measure;
  const auto consider = [&](const char* what, const std::optional<ImagePart<Dim>>& part) {
    if (!part) return;
    const double size = equivalent_diameter<Dim>(static_cast<double>(part->pixels) * image.pixel_volume());
    if (!out.smallest || size < out.smallest->size) out.smallest = {what, size, part->centre};
  };
  consider("closed pore, diameter by its volume", summary.smallest_pore);
  if (summary.bodies > 1) consider("island, diameter by its volume", summary.smallest_body);
  for (int d = 0; d < Dim; ++d) out.facts.emplace_back(fmt::format("pixels_{}", "xyz"[d]), image.size[d]);
  for (int d = 0; d < Dim; ++d) out.facts.emplace_back(fmt::format("spacing_{}", "xyz"[d]), image.spacing[d]);
  out.facts.insert(out.facts.end(), {{"least_value", values.least},
                                     {"largest_value", values.largest},
                                     {"material_fraction", summary.material},
                                     {"connected_bodies", summary.bodies},
                                     {"closed_pores", summary.closed_pores}});
  if (!values.are_labels) {
    out.facts.emplace_back("threshold", values.threshold);
    out.remarks.push_back(
        fmt::format("grey values, seen here with the threshold {:.6g} that parts them best: a case needs "
                    "[geometry.image] threshold",
                    values.threshold));
  }
  if (summary.bodies > 1)
    out.remarks.push_back(
        fmt::format("{} bodies that do not touch: hold each of them, or keep the largest with [geometry.image] "
                    "largest_only = true",
                    summary.bodies));
  for (const auto* said : {&remarks, &warnings}) out.remarks.insert(out.remarks.end(), said->begin(), said->end());

  std::vector<Vec<Dim>> points;
  if constexpr (Dim == 2) add_rows(image, out, points);
  for (const auto& facet : summary.facets) {
    typename Inspection<Dim>::Piece piece{.region = facet.label, .group = facet.group};
    for (std::size_t k = 0; k < facet.corners.size(); ++k) {
      piece.corners[k] = static_cast<Index>(points.size());
      points.push_back(facet.corners[k]);
    }
    out.pieces.push_back(piece);
  }
  out.points.resize(Dim, static_cast<Eigen::Index>(points.size()));
  for (std::size_t p = 0; p < points.size(); ++p) out.points.col(static_cast<Eigen::Index>(p)) = points[p];
  return out;
}

template Inspection<2> inspect_image<2>(const std::string&, const ImageValues&);
template Inspection<3> inspect_image<3>(const std::string&, const ImageValues&);

}  // namespace efree::internal
