// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/internal/picture_reader.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <string_view>

namespace efree::internal {
namespace {

/// One of these names, or nothing if the key is not there.
std::string named(const Section& picture, const char* key, const std::vector<std::string>& known, const char* of) {
  const std::string name = picture.text(key, "");
  if (!picture.has(key) || std::ranges::find(known, name) != known.end()) return name;
  if (known.empty()) picture.fail(key, fmt::format("the case has no {}", of));
  const std::vector<std::string_view> names(known.begin(), known.end());
  picture.fail(key, fmt::format("there is no {} \"{}\"; {}", of, name, suggestion(name, names)));
}

std::array<double, 2> two_numbers(const Section& picture, const char* key, const char* what) {
  const std::vector<double> numbers = picture.numbers(key, any_number);
  if (numbers.size() != 2) picture.fail(key, fmt::format("{} has {} numbers, expected {}", key, numbers.size(), what));
  return {numbers[0], numbers[1]};
}

/// For a file's name.
std::string plain_name(const Section& picture, const std::string& name) {
  constexpr std::size_t longest = 60;
  const bool is_plain = !name.empty() && name.size() <= longest && std::ranges::all_of(name, [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '-';
  });
  if (!is_plain)
    picture.fail(
        "name",
        fmt::format("name is \"{}\", expected at most 60 letters, digits, - and _: a file is called by it", name));
  return name;
}

}  // namespace

std::vector<PictureOptions> read_pictures(const Section& output, const PictureChoices& choices) {
  Section::Keys keys{"name", "field", "unit", "range"};
  if (choices.solid) keys.emplace_back("view");
  if (choices.at_rest) keys.insert(keys.end(), {"case", "deformation"});
  std::vector<PictureOptions> pictures;
  for (const Section& entry : output.sections("pictures", keys)) {
    PictureOptions picture{.unit = entry.text("unit", ""), .where = entry.where()};
    picture.field = choices.fields.empty() ? entry.text("field") : named(entry, "field", choices.fields, "field");
    if (picture.field.empty()) picture.field = entry.text("field");  // which says that it is missing
    picture.name = plain_name(entry, entry.text("name", picture.field));
    if (std::ranges::find(pictures, picture.name, &PictureOptions::name) != pictures.end())
      entry.fail("name", fmt::format("two pictures are called \"{}\": give one of them another name", picture.name));
    if (entry.has("view")) picture.view = two_numbers(entry, "view", "the angle about z and that above the plane xy");
    if (picture.view && !(std::abs((*picture.view)[0]) <= 360.0 && std::abs((*picture.view)[1]) <= 90.0))
      entry.fail("view",
                 fmt::format("view is [{:.6g}, {:.6g}], expected an angle about z from -360 to 360 degrees, and "
                             "one above the plane xy from -90 to 90",
                             (*picture.view)[0], (*picture.view)[1]));
    if (entry.has("range")) picture.range = two_numbers(entry, "range", "the ends of the colour scale");
    if (picture.range && !((*picture.range)[0] < (*picture.range)[1]))
      entry.fail("range", fmt::format("range is from {:.6g} to {:.6g}, expected a smaller and a larger number",
                                      (*picture.range)[0], (*picture.range)[1]));
    picture.load_case = named(entry, "case", choices.load_cases, "load case");
    if (entry.has("deformation")) picture.deformation = entry.number("deformation", {0.0, 1e9, true, true});
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

}  // namespace efree::internal
