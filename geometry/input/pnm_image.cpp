// SPDX-License-Identifier: GPL-3.0-or-later
/// PNM images.
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <cctype>
#include <cstdint>
#include <fstream>
#include <limits>

namespace efree::internal {

PixelValues read_pnm(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  file.get();
  const char kind = static_cast<char>(file.get());
  const auto number = [&]() -> double {
    while (file && (std::isspace(file.peek()) || file.peek() == '#')) {
      if (file.peek() == '#')
        file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
      else
        file.get();
    }
    double value = 0.0;
    if (!(file >> value)) throw InputError(fmt::format("{}: it is truncated, or no PNM file", path));
    return value;
  };
  PixelValues v;
  const bool bitmap = kind == '1' || kind == '4', binary = kind >= '4';
  v.components = kind == '3' || kind == '6' ? 3 : 1;
  v.top_first = true;
  for (int d = 0; d < 2; ++d) {
    const double pixels = number();
    if (!(pixels >= 1.0 && pixels < 0x1p31)) throw InputError(fmt::format("{}: {} pixels wide or high", path, pixels));
    v.size[d] = static_cast<Index>(pixels);
  }
  const double largest = bitmap ? 1.0 : number();
  v.type = largest < 256.0 ? "uint8" : "uint16";
  file.get();  // the one blank before binary values
  if (binary && !bitmap) {
    read_values(path, file, true, v);
    return v;
  }
  require_room(path, v, size_of(v.type));
  const std::size_t count = v.pixels() * v.components;
  if (kind == '4') {
    const std::size_t row = (static_cast<std::size_t>(v.size[0]) + 7) / 8;
    std::vector<char> bits(row);
    for (Index j = 0; j < v.size[1]; ++j) {
      if (!file.read(bits.data(), static_cast<std::streamsize>(row)))
        throw_truncated(path, static_cast<double>(row) * v.size[1], static_cast<double>(row) * j);
      for (Index i = 0; i < v.size[0]; ++i) v.bytes.push_back(static_cast<char>(bits[i / 8] >> (7 - i % 8) & 1));
    }
    return v;
  }
  file.unget();
  v.bytes.reserve(count * size_of(v.type));
  for (std::size_t k = 0; k < count; ++k) {
    double value;
    if (kind == '1') {  // digits without blanks between them are allowed here
      char digit = 0;
      if (!(file >> digit)) throw_truncated(path, static_cast<double>(count), static_cast<double>(k));
      value = digit - '0';
    } else {
      value = number();
    }
    if (!(value >= 0.0 && value <= largest))
      throw InputError(fmt::format("{}: a value of {}, expected 0 to {}", path, value, largest));
    const auto whole = static_cast<std::uint16_t>(value);
    v.bytes.insert(v.bytes.end(), reinterpret_cast<const char*>(&whole),
                   reinterpret_cast<const char*>(&whole) + size_of(v.type));
  }
  return v;
}

}  // namespace efree::internal
