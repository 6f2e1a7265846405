// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/facet_errors.hpp"

#include "efree/analysis/internal/corrected.hpp"
#include "efree/assembly/internal/boundary_points.hpp"
#include "efree/geometry/mesh/walls.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree::internal {
namespace {

/// A polygonal wall under a membrane force N has bending moments of N times the distance of its middle from the true
/// one: stresses of 6 M / t^2, against N / t. By how many relative sagittas stresses are off, measured on a thin tube
/// (bench_facets walls): 1.7 to 2.9.
constexpr double bending = 3.0;

/// Largest relative sagitta at which the first-order correction is used (OnSurface; docs/evidence.md).
constexpr double most_relative_sagitta = 0.05;

/// What springs at the boundary store.
template <int Dim> double energy_of_springs(const FineSpace<Dim>& space,
                                            const std::vector<DisplacementCondition<Dim>>& supports,
                                            const Points<Dim>& displacement) {
  double energy = 0.0;
  for (const Restraint<Dim>& spring : restraints(supports)) {
    if (!spring.is_elastic()) continue;
    for_each_point<Dim>(space, space.mesh().group(spring.on), [&](const BoundaryPoint<Dim>& point) {
      Vec<Dim> u = Vec<Dim>::Zero();
      for (std::size_t i = 0; i < point.dofs.size(); ++i)
        u += point.N[static_cast<Index>(i)] * displacement.col(point.dofs[i]);
      const double stretch = spring.direction(point.n).dot(u) - spring.value(point.x);
      energy += 0.5 * point.weight * spring.stiffness(point.x) * stretch * stretch;
    });
  }
  return energy;
}

/// Change of the strain energy where that of the potential energy is `change`: the opposite where loads act, the same
/// where displacements are prescribed. Unknown where both are, and where springs take a part of it.
template <int Dim>
std::optional<double> change_of_strain_energy(const FineSpace<Dim>& space,
                                              const std::vector<DisplacementCondition<Dim>>& supports,
                                              const Loads<Dim>& loads, double change) {
  bool is_moved = false;
  for (const Restraint<Dim>& held : restraints(supports)) {
    if (held.is_elastic()) return std::nullopt;
    for_each_point<Dim>(space, space.mesh().group(held.on),
                        [&](const BoundaryPoint<Dim>& point) { is_moved = is_moved || held.value(point.x) != 0.0; });
  }
  if (!is_moved) return -change;
  return loads.any() ? std::nullopt : std::optional(change);
}

/// By facet: the largest difference between the offsets of its midpoints and the means of those of the ends [length]:
/// what it lacks of the surface's curvature, wherever it lies.
template <int Dim> Vector bulges(const FineMesh<Dim>& mesh, const Matrix& offsets) {
  const Matrix heights = normal_offsets(mesh, offsets);
  Vector most(mesh.num_facets());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    double bulge = 0.0;
    int middle = Dim;
    for (int i = 0; i < Dim; ++i)
      for (int j = i + 1; j < Dim; ++j)
        bulge = std::max(bulge, std::abs(heights(middle++, f) - 0.5 * (heights(i, f) + heights(j, f))));
    most[f] = bulge;
  }
  return most;
}

/// By facet: sagitta over the thickness of the wall, or over the radius of curvature if that is less.
template <int Dim> Vector relative_sagittas(const FineMesh<Dim>& mesh, const Matrix& offsets, const Vector& thickness) {
  Vector relative = Vector::Zero(mesh.num_facets());
  const Vector heights = sagittas(mesh, offsets), bulge = bulges(mesh, offsets);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    if (heights[f] == 0.0) continue;
    double longest = 0.0;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < i; ++j)
        longest =
            std::max(longest, (mesh.vertex(mesh.facets()(i, f)) - mesh.vertex(mesh.facets()(j, f))).squaredNorm());
    const double radius = bulge[f] > 0.0 ? longest / (8.0 * bulge[f]) : std::numeric_limits<double>::infinity();
    relative[f] = heights[f] / std::min(thickness[f], radius);
  }
  return relative;
}

/// The largest of them on facets that cells around a place touch.
template <int Dim> double around(const FineSpace<Dim>& space, Index place, const Vector& relative) {
  const FineMesh<Dim>& mesh = space.mesh();
  double most = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto places = space.places(c);
    if (std::ranges::find(places, place) == places.end()) continue;
    for (int i = 0; i <= Dim; ++i)
      for (const Index f : mesh.facets_of(mesh.cells()(i, c))) most = std::max(most, relative[f]);
  }
  return most;
}

