// SPDX-License-Identifier: GPL-3.0-or-later
/// Points of a lattice in an image: the regions they are in, where they are moved to, and where edges between points of
/// two regions are cut.
#pragma once

#include "efree/geometry/meshing/internal/lattice_grid.hpp"

#include <algorithm>
#include <bit>
#include <optional>
#include <vector>

namespace efree::internal {

/// A cut nearer than this to an end of its edge, in parts of it, takes that end along, or stays away so far.
constexpr double snap = 0.2;

/// The lattice with its points in place.
class LatticePoints : public LatticeGrid {
 public:
  /// Finds the regions of all points and draws them into thin features. Throws InputError likewise.
  LatticePoints(const LabelImage<3>& image, const ImageMeshOptions& options);

  /// What no point sees of the image: to be asked before edges are cut.
  void find_lost(LostFeatures& lost) const;
  /// Cuts the edges between points of two regions, and moves points that are near a boundary onto it or away.
  void cut_edges_and_snap();

 protected:
  struct Moved {
    std::size_t point;
    Vec<3> u;
    Label region = on_boundary;
  };
  static constexpr std::uint8_t moved_before = 1, moved_now = 2;

  std::array<Label, 8> corners(std::size_t cube) const {
    std::array<Label, 8> out;
    for (int c = 0; c < 8; ++c) out[c] = label_[cube + offset_[c]];
    return out;
  }
  /// Where a point of the lattice is, in voxels.
  Vec<3> position(std::size_t point) const { return position(unpacked(point), point); }
  Vec<3> position(const std::array<Index, 3>& at, std::size_t point) const {
    if (flags_[point] == 0) return place(at);
    return std::ranges::lower_bound(moved_[at[2]], point, {}, &Moved::point)->u;
  }
  /// Of the edge from a point along the axes of a mask, if it has one; in parts of it.
  double cut_of(std::size_t point, unsigned axes) const {
    return cuts_[point / stride_[2]][first_[point] + std::popcount(cut_mask_[point] & ((1u << axes) - 1))];
  }
  /// The same, away from the ends.
  double kept_cut(std::size_t point, unsigned axes) const { return std::clamp(cut_of(point, axes), snap, 1.0 - snap); }
  /// Region of a tetrahedron without a corner that has one.
  Label region_inside(std::size_t cube, const KuhnTet& tet) const;

  std::vector<Label> label_;               ///< by point: region from 1, void 0, or on_boundary
  std::vector<std::uint8_t> cut_mask_;     ///< by point: bit m if its edge along the axes m has ends in two regions
  std::vector<Index> first_;               ///< by point: its first cut in its plane
  std::vector<std::vector<float>> cuts_;   ///< by plane
  std::vector<std::vector<Moved>> moved_;  ///< by plane, ascending
  std::vector<std::uint8_t> flags_;        ///< by point: 0, moved_before or moved_now

 private:
  /// Voxels that have no corner of their region around them, ascending.
  std::vector<std::size_t> unseen_voxels() const;
  void label_points();
  /// A point in the middle of a flat piece of boundary between faces of voxels could belong to either side: it goes to
  /// the thinner one, for which it may be the only one.
  Label region_of(const std::array<Index, 3>& at) const;
  /// Marks the cubes in which more than one region has a say.
  std::vector<std::uint8_t> mixed_cubes() const;
  void draw_in_points();
  /// Moves all points that `where` says, by what holds before any of them moves.
  template <class Where> void move(const Where& where);
  /// Points that together squeeze a tetrahedron go back; their regions stay.
  void let_go();
  /// Along the edge to which a point is drawn in the least.
  std::optional<Moved> drawn_in(const std::array<Index, 3>& at, std::size_t point,
                                const std::vector<std::uint8_t>& mixed) const;
  /// A bulge that an edge grazes goes on at one side of the edge and ends at the other; walls and necks do both alike.
  bool is_bulge(const Vec<3>& u, const Vec<3>& along, Label region) const;
  /// Whether a tetrahedron around a point has lost more than it may.
  bool squeezes(std::size_t point) const;
  /// In parts of the edge from u to u + along, whose ends are in regions a and b.
  double cut(const Vec<3>& u, const Vec<3>& along, Label a, Label b) const;
  void cut_edges();
  void snap_points();
  /// The edges of points that have moved since.
  void cut_again();
  /// Where a point near a boundary goes: onto it, if it is flat enough, and has no other side of a thin wall in reach:
  /// points on a boundary have no region, and what lies between them and farther cuts of their edges would be lost.
  /// Else away from it.
  std::optional<Moved> settled(const std::array<Index, 3>& at, std::size_t point) const;
  /// Back from a cut that is too near, but not beyond the middle of a wall.
  std::optional<Moved> away(std::size_t point, const Vec<3>& from, const Vec<3>& along, double t) const;
};

}  // namespace efree::internal
