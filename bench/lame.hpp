// SPDX-License-Identifier: GPL-3.0-or-later
/// Thick-walled cylinder and sphere under internal pressure (Lame 1852), as sections and as solids; tests and the study
/// share them.
#pragma once

#include "efree/geometry/cloud/spacing.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <cmath>
#include <numbers>

namespace efree::bench {

/// Unit pressure inside, nothing outside. The ends of the cylinder do not move along the axis.
struct ThickWall {
  static constexpr double inner = 1.0, outer = 2.0;

  bool sphere;
  IsotropicModuli material{1.0, 0.3};

  /// Displacement outwards and stresses (radial, hoop, along the axis of the cylinder) at the radius r.
  struct State {
    double u, radial, hoop, axial;
  };
  State at(double r) const {
    const auto [E, nu] = material;
    const double power = sphere ? 3.0 : 2.0;
    const double mean = std::pow(inner, power) / (std::pow(outer, power) - std::pow(inner, power));
    const double decay = std::pow(outer / r, power);
    if (sphere)
      return {mean / E * r * (1.0 - 2.0 * nu + 0.5 * (1.0 + nu) * decay), mean * (1.0 - decay),
              mean * (1.0 + 0.5 * decay), 0.0};
    return {(1.0 + nu) * mean / E * r * (1.0 - 2.0 * nu + decay), mean * (1.0 - decay), mean * (1.0 + decay),
            2.0 * nu * mean};
  }

  /// Half of a meridian section: of a slice of the cylinder, or of the upper half of the sphere.
  PlanarDomain section(double height, double size) const {
    if (!sphere)
      return {.boundary = {{"bottom", {{inner, 0.0}, {outer, 0.0}}},
                           {"outer", {{outer, 0.0}, {outer, height}}},
                           {"top", {{outer, height}, {inner, height}}},
                           {"inner", {{inner, height}, {inner, 0.0}}}}};
    const auto arc = [&](double radius, double from, double to) {
      const int chords = static_cast<int>(std::ceil(radius * std::numbers::pi / 2.0 / size));
      std::vector<Vec<2>> points;
      for (int i = 0; i <= chords; ++i) {
        const double t = from + (to - from) * i / chords;
        points.push_back(t == 0.0   ? Vec<2>(radius, 0.0)
                         : t == 1.0 ? Vec<2>(0.0, radius)
                                    : Vec<2>(radius * std::cos(t * std::numbers::pi / 2.0),
                                             radius * std::sin(t * std::numbers::pi / 2.0)));
      }
      return points;
    };
    return {.boundary = {{"bottom", {{inner, 0.0}, {outer, 0.0}}},
                         {"outer", arc(outer, 0.0, 1.0)},
                         {"axis", {{0.0, outer}, {0.0, inner}}},
                         {"inner", arc(inner, 1.0, 0.0)}}};
  }
  /// A quarter of the slice, or an eighth of the sphere. size_at_inner > 0: the size at the inner wall.
  MeshData<3> solid(double height, double size, double size_at_inner = 0.0) const {
    return sphere ? solids::thick_sphere(inner, outer, size, size_at_inner)
                  : solids::thick_cylinder(inner, outer, height, size, size_at_inner);
  }

  /// Fine mesh of the section (with `size_at_inner` everywhere, for triangulate has one size) or of the solid.
  template <int Dim> FineMesh<Dim> mesh(double height, double size, double size_at_inner) const {
    if constexpr (Dim == 2)
      return triangulate(section(height, size_at_inner), {.size = size_at_inner});
    else
      return FineMesh<3>(solid(height, size, size_at_inner));
  }

  /// Spacings of a cloud with so many nodes through the wall of thickness 1: H(x) = at_inner + growth x, x from the
  /// inner wall, with int_0^1 dx / H(x) = through - 1. growth 0: equal ones.
  struct Spacing {
    double at_inner, at_outer;
    Grading grading;
  };
  static Spacing spacing(int through, double growth) {
    static_assert(outer - inner == 1.0);
    if (growth == 0.0) return {1.0 / (through - 1), 1.0 / (through - 1), {}};
    const double at_inner = growth / std::expm1(growth * (through - 1));
    return {at_inner, at_inner + growth, {.growth = growth, .boundaries = {{"inner", at_inner}}}};
  }

