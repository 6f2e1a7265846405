// SPDX-License-Identifier: GPL-3.0-or-later
/// INR images (INRIMAGE-4).
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <zlib.h>
#include <algorithm>
#include <bit>
#include <memory>
#include <sstream>

namespace efree::internal {

PixelValues read_inr(const std::string& path) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
  if (!file) throw InputError(fmt::format("{}: cannot be read", path));
  std::string header;
  do {
    char block[256];
    if (gzread(file.get(), block, 256) != 256 || header.size() > 65536)
      throw InputError(fmt::format("{}: it is truncated, its header does not end", path));
    header.append(block, 256);
    if (!header.starts_with("#INRIMAGE-4#{")) throw InputError(fmt::format("{}: it is no INR file", path));
  } while (header.find("##}") == std::string::npos);
  const auto setting = [&](const std::string& key, const std::string& otherwise) {
    const auto at = header.find("\n" + key + "=");
    if (at == std::string::npos) return otherwise;
    const auto from = at + key.size() + 2;
    return header.substr(from, header.find('\n', from) - from);
  };
  PixelValues v;
  double bits = 0.0;
  std::istringstream numbers(setting("XDIM", "0") + ' ' + setting("YDIM", "0") + ' ' + setting("ZDIM", "1") + ' ' +
                             setting("VDIM", "1") + ' ' + setting("VX", "1") + ' ' + setting("VY", "1") + ' ' +
                             setting("VZ", "1") + ' ' + setting("PIXSIZE", "8 bits"));
  numbers >> v.size[0] >> v.size[1] >> v.size[2] >> v.components >> v.spacing[0] >> v.spacing[1] >> v.spacing[2] >>
      bits;
  if (!numbers || *std::min_element(v.size.begin(), v.size.end()) < 1 || v.components < 1)
    throw InputError(fmt::format("{}: cannot make sense of its header", path));
  v.spacing_from = "INR VX, VY, VZ";
  const std::string type = setting("TYPE", "unsigned fixed"), cpu = setting("CPU", "decm");
  v.type = fmt::format("{}{}", type.starts_with("float") ? "float" : type.starts_with("signed") ? "int" : "uint", bits);
  with_type(path, v.type, [](auto) {});
  require_room(path, v, size_of(v.type));
  v.bytes.resize(v.pixels() * v.components * size_of(v.type));
  std::size_t done = 0;
  while (done < v.bytes.size()) {
    const auto wanted = static_cast<unsigned>(std::min<std::size_t>(v.bytes.size() - done, 1u << 30));
    const int got = gzread(file.get(), v.bytes.data() + done, wanted);
    if (got <= 0) throw_truncated(path, static_cast<double>(v.bytes.size()), static_cast<double>(done));
    done += static_cast<std::size_t>(got);
  }
  const bool big_endian = cpu.starts_with("sun") || cpu.starts_with("sgi");
  if (big_endian != (std::endian::native == std::endian::big)) swap_bytes(v.bytes, size_of(v.type));
  return v;
}

}  // namespace efree::internal
