// SPDX-License-Identifier: GPL-3.0-or-later
/// Taylor's bar of copper against a rigid wall (SAND2020-9716, section 4), for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/j2.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace efree::bench {

/// Lengths in metres, the axis is the last one.
struct TaylorBar {
  static constexpr double length = 32.4e-3, radius = 3.2e-3, density = 8930.0;

  static SharedMaterial copper() {
    return J2({.moduli = {.E = 117e9, .nu = 0.35}, .yield = Hardening::linear(400e6, 100e6), .strain = Strain::finite});
  }
  /// OFHC copper (Johnson & Cook 1983).
  static SharedMaterial johnson_cook() { return J2(ofhc_copper()); }
  /// With the pressure that shocks have in it (Marsh 1980).
  static SharedMaterial shocked() {
    return WithPressure(J2(ofhc_copper()), EquationOfState::mie_grueneisen({density, 3940.0, 1.489, 1.96}));
  }
  static J2Parameters ofhc_copper() {
    return {.moduli = {.E = 124e9, .nu = 0.34},
            .yield = Hardening::ludwik(90e6, 292e6, 0.31),
            .strain = Strain::finite,
            .rate = RateFactor::johnson_cook(0.025, 1.0),
            .heating = Heating{.capacity = 8960.0 * 383.0, .melting = 1356.0, .reference = 298.0, .exponent = 1.09}};
  }
  /// Half of the meridian section (Dim = 2) or all of the bar, with nodes `size` apart.
  template <int Dim> static FineMesh<Dim> mesh(double size) {
    if constexpr (Dim == 2)
      return triangulate(shapes::rectangle(0.0, 0.0, radius, length), {.size = size});
    else
      return FineMesh<3>(solids::cylinder(radius, length, size));
  }
  /// The quarter of the bar between x = 0 and y = 0: a lattice, squares in the section bent to the quarter of a disc,
  /// cubes in six tetrahedra each (Kuhn 1960).
  static FineMesh<3> quarter(double size) {
    const auto n = static_cast<Index>(std::ceil(radius / size)), layers = static_cast<Index>(std::ceil(length / size));
    const auto vertex = [n](Index i, Index j, Index k) { return i + (n + 1) * (j + (n + 1) * k); };
    MeshData<3> mesh;
    mesh.vertices.resize(3, vertex(0, 0, layers + 1));
    for (Index k = 0; k <= layers; ++k)
      for (Index j = 0; j <= n; ++j)
        for (Index i = 0; i <= n; ++i) {
          const double u = static_cast<double>(i) / n, w = static_cast<double>(j) / n;
          mesh.vertices.col(vertex(i, j, k)) =
              Vec<3>(radius * u * std::sqrt(1.0 - 0.5 * w * w), radius * w * std::sqrt(1.0 - 0.5 * u * u),
                     length * static_cast<double>(k) / layers);
        }
    mesh.cells.resize(4, 6 * n * n * layers);
    Index cell = 0;
    for (Index k = 0; k < layers; ++k)
      for (Index j = 0; j < n; ++j)
        for (Index i = 0; i < n; ++i) {
          std::array<int, 3> axes{0, 1, 2};
          do {
            std::array<Index, 3> at{i, j, k};
            std::array<Index, 4> corners{vertex(i, j, k)};
            for (int step = 0; step < 3; ++step) {
              ++at[axes[step]];
              corners[step + 1] = vertex(at[0], at[1], at[2]);
            }
            // Every other path winds the other way.
            const bool even = (axes[1] - axes[0] + 3) % 3 == 1;
            if (!even) std::swap(corners[2], corners[3]);
            for (int corner = 0; corner < 4; ++corner) mesh.cells(corner, cell) = corners[corner];
            ++cell;
          } while (std::ranges::next_permutation(axes).found);
        }
    return FineMesh<3>(mesh);
  }
  template <int Dim> static Dynamics<Dim> bar(const FineMesh<Dim>& mesh, double speed, const OtmOptions& scheme,
                                              DynamicsOptions options = {}, bool shared_dilatation = true,
                                              const SharedMaterial& material = copper(), bool is_quarter = false) {
    options.plane = Dim == 2 ? Plane::axisymmetric : Plane::strain;
    DeformableBody<Dim> body = deformable_body(mesh, material, density, Dim == 2);
    body.velocity.setZero(Dim, body.nodes.cols());
    body.velocity.row(Dim - 1).setConstant(-speed);
    if (!shared_dilatation) body.patches.clear();
    Dynamics<Dim> dynamics({body}, otm<Dim>(scheme), options);
    dynamics.add_wall({.normal = Vec<Dim>::Unit(Dim - 1)});
    for (int axis = 0; axis < (Dim == 2 ? 1 : is_quarter ? 2 : 0); ++axis)
      for (Index a = 0; a < body.nodes.cols(); ++a)
        if (body.nodes(axis, a) < 1e-9) dynamics.prescribe(a, axis, 0.0);
    return dynamics;
  }

  struct Shape {
    double length, foot, plastic_strain;
  };
  /// Of nodes; the foot is what is within 1 % of the length above the wall.
  template <int Dim> static Shape shape(const Dynamics<Dim>& dynamics) {
    const Points<Dim>& x = dynamics.nodes();
    Shape result{x.row(Dim - 1).maxCoeff(), 0.0, dynamics.history(0).row(6).maxCoeff()};
    for (Index a = 0; a < x.cols(); ++a)
      if (x(Dim - 1, a) < 0.01 * length) result.foot = std::max(result.foot, x.col(a).template head<Dim - 1>().norm());
    return result;
  }
};

}  // namespace efree::bench
