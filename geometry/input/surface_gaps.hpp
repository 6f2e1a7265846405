// SPDX-License-Identifier: GPL-3.0-or-later
/// Gaps and slits of a surface, and whether a mesh of it closes them.
#pragma once

#include "efree/geometry/input/surface.hpp"

#include <vector>

namespace efree {

/// A gap: void between pieces of a surface that face each other, of one body or of two.
struct SurfaceGap {
  /// A line across it.
  struct Sample {
    Vec<3> from, to;  ///< its ends on the surface
    double area;      ///< of the surface that it stands for [length^2]
    /// Thickness of the body behind the two ends, along the line; infinity if it is more than the widest gap looked
    /// for.
    double behind_from, behind_to;
    double width() const { return (to - from).norm(); }
  };
  std::vector<Sample> samples;
  double narrowest = 0.0, widest = 0.0;  ///< widths of samples [length]
  Vec<3> at = Vec<3>::Zero();            ///< in the middle of the narrowest sample
  double area = 0.0;                     ///< of both walls together [length^2]
};

/// Gaps that are at most `widest` wide [length]: from points of the surface about `spacing` apart, a million at most,
/// the first triangle along the outward normal whose own normal is opposite within 45 degrees. Samples whose middles
/// are neighbours in a grid of that spacing are one gap. The surface may be dirty; which side is void follows from
/// orient_triangles. No gaps: places as wide as they are long (pores, pits), whose walls have less than eight times the
/// square of their width. The largest in area first; the same on any number of threads. Cost n log n in triangles and
/// points. Throws InputError if a triangle names a point that is not there.
std::vector<SurfaceGap> find_gaps(const SurfaceSoup& surface, double widest, double spacing);

/// The gaps, or parts of gaps, that a mesh of the surface closes: lines across them, lengthened into the body at both
/// ends by `reach` [length] (but by no more than half of its thickness there), that leave the mesh nowhere. `reach`:
/// how far the boundary of the mesh may be from the surface.
std::vector<SurfaceGap> closed_gaps(const std::vector<SurfaceGap>& gaps, const MeshData<3>& mesh, double reach);

}  // namespace efree
