// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/mesh_reports.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace efree::internal {

void report_lost(const LostFeatures& lost, MadeMesh<3>& made) {
  made.reports.push_back({"lost_parts", lost.parts});
  made.reports.push_back({"lost_pieces", lost.pieces});
  made.reports.push_back({"lost_volume", lost.volume});
  made.reports.push_back({"broken_off", lost.broken_off});
  if (lost.parts + lost.pieces > 0) {
    const bool is_void = lost.worst_region.empty();
    made.remarks.push_back(fmt::format(
        "too thin for mesh_size: {} bodies or pores and {} pieces of others are not in the mesh, volume {:.3g} in all; "
        "the largest is {}, volume {:.3g} at ({:.4g})",
        lost.parts, lost.pieces, lost.volume,
        lost.worst_is_part ? (is_void ? "a pore" : fmt::format("a body of \"{}\"", lost.worst_region))
                           : (is_void ? "a piece of void" : fmt::format("a piece of \"{}\"", lost.worst_region)),
        lost.worst_volume, fmt::join(lost.worst_place, ", ")));
  }
  if (lost.broken_off > 0)
    made.remarks.push_back(fmt::format(
        "too thin for mesh_size: necks of {} bodies that are one with others in the image; the largest has a "
        "volume of {:.3g}, around ({:.4g})",
        lost.broken_off, lost.broken_volume, fmt::join(lost.broken_place, ", ")));
}

}  // namespace efree::internal
