// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures whose pixels (voxels) say which material is where.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <cstdint>
#include <vector>

namespace efree {

/// What is in a pixel; 0 is void.
using Label = std::uint16_t;

/// Pixel (i, j) or voxel (i, j, k) fills the box origin + axes (spacing * [i, i+1] x [j, j+1] (x [k, k+1])); x runs
/// fastest, y up. Label 0 is void: nothing is there.
template <int Dim> struct LabelImage {
  std::array<Index, Dim> size{};         ///< pixels along x, y(, z)
  Vec<Dim> spacing = Vec<Dim>::Ones();   ///< edge lengths of a pixel [length]
  Vec<Dim> origin = Vec<Dim>::Zero();    ///< corner of the first pixel, not its centre [length]
  Mat<Dim> axes = Mat<Dim>::Identity();  ///< columns: directions of the rows of pixels along x, y(, z); a rotation
  std::vector<Label> labels{};           ///< by i + size[0] * (j + size[1] * k)
  /// Empty, or for every pixel how far its grey value is from the threshold: positive where the label is not 0,
  /// negative where it is. Says more exactly than labels where the boundary is.
  std::vector<float> grey{};

  std::size_t index(const std::array<Index, Dim>& at) const {
    std::size_t out = at[Dim - 1];
    for (int d = Dim - 2; d >= 0; --d) out = out * size[d] + at[d];
    return out;
  }
  Label at(const std::array<Index, Dim>& pixel) const { return labels[index(pixel)]; }
  double pixel_volume() const { return spacing.prod(); }
  bool is_turned() const { return !axes.isIdentity(0.0); }
  /// Where a point y goes when the image, first along the axes of the world, is turned about its origin.
  Vec<Dim> in_world(const Vec<Dim>& y) const { return is_turned() ? Vec<Dim>(origin + axes * (y - origin)) : y; }
};

/// Throws InputError unless sizes and spacings are positive and finite, the origin is finite, the axes are a rotation,
/// there is one label to every pixel, and grey values, if there are any, are finite and of the labels' sign.
template <int Dim> void check_image(const LabelImage<Dim>& image);

/// Where material is near a point.
template <int Dim> struct NearMaterial {
  Label label = 0;                ///< 0: there is none
  Vec<Dim> x = Vec<Dim>::Zero();  ///< the place in its pixel that is nearest to the point, in the world
  double distance = 0.0;          ///< of these two [length]
};
/// The material at a point of the world, or, if that is void, the nearest that is no more than `reach` pixels away
/// along each axis.
template <int Dim> NearMaterial<Dim> material_near(const LabelImage<Dim>& image, const Vec<Dim>& x, int reach);

/// A label and how many pixels have it.
struct LabelCount {
  Label label;
  std::int64_t pixels;
};
/// All labels of the image with their numbers of pixels, ascending by label, void included.
template <int Dim> std::vector<LabelCount> count_labels(const LabelImage<Dim>& image);

/// Pixels of the same label that hang together by their edges (faces in 3D).
struct ConnectedPixels {
  /// One of them.
  struct Part {
    Label label;
    std::size_t pixels;
  };
  std::vector<Part> parts;     ///< in the order of their first pixels
  std::vector<Index> part_of;  ///< by pixel
};
/// The connected parts of the image, void included.
template <int Dim> ConnectedPixels connected_pixels(const LabelImage<Dim>& image);

/// Pixels that are not void and hang together by their edges (faces in 3D), whatever their labels.
struct PixelBody {
  std::size_t pixels = 0, first = 0;  ///< how many, and the first of them
};
/// All of them, in the order of their first pixels. Throws as check_image does.
template <int Dim> std::vector<PixelBody> pixel_bodies(const LabelImage<Dim>& image);

/// An image without its islands.
template <int Dim> struct LargestBody {
  LabelImage<Dim> image;  ///< islands have become void (grey values: of the other sign)
  Index islands = 0;      ///< how many there were
  double fraction = 0.0;  ///< their part of the material's volume
};
/// Keeps the largest connected body of all pixels that are not void, whatever their labels. Pixels are connected
/// through edges (faces in 3D), so bodies that touch in a corner only are apart. Of bodies of the same size the first
/// stays. Throws InputError if all is void.
template <int Dim> LargestBody<Dim> keep_largest(LabelImage<Dim> image);

/// What random_spheres carves out.
struct RandomSpheres {
  double porosity = 0.3;             ///< wanted part of void, counted in pixels; the last sphere goes beyond it
  double r_min = 6.0, r_max = 14.0;  ///< radii, uniformly distributed [pixels]
  std::uint64_t seed = 1;
};
/// A square (block) of n pixels a side and label 1, out of which discs (balls) with centres anywhere in it are carved,
/// which may overlap, until its porosity is reached. Spacing 1. Reproducible by seed. Throws InputError for a size that
/// is not positive, radii that are not 0 < r_min <= r_max, or a porosity not in [0, 1).
template <int Dim> LabelImage<Dim> random_spheres(Index n, const RandomSpheres& options = {});

}  // namespace efree
