// SPDX-License-Identifier: GPL-3.0-or-later
/// What gmsh would do besides reading geometry.
#pragma once

#include <string>

namespace efree::internal {

/// gmsh takes .geo files, option files beside them (NAME.opt) and whatever else it does not recognise for scripts,
/// which can run programs and write files. Reads those that gmsh would read for `path` (a .geo or .msh file), those
/// they include among them, and throws InputError naming file, line and command if one of them does more than describe
/// geometry, includes files outside its folder or under a name that is computed, or is no mesh though it is called one.
/// For the sake of the message: gmsh reads text in ways that no other reader can follow to the letter, so whoever does
/// not know a script reads it in a process that can do no harm (io/confined/internal/confined.hpp).
void require_harmless(const std::string& path);

}  // namespace efree::internal
