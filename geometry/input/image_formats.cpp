// SPDX-License-Identifier: GPL-3.0-or-later
/// Which format an image file has.
#include "efree/core/internal/lower_case.hpp"
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <string_view>

namespace efree::internal {

template <int Dim> PixelValues read_pixels(const std::string& path, const ImageOptions<Dim>& options) {
  std::error_code error;
  if (Dim == 3 && is_slices(path)) return read_slices(path);
  if (!std::filesystem::exists(path, error)) throw InputError(fmt::format("{}: there is no such file", path));
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(fmt::format("{}: it is no file", path));
  if (std::filesystem::file_size(path) == 0) throw InputError(fmt::format("{}: it is empty", path));
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(fmt::format("{}: cannot be read", path));
  std::string head(1024, '\0');
  file.read(head.data(), 1024);
  head.resize(static_cast<std::size_t>(file.gcount()));

  const std::string name = lower_case(path);
  const auto ends = [&](auto... endings) { return (name.ends_with(endings) || ...); };
  const auto expect = [&](bool magic, const char* format) {
    if (!magic) throw InputError(fmt::format("{}: it is no {} file, whatever its name says", path, format));
  };
  const auto starts = [&](std::string_view magic) { return std::string_view(head).starts_with(magic); };
  if (options.raw.has_value() != ends(".raw"))
    throw InputError(fmt::format("{}: {}", path,
                                 options.raw ? "size and type are for .raw files, this one has a header"
                                             : "a .raw file says nothing about itself: give size and type"));
  if (ends(".raw")) return read_raw<Dim>(path, *options.raw);
  if (ends(".png")) {
    expect(starts("\x89PNG\r\n\x1a\n"), "PNG");
    return read_png(path);
  }
  if (ends(".tif", ".tiff")) {
    using namespace std::literals;
    expect(starts("II*\0"sv) || starts("MM\0*"sv) || starts("II+\0"sv) || starts("MM\0+"sv), "TIFF");
    return read_tiff(path);
  }
  if (ends(".pgm", ".pbm", ".ppm", ".pnm")) {
    expect(head.size() > 2 && head[0] == 'P' && head[1] >= '1' && head[1] <= '6' && std::isspace(head[2]), "PNM");
    return read_pnm(path);
  }
  if (ends(".nrrd", ".nhdr")) {
    expect(starts("NRRD"), "NRRD");
    return read_nrrd(path, Dim);
  }
  if (ends(".mha", ".mhd")) {
    expect(head.find("NDims") != std::string::npos, "MetaImage");
    return read_meta_image(path, head);
  }
  if (ends(".nii", ".nii.gz")) {
    expect(starts("\x1f\x8b") || head.find("n+1") == 344 || head.find("n+2") == 4, "NIfTI");
    return read_nifti(path);
  }
  if (ends(".inr", ".inr.gz")) {
    expect(starts("#INRIMAGE-4#{") || starts("\x1f\x8b"), "INR");
    return read_inr(path);
  }
  throw InputError(
      fmt::format("{}: unknown ending, images end with .png, .tif, .tiff, .pgm, .pbm, .ppm, .pnm, .nrrd, "
                  ".nhdr, .mha, .mhd, .nii, .nii.gz, .inr, .inr.gz or .raw",
                  path));
}

template PixelValues read_pixels<2>(const std::string&, const ImageOptions<2>&);
template PixelValues read_pixels<3>(const std::string&, const ImageOptions<3>&);

}  // namespace efree::internal
