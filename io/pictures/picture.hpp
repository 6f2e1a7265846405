// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of results and of geometry (PNG, 1600 x 1200), drawn in memory: they need no display.
#pragma once

#include "efree/analysis/image_analysis.hpp"
#include "efree/analysis/result.hpp"
#include "efree/dynamics/contact/rigid_body.hpp"
#include "efree/geometry/cracks/cracked_body.hpp"
#include "efree/geometry/mesh/summary.hpp"
#include "efree/io/case/inspect.hpp"
#include "efree/io/case/picture_options.hpp"

#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// A field (PointField, "error", "utilisation", or a scalar that the materials remember) on the deformed body, the
/// undeformed one behind it, where it is held and loaded, and where the field is largest. Returns false, without a
/// picture, if the result does not have the field. Throws InputError if the file cannot be written.
template <int Dim> bool draw_result(const std::filesystem::path& file, const PictureOptions& options,
                                    const Settings<Dim>& settings, const Result<Dim>& result);

/// The same of an image that was solved on cells, which have no "error" each: the faces of the cells that are mostly
/// material.
bool draw_result(const std::filesystem::path& file, const PictureOptions& options, const Settings<3>& settings,
                 const ImageResult& result);

/// Regions and named parts of the boundary, each in a colour of its own. Throws InputError if the file cannot be
/// written.
template <int Dim> void draw_pieces(const std::filesystem::path& file, const Inspection<Dim>& inspection);

/// What is seen of bodies of cells: triangles, in the plane all of the bodies, in space their surface.
template <int Dim> struct BodySkin {
  Points<Dim> nodes{};
  std::vector<std::array<Index, 3>> triangles{};  ///< of nodes
  Vector values{};                                ///< at nodes, by colour
};
/// Material points of explicit dynamics at one time.
template <int Dim> struct DynamicsPicture {
  BodySkin<Dim> skin{};  ///< of the bodies that have cells, and no points in this picture
  Points<Dim> points;
  Tensors F;      ///< 9 x points: a circle (sphere) around each is drawn as it is deformed
  Vector size;    ///< edges of squares (cubes) as large as the points at the start [length]
  Vector values;  ///< by colour
  std::string title;
  PictureOptions options;            ///< with a range
  std::array<double, 2> extremes{};  ///< of the field at the points, where skins show means
  BoundingBox<Dim> view;             ///< the part of space in the picture
  std::vector<Wall<Dim>> walls{};
  std::vector<ScalarField<Dim>> rigid_bodies{};  ///< gaps, negative inside; transparent in space
  bool axisymmetric = false;                     ///< drawn on both sides of the axis, x = 0
};
/// Values that the colours of a picture span unless its options say so.
template <int Dim> std::array<double, 2> range_of(const DynamicsPicture<Dim>& picture);
/// Writes a PNG file of 1600 x 1200 pixels. Throws InputError if that is not possible.
template <int Dim> void draw_dynamics(const std::filesystem::path& file, const DynamicsPicture<Dim>& picture);

/// A body with its cracks.
template <int Dim> struct CrackPicture {
  const CrackedMesh<Dim>& mesh;
  Vector values;                  ///< at nodes, by colour
  std::array<double, 2> range{};  ///< of values that the colours span
  std::string title, field;       ///< `field`: the name of the values
  BoundingBox<Dim> view;          ///< the part of space in the picture
};
/// In space faces of cracks are red; in the plane cracks are lines. Writes a PNG file of 1600 x 1200 pixels. Throws
/// InputError if that is not possible.
template <int Dim> void draw_cracks(const std::filesystem::path& file, const CrackPicture<Dim>& picture);

}  // namespace efree
