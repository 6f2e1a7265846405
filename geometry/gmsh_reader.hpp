// SPDX-License-Identifier: GPL-3.0-or-later
/// Fine meshes from gmsh files.
#pragma once

#include "efree/geometry/fine_mesh.hpp"

#include <map>
#include <string>
#include <vector>

namespace efree {

struct GmshOptions {
  double size = 0.0;                         ///< longest edge wanted [length]; 0: the file's own sizes
  std::map<std::string, double> parameters;  ///< values for the .geo file's DefineNumber parameters
  std::vector<std::string> slits;            ///< names of physical curves to cut the body open along
};

/// Planar mesh from a .geo or .msh file (gmsh API). Physical curves become named groups. With a size given, gmsh samples
/// the curves of a .geo file and CGAL fills in the surfaces (ten times faster); otherwise gmsh meshes it all.
/// If physical surfaces exist, only those are meshed. Throws InputError for a file that is missing, unreadable, or
/// without triangles in the z = const plane, a name in `slits` that is no physical curve, or an unknown parameter.
FineMesh<2> read_gmsh(const std::string& path, const GmshOptions& options = {});

}  // namespace efree
