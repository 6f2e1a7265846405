// SPDX-License-Identifier: GPL-3.0-or-later
/// The picture of a body at rest: values on it as it is deformed, and where it is held and loaded.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/io/case/picture_options.hpp"
#include "efree/io/pictures/internal/load_arrows.hpp"
#include "efree/io/pictures/internal/scene.hpp"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace efree::internal::drawing {

/// A value at a place of the body.
struct Peak {
  double value;
  Vec3 at;      ///< undeformed
  Index point;  ///< of the picture's body, the place or next to it; -1: inside, where no point is
};

/// A body with a value at every point.
template <int Dim> struct BodyPicture {
  using Piece = std::conditional_t<Dim == 3, Triangle, Segment>;
  Surface undeformed;                   ///< in space its skin; edges are drawn unless it is of faces
  Points<3> displacement;               ///< of its points
  Vector values;                        ///< at its points, by colour
  std::vector<Piece> held{}, loaded{};  ///< pieces of the boundary
  std::vector<LoadArrow> arrows{};      ///< at such a piece
  std::vector<Segment> rim{};           ///< in the plane: the boundary
  bool true_to_scale = false;           ///< displacements are drawn as they are, unless they are small
  /// Of the body, where its points do not have them.
  std::optional<double> largest_displacement{};
  std::optional<Peak> largest{}, smallest{};
};

/// Which load case a picture is of.
template <int Dim> std::size_t case_number(const PictureOptions& options, const Settings<Dim>& settings) {
  const auto found = std::ranges::find(settings.cases, options.load_case, &LoadCase<Dim>::name);
  return found == settings.cases.end() ? 0 : static_cast<std::size_t>(found - settings.cases.begin());
}

/// The case, and the load case if there are several.
template <int Dim> std::string title_of(const PictureOptions& options, const Settings<Dim>& settings) {
  if (settings.cases.empty()) return settings.common.title;
  return settings.common.title + ", " + settings.cases[case_number(options, settings)].name;
}

/// Side of the cubes with one arrow of a load each [length].
inline double arrow_gap(const Surface& body) {
  return box_of(body.points).diagonal().norm() / 16.0;
}

/// Writes a PNG file, displacements drawn at a fifteenth of the body's size unless the options say how, with marks at
/// the largest value and at a smallest one below 0; `title` says the case. Throws InputError if the file cannot
/// be written.
template <int Dim> void draw_body(const std::filesystem::path& file, const BodyPicture<Dim>& body,
                                  const PictureOptions& options, const std::string& title);

}  // namespace efree::internal::drawing
