// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/recorded_run.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <string_view>

namespace efree {
namespace fs = std::filesystem;
namespace {

vtkNew<vtkXMLUnstructuredGridReader> read_vtu(const fs::path& file) {
  if (!fs::exists(file)) throw InputError(fmt::format("{}: the file is missing; efree run writes it", file.string()));
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  if (reader->CanReadFile(file.c_str()) == 0)
    throw InputError(fmt::format("{}: expected an unstructured grid of VTK", file.string()));
  reader->SetFileName(file.c_str());
  reader->Update();
  if (reader->GetErrorCode() != 0 || reader->GetOutput() == nullptr || reader->GetOutput()->GetNumberOfPoints() == 0)
    throw InputError(fmt::format("{}: the file is damaged, or empty", file.string()));
  return reader;
}

/// What is between quotes after a name in a line, or nothing.
std::string_view quoted_after(std::string_view line, std::string_view name) {
  const auto begin = line.find(name);
  if (begin == std::string_view::npos) return {};
  line.remove_prefix(begin + name.size());
  return line.substr(0, line.find('"'));
}

/// The frames of a series by their times.
std::vector<std::pair<double, std::string>> read_series(const fs::path& folder) {
  const fs::path file = folder / "points.pvd";
  std::ifstream in(file);
  if (!in) {
    const fs::path unfinished = folder / "unfinished";
    throw InputError(
        fs::exists(unfinished / "points.pvd")
            ? fmt::format("{}: the run has not ended; efree run --resume ends it, and its frames so far are in {}",
                          folder.string(), unfinished.string())
            : fmt::format("{}: expected the folder of a run of explicit dynamics, as efree run makes it with "
                          "analysis.kind = \"dynamics\"; there is no points.pvd",
                          folder.string()));
  }
  static const std::regex frame_name(R"(points_[0-9]{4,9}\.vtu)");
  std::vector<std::pair<double, std::string>> frames;
  for (std::string line; std::getline(in, line);) {
    const std::string_view time = quoted_after(line, "timestep=\""), name = quoted_after(line, "file=\"");
    if (time.empty() && name.empty()) continue;
    double t = 0.0;
    const auto [end, error] = std::from_chars(time.data(), time.data() + time.size(), t);
    if (error != std::errc{} || end != time.data() + time.size() || !std::isfinite(t) ||
        (!frames.empty() && t < frames.back().first))
      throw InputError(fmt::format("{}: expected times that grow, not \"{}\"", file.string(), time.substr(0, 100)));
    if (name.size() > 30 || !std::regex_match(name.begin(), name.end(), frame_name))
      throw InputError(fmt::format("{}: expected points_NNNN.vtu, not \"{}\"", file.string(), name.substr(0, 100)));
    frames.emplace_back(t, name);
  }
  if (frames.empty()) throw InputError(fmt::format("{}: there are no frames in it", file.string()));
  return frames;
}

template <int Dim> Points<Dim> points_of(vtkUnstructuredGrid* grid, const fs::path& file) {
  Points<Dim> points(Dim, grid->GetNumberOfPoints());
  for (Index p = 0; p < points.cols(); ++p) {
    Vec<3> x;
    grid->GetPoint(p, x.data());
    points.col(p) = x.head<Dim>();
  }
  if (!points.allFinite()) throw InputError(fmt::format("{}: positions are not finite", file.string()));
  return points;
}

std::vector<Index> integers_of(vtkDataArray* array, vtkIdType count, const char* name, const fs::path& file) {
  if (array == nullptr || array->GetNumberOfTuples() != count || array->GetNumberOfComponents() != 1)
    throw InputError(fmt::format("{}: expected the array {}", file.string(), name));
  std::vector<Index> values;
  for (vtkIdType p = 0; p < count; ++p) {
    const double value = array->GetTuple1(p);
    if (!(value >= 0.0 && value < 1e9) || value != std::floor(value))
      throw InputError(fmt::format("{}: expected numbers from 0 on in {}, not {}", file.string(), name, value));
    values.push_back(static_cast<Index>(value));
  }
  return values;
}

template <int Dim> FineMesh<Dim> read_bodies(const fs::path& file) {
  const auto reader = read_vtu(file);
  vtkUnstructuredGrid* grid = reader->GetOutput();
  MeshData<Dim> data{.vertices = points_of<Dim>(grid, file), .cells = {}, .groups = {}};
  data.cells.resize(Dim + 1, grid->GetNumberOfCells());
  vtkNew<vtkIdList> corners;
  for (Index c = 0; c < data.cells.cols(); ++c) {
    grid->GetCellPoints(c, corners);
    if (corners->GetNumberOfIds() != Dim + 1)
      throw InputError(fmt::format("{}: expected {} only", file.string(), Dim == 2 ? "triangles" : "tetrahedra"));
    for (int i = 0; i <= Dim; ++i) data.cells(i, c) = static_cast<Index>(corners->GetId(i));
  }
  data.regions = integers_of(grid->GetCellData()->GetArray("region"), data.cells.cols(), "region", file);
  Index regions = 0;
  for (const Index region : data.regions) {
    if (region >= data.cells.cols()) throw InputError(fmt::format("{}: there is no body {}", file.string(), region));
    regions = std::max(regions, region + 1);
  }
  for (Index r = 0; r < regions; ++r) data.region_names.push_back(fmt::format("{}", r));
  return FineMesh<Dim>(std::move(data));
}

std::string read_title(const fs::path& folder) {
  std::ifstream in(folder / "result.json");
  const auto json = nlohmann::json::parse(in, nullptr, false);
  const auto title = json.is_object() ? json.find("title") : json.end();
  if (title != json.end() && title->is_string()) return title->get<std::string>();
  return (folder / "").parent_path().filename().string();
}

}  // namespace

int recorded_dimension(const fs::path& folder) {
  const fs::path file = folder / read_series(folder).front().second;
  const auto reader = read_vtu(file);
  return points_of<3>(reader->GetOutput(), file).row(2).isZero(0.0) ? 2 : 3;
}

template <int Dim> RecordedRun<Dim>::RecordedRun(fs::path folder)
    : folder_(std::move(folder)), frames_(read_series(folder_)), title_(read_title(folder_)) {
  if (const fs::path file = folder_ / "bodies.vtu"; fs::exists(file)) bodies_ = read_bodies<Dim>(file);
}

template <int Dim> RecordedFrame<Dim> RecordedRun<Dim>::frame(Index number) const {
  const std::string& name = frames_[number].second;
  const fs::path file = folder_ / name, nodes = folder_ / ("nodes" + name.substr(name.find('_')));
  RecordedFrame<Dim> frame;
  {
    const auto reader = read_vtu(file);
    vtkUnstructuredGrid* grid = reader->GetOutput();
    frame.points = points_of<Dim>(grid, file);
    vtkPointData* data = grid->GetPointData();
    frame.body_of_point = integers_of(data->GetArray("body"), grid->GetNumberOfPoints(), "body", file);
    for (int a = 0; a < data->GetNumberOfArrays(); ++a) {
      vtkDataArray* array = data->GetArray(a);
      if (array == nullptr || array->GetNumberOfComponents() != 1 || array->GetName() == std::string("body")) continue;
      Vector values(frame.points.cols());
      for (Index p = 0; p < values.size(); ++p) values[p] = array->GetTuple1(p);
      if (!values.allFinite())
        throw InputError(fmt::format("{}: values of {} are not finite", file.string(), array->GetName()));
      frame.scalars.emplace_back(array->GetName(), std::move(values));
    }
  }
  const auto reader = read_vtu(nodes);
  frame.nodes = points_of<Dim>(reader->GetOutput(), nodes);
  vtkDataArray* mass = reader->GetOutput()->GetPointData()->GetArray("mass");
  for (Index a = 0; mass != nullptr && mass->GetNumberOfTuples() == frame.nodes.cols() && a < frame.nodes.cols(); ++a)
    frame.has_merged_nodes |= mass->GetComponent(a, 0) == 0.0;
  return frame;
}

template class RecordedRun<2>;
template class RecordedRun<3>;

}  // namespace efree
