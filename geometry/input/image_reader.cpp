// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/image_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/lower_case.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/mesh/internal/extent.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <vtkCallbackCommand.h>
#include <vtkDataArray.h>
#include <vtkExecutive.h>
#include <vtkImageData.h>
#include <vtkImageReader2.h>
#include <vtkMetaImageReader.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkTIFFReader.h>
#include <zlib.h>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <sstream>

namespace efree {
namespace {

/// What a file says about itself, and where its values are.
struct Values {
  std::array<Index, 3> size{1, 1, 1};
  std::array<double, 3> spacing{1.0, 1.0, 1.0}, origin{0.0, 0.0, 0.0};
  int components = 1;
  std::string type;
  bool top_first = false;                ///< the first row of every layer is the top one
  vtkSmartPointer<vtkImageData> of_vtk;  ///< either this
  std::vector<char> bytes;               ///< or these hold the values, in this machine's order

  std::size_t pixels() const { return static_cast<std::size_t>(size[0]) * size[1] * size[2]; }
  const void* data() const {
    return of_vtk ? of_vtk->GetPointData()->GetScalars()->GetVoidPointer(0) : static_cast<const void*>(bytes.data());
  }
};

std::size_t size_of(const std::string& type) {
  const auto digits = type.find_first_of("0123456789");
  return digits == std::string::npos ? 0 : std::stoul(type.substr(digits)) / 8;
}

/// Calls body(value of that type).
template <class Body> void with_type(const std::string& path, const std::string& type, const Body& body) {
  if (type == "uint8") return body(std::uint8_t{});
  if (type == "int8") return body(std::int8_t{});
  if (type == "uint16") return body(std::uint16_t{});
  if (type == "int16") return body(std::int16_t{});
  if (type == "uint32") return body(std::uint32_t{});
  if (type == "int32") return body(std::int32_t{});
  if (type == "uint64") return body(std::uint64_t{});
  if (type == "int64") return body(std::int64_t{});
  if (type == "float32") return body(float{});
  if (type == "float64") return body(double{});
  throw InputError(
      fmt::format("{}: values of type \"{}\", expected uint8, int8, uint16, int16, uint32, int32, float32 "
                  "or float64",
                  path, type));
}

std::string name_of_vtk_type(int type) {
  switch (type) {
    case VTK_FLOAT:
      return "float32";
    case VTK_DOUBLE:
      return "float64";
    default:
      break;
  }
  const int bytes = vtkDataArray::GetDataTypeSize(type);
  const bool is_signed = vtkDataArray::GetDataTypeMin(type) < 0.0;
  return fmt::format("{}int{}", is_signed ? "" : "u", 8 * bytes);
}

void require_room(const std::string& path, const Values& v, std::size_t bytes_each) {
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

[[noreturn]] void truncated(const std::string& path, double expected, double found) {
  throw InputError(fmt::format("{}: it is truncated, {} bytes of values expected, {} found", path, expected, found));
}

/// Fills `bytes` from the rest of the stream.
void read_values(const std::string& path, std::istream& file, bool big_endian, Values& v) {
  require_room(path, v, size_of(v.type));
  v.bytes.resize(v.pixels() * v.components * size_of(v.type));
  file.read(v.bytes.data(), static_cast<std::streamsize>(v.bytes.size()));
  if (static_cast<std::size_t>(file.gcount()) != v.bytes.size())
    truncated(path, static_cast<double>(v.bytes.size()), static_cast<double>(file.gcount()));
  if (big_endian != (std::endian::native == std::endian::big)) swap_bytes(v.bytes, size_of(v.type));
}

template <int Dim> Values read_raw(const std::string& path, const RawImage<Dim>& raw) {
  Values v;
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

/// PNM, text or binary.
Values read_pnm(const std::string& path) {
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
  Values v;
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
        truncated(path, static_cast<double>(row) * v.size[1], static_cast<double>(row) * j);
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
      if (!(file >> digit)) truncated(path, static_cast<double>(count), static_cast<double>(k));
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

/// INRIMAGE-4: a header of 256 bytes (or a multiple) with a setting to every line, then the values; gzip or not.
Values read_inr(const std::string& path) {
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
  Values v;
  double bits = 0.0;
  std::istringstream numbers(setting("XDIM", "0") + ' ' + setting("YDIM", "0") + ' ' + setting("ZDIM", "1") + ' ' +
                             setting("VDIM", "1") + ' ' + setting("VX", "1") + ' ' + setting("VY", "1") + ' ' +
                             setting("VZ", "1") + ' ' + setting("PIXSIZE", "8 bits"));
  numbers >> v.size[0] >> v.size[1] >> v.size[2] >> v.components >> v.spacing[0] >> v.spacing[1] >> v.spacing[2] >>
      bits;
  if (!numbers || *std::min_element(v.size.begin(), v.size.end()) < 1 || v.components < 1)
    throw InputError(fmt::format("{}: cannot make sense of its header", path));
  const std::string type = setting("TYPE", "unsigned fixed"), cpu = setting("CPU", "decm");
  v.type = fmt::format("{}{}", type.starts_with("float") ? "float" : type.starts_with("signed") ? "int" : "uint", bits);
  with_type(path, v.type, [](auto) {});
  require_room(path, v, size_of(v.type));
  v.bytes.resize(v.pixels() * v.components * size_of(v.type));
  std::size_t done = 0;
  while (done < v.bytes.size()) {
    const auto wanted = static_cast<unsigned>(std::min<std::size_t>(v.bytes.size() - done, 1u << 30));
    const int got = gzread(file.get(), v.bytes.data() + done, wanted);
    if (got <= 0) truncated(path, static_cast<double>(v.bytes.size()), static_cast<double>(done));
    done += static_cast<std::size_t>(got);
  }
  const bool big_endian = cpu.starts_with("sun") || cpu.starts_with("sgi");
  if (big_endian != (std::endian::native == std::endian::big)) swap_bytes(v.bytes, size_of(v.type));
  return v;
}

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
  if (written < expected) truncated(path, static_cast<double>(expected), static_cast<double>(written));
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

/// NRRD, attached or detached (VTK's reader takes three axes for two, and falls over two): lines "key: value" up to an
/// empty one, then raw, gzip or ascii values.
Values read_nrrd(const std::string& path, int dim) {
  std::ifstream file(path, std::ios::binary);
  std::map<std::string, std::string> fields;
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty()) break;
    const auto colon = line.find(": ");
    if (line[0] != '#' && colon != std::string::npos) fields[line.substr(0, colon)] = line.substr(colon + 2);
  }
  const bool ended = static_cast<bool>(file);
  const auto either = [&](const char* a, const char* b) { return fields.contains(a) ? fields[a] : fields[b]; };
  const std::string data_file = either("data file", "datafile");
  std::vector<double> sizes = numbers_in(fields["sizes"]);
  if ((!ended && data_file.empty()) || sizes.empty())
    throw InputError(fmt::format("{}: it is truncated, its header does not end or gives no sizes", path));
  Values v;
  if (static_cast<int>(sizes.size()) == dim + 1 && sizes[0] <= 4) {
    v.components = static_cast<int>(sizes[0]);
    sizes.erase(sizes.begin());
  }
  const bool sane = std::all_of(sizes.begin(), sizes.end(), [](double n) { return n >= 1.0 && n < 0x1p31; });
  if (sizes.size() > 3 || !sane || v.components < 1)
    throw InputError(fmt::format("{}: sizes {}, expected {} positive numbers", path, fields["sizes"], dim));
  for (std::size_t d = 0; d < sizes.size(); ++d) v.size[d] = static_cast<Index>(sizes[d]);

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
  const auto type = types.find(fields["type"]);
  v.type = type == types.end() ? fields["type"] : type->second;
  with_type(path, v.type, [](auto) {});
  const std::vector<double> spacings = numbers_in(fields["spacings"]),
                            directions = numbers_in(fields["space directions"]),
                            origin = numbers_in(fields["space origin"]);
  const std::size_t n = sizes.size();
  for (std::size_t d = 0; d < n; ++d) {
    if (spacings.size() >= n) v.spacing[d] = spacings[spacings.size() - n + d];
    if (directions.size() == n * n) {
      double square = 0.0;
      for (std::size_t k = 0; k < n; ++k) square += directions[n * d + k] * directions[n * d + k];
      v.spacing[d] = std::sqrt(square);
    }
    if (origin.size() == n) v.origin[d] = origin[d] - 0.5 * v.spacing[d];
  }

  require_room(path, v, size_of(v.type));
  const auto detached = std::filesystem::path(path).parent_path() / data_file;
  if (!data_file.empty()) {
    file = std::ifstream(detached, std::ios::binary);
    if (!file)
      throw InputError(
          fmt::format("{}: its values should be in \"{}\", which does not exist", path, detached.string()));
  }
  for (double skip = numbers_in(either("line skip", "lineskip") + " 0")[0]; skip >= 1.0; --skip)
    std::getline(file, line);
  const double skip = numbers_in(either("byte skip", "byteskip") + " 0")[0];
  const std::size_t bytes = v.pixels() * v.components * size_of(v.type);
  const bool big_endian = fields["endian"] == "big";
  const std::string encoding = fields["encoding"];
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
    with_type(path, v.type, [&](auto value) {
      v.bytes.reserve(bytes);
      for (std::size_t k = 0; k < v.pixels() * v.components; ++k) {
        double number = 0.0;
        if (!(file >> number)) truncated(path, static_cast<double>(bytes), static_cast<double>(v.bytes.size()));
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
  } else {
    throw InputError(fmt::format("{}: encoding \"{}\", expected raw, gzip or ascii", path, encoding));
  }
  return v;
}

/// PNG files are chains of chunks that end with IEND.
void check_png(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  file.seekg(8);
  std::array<unsigned char, 8> chunk;
  const auto length = std::filesystem::file_size(path);
  std::uint64_t at = 8;
  while (file.read(reinterpret_cast<char*>(chunk.data()), 8)) {
    const std::uint64_t bytes = chunk[0] * 16777216ULL + chunk[1] * 65536ULL + chunk[2] * 256ULL + chunk[3];
    at += 12 + bytes;
    if (at > length) break;
    if (std::memcmp(chunk.data() + 4, "IEND", 4) == 0) return;
    file.seekg(static_cast<std::streamoff>(at));
  }
  throw InputError(fmt::format("{}: it is truncated", path));
}

/// MetaImage's library goes on with zeros where values are missing, so their number is checked here.
void check_meta_image(const std::string& path, double bytes) {
  std::ifstream file(path, std::ios::binary);
  bool compressed = false;
  for (std::string line; std::getline(file, line);) {
    const auto equals = line.find('=');
    if (equals == std::string::npos) break;
    std::string value;
    std::istringstream(line.substr(equals + 1)) >> value;
    const bool yes = value == "True" || value == "true" || value == "1";
    if (line.starts_with("CompressedData ") && yes) compressed = true;
    if (line.starts_with("CompressedDataSize")) bytes = std::stod(value);
    if (!line.starts_with("ElementDataFile")) continue;
    if (value == "LIST" || value.find('%') != std::string::npos) return;
    const bool local = value == "LOCAL" || value == "Local" || value == "local";
    const auto data = std::filesystem::path(path).parent_path() / value;
    if (!local && !std::filesystem::exists(data))
      throw InputError(fmt::format("{}: its values should be in \"{}\", which does not exist", path, data.string()));
    const double there = local
                             ? static_cast<double>(std::filesystem::file_size(path)) - static_cast<double>(file.tellg())
                             : static_cast<double>(std::filesystem::file_size(data));
    if (there < bytes && (!compressed || bytes > 0.0)) truncated(path, bytes, there);
    return;
  }
  throw InputError(fmt::format("{}: it is truncated, or no MetaImage file", path));
}

Values read_with_vtk(const std::string& path, const vtkSmartPointer<vtkImageReader2>& reader, bool meta, bool centred) {
  std::string complaint;
  vtkNew<vtkCallbackCommand> observer;
  observer->SetClientData(&complaint);
  observer->SetCallback([](vtkObject*, unsigned long, void* to, void* text) {
    auto& complaint_of_vtk = *static_cast<std::string*>(to);
    if (!complaint_of_vtk.empty() || text == nullptr) return;
    complaint_of_vtk = static_cast<const char*>(text);
    // "ERROR: In file, line n\nvtkReader (0x...): what is wrong\n\n"
    if (const auto at = complaint_of_vtk.find("): "); at != std::string::npos) complaint_of_vtk.erase(0, at + 3);
    while (!complaint_of_vtk.empty() && std::isspace(complaint_of_vtk.back())) complaint_of_vtk.pop_back();
  });
  for (const unsigned long event : {vtkCommand::ErrorEvent, vtkCommand::WarningEvent}) {
    reader->AddObserver(event, observer);
    reader->GetExecutive()->AddObserver(event, observer);
  }
  const auto check = [&] {
    if (!complaint.empty() || reader->GetErrorCode() != 0)
      throw InputError(
          fmt::format("{}: it is truncated or broken{}{}", path, complaint.empty() ? "" : ": ", complaint));
  };
  reader->SetFileName(path.c_str());
  reader->UpdateInformation();
  check();
  Values v;
  const int* extent = reader->GetDataExtent();
  for (int d = 0; d < 3; ++d) {
    v.size[d] = extent[2 * d + 1] - extent[2 * d] + 1;
    if (v.size[d] < 1) throw InputError(fmt::format("{}: it is truncated or broken, it has no pixels", path));
    if (const double spacing = reader->GetDataSpacing()[d]; meta || spacing > 0.0) v.spacing[d] = spacing;
    if (centred) v.origin[d] = reader->GetDataOrigin()[d] - 0.5 * v.spacing[d];
  }
  const std::size_t each = vtkDataArray::GetDataTypeSize(reader->GetDataScalarType());
  v.components = reader->GetNumberOfScalarComponents();
  require_room(path, v, each);
  if (meta) check_meta_image(path, static_cast<double>(v.pixels() * v.components * each));
  reader->Update();
  check();
  v.of_vtk = reader->GetOutput();
  vtkDataArray* scalars = v.of_vtk->GetPointData()->GetScalars();
  if (scalars == nullptr || static_cast<std::size_t>(scalars->GetNumberOfTuples()) != v.pixels())
    throw InputError(fmt::format("{}: it is truncated or broken, values are missing", path));
  v.components = scalars->GetNumberOfComponents();
  v.type = name_of_vtk_type(scalars->GetDataType());
  return v;
}

/// VTK's reader goes through as many dimensions as the header says there are.
void check_meta_image(const std::string& path, const std::string& head) {
  const std::size_t value = head.find_first_not_of(" \t=:", head.find("NDims") + 5);
  const double dimensions = value == std::string::npos ? 0.0 : std::strtod(head.c_str() + value, nullptr);
  if (dimensions != 2.0 && dimensions != 3.0)
    throw InputError(fmt::format("{}: it has {} dimensions (NDims), expected 2 or 3", path, dimensions));
}

template <int Dim> Values read_values_of(const std::string& path, const ImageOptions<Dim>& options) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(fmt::format("{}: there is no such file", path));
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(fmt::format("{}: it is no file", path));
  if (std::filesystem::file_size(path) == 0) throw InputError(fmt::format("{}: it is empty", path));
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(fmt::format("{}: cannot be read", path));
  std::string head(1024, '\0');
  file.read(head.data(), 1024);
  head.resize(static_cast<std::size_t>(file.gcount()));

  const std::string name = internal::lower_case(path);
  const auto ends = [&](auto... endings) { return (name.ends_with(endings) || ...); };
  const auto expect = [&](bool magic, const char* format) {
    if (!magic) throw InputError(fmt::format("{}: it is no {} file, whatever its name says", path, format));
  };
  const auto starts = [&](std::string_view magic) { return std::string_view(head).starts_with(magic); };
  if (options.raw.has_value() != ends(".raw"))
    throw InputError(fmt::format("{}: {}", path,
                                 options.raw ? "size and type are for .raw files, this one has a header"
                                             : "a .raw file says nothing about itself: give size and type"));
  if (ends(".raw")) return read_raw<Dim>(path, *options.raw);
  if (ends(".png")) {
    expect(starts("\x89PNG\r\n\x1a\n"), "PNG");
    check_png(path);
    return read_with_vtk(path, vtkSmartPointer<vtkPNGReader>::New(), false, false);
  }
  if (ends(".tif", ".tiff")) {
    using namespace std::literals;
    expect(starts("II*\0"sv) || starts("MM\0*"sv) || starts("II+\0"sv) || starts("MM\0+"sv), "TIFF");
    Values v = read_with_vtk(path, vtkSmartPointer<vtkTIFFReader>::New(), false, false);
    v.top_first = true;  // unlike VTK's other readers, whatever the file's orientation tag
    return v;
  }
  if (ends(".pgm", ".pbm", ".ppm", ".pnm")) {
    expect(head.size() > 2 && head[0] == 'P' && head[1] >= '1' && head[1] <= '6' && std::isspace(head[2]), "PNM");
    return read_pnm(path);
  }
  if (ends(".nrrd", ".nhdr")) {
    expect(starts("NRRD"), "NRRD");
    return read_nrrd(path, Dim);
  }
  if (ends(".mha", ".mhd")) {
    expect(head.find("NDims") != std::string::npos, "MetaImage");
    check_meta_image(path, head);
    return read_with_vtk(path, vtkSmartPointer<vtkMetaImageReader>::New(), true, true);
  }
  if (ends(".inr", ".inr.gz")) {
    expect(starts("#INRIMAGE-4#{") || starts("\x1f\x8b"), "INR");
    return read_inr(path);
  }
  throw InputError(
      fmt::format("{}: unknown ending, images end with .png, .tif, .tiff, .pgm, .pbm, .ppm, .pnm, .nrrd, "
                  ".nhdr, .mha, .mhd, .inr, .inr.gz or .raw",
                  path));
}

/// Throws unless all channels but alpha are equal.
template <class T> void require_grey(const std::string& path, const T* values, const Values& v) {
  const int stride = v.components, colours = stride == 2 || stride == 4 ? stride - 1 : stride;
  for (std::size_t p = 0; colours > 1 && p < v.pixels(); ++p)
    for (int c = 1; c < colours; ++c)
      if (values[p * stride + c] != values[p * stride])
        throw InputError(fmt::format("{}: it is a colour image; turn it into a grey one, or one of labels", path));
}

/// Label of every value, in the order of the file.
template <int Dim, class T>
std::vector<Label> classify(const std::string& path, const Values& v, const ImageOptions<Dim>& options) {
  const T* values = static_cast<const T*>(v.data());
  require_grey(path, values, v);
  std::vector<Label> labels(v.pixels());
  for (std::size_t p = 0; p < labels.size(); ++p) {
    const T value = values[p * v.components];
    if (options.threshold) {
      const bool high = static_cast<double>(value) >= *options.threshold;
      labels[p] = high != options.below;
      continue;
    }
    const double number = static_cast<double>(value);
    if (!(number >= 0.0 && number <= std::numeric_limits<Label>::max() && number == std::floor(number)))
      throw InputError(
          fmt::format("{}: the value {} is no label (whole numbers from 0 to {} are); for a grey image give "
                      "a threshold",
                      path, number, std::numeric_limits<Label>::max()));
    labels[p] = static_cast<Label>(number);
  }
  return labels;
}

/// Grey values as LabelImage has them. Never 0: a value that is the threshold itself counts as next to it. Values that
/// are no numbers do so, too; infinite ones as very large.
template <int Dim, class T> std::vector<float> distances_from_threshold(const T* values, int stride,
                                                                        const ImageOptions<Dim>& options,
                                                                        const std::vector<Label>& labels) {
  constexpr double least = std::numeric_limits<float>::min(), largest = 1e30;
  std::vector<float> out(labels.size());
  for (std::size_t p = 0; p < out.size(); ++p) {
    const double distance = std::abs(static_cast<double>(values[p * stride]) - *options.threshold);
    const double kept = std::isnan(distance) ? least : std::clamp(distance, least, largest);
    out[p] = static_cast<float>(labels[p] != 0 ? kept : -kept);
  }
  return out;
}

/// The file's values, with the dimensions asked for.
template <int Dim> Values read_checked(const std::string& path, const ImageOptions<Dim>& options) {
  if (!options.spacing.empty() && options.spacing.size() != 1 && options.spacing.size() != Dim)
    throw InputError(fmt::format("{}: {} spacings given, expected 1 or {}", path, options.spacing.size(), Dim));
  Values v = read_values_of<Dim>(path, options);
  if (Dim == 2 && v.size[2] != 1)
    throw InputError(fmt::format("{}: it has {} layers, expected a plane image", path, v.size[2]));
  if (Dim == 3 && v.size[2] == 1)
    throw InputError(fmt::format("{}: it has a single layer, expected an image of three dimensions", path));
  return v;
}

/// An image of this size, in this place.
template <class Image, int Dim>
Image frame_of(const std::string& path, const Values& v, const ImageOptions<Dim>& options) {
  Image image;
  for (int d = 0; d < Dim; ++d) {
    image.size[d] = v.size[d];
    image.spacing[d] = options.spacing.empty() ? v.spacing[d] : options.spacing[options.spacing.size() == 1 ? 0 : d];
    // The origin is a length as well, but not one in pixels: a spacing that is given leaves it.
    image.origin[d] = v.origin[d];
    if (!(image.spacing[d] > 0.0))
      throw InputError(fmt::format(
          "{}: the spacing of its pixels along {} is {}, expected a positive length ([geometry.image] spacing says "
          "another one)",
          path, "xyz"[d], image.spacing[d]));
  }
  Vec<Dim> extent = image.spacing;
  for (int d = 0; d < Dim; ++d) extent[d] *= image.size[d];
  internal::require_extent<Dim>(image.origin, image.origin + extent, path);
  return image;
}

/// y points up.
template <class T> void flip(const Values& v, std::vector<T>& values) {
  if (!v.top_first) return;
  for (Index k = 0; k < v.size[2]; ++k)
    for (Index j = 0; j < v.size[1] / 2; ++j) {
      const auto row = [&](Index of) {
        return values.begin() + (static_cast<std::ptrdiff_t>(k) * v.size[1] + of) * v.size[0];
      };
      std::swap_ranges(row(j), row(j) + v.size[0], row(v.size[1] - 1 - j));
    }
}

}  // namespace

template <int Dim> LabelImage<Dim> read_image(const std::string& path, const ImageOptions<Dim>& options) {
  if (options.threshold && !std::isfinite(*options.threshold))
    throw InputError(fmt::format("{}: the threshold is {}", path, *options.threshold));
  const Values v = read_checked<Dim>(path, options);
  auto image = frame_of<LabelImage<Dim>>(path, v, options);
  with_type(path, v.type, [&](auto value) {
    image.labels = classify<Dim, decltype(value)>(path, v, options);
    if (options.threshold)
      image.grey =
          distances_from_threshold(static_cast<const decltype(value)*>(v.data()), v.components, options, image.labels);
  });
  flip(v, image.labels);
  if (options.threshold) flip(v, image.grey);
  if (!options.threshold)
    for (Label& label : image.labels)
      if (std::find(options.background.begin(), options.background.end(), label) != options.background.end()) label = 0;
  check_image(image);
  const auto counts = count_labels(image);
  if (counts.size() == 1 && counts[0].label == 0) throw InputError(fmt::format("{}: all of it is background", path));
  if (static_cast<Index>(counts.size()) > options.max_labels)
    throw InputError(
        fmt::format("{}: it has {} different values and looks like a grey image: give a threshold (or allow "
                    "that many labels)",
                    path, counts.size()));
  return image;
}

template <int Dim> GreyImage<Dim> read_grey_image(const std::string& path, const ImageOptions<Dim>& options) {
  const Values v = read_checked<Dim>(path, options);
  auto image = frame_of<GreyImage<Dim>>(path, v, options);
  with_type(path, v.type, [&](auto value) {
    using T = decltype(value);
    const T* values = static_cast<const T*>(v.data());
    require_grey(path, values, v);
    image.values.resize(v.pixels());
    for (std::size_t p = 0; p < image.values.size(); ++p)
      image.values[p] = static_cast<float>(values[p * v.components]);
  });
  flip(v, image.values);
  return image;
}

ImageValues image_values(const std::string& path) {
  const Values v = read_values_of<3>(path, {});
  ImageValues out{.dimension = v.size[2] == 1 ? 2 : 3};
  with_type(path, v.type, [&](auto type) {
    using T = decltype(type);
    const T* values = static_cast<const T*>(v.data());
    const std::size_t count = v.pixels() * v.components, step = v.components;
    out.least = std::numeric_limits<double>::infinity();
    out.largest = -out.least;
    std::set<T> seen;
    for (std::size_t p = 0; p < count; p += step) {
      const double value = static_cast<double>(values[p]);
      if (!std::isfinite(value)) throw InputError(fmt::format("{}: a value is {}, expected a number", path, value));
      out.least = std::min(out.least, value);
      out.largest = std::max(out.largest, value);
      if (seen.size() <= 64) seen.insert(values[p]);
      if (value != std::floor(value)) out.are_labels = false;
    }
    out.different = static_cast<Index>(seen.size());
    if (seen.size() > 64 || out.least < 0.0 || out.largest > std::numeric_limits<Label>::max()) out.are_labels = false;

    constexpr std::size_t bins = 256;
    std::array<double, bins> histogram{};
    const double width = (out.largest - out.least) / static_cast<double>(bins);
    if (!(width > 0.0)) {
      out.threshold = out.least;
      return;
    }
    double total = 0.0, sum = 0.0;
    for (std::size_t p = 0; p < count; p += step) {
      const double at = (static_cast<double>(values[p]) - out.least) / width;
      histogram[std::min(static_cast<std::size_t>(at), bins - 1)] += 1.0;
    }
    for (std::size_t b = 0; b < bins; ++b) total += histogram[b], sum += static_cast<double>(b) * histogram[b];
    double below = 0.0, sum_below = 0.0, best = -1.0;
    for (std::size_t b = 0; b + 1 < bins; ++b) {
      below += histogram[b];
      sum_below += static_cast<double>(b) * histogram[b];
      const double above = total - below;
      if (below == 0.0 || above == 0.0) continue;
      const double apart = sum_below / below - (sum - sum_below) / above, between = below * above * apart * apart;
      if (between <= best) continue;
      best = between;
      out.threshold = out.least + static_cast<double>(b + 1) * width;
    }
  });
  return out;
}

template <int Dim> void write_image(const LabelImage<Dim>& image, const std::string& path) {
  check_image(image);
  const bool pgm = Dim == 2 && path.ends_with(".pgm");
  if (!pgm && !path.ends_with(".mha"))
    throw InputError(fmt::format("{}: images are written as {}", path, Dim == 2 ? ".pgm or .mha" : ".mha"));
  const bool wide = *std::max_element(image.labels.begin(), image.labels.end()) > 255;
  std::ofstream file(path, std::ios::binary);
  if (pgm) {
    file << fmt::format("P5\n{} {}\n{}\n", image.size[0], image.size[1], wide ? 65535 : 255);
  } else {
    const Vec<Dim> centre = image.origin + 0.5 * image.spacing;
    file << fmt::format(
        "ObjectType = Image\nNDims = {}\nBinaryData = True\nBinaryDataByteOrderMSB = True\nCompressedData = False\n"
        "Offset = {}\nElementSpacing = {}\nDimSize = {}\nElementType = {}\nElementDataFile = LOCAL\n",
        Dim, fmt::join(centre, " "), fmt::join(image.spacing, " "), fmt::join(image.size, " "),
        wide ? "MET_USHORT" : "MET_UCHAR");
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

template LabelImage<2> read_image<2>(const std::string&, const ImageOptions<2>&);
template LabelImage<3> read_image<3>(const std::string&, const ImageOptions<3>&);
template GreyImage<2> read_grey_image<2>(const std::string&, const ImageOptions<2>&);
template GreyImage<3> read_grey_image<3>(const std::string&, const ImageOptions<3>&);
template void write_image<2>(const LabelImage<2>&, const std::string&);
template void write_image<3>(const LabelImage<3>&, const std::string&);

}  // namespace efree
