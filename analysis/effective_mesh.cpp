// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/effective.hpp"

#include "efree/analysis/internal/effective_interpretation.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/prepare_mesh.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/unit_cell.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>

namespace efree {
namespace {

using internal::EffectivePhase, internal::said_at;

/// Share of a side of the frame that faces void, from which on a body is not periodic.
constexpr double not_periodic = 0.01;

/// Cells of a mesh whose size is not said: in space a tensor takes 20 s then.
template <int Dim> constexpr double natural_cells = Dim == 2 ? 1e6 : 2e4;

/// Bytes that the factor takes for each cell: in space of a cube of 47,000 cells whose opposite sides have other meshes
/// (6.3 GB), and a ninth of that for one unknown to a node.
template <int Dim> constexpr double bytes_of_factor(EffectiveProperty property) {
  return Dim == 2 ? 10e3 : property == EffectiveProperty::stiffness ? 140e3 : 16e3;
}

/// The plane of a stiffness; means nothing in space and of a conductivity. Throws InputError if it is not said.
template <int Dim> Plane plane_of(const EffectiveSettings<Dim>& settings) {
  if (Dim == 3 || settings.property == EffectiveProperty::conductivity) return Plane::strain;
  const std::optional<Plane> plane = settings.common.model.plane;
  if (!plane || *plane == Plane::axisymmetric)
    throw InputError(
        said_at(settings.common.where, "an effective stiffness in the plane is one of plane strain or stress"));
  return *plane;
}

/// By region of a mesh. Throws InputError for a region without conductivity, and one of a region that is not there.
template <int Dim>
std::vector<double> conductivities_of(const EffectiveSettings<Dim>& settings, const FineMesh<Dim>& mesh) {
  const auto& names = mesh.region_names();
  for (const RegionConductivity& one : settings.conductivities)
    if (!one.region.empty() && std::ranges::find(names, one.region) == names.end())
      throw InputError(said_at(one.where, fmt::format("there is no region \"{}\" in the mesh, which has {}", one.region,
                                                      fmt::join(names, ", "))));
  std::vector<double> by_region;
  for (const std::string& name : names) {
    const auto found = std::ranges::find_if(settings.conductivities, [&](const RegionConductivity& one) {
      return one.region.empty() || one.region == name;
    });
    if (found == settings.conductivities.end())
      throw InputError(said_at(settings.common.where, fmt::format("no conductivity for the region \"{}\"", name)));
    by_region.push_back(found->value);
  }
  return by_region;
}

/// By boundary facet: how far the true surface is outside of it in the mean.
template <int Dim> Vector mean_offsets(const FineMesh<Dim>& mesh, const Matrix& offsets) {
  // Quadratic polynomials by their values at vertices and midpoints.
  Vector weights = Vector::Constant(facet_points<Dim>, Dim == 2 ? 1.0 / 6.0 : 0.0);
  weights.tail(facet_points<Dim> - Dim).setConstant(Dim == 2 ? 2.0 / 3.0 : 1.0 / 3.0);
  return normal_offsets(mesh, offsets).transpose() * weights;
}

/// A mesh and the tensor on it.
struct OnMesh {
  EffectiveLevel level;
  UnitCellTensor found;
};
template <int Dim>
OnMesh solve_on(const EffectiveSettings<Dim>& settings, const PreparedMesh<Dim>& prepared, BasisKind kind) {
  const internal::Stopwatch seconds;
  const FineMesh<Dim>& mesh = *prepared.mesh;
  const Approximation<Dim> elements = approximate(prepared.mesh, {.kind = kind, .dilatation = Dilatation::pointwise});
  const Vector shifts = prepared.offsets.size() > 0 ? mean_offsets(mesh, prepared.offsets) : Vector();
  const UnitCellTensor found =
      settings.property == EffectiveProperty::stiffness
          ? effective_stiffness(elements, Materials<Dim>(prepared.materials, plane_of(settings)), settings.frame,
                                shifts)
          : effective_conductivity(elements, conductivities_of(settings, mesh), settings.frame, shifts);
  return {.level = {.edges = Vec<3>::Constant(internal::mean_edge(mesh)),
                    .cells = mesh.num_cells(),
                    .tensor = found.tensor,
                    .seconds = seconds()},
          .found = found};
}

/// Regions of a unit cell, and the void around them, as parts of the box.
template <int Dim>
std::vector<EffectivePhase> phases_on(const EffectiveSettings<Dim>& settings, const PreparedMesh<Dim>& prepared) {
  const FineMesh<Dim>& mesh = *prepared.mesh;
  const double frame = (mesh.vertices().rowwise().maxCoeff() - mesh.vertices().rowwise().minCoeff()).prod();
  std::vector<double> conductivities(mesh.num_regions(), 0.0);
  if (settings.property == EffectiveProperty::conductivity) conductivities = conductivities_of(settings, mesh);
  std::vector<EffectivePhase> phases;
  for (Index r = 0; r < mesh.num_regions(); ++r)
    phases.push_back({mesh.region_names()[r], 0.0, prepared.materials[r], conductivities[r]});
  double filled = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    phases[mesh.region(c)].fraction += mesh.volume(c) / frame;
    filled += mesh.volume(c) / frame;
  }
  if (filled < 1.0 - 1e-9) phases.push_back({"void", 1.0 - filled});
  return phases;
}

/// The source with cells so many times as large.
template <int Dim> MeshSource<Dim> coarsened(MeshSource<Dim> source, double times) {
  source.size *= times;
  source.coarsening *= times;
  return source;
}

/// Relative error of the finest of three levels where their differences fall faster than facets of curved boundaries
/// (second order) and corners between materials (about first order) allow: by chance, as where cells at a corner happen
/// to be as large as on the coarser mesh. The distance to the coarsest level falls at first order then.
double error_of_irregular_levels(const EffectiveTensor& tensor, const std::function<double(const Matrix&)>& size_of,
                                 const std::function<double(std::size_t, std::size_t)>& coarsening) {
  constexpr double fastest = 2.5;
  const auto& levels = tensor.levels;
  if (levels.size() < 3) return 0.0;
  const auto difference = [&](std::size_t a, std::size_t b) { return size_of(levels[a].tensor - levels[b].tensor); };
  if (difference(0, 1) * std::pow(coarsening(1, 2), fastest) >= difference(1, 2)) return 0.0;
  return difference(0, 2) / coarsening(0, 2) / std::max(size_of(tensor.tensor), 1e-300);
}

}  // namespace

