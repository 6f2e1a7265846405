// SPDX-License-Identifier: GPL-3.0-or-later
/// Label images into files.
#include "efree/core/error.hpp"
#include "efree/geometry/input/image_reader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <fstream>

namespace efree {

template <int Dim> void write_image(const LabelImage<Dim>& image, const std::string& path) {
  check_image(image);
  if (image.is_turned() && path.ends_with(".pgm"))
    throw InputError(fmt::format("{}: PGM has no place for the axes of an image that is turned, MetaImage does", path));
  const bool pgm = Dim == 2 && path.ends_with(".pgm");
  if (!pgm && !path.ends_with(".mha"))
    throw InputError(fmt::format("{}: images are written as {}", path, Dim == 2 ? ".pgm or .mha" : ".mha"));
  const bool wide = *std::max_element(image.labels.begin(), image.labels.end()) > 255;
  std::ofstream file(path, std::ios::binary);
  if (pgm) {
    file << fmt::format("P5\n{} {}\n{}\n", image.size[0], image.size[1], wide ? 65535 : 255);
  } else {
    const Vec<Dim> centre = image.origin + 0.5 * image.axes * image.spacing;
    file << fmt::format(
        "ObjectType = Image\nNDims = {}\nBinaryData = True\nBinaryDataByteOrderMSB = True\nCompressedData = False\n"
        "TransformMatrix = {}\nOffset = {}\nElementSpacing = {}\nDimSize = {}\nElementType = {}\nElementDataFile = "
        "LOCAL\n",
        Dim, fmt::join(image.axes.reshaped(), " "), fmt::join(centre, " "), fmt::join(image.spacing, " "),
        fmt::join(image.size, " "), wide ? "MET_USHORT" : "MET_UCHAR");
  }
  const std::size_t width = image.size[0], rows = image.labels.size() / width;
  std::string bytes;
  for (std::size_t r = 0; r < rows; ++r) {
    const std::size_t row = pgm ? rows - 1 - r : r;
    bytes.clear();
    for (std::size_t i = 0; i < width; ++i) {
      const Label label = image.labels[row * width + i];
      if (wide) bytes.push_back(static_cast<char>(label >> 8));
      bytes.push_back(static_cast<char>(label & 255));
    }
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }
  file.close();
  if (!file) throw InputError(fmt::format("{}: cannot be written", path));
}

template void write_image<2>(const LabelImage<2>&, const std::string&);
template void write_image<3>(const LabelImage<3>&, const std::string&);

}  // namespace efree
