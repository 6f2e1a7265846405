// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/settings.hpp"

#include "efree/analysis/internal/by_region.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>

namespace efree {

std::string text_of(const PathEnd& end) {
  std::string text = fmt::format("{} \"{}\"", end.of == PathEnd::Of::probe ? "probe" : "reaction", end.name);
  if (end.component >= 0) text += fmt::format(" {}", "xyz"[end.component]);
  if (end.above) text += fmt::format(" rises above {:.6g}", *end.above);
  if (end.below) text += fmt::format("{} falls below {:.6g}", end.above ? " or" : "", *end.below);
  return text;
}

template <int Dim> Strength strength_of(const CommonSettings<Dim>& settings, const std::string& region) {
  const RegionMaterial* own = internal::material_of(settings, region);
  return own == nullptr ? settings.strength : own->strength;
}

template <int Dim> std::vector<Loads<Dim>> loads_by_case(const Settings<Dim>& settings) {
  if (settings.cases.empty()) return {settings.loads};
  std::vector<Loads<Dim>> all;
  for (const auto& one : settings.cases) {
    Loads<Dim>& loads = all.emplace_back(settings.loads);
    const auto append = [](auto& to, const auto& more) { to.insert(to.end(), more.begin(), more.end()); };
    append(loads.tractions, one.loads.tractions);
    append(loads.followers, one.loads.followers);
    append(loads.resultants, one.loads.resultants);
    append(loads.mass_forces, one.loads.mass_forces);
    if (one.loads.body_force)
      loads.body_force = [common = settings.loads.body_force, own = one.loads.body_force](const Vec<Dim>& x) {
        return common ? Vec<Dim>(common(x) + own(x)) : own(x);
      };
  }
  return all;
}

template <int Dim> void require_estimates(const Settings<Dim>& settings) {
  if (!settings.cases.empty())
    throw InputError(internal::said_at(internal::where_said(settings.common, "accuracy"),
                                       "an accuracy cannot be asked for several load cases: ask for it "
                                       "in one of them, and give the others its mesh_size"));
  if (settings.common.approximation.kind == BasisKind::mls && settings.corrected) return;
  throw InputError(internal::said_at(
      internal::where_said(settings.common, "accuracy"),
      "an accuracy can be asked for where the error is estimated and the answer corrected: with basis.kind = "
      "\"mls\" or \"cells\" and analysis.correction = \"auto\""));
}

template Strength strength_of<2>(const CommonSettings<2>&, const std::string&);
template Strength strength_of<3>(const CommonSettings<3>&, const std::string&);
template std::vector<Loads<2>> loads_by_case<2>(const Settings<2>&);
template std::vector<Loads<3>> loads_by_case<3>(const Settings<3>&);
template void require_estimates<2>(const Settings<2>&);
template void require_estimates<3>(const Settings<3>&);

}  // namespace efree
