// SPDX-License-Identifier: GPL-3.0-or-later
/// The spacing of TIFF files.
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <tiffio.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>

namespace efree::internal {
namespace {

/// The number after `key` in a text, if it is positive.
std::optional<double> number_after(const std::string& text, const std::string& key) {
  const auto at = text.find(key);
  if (at == std::string::npos) return {};
  const double value = std::strtod(text.c_str() + at + key.size(), nullptr);
  if (!(value > 0.0) || !std::isfinite(value)) return {};
  return value;
}

std::string word_after(const std::string& text, const std::string& key, const std::string& ends) {
  const auto at = text.find(key);
  if (at == std::string::npos) return "";
  const auto from = at + key.size();
  return text.substr(from, text.find_first_of(ends, from) - from);
}

/// Whether so many pixels an inch are those of a screen or a printer, not of what the picture shows.
bool is_of_a_display(double dots) {
  constexpr std::array<double, 9> usual{72.0, 75.0, 90.0, 96.0, 100.0, 150.0, 200.0, 300.0, 600.0};
  return std::ranges::any_of(usual, [&](double of) { return std::abs(dots - of) < 0.01 * of; });
}

struct Tags {
  std::string description;
  float x = 0.0F, y = 0.0F;  // pixels to a unit
  std::uint16_t unit = RESUNIT_INCH;
};

std::optional<Tags> tags_of(const std::string& path) {
  TIFFErrorHandler errors = TIFFSetErrorHandler(nullptr), warnings = TIFFSetWarningHandler(nullptr);
  const std::unique_ptr<TIFF, void (*)(TIFF*)> file(TIFFOpen(path.c_str(), "r"), [](TIFF* f) {
    if (f != nullptr) TIFFClose(f);
  });
  std::optional<Tags> tags;
  if (file) {
    tags.emplace();
    char* description = nullptr;
    if (TIFFGetField(file.get(), TIFFTAG_IMAGEDESCRIPTION, &description) == 1 && description != nullptr)
      tags->description = description;
    TIFFGetField(file.get(), TIFFTAG_XRESOLUTION, &tags->x);
    TIFFGetField(file.get(), TIFFTAG_YRESOLUTION, &tags->y);
    TIFFGetFieldDefaulted(file.get(), TIFFTAG_RESOLUTIONUNIT, &tags->unit);
  }
  TIFFSetErrorHandler(errors);
  TIFFSetWarningHandler(warnings);
  return tags;
}

}  // namespace

void read_tiff_spacing(const std::string& path, PixelValues& v) {
  v.spacing = {1.0, 1.0, 1.0};
  const std::optional<Tags> tags = tags_of(path);
  if (!tags) return;
  const std::string& text = tags->description;
  const bool resolved = tags->x > 0.0F && tags->y > 0.0F && std::isfinite(tags->x) && std::isfinite(tags->y);
  std::optional<double> depth;
  if (text.starts_with("ImageJ=")) {
    const std::string unit = word_after(text, "\nunit=", "\n");
    if (unit.empty() && tags->unit == RESUNIT_INCH) return;
    if (resolved) v.spacing = {1.0 / tags->x, 1.0 / tags->y, 1.0};
    depth = number_after(text, "\nspacing=");
    v.spacing_from = fmt::format("ImageJ{}{}", unit.empty() ? "" : ", in ", unit);
  } else if (const auto x = number_after(text, "PhysicalSizeX=\""), y = number_after(text, "PhysicalSizeY=\"");
             x && y) {
    v.spacing = {*x, *y, 1.0};
    depth = number_after(text, "PhysicalSizeZ=\"");
    const std::string unit = word_after(text, "PhysicalSizeXUnit=\"", "\"");
    v.spacing_from = fmt::format("OME, in {}", unit.empty() ? "micrometres" : unit);
  } else if (resolved && tags->unit != RESUNIT_NONE) {
    const double unit = tags->unit == RESUNIT_CENTIMETER ? 10.0 : 25.4;  // [mm]
    if (is_of_a_display(tags->x * 25.4 / unit)) {
      v.doubts.push_back(fmt::format(
          "{}: its {:.4g} dots an inch are those of a screen or a printer, not of what it shows: pixels are taken to "
          "be 1 long; [geometry.image] spacing says their edges",
          path, tags->x * 25.4 / unit));
      return;
    }
    v.spacing = {unit / tags->x, unit / tags->y, 1.0};
    v.spacing_from = "TIFF resolution, in millimetres";
  }
  if (v.size[2] == 1 || v.spacing_from.empty()) return;
  v.spacing[2] = depth.value_or(v.spacing[0]);
  if (!depth)
    v.doubts.push_back(
        fmt::format("{}: it does not say how far apart its slices are, {:.4g} is taken, the edge of a pixel along x; "
                    "[geometry.image] spacing = [x, y, z] says another one",
                    path, v.spacing[2]));
}

}  // namespace efree::internal
