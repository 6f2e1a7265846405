// SPDX-License-Identifier: GPL-3.0-or-later
/// The part of the fine mesh that a node's support can reach.
#pragma once

#include "efree/geometry/fine_mesh.hpp"

namespace efree {

/// Connected part of the fine mesh inside a ball around a source vertex.
template <int Dim> struct Patch {
  Index source = -1;            ///< fine vertex at the centre
  double radius = 0.0;          ///< of the ball [length]
  std::vector<Index> cells;     ///< cells that meet the ball, connected to the source through facets, in flooding order
  std::vector<Index> vertices;  ///< all vertices of those cells, source first (some lie a little outside the ball)
  std::vector<Index> facets;    ///< boundary facets of those cells
  /// True if a boundary facet in reach shows its outer side to the source. If none does, the source sees all of the
  /// patch and the geodesic distance is the straight line: a segment that left the body would have to come back through such a facet.
  bool obstructed = false;
};

/// Finds patches; keeps scratch memory between calls, so use one per thread.
template <int Dim> class PatchFinder {
 public:
  explicit PatchFinder(const FineMesh<Dim>& mesh);
  /// Cost linear in the size of the patch. The reference is valid until the next call.
  const Patch<Dim>& around(Index source, double radius);

 private:
  const FineMesh<Dim>& mesh_;
  Patch<Dim> patch_;
  std::vector<Index> cell_stamp_, vertex_stamp_;
  Index stamp_ = 0;
};

}  // namespace efree
