// SPDX-License-Identifier: GPL-3.0-or-later
/// What is smooth in an error goes: a solution in few unknowns.
#pragma once

#include "efree/core/types.hpp"

#include <utility>
#include <vector>

namespace efree {

/// A space of few displacements with the factor of its stiffness.
template <int Dim> class CoarseSolver {
 public:
  virtual ~CoarseSolver() = default;
  /// The displacements that forces without a part on what is held (each Dim x nodes of the elements) lead to in this
  /// space.
  virtual std::vector<Points<Dim>> solve(const std::vector<const Points<Dim>*>& forces) const = 0;
  Points<Dim> solve(const Points<Dim>& forces) const { return std::move(solve(std::vector{&forces}).front()); }
};

}  // namespace efree
