// SPDX-License-Identifier: GPL-3.0-or-later
/// A steel sphere through an aluminium plate, for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/j2.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace efree::bench {

/// SI units. The axis is the last one, along which the sphere flies down; the plate's rim is held.
struct Perforation {
  static constexpr double radius = 5e-3, thickness = 5e-3, rim = 20e-3;

  /// 4340 steel (Johnson & Cook 1983, 1985).
  static SharedMaterial steel() {
    return J2(
        {.moduli = {.E = 200e9, .nu = 0.29},
         .yield = Hardening::ludwik(792e6, 510e6, 0.26),
         .strain = Strain::finite,
         .rate = RateFactor::johnson_cook(0.014, 1.0),
         .heating = Heating{.capacity = 7830.0 * 477.0, .melting = 1793.0, .reference = 293.0, .exponent = 1.03}});
  }
  /// 2024-T351 aluminium (Johnson & Cook 1983; Johnson & Holmquist 1989 for its failure).
  static SharedMaterial aluminium() {
    return J2({.moduli = {.E = 73e9, .nu = 0.33},
               .yield = Hardening::ludwik(265e6, 426e6, 0.34),
               .strain = Strain::finite,
               .rate = RateFactor::johnson_cook(0.015, 1.0),
               .heating = Heating{.capacity = 2770.0 * 875.0, .melting = 775.0, .reference = 293.0, .exponent = 1.0}});
  }
  /// Both ways to break: eigenerosion with the toughness of 37 MPa m^(1/2), and strain.
  static FractureCriteria fracture() {
    return {.toughness = 37e6 * 37e6 * (1.0 - 0.33 * 0.33) / 73e9,
            .strain = JohnsonCookFailure{.D = {0.13, 0.13, -1.5, 0.011, 0.0}, .melting = 482.0}};
  }

  /// Half of the meridian section (Dim = 2), or a quarter in space; edges of at most `size`.
  template <int Dim> static FineMesh<Dim> sphere(double size) {
    constexpr double pi = std::numbers::pi, centre = thickness + 1.02 * radius;
    if constexpr (Dim == 2) {
      Polyline outline{.name = "sphere", .points = {}};
      const int sides = std::max(8, static_cast<int>(std::ceil(pi * radius / size)));
      for (int k = 0; k <= sides; ++k) {
        const double angle = pi * (static_cast<double>(k) / sides - 0.5);
        outline.points.push_back({k % sides == 0 ? 0.0 : radius * std::cos(angle), centre + radius * std::sin(angle)});
      }
      outline.points.push_back(outline.points.front());
      PlanarDomain half;
      half.boundary.push_back(outline);
      return triangulate(half, {.size = size});
    } else {
      // With its mirror image; hollow in the middle, 1.6 % of its volume.
      const MeshData<3> eighth = solids::thick_sphere(0.25 * radius, radius, size);
      const auto n = static_cast<Index>(eighth.vertices.cols());
      std::vector<Index> image(static_cast<std::size_t>(n));
      Index next = n;
      for (Index a = 0; a < n; ++a) image[a] = eighth.vertices(2, a) < 1e-9 ? a : next++;
      MeshData<3> mesh;
      mesh.vertices.resize(3, next);
      mesh.cells.resize(4, 2 * eighth.cells.cols());
      for (Index a = 0; a < n; ++a) {
        const Vec<3> at = eighth.vertices.col(a);
        mesh.vertices.col(a) << at[0], at[1], centre + at[2];
        mesh.vertices.col(image[a]) << at[0], at[1], centre - at[2];
      }
      mesh.cells.leftCols(eighth.cells.cols()) = eighth.cells;
      for (Eigen::Index c = 0; c < eighth.cells.cols(); ++c)
        for (int i = 0; i < 4; ++i) mesh.cells(i, eighth.cells.cols() + c) = image[eighth.cells(i, c)];
      return FineMesh<3>(std::move(mesh));
    }
  }
  template <int Dim> static FineMesh<Dim> plate(double size) {
    if constexpr (Dim == 2)
      return triangulate(shapes::rectangle(0.0, 0.0, rim, thickness), {.size = size});
    else
      return FineMesh<3>(solids::box({rim, rim, thickness}, size));
  }

  /// `held`: the plate's rim, which else is free.
  template <int Dim>
  static Dynamics<Dim> bodies(double size, double speed, bool held, const FractureCriteria& broken_by) {
    std::vector<DeformableBody<Dim>> bodies{deformable_body(sphere<Dim>(size), steel(), 7830.0, Dim == 2),
                                            deformable_body(plate<Dim>(size), aluminium(), 2770.0, Dim == 2)};
    bodies[0].velocity.setZero(Dim, bodies[0].nodes.cols());
    bodies[0].velocity.row(Dim - 1).setConstant(-speed);
    bodies[0].fracture.strain = JohnsonCookFailure{.D = {0.05, 3.44, -2.12, 0.002, 0.61}, .melting = 1500.0};
    bodies[1].fracture = broken_by;
    DynamicsOptions options;
    options.plane = Dim == 2 ? Plane::axisymmetric : Plane::strain;
    options.shock = {.linear = 0.06, .quadratic = 1.5};
    Dynamics<Dim> dynamics(bodies, otm<Dim>(), options);
    for (Index a = 0; a < dynamics.num_nodes(); ++a) {
      const Vec<Dim> at = dynamics.nodes().col(a);
      const bool on_rim = a >= dynamics.first_node(1) && at.template head<Dim - 1>().maxCoeff() > rim - 1e-9;
      for (int i = 0; i < Dim; ++i)
        if ((i < Dim - 1 && at[i] < 1e-9) || (held && on_rim)) dynamics.prescribe(a, i, 0.0);
    }
    return dynamics;
  }

  struct End {
    double speed = 0.0;                             ///< of the sphere, downwards
    bool through = false;                           ///< it has left the plate behind
    double error = 0.0;                             ///< of energy, over that at the start
    double mass_error = 0.0, momentum_error = 0.0;  ///< over those at the start; momentum along the axis
  };
  template <int Dim> static double sphere_speed(const Dynamics<Dim>& dynamics) {
    double momentum = 0.0, mass = 0.0;
    const Points<Dim> v = dynamics.velocities();
    for (Index a = 0; a < dynamics.first_node(1); ++a) {
      momentum -= dynamics.masses()[a] * v(Dim - 1, a);
      mass += dynamics.masses()[a];
    }
    return momentum / mass;
  }
  /// Runs until the sphere is through, has been stopped, or that time.
  template <int Dim> static End run(Dynamics<Dim>& dynamics, double until = 200e-6) {
    const auto before = dynamics.balance();
    const double mass = dynamics.masses().sum();
    End end;
    while (dynamics.time() < until) {
      for (int k = 0; k < 20; ++k) dynamics.step();
      end.speed = sphere_speed(dynamics);
      end.through = dynamics.nodes().row(Dim - 1).head(dynamics.first_node(1)).maxCoeff() < -0.2 * radius;
      if (end.through || end.speed <= 0.0) break;
    }
    const auto after = dynamics.balance();
    end.error = after.total() / before.total() - 1.0;
    end.mass_error = dynamics.masses().sum() / mass - 1.0;
    end.momentum_error = after.momentum[Dim - 1] / before.momentum[Dim - 1] - 1.0;
    return end;
  }
};

}  // namespace efree::bench
