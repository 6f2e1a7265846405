// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/body.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <numbers>

namespace efree {

template <int Dim> DeformableBody<Dim> deformable_body(const FineMesh<Dim>& mesh, SharedMaterial material,
                                                       double density, bool axisymmetric) {
  if (axisymmetric && (Dim != 2 || mesh.vertices().row(0).minCoeff() < 0.0))
    throw InputError("axisymmetric: expected a mesh in the plane with x, the radius, not negative");
  const Index n = mesh.num_cells();
  DeformableBody<Dim> body{.nodes = mesh.vertices(),
                           .velocity = {},
                           .points = Points<Dim>(Dim, n),
                           .volumes = mesh.volumes(),
                           .cells = mesh.cells(),
                           .patches = std::vector<Index>(n),
                           .material = std::move(material),
                           .density = density};
  std::vector<Index> number(mesh.num_vertices(), -1);
  Index patches = 0;
  for (Index c = 0; c < n; ++c) {
    const Vec<Dim> centre = mesh.centroid(c);
    body.points.col(c) = centre;
    if (axisymmetric) body.volumes[c] *= 2.0 * std::numbers::pi * centre[0];
    Index nearest = mesh.cells()(0, c);
    for (int i = 1; i <= Dim; ++i)
      if ((mesh.vertex(mesh.cells()(i, c)) - centre).squaredNorm() < (mesh.vertex(nearest) - centre).squaredNorm())
        nearest = mesh.cells()(i, c);
    if (number[nearest] < 0) number[nearest] = patches++;
    body.patches[c] = number[nearest];
  }
  return body;
}

template <int Dim>
DeformableBody<Dim> deformable_body(const Approximation<Dim>& approximation, SharedMaterial material, double density) {
  const FineSpace<Dim>& space = approximation.space;
  const bool elements = approximation.nodes.cols() == space.size();
  if (elements && space.degree() > 1)
    throw InputError("quadratic finite elements: lumped masses of corners are not positive, take linear ones");
  if (approximation.pressures.nonZeros() != approximation.pressures.rows())
    throw InputError("linear pressures on patches: explicit dynamics takes PressureKind::constant");
  DeformableBody<Dim> body{.nodes = approximation.nodes,
                           .velocity = {},
                           .points = approximation.quadrature.points,
                           .volumes = approximation.quadrature.weights,
                           .patches = approximation.patch_of,
                           .material = std::move(material),
                           .density = density,
                           .shape = approximation.quadrature.shape};
  if (elements) return body;
  std::vector<char> outer(space.size());
  for (Index f = 0; f < space.mesh().num_facets(); ++f)
    for (const Index dof : space.facet(f)) outer[dof] = 1;
  std::vector<Offset> offsets{0};
  std::vector<Index> nodes;
  std::vector<double> N;
  for (Index dof = 0; dof < space.size(); ++dof) {
    if (!outer[dof]) continue;
    const ShapeRow<Dim> row = approximation.shape.row(dof);
    nodes.insert(nodes.end(), row.nodes.begin(), row.nodes.end());
    N.insert(N.end(), row.N.begin(), row.N.end());
    offsets.push_back(static_cast<Offset>(N.size()));
  }
  body.surface.emplace(static_cast<Index>(body.nodes.cols()), std::move(offsets), std::move(nodes), std::move(N));
  body.mass_terms = 4;
  return body;
}

template DeformableBody<2> deformable_body(const Approximation<2>&, SharedMaterial, double);
template DeformableBody<3> deformable_body(const Approximation<3>&, SharedMaterial, double);
template DeformableBody<2> deformable_body(const FineMesh<2>&, SharedMaterial, double, bool);
template DeformableBody<3> deformable_body(const FineMesh<3>&, SharedMaterial, double, bool);

}  // namespace efree
