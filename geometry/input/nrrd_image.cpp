// SPDX-License-Identifier: GPL-3.0-or-later
/// NRRD images.
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <zlib.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <sstream>
#include <type_traits>

namespace efree::internal {
namespace {

/// Inflates what gzip packed.
std::string inflated(const std::string& path, const std::string& packed, std::size_t expected) {
  std::string out(expected, '\0');
  z_stream stream{};
  inflateInit2(&stream, 15 + 32);  // with a header of gzip or zlib
  std::size_t read = 0, written = 0;
  int status = Z_OK;
  while (status == Z_OK && written < expected) {  // zlib counts in 32 bits
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data() + read));
    stream.avail_in = static_cast<uInt>(std::min<std::size_t>(packed.size() - read, 1u << 30));
    stream.next_out = reinterpret_cast<Bytef*>(out.data() + written);
    stream.avail_out = static_cast<uInt>(std::min<std::size_t>(expected - written, 1u << 30));
    const auto in = stream.avail_in, room = stream.avail_out;
    status = inflate(&stream, Z_NO_FLUSH);
    read += in - stream.avail_in;
    written += room - stream.avail_out;
  }
  inflateEnd(&stream);
  if (written < expected) throw_truncated(path, static_cast<double>(expected), static_cast<double>(written));
  return out;
}

/// Numbers in "0.5 2 1" or "(0.5,0,0) (0,2,0)", whatever stands between them; what is no number ("none") is left out.
std::vector<double> numbers_in(std::string text) {
  for (char& c : text)
    if (c == '(' || c == ')' || c == ',') c = ' ';
  std::istringstream words(text);
  std::vector<double> out;
  for (std::string word; words >> word;) {
    char* end = nullptr;
    const double value = std::strtod(word.c_str(), &end);
    if (end != word.c_str()) out.push_back(value);
  }
  return out;
}

/// Lines "key: value" up to an empty one.
struct NrrdHeader {
  std::map<std::string, std::string> fields;
  bool ended = false;  ///< by an empty line

  explicit NrrdHeader(std::istream& file) {
    std::string line;
    std::getline(file, line);
    while (std::getline(file, line)) {
      if (!line.empty() && line.back() == '\r') line.pop_back();
      if (line.empty()) break;
      const auto colon = line.find(": ");
      if (line[0] != '#' && colon != std::string::npos) fields[line.substr(0, colon)] = line.substr(colon + 2);
    }
    ended = static_cast<bool>(file);
  }
  /// Empty for a key that is not there.
  std::string operator[](const std::string& key) const {
    const auto found = fields.find(key);
    return found == fields.end() ? "" : found->second;
  }
  /// Of a key with two spellings.
  std::string either(const std::string& one, const std::string& other) const {
    return fields.contains(one) ? (*this)[one] : (*this)[other];
  }
  double number(const std::string& one, const std::string& other) const {
    return numbers_in(either(one, other) + " 0")[0];
  }
};

/// Sets pixels and components. Returns how many axes have pixels.
std::size_t read_sizes(const std::string& path, const NrrdHeader& header, int dim, PixelValues& v) {
  std::vector<double> sizes = numbers_in(header["sizes"]);
  if ((!header.ended && header.either("data file", "datafile").empty()) || sizes.empty())
    throw InputError(fmt::format("{}: it is truncated, its header does not end or gives no sizes", path));
  if (static_cast<int>(sizes.size()) == dim + 1 && sizes[0] <= 4) {
    v.components = static_cast<int>(sizes[0]);
    sizes.erase(sizes.begin());
  }
  const bool sane = std::all_of(sizes.begin(), sizes.end(), [](double n) { return n >= 1.0 && n < 0x1p31; });
  if (sizes.size() > 3 || !sane || v.components < 1)
    throw InputError(fmt::format("{}: sizes {}, expected {} positive numbers", path, header["sizes"], dim));
  for (std::size_t d = 0; d < sizes.size(); ++d) v.size[d] = static_cast<Index>(sizes[d]);
  return sizes.size();
}

/// Our name of a type; one that is unknown stays.
std::string type_name(const std::string& name) {
  static const std::map<std::string, std::string> types{{"signed char", "int8"},
                                                        {"int8", "int8"},
                                                        {"int8_t", "int8"},
                                                        {"uchar", "uint8"},
                                                        {"unsigned char", "uint8"},
                                                        {"uint8", "uint8"},
                                                        {"uint8_t", "uint8"},
                                                        {"short", "int16"},
                                                        {"short int", "int16"},
                                                        {"int16", "int16"},
                                                        {"int16_t", "int16"},
                                                        {"signed short", "int16"},
                                                        {"ushort", "uint16"},
                                                        {"uint16", "uint16"},
                                                        {"uint16_t", "uint16"},
                                                        {"unsigned short", "uint16"},
                                                        {"unsigned short int", "uint16"},
                                                        {"int", "int32"},
                                                        {"int32", "int32"},
                                                        {"int32_t", "int32"},
                                                        {"signed int", "int32"},
                                                        {"uint", "uint32"},
                                                        {"uint32", "uint32"},
                                                        {"uint32_t", "uint32"},
                                                        {"unsigned int", "uint32"},
                                                        {"float", "float32"},
                                                        {"double", "float64"}};
  const auto type = types.find(name);
  return type == types.end() ? name : type->second;
}

