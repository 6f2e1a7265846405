// SPDX-License-Identifier: GPL-3.0-or-later
/// Plastic bodies whose answers are known: thick sphere, thick tube and bent bar. Tests and the study share them.
#pragma once

#include "efree/analysis/analyse.hpp"
#include "efree/bench/lame.hpp"
#include "efree/materials/j2.hpp"

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace efree::bench {

/// A metal, perfectly plastic unless it hardens kinematically.
struct Metal {
  double E = 210.0, nu = 0.3, yield = 0.24, kinematic = 0.0;

  double mu() const { return 0.5 * E / (1.0 + nu); }
  double kappa() const { return E / (3.0 * (1.0 - 2.0 * nu)); }
  SharedMaterial material() const { return J2({.moduli = {.E = E, .nu = nu}, .yield = yield, .kinematic = kinematic}); }
};

/// Thick sphere whose bore is moved outwards, to and fro. With q the hoop less the radial stress and e the plastic
/// hoop strain times two, equilibrium dS_r/dr = 2 q / r and Hooke's law give
///   (kappa / (2 mu) + 2/3) q + 3/2 kappa e = C / r^3,   |q - kinematic e| <= yield,
/// so that every radius yields by itself and one number C holds them together (without hardening Hill 1950, chapter
/// V.2). Integrals over the radius by the trapezoidal rule on 2000 shells.
class SphereInBothDirections {
 public:
  static constexpr double inner = ThickWall::inner, outer = ThickWall::outer;

  explicit SphereInBothDirections(const Metal& metal) : metal_(metal), e_(shells + 1, 0.0), q_(e_) {}

  /// Moves the bore to a displacement, or puts it under a pressure, from what was before.
  void bore_to(double u) {
    find([&](const State& state) { return displacement(state) - u; });
  }
  void load(double p) {
    find([&](const State& state) { return pressure(state) - p; });
  }
  double pressure() const { return pressure({q_, e_}); }
  double displacement() const { return displacement({q_, e_}); }
  /// Radial and hoop stress at a radius.
  Vec<2> stress(double r) const {
    const double at = std::log(r / inner) / std::log(outer / inner) * shells;
    const int i = std::clamp(static_cast<int>(at), 0, shells - 1);
    const double share = at - i, q = (1.0 - share) * q_[i] + share * q_[i + 1];
    double radial = 0.5 * (radius(i + 1) - r) * -(2.0 * q / r + 2.0 * q_[i + 1] / radius(i + 1));
    for (int j = i + 1; j < shells; ++j)
      radial -= 0.5 * (radius(j + 1) - radius(j)) * (2.0 * q_[j] / radius(j) + 2.0 * q_[j + 1] / radius(j + 1));
    return {radial, radial + q};
  }

 private:
  using Shells = std::vector<double>;
  using State = std::pair<Shells, Shells>;  // q and e at the radii
  static constexpr int shells = 2000;

  static double radius(int i) { return inner * std::pow(outer / inner, static_cast<double>(i) / shells); }
  template <class F> static double integral(const F& f) {
    double sum = 0.0;
    for (int i = 0; i < shells; ++i) sum += 0.5 * (radius(i + 1) - radius(i)) * (f(i) + f(i + 1));
    return sum;
  }
  /// Takes the C at which a rising function vanishes.
  template <class F> void find(const F& f) {
    double low = -1.0, high = 1.0;
    while (f(after(low)) > 0.0) low *= 2.0;
    while (f(after(high)) < 0.0) high *= 2.0;
    for (int k = 0; k < 100; ++k) {
      const double middle = 0.5 * (low + high);
      (f(after(middle)) < 0.0 ? low : high) = middle;
    }
    std::tie(q_, e_) = after(0.5 * (low + high));
  }
  State after(double C) const {
    State result{q_, e_};
    auto& [q, e] = result;
    const double A = metal_.kappa() / (2.0 * metal_.mu()) + 2.0 / 3.0, B = 1.5 * metal_.kappa();
    for (int i = 0; i <= shells; ++i) {
      const double D = C / std::pow(radius(i), 3);
      q[i] = (D - B * e[i]) / A;
      if (std::abs(q[i] - metal_.kinematic * e[i]) <= metal_.yield) continue;
      const double yield = std::copysign(metal_.yield, q[i] - metal_.kinematic * e[i]);
      e[i] = (D - A * yield) / (A * metal_.kinematic + B);
      q[i] = yield + metal_.kinematic * e[i];
    }
    return result;
  }
  static double pressure(const State& at) {
    return integral([&](int i) { return 2.0 * at.first[i] / radius(i); });
  }
  double displacement(const State& at) const {
    const Shells &q = at.first, &e = at.second;
    const auto w = [&](int i) { return q[i] / (2.0 * metal_.mu()) + 1.5 * e[i]; };
    return inner * ((2.0 * q[shells] / (3.0 * metal_.kappa()) + w(shells)) / 3.0 +
                    integral([&](int i) { return w(i) / radius(i); }));
  }

  Metal metal_;
  Shells e_, q_;
};

/// Thick tube in plane strain, elastically incompressible and perfectly plastic as far as the radius c: the pressure
/// and the displacement of its bore (Hill 1950, chapter V.2).
struct TubeYieldedTo {
  double pressure, displacement;

  TubeYieldedTo(const Metal& metal, double c) {
    const double k = metal.yield / std::sqrt(3.0), a = ThickWall::inner, b = ThickWall::outer;
    pressure = k * (1.0 - c * c / (b * b) + 2.0 * std::log(c / a));
    displacement = k * c * c / (2.0 * metal.mu() * a);
  }
  /// Of a displacement of the bore; elastic before it yields, b once all has.
  static double pressure_at(const Metal& metal, double displacement) {
    const TubeYieldedTo first(metal, ThickWall::inner);
    if (displacement < first.displacement) return first.pressure * displacement / first.displacement;
    const double c = ThickWall::inner * std::sqrt(displacement / first.displacement);
    return TubeYieldedTo(metal, std::min(c, ThickWall::outer)).pressure;
  }
  static double limit(const Metal& metal) { return TubeYieldedTo(metal, ThickWall::outer).pressure; }
};
/// 2 yield ln(b / a) (Hill 1950).
inline double sphere_limit(const Metal& metal) {
  return 2.0 * metal.yield * std::log(ThickWall::outer / ThickWall::inner);
}

/// Which wall, of which kind.
enum class PressedWall { tube, tube_of_revolution, tube_in_space, sphere_of_revolution, sphere_in_space };
constexpr bool in_space(PressedWall wall) {
  return wall == PressedWall::tube_in_space || wall == PressedWall::sphere_in_space;
}
constexpr bool is_sphere(PressedWall wall) {
  return wall == PressedWall::sphere_of_revolution || wall == PressedWall::sphere_in_space;
}
constexpr double height_of_tube = 0.5;

/// A quarter (plane), a section or an eighth.
template <int Dim> FineMesh<Dim> mesh_of(PressedWall wall, double size) {
  const ThickWall round{.sphere = true}, slice{.sphere = false};
  if constexpr (Dim == 3)
    return FineMesh<3>((wall == PressedWall::sphere_in_space ? round : slice).solid(height_of_tube, size));
  else
    return triangulate((wall == PressedWall::tube_of_revolution ? slice : round).section(height_of_tube, size),
                       {.size = size});
}

/// What happens to the bore over time.
struct Bore {
  std::function<double(double)> displacement{}, pressure{};  ///< one of them
};
/// A wall through time.
template <int Dim> Settings<Dim> wall_settings(PressedWall wall, const Metal& metal,
                                               const ApproximationOptions& options, const Bore& bore,
                                               const PathOptions& path) {
  Settings<Dim> settings;
  settings.common.model.material = metal.material();
  if (Dim == 2) settings.common.model.plane = wall == PressedWall::tube ? Plane::strain : Plane::axisymmetric;
  settings.common.approximation = options;
  const auto supports = [=](double time) {
    std::vector<DisplacementCondition<Dim>> all{symmetry_plane<Dim>("bottom")};
    if (bore.displacement) {
      const double u = bore.displacement(time);
      DisplacementCondition<Dim> outwards{"inner", {}, [u](const Vec<Dim>&) { return -u; }};
      if (options.kind != BasisKind::mls) {  // nodal values know no normals of curved walls
        const int turning = wall == PressedWall::tube_of_revolution ? 1 : wall == PressedWall::tube_in_space ? 2 : Dim;
        outwards.normal = {};
        for (int i = 0; i < turning; ++i)
          outwards.components[i] = [=](const Vec<Dim>& x) { return u * x[i] / x.head(turning).norm(); };
      }
      all.push_back(std::move(outwards));
    }
    if (Dim == 3) all.push_back(symmetry_plane<Dim>("left")), all.push_back(symmetry_plane<Dim>("front"));
    if (wall == PressedWall::tube) all.push_back(symmetry_plane<Dim>("axis"));
    if (wall == PressedWall::tube_of_revolution || wall == PressedWall::tube_in_space)
      all.push_back(symmetry_plane<Dim>("top"));
    return all;
  };
  settings.supports = supports(path.end);
  settings.time = {path, {}, [=](double time) {
                     Acting<Dim> acting{supports(time), {}};
                     if (bore.pressure) {
                       const double p = bore.pressure(time);
                       acting.loads.tractions.push_back(pressure<Dim>("inner", [p](const Vec<Dim>&) { return p; }));
                     }
                     return acting;
                   }};
  return settings;
}

/// Pressure on the bore: the force along an axis over the area that it sees.
template <int Dim> double bore_pressure(PressedWall wall, const HistoryStep<Dim>& step) {
  const Vec<Dim> force = step.reactions.at("inner").force;
  constexpr double pi = std::numbers::pi;
  switch (wall) {
    case PressedWall::tube:
      return 0.5 * (force[0] + force[1]);
    case PressedWall::tube_of_revolution:
      return force[0] / (2.0 * pi * height_of_tube);
    case PressedWall::tube_in_space:
      return 0.5 * (force[0] + force[1]) / height_of_tube;
    case PressedWall::sphere_of_revolution:
      return force[1] / pi;
    case PressedWall::sphere_in_space:
      return force.sum() / 3.0 / (pi / 4.0);
  }
  return 0.0;
}

}  // namespace efree::bench
