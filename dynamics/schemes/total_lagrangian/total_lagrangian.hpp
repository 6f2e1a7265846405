// SPDX-License-Identifier: GPL-3.0-or-later
/// Total Lagrangian dynamics: tables of shape functions in the reference configuration, such as those of the static
/// solver and of finite elements, which stay.
#pragma once

#include "efree/dynamics/scheme.hpp"

#include <memory>

namespace efree {

/// Every body of the run must have a DeformableBody::shape.
template <int Dim> std::unique_ptr<Scheme<Dim>> total_lagrangian();

}  // namespace efree
