// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/image_record.hpp"

#include "efree/analysis/point_field.hpp"
#include "efree/core/memory.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/answer_json.hpp"
#include "efree/io/records/internal/answer_text.hpp"
#include "efree/io/records/internal/csv.hpp"
#include "efree/io/records/internal/region_records.hpp"
#include "efree/io/records/internal/write_json.hpp"
#include "efree/io/records/writers.hpp"
#include "efree/solvers/cells/cell_slices.hpp"

#include <fmt/format.h>
#include <vtkCellData.h>
#include <vtkDataSetAttributes.h>
#include <vtkFloatArray.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkShortArray.h>
#include <vtkUnsignedCharArray.h>
#include <vtkXMLImageDataWriter.h>
#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>
#include <variant>

namespace efree {
namespace {

constexpr std::array<const char*, 6> tensor_components{"xx", "yy", "zz", "yz", "xz", "xy"};

/// Values that stay where they are, `components` to a tuple.
vtkNew<vtkFloatArray> array_on(const std::string& name, const float* values, std::size_t count, int components) {
  vtkNew<vtkFloatArray> array;
  array->SetName(name.c_str());
  array->SetNumberOfComponents(components);
  if (components == 6)
    for (int c = 0; c < 6; ++c) array->SetComponentName(c, tensor_components[c]);
  array->SetArray(const_cast<float*>(values), static_cast<vtkIdType>(count), 1);
  return array;
}

}  // namespace

void write_fields(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result) {
  const CellSolution& cells = *result.cells;
  const CellFields& fields = result.by_cell;
  const auto& n = cells.grid.cubes;
  vtkNew<vtkImageData> grid;
  grid->SetDimensions(n[0] + 1, n[1] + 1, n[2] + 1);
  grid->SetOrigin(cells.grid.origin.data());
  grid->SetSpacing(cells.grid.spacing.data());
  const Mat<3> rows = cells.axes.transpose();  // VTK's matrices are stored by rows
  grid->SetDirectionMatrix(rows.data());
  vtkCellData* data = grid->GetCellData();
  vtkNew<vtkShortArray> region;
  region->SetName("region");
  region->SetArray(const_cast<std::int16_t*>(fields.region.data()), static_cast<vtkIdType>(fields.region.size()), 1);
  data->AddArray(region);
  data->AddArray(array_on("solid", fields.solid.data(), fields.solid.size(), 1));
  std::vector<Eigen::Matrix<float, 3, Eigen::Dynamic>> displacements;
  std::vector<std::vector<float>> utilised;
  const auto answers = result.answers();
  for (std::size_t k = 0; k < answers.size(); ++k) {
    const CellFields& by_cell = answers[k]->by_cell;
    const std::string of = k == 0 ? "" : settings.cases[k].name + ": ";
    const auto& u = displacements.emplace_back(answers[k]->cells->displacement.cast<float>());
    grid->GetPointData()->AddArray(array_on(of + "displacement", u.data(), u.size(), 3));
    data->AddArray(array_on(of + "strain", by_cell.strain.data(), by_cell.strain.size(), 6));
    data->AddArray(array_on(of + "stress", by_cell.stress.data(), by_cell.stress.size(), 6));
    data->AddArray(array_on(of + "von_mises", by_cell.von_mises.data(), by_cell.von_mises.size(), 1));
    const auto& values = utilised.emplace_back(utilisation_of_cells(settings.common, result.regions, by_cell));
    if (!values.empty()) data->AddArray(array_on(of + "utilisation", values.data(), values.size(), 1));
  }
  vtkNew<vtkUnsignedCharArray> hidden;
  hidden->SetName(vtkDataSetAttributes::GhostArrayName());
  hidden->SetNumberOfValues(static_cast<vtkIdType>(fields.region.size()));
  for (std::size_t c = 0; c < fields.region.size(); ++c)
    hidden->SetValue(static_cast<vtkIdType>(c),
                     fields.region[c] < 0 ? static_cast<unsigned char>(vtkDataSetAttributes::HIDDENCELL) : 0);
  data->AddArray(hidden);

  vtkNew<vtkXMLImageDataWriter> writer;
  writer->SetFileName(file.c_str());
  writer->SetInputData(grid);
  writer->SetDataModeToAppended();
  writer->EncodeAppendedDataOff();
  writer->SetCompressorTypeToLZ4();
  if (!writer->Write() || writer->GetErrorCode() != 0) internal::cannot_write(file);
}

void write_slices(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result) {
  std::ofstream out(file);
  out << (settings.cases.empty() ? "" : "case,") << "axis,at,solid,von_mises,largest_von_mises";
  for (const char* component : tensor_components) out << ",stress_" << component;
  out << '\n';
  const auto answers = result.answers();
  for (std::size_t k = 0; k < answers.size(); ++k) {
    const auto slices = cell_slices(answers[k]->cells->grid, answers[k]->by_cell);
    for (std::size_t d = 0; d < 3; ++d)
      for (const CellSlice& slice : slices[d]) {
        if (!settings.cases.empty()) out << internal::csv_cell(settings.cases[k].name) << ',';
        out << fmt::format("{},{:.8g},{:.7g},{:.7g},{:.7g}", "xyz"[d], slice.at, slice.solid, slice.von_mises,
                           slice.most);
        for (const double component : slice.stress) out << fmt::format(",{:.7g}", component);
        out << '\n';
      }
  }
  if (!out.flush()) internal::cannot_write(file);
}

void write_result(const std::filesystem::path& file, const Settings<3>& settings, const ImageResult& result) {
  nlohmann::ordered_json json;
  json["title"] = settings.common.title;
  json["dimension"] = 3;
  const auto& n = result.cells->grid.cubes;
  json["counts"] = {{"voxels", result.image->labels.size()},
                    {"regions", result.regions.size()},
                    {"cells", result.cells->finest().cells}};
  json["grid"] = {{"cells", n},
                  {"edges", internal::json_array(result.cells->grid.spacing)},
                  {"origin", internal::json_array(result.cells->grid.origin)}};
  for (int d = 0; d < 3; ++d) json["grid"]["axes"].push_back(internal::json_array(Vec<3>(result.cells->axes.col(d))));
  json["regions"] = result.regions;
  json["boundaries"] = nlohmann::ordered_json::object();
  for (const auto& part : result.parts)
    json["boundaries"][part.name] = {{"facets", part.facets}, {"area", part.measure}};
  json["model"] = {{"taken", "linear"}};
  const auto add = [](const ImageAnswer& answer, nlohmann::ordered_json& to) {
    internal::add_values_of<3>(answer, to);
    to["estimates"]["energy"]["interfaces"] = answer.cells->interface_error;
    internal::add_ranges(field_ranges(answer.by_cell), to);
    internal::add_utilisations(answer.utilisations, to);
  };
  add(result, json);
  internal::add_regions(settings.common, result, json);
  internal::add_grids(*result.cells, json);
  internal::add_attempts(result.attempts, json);
  for (std::size_t k = 0; k < settings.cases.size(); ++k)
    add(*result.answers()[k], json["cases"][settings.cases[k].name]);
  json["reports"] = {{"basis", "cells"}};
  for (const auto& [name, reported] : result.reports)
    std::visit([&, &key = name](auto value) { json["reports"][key] = value; }, reported);
  json["reports"]["warnings"] = result.warnings;
  for (const auto& [stage, seconds] : result.times.stages()) json["seconds"][stage] = seconds;
  json["seconds"]["total"] = result.times.total();
  json["peak_memory_mb"] = peak_memory_mb();
  json["threads"] = num_threads();
  json["version"] = version();
  internal::write_json(file, json);
}

std::vector<std::string> describe_result(const Settings<3>& settings, const ImageResult& result) {
  std::vector<std::string> lines;
  const auto answers = result.answers();
  for (std::size_t k = 0; k < answers.size(); ++k) {
    if (!settings.cases.empty()) lines.push_back(fmt::format("case \"{}\":", settings.cases[k].name));
    lines.push_back(internal::grid_text(*answers[k]->cells, *answers[k]->estimates));
    for (std::string& line : internal::answer_text<3>(*answers[k], answers[k]->utilisations))
      lines.push_back(std::move(line));
  }
  return lines;
}

}  // namespace efree
