// SPDX-License-Identifier: GPL-3.0-or-later
/// Fine meshes from gmsh and CAD files.
#pragma once

#include "efree/geometry/mesh/boundary_offsets.hpp"

#include <map>
#include <string>
#include <vector>

namespace efree {

/// How gmsh reads and meshes a file.
struct GmshOptions {
  double size = 0.0;  ///< longest edge wanted [length]; 0: the file's own sizes, for CAD the box's diagonal / 20
  double factor =
      1.0;  ///< on the sizes that a .geo file has (`size` bounds them still), and on what CAD has without one
  /// > 0: facets are no farther from a curved surface than this fraction of the thickness of the wall, or of the radius
  /// of curvature if that is less: for nearly all of them, and at most 60 000 that only this asks for. 0: at least 16
  /// to a full turn, of .geo files with their own sizes as many as these say.
  double sagitta = 0.0;
  /// Values for the .geo file's DefineNumber parameters, by full name ("Parameters/radius") or its last part
  /// ("radius").
  std::map<std::string, double> parameters{};
  std::vector<std::string> slits{};  ///< names of physical curves (surfaces in 3D) to cut the body open along
  /// Run scripts whatever they do. Otherwise those that are seen to start programs, write files, or take files from
  /// outside their folder are refused before gmsh sees them. Scripts of people one does not know are for `read_case`
  /// and `inspect`, which have gmsh run in a process that can do neither.
  bool trust = false;
};

/// Mesh from a gmsh or CAD file (gmsh API). Starts and ends a gmsh session of its own: neither call it while using gmsh
/// nor from two threads. Deterministic.
///
/// .geo and .msh: physical surfaces (volumes in 3D) become regions, and if there are any only those are meshed.
/// Without, a planar mesh has one region without a name, a solid one for each volume ("volume 1", or the name it came
/// with). Physical curves (surfaces in 3D) become groups, of any overlap; without them every surface of a solid becomes
/// one ("surface 1"). What has no name goes by its number. Slits inside the body are cut open.
///
/// 2D: with a size given, gmsh samples the curves of a .geo file (at least 16 chords to a full circle, finer where the
/// file says so) and CGAL fills in the plane surfaces (ten times faster); otherwise gmsh meshes it all with the file's
/// own sizes.
///
/// 3D: gmsh's Delaunay tetrahedra, neither optimised nor smoothed, at least 16 elements to a full turn of a curved
/// surface; edges longer than `size` are then split.
///
/// .step, .stp, .iges, .igs, .brep (3D only; OpenCASCADE): bodies become regions, named by the last part of their
/// label in the file, numbered if several share it ("nut 1", "nut 2"), "body 1" without a label; surfaces become
/// groups. Bodies that touch share the facets between them. Where bodies overlap the common part is a region of its
/// own, named "a & b". Coordinates are the file's numbers, in the length unit that a STEP or IGES file declares (in the
/// first of them, if it mixes several). A file of surfaces only is sewn to bodies if they close.
///
/// Of triangles (tetrahedra) of a higher order the corner nodes are read.
///
/// Throws InputError for a file that is missing, unreadable, with elements other than triangles (tetrahedra) or none, a
/// planar one not in one plane z = const, an entity in two regions, a name in `slits` that is no physical group, an
/// unknown parameter, a size or parameters for a .msh file, a script that does more than describe geometry, CAD without
/// a body, and for everything that gmsh itself reports as an error, in its words.
template <int Dim> MeshData<Dim> read_gmsh(const std::string& path, const GmshOptions& options = {});
/// The same with the offsets of its facets from the curves and surfaces of the file (of a .msh file there are none) and
/// the highest order of its elements.
template <int Dim> CurvedMesh<Dim> read_curved_gmsh(const std::string& path, const GmshOptions& options = {});

/// 3 if the file holds volumes (always for CAD files, which are not opened), else 2. `trust`, and what it throws, as
/// for read_gmsh.
int gmsh_dimension(const std::string& path, bool trust = false);

}  // namespace efree
