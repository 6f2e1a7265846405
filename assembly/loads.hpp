// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads as forces on nodes.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/assembly/resultants.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"

#include <string>
#include <vector>

namespace efree {

/// f = int phi_I t + int phi_I b, integrated on the fine mesh: Dim x N. Throws InputError for an unknown boundary, a
/// traction, force or density that is not finite (naming the point), mass forces without a density for every region,
/// axisymmetric, resultants other than forces along the axis, and pressures that follow the body, which is taken to be
/// at rest.
template <int Dim>
Points<Dim> load_vector(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape, const Loads<Dim>& loads);

/// One load and what it amounts to.
template <int Dim> struct AppliedLoad {
  std::string on;    ///< part of the boundary; empty for what acts on the whole body
  std::string kind;  ///< "traction", "pressure", "follower_pressure", "force", "body_force", "acceleration", "rotation"
  Resultant<Dim> of;
};
/// Each of the loads, as load_vector integrates it: tractions, resultants, body force, mass forces. Moments are those
/// of forces where they act, or with `moved_by` (Dim x space.size()) where the body has moved since. Throws likewise.
template <int Dim> std::vector<AppliedLoad<Dim>> applied_loads(const FineSpace<Dim>& space, const Loads<Dim>& loads,
                                                               const Points<Dim>* moved_by = nullptr);

/// A part of the boundary as forces on it see it: area, its first and second moments about the origin.
template <int Dim> struct AreaMoments {
  double area = 0.0;
  Vec<Dim> first = Vec<Dim>::Zero();
  Mat<Dim> second = Mat<Dim>::Zero();

  void add(const Vec<Dim>& x, double weight) {
    area += weight;
    first += weight * x;
    second += weight * x * x.transpose();
  }
  /// The traction of a load on it.
  TractionCondition<Dim> traction(const ResultantLoad<Dim>& load) const;
};

}  // namespace efree
