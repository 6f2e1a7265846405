// SPDX-License-Identifier: GPL-3.0-or-later
/// Names that settings use and that the mesh must have.
#pragma once

#include "efree/analysis/settings.hpp"

#include <vector>

namespace efree::internal {

/// Every boundary that spacings name, once: those of settings.groups first.
template <int Dim> std::vector<Mention> boundaries(const CommonSettings<Dim>& settings);
/// The same, with those that supports, loads and reactions name before those of spacings.
template <int Dim> std::vector<Mention> boundaries(const Settings<Dim>& settings);
/// Every region with a spacing of its own, once: those of settings.graded first.
template <int Dim> std::vector<Mention> graded_regions(const CommonSettings<Dim>& settings);

}  // namespace efree::internal
