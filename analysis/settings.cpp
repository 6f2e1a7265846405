// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/settings.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"

namespace efree {

template <int Dim> void require_estimates(const Settings<Dim>& settings) {
  if (settings.approximation.kind == BasisKind::mls && settings.corrected) return;
  throw InputError(internal::said_at(
      settings.where,
      "an accuracy can be asked for where the error is estimated and the answer corrected: with basis.kind = "
      "\"mls\" or \"cells\" and analysis.correction = \"auto\""));
}

template void require_estimates<2>(const Settings<2>&);
template void require_estimates<3>(const Settings<3>&);

}  // namespace efree
