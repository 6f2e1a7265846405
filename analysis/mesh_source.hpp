// SPDX-License-Identifier: GPL-3.0-or-later
/// Where the fine mesh of an analysis comes from, as fine as it is asked for.
#pragma once

#include "efree/core/monitor.hpp"
#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/boundary_offsets.hpp"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace efree {

/// A count or a measure.
using Reported = std::variant<Index, double>;

/// A mesh, and what was measured while it was made.
template <int Dim> struct MadeMesh {
  MeshData<Dim> mesh;
  std::vector<std::pair<std::string, Reported>> reports{};  ///< names as in result.json, values
  std::vector<std::string> remarks{};                       ///< the same in words
  std::vector<std::string> warnings{};                      ///< what makes results on this mesh doubtful
  double size = 0.0;                                        ///< it was made with; 0: with the file's own sizes
  std::optional<BoundaryOffsets<Dim>> boundary{};           ///< where the true surface is known, or guessed
  /// The true surface is not known, and is taken to be smooth where facets meet at small angles: `boundary` is that, or
  /// smooth_offsets. A finer mesh does not always come closer to it.
  bool smooth = false;
};

/// An image as it is analysed without a mesh, and what was found while it was read.
template <int Dim> struct MadeImage {
  LabelImage<Dim> image;
  std::map<Label, std::string> region_of_label{};  ///< names of regions
  std::vector<std::pair<std::string, Reported>> reports{};
  std::vector<std::string> remarks{}, warnings{};
};

/// How fine a mesh should be.
struct MeshSize {
  double length = 0.0;      ///< longest edge; 0: what is natural for the geometry, or the file's own sizes
  double coarsening = 1.0;  ///< factor on what is natural; less for geometries of which it would change too much
  /// Largest distance of facets from a curved surface, over the thickness of the wall there, or the radius of curvature
  /// if that is less; 0: default_sagitta if the length is open, else 16 facets to a full turn.
  double sagitta = 0.0;

  double sagitta_or_natural() const;
};

/// Where nothing is said of sizes: 16 facets to a full turn of a curved boundary, more in thin walls. With facets this
/// far from the surface of such a wall, relative to its thickness, stresses are some 3 % off, as polygons bend
/// (bench_facets walls).
constexpr double default_sagitta = 0.02;

inline double MeshSize::sagitta_or_natural() const {
  return sagitta > 0.0 ? sagitta : length > 0.0 ? 0.0 : default_sagitta;
}

/// A geometry: a mesh as a function of its size.
template <int Dim> struct MeshSource {
  /// Reads or makes the mesh, as part of a stage: where it takes long it ticks, and so can be cancelled. Throws as the
  /// readers do.
  std::function<MadeMesh<Dim>(const MeshSize& size, const Stage& stage)> mesh;
  /// Of images that a lattice would be cut out of: the image alone. Throws as `mesh`. Empty: there is none.
  std::function<MadeImage<Dim>(const Stage& stage)> image{};
  double size = 0.0;                 ///< [length]; 0: `ratio` says it, or it is open
  double coarsening = 1.0;           ///< of the natural size, where it is open
  double sagitta = 0.0;              ///< as of MeshSize
  double ratio = 0.0;                ///< H/h, cloud spacing over fine mesh size; 0: size holds
  std::vector<std::string> slits{};  ///< names of the parts the body was cut open along
  ScalarField<Dim> grey{};           ///< value of the image at a point (grey_value); empty: the geometry is no image
  std::string where{};               ///< where the geometry was named; messages begin with it unless it is empty

  /// Whether no other size may be taken.
  bool says_its_size() const { return size > 0.0 || ratio > 0.0; }
};

}  // namespace efree
