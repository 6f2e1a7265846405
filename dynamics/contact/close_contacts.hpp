// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that shall touch at the start, and miss each other by a little.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree {

/// What close_contacts did.
struct ClosedContacts {
  Index vertices = 0;     ///< of surfaces that were moved onto others
  double furthest = 0.0;  ///< by how much vertices were moved at most [length]
  double overlap = 0.0;   ///< the deepest that is left, no deeper than the tolerance [length]
  /// By region: its volume (area in the plane) over that before, less 1. Axisymmetric: of the full revolution.
  Vector volume_change{};
};

/// Closes gaps and overlaps between regions, cut apart (cut_regions), that are no wider or deeper than `tolerance`
/// [length]: vertices of a region move along the normal onto facets of earlier ones that face them, as far as a
/// millionth of the tolerance in front of them, so that no two become the same; then any that are inside another region
/// move out. The rest of the region is stretched: it follows, the less the farther away it is. The body is stress-free
/// as it is then. axisymmetric: what is on the axis x = 0 stays there. Throws InputError where a cell would keep less
/// than a tenth of its volume.
template <int Dim> ClosedContacts close_contacts(FineMesh<Dim>& mesh, double tolerance, bool axisymmetric = false);

}  // namespace efree
