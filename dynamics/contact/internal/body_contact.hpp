// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/scheme.hpp"

namespace efree::internal {

/// Contact between deformable bodies by penalty springs, with friction. Acts if ContactOptions::stiffness > 0 and there
/// are several bodies. The scheme, which knows the surfaces, must outlive it.
template <int Dim> std::unique_ptr<Interaction<Dim>> body_contact(const Scheme<Dim>& scheme);

}  // namespace efree::internal