/// Warns where bending of the facets makes stresses that are not those of the wall.
template <int Dim> void warn_of_walls(const FineMesh<Dim>& mesh, const Vector& relative, const Vector& thickness,
                                      const Vector& heights, Result<Dim>& result) {
  constexpr double bearable = 0.25;
  Index worst = -1;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    if (heights[f] > 0.0 && std::isfinite(thickness[f]) && heights[f] >= 0.99 * relative[f] * thickness[f] &&
        (worst < 0 || relative[f] > relative[worst]))
      worst = f;
  if (worst < 0 || bending * relative[worst] < bearable) return;
  Vec<Dim> at = Vec<Dim>::Zero();
  for (int k = 0; k < Dim; ++k) at += mesh.vertex(mesh.facets()(k, worst)) / Dim;
  result.warnings.push_back(fmt::format(
      "stresses in the wall around ({:.4g}) may be {:.2g} % off: it is {:.3g} thick, and the facets of its curved "
      "surface lie up to {:.2g} from that; use a smaller mesh_size",
      fmt::join(at, ", "), 100.0 * bending * relative[worst], thickness[worst], heights[worst]));
}

}  // namespace

template <int Dim>
std::optional<ShapeDerivative<Dim>> shape_derivative(const Settings<Dim>& settings, const Result<Dim>& result,
                                                     const FineSpace<Dim>& space, const Materials<Dim>& materials) {
  if (result.offsets.size() == 0) return {};
  ShapeDerivative<Dim> derivative(space, result.offsets, materials, settings.supports,
                                  tied_facets(*result.mesh, result.model.open_interface));
  if (derivative.is_flat()) return {};
  return derivative;
}

template <int Dim> double largest_relative_sagitta(const FineMesh<Dim>& mesh, const Matrix& offsets) {
  return relative_sagittas(mesh, offsets, wall_thickness(mesh)).maxCoeff();
}

template <int Dim> void add_facet_errors(const Settings<Dim>& settings, Result<Dim>& result) {
  if (!result.estimates || !result.history.empty()) return;
  const FineSpace<Dim>& space = result.basis().space;
  const auto materials = materials_of(result.model, *result.mesh);
  const auto derivative = shape_derivative(settings, result, space, materials);
  if (!derivative) return;
  const auto answers = answers_in(result);
  const auto loads = loads_of(settings, 0, answers.size());
  const Vector thickness = wall_thickness(*result.mesh),
               relative = relative_sagittas(*result.mesh, result.offsets, thickness);
  const bool is_near = relative.maxCoeff() <= most_relative_sagitta;
  for (std::size_t k = 0; k < answers.size(); ++k) {
    Answer<Dim>& answer = *answers[k];
    if (!is_near) answer.on_surface.reset();
    if (!answer.estimates || answer.fields.displacement.cols() != space.size()) continue;
    const ShapeChange change = derivative->potential_energy(answer.fields.displacement, loads[k]);
    // Soft springs store more than the body.
    const double energy =
        answer.solution.strain_energy + energy_of_springs(space, settings.supports, answer.fields.displacement);
    if (energy > 0.0) answer.estimates->geometry = std::sqrt(change.size() / energy);
    if (is_near) {
      if (!answer.on_surface) answer.on_surface.emplace();
      const double on_facets = answer.solution.strain_energy,
                   of_cells = std::hypot(answer.estimates->cloud, answer.estimates->mesh);
      if (const auto more = change_of_strain_energy(space, settings.supports, loads[k], change.sum))
        answer.on_surface->strain_energy = {
            on_facets + *more, std::hypot(of_cells * of_cells * on_facets, left_by_first_order * change.size())};
    }
    for (Extreme<Dim>& extreme : answer.extremes)
      if (extreme.of == "von_mises" && extreme.error)
        *extreme.error += std::min(1.0, bending * around(space, extreme.place, relative)) * extreme.value;
  }
  warn_of_walls(*result.mesh, relative, thickness, sagittas(*result.mesh, result.offsets), result);
}

template std::optional<ShapeDerivative<2>> shape_derivative<2>(const Settings<2>&, const Result<2>&,
                                                               const FineSpace<2>&, const Materials<2>&);
template std::optional<ShapeDerivative<3>> shape_derivative<3>(const Settings<3>&, const Result<3>&,
                                                               const FineSpace<3>&, const Materials<3>&);
template double largest_relative_sagitta<2>(const FineMesh<2>&, const Matrix&);
template double largest_relative_sagitta<3>(const FineMesh<3>&, const Matrix&);
template void add_facet_errors<2>(const Settings<2>&, Result<2>&);
template void add_facet_errors<3>(const Settings<3>&, Result<3>&);

}  // namespace efree::internal
