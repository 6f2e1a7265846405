// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/internal/pixel_values.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <bit>

namespace efree::internal {

std::size_t size_of(const std::string& type) {
  const auto digits = type.find_first_of("0123456789");
  return digits == std::string::npos ? 0 : std::stoul(type.substr(digits)) / 8;
}

void require_room(const std::string& path, const PixelValues& v, std::size_t bytes_each) {
  const double pixels = static_cast<double>(v.size[0]) * v.size[1] * v.size[2];
  require_memory(pixels * static_cast<double>(v.components * bytes_each + sizeof(Label) + sizeof(float)),
                 fmt::format("{}: an image of {} pixels", path, fmt::join(v.size, " x ")));
  if (!(pixels < 0x1p40)) throw InputError(fmt::format("{}: an image of {} pixels", path, fmt::join(v.size, " x ")));
}

void swap_bytes(std::vector<char>& bytes, std::size_t each) {
  if (each > 1)
    for (std::size_t k = 0; k + each <= bytes.size(); k += each)
      std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(k),
                   bytes.begin() + static_cast<std::ptrdiff_t>(k + each));
}

void throw_truncated(const std::string& path, double expected, double found) {
  throw InputError(fmt::format("{}: it is truncated, {} bytes of values expected, {} found", path, expected, found));
}

void read_values(const std::string& path, std::istream& file, bool big_endian, PixelValues& v) {
  require_room(path, v, size_of(v.type));
  v.bytes.resize(v.pixels() * v.components * size_of(v.type));
  file.read(v.bytes.data(), static_cast<std::streamsize>(v.bytes.size()));
  if (static_cast<std::size_t>(file.gcount()) != v.bytes.size())
    throw_truncated(path, static_cast<double>(v.bytes.size()), static_cast<double>(file.gcount()));
  if (big_endian != (std::endian::native == std::endian::big)) swap_bytes(v.bytes, size_of(v.type));
}

}  // namespace efree::internal
