// SPDX-License-Identifier: GPL-3.0-or-later
/// Fine meshes of label images.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"

#include <map>
#include <string>

namespace efree {

/// How the boundaries between labels run in 2D.
enum class Contour {
  pixel,   ///< along the edges of pixels: areas are those of the pixels exactly
  smooth,  ///< from midpoint to midpoint of these edges (marching squares): corners of pixels are cut off
};

/// What meshes images in 3D.
enum class Mesher {
  lattice,   ///< a regular lattice, cut where labels differ; see lattice_mesh.hpp
  delaunay,  ///< Delaunay refinement (CGAL Mesh_3; Boissonnat and Oudot 2005)
};

/// How an image is meshed.
struct ImageMeshOptions {
  /// Required [length]. In 2D the longest edge allowed; on a lattice the edge of its cubes, the longest edge of cells
  /// is 1.7 to 2 times it; for Delaunay refinement the edge wanted.
  double size = 0.0;
  Mesher mesher = Mesher::lattice;   ///< 3D only; in 2D there is constrained Delaunay triangulation alone
  Contour contour = Contour::pixel;  ///< 2D only; in 3D boundaries are always smooth
  /// 2D only: contours are simplified as long as they move by no more than this [pixels]; 0 keeps them. Junctions, ends
  /// on the image's frame, and the frame itself stay; contours neither cross nor vanish (CGAL
  /// Polyline_simplification_2; Dyken, Daehlen, Sevaldrud 2009).
  double simplify = 0.0;
  /// Names of regions by label. Empty: every label is a region named by its number. Otherwise all labels but 0 must
  /// have a name and all named labels must be in the image; labels with the same name are one region.
  std::map<Label, std::string> names{};
  /// Mesher::delaunay only: largest distance between the boundary's facets and the boundary itself [smallest edge of a
  /// voxel].
  double facet_distance = 0.35;
};

/// Conforming mesh of all pixels (voxels) that are not void. Regions: one for each name, ascending by label. Groups:
/// "left", "right" (x), "bottom", "top" (y; in 3D z), in 3D "front", "back" (y) for the facets on the image's frame,
/// and "pores" for all others of the boundary; facets between two regions belong to none. Bodies that touch in a corner
/// only (in 3D in an edge, too) are not connected there. Deterministic, in 3D by lattice on any number of threads.
///
/// 2D: constrained Delaunay triangulation of the contours, coarser than a pixel away from them if `size` is. On the
/// frame contours stay where the pixels end. Smooth contours of three or more labels meet in the pixels' corner.
///
/// 3D, Mesher::lattice: tetrahedra of a lattice of cubes, see mesh_on_lattice. The boundary is that of the trilinear
/// interpolation of the image's grey values, where it has any, else of each label's indicator, the label with the
/// largest winning; it is found on each edge of the lattice. Points of the lattice near a boundary move onto it or away
/// from it, and those next to a wall, gap or neck that would fall between them into it (by less than half an edge), so
/// that cells have a flatness (six times the volume over the cube of the longest edge) of at least 3e-4, commonly 1e-3.
/// Features thinner than the lattice may be lost, gaps closed and necks broken: mesh_on_lattice says which. Sharp edges
/// of the image are cut off by up to a cube. Cost linear in the voxels and in the lattice.
///
/// 3D, Mesher::delaunay: Delaunay refinement (CGAL Mesh_3) of the same boundary, but by labels only; slivers are left
/// in, cells as good as without volume (flatness below 1e-4) are not: a vertex of each that is not on the frame moves
/// inside the body, along the boundary, or off it by up to a tenth of `facet_distance` in all (NumericalError if that
/// is not enough). A body or pore smaller than `size` may be lost, and gaps and necks thinner than a voxel may close or
/// open. Known limit: noise from voxel to voxel on the frame (contours that nearly touch everywhere) can keep Mesh_3's
/// protection of features going without end; filter such images first.
///
/// Throws InputError for a broken image, one that is all void, names that do not match the labels (the message lists
/// these), a size that is not positive, negative tolerances, grey values in an image of several regions (lattice), more
/// cells than can be numbered, and too little memory; NumericalError if no material is found at this size.
template <int Dim> MeshData<Dim> mesh_image(const LabelImage<Dim>& image, const ImageMeshOptions& options);
template <> MeshData<2> mesh_image<2>(const LabelImage<2>& image, const ImageMeshOptions& options);
template <> MeshData<3> mesh_image<3>(const LabelImage<3>& image, const ImageMeshOptions& options);

}  // namespace efree
