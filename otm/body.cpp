// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/otm/body.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <numbers>

namespace efree {

template <int Dim>
OtmBody<Dim> otm_body(const FineMesh<Dim>& mesh, SharedMaterial material, double density, bool axisymmetric) {
  if (axisymmetric && (Dim != 2 || mesh.vertices().row(0).minCoeff() < 0.0))
    throw InputError("axisymmetric: expected a mesh in the plane with x, the radius, not negative");
  const Index n = mesh.num_cells();
  OtmBody<Dim> body{.nodes = mesh.vertices(),
                    .velocity = {},
                    .points = Points<Dim>(Dim, n),
                    .volumes = mesh.volumes(),
                    .cells = mesh.cells(),
                    .unions = std::vector<Index>(n),
                    .material = std::move(material),
                    .density = density};
  std::vector<Index> number(mesh.num_vertices(), -1);
  Index unions = 0;
  for (Index c = 0; c < n; ++c) {
    const Vec<Dim> centre = mesh.centroid(c);
    body.points.col(c) = centre;
    if (axisymmetric) body.volumes[c] *= 2.0 * std::numbers::pi * centre[0];
    Index nearest = mesh.cells()(0, c);
    for (int i = 1; i <= Dim; ++i)
      if ((mesh.vertex(mesh.cells()(i, c)) - centre).squaredNorm() < (mesh.vertex(nearest) - centre).squaredNorm())
        nearest = mesh.cells()(i, c);
    if (number[nearest] < 0) number[nearest] = unions++;
    body.unions[c] = number[nearest];
  }
  return body;
}

template OtmBody<2> otm_body(const FineMesh<2>&, SharedMaterial, double, bool);
template OtmBody<3> otm_body(const FineMesh<3>&, SharedMaterial, double, bool);

}  // namespace efree
