// SPDX-License-Identifier: GPL-3.0-or-later
/// Images that VTK reads: PNG, TIFF, MetaImage, NIfTI.
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <vtkCallbackCommand.h>
#include <vtkDataArray.h>
#include <vtkExecutive.h>
#include <vtkImageData.h>
#include <vtkImageReader2.h>
#include <vtkMatrix4x4.h>
#include <vtkMetaImageReader.h>
#include <vtkNIFTIImageHeader.h>
#include <vtkNIFTIImageReader.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkTIFFReader.h>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace efree::internal {
namespace {

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

/// Throws for a file that ends early: PNG files are chains of chunks that end with IEND.
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
void check_length(const std::string& path, double bytes) {
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
    if (there < bytes && (!compressed || bytes > 0.0)) throw_truncated(path, bytes, there);
    return;
  }
  throw InputError(fmt::format("{}: it is truncated, or no MetaImage file", path));
}

PixelValues read_with_vtk(const std::string& path, const vtkSmartPointer<vtkImageReader2>& reader, bool meta = false) {
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
  PixelValues v;
  const int* extent = reader->GetDataExtent();
  for (int d = 0; d < 3; ++d) {
    v.size[d] = extent[2 * d + 1] - extent[2 * d] + 1;
    if (v.size[d] < 1) throw InputError(fmt::format("{}: it is truncated or broken, it has no pixels", path));
    if (const double spacing = reader->GetDataSpacing()[d]; meta || spacing > 0.0) v.spacing[d] = spacing;
    if (meta) v.origin[d] = reader->GetDataOrigin()[d];
  }
  const std::size_t each = vtkDataArray::GetDataTypeSize(reader->GetDataScalarType());
  v.components = reader->GetNumberOfScalarComponents();
  require_room(path, v, each);
  if (meta) check_length(path, static_cast<double>(v.pixels() * v.components * each));
  reader->Update();
  check();
  const vtkSmartPointer<vtkImageData> image = reader->GetOutput();
  vtkDataArray* scalars = image->GetPointData()->GetScalars();
  if (scalars == nullptr || static_cast<std::size_t>(scalars->GetNumberOfTuples()) != v.pixels())
    throw InputError(fmt::format("{}: it is truncated or broken, values are missing", path));
  v.shared = std::shared_ptr<const void>(scalars->GetVoidPointer(0), [image](const void*) {});
  v.components = scalars->GetNumberOfComponents();
  v.type = name_of_vtk_type(scalars->GetDataType());
  return v;
}

/// VTK's reader goes through as many dimensions as the header says there are.
void check_dimensions(const std::string& path, const std::string& head) {
  const std::size_t value = head.find_first_not_of(" \t=:", head.find("NDims") + 5);
  const double dimensions = value == std::string::npos ? 0.0 : std::strtod(head.c_str() + value, nullptr);
  if (dimensions != 2.0 && dimensions != 3.0)
    throw InputError(fmt::format("{}: it has {} dimensions (NDims), expected 2 or 3", path, dimensions));
}

/// Of MetaImage: the directions of its axes, one after the other. Throws InputError also for edges of voxels that are
/// not positive, which VTK's reader takes.
void read_meta_frame(const std::string& path, PixelValues& v) {
  std::ifstream file(path, std::ios::binary);
  for (std::string line; std::getline(file, line) && !line.starts_with("ElementDataFile");) {
    const auto equals = line.find('=');
    const std::string key = line.substr(0, line.find_first_of(" \t="));
    const bool is_spacing = key == "ElementSpacing" || key == "ElementSize";
    if (equals == std::string::npos ||
        (!is_spacing && key != "TransformMatrix" && key != "Rotation" && key != "Orientation"))
      continue;
    const int dim = v.size[2] > 1 ? 3 : 2;
    std::istringstream numbers(line.substr(equals + 1));
    std::vector<double> values;
    for (double value = 0.0; numbers >> value;) values.push_back(value);
    if (is_spacing) {
      if (!std::ranges::all_of(values, [](double edge) { return edge > 0.0; }))
        throw InputError(fmt::format("{}: {}, expected edges of a voxel > 0", path, line));
      continue;
    }
    const int axes = values.size() == 9 ? 3 : 2;
    if (static_cast<int>(values.size()) != axes * axes || axes < dim)
      throw InputError(fmt::format("{}: {}, expected {} numbers", path, line, dim * dim));
    for (int a = 0; a < axes; ++a)
      for (int d = 0; d < axes; ++d) v.axes(d, a) = values[axes * a + d];
  }
}

/// Values times the slope of a NIfTI header, plus its intercept.
void rescale(const std::string& path, double slope, double intercept, PixelValues& v) {
  with_type(path, v.type, [&](auto type) {
    const auto* from = static_cast<const decltype(type)*>(v.data());
    std::vector<char> bytes(v.pixels() * v.components * sizeof(double));
    auto* to = reinterpret_cast<double*>(bytes.data());
    for (std::size_t p = 0; p < v.pixels() * v.components; ++p)
      to[p] = slope * static_cast<double>(from[p]) + intercept;
    v.bytes = std::move(bytes);
  });
  v.shared.reset();
  v.type = "float64";
}

}  // namespace

PixelValues read_png(const std::string& path) {
  check_png(path);
  return read_with_vtk(path, vtkSmartPointer<vtkPNGReader>::New());
}

PixelValues read_tiff(const std::string& path) {
  PixelValues v = read_with_vtk(path, vtkSmartPointer<vtkTIFFReader>::New());
  // VTK's reader begins with the top row, unlike its others, whatever the file's orientation tag.
  v.top_first = v.size[2] == 1;
  read_tiff_spacing(path, v);
  return v;
}

PixelValues read_nifti(const std::string& path) {
  const auto reader = vtkSmartPointer<vtkNIFTIImageReader>::New();
  PixelValues v = read_with_vtk(path, reader);
  vtkMatrix4x4* matrix = reader->GetSFormMatrix();
  v.spacing_from = matrix != nullptr ? "NIfTI s-form" : "NIfTI q-form";
  if (matrix == nullptr) matrix = reader->GetQFormMatrix();
  if (matrix == nullptr) {
    v.spacing_from = "NIfTI pixdim";
  } else {
    v.centred = true;
    v.world = "RAS";
    for (int a = 0; a < 3; ++a) {
      Vec<3> direction;
      for (int d = 0; d < 3; ++d) direction[d] = matrix->GetElement(d, a);
      // VTK has taken the edges out of the matrix, in single precision.
      const double length = direction.norm(), edge = v.spacing[a] * length;
      v.spacing[a] = std::strtod(fmt::format("{}", static_cast<float>(edge)).c_str(), nullptr);
      if (direction.norm() > 0.0) v.axes.col(a) = direction.normalized();
      v.origin[a] = matrix->GetElement(a, 3);
    }
  }
  const double slope = reader->GetRescaleSlope(), intercept = reader->GetRescaleIntercept();
  if (slope != 0.0 && (slope != 1.0 || intercept != 0.0)) rescale(path, slope, intercept, v);
  return v;
}

PixelValues read_meta_image(const std::string& path, const std::string& head) {
  check_dimensions(path, head);
  PixelValues v = read_with_vtk(path, vtkSmartPointer<vtkMetaImageReader>::New(), true);
  v.spacing_from = "MetaImage ElementSpacing";
  v.world = "LPS";  // as ITK, whose format it is, has it
  v.centred = true;
  read_meta_frame(path, v);
  return v;
}

}  // namespace efree::internal
