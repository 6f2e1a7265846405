// SPDX-License-Identifier: GPL-3.0-or-later
/// How far files are trusted that others wrote.
#pragma once

namespace efree {

/// Geometries are read and meshed in a process of their own (docs/case-file.md, "Files from others"): it has the memory
/// that is available, and can neither start programs nor write files.
struct Reading {
  double seconds = 3600.0;  ///< after which that process is ended
  bool trust = false;       ///< it may start programs and write files, and scripts of gmsh may tell it to
};

}  // namespace efree
