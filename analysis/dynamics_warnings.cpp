// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/dynamics.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree {

namespace {

/// Of mass scaling; empty: there is none.
template <int Dim> std::string warn_of_inertia(const DynamicsSettings<Dim>& settings, const Dynamics<Dim>& dynamics) {
  const AddedInertia inertia = dynamics.added_inertia();
  if (settings.options.mass_scaling.on() && !inertia.is_known())
    return "Motion and forces may be wrong: the error by mass scaling is not known, as the run is shorter than three "
           "times that a wave takes through a body. Mass scaling is for quasi-static processes: leave it out in short "
           "ones";
  const double error = inertia.error();
  if (!(error > warned_inertia)) return {};
  const std::string advice = fmt::format(
      "Mass scaling is for quasi-static processes: take slower loads{} or less mass_scaling{}",
      settings.options.damping > 0.0 ? ", less damping" : "",
      settings.gravity || settings.gravity_field
          ? ", and none where bodies fall: under gravity they accelerate by its share of the mass that is real"
          : ", and none where bodies fly, fall or vibrate");
  const std::string forces = settings.options.damping > 0.0 ? "inertial and damping forces" : "inertial forces";
  if (error >= 1.0)
    return fmt::format("Motion and forces are wrong: {} of the added mass are up to {:.2g} times those of stresses. {}",
                       forces, error, advice);
  return fmt::format("Forces may be wrong by {:.2g} % of the largest, as much as the {} of the added mass. {}",
                     100.0 * error, forces, advice);
}

}  // namespace

template <int Dim> std::vector<std::string> collect_warnings(const DynamicsSettings<Dim>& settings,
                                                             const DynamicsModel<Dim>& model,
                                                             const DynamicsOutcome& outcome) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  std::vector<std::string> warnings = model.warnings;
  const EnergyWatch energy = dynamics.energy();
  if (const double error = energy.largest_error(); std::abs(error) > warned_imbalance)
    warnings.push_back(
        fmt::format("Velocities and stresses may be inaccurate: the energy is off by up to {:.2g} %. Try smaller steps "
                    "(dynamics.courant) or a finer mesh",
                    100.0 * error));
  if (const double lost = dynamics.balance()["reconnection"]; lost > warned_reconnection * energy.scale)
    warnings.push_back(fmt::format(
        "Bodies may be too slow: reconnection has dissipated {:.2g} % of the energy, as where parts of a body meet and "
        "stick to each other, points reconnect often, or shocks have no artificial viscosity. Try dynamics.shock, a "
        "larger otm.reconnection_strain or more otm.stabilisation",
        100.0 * lost / energy.scale));
  if (const auto shared = dynamics.count("shared supports") + dynamics.num_inverted(); shared > 0)
    warnings.push_back(fmt::format(
        "Stresses may be wrong at single points: {} times one of {} material points had no shape functions, or would "
        "have been inverted, and shares those of a neighbour. Try a finer mesh",
        shared, dynamics.num_points()));
  if (const auto penetrated = dynamics.count("penetrated points"); penetrated > 0)
    warnings.push_back(fmt::format(
        "Bodies penetrate each other: {} of {} material points have passed the surface of another body. Try "
        "artificial viscosity (dynamics.shock) or a finer mesh",
        penetrated, dynamics.num_points()));
  if (const auto separated = dynamics.count("separated points"); separated > 0)
    warnings.push_back(fmt::format(
        "Stresses scatter, and bodies may break where their material does not (numerical fracture): {} of {} material "
        "points were stretched until they were too far from their neighbours for the grid. Try more points along a "
        "cell (mpm.points), mpm.degree = 3 or mpm.frame = \"mesh\" (\"total\" where bodies do not meet)",
        separated, dynamics.num_points()));
  if (const auto clumped = static_cast<double>(dynamics.count("clumped particles"));
      clumped > warned_clumped * static_cast<double>(dynamics.num_points()))
    warnings.push_back(fmt::format(
        "Stresses scatter, and bodies may break where their material does not (tensile instability): {} of {} "
        "particles are closer to another than half of their spacing. Try sph.artificial_stress = {{ strength = 0.5 }}, "
        "sph.frame = \"total\" where bodies do not meet or flow, or [mpm]",
        clumped, dynamics.num_points()));
  if (std::string warning = warn_of_inertia(settings, dynamics); !warning.empty())
    warnings.push_back(std::move(warning));
  if (settings.residual > 0.0 && !outcome.at_rest)
    warnings.push_back(
        fmt::format("Bodies are not at rest at the end: the residual is {:.2g}, more than relaxation.residual = "
                    "{:.2g}. Take a later "
                    "time.end, a larger residual, or loads that grow more slowly",
                    outcome.residual.value_or(std::numeric_limits<double>::infinity()), settings.residual));
  for (const auto& [name, values] : measure_probes(settings, model))
    if (std::isnan(values[0]))
      warnings.push_back(fmt::format("Probe \"{}\" has no value: no node or point is in its box at the end", name));
  return warnings;
}

template std::vector<std::string> collect_warnings(const DynamicsSettings<2>&, const DynamicsModel<2>&,
                                                   const DynamicsOutcome&);
template std::vector<std::string> collect_warnings(const DynamicsSettings<3>&, const DynamicsModel<3>&,
                                                   const DynamicsOutcome&);

}  // namespace efree
