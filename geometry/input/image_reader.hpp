// SPDX-License-Identifier: GPL-3.0-or-later
/// Label images from files and into files.
#pragma once

#include "efree/geometry/input/grey_image.hpp"
#include "efree/geometry/input/label_image.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace efree {

/// What a file without a header holds.
template <int Dim> struct RawImage {
  std::array<Index, Dim> size{};  ///< pixels along x, y(, z); x runs fastest, in 2D the first row is the top one
  std::string type = "uint8";     ///< uint8, int8, uint16, int16, uint32, int32, float32 or float64
  bool big_endian = false;
  std::int64_t header = 0;  ///< bytes to skip
};

/// How an image is read.
template <int Dim> struct ImageOptions {
  /// Edge lengths of a pixel, one number for all directions or one for each; empty: the file's, or 1 where it has none.
  std::vector<double> spacing{};
  /// For grey images: label 1 where the value is at least this, and the image keeps how far its grey values are from
  /// it. Without it the values themselves are the labels.
  std::optional<double> threshold{};
  bool below = false;                ///< label 1 where the value is less than the threshold
  std::vector<Label> background{0};  ///< labels that become 0, void; labels of no threshold only
  /// Anatomical axes that the world should have, "LPS" (x to the left, y to the back, z up, as ITK has it) or "RAS";
  /// empty: those of the file.
  std::string world{};
  Index max_labels = 64;               ///< more of them are taken for the shades of a grey image, which is an error
  std::optional<RawImage<Dim>> raw{};  ///< required for .raw files, refused for others
};

/// Whether a path is a folder of slices, or a pattern of their names ("slices/a_*.png").
bool is_slices(const std::string& path);

/// An image, and what its file says of where it lies.
template <int Dim> struct ImageFile {
  LabelImage<Dim> image;
  std::vector<std::string> remarks;   ///< pixels, spacing and what it comes from, place and axes, in words
  std::vector<std::string> warnings;  ///< lengths that nothing says
};

/// Reads the format that the ending of the name says: in 2D PNG, TIFF, PNM (.pgm, .pbm, .ppm, .pnm), NRRD, MetaImage
/// and raw; in 3D TIFF stacks, NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), NIfTI (.nii, .nii.gz), INR (.inr, .inr.gz),
/// raw, and slices: a folder of images in the plane, or a pattern of their names, in the order of the numbers in these.
///
/// Pictures in the plane (PNG, TIFF, PNM, raw) stand upright: their first row is the top one, y points up. In space
/// arrays are as the file has them, row by row along x, page by page along z. NRRD, MetaImage and NIfTI say where the
/// first pixel's centre is and how axes are directed (`space directions`, `TransformMatrix`, the s-form, else the
/// q-form): axes that are exchanged or reversed are put in the world's order, a rotation remains in `axes`, and axes
/// that are not at right angles are refused. Elsewhere the origin is 0. Spacings of TIFF are those of ImageJ (with the
/// distance of slices), of OME, or resolutions, in millimetres, but for those of screens and printers (72, 96, 150,
/// 300, 600 dpi, ...), which say nothing. Colour images are read if their channels are equal; alpha is ignored.
///
/// Throws InputError for a file that is missing, empty or truncated, no file of that format, or of an unknown one, with
/// more or fewer dimensions than asked for, slices that do not match each other, a sheared frame, colours, values that
/// are no labels (without a threshold), more than max_labels, nothing but background, a raw size that does not match
/// the file's length, and too little memory, which is said from the header, before it is taken.
template <int Dim> ImageFile<Dim> read_image_file(const std::string& path, const ImageOptions<Dim>& options = {});

/// The image alone.
template <int Dim> LabelImage<Dim> read_image(const std::string& path, const ImageOptions<Dim>& options = {});

/// The values of the same pixels as they are in the file, in single precision; of `options` spacing, world and raw
/// count. Throws InputError for the file itself as read_image does.
template <int Dim> GreyImage<Dim> read_grey_image(const std::string& path, const ImageOptions<Dim>& options = {});

/// What an image holds, for choosing how to read it.
struct ImageValues {
  int dimension = 2;
  double least = 0.0, largest = 0.0;
  Index different = 0;     ///< how many values there are, counted up to 65
  bool are_labels = true;  ///< whole numbers from 0 to 65535, no more than 64 different ones
  /// The value that parts two classes best, by the variance between them (Otsu 1979, on 256 bins).
  double threshold = 0.0;
};
/// Of the first colour. Throws InputError as read_image does for the file itself, and for values that are no numbers.
ImageValues image_values(const std::string& path);

/// Writes the labels as PGM or MetaImage (.mha, with spacing and origin) in 2D, as MetaImage in 3D: 8 bits to a label
/// if that is enough, else 16. Throws InputError for another ending and if the file cannot be written.
template <int Dim> void write_image(const LabelImage<Dim>& image, const std::string& path);

}  // namespace efree
