// SPDX-License-Identifier: GPL-3.0-or-later
/// Parts of the boundary, in entries of a case file.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/io/case/internal/section.hpp"

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
  explicit PlaceReader(CommonSettings<Dim>& result) : result_(result) {}

  /// Name of the part the entry is about, which the case then mentions. Equal selections share a name, and so do equal
  /// lists of parts, each of which is one part.
  std::string name(const Section& entry) {
    std::string on;
    if (entry.has("on") && entry.table().get("on")->is_array())
      on = united(entry, *entry.table().get("on")->as_array());
    else
      on = entry.is_table("on") ? selected(entry.section("on", selection_keys()), entry.where("on")) : entry.text("on");
    mention(on, entry.where("on"));
    return on;
  }
  /// The parts that a name stands for: those of a list, else itself.
  std::vector<std::string> parts(const std::string& on) const {
    const auto found = united_.find(on);
    return found == united_.end() ? std::vector{on} : found->second;
  }

 private:
  static Section::Keys selection_keys() { return {"box", "plane", "normal", "angle", "nearest"}; }
  void mention(const std::string& on, const std::string& where) {
    if (std::ranges::find(result_.groups, on, &Mention::name) == result_.groups.end())
      result_.groups.push_back({on, where});
  }
  /// The name of a list: its parts with " + " between them, in their order.
  std::string united(const Section& entry, const toml::array& list) {
    std::vector<std::string> parts;
    for (const toml::node& node : list) {
      const bool is_name = node.is_string() && !node.value<std::string>()->empty();
      if (!is_name && !node.is_table())
        entry.fail("on",
                   "on has something else in its list than names of parts and selections, such as on = "
                   "[\"left\", \"right\"]");
      parts.push_back(is_name ? *node.value<std::string>()
                              : selected(entry.section(*node.as_table(), "on", selection_keys()), entry.where("on")));
      if (std::ranges::count(parts, parts.back()) > 1)
        entry.fail("on", fmt::format("on names \"{}\" twice", parts.back()));
    }
    if (parts.empty()) entry.fail("on", "on is an empty list, expected names of parts");
    if (parts.size() == 1) return parts.front();
    std::string name = fmt::format("{}", fmt::join(parts, " + "));
    for (const std::string& part : parts) mention(part, entry.where("on"));
    if (united_.try_emplace(name, parts).second)
      result_.selections.push_back({name, {}, entry.where("on"), std::move(parts)});
    return name;
  }
  std::string selected(const Section& on, const std::string& where) {
    const auto [kind, how] = selection(on);
    for (const auto& earlier : result_.selections)
      if (earlier.parts.empty() && earlier.how == how) return earlier.name;
    const std::string name = fmt::format("{} {}", kind, ++count_[kind]);
    result_.selections.push_back({name, how, where});
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

  CommonSettings<Dim>& result_;
  std::map<std::string, int> count_;
  std::map<std::string, std::vector<std::string>> united_;  ///< parts by the name of their list
};

}  // namespace efree::internal
