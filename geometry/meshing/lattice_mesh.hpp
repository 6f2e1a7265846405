// SPDX-License-Identifier: GPL-3.0-or-later
/// Fine meshes of images in space without a mesher: a regular lattice, cut where the material ends.
#pragma once

#include "efree/geometry/meshing/image_mesh.hpp"

namespace efree {

/// Points `origin + spacing * (i, j, k)`, 0 <= i <= cubes[0] and so on, numbered with i fastest; the cube numbered
/// alike (0 <= i < cubes[0]) has point (i, j, k) as its lowest corner.
struct Lattice {
  Vec<3> origin = Vec<3>::Zero();   ///< [length]
  Vec<3> spacing = Vec<3>::Ones();  ///< edge lengths of a cube [length]
  std::array<Index, 3> cubes{};
};

/// What is in the image, but not in a mesh of it: clusters of voxels of one region (or of void) in cubes of the lattice
/// that have no corner in that region. Clusters are connected through faces of voxels.
struct LostFeatures {
  Index parts = 0;    ///< clusters that are a whole body or a whole pore, so that nothing of it is in the mesh
  Index pieces = 0;   ///< all others: pieces of walls, necks and tips
  double volume = 0;  ///< of all clusters together [length^3]
  /// The largest cluster by volume; a part goes before a piece of the same size.
  double worst_volume = 0;              ///< [length^3]
  Vec<3> worst_place = Vec<3>::Zero();  ///< its voxel next to the mean of its voxels, its centre [length]
  bool worst_is_part = false;           ///< a whole body or pore
  std::string worst_region{};           ///< name of its region; empty: void
  /// Bodies of the mesh that are one with a larger one in the image (connected through faces of voxels there).
  Index broken_off = 0;
  double broken_volume = 0;              ///< of the largest of them [length^3]
  Vec<3> broken_place = Vec<3>::Zero();  ///< its centre of mass [length]
};

/// A mesh cut out of a lattice.
struct LatticeMesh {
  MeshData<3> mesh;
  Lattice lattice;                     ///< along the axes of the image, about whose origin it is turned as this is
  std::vector<Index> cube_of_cell;     ///< ascending
  std::vector<Index> point_of_vertex;  ///< by vertex, the point of the lattice that it is; -1: it lies elsewhere
  LostFeatures lost;
};

/// What mesh_image<3> does by default, and what it says there; with what is known of the mesh besides. The image's
/// frame is cut into equal cubes (but for rounding to whole numbers of them along each axis: boxes) with edges of about
/// `options.size`, each cube into six tetrahedra along its diagonal (Kuhn 1960; Freudenthal 1942), and these where the
/// labels at their corners differ (marching tetrahedra; Doi and Koide 1991), so that cells of up to four labels
/// conform. Throws as mesh_image does.
LatticeMesh mesh_on_lattice(const LabelImage<3>& image, const ImageMeshOptions& options);

}  // namespace efree
