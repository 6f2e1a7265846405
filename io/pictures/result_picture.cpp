// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of results.
#include "efree/analysis/point_field.hpp"
#include "efree/analysis/utilisation.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/pictures/internal/body_picture.hpp"
#include "efree/io/pictures/picture.hpp"

#include <algorithm>
#include <array>
#include <numbers>
#include <set>
#include <string>
#include <vector>

namespace efree {
namespace {

using namespace internal::drawing;
/// Boundary facet f as triangles (lines in 2D) between places, in 3D facing outwards.
template <int Dim> auto facet_pieces(const FineSpace<Dim>& space, Index f) {
  using Piece = std::conditional_t<Dim == 3, Triangle, Segment>;
  std::vector<Index> dofs = space.facet(f);
  for (Index& dof : dofs) dof = space.place(dof, space.mesh().region(space.mesh().facet_cell(f)));
  if constexpr (Dim == 2) {
    if (space.degree() == 1) return std::vector<Piece>{{dofs[0], dofs[1]}};
    return std::vector<Piece>{{dofs[0], dofs[2]}, {dofs[2], dofs[1]}};
  } else {
    if (space.degree() == 1) return std::vector<Piece>{{dofs[0], dofs[1], dofs[2]}};
    const auto at = [&](Index place) { return space.points().col(space.dof_at(place)); };
    const auto between = [&](Index a, Index b) {
      const Vec3 middle = 0.5 * (at(a) + at(b));
      return *std::min_element(dofs.begin() + 3, dofs.end(), [&](Index m, Index n) {
        return (at(m) - middle).squaredNorm() < (at(n) - middle).squaredNorm();
      });
    };
    const Index ab = between(dofs[0], dofs[1]), bc = between(dofs[1], dofs[2]), ca = between(dofs[2], dofs[0]);
    return std::vector<Piece>{{dofs[0], ab, ca}, {ab, dofs[1], bc}, {ca, bc, dofs[2]}, {ab, bc, ca}};
  }
}

/// What to draw of the body: its skin, in 2D all of it.
template <int Dim> std::vector<Triangle> faces(const FineSpace<Dim>& space) {
  std::vector<Triangle> out;
  if constexpr (Dim == 3) {
    for (Index f = 0; f < space.mesh().num_facets(); ++f)
      for (const Triangle& t : facet_pieces(space, f)) out.push_back(t);
  } else {
    for (Index c = 0; c < space.mesh().num_cells(); ++c) {
      const auto d = space.places(c);
      if (space.degree() == 1)
        out.push_back({d[0], d[1], d[2]});
      else  // midpoints of edges (0, 1), (0, 2), (1, 2)
        out.insert(out.end(), {{d[0], d[3], d[4]}, {d[3], d[1], d[5]}, {d[4], d[5], d[2]}, {d[3], d[5], d[4]}});
    }
  }
  return out;
}

/// Pieces of the boundary where conditions hold.
template <int Dim, class Conditions> auto where(const FineSpace<Dim>& space, const Conditions& conditions) {
  std::set<Index> facets;
  for (const auto& condition : conditions)
    for (const Index f : space.mesh().group(condition.on)) facets.insert(f);
  decltype(facet_pieces(space, 0)) out;
  for (const Index f : facets)
    for (const auto& piece : facet_pieces(space, f)) out.push_back(piece);
  return out;
}

/// Means of the cells around each place, by volume.
template <int Dim> Vector means_at_places(const FineSpace<Dim>& space, const Vector& by_cell) {
  Vector values = Vector::Zero(space.num_places()), volumes = values;
  for (Index c = 0; c < space.mesh().num_cells(); ++c)
    for (const Index p : space.places(c)) values[p] += space.volume(c) * by_cell[c], volumes[p] += space.volume(c);
  return values.cwiseQuotient(volumes);
}

/// Values of a field at the places of the space.
template <int Dim> Vector values_at_places(const PictureOptions& options, const Settings<Dim>& settings,
                                           const Result<Dim>& result, const Fields<Dim>& fields) {
  const FineSpace<Dim>& space = result.basis().space;
  const auto at_points = PointField<Dim>::find(options.field, settings.common.model.plane == Plane::axisymmetric);
  if (at_points) {
    const auto displacement = space.at_places(fields.displacement);
    Vector values(space.num_places());
    parallel_for(space.num_places(), [&](Index p) {
      values[p] = (*at_points)(displacement.col(p), fields.strain.col(p), fields.stress.col(p));
    });
    return values;
  }
  if (options.field == "error" && result.error_density.size() > 0) return means_at_places(space, result.error_density);
  if (options.field == "utilisation") return utilisation_at_places(settings.common, space, fields);
  for (const auto& [name, values] : result.remembered)
    if (name == options.field && values.rows() == 1) return values.row(0).transpose();
  return {};
}

/// Facets of parts of the boundary with the places next to their middles.
template <int Dim> std::vector<LoadedFacet<Dim>> loaded_facets(const FineSpace<Dim>& space, const std::string& part) {
  const FineMesh<Dim>& mesh = space.mesh();
  std::vector<LoadedFacet<Dim>> facets;
  for (const Index f : mesh.group(part)) {
    Vec<Dim> middle = Vec<Dim>::Zero();
    for (int k = 0; k < Dim; ++k) middle += mesh.vertices().col(mesh.facets()(k, f)) / Dim;
    const double turn = space.axisymmetric() ? 2.0 * std::numbers::pi * middle[0] : 1.0;
    facets.push_back({middle, mesh.facet_normal(f), turn * mesh.facet_measure(f),
                      space.place(space.facet(f).front(), mesh.region(mesh.facet_cell(f)))});
  }
  return facets;
}

}  // namespace

template <int Dim> bool draw_result(const std::filesystem::path& file, const PictureOptions& options,
                                    const Settings<Dim>& settings, const Result<Dim>& result) {
  const FineSpace<Dim>& space = result.basis().space;
  const std::size_t number = case_number(options, settings);
  const Fields<Dim>& fields = number == 0 ? result.fields : result.more[number - 1].fields;
  BodyPicture<Dim> body{.undeformed = {in_space<Dim>(space.at_places(space.points())), faces(space)},
                        .displacement = in_space<Dim>(space.at_places(fields.displacement)),
                        .values = values_at_places(options, settings, result, fields),
                        .held = where(space, settings.supports)};
  if (body.values.size() == 0) return false;
  const Loads<Dim> loads = loads_by_case(settings)[number];
  body.loaded = where(space, loads.tractions);
  for (const auto& of : {where(space, loads.followers), where(space, loads.resultants)})
    body.loaded.insert(body.loaded.end(), of.begin(), of.end());
  body.arrows = load_arrows<Dim>(
      loads, [&](const std::string& part) { return loaded_facets(space, part); }, arrow_gap(body.undeformed));
  if constexpr (Dim == 2)
    for (Index f = 0; f < space.mesh().num_facets(); ++f)
      for (const Segment& segment : facet_pieces(space, f)) body.rim.push_back(segment);
  body.true_to_scale = !result.history.empty();  // large displacements as they are
  draw_body(file, body, options, title_of(options, settings));
  return true;
}

template bool draw_result<2>(const std::filesystem::path&, const PictureOptions&, const Settings<2>&, const Result<2>&);
template bool draw_result<3>(const std::filesystem::path&, const PictureOptions&, const Settings<3>&, const Result<3>&);

}  // namespace efree
