// SPDX-License-Identifier: GPL-3.0-or-later
/// Grey values of a picture as a field.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <vector>

namespace efree {

/// What the pixels of a LabelImage were before they were sorted into labels; pixels lie as there.
template <int Dim> struct GreyImage {
  std::array<Index, Dim> size{};         ///< pixels along x, y(, z)
  Vec<Dim> spacing = Vec<Dim>::Ones();   ///< edge lengths of a pixel [length]
  Vec<Dim> origin = Vec<Dim>::Zero();    ///< corner of the first pixel, not its centre [length]
  Mat<Dim> axes = Mat<Dim>::Identity();  ///< as of a LabelImage
  std::vector<float> values{};           ///< by i + size[0] * (j + size[1] * k)
};

/// The grey value at a point: linear between the centres of pixels along each axis, constant beyond the outermost of
/// them. May be called from several threads at once. A Parameter of a material in space takes it, as in
/// [grey = grey_value<3>(image)](const Vec<3>& X) { return 17e9 * std::pow(grey(X) / 255.0, 2); }. Throws InputError
/// unless sizes and spacings are positive and there is one value to every pixel.
template <int Dim> ScalarField<Dim> grey_value(GreyImage<Dim> image);

}  // namespace efree