  template <int Dim>
  ElasticSolver<Dim> solver(const Approximation<Dim>& approximation, Essential essential = Essential::nitsche) const {
    std::vector<DisplacementCondition<Dim>> planes{symmetry_plane<Dim>("bottom")};
    if (!sphere) planes.push_back(symmetry_plane<Dim>("top"));
    if (Dim == 3) planes.push_back(symmetry_plane<Dim>("left")), planes.push_back(symmetry_plane<Dim>("front"));
    return ElasticSolver<Dim>(approximation,
                              {.material = LinearElastic(material),
                               .plane = Dim == 2 ? Plane::axisymmetric : Plane::strain,
                               .essential = essential},
                              planes);
  }
  template <int Dim> Loads<Dim> loads() const {
    return {.tractions = {pressure<Dim>("inner", [](const Vec<Dim>&) { return 1.0; })}, .body_force = {}};
  }

  /// Distance from the centre of the sphere or from the axis (y in a section, z in space), and the unit vector
  /// outwards.
  template <int Dim> std::pair<double, Vec<Dim>> outwards(const Vec<Dim>& x) const {
    Vec<Dim> n = x;
    if (!sphere) n[Dim - 1] = 0.0;
    const double r = n.norm();
    return {r, n / r};
  }
  template <int Dim> Vec<Dim> displacement(const Vec<Dim>& x) const {
    const auto [r, n] = outwards<Dim>(x);
    return at(r).u * n;
  }
  template <int Dim> Voigt<Dim> stress(const Vec<Dim>& x) const {
    const auto [r, n] = outwards<Dim>(x);
    const State s = at(r);
    Mat<Dim> tensor = s.hoop * Mat<Dim>::Identity() + (s.radial - s.hoop) * n * n.transpose();
    if (!sphere) tensor(Dim - 1, Dim - 1) = s.axial;
    if constexpr (Dim == 2)
      return {tensor(0, 0), tensor(1, 1), s.hoop, tensor(0, 1)};
    else
      return Voigt<3>{{tensor(0, 0), tensor(1, 1), tensor(2, 2), tensor(1, 2), tensor(0, 2), tensor(0, 1)}};
  }

  /// Relative errors at the inner wall, of the mean over its surface and the largest at any vertex; and over the body.
  struct WallErrors {
    struct Pair {
      double mean = 0.0, worst = 0.0;
    };
    Pair displacement;  ///< outwards
    Pair hoop;          ///< recovered hoop stress
    Errors body;
  };
  template <int Dim> WallErrors errors(const Approximation<Dim>& approximation, const Solution<Dim>& solution) const {
    const auto& mesh = approximation.space.mesh();
    const Fields<Dim> fields = recover_fields(approximation, solution);
    WallErrors result;
    double area = 0.0;
    const auto add = [](WallErrors::Pair& pair, double error, double share) {
      pair.mean += share * error;
      pair.worst = std::max(pair.worst, std::abs(error));
    };
    for (const Index f : mesh.group("inner"))
      for (int k = 0; k < Dim; ++k) {
        const Index v = mesh.facets()(k, f);
        const auto [r, n] = outwards<Dim>(mesh.vertex(v));
        const State exact = at(r);
        const double share = mesh.facet_measure(f) * approximation.space.measure(mesh.vertex(v));
        area += share;
        add(result.displacement, Vec<Dim>(fields.displacement.col(v)).dot(n) / exact.u - 1.0, share);
        add(result.hoop, hoop_stress<Dim>(fields.stress.col(v), mesh.vertex(v)) / exact.hoop - 1.0, share);
      }
    result.displacement.mean = std::abs(result.displacement.mean) / area;
    result.hoop.mean = std::abs(result.hoop.mean) / area;
    result.body =
        errors_against<Dim>(approximation, fields, Materials<Dim>({LinearElastic(material)}, Plane::axisymmetric),
                            {[this](const Vec<Dim>& x) { return displacement<Dim>(x); },
                             [this](const Vec<Dim>& x) { return stress<Dim>(x); }});
    return result;
  }

 private:
  /// Along the circle around the axis.
  template <int Dim> static double hoop_stress(const Voigt<Dim>& s, const Vec<Dim>& x) {
    if constexpr (Dim == 2) {
      return s[2];
    } else {
      const double r = std::hypot(x[0], x[1]);
      if (r < 1e-12) return s[0];
      const double c = x[0] / r, t = x[1] / r;
      return t * t * s[0] + c * c * s[1] - 2.0 * t * c * s[5];
    }
  }
};

}  // namespace efree::bench