template <int Dim> EffectiveResult find_effective(const EffectiveSettings<Dim>& settings, const MeshSource<Dim>& source,
                                                  const Monitor& monitor_of_run) {
  EffectiveResult result{.dim = Dim, .tensor = {}, .on_mesh = true};
  const Monitor monitor = monitor_of_run.timing(result.times);
  const auto say = [&](const std::string& remark) {
    if (monitor.say) monitor.say(remark);
  };
  CommonSettings<Dim> common = settings.common;
  common.approximation.kind = BasisKind::p2;
  if (settings.property == EffectiveProperty::conductivity) common.model.material = LinearElastic(1.0, 0.0);
  PreparedMesh<Dim> finest = internal::prepare_mesh<Dim>(source, common, nullptr, monitor);
  double factor = 1.0;  // on the natural size
  if (const double excess = static_cast<double>(finest.mesh->num_cells()) / natural_cells<Dim>;
      excess > 1.0 && !source.says_its_size()) {
    factor = std::pow(excess, 1.0 / Dim);
    finest = internal::prepare_mesh<Dim>(coarsened(source, factor), common, nullptr, monitor);
  }
  for (const std::string& remark : finest.remarks) say(remark);
  const double bytes = bytes_of_factor<Dim>(settings.property) * static_cast<double>(finest.mesh->num_cells());
  if (bytes > internal::usable_memory * available_memory())
    throw InputError(said_at(source.where,
                             fmt::format("{} quadratic cells take {:.0f} GB of memory, {:.0f} GB are available: take a "
                                         "larger geometry.mesh_size",
                                         finest.mesh->num_cells(), 1e-9 * bytes, 1e-9 * available_memory())));
  const auto solve_within = [&](const PreparedMesh<Dim>& prepared, BasisKind kind) {
    const Stage stage("solve", monitor);
    return solve_on(settings, prepared, kind);
  };
  const UnitCellTensor found = [&] {
    OnMesh on_finest = solve_within(finest, BasisKind::p2);
    result.tensor.levels.push_back(std::move(on_finest.level));
    return on_finest.found;
  }();
  for (const int axis : found.coupled_axes)
    say(fmt::format("opposite sides along {} have other meshes: periodic by Nitsche's method", "xyz"[axis]));
  for (const double times : {2.0, 4.0}) {
    // The finest mesh was accepted with the same settings: what is wrong with this one is its size.
    const auto leave_out = [&](const std::exception& error) {
      say(fmt::format("no error from a mesh of {} times the size: {}", times, error.what()));
    };
    try {
      const PreparedMesh<Dim> prepared =
          internal::prepare_mesh<Dim>(coarsened(source, factor * times), common, nullptr, monitor);
      result.tensor.levels.push_back(solve_within(prepared, BasisKind::p2).level);
    } catch (const InputError& error) {
      leave_out(error);
    } catch (const NumericalError& error) {
      leave_out(error);
    }
  }
  EffectiveTensor& tensor = result.tensor;
  tensor.tensor = found.tensor;
  tensor.mean = found.mean;
  const auto size_of = [&](const Matrix& one) { return internal::size_of(one, settings.property); };
  const auto coarsening = [&](std::size_t a, std::size_t b) {
    return std::pow(static_cast<double>(tensor.levels[a].cells) / tensor.levels[b].cells, 1.0 / Dim);
  };
  constexpr double of_corners = 0.78;  // four squares of conductivities 1 and 10: 8 / pi atan(1 / sqrt(10))
  estimate_grid_error(tensor, size_of, coarsening, false, of_corners);
  tensor.grid_error = std::max(tensor.grid_error, error_of_irregular_levels(tensor, size_of, coarsening));
  if (coarsening(0, tensor.levels.size() - 1) < 1.6) {  // the file has its mesh
    const Matrix linear = solve_within(finest, BasisKind::p1).level.tensor;
    tensor.grid_error = size_of(linear - tensor.tensor) / std::max(size_of(tensor.tensor), 1e-300);
    result.warnings.emplace_back(
        "the error is the distance from linear elements, as there is no coarser mesh of this geometry; what facets "
        "leave "
        "of curved interfaces between regions is not in it");
  }
  // Where curved walls are finer than the size that was asked for, coarser meshes have the same facets.
  if (found.facet_change.size() > 0)
    tensor.grid_error =
        std::max(tensor.grid_error, size_of(found.facet_change) / std::max(size_of(tensor.tensor), 1e-300));
  const std::vector<EffectivePhase> phases = phases_on(settings, finest);
  for (const EffectivePhase& phase : phases) result.fractions.push_back({phase.region, phase.fraction});
  internal::interpret(settings.property, result);
  internal::find_bounds(settings.property, plane_of(settings), phases, result);
  result.warnings.insert(result.warnings.end(), finest.warnings.begin(), finest.warnings.end());
  if (found.uncovered > not_periodic)
    result.warnings.push_back(fmt::format(
        "the tensor may not be that of a periodic body: on opposite sides of the frame up to {:.2g} % of the "
        "area is material with void opposite, which is free",
        100.0 * found.uncovered));
  if (tensor.grid_error > 0.05)
    result.warnings.push_back(
        fmt::format("the tensor may be {:.0f} % off: take a smaller geometry.mesh_size", 100.0 * tensor.grid_error));
  return result;
}

template EffectiveResult find_effective(const EffectiveSettings<2>&, const MeshSource<2>&, const Monitor&);
template EffectiveResult find_effective(const EffectiveSettings<3>&, const MeshSource<3>&, const Monitor&);

}  // namespace efree
