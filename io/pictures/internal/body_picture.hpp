// SPDX-License-Identifier: GPL-3.0-or-later
/// The picture of a body at rest: values on it as it is deformed, and where it is held and loaded.
#pragma once

#include "efree/io/pictures/internal/scene.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace efree::internal::drawing {

/// A body with a value at every point.
template <int Dim> struct BodyPicture {
  using Piece = std::conditional_t<Dim == 3, Triangle, Segment>;
  Surface undeformed;                   ///< in space its skin; edges are drawn unless it is of faces
  Points<3> displacement;               ///< of its points
  Vector values;                        ///< at its points, by colour
  std::vector<Piece> held{}, loaded{};  ///< pieces of the boundary
  std::vector<Segment> rim{};           ///< in the plane: the boundary
  bool true_to_scale = false;           ///< displacements are drawn as they are, unless they are small
  /// Of the body, where its points do not have them.
  std::optional<double> largest_displacement{}, largest_value{};
};

/// Writes a PNG file, displacements drawn at a fifteenth of the body's size; `name` is what values beyond the scale are
/// called. Throws InputError if the file cannot be written.
template <int Dim> void draw_body(const std::filesystem::path& file, const BodyPicture<Dim>& body,
                                  const std::string& title, const std::string& name);

}  // namespace efree::internal::drawing
