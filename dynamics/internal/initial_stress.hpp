// SPDX-License-Identifier: GPL-3.0-or-later
/// Stresses at the start of a run.
#pragma once

#include "efree/core/types.hpp"

#include <functional>
#include <optional>

namespace efree::internal {

/// Cauchy stress by body and position; nothing: the point stays as it is.
template <int Dim> using InitialStressField = std::function<std::optional<Mat<3>>(Index body, const Vec<Dim>& x)>;

}  // namespace efree::internal
