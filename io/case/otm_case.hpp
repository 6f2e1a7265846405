// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files of bodies in motion (analysis.kind = "otm"). docs/case-file.md describes every key.
#pragma once

#include "efree/analysis/motion.hpp"
#include "efree/io/case/case_file.hpp"

#include <filesystem>
#include <variant>

namespace efree {

/// A case as read, before anything is computed. Of its mark `how` is 0, and `what` all but [time] and [output].
template <int Dim> struct OtmCase : Case<Dim> { MotionSettings<Dim> motion{}; };

/// The geometry decides which.
using AnyOtmCase = std::variant<OtmCase<2>, OtmCase<3>>;

/// Whether a case file is about bodies in motion. Throws InputError for a file that cannot be read or is no TOML.
bool is_otm_case(const std::filesystem::path& file);

/// Reads and checks one, as read_case does those at rest.
AnyOtmCase read_otm_case(const std::filesystem::path& file, const Reading& reading = {}, const Monitor& monitor = {});

/// prepare and set_in_motion with the case's own geometry.
template <int Dim> MovingBodies<Dim> set_in_motion(const OtmCase<Dim>& of, const Monitor& monitor = {}) {
  return set_in_motion<Dim>(prepare<Dim>(of.geometry, of, monitor), of, of.motion, monitor);
}

}  // namespace efree
