// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/case_file.hpp"

#include "efree/io/case/internal/case_readers.hpp"
#include "efree/io/case/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <memory>
#include <string_view>

namespace efree {
namespace {

using internal::CaseText, internal::Section;

/// Fails for a key of the other kind of case.
void reject_other_keys(const Section& root, bool is_dynamics) {
  const auto own = is_dynamics ? internal::dynamics_keys() : internal::static_keys();
  for (const std::string_view key : is_dynamics ? internal::static_keys() : internal::dynamics_keys())
    if (root.has(key) && std::ranges::find(own, key) == own.end())
      root.fail(key, is_dynamics ? fmt::format("[{}] is for static analyses: leave it out in explicit dynamics", key)
                                 : fmt::format("[{}] is for explicit dynamics: set analysis.kind = \"dynamics\"", key));
}

/// Reads as far as is the same for all kinds.
CaseText open_case(const std::filesystem::path& file, const Reading& reading) {
  const auto table = std::make_shared<const toml::table>(internal::parse_toml(file.string()));
  const Section any(*table, "", file.string(), {});
  internal::reject_former_keys(any);
  const bool is_dynamics =
      any.is_table("analysis") &&
      any.section("analysis", {}).choice<bool>("kind", {{"static", false}, {"dynamics", true}}, false);
  reject_other_keys(any, is_dynamics);
  const Section root(*table, "", file.string(), is_dynamics ? internal::dynamics_keys() : internal::static_keys());
  return {file, table, is_dynamics, root, root.required_section("geometry", internal::geometry_keys()), reading};
}

int dimension_of(const CaseText& text, const Monitor& monitor) {
  const bool has_plane = text.root.is_table("analysis") && text.root.section("analysis", {}).has("plane");
  return internal::geometry_dimension(text.geometry, text.folder(), has_plane, text.reading, monitor);
}

}  // namespace

AnyCase read_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const CaseText text = open_case(file, reading);
  const bool is_planar = dimension_of(text, monitor) == 2;
  if (text.is_dynamics) {
    if (is_planar) return internal::read_dynamics<2>(text);
    return internal::read_dynamics<3>(text);
  }
  if (is_planar) return internal::read_static<2>(text);
  return internal::read_static<3>(text);
}

StaticCase read_static_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const CaseText text = open_case(file, reading);
  if (text.is_dynamics)
    text.root.section("analysis", {})
        .fail("kind", "this case is of explicit dynamics, and this command is for static analyses: take efree run");
  if (dimension_of(text, monitor) == 2) return internal::read_static<2>(text);
  return internal::read_static<3>(text);
}

}  // namespace efree