/// Anatomical axes by what NRRD calls a space; empty for others.
std::string world_named(std::string space) {
  for (char& c : space) c = static_cast<char>(std::tolower(c));
  if (space.starts_with("left-posterior-superior") || space == "lps") return "LPS";
  if (space.starts_with("right-anterior-superior") || space == "ras") return "RAS";
  if (space.starts_with("left-anterior-superior") || space == "las") return "LAS";
  return "";
}

/// Sets spacing, axes and origin: NRRD has the centre of the first pixel.
void read_frame(const std::string& path, const NrrdHeader& header, std::size_t axes, PixelValues& v) {
  const std::vector<double> spacings = numbers_in(header["spacings"]),
                            directions = numbers_in(header["space directions"]),
                            origin = numbers_in(header["space origin"]);
  if (!directions.empty() && directions.size() != axes * axes)
    throw InputError(fmt::format("{}: space directions {}, expected {} vectors of {} numbers", path,
                                 header["space directions"], axes, axes));
  v.world = world_named(header["space"]);
  v.centred = origin.size() == axes;
  if (!directions.empty())
    v.spacing_from = "NRRD space directions";
  else if (spacings.size() >= axes)
    v.spacing_from = "NRRD spacings";
  for (std::size_t d = 0; d < axes; ++d) {
    if (spacings.size() >= axes) v.spacing[d] = spacings[spacings.size() - axes + d];
    if (!directions.empty()) {
      Vec<3> direction = Vec<3>::Zero();
      for (std::size_t k = 0; k < axes; ++k) direction[k] = directions[axes * d + k];
      v.spacing[d] = direction.norm();
      if (v.spacing[d] > 0.0) v.axes.col(d) = direction / v.spacing[d];
    }
    if (v.centred) v.origin[d] = origin[d];
  }
}

/// Values as text, `bytes` in all.
void read_text(const std::string& path, std::istream& file, std::size_t bytes, PixelValues& v) {
  with_type(path, v.type, [&](auto value) {
    v.bytes.reserve(bytes);
    for (std::size_t k = 0; k < v.pixels() * v.components; ++k) {
      double number = 0.0;
      if (!(file >> number)) throw_truncated(path, static_cast<double>(bytes), static_cast<double>(v.bytes.size()));
      using Value = decltype(value);
      if constexpr (std::is_integral_v<Value>)
        if (!(number >= static_cast<double>(std::numeric_limits<Value>::lowest()) &&
              number < static_cast<double>(std::numeric_limits<Value>::max()) + 1.0))
          throw InputError(fmt::format("{}: the value {} is none of type {}", path, number, v.type));
      value = static_cast<Value>(number);
      const char* const first = reinterpret_cast<const char*>(&value);
      v.bytes.insert(v.bytes.end(), first, first + sizeof value);
    }
  });
}

/// The values, which begin where the file stands, but for `skip` bytes.
void read_encoded(const std::string& path, std::istream& file, const NrrdHeader& header, double skip, PixelValues& v) {
  const std::size_t bytes = v.pixels() * v.components * size_of(v.type);
  const bool big_endian = header["endian"] == "big";
  const std::string encoding = header["encoding"];
  if (encoding == "raw") {
    if (skip < 0.0)
      file.seekg(-static_cast<std::streamoff>(bytes), std::ios::end);  // the values are the end of the file
    else
      file.ignore(static_cast<std::streamsize>(skip));
    read_values(path, file, big_endian, v);
  } else if (encoding == "gzip" || encoding == "gz") {
    std::istringstream values(inflated(path, std::string(std::istreambuf_iterator<char>(file), {}),
                                       bytes + static_cast<std::size_t>(std::max(skip, 0.0))));
    values.ignore(static_cast<std::streamsize>(std::max(skip, 0.0)));
    read_values(path, values, big_endian, v);
  } else if (encoding == "ascii" || encoding == "text" || encoding == "txt") {
    read_text(path, file, bytes, v);
  } else {
    throw InputError(fmt::format("{}: encoding \"{}\", expected raw, gzip or ascii", path, encoding));
  }
}

}  // namespace

PixelValues read_nrrd(const std::string& path, int dim) {
  std::ifstream file(path, std::ios::binary);
  const NrrdHeader header(file);
  PixelValues v;
  const std::size_t axes = read_sizes(path, header, dim, v);
  v.type = type_name(header["type"]);
  with_type(path, v.type, [](auto) {});
  read_frame(path, header, axes, v);
  require_room(path, v, size_of(v.type));
  if (const std::string data_file = header.either("data file", "datafile"); !data_file.empty()) {
    const auto detached = std::filesystem::path(path).parent_path() / data_file;
    file = std::ifstream(detached, std::ios::binary);
    if (!file)
      throw InputError(
          fmt::format("{}: its values should be in \"{}\", which does not exist", path, detached.string()));
  }
  std::string line;
  for (double skip = header.number("line skip", "lineskip"); skip >= 1.0; --skip) std::getline(file, line);
  read_encoded(path, file, header, header.number("byte skip", "byteskip"), v);
  return v;
}

}  // namespace efree::internal
