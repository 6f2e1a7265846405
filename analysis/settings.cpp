// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/settings.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"

#include <algorithm>

namespace efree {

template <int Dim> void require_estimates(const Settings<Dim>& settings) {
  if (settings.approximation.kind == BasisKind::mls && settings.corrected) return;
  throw InputError(internal::said_at(
      settings.where,
      "an accuracy can be asked for where the error is estimated and the answer corrected: with basis.kind = "
      "\"mls\" or \"cells\" and analysis.correction = \"auto\""));
}

template <int Dim> bool locks_without_dilatation(const Settings<Dim>& settings) {
  constexpr double bearable = 4.67;  // nu = 0.4
  return settings.approximation.kind == BasisKind::mls && settings.model.plane != Plane::stress &&
         std::ranges::any_of(settings.materials,
                             [](const auto& material) { return material.incompressibility > bearable; });
}

template <int Dim> void impose(Settings<Dim>& settings, Essential essential) {
  settings.model.essential = essential;
  auto& vanish_on = settings.approximation.vanish_on;
  vanish_on.clear();
  if (essential == Essential::nitsche || settings.approximation.kind != BasisKind::mls) return;
  for (const auto& support : settings.supports)
    if (std::ranges::find(vanish_on, support.on) == vanish_on.end()) vanish_on.push_back(support.on);
}

template void require_estimates<2>(const Settings<2>&);
template void require_estimates<3>(const Settings<3>&);
template bool locks_without_dilatation<2>(const Settings<2>&);
template bool locks_without_dilatation<3>(const Settings<3>&);
template void impose<2>(Settings<2>&, Essential);
template void impose<3>(Settings<3>&, Essential);

}  // namespace efree
