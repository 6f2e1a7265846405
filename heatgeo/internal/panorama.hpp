// SPDX-License-Identifier: GPL-3.0-or-later
/// What a point in a solid sees.
#pragma once

#include "efree/heatgeo/internal/spatial_sight.hpp"

namespace efree {

/// Which vertices within a radius are in sight of a source: those that no facet hides. Only facets that show it their
/// outer side can, for a line that leaves the body comes back through one. They are sorted by direction, on the sides
/// of a cube around the source. Keeps its memory: use one per thread.
class Panorama {
 public:
  /// Keeps a reference to what must have been made for patches.
  explicit Panorama(const SpatialSight& sight);

  /// Looks around from the source.
  void look(Index source, double radius);
  /// Whether vertex v of the source's body is in sight; `line` leads there from the source, `distance` < radius is its
  /// length. Lines along the boundary are in sight.
  bool shows(Index v, const Vec<3>& line, double distance) const;

 private:
  /// Projection to a cube around the source: the side, and where on it, in [-1, 1]^2.
  struct OnCube {
    int side;
    double u, v;
    explicit OnCube(const Vec<3>& x);
  };
  /// A vertex of facets that turn their outer side to the source.
  struct Corner {
    Index vertex;
    Vec<3> x;  ///< from the source
    double distance;
    OnCube on_cube;
    Index outer_facets;  ///< how many there are
  };
  /// A facet that may hide what is behind it. The line to x crosses it if edges x >= 0, and the sum of that is how far
  /// it goes, `depth` at the facet.
  struct Screen {
    Mat<3> edges;  ///< rows: normals of the planes through the source and a side
    double depth, nearest, rim;
  };
  enum class Cut { none, rim, inside };

  int square(int side, double u, double v) const;
  Index corner(Index v);
  void sort_by_direction();
  template <class Emit> void for_each_square(const Corner& a, const Corner& b, const Corner& c, const Emit& emit) const;
  /// Whether the line goes through the inside of a screen, or through the rim of one.
  Cut cut(const Vec<3>& line, double distance) const;

  const SpatialSight& sight_;
  Index source_ = -1;
  bool on_slit_ = false;          ///< another vertex lies where the source is
  std::vector<Index> corner_at_;  ///< by vertex: in corners_, or -1: none of its facets turns its outer side here
  std::vector<Corner> corners_;
  std::vector<Screen> screens_;
  std::vector<std::array<Index, 3>> screen_corners_;
  int resolution_ = 1;                            ///< squares along an edge of the cube
  std::vector<std::pair<Index, Index>> covered_;  ///< square and screen
  std::vector<Index> begin_, items_;              ///< screens by square
  std::vector<double> nearest_;                   ///< of the screens of a square
};

}  // namespace efree
