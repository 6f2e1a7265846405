// SPDX-License-Identifier: GPL-3.0-or-later
/// Fine meshes from gmsh files.
#pragma once

#include "efree/geometry/fine_mesh.hpp"

#include <map>
#include <string>
#include <vector>

namespace efree {

struct GmshOptions {
  double size = 0.0;  ///< longest edge wanted [length]; 0: the file's own sizes
  /// Values for the .geo file's DefineNumber parameters, by full name ("Parameters/radius") or its last part
  /// ("radius").
  std::map<std::string, double> parameters{};
  std::vector<std::string> slits{};  ///< names of physical curves to cut the body open along
};

/// Planar mesh from a .geo or .msh file (gmsh API). Physical curves become named groups (one without a name goes by its
/// number); of those inside the body only the ones in `slits` remain. With a size given, gmsh samples the curves of a
/// .geo file (at least 16 chords to a full circle, finer where the file says so) and CGAL fills in the plane surfaces
/// (ten times faster); otherwise gmsh meshes it all with the file's own sizes. If physical surfaces exist, only those
/// are meshed. Starts and ends a gmsh session of its own: neither call it while using gmsh nor from two threads. Throws
/// InputError for a file that is missing, unreadable, with elements other than 3-node triangles or none, not in one
/// plane z = const, a name in `slits` that is no physical curve, an unknown parameter, a size or parameters for a .msh
/// file, and for everything that gmsh itself reports as an error, in its words.
FineMesh<2> read_gmsh(const std::string& path, const GmshOptions& options = {});

}  // namespace efree
