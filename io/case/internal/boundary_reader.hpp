// SPDX-License-Identifier: GPL-3.0-or-later
/// [[boundary]] entries of static cases.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/assembly/internal/no_follower.hpp"
#include "efree/io/case/expression.hpp"
#include "efree/io/case/internal/place_reader.hpp"
#include "efree/io/case/internal/section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace efree::internal {

/// The [[boundary]] entries: each prescribes one thing on one part. Loads are refused where the body is held against
/// them.
template <int Dim> class BoundaryReader {
 public:
  BoundaryReader(const Expressions<Dim>& expressions, PlaceReader<Dim>& places, Settings<Dim>& result)
      : expressions_(expressions), places_(places), result_(result) {}

  void read(const std::vector<Section>& entries) {
    for (const Section& entry : entries) {
      const std::string on = places_.name(entry);
      read_support(entry, on, only_kind(entry));
      read_springs(entry, on, only_kind(entry));
    }
    for (const Section& entry : entries) read_load(entry, places_.name(entry), only_kind(entry), result_.loads);
  }
  /// The loads of a case. Supports are read before, and all cases share them.
  void read_case(const std::vector<Section>& entries, Loads<Dim>& loads) {
    for (const Section& entry : entries) {
      const std::string on = places_.name(entry);
      const std::string_view kind = only_kind(entry);
      if (kind != "traction" && kind != "pressure" && kind != "force")
        entry.fail(kind,
                   fmt::format("{} in a [[case]]: what holds the body is the same for all load cases, which share "
                               "one matrix; say it in a [[boundary]]",
                               kind));
      read_load(entry, on, kind, loads);
    }
  }

 private:
  static constexpr std::array<const char*, 3> component{"displacement component x", "displacement component y",
                                                        "displacement component z"};
  static constexpr const char* normal = "normal displacement";

  void read_support(const Section& entry, const std::string& on, std::string_view kind) {
    if (kind == "displacement") {
      refuse_if_claimed(entry, kind, on, normal);
      const auto components = entry.template expressions<Dim>(kind);
      if (std::ranges::count(components, "free") == Dim)
        entry.fail(kind, "displacement leaves every component free, expected a value for one of them");
      DisplacementCondition<Dim> condition{on, {}, {}};
      for (std::size_t i = 0; i < Dim; ++i) {
        if (components[i] == "free") continue;
        claim(entry, kind, on, component[i]);
        condition.components[i] = expressions_.field(components[i], entry.where(kind));
      }
      result_.supports.push_back(std::move(condition));
    } else if (kind == "normal_displacement") {
      for (int i = 0; i < Dim; ++i) refuse_if_claimed(entry, kind, on, component[i]);
      claim(entry, kind, on, normal);
      result_.supports.push_back({on, {}, expressions_.field(entry.expression(kind), entry.where(kind))});
    }
  }
  /// An elastic support: one number for all directions, or one for each; or along the normal.
  void read_springs(const Section& entry, const std::string& on, std::string_view kind) {
    const auto nothing = [](const Vec<Dim>&) { return 0.0; };
    const auto stiffness = [&](const std::string& text) -> ScalarField<Dim> {
      const auto field = expressions_.field(text, entry.where(kind));
      if (!expressions_.varies(text, entry.where(kind)) && !(field(Vec<Dim>::Zero()) >= 0.0))
        entry.fail(kind, fmt::format("{} is {:.6g}, expected a number >= 0", kind, field(Vec<Dim>::Zero())));
      return field;
    };
    if (kind == "normal_stiffness") {
      for (int i = 0; i < Dim; ++i) refuse_if_claimed(entry, kind, on, component[i]);
      claim(entry, kind, on, normal);
      result_.supports.push_back({on, {}, nothing, stiffness(entry.expression(kind))});
    } else if (kind == "stiffness") {
      refuse_if_claimed(entry, kind, on, normal);
      std::array<std::string, Dim> along;
      if (entry.table().get(kind)->is_array())
        along = entry.template expressions<Dim>(kind);
      else
        along.fill(entry.expression(kind));
      if (std::ranges::count(along, "0") == Dim)
        entry.fail(kind, "stiffness is zero along every direction, expected one that is not");
      for (std::size_t i = 0; i < Dim; ++i) {
        if (along[i] == "0") continue;
        claim(entry, kind, on, component[i]);
        DisplacementCondition<Dim> springs{on, {}, {}, stiffness(along[i])};
        springs.components[i] = nothing;
        result_.supports.push_back(std::move(springs));
      }
    }
  }
  /// A number, or an expression of the time and definitions but not of the place.
  double uniform(const Section& entry, std::string_view key, const std::string& text) const {
    if (expressions_.varies(text, entry.where(key)))
      entry.fail(key, fmt::format("{} depends on the place: it is of the whole part, expected numbers", key));
    return expressions_.field(text, entry.where(key))(Vec<Dim>::Zero());
  }
  template <std::size_t Size>
  Eigen::Matrix<double, static_cast<int>(Size), 1> uniform(const Section& entry, std::string_view key) const {
    const auto texts = entry.template expressions<Size>(key);
    Eigen::Matrix<double, static_cast<int>(Size), 1> values;
    for (std::size_t i = 0; i < Size; ++i) values[static_cast<int>(i)] = uniform(entry, key, texts[i]);
    return values;
  }
  /// Force and moment of a part.
  void read_resultant(const Section& entry, const std::string& on, Loads<Dim>& loads) {
    ResultantLoad<Dim> load{on};
    if (entry.has("force")) load.force = uniform<Dim>(entry, "force");
    if (entry.has("moment")) {
      if constexpr (Dim == 2)
        load.moment[0] = uniform(entry, "moment", entry.expression("moment"));
      else
        load.moment = uniform<3>(entry, "moment");
    }
    if (entry.has("at")) load.at = entry.template point<Dim>("at");
    if (load.at && !entry.has("force")) entry.fail("at", "at is where a force acts, and there is no force");
    if (result_.common.model.plane == Plane::axisymmetric && Dim == 2) {
      if (load.force[0] != 0.0)
        entry.fail("force", "around an axis of revolution radial forces have no resultant: expected [0, F]");
      for (const char* key : {"moment", "at"})
        if (entry.has(key))
          entry.fail(key, fmt::format("{} means nothing around an axis of revolution: forces act along it", key));
    }
    for (int i = 0; i < Dim; ++i)
      if (load.force[i] != 0.0) refuse_if_held(entry, "force", on, component[i]);
    for (const char* key : {"moment", "at"})
      if (entry.has(key)) {
        refuse_if_held(entry, key, on, normal);
        for (int i = 0; i < Dim; ++i) refuse_if_held(entry, key, on, component[i]);
      }
    loads.resultants.push_back(load);
  }
  void read_load(const Section& entry, const std::string& on, std::string_view kind, Loads<Dim>& loads) {
    if (kind == "force") {
      read_resultant(entry, on, loads);
    } else if (kind == "traction") {
      const auto components = entry.template expressions<Dim>(kind);
      for (std::size_t i = 0; i < Dim; ++i)
        if (components[i] != "0" && components[i] != "-0") refuse_if_held(entry, kind, on, component[i]);
      const auto traction = expressions_.fields(components, entry.where(kind));
      loads.tractions.push_back({on, [traction](const Vec<Dim>& x, const Vec<Dim>&) { return traction(x); }});
    } else if (kind == "pressure") {
      refuse_if_held(entry, kind, on, normal);
      int held = 0;
      for (int i = 0; i < Dim; ++i) held += claimed(on, component[i], true) != nullptr;
      if (held == Dim) refuse_if_held(entry, kind, on, component[Dim - 1]);
      const auto value = expressions_.field(entry.expression(kind), entry.where(kind));
      if (entry.boolean("follower", false))
        add_follower(entry, {on, value}, loads);
      else
        loads.tractions.push_back(pressure<Dim>(on, value));
    }
  }
  void add_follower(const Section& entry, const FollowerPressure<Dim>& pressure, Loads<Dim>& loads) {
    loads.followers.push_back(pressure);
    result_.common.said.try_emplace(follower_on(pressure.on), entry.where("follower"));
  }
  static std::string_view only_kind(const Section& entry) {
    std::vector<std::string_view> found;
    for (const std::string_view kind :
         {"displacement", "normal_displacement", "stiffness", "normal_stiffness", "traction", "pressure", "force"})
      if (entry.has(kind)) found.push_back(kind);
    if (!entry.has("force") && entry.has("moment")) found.push_back("force");
    if (entry.has("at") && std::ranges::find(found, "force") == found.end())
      entry.fail("at", "at is where a force acts, and there is no force");
    if (entry.has("follower") && !entry.has("pressure"))
      entry.fail("follower", "follower is for a pressure, and there is none");
    if (found.size() != 1)
      entry.fail(
          "on",
          fmt::format("a [[boundary]] entry prescribes exactly one of displacement, normal_displacement, stiffness, "
                      "normal_stiffness, traction, pressure, force (with moment); this one has {}. Several entries may "
                      "name the "
                      "same boundary",
                      found.empty() ? "none" : fmt::format("{}", fmt::join(found, " and "))));
    return found.front();
  }
  /// What is prescribed on a part: held rigidly, or by springs, which bear loads.
  struct Claim {
    std::string where;
    bool rigid;
  };
  void claim(const Section& entry, std::string_view key, const std::string& on, const std::string& what) {
    const bool rigid = key == "displacement" || key == "normal_displacement";
    for (const std::string& part : places_.parts(on)) {
      const auto [earlier, is_new] = claimed_.try_emplace({part, what}, Claim{entry.where(key), rigid});
      if (!is_new)
        entry.fail(key, fmt::format("{} on \"{}\" is already prescribed at {}", what, part, earlier->second.where));
    }
  }
  /// Another support of the part, or of one of its parts; of this kind only if it is to be rigid.
  const Claim* claimed(const std::string& on, const std::string& what, bool rigid) const {
    for (const std::string& part : places_.parts(on))
      if (const auto found = claimed_.find({part, what}); found != claimed_.end() && (found->second.rigid || !rigid))
        return &found->second;
    return nullptr;
  }
  /// Of supports, which springs exclude, too.
  void refuse_if_claimed(const Section& entry, std::string_view key, const std::string& on,
                         const std::string& what) const {
    refuse(entry, key, on, what, claimed(on, what, false));
  }
  /// Of loads, which springs bear.
  void refuse_if_held(const Section& entry, std::string_view key, const std::string& on,
                      const std::string& what) const {
    refuse(entry, key, on, what, claimed(on, what, true));
  }
  static void refuse(const Section& entry, std::string_view key, const std::string& on, const std::string& what,
                     const Claim* by) {
    if (by)
      entry.fail(key, fmt::format("{} on \"{}\" contradicts the {} prescribed at {}, expected one of them", key, on,
                                  what, by->where));
  }

  const Expressions<Dim>& expressions_;
  PlaceReader<Dim>& places_;
  Settings<Dim>& result_;
  std::map<std::pair<std::string, std::string>, Claim> claimed_;  ///< by boundary and what is prescribed
};

}  // namespace efree::internal
