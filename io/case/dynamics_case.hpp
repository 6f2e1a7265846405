// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files of explicit dynamics (analysis.kind = "dynamics"). docs/case-file.md describes every key.
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/io/case/case_file.hpp"

#include <filesystem>
#include <variant>

namespace efree {

/// A case as read, before anything is computed. Of its mark `how` is 0, and `what` all but [time] and [output].
template <int Dim> struct DynamicsCase : Case<Dim> { DynamicsSettings<Dim> dynamics{}; };

/// The geometry decides which.
using AnyDynamicsCase = std::variant<DynamicsCase<2>, DynamicsCase<3>>;

/// Whether a case file is one of explicit dynamics. Throws InputError for a file that cannot be read or is no TOML.
bool is_dynamics_case(const std::filesystem::path& file);

/// Reads and checks one, as read_case does static ones.
AnyDynamicsCase read_dynamics_case(const std::filesystem::path& file, const Reading& reading = {},
                                   const Monitor& monitor = {});

/// prepare and build_dynamics_model with the case's own geometry.
template <int Dim>
DynamicsModel<Dim> build_dynamics_model(const DynamicsCase<Dim>& dynamics_case, const Monitor& monitor = {}) {
  return build_dynamics_model<Dim>(prepare<Dim>(dynamics_case.geometry, dynamics_case, monitor), dynamics_case,
                                   dynamics_case.dynamics, monitor);
}

}  // namespace efree
