// SPDX-License-Identifier: GPL-3.0-or-later
/// Readers of the kinds of cases. All that throws, throws InputError that begins with "file:line: ".
#pragma once

#include "efree/io/case/case_file.hpp"
#include "efree/io/case/internal/case_parts.hpp"

namespace efree::internal {

/// Keys of the file, by the kind of case.
Section::Keys static_keys();
Section::Keys dynamics_keys();
Section::Keys effective_keys();
/// Fails for keys that earlier versions had for dynamics: the message names the new ones.
void reject_former_keys(const Section& root);

template <int Dim> Case<Dim> read_static(const CaseText& text);
template <int Dim> DynamicsCase<Dim> read_dynamics(const CaseText& text);
template <int Dim> EffectiveCase<Dim> read_effective(const CaseText& text);

}  // namespace efree::internal
