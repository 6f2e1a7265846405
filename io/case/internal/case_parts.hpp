// SPDX-License-Identifier: GPL-3.0-or-later
/// What case files of all kinds have in common. All that throws, throws InputError that begins with "file:line: ".
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/analysis/settings.hpp"
#include "efree/core/internal/fingerprint.hpp"
#include "efree/io/case/expression.hpp"
#include "efree/io/case/internal/place_reader.hpp"
#include "efree/io/case/internal/section.hpp"
#include "efree/io/confined/reading.hpp"

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace efree::internal {

/// What analysis.kind says.
enum class AnalysisKind { statics, dynamics, effective };

/// A case file that is being read.
struct CaseText {
  std::filesystem::path file;
  std::shared_ptr<const toml::table> table;
  AnalysisKind kind;
  Section root, geometry;
  Reading reading;

  std::filesystem::path folder() const { return file.parent_path(); }
};

/// Names of planes.
using PlaneNames = std::vector<std::pair<std::string_view, Plane>>;
/// Title, places, geometry and plane, which is one of these in 2D, and `fallback` if the file does not say it; without
/// that it has to.
template <int Dim> void read_common(const CaseText& text, const Section& analysis, const PlaneNames& planes,
                                    CommonSettings<Dim>& common, MeshSource<Dim>& geometry,
                                    std::optional<Plane> fallback = std::nullopt);

/// The time in expressions, or why there is none.
struct ExpressionTime {
  std::optional<double> time;
  std::string why{};
  bool runs = false;  ///< it is the first coordinate of where fields are asked for, which depend on no other
  std::shared_ptr<const double> clock{};  ///< it is what this says when they are asked for
};

/// [definitions] in the order they are written: each may use those before, the grey value of an image, and the time.
template <int Dim>
Expressions<Dim> read_definitions(const Section& root, const ScalarField<Dim>& grey, const ExpressionTime& time);

/// Edge lengths of pixels, one number or `dim`: ImageOptions::spacing.
std::vector<double> read_pixel_spacing(const Section& image, std::size_t dim);

/// Keys of [cloud] and [quadrature].
Section::Keys cloud_keys();
Section::Keys quadrature_keys();

/// Cloud and quadrature but for the grading. `mesh_ratio`: of the geometry, relative to the cloud's spacing.
template <int Dim> void read_approximation(const Section& cloud, const Section& quadrature, double mesh_ratio,
                                           CommonSettings<Dim>& result);
/// Where the cloud is denser; `graded` gets the regions that it names.
template <int Dim> Grading read_grading(const Section& cloud, PlaceReader<Dim>& places, std::vector<Mention>& graded);

/// Where sections, and what is in them, are said.
std::map<std::string, std::string> places_in(const Section& root);

/// What a node of the file says, as text.
std::string text_of(const toml::node_view<const toml::node>& node);
/// Adds the bytes of a file, if it has a name.
void add_file(Fingerprint& to, const std::filesystem::path& file);

}  // namespace efree::internal
