// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/case_file.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"
#include "efree/io/case/internal/case_readers.hpp"
#include "efree/io/case/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <type_traits>
#include <utility>

namespace efree {
namespace {

using internal::CaseText, internal::Section;

template <int Dim> AnyCase read(const CaseText& text, bool is_dynamics) {
  if (is_dynamics) return internal::read_dynamics<Dim>(text);
  return internal::read_static<Dim>(text);
}

}  // namespace

AnyCase read_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const auto table = std::make_shared<const toml::table>(internal::parse_toml(file.string()));
  const Section any(*table, "", file.string(), {});
  const bool has_analysis = any.is_table("analysis");
  internal::reject_former_keys(any);
  const bool is_dynamics =
      has_analysis && any.section("analysis", {}).choice<bool>("kind", {{"static", false}, {"dynamics", true}}, false);
  if (!is_dynamics) internal::reject_dynamics_keys(any);
  const Section root(*table, "", file.string(), is_dynamics ? internal::dynamics_keys() : internal::static_keys());
  const CaseText text{file, table, root, root.required_section("geometry", internal::geometry_keys()), reading};
  const bool has_plane = has_analysis && root.section("analysis", {}).has("plane");
  return internal::geometry_dimension(text.geometry, text.folder(), has_plane, reading, monitor) == 2
             ? read<2>(text, is_dynamics)
             : read<3>(text, is_dynamics);
}

StaticCase read_static_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const auto static_only = [](auto&& any) -> StaticCase {
    if constexpr (std::is_constructible_v<StaticCase, decltype(any)>)
      return std::forward<decltype(any)>(any);
    else
      throw InputError(internal::said_at(
          internal::where_said(any.common, "analysis.kind"),
          "this case is of explicit dynamics, and this command is for static analyses: take efree run"));
  };
  return std::visit(static_only, read_case(file, reading, monitor));
}

}  // namespace efree
