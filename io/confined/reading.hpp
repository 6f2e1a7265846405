// SPDX-License-Identifier: GPL-3.0-or-later
/// How far files are trusted that others wrote.
#pragma once

#include <optional>

namespace efree {

/// Geometries are read and meshed in a process of their own (docs/case-file.md, "Files from others"): it has the memory
/// that is available, and can neither start programs nor write files.
struct Reading {
  /// After which that process is ended; none: 3600, and as soon as a CAD file has taken 20 s of computing, and 20 s for
  /// every megabyte of it, before it is read.
  std::optional<double> seconds{};
  bool trust = false;  ///< it may start programs and write files, and scripts of gmsh may tell it to
};

}  // namespace efree
