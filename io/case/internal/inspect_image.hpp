// SPDX-License-Identifier: GPL-3.0-or-later
/// What an image holds.
#pragma once

#include "efree/geometry/input/image_reader.hpp"
#include "efree/io/case/inspect.hpp"

#include <string>

namespace efree::internal {

/// Of an image file with these values; grey ones are parted by their threshold. Throws InputError as read_image_file.
template <int Dim> Inspection<Dim> inspect_image(const std::string& path, const ImageValues& values);

}  // namespace efree::internal
