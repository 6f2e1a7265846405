// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/io/case/case_file.hpp"
#include "efree/tests/io/workspace.hpp"

#include <string>
#include <variant>

namespace efree::test {

/// The result of a case by its text, to the accuracy that it asks for.
template <int Dim = 2> Result<Dim> solved(const std::string& text) {
  const Workspace work(text);
  const auto analysis = std::get<Case<Dim>>(read_case(work / "case.toml"));
  return analysis.asks_for_accuracy() ? analyse_to_accuracy(analysis) : analyse(analysis);
}

}  // namespace efree::test
