// SPDX-License-Identifier: GPL-3.0-or-later
/// Results of explicit dynamics as text and as result.json.
#pragma once

#include "efree/core/monitor.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/io/records/contact_forces.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// Numbers of bodies, nodes and points, and the length of the next step.
template <int Dim> std::string describe_model(const DynamicsModel<Dim>& model);

/// Steps, counts, energies, shares of the time and probes, a line each.
template <int Dim>
std::vector<std::string> describe_run(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model);

/// Counts, energies, momenta, rigid bodies, forces of contact, probes, extremes of all fields, shares of the time: the
/// format is in docs/case-file.md. Probes without a value are left out. Throws InputError if the file cannot be
/// written.
template <int Dim> void write_dynamics_result(const std::filesystem::path& file, const DynamicsCase<Dim>& dynamics_case,
                                              const DynamicsModel<Dim>& model, const ContactForces<Dim>& contacts,
                                              const DynamicsOutcome& outcome, const std::vector<std::string>& warnings,
                                              const StageTimes& times);

}  // namespace efree
