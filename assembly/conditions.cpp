// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/conditions.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>

namespace efree {

template <int Dim> std::vector<Restraint<Dim>> restraints(const std::vector<DisplacementCondition<Dim>>& conditions) {
  std::vector<Restraint<Dim>> list;
  for (const auto& condition : conditions) {
    const std::size_t before = list.size();
    for (int i = 0; i < Dim; ++i)
      if (condition.components[i]) list.push_back({condition.on, i, condition.components[i], condition.stiffness});
    if (condition.normal && list.size() > before)
      throw InputError(
          fmt::format("displacement on \"{}\": give components or the normal one, not both", condition.on));
    if (condition.normal) list.push_back({condition.on, -1, condition.normal, condition.stiffness});
    if (list.size() == before) throw InputError(fmt::format("displacement on \"{}\" prescribes nothing", condition.on));
  }
  return list;
}

template std::vector<Restraint<2>> restraints<2>(const std::vector<DisplacementCondition<2>>&);
template std::vector<Restraint<3>> restraints<3>(const std::vector<DisplacementCondition<3>>&);

}  // namespace efree
