// SPDX-License-Identifier: GPL-3.0-or-later
/// What a case file asks to see in a picture.
#pragma once

#include <array>
#include <optional>
#include <string>

namespace efree {

/// A picture of [output] pictures.
struct PictureOptions {
  std::string name{};       ///< of the file, without ".png"; of dynamics without the number of the frame
  std::string field{};      ///< by colour
  std::string unit{};       ///< of the field, for people
  std::string load_case{};  ///< of statics; empty: the first
  /// In space, where it is seen from: the angle about z from the x axis on, and that above the xy plane [degrees].
  /// Empty: from the side that shows the most.
  std::optional<std::array<double, 2>> view{};
  std::optional<std::array<double, 2>> range{};  ///< of the colours; empty: that of the values
  std::optional<double> deformation{};  ///< of statics: factor of the displacements drawn; empty: a fifteenth of
                                        ///< the body's size, or as they are where they are large
  std::string where{};                  ///< the place in the case file
};

}  // namespace efree
