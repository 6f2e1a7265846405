// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace efree {

/// Largest relative error of a patch test that is passed.
inline constexpr double patch_tolerance = 1e-11;

}  // namespace efree
