// SPDX-License-Identifier: GPL-3.0-or-later
/// What a run of explicit dynamics has counted so far: energies, numbers and times, by name. Every part adds entries of
/// its own; whoever reports them loops over all.
#pragma once

#include "efree/core/types.hpp"

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

namespace efree {

/// How an energy enters the balance.
enum class EnergyKind {
  kinetic,
  stored,       ///< in materials, cavities
  dissipated,   ///< by materials
  loss,         ///< by contact, fracture, artificial viscosity
  transfer,     ///< lost where shape functions or nodes change; negative where it was gained
  stabilising,  ///< held by zero-energy modes
  work,         ///< done on the bodies
};

/// Named numbers, in the order in which they were first added to.
class Ledger {
 public:
  struct Energy {
    std::string name;
    EnergyKind kind;
    double value;
  };
  struct Count {
    std::string name;
    std::int64_t value;
  };
  struct Time {
    std::string name;
    double seconds;
  };

  /// Adds to the entry of that name, which begins with 0.
  void add_energy(std::string_view name, EnergyKind kind, double energy);
  void add_count(std::string_view name, std::int64_t count);
  /// Of what is counted anew each time.
  void set_count(std::string_view name, std::int64_t count);
  void add_time(std::string_view name, double seconds);

  const std::vector<Energy>& energies() const { return energies_; }
  const std::vector<Count>& counts() const { return counts_; }
  const std::vector<Time>& times() const { return times_; }
  /// The value of an entry; 0 where there is none of that name.
  double energy(std::string_view name) const;
  std::int64_t count(std::string_view name) const;
  double time(std::string_view name) const;
  /// Sum over the entries of that kind.
  double sum(EnergyKind kind) const;
  /// Energy that there is and that was lost, less the work done on the bodies: constant but for errors of the
  /// integration in time.
  double total() const;

  friend auto fields(Ledger& of) {
    auto& [energies, counts, times] = of;
    return std::tie(energies, counts, times);
  }
  friend auto fields(Energy& of) {
    auto& [name, kind, value] = of;
    return std::tie(name, kind, value);
  }
  friend auto fields(Count& of) {
    auto& [name, value] = of;
    return std::tie(name, value);
  }
  friend auto fields(Time& of) {
    auto& [name, seconds] = of;
    return std::tie(name, seconds);
  }

 private:
  std::vector<Energy> energies_;
  std::vector<Count> counts_;
  std::vector<Time> times_;
};

/// Angular velocity or angular momentum, counterclockwise: a number in the plane, a vector in space.
template <int Dim> using Spin = Vec<Dim == 2 ? 1 : 3>;

/// Angular momentum of a momentum, or moment of a force, about the origin.
template <int Dim> Spin<Dim> moment_about_origin(const Vec<Dim>& at, const Vec<Dim>& force) {
  if constexpr (Dim == 2)
    return Spin<2>(at[0] * force[1] - at[1] * force[0]);
  else
    return at.cross(force);
}

/// Energies and momenta of all bodies, and of rigid bodies that have a mass. In the plane per unit thickness,
/// axisymmetric per full revolution.
template <int Dim> struct EnergyBalance {
  Ledger energies{};
  Vec<Dim> momentum = Vec<Dim>::Zero();            ///< half a step ago
  Spin<Dim> angular_momentum = Spin<Dim>::Zero();  ///< likewise, about the origin
  double operator[](std::string_view name) const { return energies.energy(name); }
  double total() const { return energies.total(); }
};

/// Error of the energy balance over a run.
struct EnergyWatch {
  double start = 0.0;  ///< total at the start
  double scale = 0.0;  ///< largest energy so far, at least what rounding makes of the moduli
  /// Total now less that at the start; energy gained where shape functions changed is an error.
  double residual = 0.0;
  double largest_residual = 0.0;  ///< so far
  Index beyond = 0;               ///< checks in a row at which it exceeded DynamicsOptions::imbalance
  bool begun = false;

  double error() const { return scale > 0.0 ? residual / scale : 0.0; }
  double largest_error() const { return scale > 0.0 ? largest_residual / scale : 0.0; }
  /// Compares with the energies now.
  void look(const Ledger& now);
};

}  // namespace efree
