// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/writers.hpp"

#include "efree/analysis/utilisation.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/answer_json.hpp"
#include "efree/io/records/internal/json_array.hpp"
#include "efree/io/records/internal/region_records.hpp"
#include "efree/io/records/internal/utilisation_records.hpp"
#include "efree/io/records/internal/write_json.hpp"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDataSetAttributes.h>
#include <vtkDoubleArray.h>
#include <vtkFloatArray.h>
#include <vtkIntArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridWriter.h>
#include <algorithm>
#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

namespace efree {
namespace {

using internal::json_array, nlohmann::ordered_json;

using internal::cannot_write, internal::write_json;

/// A name as VTK's writer takes it, which puts it into XML as it is.
std::string in_xml(const std::string& name) {
  std::string result;
  for (const char c : name)
    if (c == '&')
      result += "&amp;";
    else if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else if (c == '"')
      result += "&quot;";
    else
      result += c;
  return result;
}

void name_components(vtkDataArray* array, const char* name, const std::vector<const char*>& components) {
  array->SetName(in_xml(name).c_str());
  array->SetNumberOfComponents(static_cast<int>(components.size()));
  for (std::size_t i = 0; components.size() > 1 && i < components.size(); ++i)
    if (components[i]) array->SetComponentName(static_cast<int>(i), components[i]);
}

/// One tuple per column of `values`; missing components become 0.
template <class Array = vtkDoubleArray> vtkNew<Array> array_of(const char* name, const Eigen::Ref<const Matrix>& values,
                                                               const std::vector<const char*>& components) {
  vtkNew<Array> array;
  name_components(array, name, components);
  array->SetNumberOfTuples(values.cols());
  const auto count = static_cast<Index>(components.size());
  auto* const to = array->GetPointer(0);
  parallel_for(static_cast<Index>(values.cols()), [&](Index p) {
    for (Index i = 0; i < count; ++i)
      to[static_cast<std::ptrdiff_t>(count) * p + i] =
          static_cast<typename Array::ValueType>(i < values.rows() ? values(i, p) : 0.0);
  });
  return array;
}
void add_array(vtkUnstructuredGrid* grid, const std::string& name, const Eigen::Ref<const Matrix>& values,
               const std::vector<const char*>& components) {
  grid->GetPointData()->AddArray(array_of(name.c_str(), values, components));
}

/// The same of what is derived from displacements: in single precision, whose seven digits are more than it is good to,
/// where it has the range.
void add_derived(vtkUnstructuredGrid* grid, const std::string& name, const Eigen::Ref<const Matrix>& values,
                 const std::vector<const char*>& components) {
  const double largest = values.cwiseAbs().maxCoeff();
  if (largest > 0.0 && !(largest > 1e-30 && largest < 1e30)) return add_array(grid, name, values, components);
  grid->GetPointData()->AddArray(array_of<vtkFloatArray>(name.c_str(), values, components));
}

template <int Dim> vtkNew<vtkUnstructuredGrid> grid_on(const Points<Dim>& points) {
  vtkNew<vtkPoints> vtk_points;
  vtk_points->SetDataTypeToDouble();
  vtk_points->SetNumberOfPoints(points.cols());
  for (Index p = 0; p < points.cols(); ++p)
    vtk_points->SetPoint(p, points(0, p), points(1, p), Dim == 3 ? points(Dim - 1, p) : 0.0);
  vtkNew<vtkUnstructuredGrid> grid;
  grid->SetPoints(vtk_points);
  return grid;
}

/// How VTK names a cell of the space and orders its points: it counts the edges around a triangle, then those up to the
/// apex; FineSpace counts them by their vertices.
template <int Dim> struct VtkCell;
template <> struct VtkCell<2> {
  static constexpr int linear = VTK_TRIANGLE, quadratic = VTK_QUADRATIC_TRIANGLE;
  static constexpr std::array<std::size_t, 6> order{0, 1, 2, 3, 5, 4};
};
template <> struct VtkCell<3> {
  static constexpr int linear = VTK_TETRA, quadratic = VTK_QUADRATIC_TETRA;
  static constexpr std::array<std::size_t, 10> order{0, 1, 2, 3, 4, 7, 5, 6, 8, 9};
};

/// Enters 1 at degrees of freedom on the parts that the conditions are on.
template <int Dim, class Conditions>
void mark(const FineSpace<Dim>& space, const Conditions& conditions, Matrix& at_dofs) {
  for (const auto& condition : conditions)
    for (const Index f : space.mesh().group(condition.on))
      for (const Index dof : space.facet(f)) at_dofs(0, dof) = 1.0;
}

void write_grid(const std::filesystem::path& file, vtkUnstructuredGrid* grid) {
  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->SetFileName(file.c_str());
  writer->SetInputData(grid);
  writer->SetDataModeToAppended();
  writer->EncodeAppendedDataOff();
  writer->SetCompressorTypeToNone();  // would take twenty times as long for a third of the bytes
  if (!writer->Write() || writer->GetErrorCode() != 0) cannot_write(file);
}

/// What an answer has by itself: energy, estimates, probes, loads and reactions, extremes with their errors,
/// utilisation.
template <int Dim> void add_answer(const CommonSettings<Dim>& settings, const FineSpace<Dim>& space,
                                   const Answer<Dim>& answer, ordered_json& json) {
  internal::add_values_of(answer, json);
  internal::add_ranges(field_ranges(space, answer.fields), json);
  internal::add_utilisations(largest_utilisations(settings, space, answer.fields), json);
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

namespace {

/// The cells of a space with their regions, at its places.
template <int Dim> vtkNew<vtkUnstructuredGrid> grid_of(const FineSpace<Dim>& space) {
  using Cell = VtkCell<Dim>;
  vtkNew<vtkUnstructuredGrid> grid = grid_on<Dim>(space.at_places(space.points()));
  const std::size_t size = space.degree() == 1 ? Dim + 1 : Cell::order.size();
  vtkNew<vtkCellArray> cells;
  Matrix region(1, space.mesh().num_cells());
  for (Index c = 0; c < space.mesh().num_cells(); ++c) {
    const auto places = space.places(c);
    cells->InsertNextCell(static_cast<int>(size));
    for (std::size_t i = 0; i < size; ++i) cells->InsertCellPoint(places[Cell::order[i]]);
    region(0, c) = space.mesh().region(c);
  }
  grid->SetCells(space.degree() == 1 ? Cell::linear : Cell::quadratic, cells);
  grid->GetCellData()->AddArray(array_of<vtkIntArray>("region", region, {""}));
  return grid;
}

template <int Dim> void add_fields(vtkUnstructuredGrid* grid, const FineSpace<Dim>& space, const Fields<Dim>& fields,
                                   const std::string& of = "") {
  if (space.num_places() > space.size())
    add_array(grid, of + "displacement", space.at_places(fields.displacement), {"x", "y", "z"});
  else
    add_array(grid, of + "displacement", fields.displacement, {"x", "y", "z"});
  const auto components = component_names<Dim>(space.axisymmetric());
  add_derived(grid, of + "strain", fields.strain, components);
  add_derived(grid, of + "stress", fields.stress, components);
  add_derived(grid, of + "von_mises", von_mises_at_places(fields).transpose(), {""});
}

}  // namespace

template <int Dim>
void write_fields(const std::filesystem::path& file, const FineSpace<Dim>& space, const Fields<Dim>& fields) {
  require(fields.displacement.cols() == space.size() && fields.strain.cols() == space.num_places() &&
              fields.stress.cols() == space.num_places(),
          "write_fields: displacements at the degrees of freedom of the space, strains and stresses at its places "
          "expected");
  const vtkNew<vtkUnstructuredGrid> grid = grid_of(space);
  add_fields(grid, space, fields);
  write_grid(file, grid);
}

namespace {

/// Fields of all load cases, and what is held and loaded.
template <int Dim> vtkNew<vtkUnstructuredGrid> grid_with(const Settings<Dim>& settings, const FineSpace<Dim>& space,
                                                         const std::vector<const Fields<Dim>*>& by_case) {
  vtkNew<vtkUnstructuredGrid> grid = grid_of(space);
  for (std::size_t k = 0; k < by_case.size(); ++k) {
    const std::string of = k == 0 ? "" : settings.cases[k].name + ": ";
    add_fields(grid, space, *by_case[k], of);
    if (const Vector utilised = utilisation_at_places(settings.common, space, *by_case[k]); utilised.size() > 0)
      add_derived(grid, of + "utilisation", utilised.transpose(), {""});
  }
  Matrix restrained = Matrix::Zero(1, space.size()), loaded = restrained;
  mark(space, settings.supports, restrained);
  for (const auto& loads : loads_by_case(settings)) {
    mark(space, loads.tractions, loaded);
    mark(space, loads.resultants, loaded);
    mark(space, loads.followers, loaded);
  }
  const auto add_mark = [&](const char* name, const Matrix& at_dofs) {
    grid->GetPointData()->AddArray(array_of<vtkUnsignedCharArray>(name, space.at_places(at_dofs), {""}));
  };
  add_mark("restrained", restrained);
  add_mark("loaded", loaded);
  return grid;
}

}  // namespace

template <int Dim> void write_fields(const std::filesystem::path& file, const Settings<Dim>& settings,
                                     const FineSpace<Dim>& space, const std::vector<const Fields<Dim>*>& by_case) {
  write_grid(file, grid_with(settings, space, by_case));
}

template <int Dim>
void write_fields(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result) {
  const FineSpace<Dim>& space = result.basis().space;
  std::vector<const Fields<Dim>*> by_case{&result.fields};
  for (const Answer<Dim>& answer : result.more) by_case.push_back(&answer.fields);
  const vtkNew<vtkUnstructuredGrid> grid = grid_with(settings, space, by_case);
  if (result.instability.size() > 0)
    add_array(grid, "instability_mode", space.at_places(result.instability), {"x", "y", "z"});
  for (const auto& [name, values] : result.remembered) {
    const auto components = values.rows() == 6 ? std::vector<const char*>{"xx", "yy", "zz", "yz", "xz", "xy"}
                                               : std::vector<const char*>(values.rows(), "");
    add_array(grid, name, values, components);
  }
  if (result.error_density.size() > 0)
    grid->GetCellData()->AddArray(array_of("error", result.error_density.transpose(), {""}));
  write_grid(file, grid);
}

namespace {

void add_values(const std::filesystem::path& file, Eigen::Index count, const std::vector<PointValues>& values,
                vtkDataSetAttributes* to) {
  for (const PointValues& of : values) {
    if (of.values.cols() != count)
      throw InputError(
          fmt::format("{}: {} values of {}, expected {}", file.string(), of.values.cols(), of.name, count));
    std::vector<const char*> components;
    for (Index i = 0; i < of.values.rows(); ++i)
      components.push_back(i < static_cast<Index>(of.components.size()) ? of.components[i].c_str() : nullptr);
    // A vector has three components for ParaView.
    while (of.components == std::vector<std::string>{"x", "y"} && components.size() == 2) components.push_back("z");
    to->AddArray(array_of(of.name.c_str(), of.values, components));
  }
}

}  // namespace

template <int Dim> void write_points(const std::filesystem::path& file, const Points<Dim>& points,
                                     const std::vector<PointValues>& values) {
  const vtkNew<vtkUnstructuredGrid> grid = grid_on<Dim>(points);
  vtkNew<vtkCellArray> cells;
  for (Index p = 0; p < points.cols(); ++p) {
    cells->InsertNextCell(1);
    cells->InsertCellPoint(p);
  }
  grid->SetCells(VTK_VERTEX, cells);
  add_values(file, points.cols(), values, grid->GetPointData());
  write_grid(file, grid);
}

template <int Dim> void write_cells(const std::filesystem::path& file, const Points<Dim>& vertices,
                                    const Cells<Dim>& cells, const std::vector<PointValues>& at_vertices,
                                    const std::vector<PointValues>& of_cells) {
  const vtkNew<vtkUnstructuredGrid> grid = grid_on<Dim>(vertices);
  vtkNew<vtkCellArray> vtk_cells;
  for (Index c = 0; c < cells.cols(); ++c) {
    vtk_cells->InsertNextCell(Dim + 1);
    for (int i = 0; i <= Dim; ++i) vtk_cells->InsertCellPoint(cells(i, c));
  }
  grid->SetCells(VtkCell<Dim>::linear, vtk_cells);
  add_values(file, vertices.cols(), at_vertices, grid->GetPointData());
  add_values(file, cells.cols(), of_cells, grid->GetCellData());
  write_grid(file, grid);
}

template <int Dim> void write_mesh(const std::filesystem::path& file, const FineMesh<Dim>& mesh) {
  Matrix region(1, mesh.num_cells());
  for (Index c = 0; c < mesh.num_cells(); ++c) region(0, c) = mesh.region(c);
  write_cells<Dim>(file, mesh.vertices(), mesh.cells(), {}, {{"region", region}});
}

template <int Dim> void write_nodes(const std::filesystem::path& file, const Result<Dim>& result) {
  const Approximation<Dim>& approximation = result.approximation;
  std::vector<std::string> axes{"x", "y"};
  if (Dim == 3) axes.push_back("z");
  write_points<Dim>(file, approximation.nodes,
                    {{"displacement", result.fields.displacement(Eigen::all, approximation.node_dofs), axes}});
}

namespace {

template <int Dim> void add_counts(const Result<Dim>& result, ordered_json& json) {
  const Approximation<Dim>& approximation = result.approximation;
  json["counts"] = {{"fine_vertices", result.mesh->num_vertices()},
                    {"fine_cells", result.mesh->num_cells()},
                    {"regions", result.mesh->num_regions()},
                    {"nodes", approximation.nodes.cols()},
                    {"quadrature_points", approximation.quadrature.size()}};
  json["regions"] = result.mesh->region_names();
  json["boundaries"] = ordered_json::object();
  for (const auto& part : result.parts)
    json["boundaries"][part.name] = {{"facets", part.facets}, {Dim == 2 ? "length" : "area", part.measure}};
}

/// The model that was chosen, and why.
template <int Dim> void add_model(const Settings<Dim>& settings, const Result<Dim>& result, ordered_json& json) {
  json["model"] = {{"taken", result.regime == Regime::linear ? "linear" : "finite"}};
  for (const LinearCheck& check : result.linear_checks) {
    ordered_json one = {{"time", check.time},
                        {"linear", check.enough},
                        {"displacement", check.displacement},
                        {"stress", check.stress},
                        {"overload", check.overload},
                        {"strain", check.strain},
                        {"rotation", check.rotation},
                        {"negative_pivots", check.negative_pivots},
                        {"same", check.same}};
    if (!check.failure.empty()) one["failure"] = check.failure;
    json["model"]["tolerance"] = settings.regime_tolerance;
    json["model"]["checks"].push_back(one);
  }
}

/// Of an analysis through time.
template <int Dim> void add_path(const Result<Dim>& result, ordered_json& json) {
  const auto& last = result.history.back();
  int iterations = 0;
  for (const auto& step : result.history) iterations += step.iterations;
  json["path"] = {{"steps", result.history.size()},
                  {"time", last.time},
                  {"iterations", iterations},
                  {"dissipated", last.dissipated},
                  {"smallest_J", last.smallest_jacobian},
                  {"plastic_share", last.plastic_share},
                  {"negative_pivots", last.negative_pivots}};
  for (const auto& [name, values] : result.remembered)
    if (values.rows() == 1) json["path"]["largest"][name] = values.maxCoeff();
  json["path"]["gap"] = result.gap;
  if (!result.stopped.empty()) json["path"]["stopped"] = result.stopped;
}

template <int Dim> void add_path_errors(const Result<Dim>& result, ordered_json& json) {
  const auto& errors = *result.path_errors;
  json["estimates"]["path"] = {{"coarser", errors.coarser},       {"until", errors.until},   {"work", errors.work},
                               {"dissipated", errors.dissipated}, {"space", errors.space},   {"steps", errors.steps},
                               {"reactions", errors.reactions},   {"probes", errors.probes}, {"stress", nullptr}};
  if (errors.stress) json["estimates"]["path"]["stress"] = *errors.stress;
  if (errors.limit) json["estimates"]["path"]["limit"] = *errors.limit;
}

/// How functions and quadrature were made, and warnings.
template <int Dim> void add_reports(const Settings<Dim>& settings, const Result<Dim>& result, ordered_json& json) {
  const Approximation<Dim>& approximation = result.approximation;
  json["reports"] = {{"supports_grown", approximation.mls.grown_nodes},
                     {"largest_support_growth", approximation.mls.largest_growth},
                     {"largest_sum_of_shape_functions", approximation.mls.largest_sum},
                     {"small_bodies", approximation.small_bodies},
                     {"own_functions", approximation.mls.own_functions},
                     {"quadrature_points_dropped", approximation.dropped_points},
                     {"interpolation", result.basis().space.degree()}};
  ApproximationOptions asked = settings.common.approximation;
  asked.dilatation = approximation.averaged ? Dilatation::averaged : Dilatation::pointwise;
  const bool has_cloud = approximation.shape.num_nodes() < approximation.space.size();
  json["reports"]["basis"] = has_cloud ? "mls" : result.basis().space.degree() == 1 ? "p1" : "p2";
  if (has_cloud && asked.secondary != SecondaryKind::full) {
    const double vertices_per_node = static_cast<double>(result.mesh->num_vertices()) / approximation.nodes.cols();
    json["reports"]["ratio_asked"] = with_defaults<Dim>(asked, vertices_per_node).ratio;
    json["reports"]["ratio_reached"] = approximation.ratio();
  }
  for (const auto& [name, reported] : result.reports)
    std::visit([&, &key = name](auto value) { json["reports"][key] = value; }, reported);
  json["reports"]["warnings"] = result.warnings;
}

}  // namespace

template <int Dim>
void write_result(const std::filesystem::path& file, const Settings<Dim>& settings, const Result<Dim>& result) {
  ordered_json json;
  json["title"] = settings.common.title;
  json["dimension"] = Dim;
  add_counts(result, json);
  add_model(settings, result, json);
  if (!result.history.empty()) add_path(result, json);
  if (result.errors) json["errors"] = errors_json(*result.errors);
  add_answer<Dim>(settings.common, result.basis().space, result, json);
  internal::add_regions<Dim>(settings.common, result, json);
  internal::add_attempts(result.attempts, json);
  if (!result.history.empty())
    for (const auto& reaction : settings.reactions)
      json["reactions"][reaction.name] = internal::json_of<Dim>(result.balance.reactions.at(reaction.on));
  if (result.cloud_alone)
    json["estimates"]["cloud_alone"] = {{"reactions", result.cloud_alone->reactions},
                                        {"probes", result.cloud_alone->probes}};
  if (result.path_errors) add_path_errors(result, json);
  for (std::size_t k = 0; k < settings.cases.size(); ++k) {
    const Answer<Dim>& answer = k == 0 ? static_cast<const Answer<Dim>&>(result) : result.more[k - 1];
    add_answer(settings.common, result.basis().space, answer, json["cases"][settings.cases[k].name]);
  }
  add_reports(settings, result, json);
  for (const auto& [stage, seconds] : result.times.stages()) json["seconds"][stage] = seconds;
  json["seconds"]["total"] = result.times.total();
  json["peak_memory_mb"] = peak_memory_mb();
  json["bytes_per_fine_vertex"] = 0x1p20 * peak_memory_mb() / result.mesh->num_vertices();
  json["threads"] = num_threads();
  json["version"] = version();
  write_json(file, json);
}

void write_failure(const std::filesystem::path& file, const std::string& title, const std::string& reason,
                   const std::string& stage, const std::string& results) {
  write_json(file, {{"title", title},
                    {"status", "failed"},
                    {"reason", reason},
                    {"stage", stage},
                    {"results", results},
                    {"version", version()}});
}

template void write_fields<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void write_fields<2>(const std::filesystem::path&, const FineSpace<2>&, const Fields<2>&);
template void write_points<2>(const std::filesystem::path&, const Points<2>&, const std::vector<PointValues>&);
template void write_points<3>(const std::filesystem::path&, const Points<3>&, const std::vector<PointValues>&);
template void write_cells<2>(const std::filesystem::path&, const Points<2>&, const Cells<2>&,
                             const std::vector<PointValues>&, const std::vector<PointValues>&);
template void write_cells<3>(const std::filesystem::path&, const Points<3>&, const Cells<3>&,
                             const std::vector<PointValues>&, const std::vector<PointValues>&);
template void write_mesh<2>(const std::filesystem::path&, const FineMesh<2>&);
template void write_mesh<3>(const std::filesystem::path&, const FineMesh<3>&);
template void write_nodes<2>(const std::filesystem::path&, const Result<2>&);
template void write_result<2>(const std::filesystem::path&, const Settings<2>&, const Result<2>&);
template void write_fields<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);
template void write_fields<3>(const std::filesystem::path&, const Settings<3>&, const FineSpace<3>&,
                              const std::vector<const Fields<3>*>&);
template void write_fields<3>(const std::filesystem::path&, const FineSpace<3>&, const Fields<3>&);
template void write_nodes<3>(const std::filesystem::path&, const Result<3>&);
template void write_result<3>(const std::filesystem::path&, const Settings<3>&, const Result<3>&);

}  // namespace efree
