// SPDX-License-Identifier: GPL-3.0-or-later
/// Images without a header.
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <filesystem>
#include <fstream>

namespace efree::internal {

template <int Dim> PixelValues read_raw(const std::string& path, const RawImage<Dim>& raw) {
  PixelValues v;
  for (int d = 0; d < Dim; ++d) {
    v.size[d] = raw.size[d];
    if (raw.size[d] < 1)
      throw InputError(
          fmt::format("{}: a raw size of {}, expected positive numbers", path, fmt::join(raw.size, " x ")));
  }
  v.type = raw.type;
  v.top_first = Dim == 2;
  with_type(path, v.type, [](auto) {});
  const double length = static_cast<double>(std::filesystem::file_size(path));
  const double expected = static_cast<double>(raw.header) +
                          static_cast<double>(v.size[0]) * v.size[1] * v.size[2] * static_cast<double>(size_of(v.type));
  if (raw.header < 0 || length != expected)
    throw InputError(fmt::format("{}: {} pixels of {} after a header of {} bytes are {} bytes, but the file has {}",
                                 path, fmt::join(raw.size, " x "), raw.type, raw.header, expected, length));
  std::ifstream file(path, std::ios::binary);
  file.seekg(raw.header);
  read_values(path, file, raw.big_endian, v);
  return v;
}

template PixelValues read_raw<2>(const std::string&, const RawImage<2>&);
template PixelValues read_raw<3>(const std::string&, const RawImage<3>&);

}  // namespace efree::internal
