// SPDX-License-Identifier: GPL-3.0-or-later
/// Parts of the boundary, in entries of a case file.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/io/internal/section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <map>
#include <string>
#include <utility>

namespace efree::internal {

/// Gives the parts of the boundary that entries are about: names, or selections that get a name here.
template <int Dim> class PlaceReader {
 public:
  explicit PlaceReader(Settings<Dim>& result) : result_(result) {}

  /// Name of the part the entry is about, which the case then mentions. Equal selections share a name.
  std::string name(const Section& entry) {
    const std::string on = entry.is_table("on") ? selected(entry) : entry.text("on");
    if (std::ranges::find(result_.groups, on, &Mention::name) == result_.groups.end())
      result_.groups.push_back({on, entry.where("on")});
    return on;
  }

 private:
  std::string selected(const Section& entry) {
    const auto [kind, how] = selection(entry.section("on", {"box", "plane", "normal", "angle", "nearest"}));
    for (const auto& earlier : result_.selections)
      if (earlier.how == how) return earlier.name;
    const std::string name = fmt::format("{} {}", kind, ++count_[kind]);
    result_.selections.push_back({name, how, entry.where("on")});
    return name;
  }
  std::pair<std::string, Selection<Dim>> selection(const Section& on) const {
    Section::Keys found;
    for (const std::string_view key : {"box", "plane", "normal", "nearest"})
      if (on.has(key)) found.push_back(key);
    if (found.size() != 1)
      on.fail("", fmt::format("a selection has exactly one of box, plane, normal, nearest; this one has {}",
                              found.empty() ? "none" : fmt::format("{}", fmt::join(found, " and "))));
    const std::string kind(found.front());
    if (on.has("angle") && (kind == "box" || kind == "plane"))
      on.fail("angle", fmt::format("angle has no meaning for a {}", kind));
    const double angle = on.number("angle", {0.0, 180.0, false, true}, 30.0);
    if (kind == "box") {
      const auto [a, b] = on.template corners<Dim>("box");
      return {kind, InBox<Dim>{a.cwiseMin(b), a.cwiseMax(b)}};
    }
    if (kind == "plane") {
      const Section plane = on.section("plane", {"point", "normal", "tolerance"});
      return {kind, OnPlane<Dim>{plane.template point<Dim>("point"), plane.template direction<Dim>("normal"),
                                 plane.number("tolerance", not_negative, 0.0)}};
    }
    if (kind == "normal") return {kind, Facing<Dim>{on.template direction<Dim>("normal"), angle}};
    return {kind, NearestPatch<Dim>{on.template point<Dim>("nearest"), angle}};
  }

  Settings<Dim>& result_;
  std::map<std::string, int> count_;
};

}  // namespace efree::internal
