// SPDX-License-Identifier: GPL-3.0-or-later
/// [[wall]] and [[rigid_body]] of a case file. All that throws, throws InputError that begins with "file:line: ".
#pragma once

#include "efree/analysis/dynamics.hpp"
#include "efree/io/case/internal/section.hpp"

#include <filesystem>
#include <vector>

namespace efree::internal {

template <int Dim> void read_walls(const std::vector<Section>& entries, DynamicsSettings<Dim>& dynamics);
/// Files are looked for in `folder`; root, grey: of expressions, as read_definitions takes them.
template <int Dim> void read_rigid_bodies(const std::vector<Section>& entries, const std::filesystem::path& folder,
                                          const Section& root, const ScalarField<Dim>& grey,
                                          DynamicsSettings<Dim>& dynamics);

}  // namespace efree::internal
