// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of dirty surfaces without a wrap: inside and outside by how often the triangles wind around a point.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"

namespace efree {

/// The body of a surface as an image.
struct SurfaceImage {
  /// One label, 1, inside; grey values: distance to the triangles, positive inside [length], which shrinks to nothing
  /// across holes. Two voxels of void all around.
  LabelImage<3> image;
  Index turned = 0;         ///< triangles that faced the other way in the file (up to a turn of the whole surface)
  Index shells_turned = 0;  ///< closed shells among them that were turned as a whole
  /// Share of the body's boundary, counted in pairs of neighbouring voxels, that is farther than a voxel from all
  /// triangles: there holes are closed.
  double closed = 0.0;
};

/// Samples a surface on voxels with this edge [length]. Inside is where the generalised winding number (Jacobson, Kavan
/// & Sorkine-Hornung 2013) is more than a half: holes are closed by smooth patches, bodies that cross are united,
/// doubled and loose triangles mostly do not matter. Triangles face as the file has them, but for those that face
/// against most of the surface they hang together with by edges; where a quarter of it does, outward; a surface inside
/// out is turned. Closed shells within others are cavities, whichever way they face. Walls thinner than two voxels get
/// lost. The same on any number of threads. Throws InputError for no triangle, an edge that is not positive, too little
/// memory for so many voxels, and if nothing is inside.
SurfaceImage sample_surface(const SurfaceSoup& surface, double voxel);

/// A mesh of what a surface encloses, holes and crossings or not.
struct SurfaceLattice {
  MeshData<3> mesh;                     ///< one region without a name, one group, "surface 1"
  LostFeatures lost;                    ///< what of the sampled body is thinner than the lattice
  Index turned = 0, shells_turned = 0;  ///< as in SurfaceImage
  double closed = 0.0;                  ///< likewise
};
/// mesh_on_lattice of sample_surface on voxels of half the lattice's edge `size` [length]. Sharp edges are cut off by
/// up to a cube. Throws like both.
SurfaceLattice mesh_surface_on_lattice(const SurfaceSoup& surface, double size);

}  // namespace efree
