// SPDX-License-Identifier: GPL-3.0-or-later
/// Where the pixels of a file lie in the world.
#pragma once

#include "efree/geometry/input/internal/pixel_values.hpp"

#include <array>
#include <string>
#include <vector>

namespace efree::internal {

/// The frame of an image whose axes are those of the file in the order, and with the signs, in which they come nearest
/// to the axes of the world.
template <int Dim> class ImageFrame {
 public:
  /// Throws InputError for spacings that are not positive, axes that are not at right angles, lengths beyond what
  /// meshes take, and a change of world that the file does not allow.
  ImageFrame(const std::string& path, const PixelValues& v, const ImageOptions<Dim>& options);

  /// An image with this frame and no pixels yet.
  template <class Image> Image empty() const {
    Image image;
    image.size = size_;
    image.spacing = spacing_;
    image.origin = origin_;
    image.axes = axes_;
    return image;
  }
  /// Values by pixel from the order of the file to that of the image.
  template <class T> void put_in_order(std::vector<T>& values) const {
    if (is_as_in_file()) return;
    std::array<std::size_t, Dim> step;  // in the file, along each axis of the image
    std::size_t first = 0;
    for (int d = 0; d < Dim; ++d) {
      step[d] = 1;
      for (int e = 0; e < from_[d]; ++e) step[d] *= static_cast<std::size_t>(size_in_file(e));
      if (reversed_[d]) first += step[d] * static_cast<std::size_t>(size_[d] - 1);
    }
    std::vector<T> ordered(values.size());
    std::array<Index, Dim> at{};
    for (T& value : ordered) {
      std::size_t pixel = first;
      for (int d = 0; d < Dim; ++d) {
        const std::size_t way = step[d] * static_cast<std::size_t>(at[d]);
        pixel = reversed_[d] ? pixel - way : pixel + way;
      }
      value = values[pixel];
      for (int d = 0; d < Dim && ++at[d] == size_[d]; ++d) at[d] = 0;
    }
    values = std::move(ordered);
  }
  /// Pixels, spacing and what it comes from, place and axes, in words.
  const std::vector<std::string>& remarks() const { return remarks_; }

 private:
  bool is_as_in_file() const;
  /// Pixels along an axis of the file.
  Index size_in_file(int axis) const;
  void describe(const PixelValues& v, const ImageOptions<Dim>& options, const std::string& world);

  std::array<Index, Dim> size_{};
  Vec<Dim> spacing_, origin_;
  Mat<Dim> axes_;
  std::array<int, Dim> from_{};       ///< axis of the file that each axis of the image is
  std::array<bool, Dim> reversed_{};  ///< whether it runs against it
  std::vector<std::string> remarks_;
};

}  // namespace efree::internal
