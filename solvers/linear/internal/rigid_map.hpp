// SPDX-License-Identifier: GPL-3.0-or-later
/// Motions as sums of others, turned about them; for one or several fields side by side.
#pragma once

#include "efree/assembly/internal/lanes.hpp"
#include "efree/core/types.hpp"

#include <vector>

namespace efree {

/// Row by row: which others a place moves with, and by what share of their motion.
template <int Dim> struct RigidMap {
  struct Entry {
    Index of;
    double share;
  };
  Ragged<Entry> rows;
  Points<Dim> places, others;  ///< of the rows, and where the others are

  /// By other, in ascending order of row: the entries that name it, of the row.
  RigidMap mirrored() const;
};

/// Vectors in `lanes` lanes (1, 4 or 8; see NodeLanes). In the plane rotations are the first component.
using Lanes = std::vector<double>;

/// A motion, and how what moves turns: empty if nothing does. Or forces and moments.
struct LanesPair {
  Lanes moves, turns;
};

/// By row: the sum of share * (moves + turns x arm), arm from the other to the row's place, and, if `turning`, of share
/// * turns.
template <int Dim> LanesPair follow(const RigidMap<Dim>& map, int lanes, const LanesPair& others, bool turning);
/// Its adjoint, by row of the mirrored map: the sum of share * forces, and, if `turning`, of share * (arm x forces +
/// moments).
template <int Dim> LanesPair gather(const RigidMap<Dim>& mirrored, int lanes, const LanesPair& rows, bool turning);

}  // namespace efree
