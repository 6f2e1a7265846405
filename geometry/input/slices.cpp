// SPDX-License-Identifier: GPL-3.0-or-later
/// Stacks of slices, each in a file of its own.
#include "efree/core/internal/lower_case.hpp"
#include "efree/geometry/input/internal/pixel_values.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <glob.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <string_view>

namespace efree {

bool is_slices(const std::string& path) {
  std::error_code error;  // names that are too long are no folders
  if (std::filesystem::exists(path, error)) return std::filesystem::is_directory(path, error);
  return std::filesystem::path(path).filename().string().find_first_of("*?[") != std::string::npos;
}

namespace internal {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 7> endings{".png", ".tif", ".tiff", ".pgm", ".pbm", ".ppm", ".pnm"};

std::string_view ending_of(const std::string& name) {
  const std::string lower = lower_case(name);
  for (const std::string_view ending : endings)
    if (lower.ends_with(ending)) return ending;
  return "";
}

/// Whether a name comes before another, numbers in them by their value: slice_9 before slice_10.
bool comes_before(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [&](const std::string& s, std::size_t& at) {
      while (at + 1 < s.size() && s[at] == '0' && is_digit(s[at + 1])) ++at;
      const std::size_t first = at;
      while (at < s.size() && is_digit(s[at])) ++at;
      return std::string_view(s).substr(first, at - first);
    };
    const std::string_view one = number(a, i), other = number(b, j);
    if (one.size() != other.size()) return one.size() < other.size();
    if (one != other) return one < other;
  }
  return a.size() - i < b.size() - j;
}

std::vector<std::string> matching(const std::string& pattern) {
  glob_t found{};
  std::vector<std::string> files;
  if (glob(pattern.c_str(), GLOB_NOSORT, nullptr, &found) == 0)
    files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  globfree(&found);
  return files;
}

}  // namespace

std::vector<std::string> slice_files(const std::string& path) {
  std::error_code error;
  std::vector<std::string> files;
  const bool is_folder = fs::is_directory(path, error);
  if (is_folder)
    for (const auto& entry : fs::directory_iterator(path)) files.push_back(entry.path().string());
  else
    files = matching(path);
  std::erase_if(files, [&](const std::string& file) {
    return (is_folder && ending_of(file).empty()) || fs::is_directory(file, error);
  });
  if (files.empty())
    throw InputError(fmt::format("{}: {}, expected slices that end with {}", path,
                                 is_folder ? "there is no image in this folder" : "no file has such a name",
                                 fmt::join(endings, ", ")));
  std::ranges::sort(files, comes_before);
  for (const std::string& file : files)
    if (ending_of(file) != ending_of(files.front()) || ending_of(file).empty())
      throw InputError(
          fmt::format("{}: slices of several formats, such as {} and {}; a pattern of names, as in "
                      "\"slices/a_*.png\", chooses",
                      path, files.front(), file));
  return files;
}

PixelValues read_slices(const std::string& path) {
  const std::vector<std::string> files = slice_files(path);
  PixelValues stack;
  for (std::size_t k = 0; k < files.size(); ++k) {
    PixelValues slice = read_pixels<2>(files[k], {});
    if (slice.size[2] != 1)
      throw InputError(fmt::format("{}: it has {} layers, expected a slice", files[k], slice.size[2]));
    const std::size_t bytes = slice.pixels() * slice.components * size_of(slice.type);
    if (k == 0) {
      stack.size = {slice.size[0], slice.size[1], static_cast<Index>(files.size())};
      stack.spacing = slice.spacing;
      stack.spacing_from = slice.spacing_from;
      stack.components = slice.components;
      stack.type = slice.type;
      stack.doubts = slice.doubts;
      require_room(path, stack, size_of(stack.type));
      stack.bytes.reserve(bytes * files.size());
    } else if (slice.size[0] != stack.size[0] || slice.size[1] != stack.size[1] || slice.type != stack.type ||
               slice.components != stack.components) {
      throw InputError(fmt::format("{}: a slice of {} x {} pixels of {}, {} has {} x {} of {}", files[k], slice.size[0],
                                   slice.size[1], slice.type, files[0], stack.size[0], stack.size[1], stack.type));
    }
    const char* first = static_cast<const char*>(slice.data());
    stack.bytes.insert(stack.bytes.end(), first, first + bytes);
  }
  if (!stack.spacing_from.empty()) {
    stack.spacing[2] = stack.spacing[0];
    stack.doubts.push_back(
        fmt::format("{}: nothing says how far apart the slices are, {:.4g} is taken, the edge of a pixel along x; "
                    "[geometry.image] spacing = [x, y, z] says another one",
                    path, stack.spacing[2]));
  }
  return stack;
}

}  // namespace internal
}  // namespace efree
