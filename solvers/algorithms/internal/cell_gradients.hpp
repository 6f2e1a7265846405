// SPDX-License-Identifier: GPL-3.0-or-later
/// Gradients of several fields in a cell.
#pragma once

#include "efree/assembly/kinematics.hpp"
#include "efree/basis/fine_space.hpp"

#include <span>
#include <vector>

namespace efree {

/// The functions of one cell after the other at the points of a rule, worked out once for all fields that are asked for
/// there.
template <int Dim> class CellGradients {
 public:
  /// Keeps references to both.
  CellGradients(const FineSpace<Dim>& space, const SimplexRule<Dim>& rule)
      : space_(space), rule_(rule), dN_(rule.weights.size()), hoop_(space.axisymmetric() ? rule.weights.size() : 0) {}

  void enter(Index c) {
    dofs_ = space_.cell(c);
    for (std::size_t q = 0; q < dN_.size(); ++q) {
      const typename FineSpace<Dim>::Barycentric at = rule_.points.col(static_cast<Index>(q));
      dN_[q] = space_.gradients(c, at);
      if (!hoop_.empty()) hoop_[q] = space_.values(at) / space_.position(c, at)[0];
    }
  }
  /// In the cell that was entered, at point q of the rule, of the field with values u (Dim x space.size()): as
  /// gradient_at.
  Gradient<Dim> of(Index q, const Points<Dim>& u) const {
    Gradient<Dim> H = Gradient<Dim>::Zero();
    const auto& dN = dN_[q];
    for (std::size_t i = 0; i < dofs_.size(); ++i)
      for (int J = 0; J < Dim; ++J) H.template segment<Dim>(Dim * J) += dN(J, static_cast<Index>(i)) * u.col(dofs_[i]);
    if constexpr (Dim == 2)
      for (std::size_t i = 0; i < dofs_.size() && !hoop_.empty(); ++i)
        H[4] += hoop_[q][static_cast<Index>(i)] * u(0, dofs_[i]);
    return H;
  }

 private:
  const FineSpace<Dim>& space_;
  const SimplexRule<Dim>& rule_;
  std::span<const Index> dofs_;
  std::vector<typename FineSpace<Dim>::CellGradients> dN_;
  std::vector<typename FineSpace<Dim>::CellValues> hoop_;
};

}  // namespace efree
