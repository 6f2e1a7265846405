// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/writers.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridWriter.h>
#include <algorithm>
#include <array>
#include <fstream>
#include <initializer_list>
#include <nlohmann/json.hpp>

namespace efree {
namespace {

using nlohmann::ordered_json;

[[noreturn]] void cannot_write(const std::filesystem::path& file) {
  throw InputError(fmt::format("cannot write {}", file.string()));
}

void write_json(const std::filesystem::path& file, const ordered_json& json) {
  std::ofstream stream(file);
  stream << json.dump(2) << '\n';
  if (!stream.flush()) cannot_write(file);
}

/// Point data with one tuple per column of `values`; missing components become 0.
void add_array(vtkUnstructuredGrid* grid, const char* name, const Eigen::Ref<const Matrix>& values,
               std::initializer_list<const char*> components) {
  vtkNew<vtkDoubleArray> array;
  array->SetName(name);
  array->SetNumberOfComponents(static_cast<int>(components.size()));
  array->SetNumberOfTuples(values.cols());
  int i = 0;
  for (const char* component : components) {
    if (components.size() > 1) array->SetComponentName(i, component);
    for (Index p = 0; p < values.cols(); ++p) array->SetComponent(p, i, i < values.rows() ? values(i, p) : 0.0);
    ++i;
  }
  grid->GetPointData()->AddArray(array);
}

vtkNew<vtkUnstructuredGrid> grid_on(const Points<2>& points) {
  vtkNew<vtkPoints> vtk_points;
  vtk_points->SetDataTypeToDouble();
  vtk_points->SetNumberOfPoints(points.cols());
  for (Index p = 0; p < points.cols(); ++p) vtk_points->SetPoint(p, points(0, p), points(1, p), 0.0);
  vtkNew<vtkUnstructuredGrid> grid;
  grid->SetPoints(vtk_points);
  return grid;
}

void write_grid(const std::filesystem::path& file, vtkUnstructuredGrid* grid) {
  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->SetFileName(file.c_str());
  writer->SetInputData(grid);
  writer->SetDataModeToAppended();
  writer->EncodeAppendedDataOff();
  writer->SetCompressorTypeToZLib();
  if (!writer->Write()) cannot_write(file);
}

template <class Values> ordered_json array(const Values& values) {
  return std::vector<double>(values.begin(), values.end());
}

ordered_json errors_json(const Errors& errors) {
  ordered_json json = ordered_json::object();
  if (errors.l2_displacement) json["l2_displacement"] = *errors.l2_displacement;
  if (errors.energy_norm) json["energy_norm"] = *errors.energy_norm;
  if (errors.energy_norm_recovered) json["energy_norm_recovered"] = *errors.energy_norm_recovered;
  return json;
}

}  // namespace

std::string version() {
  return EFREE_VERSION;
}

void write_fields(const std::filesystem::path& file, const Case& analysis, const CaseResult& result) {
  const FineSpace<2>& space = result.approximation.space;
  const vtkNew<vtkUnstructuredGrid> grid = grid_on(space.points());
  constexpr std::array<int, 6> vtk_order{0, 1, 2, 3, 5, 4};  // VTK counts the edges around, FineSpace by their vertices
  const std::size_t size = space.degree() == 1 ? 3 : 6;
  vtkNew<vtkCellArray> cells;
  for (Index c = 0; c < space.mesh().num_cells(); ++c) {
    const auto dofs = space.cell(c);
    cells->InsertNextCell(static_cast<int>(size));
    for (std::size_t i = 0; i < size; ++i) cells->InsertCellPoint(dofs[static_cast<std::size_t>(vtk_order[i])]);
  }
  grid->SetCells(space.degree() == 1 ? VTK_TRIANGLE : VTK_QUADRATIC_TRIANGLE, cells);

  const Fields<2>& fields = result.fields;
  Matrix mises(1, space.size());
  for (Index p = 0; p < space.size(); ++p)
    mises(0, p) = von_mises(fields.stress.col(p), analysis.model.plane, analysis.model.material.nu);
  add_array(grid, "displacement", fields.displacement, {"x", "y", "z"});
  add_array(grid, "strain", fields.strain, {"xx", "yy", "xy"});
  add_array(grid, "stress", fields.stress, {"xx", "yy", "xy"});
  add_array(grid, "von_mises", mises, {""});
  write_grid(file, grid);
}

void write_nodes(const std::filesystem::path& file, const CaseResult& result) {
  const Approximation<2>& approximation = result.approximation;
  const vtkNew<vtkUnstructuredGrid> grid = grid_on(approximation.nodes);
  vtkNew<vtkCellArray> cells;
  for (Index I = 0; I < approximation.nodes.cols(); ++I) {
    cells->InsertNextCell(1);
    cells->InsertCellPoint(I);
  }
  grid->SetCells(VTK_VERTEX, cells);
  add_array(grid, "displacement", result.fields.displacement(Eigen::all, approximation.node_dofs), {"x", "y", "z"});
  write_grid(file, grid);
}

void write_result(const std::filesystem::path& file, const Case& analysis, const CaseResult& result) {
  const Approximation<2>& approximation = result.approximation;
  ordered_json json;
  json["title"] = analysis.title;
  json["counts"] = {{"fine_vertices", result.mesh->num_vertices()},
                    {"fine_cells", result.mesh->num_cells()},
                    {"nodes", approximation.nodes.cols()},
                    {"quadrature_points", approximation.quadrature.size()}};
  if (result.errors) json["errors"] = errors_json(*result.errors);
  json["strain_energy"] = result.solution.strain_energy;
  json["probes"] = ordered_json::object();
  for (const auto& [name, values] : result.probes)
    json["probes"][name] = {{"displacement", array(values.displacement)},
                            {"strain", array(values.strain)},
                            {"stress", array(values.stress)}};
  json["reports"] = {{"supports_grown", approximation.mls.grown_nodes},
                     {"largest_support_growth", approximation.mls.largest_growth},
                     {"largest_sum_of_shape_functions", approximation.mls.largest_sum},
                     {"quadrature_points_dropped", approximation.dropped_points},
                     {"warnings", result.warnings}};
  for (const auto& [stage, seconds] : result.times.stages()) json["seconds"][stage] = seconds;
  json["seconds"]["total"] = result.times.total();
  json["peak_memory_mb"] = peak_memory_mb();
  json["threads"] = num_threads();
  json["version"] = version();
  write_json(file, json);
}

void write_failure(const std::filesystem::path& file, const Case& analysis, const std::string& reason,
                   const std::string& stage) {
  write_json(
      file,
      {{"title", analysis.title}, {"status", "failed"}, {"reason", reason}, {"stage", stage}, {"version", version()}});
}

}  // namespace efree
