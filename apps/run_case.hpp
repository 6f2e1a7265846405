// SPDX-License-Identifier: GPL-3.0-or-later
/// `efree run`: one case into one output directory, whatever is computed.
#pragma once

#include "display.hpp"
#include "efree/io/case/case_file.hpp"

#include <string>

namespace efree {

struct RunOptions {
  std::string out{};  ///< directory
  bool quiet = false, no_picture = false;
  bool resume = false;  ///< go on from the steps of an earlier run
};

/// Throws InputError; and NumericalError if the run fails or its results are rejected, once failure.json and what there
/// is of results are in the directory. A signal ends it with the directory as it was; explicit dynamics after a
/// checkpoint.
template <int Dim> void run_case(Case<Dim> analysis, const RunOptions& options, Display& display);
template <int Dim> void run_case(const DynamicsCase<Dim>& dynamics_case, const RunOptions& options, Display& display);
template <int Dim> void run_case(const EffectiveCase<Dim>& analysis, const RunOptions& options, Display& display);

}  // namespace efree
