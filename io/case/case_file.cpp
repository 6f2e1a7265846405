// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/case_file.hpp"

#include "efree/io/case/internal/case_readers.hpp"
#include "efree/io/case/internal/read_geometry.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <memory>
#include <string_view>
#include <utility>

namespace efree {
namespace {

using internal::CaseText, internal::Section;

using internal::AnalysisKind;

Section::Keys keys_of(AnalysisKind kind) {
  switch (kind) {
    case AnalysisKind::dynamics:
      return internal::dynamics_keys();
    case AnalysisKind::effective:
      return internal::effective_keys();
    default:
      return internal::static_keys();
  }
}
/// What cases of a kind are called, and how a case becomes one.
std::pair<std::string_view, std::string_view> words_for(AnalysisKind kind) {
  switch (kind) {
    case AnalysisKind::dynamics:
      return {"explicit dynamics", "set analysis.kind = \"dynamics\""};
    case AnalysisKind::effective:
      return {"effective properties", "set analysis.kind = \"effective\""};
    default:
      return {"static analyses", "set analysis.kind = \"static\""};
  }
}

/// Fails for a key of other kinds of cases.
void reject_other_keys(const Section& root, AnalysisKind kind) {
  const auto own = keys_of(kind);
  for (const AnalysisKind other : {AnalysisKind::statics, AnalysisKind::dynamics, AnalysisKind::effective})
    for (const std::string_view key : keys_of(other)) {
      if (!root.has(key) || std::ranges::find(own, key) != own.end()) continue;
      if (kind == AnalysisKind::effective)
        root.fail(key, fmt::format("[{}] means nothing for effective properties, whose loads are mean strains on the "
                                   "frame: leave it out",
                                   key));
      root.fail(key, kind == AnalysisKind::dynamics && other == AnalysisKind::statics
                         ? fmt::format("[{}] is for static analyses: leave it out in explicit dynamics", key)
                         : fmt::format("[{}] is for {}: {}", key, words_for(other).first, words_for(other).second));
    }
}

/// Reads as far as is the same for all kinds.
CaseText open_case(const std::filesystem::path& file, const Reading& reading) {
  const auto table = std::make_shared<const toml::table>(internal::parse_toml(file.string()));
  const Section any(*table, "", file.string(), {});
  internal::reject_former_keys(any);
  const auto kind = any.is_table("analysis") ? any.section("analysis", {})
                                                   .choice<AnalysisKind>("kind",
                                                                         {{"static", AnalysisKind::statics},
                                                                          {"dynamics", AnalysisKind::dynamics},
                                                                          {"effective", AnalysisKind::effective}},
                                                                         AnalysisKind::statics)
                                             : AnalysisKind::statics;
  reject_other_keys(any, kind);
  const Section root(*table, "", file.string(), keys_of(kind));
  return {file, table, kind, root, root.required_section("geometry", internal::geometry_keys()), reading};
}

int dimension_of(const CaseText& text, const Monitor& monitor) {
  const bool has_plane = text.root.is_table("analysis") && text.root.section("analysis", {}).has("plane");
  return internal::geometry_dimension(text.geometry, text.folder(), has_plane, text.reading, monitor);
}

}  // namespace

AnyCase read_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const CaseText text = open_case(file, reading);
  const bool is_planar = dimension_of(text, monitor) == 2;
  if (text.kind == AnalysisKind::effective) {
    if (is_planar) return internal::read_effective<2>(text);
    return internal::read_effective<3>(text);
  }
  if (text.kind == AnalysisKind::dynamics) {
    if (is_planar) return internal::read_dynamics<2>(text);
    return internal::read_dynamics<3>(text);
  }
  if (is_planar) return internal::read_static<2>(text);
  return internal::read_static<3>(text);
}

StaticCase read_static_case(const std::filesystem::path& file, const Reading& reading, const Monitor& monitor) {
  const CaseText text = open_case(file, reading);
  if (text.kind != AnalysisKind::statics)
    text.root.section("analysis", {})
        .fail("kind", fmt::format("this case is of {}, and this command is for static analyses: take efree run",
                                  words_for(text.kind).first));
  if (dimension_of(text, monitor) == 2) return internal::read_static<2>(text);
  return internal::read_static<3>(text);
}

template <int Dim> EffectiveResult find_effective(const EffectiveCase<Dim>& analysis, const Monitor& monitor) {
  if constexpr (Dim == 3)
    if (analysis.geometry.image) {
      const MadeImage<3> image = [&] {
        const Stage stage("image", monitor);
        return analysis.geometry.image(stage);
      }();
      if (monitor.say)
        for (const std::string& remark : image.remarks) monitor.say(remark);
      return find_effective(analysis, image, monitor);
    }
  return find_effective<Dim>(analysis, analysis.geometry, monitor);
}

template EffectiveResult find_effective(const EffectiveCase<2>&, const Monitor&);
template EffectiveResult find_effective(const EffectiveCase<3>&, const Monitor&);

}  // namespace efree
