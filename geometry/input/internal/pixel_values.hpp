// SPDX-License-Identifier: GPL-3.0-or-later
/// The values of an image as a file holds them, whatever its format.
#pragma once

#include "efree/core/error.hpp"
#include "efree/core/types.hpp"
#include "efree/geometry/input/image_reader.hpp"

#include <fmt/format.h>
#include <array>
#include <istream>
#include <memory>
#include <string>
#include <vector>

namespace efree::internal {

/// What an image file says about itself, and its values.
struct PixelValues {
  std::array<Index, 3> size{1, 1, 1};
  std::array<double, 3> spacing{1.0, 1.0, 1.0}, origin{0.0, 0.0, 0.0};
  Mat<3> axes = Mat<3>::Identity();  ///< columns: directions of the file's axes in the world, of length 1
  bool centred = false;              ///< the origin is the centre of the first pixel, not its corner
  std::string spacing_from;          ///< what in the file says the spacing; empty: nothing, edges are 1
  std::string world;                 ///< anatomical axes of the world, "LPS", "RAS" or "LAS"; empty: not said
  std::vector<std::string> doubts;   ///< lengths that had to be guessed, in words
  int components = 1;
  std::string type;                    ///< "uint8", "float32", ...
  bool top_first = false;              ///< the first row is the top one
  std::shared_ptr<const void> shared;  ///< either this, owned by a library,
  std::vector<char> bytes;             ///< or these hold the values, in this machine's order

  std::size_t pixels() const { return static_cast<std::size_t>(size[0]) * size[1] * size[2]; }
  const void* data() const { return shared ? shared.get() : static_cast<const void*>(bytes.data()); }
};

/// Bytes of a value of a type by its name.
std::size_t size_of(const std::string& type);

/// Calls body(value of that type).
template <class Body> void with_type(const std::string& path, const std::string& type, const Body& body) {
  if (type == "uint8") return body(std::uint8_t{});
  if (type == "int8") return body(std::int8_t{});
  if (type == "uint16") return body(std::uint16_t{});
  if (type == "int16") return body(std::int16_t{});
  if (type == "uint32") return body(std::uint32_t{});
  if (type == "int32") return body(std::int32_t{});
  if (type == "uint64") return body(std::uint64_t{});
  if (type == "int64") return body(std::int64_t{});
  if (type == "float32") return body(float{});
  if (type == "float64") return body(double{});
  throw InputError(
      fmt::format("{}: values of type \"{}\", expected uint8, int8, uint16, int16, uint32, int32, float32 "
                  "or float64",
                  path, type));
}

/// Throws InputError if the values of an image of this size, `bytes_each` for one, do not fit into memory.
void require_room(const std::string& path, const PixelValues& v, std::size_t bytes_each);

/// Turns big-endian values into little-endian ones and back, `each` bytes for one.
void swap_bytes(std::vector<char>& bytes, std::size_t each);

/// Throws InputError: so many bytes of values are in the file.
[[noreturn]] void throw_truncated(const std::string& path, double expected, double found);

/// Fills `bytes` from the rest of the stream.
void read_values(const std::string& path, std::istream& file, bool big_endian, PixelValues& v);

// The formats. All throw InputError for a file that is truncated, broken or of another format.

/// A file without a header.
template <int Dim> PixelValues read_raw(const std::string& path, const RawImage<Dim>& raw);
/// PNM, text or binary.
PixelValues read_pnm(const std::string& path);
/// INRIMAGE-4: a header of 256 bytes (or a multiple) with a setting to every line, then the values; gzip or not.
PixelValues read_inr(const std::string& path);
/// NIfTI, gzip or not: voxels as the s-form places them, else the q-form.
PixelValues read_nifti(const std::string& path);
/// The slices of a stack, each an image in the plane, in the order of the numbers in their names; x and y as in the
/// file, so that the array is not mirrored.
PixelValues read_slices(const std::string& path);
/// The files of a folder that are images in the plane, or those that a pattern matches, in the order of the numbers in
/// their names. Throws InputError if there are none, or of several formats.
std::vector<std::string> slice_files(const std::string& path);
/// Spacing of a TIFF file by its tags: that of ImageJ, of OME, or resolutions that are no screen's or printer's.
void read_tiff_spacing(const std::string& path, PixelValues& v);
/// NRRD, attached or detached (VTK's reader takes three axes for two, and falls over two): lines "key: value" up to an
/// empty one, then raw, gzip or ascii values.
PixelValues read_nrrd(const std::string& path, int dim);
/// PNG.
PixelValues read_png(const std::string& path);
/// TIFF, a page for every layer.
PixelValues read_tiff(const std::string& path);
/// MetaImage; `head`: how the file begins.
PixelValues read_meta_image(const std::string& path, const std::string& head);

/// The format that the ending of the name says, checked against how the file begins.
template <int Dim> PixelValues read_pixels(const std::string& path, const ImageOptions<Dim>& options);

/// Throws InputError unless all channels but alpha are equal.
template <class T> void require_grey(const std::string& path, const T* values, const PixelValues& v) {
  const int stride = v.components, colours = stride == 2 || stride == 4 ? stride - 1 : stride;
  for (std::size_t p = 0; colours > 1 && p < v.pixels(); ++p)
    for (int c = 1; c < colours; ++c)
      if (values[p * stride + c] != values[p * stride])
        throw InputError(fmt::format("{}: it is a colour image; turn it into a grey one, or one of labels", path));
}

}  // namespace efree::internal
